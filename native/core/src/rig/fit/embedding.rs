//! The discrete embedding (Baran & Popović 2007, section 3.3): a best-first search over the places of
//! the reduced skeleton's nodes. Ends of limbs go to tips of the body, branchings to spheres.
//!
//! The cost of a partial embedding is the sum of the penalties between its nodes; the cheapest
//! candidate of every open node beside those that are placed bounds what is still to come from
//! below, so the first complete embedding is the best (A*).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::penalties::{self, MISSING, ONE_SIDED, SHARED_TIP};
use super::reduced_skeleton::ReducedSkeleton;
use super::sphere_graph::SphereGraph;
use super::symmetry::TemplateMirror;
use super::tips::Tips;
use crate::rig::bind::Plane;

/// The most limbs that are searched for; the shorter ones of more are carried along.
const MOST_LIMBS: usize = 12;
/// Branchings nearer to each other than this share of the diameter are one node.
const ONE_BRANCHING: f64 = 0.06;
/// A branching is in a sphere of at least this share of the largest radius.
const THICK: f64 = 0.3;
/// Partial embeddings to look at before the best so far is completed greedily.
const MOST_STATES: usize = 60_000;

/// Everything that an embedding is judged by.
pub(super) struct Search<'a> {
    pub(super) reduced: &'a ReducedSkeleton,
    /// Joints (J) of the template, as given.
    pub(super) points: &'a [DVec3],
    pub(super) tips: &'a Tips,
    pub(super) tip_places: Vec<DVec3>,
    pub(super) graph: &'a SphereGraph,
    /// Length in the body for a length in the template.
    pub(super) scale: f64,
    /// Partners of the template's joints.
    pub(super) mirror: Option<&'a TemplateMirror>,
    /// The mirror plane of the mesh.
    pub(super) plane: Option<Plane>,
}

/// Where a node went.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Place {
    Tip(usize),
    Sphere(usize),
    Nowhere,
}

/// Places of nodes: joints that end limbs, then branchings.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Embedding {
    pub(super) nodes: Vec<(usize, Place)>,
    /// Sum of all penalties.
    pub(super) cost: f64,
    /// Mean penalty over the pairs of nodes that have a place.
    pub(super) mean: f64,
}

struct Node {
    joint: usize,
    /// Length of the limb that ends here, 0 for a branching.
    limb: f64,
    candidates: Vec<Place>,
    ways: Vec<f64>,
}

