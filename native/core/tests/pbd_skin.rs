//! `PbdSkin` as its users see it: rest in, rest out; a pure function; typed errors.

#![allow(clippy::unwrap_used)]

#[path = "pbd_support/mod.rs"]
mod support;

use dermis::mesh::TriangleMesh;
use dermis::pbd::{PbdError, PbdSettings, PbdSkin, Region, SkinningMethod};
use dermis::rig::Skeleton;
use dermis::skinning::{SkinWeights, SkinningError, dual_quaternion_skinning, linear_blend_skinning};
use glam::{Affine3A, DVec3, Mat3A, Quat, Vec3};
use support::{Cylinder, bend, crossings, twist, zone_volume};

fn cylinder() -> Cylinder {
    Cylinder::new(|p| p)
}

fn skin(cylinder: &Cylinder, settings: &PbdSettings) -> PbdSkin {
    PbdSkin::new(&cylinder.mesh, &cylinder.skeleton, &cylinder.weights, settings).unwrap()
}

fn largest_distance(a: &[Vec3], b: &[Vec3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
}

#[test]
fn joints_keep_their_volume_and_do_not_cross() {
    let cylinder = cylinder();
    let skin = skin(&cylinder, &PbdSettings::default());
    let rest = zone_volume(&cylinder.rest());
    for (name, pose, least) in [
        ("twist 60", twist(60.0), 98.0),
        ("twist 90", twist(90.0), 98.0),
        ("twist 150", twist(150.0), 96.0),
        ("bend 60", bend(60.0), 97.0),
        ("bend 90", bend(90.0), 96.0),
        ("bend 120", bend(120.0), 95.0),
    ] {
        let solved = skin.solve(&pose, None).unwrap();
        let kept = 100.0 * zone_volume(&solved.vertices) / rest;
        assert!((least..=103.0).contains(&kept), "{name}: {kept} % of the volume");
        assert_eq!(solved.stats.inverted, 0, "{name}");
        assert_eq!(crossings(&cylinder.mesh, &solved.vertices), 0, "{name}");
    }
}

#[test]
fn plain_skinning_is_as_bad_as_its_name_among_these_measures() {
    let cylinder = cylinder();
    let rest = zone_volume(&cylinder.rest());
    let kept = |pose: &[Affine3A]| {
        let plain = linear_blend_skinning(&cylinder.rest(), &cylinder.weights, pose).unwrap();
        (100.0 * zone_volume(&plain) / rest, crossings(&cylinder.mesh, &plain))
    };
    assert!(kept(&twist(150.0)).0 < 60.0);
    let (volume, crossings) = kept(&bend(120.0));
    assert!(volume < 85.0 && crossings > 50, "{volume} % {crossings}");
}

#[test]
fn rest_comes_back_to_the_last_bit() {
    let cylinder = cylinder();
    for settings in [PbdSettings::default(), PbdSettings::paper(), PbdSettings::rumman_fratarcangeli()] {
        let skin = skin(&cylinder, &settings);
        let solved = skin.solve(&[Affine3A::IDENTITY; 2], None).unwrap();
        assert_eq!(solved.vertices, cylinder.rest());
        assert_eq!(solved.stats.active_islands, 0);
    }
}

#[test]
fn the_result_depends_on_nothing_but_the_pose() {
    let cylinder = cylinder();
    // Fine cells make an island that several cores share.
    for (preset, cell_size) in [
        (PbdSettings::default(), None),
        (PbdSettings::default(), Some(0.2)),
        (PbdSettings::paper(), Some(0.2)),
    ] {
        let solve = |threads: usize| {
            let settings = PbdSettings { threads: Some(threads), cell_size, ..preset.clone() };
            let skin = skin(&cylinder, &settings);
            assert_eq!(
                cell_size.is_some(),
                skin.build_stats().tetrahedra > 12_000,
                "{:?}",
                skin.build_stats()
            );
            let forwards = [30.0, 60.0, 90.0].map(|angle| skin.solve(&bend(angle), None).unwrap().vertices);
            let again = skin.solve(&bend(30.0), None).unwrap().vertices;
            assert_eq!(forwards[0], again, "whatever was solved before");
            forwards
        };
        let one = solve(1);
        assert_eq!(one, solve(2));
        assert_eq!(one, solve(16));
    }
}

#[test]
fn the_result_moves_and_scales_with_the_character() {
    let cylinder = cylinder();
    let skin = skin(&cylinder, &PbdSettings::default());
    let world = Affine3A::from_scale_rotation_translation(
        Vec3::splat(2.5),
        Quat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 0.7),
        Vec3::new(30.0, -20.0, 5.0),
    );
    let here = skin.solve(&bend(80.0), None).unwrap().vertices;
    let there = skin.solve(&bend(80.0).map(|t| world * t), None).unwrap().vertices;
    let moved: Vec<Vec3> = here.iter().map(|&p| world.transform_point3(p)).collect();
    assert!(largest_distance(&moved, &there) < 2e-4, "{}", largest_distance(&moved, &there));
    let still = skin.solve(&[world; 2], None).unwrap();
    assert_eq!(still.stats.active_islands, 0, "nothing has moved within the character");
}

