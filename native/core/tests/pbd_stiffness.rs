//! A stiffness painted on the surface: what is painted soft gives way as soft material does.

#![allow(clippy::unwrap_used)]

#[path = "pbd_support/mod.rs"]
#[allow(dead_code)]
mod support;

use dermis::pbd::{PbdError, PbdSettings, PbdSkin};
use glam::Vec3;
use support::{Cylinder, twist, zone_volume};

/// Springs alone, so that nothing else answers.
fn springs(stiffness: f32) -> PbdSettings {
    PbdSettings {
        stretch: 0.0,
        volume: 0.0,
        energy: 1.0,
        stiffness,
        self_collision: false,
        ..PbdSettings::default()
    }
}

fn solve(cylinder: &Cylinder, settings: &PbdSettings, shares: Option<&[f32]>) -> Vec<Vec3> {
    PbdSkin::with_stiffness(&cylinder.mesh, &cylinder.skeleton, &cylinder.weights, settings, shares)
        .unwrap()
        .solve(&twist(120.0), None)
        .unwrap()
        .vertices
}

#[test]
fn full_shares_are_no_shares_and_equal_shares_scale_the_stiffness() {
    let cylinder = Cylinder::new(|p| p);
    let count = cylinder.mesh.vertex_count();
    let uniform = solve(&cylinder, &springs(10.0), None);
    assert_eq!(solve(&cylinder, &springs(10.0), Some(&vec![1.0; count])), uniform);
    let scaled = solve(&cylinder, &springs(10.0), Some(&vec![0.25; count]));
    let softer = solve(&cylinder, &springs(2.5), None);
    let distance = scaled.iter().zip(&softer).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    assert!(distance < 1e-4, "{distance}");
    assert_ne!(softer, uniform);
}

#[test]
fn each_side_of_a_joint_behaves_as_it_is_painted() {
    let cylinder = Cylinder::new(|p| p);
    let rest = cylinder.rest();
    let painted = |share: &dyn Fn(Vec3) -> f32| {
        let shares: Vec<f32> = rest.iter().map(|&p| share(p)).collect();
        solve(&cylinder, &springs(1.0), Some(&shares))
    };
    let (soft, hard) = (painted(&|_| 0.0), painted(&|_| 1.0));
    let both = painted(&|p| if p.x < 0.0 { 0.0 } else { 1.0 });
    let distance = |other: &[Vec3], side: f32| -> f32 {
        let apart = (0..rest.len()).filter(|&v| (0.3..1.2).contains(&(side * rest[v].x)));
        apart.map(|v| both[v].distance(other[v])).sum()
    };
    assert!(distance(&soft, -1.0) < 0.5 * distance(&hard, -1.0));
    assert!(distance(&hard, 1.0) < 0.5 * distance(&soft, 1.0));
    assert!(zone_volume(&soft) < 0.9 * zone_volume(&both));
}

#[test]
fn shares_out_of_range_are_named() {
    let cylinder = Cylinder::new(|p| p);
    let count = cylinder.mesh.vertex_count();
    let error = |shares: &[f32]| {
        let (mesh, skeleton) = (&cylinder.mesh, &cylinder.skeleton);
        PbdSkin::with_stiffness(mesh, skeleton, &cylinder.weights, &springs(1.0), Some(shares))
            .map(|_| ())
            .unwrap_err()
    };
    assert!(matches!(error(&[1.0]), PbdError::Mismatch { right: "stiffness_shares", right_count: 1, .. }));
    for bad in [-0.1, 1.5, f32::NAN] {
        let mut shares = vec![0.5; count];
        shares[7] = bad;
        assert!(matches!(error(&shares), PbdError::Share { name: "stiffness_shares", vertex: 7, .. }));
    }
}