impl Search<'_> {
    /// The best embedding; `None` without tips.
    pub(super) fn run(&self) -> Option<Embedding> {
        if self.tips.tips.is_empty() {
            return None;
        }
        let nodes = self.nodes();
        let (cost, places) = self.best_first(&nodes);
        let found: Vec<(&Node, Place)> =
            nodes.iter().zip(places.iter().copied()).filter(|(_, place)| *place != Place::Nowhere).collect();
        let mut sum = 0.0;
        for (i, &one) in found.iter().enumerate() {
            sum += self.single(one.0, one.1, 0);
            sum += found[..i].iter().map(|&other| self.pair(one, other)).sum::<f64>();
        }
        let pairs = found.len() * found.len().saturating_sub(1) / 2;
        let nodes = nodes.iter().zip(places).map(|(node, place)| (node.joint, place)).collect();
        Some(Embedding { nodes, cost, mean: sum / pairs.max(1) as f64 })
    }

    fn nodes(&self) -> Vec<Node> {
        let mut limbs: Vec<(usize, f64)> = self
            .reduced
            .limbs
            .iter()
            .map(|limb| (limb.joints[0], limb.lengths[limb.lengths.len() - 1]))
            .collect();
        limbs.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        limbs.truncate(MOST_LIMBS);
        let mut places: Vec<Place> = (0..self.tips.tips.len()).map(Place::Tip).collect();
        places.push(Place::Nowhere);
        let mut nodes: Vec<Node> = limbs
            .into_iter()
            .map(|(joint, limb)| Node { joint, limb, candidates: places.clone(), ways: self.ways(joint) })
            .collect();
        let near = ONE_BRANCHING * self.reduced.diameter;
        let thick = THICK * self.graph.radii.iter().copied().fold(0.0, f64::max);
        let spheres: Vec<Place> =
            (0..self.graph.ways.len()).filter(|&s| self.graph.radii[s] >= thick).map(Place::Sphere).collect();
        for &joint in &self.reduced.branchings {
            let mut others = nodes.iter().filter(|node| node.limb == 0.0);
            if others.all(|other| self.points[other.joint].distance(self.points[joint]) > near) {
                nodes.push(Node { joint, limb: 0.0, candidates: spheres.clone(), ways: self.ways(joint) });
            }
        }
        nodes
    }

    fn ways(&self, joint: usize) -> Vec<f64> {
        self.reduced.ways_from(joint, self.points)
    }

    fn position(&self, place: Place) -> Option<DVec3> {
        match place {
            Place::Tip(tip) => Some(self.tip_places[tip]),
            Place::Sphere(sphere) => Some(self.graph.centres[sphere]),
            Place::Nowhere => None,
        }
    }

    fn way(&self, a: Place, b: Place) -> f64 {
        match (a, b) {
            (Place::Tip(a), Place::Tip(b)) => self.tips.tips[a].distances[self.tips.tips[b].voxel as usize],
            (Place::Tip(tip), Place::Sphere(sphere)) | (Place::Sphere(sphere), Place::Tip(tip)) => {
                self.tips.tips[tip].distances[self.graph.voxels[sphere] as usize]
            }
            (Place::Sphere(a), Place::Sphere(b)) => self.graph.ways[a][b],
            _ => f64::INFINITY,
        }
    }

    fn are_partners(&self, one: usize, other: usize) -> bool {
        self.mirror.is_some_and(|mirror| mirror.partner[one] == Some(other))
    }

    /// Penalties of a node by itself.
    fn single(&self, node: &Node, place: Place, others: usize) -> f64 {
        let tip = match place {
            Place::Nowhere => return MISSING * others as f64,
            Place::Tip(tip) => penalties::tip(self.tips.tips[tip].length, self.scale * node.limb),
            Place::Sphere(_) => 0.0,
        };
        let is_middle = self.are_partners(node.joint, node.joint);
        if let Place::Tip(tip) = place
            && self.tips.tips[tip].is_middle
            && !is_middle
        {
            return f64::INFINITY;
        }
        match (is_middle, &self.plane, self.position(place)) {
            (true, Some(plane), Some(at)) => tip + penalties::symmetry(plane, at, at, self.tips.diameter),
            _ => tip,
        }
    }

    /// Penalties between two nodes.
    fn pair(&self, one: (&Node, Place), other: (&Node, Place)) -> f64 {
        let are_partners = self.are_partners(one.0.joint, other.0.joint);
        let (a, b) = match (self.position(one.1), self.position(other.1)) {
            (Some(a), Some(b)) => (a, b),
            (None, None) => return 0.0,
            _ => return if are_partners { ONE_SIDED } else { 0.0 },
        };
        if one.1 == other.1 {
            return if are_partners { SHARED_TIP } else { f64::INFINITY };
        }
        let expected = one.0.ways[other.0.joint];
        let length = penalties::length(self.way(one.1, other.1), self.scale * expected);
        let bone = self.points[other.0.joint] - self.points[one.0.joint];
        let direction = penalties::direction(b - a, bone, expected);
        let symmetry = match (are_partners, &self.plane) {
            (true, Some(plane)) => penalties::symmetry(plane, a, b, self.tips.diameter),
            _ => 0.0,
        };
        length + direction + symmetry
    }

    fn best_first(&self, nodes: &[Node]) -> (f64, Vec<Place>) {
        let table = Table::new(self, nodes);
        let limbs = nodes.iter().filter(|node| node.limb > 0.0).count();
        let mut heap = BinaryHeap::new();
        let push = |heap: &mut BinaryHeap<_>, chosen: Vec<usize>, cost: f64| {
            // Limbs come first; branchings follow from them and are not bounded before.
            let open = chosen.len()..if chosen.len() < limbs { limbs } else { nodes.len() };
            let cheapest = |at| table.costs(&chosen, at).into_iter().fold(f64::INFINITY, f64::min);
            let bound: f64 = cost + open.map(cheapest).sum::<f64>();
            if bound.is_finite() {
                // Costs are not negative, so their bits are in the order of their values.
                heap.push(Reverse((bound.to_bits(), Reverse(chosen.len()), chosen, cost.to_bits())));
            }
        };
        push(&mut heap, Vec::new(), 0.0);
        let mut states = 0;
        while let Some(Reverse((_, _, chosen, cost))) = heap.pop() {
            let cost = f64::from_bits(cost);
            if chosen.len() == nodes.len() {
                return (cost, chosen.iter().zip(nodes).map(|(&c, node)| node.candidates[c]).collect());
            }
            states += 1;
            let open = table.costs(&chosen, chosen.len());
            let mut order: Vec<usize> = (0..open.len()).filter(|&c| open[c].is_finite()).collect();
            order.sort_by(|&a, &b| open[a].total_cmp(&open[b]));
            if states > MOST_STATES {
                // Depth first from here on: only the cheapest next place, and nothing else is left.
                heap.clear();
                order.truncate(1);
            }
            for c in order {
                let mut longer = chosen.clone();
                longer.push(c);
                push(&mut heap, longer, cost + open[c]);
            }
        }
        (f64::INFINITY, vec![Place::Nowhere; nodes.len()])
    }
}

/// All penalties, of candidates by themselves and in pairs.
struct Table {
    /// Number of the first candidate of each node, and of all.
    first: Vec<usize>,
    single: Vec<f64>,
    pair: Vec<f64>,
}

impl Table {
    fn new(search: &Search, nodes: &[Node]) -> Self {
        let all: Vec<(usize, Place)> =
            (0..nodes.len()).flat_map(|n| nodes[n].candidates.iter().map(move |&place| (n, place))).collect();
        let mut first = vec![0];
        for node in nodes {
            first.push(first[first.len() - 1] + node.candidates.len());
        }
        let single = all.iter().map(|&(n, place)| search.single(&nodes[n], place, nodes.len() - 1)).collect();
        let pairs = all.iter().flat_map(|&(n, place)| {
            all.iter().map(move |&(m, other)| match n == m {
                true => f64::INFINITY,
                false => search.pair((&nodes[n], place), (&nodes[m], other)),
            })
        });
        Self { first, single, pair: pairs.collect() }
    }

    /// Cost of each candidate of a node beside those that are chosen for the nodes before it.
    fn costs(&self, chosen: &[usize], node: usize) -> Vec<f64> {
        (self.first[node]..self.first[node + 1])
            .map(|candidate| {
                let row = &self.pair[candidate * self.single.len()..];
                let beside = chosen.iter().enumerate().map(|(n, &c)| row[self.first[n] + c]);
                self.single[candidate] + beside.sum::<f64>()
            })
            .collect()
    }
}
