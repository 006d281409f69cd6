//! The surface follows the solved cage: corrections of the vertices that islands move.

use glam::Vec3;
use rayon::prelude::*;

use super::island::Island;
use super::pose_scratch::IslandScratch;
use crate::skinning::{SkinWeights, Skinning};

/// Vertices per task.
const CHUNK: usize = 512;

/// Which points of which islands move which vertices.
#[derive(Debug, Clone, Default)]
pub(super) struct MovedVertices {
    /// Vertices that some island moves (M), those of an island together.
    pub vertices: Vec<u32>,
    /// First point of each of them in `points`, and the end.
    starts: Vec<u32>,
    /// Island and place in its list of surface points.
    points: Vec<(u32, u32)>,
}

/// What corrections are relative to: the surface at rest and its plain skinning.
pub(super) struct PlainSkin<'a> {
    pub skinning: &'a Skinning<'a>,
    pub weights: &'a SkinWeights,
    pub rest: &'a [Vec3],
    /// The rest surface plainly skinned, where that is at hand.
    pub skinned: Option<&'a [Vec3]>,
}

/// Corrections in a pose. Which ones there are is kept for the next.
#[derive(Debug, Clone, Default)]
pub(super) struct Corrections {
    /// Of all moved vertices (M).
    pub all: Vec<Vec3>,
    /// Places of those that were computed, ascending, task by task; all others are zero.
    pub computed: Vec<Vec<u32>>,
    /// The islands' counts of changes that they are for, 0 where an island is idle.
    concerned: Vec<u64>,
}

impl MovedVertices {
    pub(super) fn new(islands: &[Island]) -> Self {
        let points_of = |(index, island): (u32, &Island)| {
            let points: Vec<(u32, u32, u32)> =
                (0..).zip(&island.surface).map(|(place, point)| (point.vertex, index, place)).collect();
            points
        };
        let mut entries: Vec<(u32, u32, u32)> = (0..).zip(islands).flat_map(points_of).collect();
        entries.par_sort_unstable();
        let mut runs: Vec<&[(u32, u32, u32)]> = entries.chunk_by(|a, b| a.0 == b.0).collect();
        runs.par_sort_by_key(|run| run[0].1);
        let mut moved = Self::default();
        for run in runs {
            moved.vertices.push(run[0].0);
            moved.starts.push(moved.points.len() as u32);
            moved.points.extend(run.iter().map(|&(_, island, place)| (island, place)));
        }
        moved.starts.push(moved.points.len() as u32);
        moved
    }

    /// Corrections of the moved vertices (M) into `corrections.all`, and how many of them were computed: where all
    /// is as if at rest, the correction is zero.
    pub(super) fn correct(
        &self,
        islands: &[Island],
        scratch: &[IslandScratch],
        plain: &PlainSkin<'_>,
        corrections: &mut Corrections,
    ) -> usize {
        let Corrections { all, computed, concerned } = corrections;
        let states = scratch.iter().map(|s| s.frame.map_or(0, |_| s.solver.changes()));
        let is_known = all.len() == self.vertices.len() && states.clone().eq(concerned.iter().copied());
        if !is_known {
            concerned.clear();
            concerned.extend(states);
            all.resize(self.vertices.len(), Vec3::ZERO);
            computed.resize_with(all.len().div_ceil(CHUNK), Vec::new);
        }
        let is_idle = |island: u32| scratch[island as usize].frame.is_none();
        let chunks = all.par_chunks_mut(CHUNK).zip(&mut *computed).enumerate();
        let counts = chunks.map(|(chunk, (all, places))| {
            let first = chunk * CHUNK;
            let correction = |place: usize| self.correction(place, islands, scratch, plain);
            if is_known {
                for &place in &*places {
                    all[place as usize - first] = correction(place as usize).unwrap_or_default();
                }
                return places.len();
            }
            all.fill(Vec3::ZERO);
            places.clear();
            let starts = &self.starts[first..][..=all.len()];
            let points = &self.points[starts[0] as usize..starts[all.len()] as usize];
            if points.chunk_by(|a, b| a.0 == b.0).all(|run| is_idle(run[0].0)) {
                return 0;
            }
            for (place, own) in (first..).zip(all) {
                if let Some(correction) = correction(place) {
                    *own = correction;
                    places.push(place as u32);
                }
            }
            places.len()
        });
        counts.sum()
    }

    /// The correction of a moved vertex; `None` where no island is active or it is carried rigidly.
    fn correction(
        &self,
        place: usize,
        islands: &[Island],
        scratch: &[IslandScratch],
        plain: &PlainSkin<'_>,
    ) -> Option<Vec3> {
        let vertex = self.vertices[place] as usize;
        let row = plain.weights.row(vertex);
        let mut skinned = plain.skinned.map(|skinned| skinned[vertex]);
        let mut correction = None;
        for &(island, point) in &self.points[self.starts[place] as usize..self.starts[place + 1] as usize] {
            let scratch = &scratch[island as usize];
            let Some(frame) = &scratch.frame else { continue };
            let point = &islands[island as usize].surface[point as usize];
            if scratch.solver.concerns(point, row.0) {
                let solved = frame.transform_point3(point.position(&scratch.solver.particles));
                let skinned = *skinned.get_or_insert_with(|| plain.skinning.vertex(plain.rest[vertex], row));
                *correction.get_or_insert(Vec3::ZERO) += point.share * (solved - skinned);
            }
        }
        correction
    }
}
