//! The reduced skeleton (Baran & Popović 2007, section 3.2): the template's ends and branchings and
//! the chains of bones between them. Fingers, face, breasts, heels and other short branches are left
//! out; the longest of them ends its limb.

use glam::DVec3;

use super::joints::{Joints, bounds};
use super::symmetry::TemplateMirror;
use crate::rig::bone_map::names_a_root;
use crate::rig::{Skeleton, distance_to_segment};

/// Branches that reach less far than this share of the longest way through the skeleton are left out.
const SHORTEST_LIMB: f64 = 0.08;
/// A limb of a single bone must reach out this far, or it is a breast or a pelvis bone.
const LONE_BONE: f64 = 0.15;
/// The only limb in the mirror plane at a branching, a neck with its head or a tail, may be this short.
const SHORTEST_MIDDLE: f64 = 0.045;
/// A joint nearer to the trunk's axis than this share of the diameter is in it.
const BESIDE_TRUNK: f64 = 0.02;
/// A root whose child is farther away than this share of the size stands on the ground, not in the body.
const FAR_ROOT: f64 = 0.2;
/// A tree of bones joins the body's where it begins nearer than this share of the size.
const NEAR_TREE: f64 = 0.12;
/// How much less a branch counts for every length of it that no bone covers.
const GAP_COST: f64 = 0.5;

/// A limb: joints from its end to the branching where it begins.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Limb {
    pub(super) joints: Vec<usize>,
    /// Length of the way from the end to each of the joints.
    pub(super) lengths: Vec<f64>,
    /// Whether each joint is beside the trunk, not in its axis as the inner end of a collar bone is.
    /// True for all of a limb in the middle.
    pub(super) beside_trunk: Vec<bool>,
}

/// The template reduced to its limbs and the tree of joints that carries them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ReducedSkeleton {
    pub(super) limbs: Vec<Limb>,
    /// Joints where more than two chains meet.
    pub(super) branchings: Vec<usize>,
    /// Neighbours of each joint (J) in the tree of limbs and trunk; empty for joints left out.
    pub(super) links: Vec<Vec<usize>>,
    /// Bones (B) that follow the body: deforming, and not a root on the ground.
    pub(super) body_bones: Vec<bool>,
    /// Longest way through the tree.
    pub(super) diameter: f64,
}

impl ReducedSkeleton {
    /// Reduces a template with the bones (B) that follow the body; `None` where it has no two ends that are apart.
    pub(super) fn new(
        template: &Skeleton,
        joints: &Joints,
        body_bones: Vec<bool>,
        mirror: Option<&TemplateMirror>,
    ) -> Option<Self> {
        let mut edges = edges(template, joints, &body_bones);
        join_trees(&joints.points, &mut edges);
        let mut links: Vec<Vec<usize>> = vec![Vec::new(); joints.points.len()];
        let mut gaps: Vec<(usize, usize)> = Vec::new();
        for edge in &edges {
            links[edge.ends.0].push(edge.ends.1);
            links[edge.ends.1].push(edge.ends.0);
            if edge.is_gap {
                gaps.push((edge.ends.0.min(edge.ends.1), edge.ends.0.max(edge.ends.1)));
            }
        }
        let mut reduced =
            Self { limbs: Vec::new(), branchings: Vec::new(), links, body_bones, diameter: 0.0 };
        reduced.keep_largest_tree(&joints.points);
        reduced.diameter = reduced.longest_way(&joints.points)?;
        reduced.prune(&joints.points, &gaps, mirror);
        reduced.branchings = (0..reduced.links.len()).filter(|&j| reduced.links[j].len() > 2).collect();
        reduced.limbs = reduced.all_limbs(&joints.points, mirror);
        Some(reduced)
    }

    /// Ways (J) along the tree from one joint; infinite for joints left out.
    pub(super) fn ways_from(&self, start: usize, points: &[DVec3]) -> Vec<f64> {
        let mut ways = vec![f64::INFINITY; self.links.len()];
        ways[start] = 0.0;
        let mut front = vec![start];
        while let Some(joint) = front.pop() {
            for &next in &self.links[joint] {
                if ways[next].is_infinite() {
                    ways[next] = ways[joint] + points[joint].distance(points[next]);
                    front.push(next);
                }
            }
        }
        ways
    }

    /// Whether a joint is part of a limb or the trunk.
    pub(super) fn holds(&self, joint: usize) -> bool {
        !self.links[joint].is_empty()
    }

