//! The part of a character that is matched: the one piece of its surface that carries the
//! landmarks, with texture seams closed.

use super::RetargetError;
use crate::mesh::{MeshError, Submesh, TriangleMesh, weld_seams};

/// The connected piece of a surface that takes part in matching.
pub(super) struct Body {
    /// The piece, seams closed.
    pub(super) surface: Submesh,
    /// Vertex of the whole mesh that stands for each vertex once seams are closed.
    stands_for: Vec<u32>,
}

/// Pieces of a surface once seams are closed.
pub(super) struct Pieces {
    welded: TriangleMesh,
    stands_for: Vec<u32>,
    components: Vec<u32>,
}

impl Pieces {
    pub(super) fn new(mesh: &TriangleMesh) -> Result<Self, MeshError> {
        let stands_for = weld_seams(mesh);
        let triangles = mesh.triangles().iter().map(|t| t.map(|v| stands_for[v as usize])).collect();
        let welded = TriangleMesh::new(mesh.vertices().to_vec(), triangles)?;
        if (0..welded.triangles().len()).all(|t| welded.area_vector(t).length() <= 0.0) {
            return Err(MeshError::NoSurface);
        }
        let components = welded.topology().components().to_vec();
        Ok(Self { welded, stands_for, components })
    }

    /// The piece of a vertex.
    pub(super) fn component(&self, vertex: u32) -> u32 {
        self.components[self.stands_for[vertex as usize] as usize]
    }

    /// The piece with the largest area; the one with the lowest vertex where two are equal.
    pub(super) fn largest(&self) -> u32 {
        let mut areas = vec![0.0; self.components.len()];
        for (t, triangle) in self.welded.triangles().iter().enumerate() {
            areas[self.components[triangle[0] as usize] as usize] += self.welded.area_vector(t).length();
        }
        let largest = (0..areas.len()).rev().max_by(|&a, &b| areas[a].total_cmp(&areas[b]));
        largest.unwrap_or(0) as u32
    }

    /// Takes one piece as the body.
    pub(super) fn body(self, component: u32) -> Result<Body, MeshError> {
        let surface = Submesh::new(&self.welded, |v| self.components[v] == component)?;
        Ok(Body { surface, stands_for: self.stands_for })
    }
}

impl Body {
    /// Vertex of the piece for a vertex of the whole mesh, `None` outside the piece.
    pub(super) fn local(&self, vertex: u32) -> Option<u32> {
        self.surface.to_part[self.stands_for[vertex as usize] as usize]
    }

    /// Vertex of the whole mesh for a vertex of the piece.
    pub(super) fn whole(&self, local: u32) -> u32 {
        self.surface.to_whole[local as usize]
    }
}

/// The pieces that carry the landmarks: all on one piece on either side.
///
/// # Errors
/// [`RetargetError::LandmarkOnOtherComponent`] naming the pair and the side.
pub(super) fn pieces_with_landmarks(
    source: &Pieces,
    target: &Pieces,
    landmarks: &[[u32; 2]],
) -> Result<[u32; 2], RetargetError> {
    let component = |pair: [u32; 2]| [source.component(pair[0]), target.component(pair[1])];
    let Some(&first) = landmarks.first() else {
        return Ok([source.largest(), target.largest()]);
    };
    let expected = component(first);
    for (landmark, &pair) in landmarks.iter().enumerate() {
        let found = component(pair);
        for (side, name) in ["source", "target"].into_iter().enumerate() {
            if found[side] != expected[side] {
                let vertex = pair[side] as usize;
                return Err(RetargetError::LandmarkOnOtherComponent { landmark, side: name, vertex });
            }
        }
    }
    Ok(expected)
}
