//! The loose parts of a surface, and what they are like: where, how large, how flat, how closed.

use glam::DVec3;

use crate::mesh::{TriangleMesh, weld_seams};

/// Size and place of a part. Lengths are in the mesh's unit.
#[derive(Debug, Clone, PartialEq)]
pub struct PartShape {
    /// Vertices, ascending; with those that others stand for on closed seams.
    pub vertices: Vec<u32>,
    /// Centre of the area; of the vertices where there is none.
    pub centre: DVec3,
    /// Lengths along the principal axes, descending: those of a box with the same moments.
    pub lengths: [f64; 3],
    /// Largest distance of a vertex to the centre.
    pub radius: f64,
    /// Area in square units.
    pub area: f64,
    /// Whether no edge is open.
    pub closed: bool,
}

/// Two parts are alike if their sizes differ by less than this factor.
const LIKE_SIZE: f64 = 1.6;
/// They are at the same place if their centres lie nearer than this share of their radius.
const LIKE_PLACE: f64 = 0.5;

impl PartShape {
    /// Whether the other part could be the same part of another character that lies at the same
    /// place: alike in size and proportions. Smaller is more alike; `None`: not alike.
    #[must_use]
    pub fn likeness(&self, other: &Self) -> Option<f64> {
        let radius = self.radius.max(other.radius);
        let apart = self.centre.distance(other.centre);
        let ratio = |a: f64, b: f64| a.max(b) / a.min(b);
        let flat = 0.1 * self.lengths[0].max(other.lengths[0]);
        // A thin axis counts by what it adds, so that cards of any thinness are alike.
        let worst = (self.lengths.iter().zip(other.lengths))
            .map(|(a, b)| ratio(a + flat, b + flat))
            .fold(1.0, f64::max);
        (apart <= LIKE_PLACE * radius && worst <= LIKE_SIZE && self.area > 0.0 && other.area > 0.0)
            .then(|| apart / radius + (worst - 1.0))
    }

    /// Whether the part has volume rather than being a sheet.
    #[must_use]
    pub fn is_bulky(&self) -> bool {
        let flatness = self.lengths[2] / self.lengths[0].max(f64::MIN_POSITIVE);
        flatness >= if self.closed { 0.1 } else { 0.25 }
    }
}

/// The connected parts of a surface once seams are closed, in the order of their smallest vertices,
/// and the part of every vertex (V). Loose vertices are parts without area.
#[must_use]
pub fn part_shapes(mesh: &TriangleMesh) -> (Vec<PartShape>, Vec<u32>) {
    let stands_for = weld_seams(mesh);
    let triangles = mesh.triangles().iter().map(|t| t.map(|v| stands_for[v as usize])).collect();
    let welded = TriangleMesh::new(mesh.vertices().to_vec(), triangles).unwrap_or_else(|_| mesh.clone());
    let topology = welded.topology();
    // A vertex that another stands for is a component of its own in the welded mesh, of no use.
    let mut number = vec![None; topology.component_count()];
    let mut members: Vec<Vec<u32>> = Vec::new();
    let mut part_of = vec![0; mesh.vertex_count()];
    for (v, &stand) in (0u32..).zip(&stands_for) {
        let slot = &mut number[topology.components()[stand as usize] as usize];
        let part = *slot.get_or_insert_with(|| {
            members.push(Vec::new());
            members.len() - 1
        });
        members[part].push(v);
        part_of[v as usize] = part as u32;
    }
    let mut faces: Vec<Vec<u32>> = vec![Vec::new(); members.len()];
    for (t, triangle) in (0u32..).zip(mesh.triangles()) {
        faces[part_of[triangle[0] as usize] as usize].push(t);
    }
    let mut closed = vec![true; members.len()];
    topology.boundary_edges().iter().for_each(|edge| closed[part_of[edge[0] as usize] as usize] = false);
    let shapes = members.into_iter().zip(faces).zip(closed);
    let shapes = shapes.map(|((vertices, faces), closed)| shape(mesh, vertices, &faces, closed)).collect();
    (shapes, part_of)
}

