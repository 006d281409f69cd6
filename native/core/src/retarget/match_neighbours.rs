//! What neighbours say of a match: places near along the target must lie near along the source, the way
//! back from the source must end near, and small patches that contradict what is around them fall.

use super::geodesic::{Ball, joined_by_two_edges};
use super::icp::Surroundings;
use super::rejection::Candidate;
use crate::mesh::{Adjacency, ClosestPoint, TriangleMesh};
use crate::spectral::SpectralError;

/// How much longer than the straight way the way along the surface may be.
const DETOUR: f64 = 3.0;
/// Both faces of a cloth lie this near to each other, as a share of the extent.
const CLOTH: f64 = 0.01;
/// Least share of a part that makes even a small patch stand.
const MOST_OF_PART: f64 = 0.5;

/// What the neighbours say of a match.
#[derive(Debug, Default)]
pub(super) struct Verdict {
    /// Neighbours whose matches passed too, and whether they lie near along the source.
    pub(super) consistent: Vec<(u32, bool)>,
    /// Whether the way back from the source ends near.
    pub(super) returns: bool,
}

/// Edges of both surfaces with their seams closed.
pub(super) struct Neighbours {
    source: TriangleMesh,
    target: TriangleMesh,
    source_edges: Adjacency,
    target_edges: Adjacency,
    stands_for: Vec<u32>,
    components: Vec<u32>,
}

impl Neighbours {
    pub(super) fn new(target: Surroundings<'_>, source: &Surroundings<'_>) -> Result<Self, SpectralError> {
        let (source, target_mesh) = (source.shell.welded(source.mesh)?, target.shell.welded(target.mesh)?);
        let topology = target_mesh.topology();
        Ok(Self {
            source_edges: Adjacency::new(source.vertex_count(), &source.topology()),
            target_edges: Adjacency::new(target_mesh.vertex_count(), &topology),
            components: topology.components().to_vec(),
            stands_for: target.shell.stands_for().to_vec(),
            source,
            target: target_mesh,
        })
    }

    fn neighbours(&self, v: usize) -> &[u32] {
        self.target_edges.neighbours(self.stands_for[v] as usize)
    }

    /// Whether each neighbour's match lies near the vertex's own along the source.
    pub(super) fn consistent(
        &self,
        v: usize,
        candidates: &[Candidate],
        source: Surroundings<'_>,
        ball: &mut Ball,
    ) -> Vec<(u32, bool)> {
        let own = &candidates[v].at;
        let coarse = |at: &ClosestPoint| {
            let [a, b, c] = source.mesh.corners(at.triangle as usize);
            a.distance(b).max(b.distance(c)).max(c.distance(a))
        };
        let neighbours = self.neighbours(v).iter().filter(|n| candidates[**n as usize].passes);
        let corners = |at: &ClosestPoint| self.source.triangles()[at.triangle as usize];
        let mut grown = -1.0;
        neighbours
            .map(|&n| {
                let at = &candidates[n as usize].at;
                if corners(at).iter().any(|corner| corners(own).contains(corner)) {
                    return (n, true);
                }
                let straight = self.target.vertices()[v].distance(self.target.vertices()[n as usize]);
                let slack = coarse(own) + coarse(at);
                let bound = DETOUR * straight + own.distance + at.distance + slack;
                // The way is mostly short and straight, and then a look around or a small ball decides.
                let ends = [own, at].map(|at| (corners(at), at.position));
                if joined_by_two_edges(&self.source, &self.source_edges, ends[0], ends[1], bound) {
                    return (n, true);
                }
                let likely = (1.2 * own.position.distance(at.position) + slack).min(bound);
                for radius in [likely, bound] {
                    if grown < radius {
                        ball.grow(&self.source, &self.source_edges, corners(own), own.position, radius);
                        grown = radius;
                    }
                    if ball.distance(&self.source, corners(at), at.position) <= bound {
                        return (n, true);
                    }
                }
                (n, false)
            })
            .collect()
    }

    /// Whether the match leaps by more than `stretch` times an edge, from limb to limb.
    pub(super) fn tears(&self, v: usize, candidates: &[Candidate], stretch: f64) -> bool {
        let (at, place) = (self.target.vertices(), |v: usize| candidates[v].at.position);
        let leaps = |n: usize| place(v).distance(place(n)) > stretch * at[v].distance(at[n]);
        self.neighbours(v).iter().any(|&n| leaps(n as usize))
    }

    /// Whether the target's point closest to the match lies near the vertex along the target.
    pub(super) fn returns(
        &self,
        v: usize,
        candidate: &Candidate,
        target: Surroundings<'_>,
        ball: &mut Ball,
    ) -> bool {
        let Some(home) = target.closest(candidate.at.position) else {
            return false;
        };
        let point = target.mesh.vertices()[v];
        let longest = |v: usize| {
            let from = self.target.vertices()[self.stands_for[v] as usize];
            let length = |n: &u32| from.distance(self.target.vertices()[*n as usize]);
            self.neighbours(v).iter().map(length).fold(0.0, f64::max)
        };
        let radius = DETOUR * home.position.distance(point) + 2.0 * longest(v);
        let own = self.stands_for[v];
        let corners = self.target.triangles()[home.triangle as usize];
        // Another layer or part right there is no contradiction: it lies where this one does.
        if self.components[corners[0] as usize] != self.components[own as usize] {
            return true;
        }
        // So does the other face of a thin cloth.
        if target.shell.two_sided[v] && home.position.distance(point) <= CLOTH * target.shell.extent {
            return true;
        }
        let near = |corner: &u32| *corner == own || self.neighbours(v).contains(corner);
        if corners.iter().any(near) {
            return true;
        }
        let ends = [([own; 3], point), (corners, home.position)];
        if joined_by_two_edges(&self.target, &self.target_edges, ends[0], ends[1], radius) {
            return true;
        }
        ball.grow(&self.target, &self.target_edges, [own; 3], point, radius);
        ball.distance(&self.target, corners, home.position) <= radius
    }

    /// Takes away small patches of matches that contradict or miss what is around them.
    pub(super) fn without_small_patches(
        &self,
        passes: &[bool],
        verdicts: &[Verdict],
        target: &TriangleMesh,
        smallest: f64,
    ) -> Vec<bool> {
        let count = passes.len();
        let mut areas = vec![0.0; count];
        for (t, triangle) in self.target.triangles().iter().enumerate() {
            let share = target.area_vector(t).length() / 6.0;
            triangle.iter().for_each(|&v| areas[v as usize] += share);
        }
        let mut part_areas = vec![0.0; count];
        for (v, area) in areas.iter().enumerate() {
            part_areas[self.components[v] as usize] += area;
        }
        let mut accepted = passes.to_vec();
        let mut seen = vec![false; count];
        for first in (0..count).filter(|&v| passes[v] && self.stands_for[v] as usize == v) {
            if std::mem::replace(&mut seen[first], true) {
                continue;
            }
            let (mut patch, mut next, mut area) = (vec![first], 0, 0.0);
            while let Some(&v) = patch.get(next) {
                next += 1;
                area += areas[v];
                for (n, agrees) in &verdicts[v].consistent {
                    let n = *n as usize;
                    if *agrees && passes[n] && !std::mem::replace(&mut seen[n], true) {
                        patch.push(n);
                    }
                }
            }
            let part = part_areas[self.components[first] as usize];
            if area < smallest && area < MOST_OF_PART * part {
                patch.iter().for_each(|&v| accepted[v] = false);
            }
        }
        (0..count).map(|v| accepted[v] && accepted[self.stands_for[v] as usize]).collect()
    }
}
