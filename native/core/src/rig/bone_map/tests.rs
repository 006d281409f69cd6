//! Tests of the whole map.

use glam::{DQuat, DVec3};
use proptest::prelude::*;

use super::*;
use crate::skinning::SkinWeights;

/// A bone as name, parent, head and tail.
type Bone = (String, i64, DVec3, DVec3);

fn skeleton(bones: &[Bone]) -> Skeleton {
    Skeleton::new(
        bones.iter().map(|b| b.2).collect(),
        bones.iter().map(|b| b.3).collect(),
        &bones.iter().map(|b| b.1).collect::<Vec<_>>(),
        Some(bones.iter().map(|b| b.0.clone()).collect()),
    )
    .unwrap()
}

/// A biped that faces -Y: the names give the spine, neck, head and hips, then one side with "?".
struct Scheme {
    hips: &'static str,
    spine: &'static [&'static str],
    neck: &'static [&'static str],
    head: &'static str,
    /// Clavicle, upper arm, lower arm and hand, each one bone or two.
    arm: [&'static [&'static str]; 4],
    /// Thigh, shin, foot and toes.
    leg: [&'static [&'static str]; 4],
    /// Name of a finger bone: "{f}" the finger, "{n}" 1 to 3.
    finger: &'static str,
    fingers: [&'static str; 5],
    sides: [&'static str; 2],
}

const UNREAL: Scheme = Scheme {
    hips: "pelvis",
    spine: &["spine_01", "spine_02", "spine_03"],
    neck: &["neck_01"],
    head: "head",
    arm: [&["clavicle_?"], &["upperarm_?"], &["lowerarm_?", "lowerarm_twist_01_?"], &["hand_?"]],
    leg: [&["thigh_?"], &["calf_?"], &["foot_?"], &["ball_?"]],
    finger: "{f}_0{n}_?",
    fingers: ["thumb", "index", "middle", "ring", "pinky"],
    sides: ["l", "r"],
};
const MIXAMO: Scheme = Scheme {
    hips: "mixamorig:Hips",
    spine: &["mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2"],
    neck: &["mixamorig:Neck"],
    head: "mixamorig:Head",
    arm: [&["mixamorig:?Shoulder"], &["mixamorig:?Arm"], &["mixamorig:?ForeArm"], &["mixamorig:?Hand"]],
    leg: [&["mixamorig:?UpLeg"], &["mixamorig:?Leg"], &["mixamorig:?Foot"], &["mixamorig:?ToeBase"]],
    finger: "mixamorig:?Hand{f}{n}",
    fingers: ["Thumb", "Index", "Middle", "Ring", "Pinky"],
    sides: ["Left", "Right"],
};
const RIGIFY: Scheme = Scheme {
    hips: "DEF-spine",
    spine: &["DEF-spine.001", "DEF-spine.002", "DEF-spine.003"],
    neck: &["DEF-spine.004", "DEF-spine.005"],
    head: "DEF-spine.006",
    arm: [
        &["DEF-shoulder.?"],
        &["DEF-upper_arm.?", "DEF-upper_arm.?.001"],
        &["DEF-forearm.?", "DEF-forearm.?.001"],
        &["DEF-hand.?"],
    ],
    leg: [
        &["DEF-thigh.?", "DEF-thigh.?.001"],
        &["DEF-shin.?", "DEF-shin.?.001"],
        &["DEF-foot.?"],
        &["DEF-toe.?"],
    ],
    finger: "DEF-{f}.0{n}.?",
    fingers: ["thumb", "f_index", "f_middle", "f_ring", "f_pinky"],
    sides: ["L", "R"],
};
const VRM: Scheme = Scheme {
    hips: "J_Bip_C_Hips",
    spine: &["J_Bip_C_Spine", "J_Bip_C_Chest", "J_Bip_C_UpperChest"],
    neck: &["J_Bip_C_Neck"],
    head: "J_Bip_C_Head",
    arm: [&["J_Bip_?_Shoulder"], &["J_Bip_?_UpperArm"], &["J_Bip_?_LowerArm"], &["J_Bip_?_Hand"]],
    leg: [&["J_Bip_?_UpperLeg"], &["J_Bip_?_LowerLeg"], &["J_Bip_?_Foot"], &["J_Bip_?_ToeBase"]],
    finger: "J_Bip_?_{f}{n}",
    fingers: ["Thumb", "Index", "Middle", "Ring", "Little"],
    sides: ["L", "R"],
};
const VRM_HUMANOID: Scheme = Scheme {
    hips: "hips",
    spine: &["spine", "chest"],
    neck: &["neck"],
    head: "head",
    arm: [&["?Shoulder"], &["?UpperArm"], &["?LowerArm"], &["?Hand"]],
    leg: [&["?UpperLeg"], &["?LowerLeg"], &["?Foot"], &["?Toes"]],
    finger: "?{f}{n}",
    fingers: ["Thumb", "Index", "Middle", "Ring", "Little"],
    sides: ["left", "right"],
};
const SCHEMES: [&Scheme; 5] = [&UNREAL, &MIXAMO, &RIGIFY, &VRM, &VRM_HUMANOID];

fn chain(bones: &mut Vec<Bone>, parent: i64, names: &[String], from: DVec3, to: DVec3) -> i64 {
    let count = names.len() as f64;
    let mut parent = parent;
    for (i, name) in names.iter().enumerate() {
        let [head, tail] = [i, i + 1].map(|k| from.lerp(to, k as f64 / count));
        bones.push((name.clone(), parent, head, tail));
        parent = bones.len() as i64 - 1;
    }
    parent
}

impl Scheme {
    fn bones(&self) -> Vec<Bone> {
        let mut bones = Vec::new();
        let (point, own) =
            (DVec3::new, |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>());
        let hips = chain(&mut bones, -1, &own(&[self.hips]), point(0.0, 0.0, 0.95), point(0.0, 0.0, 1.05));
        let chest = chain(&mut bones, hips, &own(self.spine), point(0.0, 0.0, 1.05), point(0.0, 0.02, 1.45));
        let neck = chain(&mut bones, chest, &own(self.neck), point(0.0, 0.02, 1.45), point(0.0, 0.0, 1.55));
        chain(&mut bones, neck, &own(&[self.head]), point(0.0, 0.0, 1.55), point(0.0, 0.0, 1.75));
        for (side, sign) in self.sides.iter().zip([1.0, -1.0]) {
            let named = |names: &[&str]| names.iter().map(|n| n.replace('?', side)).collect::<Vec<_>>();
            let arm = [0.03, 0.16, 0.45, 0.7, 0.78].map(|x| point(sign * x, 0.01, 1.42));
            let mut last = chest;
            for (names, ends) in self.arm.iter().zip(arm.windows(2)) {
                last = chain(&mut bones, last, &named(names), ends[0], ends[1]);
            }
            for (finger, name) in self.fingers.iter().enumerate() {
                let y = 0.025 * (finger as f64 - 2.0);
                let start = if finger == 0 { arm[3] - DVec3::Y * 0.03 } else { arm[4] + DVec3::Y * y };
                let names: Vec<String> = (1..=3)
                    .map(|n| {
                        self.finger.replace("{f}", name).replace("{n}", &n.to_string()).replace('?', side)
                    })
                    .collect();
                chain(&mut bones, last, &names, start, start + point(sign * 0.08, 0.0, 0.0));
            }
            let leg = [(0.0, 0.92), (-0.01, 0.5), (0.0, 0.08), (-0.13, 0.02), (-0.2, 0.02)]
                .map(|(y, z)| point(sign * 0.1, y, z));
            let mut last = hips;
            for (names, ends) in self.leg.iter().zip(leg.windows(2)) {
                last = chain(&mut bones, last, &named(names), ends[0], ends[1]);
            }
        }
        bones
    }
}

/// The middle of a bone's targets, which must lie near the middle of the bone.
fn worst_offset(source: &Skeleton, target: &Skeleton, map: &BoneMap) -> f64 {
    let aligned = map.aligned_skeleton(source, target).unwrap();
    (0..source.bone_count())
        .map(|b| {
            let middle = |s: &Skeleton| 0.5 * (s.heads()[b] + s.tails()[b]);
            middle(source).distance(middle(&aligned))
        })
        .fold(0.0, f64::max)
}

#[test]
fn every_scheme_maps_to_every_other() {
    for from in SCHEMES {
        for to in SCHEMES {
            let (source, target) = (skeleton(&from.bones()), skeleton(&to.bones()));
            let map = map_bones(&source, &target).unwrap();
            for bone in 0..source.bone_count() {
                assert!(!map.targets(bone).is_empty(), "{} to {}", source.label(bone), to.hips);
                assert!(matches!(map.how(bone), How::Name | How::Scheme), "{}", source.label(bone));
            }
            let used: std::collections::HashSet<u32> =
                (0..source.bone_count()).flat_map(|b| map.targets(b).to_vec()).collect();
            assert_eq!(used.len(), target.bone_count(), "{} to {}", from.hips, to.hips);
            assert!(worst_offset(&source, &target, &map) < 0.11, "{} to {}", from.hips, to.hips);
        }
    }
}

#[test]
fn twist_bones_share_their_limb() {
    let (mixamo, unreal) = (skeleton(&MIXAMO.bones()), skeleton(&UNREAL.bones()));
    let index = |s: &Skeleton, name: &str| s.names().unwrap().iter().position(|n| n == name).unwrap();
    let map = map_bones(&mixamo, &unreal).unwrap();
    let forearm = map.targets(index(&mixamo, "mixamorig:LeftForeArm"));
    let [lower, twist] = ["lowerarm_l", "lowerarm_twist_01_l"].map(|name| index(&unreal, name) as u32);
    assert_eq!(forearm, [lower, twist]);
    let back = map_bones(&unreal, &mixamo).unwrap();
    assert_eq!(back.targets(lower as usize), back.targets(twist as usize));
}

fn renamed(bones: &[Bone], name: impl Fn(usize) -> String) -> Vec<Bone> {
    bones.iter().enumerate().map(|(i, b)| (name(i), b.1, b.2, b.3)).collect()
}

fn permuted(bones: &[Bone], order: &[usize]) -> Vec<Bone> {
    let mut place = vec![0; bones.len()];
    order.iter().enumerate().for_each(|(new, &old)| place[old] = new as i64);
    let parent = |p: i64| if p < 0 { p } else { place[p as usize] };
    order
        .iter()
        .map(|&old| (bones[old].0.clone(), parent(bones[old].1), bones[old].2, bones[old].3))
        .collect()
}

fn turned(bones: &[Bone], rotation: DQuat, scale: f64, offset: DVec3) -> Vec<Bone> {
    let place = |p: DVec3| rotation * p * scale + offset;
    bones.iter().map(|b| (b.0.clone(), b.1, place(b.2), place(b.3))).collect()
}

/// A four-legged creature that looks along -Y, with `tail` bones in its tail.
fn quadruped(tail: usize, legs: f64) -> Vec<Bone> {
    let point = DVec3::new;
    let names = |n: usize| (0..n).map(|_| String::new()).collect::<Vec<_>>();
    let mut bones = Vec::new();
    let hips = chain(&mut bones, -1, &names(1), point(0.0, 0.3, legs), point(0.0, 0.15, legs));
    let chest = chain(&mut bones, hips, &names(3), point(0.0, 0.15, legs), point(0.0, -0.35, legs + 0.02));
    let neck =
        chain(&mut bones, chest, &names(2), point(0.0, -0.35, legs + 0.02), point(0.0, -0.5, legs + 0.2));
    chain(&mut bones, neck, &names(1), point(0.0, -0.5, legs + 0.2), point(0.0, -0.7, legs + 0.17));
    chain(&mut bones, hips, &names(tail), point(0.0, 0.32, legs), point(0.0, 0.8, legs - 0.1));
    for sign in [1.0, -1.0] {
        chain(
            &mut bones,
            chest,
            &names(3),
            point(sign * 0.1, -0.33, legs - 0.03),
            point(sign * 0.1, -0.36, 0.0),
        );
        chain(
            &mut bones,
            hips,
            &names(4),
            point(sign * 0.1, 0.28, legs - 0.03),
            point(sign * 0.1, 0.33, 0.0),
        );
    }
    renamed(&bones, |i| format!("bone.{i:03}"))
}

fn anonymous(bones: &[Bone]) -> Skeleton {
    let s = skeleton(bones);
    let parents: Vec<i64> = s.parents().iter().map(|p| p.map_or(-1, i64::from)).collect();
    Skeleton::new(s.heads().to_vec(), s.tails().to_vec(), &parents, None).unwrap()
}

fn side(point: DVec3) -> i32 {
    if point.x.abs() < 0.02 { 0 } else { point.x.signum() as i32 }
}

#[test]
fn quadrupeds_without_common_names_are_mapped_by_structure() {
    let (from, to) = (quadruped(6, 0.6), quadruped(4, 0.75));
    let (source, target) = (anonymous(&from), anonymous(&to));
    let map = map_bones(&source, &target).unwrap();
    for bone in 0..source.bone_count() {
        assert_eq!(map.how(bone), How::Structure, "bone {bone}");
        for &other in map.targets(bone) {
            let other = other as usize;
            assert_eq!(side(source.tails()[bone]), side(target.tails()[other]), "bone {bone} on {other}");
            let away = (source.tails()[bone] - target.tails()[other]).abs();
            assert!(away.y < 0.2 && away.z < 0.3, "bone {bone} on {other}");
        }
    }
}

#[test]
fn order_serves_only_where_it_agrees_with_structure() {
    let from = quadruped(5, 0.6);
    let posed = {
        let mut posed = from.clone();
        let last = posed.len() - 1;
        posed[last].3 += DVec3::new(0.0, -0.1, 0.05);
        posed
    };
    let (source, target) = (anonymous(&from), anonymous(&posed));
    let map = map_bones(&source, &target).unwrap();
    assert!((0..source.bone_count()).all(|b| map.targets(b) == [b as u32]));
    // The legs of either side in the other's places: the same numbers and parents, other sides.
    let mirrored: Vec<Bone> = from
        .iter()
        .map(|b| (b.0.clone(), b.1, b.2 * DVec3::new(-1.0, 1.0, 1.0), b.3 * DVec3::new(-1.0, 1.0, 1.0)))
        .collect();
    let target = anonymous(&mirrored);
    let map = map_bones(&source, &target).unwrap();
    for bone in 0..source.bone_count() {
        let sides = map.targets(bone).iter().map(|&t| side(target.tails()[t as usize]));
        assert!(sides.into_iter().all(|s| s == side(source.tails()[bone])), "bone {bone}");
    }
}

#[test]
fn nothing_in_common_lists_both_sides() {
    let empty = Skeleton::new(vec![], vec![], &[], None).unwrap();
    let error = map_bones(&skeleton(&UNREAL.bones()), &empty).unwrap_err();
    assert!(error.to_string().contains("pelvis") && error.to_string().contains("none"), "{error}");
}

#[test]
fn the_users_pairs_are_checked() {
    let source = skeleton(&VRM_HUMANOID.bones());
    let target = skeleton(&UNREAL.bones());
    let none = vec![vec![]; source.bone_count()];
    let with = |bone: usize, list: Vec<i64>| {
        let mut targets = none.clone();
        targets[bone] = list;
        BoneMap::from_pairs(&source, &target, &targets)
    };
    let text = |result: Result<BoneMap, BoneMapError>| result.unwrap_err().to_string();
    assert!(text(with(0, vec![])).contains("no bone"));
    assert!(text(with(1, vec![99])).contains("\"spine\""));
    assert!(text(with(1, vec![1, 1])).contains("twice"));
    let hand =
        |skeleton: &Skeleton, name: &str| skeleton.names().unwrap().iter().position(|n| n == name).unwrap();
    let [left, right] = ["hand_l", "hand_r"].map(|name| hand(&target, name) as i64);
    assert!(text(with(0, vec![left, right])).contains("hand_r"));
    assert!(text(BoneMap::from_pairs(&source, &target, &[])).contains("0 entries"));
    let map = with(1, vec![0]).unwrap();
    assert_eq!((map.how(1), map.how(0)), (How::User, How::None));
    // Hips lie above: they give to the nearest below; all others lie below the spine or beside it.
    assert!((0..source.bone_count()).all(|bone| map.carrier(bone) == 1));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn numbering_position_and_size_do_not_matter(
        order in Just((0..26usize).collect::<Vec<_>>()).prop_shuffle(),
        angles in prop::array::uniform3(-3.0f64..3.0),
        scale in 0.01f64..100.0,
        named in any::<bool>(),
    ) {
        let (from, to) = (quadruped(5, 0.6), quadruped(7, 0.7));
        prop_assert_eq!(to.len(), 28);
        let mut from = from;
        from.truncate(26);
        let mut to = to;
        if named {
            from = renamed(&from, |i| format!("limb_{}", i % 7));
            from = renamed(&from, |i| format!("limb_x{i}"));
            to = renamed(&to, |i| format!("glied_{i}"));
        }
        let rotation = DQuat::from_euler(glam::EulerRot::XYZ, angles[0], angles[1], angles[2]);
        let source = skeleton(&from);
        let target = skeleton(&to);
        let plain = map_bones(&source, &target).unwrap();
        let moved = map_bones(&source, &skeleton(&turned(&to, rotation, scale, DVec3::splat(3.0)))).unwrap();
        for bone in 0..26 {
            // Where two ways to share out a chain are nearly as good, the next bone may take over.
            let near = |a: u32, b: u32| {
                a == b || target.parents()[a as usize] == Some(b) || target.parents()[b as usize] == Some(a)
            };
            let common = plain.targets(bone).iter().any(|&a| moved.targets(bone).iter().any(|&b| near(a, b)));
            prop_assert!(common, "bone {}: {:?}, {:?}", bone, plain.targets(bone), moved.targets(bone));
        }
        let shuffled = map_bones(&skeleton(&permuted(&from, &order)), &skeleton(&to)).unwrap();
        for (new, &old) in order.iter().enumerate() {
            prop_assert_eq!(plain.targets(old), shuffled.targets(new));
        }
    }

    #[test]
    fn transfer_keeps_sums_and_is_continuous(
        values in prop::collection::vec(0.0f64..1.0, 3),
        x in -0.5f64..1.5,
        step in -1e-4f64..1e-4,
    ) {
        let line = |count: usize| {
            let mut bones = Vec::new();
            let names: Vec<String> = (0..count).map(|i| format!("tail_{i}")).collect();
            chain(&mut bones, -1, &names, DVec3::ZERO, DVec3::new(1.0, 0.3, 0.0));
            skeleton(&bones)
        };
        let (source, target) = (line(3), line(5));
        let map = map_bones(&source, &target).unwrap();
        let rows = SkinWeights::from_dense(&[&values[..], &values[..]].concat(), 3).unwrap();
        let points = [DVec3::new(x, 0.1, 0.2), DVec3::new(x + step, 0.1, 0.2)];
        let moved = map.transfer(&rows, &points, &target).unwrap();
        for vertex in 0..2 {
            prop_assert!((moved.total(vertex) - rows.total(vertex)).abs() < 1e-6);
        }
        let dense = moved.to_dense();
        for bone in 0..5 {
            let [a, b] = [dense[bone], dense[5 + bone]];
            prop_assert!((a - b).abs() < 60.0 * step.abs() as f32 + 1e-6);
        }
    }
}

#[test]
fn aligned_bones_tile_the_target() {
    let (source, target) = (skeleton(&RIGIFY.bones()), skeleton(&VRM.bones()));
    let map = map_bones(&source, &target).unwrap();
    let aligned = map.aligned_skeleton(&source, &target).unwrap();
    let index = |name: &str| source.names().unwrap().iter().position(|n| n == name).unwrap();
    let [upper, lower] = ["DEF-upper_arm.L", "DEF-upper_arm.L.001"].map(index);
    assert!(aligned.tails()[upper].distance(aligned.heads()[lower]) < 1e-12);
    let arm = target.names().unwrap().iter().position(|n| n == "J_Bip_L_UpperArm").unwrap();
    assert!(aligned.heads()[upper].distance(target.heads()[arm]) < 1e-12);
    assert!(aligned.tails()[lower].distance(target.tails()[arm]) < 1e-12);
}