fn shape(mesh: &TriangleMesh, vertices: Vec<u32>, faces: &[u32], closed: bool) -> PartShape {
    let position = |v: &u32| mesh.vertices()[*v as usize];
    let middle = |t: u32| mesh.corners(t as usize).into_iter().sum::<DVec3>() / 3.0;
    let weight = |t: u32| 0.5 * mesh.area_vector(t as usize).length();
    let area: f64 = faces.iter().map(|&t| weight(t)).sum();
    let centre = if area > 0.0 {
        faces.iter().map(|&t| middle(t) * weight(t)).sum::<DVec3>() / area
    } else {
        vertices.iter().map(position).sum::<DVec3>() / vertices.len().max(1) as f64
    };
    let mut moment = nalgebra::Matrix3::<f64>::zeros();
    for &t in faces.iter().filter(|_| area > 0.0) {
        // Exact second moment of a triangle: its corners and its middle.
        let points = mesh.corners(t as usize).map(|p| (p, 1.0)).into_iter().chain([(middle(t), 9.0)]);
        for (point, share) in points {
            let x = (point - centre).to_array();
            let share = share * weight(t) / (12.0 * area);
            moment += nalgebra::Matrix3::from_fn(|row, column| share * x[row] * x[column]);
        }
    }
    let mut squares: Vec<f64> = moment.symmetric_eigenvalues().iter().copied().collect();
    squares.sort_unstable_by(|a, b| b.total_cmp(a));
    let length = |axis: usize| (12.0 * squares[axis].max(0.0)).sqrt();
    let radius = vertices.iter().map(|v| position(v).distance(centre)).fold(0.0, f64::max);
    let closed = closed && area > 0.0;
    PartShape { vertices, centre, lengths: [length(0), length(1), length(2)], radius, area, closed }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::test_surfaces::{grid, icosphere, joined, mapped, similarity};

    #[test]
    fn measures_parts() {
        let plate = mapped(&grid(4), |p| p * DVec3::new(4.0, 2.0, 1.0));
        let (shapes, part_of) = part_shapes(&joined(&plate, &icosphere(3)));
        assert_eq!((shapes.len(), part_of[0], part_of[25]), (2, 0, 1));
        let expected = [4.0, 2.0, 0.0];
        assert!(shapes[0].lengths.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9));
        assert!(!shapes[0].closed && !shapes[0].is_bulky());
        // A spherical shell has the second moment 1/3 along every axis.
        assert!(shapes[1].lengths.iter().all(|a| (a - 2.0).abs() < 0.02));
        assert!(shapes[1].closed && shapes[1].is_bulky());
        assert!(
            (shapes[0].area - 8.0).abs() < 1e-12
                && shapes[0].centre.distance(DVec3::new(2.0, 1.0, 0.0)) < 1e-12
        );
    }

    #[test]
    fn halves_along_a_seam_are_one_part() {
        let half = grid(3);
        let (shapes, part_of) = part_shapes(&joined(&half, &mapped(&half, |p| p + DVec3::X)));
        assert_eq!(shapes.len(), 1);
        assert!(part_of.iter().all(|part| *part == 0));
    }

    #[test]
    fn likeness_needs_place_size_and_proportion() {
        let eye = icosphere(2);
        let shape = |map: &dyn Fn(DVec3) -> DVec3| part_shapes(&mapped(&eye, map)).0.remove(0);
        let own = shape(&|p| p);
        assert!(own.likeness(&shape(&|p| p * 1.2 + DVec3::X * 0.3)).is_some());
        assert_eq!(own.likeness(&shape(&|p| p + DVec3::X)), None);
        assert_eq!(own.likeness(&shape(&|p| p * 2.0)), None);
        assert_eq!(own.likeness(&shape(&|p| p * DVec3::new(1.0, 1.0, 0.1))), None);
        let (a, b) = (shape(&|p| p * 1.2), own);
        let motion = similarity(50.0);
        let far = |shape: &PartShape, factor: f64| {
            part_shapes(&mapped(&eye, |p| motion.transform_point3(p * factor))).0[0].likeness(shape)
        };
        let moved = far(&part_shapes(&mapped(&eye, |p| motion.transform_point3(p))).0[0], 1.2);
        assert!((moved.unwrap() - a.likeness(&b).unwrap()).abs() < 1e-9);
    }

    #[test]
    fn a_loose_vertex_is_a_part_without_area() {
        let mut vertices = icosphere(0).vertices().to_vec();
        vertices.push(DVec3::splat(3.0));
        let mesh = TriangleMesh::new(vertices, icosphere(0).triangles().to_vec()).unwrap();
        let (shapes, _) = part_shapes(&mesh);
        assert_eq!((shapes[1].area, shapes[1].radius, shapes[1].closed), (0.0, 0.0, false));
        assert_eq!(shapes[1].likeness(&shapes[0]), None);
    }
}
