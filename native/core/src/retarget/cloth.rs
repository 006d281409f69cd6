//! How much a match tells of cloth: the farther it hangs from the body, the less sharply.
//!
//! A closest point tells the place below a cloth no better than about as far as the cloth is away, and the
//! flatter it looks at the body the worse: between two legs the closest points of a skirt leap from one to the
//! other. So the weights there count as a mean over a reach (see [`super::inpaint`]); those of cloth on the skin
//! stay as they are.

use glam::DVec3;

use super::icp::Surroundings;
use super::inpaint::Known;
use super::rejection::SurfaceMatch;
use crate::mesh::TriangleMesh;

/// Reach of a closest point straight below, as a share of its distance; it grows with the inverse square of the
/// cosines from the cloth's normal to the way there and to the normal there,
const REACH: f64 = 0.4;
/// whose product is at least this,
const FLATTEST: f64 = 0.1;
/// and is at least this share of the extent.
const SHORTEST: f64 = 1e-4;

/// What a match of a vertex of the cloth with `source` tells.
pub(super) fn told(cloth: Surroundings<'_>, v: usize, source: &TriangleMesh, found: &SurfaceMatch) -> Known {
    let shortest = SHORTEST * cloth.shell.extent;
    let corners = source.corners(found.triangle as usize);
    let place: DVec3 = corners.iter().zip(found.barycentric).map(|(&corner, share)| corner * share).sum();
    let way = place - cloth.mesh.vertices()[v];
    let length = way.length();
    // On the skin the way has no direction.
    let straight = if length > shortest { cloth.shell.normals[v].dot(way).abs() / length } else { 1.0 };
    let straight = (straight * found.agreement.abs()).clamp(FLATTEST, 1.0);
    Known::Within((REACH * length / straight.powi(2)).max(shortest))
}

#[cfg(test)]
mod tests {
    use super::super::shell::Shell;
    use super::*;
    use crate::mesh::SurfaceQuery;
    use crate::mesh::test_surfaces::{grid, mapped};
    use crate::progress::Progress;

    /// The reach of a vertex of a flat cloth whose match lies at `place` and has a normal at `agreement`.
    fn reach(place: DVec3, agreement: f64) -> f64 {
        let cloth = grid(4);
        let query = SurfaceQuery::new(&cloth).unwrap();
        let shell = Shell::new(&cloth, &query, &Progress::new()).unwrap();
        let cloth = Surroundings { mesh: &cloth, query: &query, shell: &shell };
        let body = mapped(cloth.mesh, |p| p + place);
        let triangle = body.triangles().iter().position(|corners| corners[0] == 0).unwrap() as u32;
        let barycentric = [1.0, 0.0, 0.0];
        let found =
            SurfaceMatch { triangle, barycentric, distance: place.length(), agreement, accepted: true };
        match told(cloth, 0, &body, &found) {
            Known::Within(reach) => reach,
            known => panic!("{known:?}"),
        }
    }

    #[test]
    fn it_tells_the_less_the_farther_and_the_flatter() {
        let below = reach(-DVec3::Z * 0.1, 1.0);
        assert!((below - 0.1 * REACH).abs() < 1e-12);
        assert!((reach(-DVec3::Z * 0.2, -1.0) / below - 2.0).abs() < 1e-9);
        assert!((reach(-DVec3::Z * 0.1, 0.5) / below - 4.0).abs() < 1e-9);
        let aside = reach(DVec3::new(0.0, 0.1, -0.1), 1.0);
        assert!((aside / below - 2.0 * 2f64.sqrt()).abs() < 1e-9);
        let level = reach(DVec3::X * 0.1, 0.0);
        assert!((level / below - FLATTEST.powi(-2)).abs() < 1e-6 && level.is_finite());
        assert!(reach(DVec3::ZERO, 1.0) > 0.0 && reach(DVec3::ZERO, 1.0) < 1e-3);
    }
}
