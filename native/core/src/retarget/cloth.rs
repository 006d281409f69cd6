//! Cloth on its wearer: how it is laid on the skin, and how much a match then tells of it.
//!
//! Between two legs or under an arm the closest points of cloth that spans them lie on both rims, and the skin
//! between meets nothing. So the cloth is first laid on the skin as smoothly as may be, which draws it into such
//! hollows, and is matched there.
//!
//! A closest point tells the place below a cloth no better than about as far as the cloth is away, and the flatter
//! it looks at the body the worse. So the weights there count as a mean over a reach (see [`super::inpaint`]);
//! those of cloth on the skin stay as they are.

use glam::DVec3;

use super::deform::{Deformed, Deformer};
use super::icp::{IcpSettings, Surroundings, register};
use super::inpaint::Known;
use super::rejection::SurfaceMatch;
use crate::mesh::TriangleMesh;
use crate::progress::Progress;
use crate::spectral::SpectralError;

/// Lengths that cloth being laid smooths over, round by round, as shares of the wearer's extent,
const SMOOTHED_OVER: [f64; 2] = [0.03, 0.02];
/// the largest angle of its normals with the skin's, in degrees,
const MAX_ANGLE: f64 = 45.0;
/// and the largest distance that it is drawn from, as a share of that extent.
const MAX_DISTANCE: f64 = 0.05;
/// Reach of a closest point straight below, as a share of its distance; it grows with the cosines from the cloth's
/// normal to the way there and to the normal there,
const REACH: f64 = 0.4;
/// with this inverse power of them,
const POWER: i32 = 2;
/// whose product is at least this,
const FLATTEST: f64 = 0.1;
/// and is at least this share of the extent,
const SHORTEST: f64 = 1e-4;
/// and, once the cloth is laid, this share of what it was before.
const KEPT: f64 = 0.55;

/// How a target is worn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Worn {
    /// Almost all of it lies on the skin already, as do another topology of the body and pieces of it.
    OnSkin,
    /// It has to be laid there.
    Hanging,
}

/// The cloth laid on its wearer's skin.
///
/// # Errors
/// [`SpectralError`] when a factorisation fails or `progress` was cancelled.
pub(super) fn laid(
    cloth: &TriangleMesh,
    wearer: Surroundings<'_>,
    progress: &Progress,
) -> Result<TriangleMesh, SpectralError> {
    let deformer = Deformer::new(cloth, &[])?;
    let size = deformer.surface().area.sqrt() / wearer.shell.extent;
    let settings = IcpSettings {
        smoothing_lengths: SMOOTHED_OVER.iter().map(|length| length / size).collect(),
        max_angle: MAX_ANGLE,
        max_distance: MAX_DISTANCE,
    };
    let vertices = cloth.vertices().to_vec();
    let hanging = Deformed { vertices, kept: Vec::new(), residuals: Vec::new() };
    let found = register(&deformer, &hanging, wearer, &settings, progress)?;
    Ok(TriangleMesh::new(found.vertices, cloth.triangles().to_vec())?)
}