    fn keep_largest_tree(&mut self, points: &[DVec3]) {
        let mut tree_of = vec![usize::MAX; self.links.len()];
        let mut lengths = Vec::new();
        for seed in 0..self.links.len() {
            if tree_of[seed] != usize::MAX || self.links[seed].is_empty() {
                continue;
            }
            let mut length = 0.0;
            tree_of[seed] = lengths.len();
            let mut front = vec![seed];
            while let Some(joint) = front.pop() {
                for &next in &self.links[joint] {
                    length += points[joint].distance(points[next]);
                    if tree_of[next] == usize::MAX {
                        tree_of[next] = lengths.len();
                        front.push(next);
                    }
                }
            }
            lengths.push(length);
        }
        let largest = (0..lengths.len()).max_by(|&a, &b| lengths[a].total_cmp(&lengths[b]).then(b.cmp(&a)));
        for (joint, links) in self.links.iter_mut().enumerate() {
            if Some(tree_of[joint]) != largest {
                links.clear();
            }
        }
    }

    fn longest_way(&self, points: &[DVec3]) -> Option<f64> {
        let farthest = |start: usize| {
            let ways = self.ways_from(start, points);
            (0..ways.len())
                .filter(|&j| ways[j].is_finite())
                .map(|j| (j, ways[j]))
                .max_by(|a, b| a.1.total_cmp(&b.1))
        };
        let start = (0..self.links.len()).find(|&j| self.holds(j))?;
        let diameter = farthest(farthest(start)?.0)?.1;
        (diameter > 0.0).then_some(diameter)
    }

    /// Takes the shortest branch away as long as one is too short.
    fn prune(&mut self, points: &[DVec3], gaps: &[(usize, usize)], mirror: Option<&TemplateMirror>) {
        let is_gap = |pair: &[usize]| gaps.contains(&(pair[0].min(pair[1]), pair[0].max(pair[1])));
        loop {
            let ends: Vec<usize> = (0..self.links.len()).filter(|&j| self.links[j].len() == 1).collect();
            let branch = |end: usize| {
                let path = self.chain(end);
                let reach = points[path[path.len() - 1]].distance(points[end]);
                let gap: f64 = path
                    .windows(2)
                    .filter(|pair| is_gap(pair))
                    .map(|pair| points[pair[0]].distance(points[pair[1]]))
                    .sum();
                (reach - GAP_COST * gap, path)
            };
            let is_middle = |joint: usize| mirror.is_some_and(|m| m.partner[joint] == Some(joint));
            let branches: Vec<(f64, Vec<usize>)> = ends.into_iter().map(branch).collect();
            let middle_at = |branching: usize| {
                let here = branches.iter().filter(|(_, path)| path[path.len() - 1] == branching);
                here.filter(|(_, path)| is_middle(path[0])).count()
            };
            let shortest = branches
                .iter()
                .filter(|(_, path)| self.links[path[path.len() - 1]].len() > 2)
                .filter(|(reach, path)| {
                    let is_lone = path.windows(2).filter(|pair| !is_gap(pair)).count() < 2;
                    let is_only = is_middle(path[0]) && middle_at(path[path.len() - 1]) == 1;
                    let least = match (is_lone, is_only) {
                        (_, true) => SHORTEST_MIDDLE,
                        (false, false) => SHORTEST_LIMB,
                        (true, false) => LONE_BONE,
                    };
                    *reach < self.diameter * least
                })
                .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let Some(path) = shortest.map(|(_, path)| path.clone()) else { return };
            for pair in path.windows(2) {
                self.links[pair[0]].clear();
                self.links[pair[1]].retain(|&j| j != pair[0]);
            }
        }
    }

    /// Joints from an end to the next branching or the other end.
    fn chain(&self, end: usize) -> Vec<usize> {
        let mut path = vec![end];
        let mut before = end;
        let mut at = end;
        while let Some(&next) = self.links[at].iter().find(|&&next| next != before) {
            (before, at) = (at, next);
            path.push(at);
            if self.links[at].len() != 2 {
                break;
            }
        }
        path
    }