#[test]
fn a_smaller_character_is_solved_alike() {
    let large = cylinder();
    let small = Cylinder::new(|p| p * 0.01 + DVec3::new(1.0, 2.0, -0.5));
    let offset = Vec3::new(1.0, 2.0, -0.5);
    let rotation = Quat::from_rotation_z(1.2);
    let pose =
        [Affine3A::IDENTITY, Affine3A::from_rotation_translation(rotation, offset - rotation * offset)];
    let solve = |c: &Cylinder, pose: &[Affine3A]| {
        skin(c, &PbdSettings::default()).solve(pose, None).unwrap().vertices
    };
    let expected: Vec<Vec3> =
        solve(&large, &bend(1.2f32.to_degrees())).iter().map(|p| *p * 0.01 + offset).collect();
    let found = solve(&small, &pose);
    assert!(largest_distance(&expected, &found) < 2e-4, "{}", largest_distance(&expected, &found));
}

#[test]
fn vertices_given_with_the_pose_carry_the_same_correction() {
    let cylinder = cylinder();
    // Without what looks at the posed surface itself: contact, and the limit of its stretch.
    let settings = PbdSettings { self_collision: false, anneal_stretch: false, ..PbdSettings::default() };
    let skin = skin(&cylinder, &settings);
    let pose = twist(100.0);
    let keyed: Vec<Vec3> = cylinder.rest().iter().map(|p| *p * Vec3::new(1.0, 1.1, 0.9)).collect();
    let solved = skin.solve(&pose, Some(&keyed)).unwrap().vertices;
    let unkeyed = skin.solve(&pose, None).unwrap().vertices;
    let plain = |v: &[Vec3]| linear_blend_skinning(v, &cylinder.weights, &pose).unwrap();
    let (plain_keyed, plain_rest) = (plain(&keyed), plain(&cylinder.rest()));
    for v in 0..keyed.len() {
        let correction = unkeyed[v] - plain_rest[v];
        assert!((solved[v] - plain_keyed[v]).distance(correction) < 1e-5);
    }
}

#[test]
fn far_from_the_joint_the_plain_skin_stays_with_either_method() {
    let cylinder = cylinder();
    let pose = bend(70.0);
    for method in [SkinningMethod::Linear, SkinningMethod::DualQuaternion] {
        let solved = skin(&cylinder, &PbdSettings { skinning: method, ..PbdSettings::default() });
        let solved = solved.solve(&pose, None).unwrap().vertices;
        let plain = match method {
            SkinningMethod::Linear => linear_blend_skinning(&cylinder.rest(), &cylinder.weights, &pose),
            SkinningMethod::DualQuaternion => {
                dual_quaternion_skinning(&cylinder.rest(), &cylinder.weights, &pose, None)
            }
        };
        let plain = plain.unwrap();
        for (v, p) in cylinder.rest().iter().enumerate() {
            if p.x.abs() > 3.5 {
                assert_eq!(solved[v], plain[v]);
            }
        }
        assert!(largest_distance(&solved, &plain) > 0.05);
    }
}

