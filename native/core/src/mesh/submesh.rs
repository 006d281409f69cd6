//! Parts of a mesh: one component by itself, and seams closed that only an export had opened.

use std::collections::HashMap;

use super::{MeshError, TriangleMesh};

/// A part of a mesh with its way back.
#[derive(Debug, Clone, PartialEq)]
pub struct Submesh {
    /// The part.
    pub mesh: TriangleMesh,
    /// Vertex of the whole mesh for each vertex of the part.
    pub to_whole: Vec<u32>,
    /// Vertex of the part for each vertex of the whole mesh, `None` outside the part.
    pub to_part: Vec<Option<u32>>,
}

impl Submesh {
    /// The triangles whose vertices all satisfy `keep`, with the vertices that they use.
    ///
    /// # Errors
    /// [`MeshError::NoSurface`] when no triangle is kept.
    pub fn new(whole: &TriangleMesh, keep: impl Fn(usize) -> bool) -> Result<Self, MeshError> {
        let kept: Vec<[u32; 3]> =
            whole.triangles().iter().filter(|t| t.iter().all(|&v| keep(v as usize))).copied().collect();
        if kept.is_empty() {
            return Err(MeshError::NoSurface);
        }
        let mut to_part = vec![None; whole.vertex_count()];
        for &v in kept.iter().flatten() {
            to_part[v as usize] = Some(0);
        }
        let mut to_whole = Vec::new();
        for (v, slot) in to_part.iter_mut().enumerate() {
            if slot.is_some() {
                *slot = Some(to_whole.len() as u32);
                to_whole.push(v as u32);
            }
        }
        let vertices = to_whole.iter().map(|&v| whole.vertices()[v as usize]).collect();
        let triangles = kept.iter().map(|t| t.map(|v| to_part[v as usize].unwrap_or_default())).collect();
        Ok(Self { mesh: TriangleMesh::new(vertices, triangles)?, to_whole, to_part })
    }
}

/// Vertex that stands for each vertex once coincident vertices on open edges are one.
///
/// Exporters cut a surface along texture seams and repeat the vertices there; for distances over
/// the surface such a seam is not a gap. Only vertices at open edges are joined, so surfaces that
/// merely touch (closed lips) stay apart. The result maps every vertex to the smallest vertex of
/// its group.
#[must_use]
pub fn weld_seams(mesh: &TriangleMesh) -> Vec<u32> {
    let mut stands_for: Vec<u32> = (0..mesh.vertex_count() as u32).collect();
    let mut open: Vec<u32> = mesh.topology().boundary_edges().into_iter().flatten().collect();
    open.sort_unstable();
    open.dedup();
    let mut first: HashMap<[u64; 3], u32> = HashMap::with_capacity(open.len());
    for v in open {
        // Adding zero turns -0.0 into 0.0, so that equal positions have equal bits.
        let key = mesh.vertices()[v as usize].to_array().map(|x| (x + 0.0).to_bits());
        stands_for[v as usize] = *first.entry(key).or_insert(v);
    }
    stands_for
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn extracts_a_component_and_maps_back() {
        let vertices = (0..7).map(|i| DVec3::new(f64::from(i), f64::from(i * i), 0.0)).collect();
        let mesh = TriangleMesh::new(vertices, vec![[0, 2, 4], [1, 3, 5]]).unwrap();
        let components = mesh.topology().components().to_vec();
        let part = Submesh::new(&mesh, |v| components[v] == 1).unwrap();
        assert_eq!(part.to_whole, [1, 3, 5]);
        assert_eq!(part.mesh.triangles(), [[0, 1, 2]]);
        assert_eq!(part.to_part[3], Some(1));
        assert_eq!(part.to_part[6], None);
        assert_eq!(Submesh::new(&mesh, |v| v == 6), Err(MeshError::NoSurface));
    }

    #[test]
    fn welds_an_open_seam_but_not_touching_surfaces() {
        // Two triangles along a repeated edge, and a closed tetrahedron that touches vertex 0.
        let mut vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X, DVec3::Y, DVec3::ONE];
        let mut triangles = vec![[0, 1, 2], [3, 5, 4]];
        let base = vertices.len() as u32;
        vertices.extend([-DVec3::ZERO, -DVec3::X, -DVec3::Y, -DVec3::Z]);
        triangles.extend([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]].map(|t| t.map(|v: u32| v + base)));
        let mesh = TriangleMesh::new(vertices, triangles).unwrap();
        let welded = weld_seams(&mesh);
        assert_eq!(welded[..6], [0, 1, 2, 1, 2, 5]);
        assert_eq!(welded[6..], [6, 7, 8, 9]);
    }
}