    /// Limbs, ends ascending.
    fn all_limbs(&self, points: &[DVec3], mirror: Option<&TemplateMirror>) -> Vec<Limb> {
        let ends: Vec<usize> = (0..self.links.len()).filter(|&j| self.links[j].len() == 1).collect();
        let chains: Vec<Vec<usize>> = ends.iter().map(|&end| self.chain(end)).collect();
        // The axis of the trunk: every link that is not part of a limb on a side.
        let is_middle = |joint: usize| mirror.is_none_or(|m| m.partner[joint] == Some(joint));
        let on_a_side = |a: usize, b: usize| {
            let holds = |chain: &&Vec<usize>| chain.windows(2).any(|pair| pair == [a, b] || pair == [b, a]);
            chains.iter().find(holds).is_some_and(|chain| mirror.is_some() && !is_middle(chain[0]))
        };
        let axis: Vec<(usize, usize)> = (0..self.links.len())
            .flat_map(|a| self.links[a].iter().map(move |&b| (a, b)))
            .filter(|&(a, b)| a < b && !on_a_side(a, b))
            .collect();
        let from_axis = |joint: usize| {
            let ways = axis.iter().map(|&(a, b)| distance_to_segment(points[joint], points[a], points[b]));
            ways.fold(f64::INFINITY, f64::min)
        };
        let limb = |joints: Vec<usize>| {
            let mut sum = 0.0;
            let mut lengths = vec![0.0];
            for pair in joints.windows(2) {
                sum += points[pair[0]].distance(points[pair[1]]);
                lengths.push(sum);
            }
            let is_side = mirror.is_some() && !is_middle(joints[0]);
            let beside = |&joint: &usize| !is_side || from_axis(joint) > BESIDE_TRUNK * self.diameter;
            Limb { beside_trunk: joints.iter().map(beside).collect(), joints, lengths }
        };
        chains.iter().cloned().map(limb).collect()
    }
}

/// A bone, or a gap between a bone and its parent, between two joints.
struct Edge {
    ends: (usize, usize),
    is_gap: bool,
}

/// Nearest ancestor that is part of the body.
fn carrier(template: &Skeleton, body_bones: &[bool], bone: usize) -> Option<usize> {
    let mut above = template.parents()[bone];
    while let Some(parent) = above.map(|p| p as usize) {
        if body_bones[parent] {
            return Some(parent);
        }
        above = template.parents()[parent];
    }
    None
}

/// Bones as edges, parents first, and the gaps from a parent's nearer end to a child's head.
fn edges(template: &Skeleton, joints: &Joints, body_bones: &[bool]) -> Vec<Edge> {
    let mut edges = Vec::new();
    for &bone in template.depth_order() {
        let bone = bone as usize;
        if !body_bones[bone] {
            continue;
        }
        let (head, tail) = (joints.heads[bone], joints.tails[bone]);
        if let Some(parent) = carrier(template, body_bones, bone) {
            let ends = (joints.heads[parent], joints.tails[parent]);
            if head != ends.0 && head != ends.1 {
                let way = |joint: usize| joints.points[joint].distance(joints.points[head]);
                let from = if way(ends.0) < way(ends.1) { ends.0 } else { ends.1 };
                edges.push(Edge { ends: (from, head), is_gap: true });
            }
        }
        if head != tail {
            edges.push(Edge { ends: (head, tail), is_gap: false });
        }
    }
    edges
}

/// Joins trees that begin near another tree, such as feet under a control of their own.
fn join_trees(points: &[DVec3], edges: &mut Vec<Edge>) {
    let mut tree_of: Vec<usize> = (0..points.len()).collect();
    let mut used = vec![false; points.len()];
    let join = |tree_of: &mut Vec<usize>, (a, b): (usize, usize)| {
        let (from, to) = (tree_of[a].max(tree_of[b]), tree_of[a].min(tree_of[b]));
        tree_of.iter_mut().filter(|tree| **tree == from).for_each(|tree| *tree = to);
    };
    for edge in edges.iter() {
        used[edge.ends.0] = true;
        used[edge.ends.1] = true;
        join(&mut tree_of, edge.ends);
    }
    let joints: Vec<usize> = (0..points.len()).filter(|&j| used[j]).collect();
    let (low, high) = bounds(joints.iter().map(|&j| points[j]));
    let near = NEAR_TREE * (high - low).max_element();
    loop {
        let pairs = joints.iter().flat_map(|&a| joints.iter().map(move |&b| (a, b)));
        let nearest = pairs
            .filter(|&(a, b)| a < b && tree_of[a] != tree_of[b])
            .map(|(a, b)| (points[a].distance(points[b]), (a, b)))
            .filter(|(way, _)| *way <= near)
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, ends)) = nearest else { return };
        edges.push(Edge { ends, is_gap: true });
        join(&mut tree_of, ends);
    }
}