/// What a match with `source` tells of a vertex of the cloth, hanging and laid.
pub(super) fn told(
    [hanging, laid]: [Surroundings<'_>; 2],
    v: usize,
    (source, found): (&TriangleMesh, &SurfaceMatch),
) -> Known {
    let corners = source.corners(found.triangle as usize);
    let place: DVec3 = corners.iter().zip(found.barycentric).map(|(&corner, share)| corner * share).sum();
    let agreement = found.agreement.abs();
    let [before, now] = [hanging, laid].map(|cloth| reach(cloth, v, place, agreement));
    Known::Within(now.max(KEPT * before).max(SHORTEST * hanging.shell.extent))
}

/// Reach of a match at a place with a normal that agrees so far with the vertex's.
fn reach(cloth: Surroundings<'_>, v: usize, place: DVec3, agreement: f64) -> f64 {
    let way = place - cloth.mesh.vertices()[v];
    let length = way.length();
    // On the skin the way has no direction.
    let on_skin = length <= SHORTEST * cloth.shell.extent;
    let straight = if on_skin { 1.0 } else { cloth.shell.normals[v].dot(way).abs() / length };
    REACH * length / (straight * agreement).clamp(FLATTEST, 1.0).powi(POWER)
}

#[cfg(test)]
mod tests {
    use super::super::shell::Shell;
    use super::*;
    use crate::mesh::SurfaceQuery;
    use crate::mesh::test_surfaces::{grid, joined, mapped, tube};

    /// What is told of a vertex of a flat cloth that matches at `place` with normals that agree so far.
    fn reach(hanging: DVec3, place: DVec3, agreement: f64) -> f64 {
        let laid = grid(4);
        let hung = mapped(&laid, |p| p + hanging);
        let queries = [&hung, &laid].map(|mesh| SurfaceQuery::new(mesh).unwrap());
        let shells = [(&hung, &queries[0]), (&laid, &queries[1])]
            .map(|(mesh, query)| Shell::new(mesh, query, &Progress::new()).unwrap());
        let cloth = |k: usize, mesh| Surroundings { mesh, query: &queries[k], shell: &shells[k] };
        let body = mapped(&laid, |p| p + place);
        let triangle = body.triangles().iter().position(|corners| corners[0] == 0).unwrap() as u32;
        let barycentric = [1.0, 0.0, 0.0];
        let found =
            SurfaceMatch { triangle, barycentric, distance: place.length(), agreement, accepted: true };
        match told([cloth(0, &hung), cloth(1, &laid)], 0, (&body, &found)) {
            Known::Within(reach) => reach,
            known => panic!("{known:?}"),
        }
    }

    #[test]
    fn it_tells_the_less_the_farther_and_the_flatter() {
        let reach_of = |place, agreement| reach(DVec3::ZERO, place, agreement);
        let below = reach_of(-DVec3::Z * 0.1, 1.0);
        assert!((below - 0.1 * REACH).abs() < 1e-12);
        assert!((reach_of(-DVec3::Z * 0.2, -1.0) / below - 2.0).abs() < 1e-9);
        assert!((reach_of(-DVec3::Z * 0.1, 0.5) / below - 4.0).abs() < 1e-9);
        let aside = reach_of(DVec3::new(0.0, 0.1, -0.1), 1.0);
        assert!((aside / below - 8f64.sqrt()).abs() < 1e-9);
        let level = reach_of(DVec3::X * 0.1, 0.0);
        assert!((level / below - FLATTEST.powi(-POWER)).abs() < 1e-6 && level.is_finite());
        assert!(reach_of(DVec3::ZERO, 1.0) > 0.0 && reach_of(DVec3::ZERO, 1.0) < 1e-3);
        let hung = reach(DVec3::Z * 0.5, DVec3::ZERO, 1.0);
        assert!((hung - KEPT * REACH * 0.5).abs() < 1e-9, "{hung}");
    }

    #[test]
    fn cloth_is_drawn_into_a_hollow_that_it_spans() {
        // Two limbs side by side, and a sheet that lies over both.
        let limb = |x: f64| mapped(&tube(0.1, 1.0, 32, 20), |p| DVec3::new(p.x + x, p.z - 0.5, p.y));
        let body = joined(&limb(-0.1), &limb(0.1));
        let cloth = mapped(&grid(40), |p| DVec3::new(0.4 * p.x - 0.2, 0.6 * p.y - 0.3, 0.0));
        let over = |p: DVec3| 0.105 - 0.105 * ((p.x.abs() - 0.1).max(0.0) / 0.1).powi(2);
        let cloth = mapped(&cloth, |p| p + DVec3::Z * over(p));
        let query = SurfaceQuery::new(&body).unwrap();
        let shell = Shell::new(&body, &query, &Progress::new()).unwrap();
        let wearer = Surroundings { mesh: &body, query: &query, shell: &shell };
        let found = laid(&cloth, wearer, &Progress::new()).unwrap();
        for (before, after) in cloth.vertices().iter().zip(found.vertices()) {
            if before.x.abs() < 0.01 && before.y.abs() < 0.2 {
                assert!(after.z < before.z - 0.005, "{before} {after}");
            }
            if (before.x.abs() - 0.1).abs() < 0.01 && before.y.abs() < 0.2 {
                assert!((after.z - 0.1).abs() < 0.005, "{before} {after}");
            }
        }
    }
}
