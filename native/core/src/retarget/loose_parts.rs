//! Vertices that no surface path joins to the body (eyes, buttons, loose points): they take the
//! weights of the nearest matched surface.

use glam::DVec3;

use crate::mesh::{ClosestPoint, SurfaceQuery, TriangleMesh};

/// Weights and correspondence of one vertex.
pub(super) struct Follower {
    /// Entries `(bone, weight)`, bones ascending.
    pub(super) row: Vec<(u32, f64)>,
    /// Vertex of the body that counts most.
    pub(super) nearest: u32,
    /// Distance to the body.
    pub(super) distance: f64,
}

/// Interpolates the rows of the body's vertices at the point of the body nearest to `point`.
pub(super) fn follow(
    point: DVec3,
    body: &TriangleMesh,
    query: &SurfaceQuery,
    rows: &[Vec<(u32, f64)>],
) -> Follower {
    let at = query.closest_point(point);
    let Some(ClosestPoint { triangle, barycentric, distance, .. }) = at else {
        return Follower { row: rows.first().cloned().unwrap_or_default(), nearest: 0, distance: 0.0 };
    };
    let corners = body.triangles()[triangle as usize];
    let mut row: Vec<(u32, f64)> = Vec::new();
    for (&corner, share) in corners.iter().zip(barycentric) {
        for &(bone, weight) in &rows[corner as usize] {
            match row.binary_search_by_key(&bone, |entry| entry.0) {
                Ok(entry) => row[entry].1 += share * weight,
                Err(entry) => row.insert(entry, (bone, share * weight)),
            }
        }
    }
    let largest = (0..3).rev().max_by(|&a, &b| barycentric[a].total_cmp(&barycentric[b])).unwrap_or(0);
    Follower { row, nearest: corners[largest], distance }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolates_at_the_closest_point() {
        let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
        let body = TriangleMesh::new(vertices, vec![[0, 1, 2]]).unwrap();
        let query = SurfaceQuery::new(&body).unwrap();
        let rows = [vec![(0, 1.0)], vec![(1, 1.0)], vec![(0, 0.5), (2, 0.5)]];
        let follower = follow(DVec3::new(0.75, 0.0, 3.0), &body, &query, &rows);
        assert_eq!(follower.row, [(0, 0.25), (1, 0.75), (2, 0.0)]);
        assert_eq!((follower.nearest, follower.distance), (1, 3.0));
    }
}