/// Deforming bones without the roots that only say where the character stands.
pub(super) fn without_ground_roots(template: &Skeleton, deform: &[bool]) -> Vec<bool> {
    let mut body: Vec<bool> = deform.to_vec();
    let heads = template.heads();
    let deforming = || (0..deform.len()).filter(|&b| deform[b]);
    let (low, high) = bounds(deforming().flat_map(|b| [heads[b], template.tails()[b]]));
    let size = (high - low).max_element();
    let children = template.children();
    let mut below = vec![1usize; deform.len()];
    for &bone in template.depth_order().iter().rev() {
        if let Some(parent) = template.parents()[bone as usize] {
            below[parent as usize] += below[bone as usize];
        }
    }
    for &bone in template.depth_order() {
        let bone = bone as usize;
        if !body[bone] || carrier(template, &body, bone).is_some() {
            continue;
        }
        let main =
            children[bone].iter().map(|&c| c as usize).max_by_key(|&c| (below[c], std::cmp::Reverse(c)));
        let Some(main) = main else { continue };
        let is_named = template.names().is_some_and(|names| names_a_root(&names[bone]));
        let is_far = heads[bone].distance(heads[main]) > FAR_ROOT * size
            && children[bone]
                .iter()
                .all(|&c| heads[c as usize].distance(heads[bone]) > 0.5 * FAR_ROOT * size);
        body[bone] = !(is_named || is_far);
    }
    // A template of such bones alone is a body.
    if body.iter().filter(|&&b| b).count() < 2 { deform.to_vec() } else { body }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::test_bodies::{bone, skeleton};

    fn reduced(template: &Skeleton) -> (Joints, ReducedSkeleton) {
        let joints = Joints::new(template);
        let body = without_ground_roots(template, &vec![true; template.bone_count()]);
        let mirror = TemplateMirror::new(template, &joints, &body);
        let reduced = ReducedSkeleton::new(template, &joints, body, mirror.as_ref()).unwrap();
        (joints, reduced)
    }

    #[test]
    fn arms_legs_and_head_remain() {
        let template = skeleton();
        let (joints, reduced) = reduced(&template);
        assert!(!reduced.body_bones[bone(&template, "root")], "it stands on the ground");
        let mut ends: Vec<usize> = reduced.limbs.iter().map(|limb| limb.joints[0]).collect();
        let mut expected: Vec<usize> = ["hand_l", "hand_r", "foot_l", "foot_r", "head"]
            .iter()
            .map(|name| joints.tails[bone(&template, name)])
            .collect();
        ends.sort_unstable();
        expected.sort_unstable();
        assert_eq!(ends, expected);
        assert!(!reduced.holds(joints.tails[bone(&template, "thumb_l")]));
        assert_eq!(reduced.branchings.len(), 2);
        let arm =
            reduced.limbs.iter().find(|l| l.joints[0] == joints.tails[bone(&template, "hand_l")]).unwrap();
        let beside = |name: &str| {
            let head = joints.heads[bone(&template, name)];
            arm.beside_trunk[arm.joints.iter().position(|&j| j == head).unwrap()]
        };
        assert!(beside("upperarm_l") && !beside("clavicle_l"));
        assert!((arm.lengths[1] - 0.09).abs() < 1e-12);
    }

    #[test]
    fn a_long_root_bone_up_to_the_hips_is_no_part_of_the_body() {
        let at = |z: f64| DVec3::new(0.0, 0.0, z);
        let heads = vec![at(0.0), at(1.0), at(1.2), DVec3::new(0.1, 0.0, 1.0)];
        let tails = vec![at(1.0), at(1.2), at(1.8), DVec3::new(0.1, 0.0, 0.0)];
        let named = |root: &str| {
            let names = [root, "a", "b", "c"].map(String::from).to_vec();
            let template = Skeleton::new(heads.clone(), tails.clone(), &[-1, 0, 1, 1], Some(names)).unwrap();
            without_ground_roots(&template, &[true; 4])[0]
        };
        assert!(!named("Root") && !named("trunk"));
    }

    #[test]
    fn a_point_has_no_limbs() {
        let points = vec![DVec3::ZERO; 2];
        let template = Skeleton::new(points.clone(), points, &[-1, 0], None).unwrap();
        let joints = Joints::new(&template);
        assert_eq!(ReducedSkeleton::new(&template, &joints, vec![true; 2], None), None);
    }
}