#[test]
fn stiffer_material_keeps_more_volume_over_six_decades() {
    let cylinder = cylinder();
    let rest = zone_volume(&cylinder.rest());
    let solve = |stiffness: f32, iterations: u32| {
        let settings = PbdSettings {
            iterations,
            stretch: 0.0,
            volume: 0.0,
            energy: 1.0,
            stiffness,
            self_collision: false,
            ..PbdSettings::default()
        };
        skin(&cylinder, &settings).solve(&twist(120.0), None).unwrap().vertices
    };
    let kept: Vec<f64> =
        [1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0, 1000.0].map(|k| zone_volume(&solve(k, 10)) / rest).to_vec();
    assert!(kept.windows(2).all(|pair| pair[1] > pair[0]), "{kept:?}");
    assert!(kept[6] - kept[0] > 0.05, "{kept:?}");
    let plain = linear_blend_skinning(&cylinder.rest(), &cylinder.weights, &twist(120.0)).unwrap();
    for stiffness in [0.01, 1.0, 100.0] {
        let (once, twice) = (solve(stiffness, 10), solve(stiffness, 20));
        let change = largest_distance(&once, &twice) / largest_distance(&once, &plain);
        assert!(change < 0.1, "stiffness {stiffness}: doubling the iterations changes {change}");
    }
}

#[test]
fn more_than_the_joint_moves_when_the_region_is_all() {
    let cylinder = cylinder();
    let joints = skin(&cylinder, &PbdSettings::default()).build_stats();
    let all = skin(&cylinder, &PbdSettings { region: Region::All, ..PbdSettings::default() });
    assert!(all.build_stats().tetrahedra > joints.tetrahedra);
    let solved = all.solve(&bend(60.0), None).unwrap();
    let kept = zone_volume(&solved.vertices) / zone_volume(&cylinder.rest());
    assert!((0.9..1.05).contains(&kept), "{kept}");
}

#[test]
fn the_cage_is_rest_and_positive() {
    let skin = skin(&cylinder(), &PbdSettings::default());
    let (cage, stats) = (skin.cage(), skin.build_stats());
    assert_eq!(cage.tetrahedra().len(), stats.tetrahedra);
    assert_eq!(stats.constraints.volume, stats.tetrahedra);
    assert_eq!((stats.constraints.bind, stats.constraints.energy), (0, 0), "off by default");
    assert!(stats.constraints.stretch > stats.tetrahedra && stats.constraints.self_collision > 0);
    assert!((0..cage.tetrahedra().len()).all(|t| cage.volume(t) > 0.0));
}

#[test]
fn bad_poses_are_refused_by_name() {
    let cylinder = cylinder();
    let skin = skin(&cylinder, &PbdSettings::default());
    let mut pose = bend(20.0);
    pose[1].translation.x = f32::NAN;
    assert_eq!(
        skin.solve(&pose, None).map(|_| ()),
        Err(PbdError::Skinning(SkinningError::NonFiniteTransform { bone: 1 }))
    );
    assert!(matches!(
        skin.solve(&pose[..1], None),
        Err(PbdError::Skinning(SkinningError::Count { element: "transforms", expected: 2, given: 1 }))
    ));
    let mut vertices = cylinder.rest();
    vertices[17].y = f32::INFINITY;
    assert_eq!(
        skin.solve(&bend(20.0), Some(&vertices)).map(|_| ()),
        Err(PbdError::Skinning(SkinningError::NonFiniteVertex { vertex: 17 }))
    );
}

#[test]
fn extreme_poses_stay_finite() {
    let cylinder = cylinder();
    let skin = skin(&cylinder, &PbdSettings::default());
    let flat = Affine3A { matrix3: Mat3A::ZERO, ..Affine3A::IDENTITY };
    let mirror = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    let huge = Affine3A::from_scale(Vec3::splat(1e30));
    for second in [flat, mirror, huge, Affine3A::from_translation(Vec3::splat(1e20)), twist(180.0)[1]] {
        for pose in [[Affine3A::IDENTITY, second], [second, Affine3A::IDENTITY], [second, second]] {
            let solved = skin.solve(&pose, None).unwrap();
            let plain = linear_blend_skinning(&cylinder.rest(), &cylinder.weights, &pose).unwrap();
            let finite = plain.iter().zip(&solved.vertices).all(|(p, s)| s.is_finite() || !p.is_finite());
            assert!(finite, "{second:?}");
        }
    }
}

#[test]
fn what_has_no_joint_is_skinned_plainly() {
    let cylinder = cylinder();
    let count = cylinder.mesh.vertex_count();
    let rigid = SkinWeights::from_triplets((0..count as i64).map(|v| (v, 1, 1.0)), count, 2).unwrap();
    let no_weights = SkinWeights::from_triplets([], count, 2).unwrap();
    for weights in [rigid, no_weights] {
        let skin =
            PbdSkin::new(&cylinder.mesh, &cylinder.skeleton, &weights, &PbdSettings::default()).unwrap();
        let plain = linear_blend_skinning(&cylinder.rest(), &weights, &bend(50.0)).unwrap();
        assert_eq!(skin.solve(&bend(50.0), None).unwrap().vertices, plain);
    }
    let point = TriangleMesh::new(vec![DVec3::ONE], vec![]).unwrap();
    let weights = SkinWeights::from_triplets([(0, 0, 0.5), (0, 1, 0.5)], 1, 2).unwrap();
    let skin = PbdSkin::new(&point, &cylinder.skeleton, &weights, &PbdSettings::default()).unwrap();
    assert_eq!(skin.solve(&bend(90.0), None).unwrap().vertices.len(), 1);
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let cylinder = cylinder();
    let skeleton = Skeleton::new(vec![DVec3::ZERO], vec![DVec3::X], &[-1], None).unwrap();
    let error = |skeleton, weights, settings| {
        PbdSkin::new(&cylinder.mesh, skeleton, weights, settings).map(|_| ()).unwrap_err()
    };
    let default = PbdSettings::default();
    assert!(matches!(
        error(&skeleton, &cylinder.weights, &default),
        PbdError::Mismatch { element: "bones", left_count: 1, right_count: 2, .. }
    ));
    let few = SkinWeights::from_triplets([(0, 0, 1.0)], 3, 2).unwrap();
    assert!(matches!(
        error(&cylinder.skeleton, &few, &default),
        PbdError::Mismatch { element: "vertices", right_count: 3, .. }
    ));
    let settings = PbdSettings { bind: -0.5, ..default.clone() };
    assert!(matches!(
        error(&cylinder.skeleton, &cylinder.weights, &settings),
        PbdError::Setting { name: "bind", .. }
    ));
    let settings = PbdSettings { cell_size: Some(1e-4), ..default };
    assert!(matches!(error(&cylinder.skeleton, &cylinder.weights, &settings), PbdError::Cage(_)));
}

#[test]
fn a_bone_that_starts_to_move_starts_gently() {
    let cylinder = cylinder();
    let skin = skin(&cylinder, &PbdSettings::default());
    let solve = |degrees: f32| skin.solve(&bend(degrees), None).unwrap().vertices;
    let (still, least, little) = (solve(0.0), solve(0.001), solve(0.1));
    // 0.001° moves the end by 7e-5, 0.1° by 7e-3; so does what is solved, and no more than that.
    assert!(largest_distance(&still, &least) < 2e-4);
    assert!(largest_distance(&still, &little) < 1e-2);
}
