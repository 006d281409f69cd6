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

    /// Corrections of the moved vertices (M), and how many of them were computed: where all is as if at
    /// rest, the correction is zero.
    pub(super) fn corrections(
        &self,
        islands: &[Island],
        scratch: &[IslandScratch],
        plain: &PlainSkin<'_>,
        corrections: &mut Vec<Vec3>,
    ) -> usize {
        corrections.clear();
        corrections.resize(self.vertices.len(), Vec3::ZERO);
        let chunks = corrections.par_chunks_mut(CHUNK).enumerate();
        let counts = chunks.map(|(chunk, corrections)| {
            let mut count = 0;
            let starts = &self.starts[chunk * CHUNK..][..=corrections.len()];
            let points = &self.points[starts[0] as usize..starts[corrections.len()] as usize];
            let mut seen = None;
            let mut is_idle = |island: u32| {
                let is_new = seen.replace(island) != Some(island);
                !is_new || scratch[island as usize].frame.is_none()
            };
            if points.iter().all(|&(island, _)| is_idle(island)) {
                return 0;
            }
            for (place, correction) in (chunk * CHUNK..).zip(corrections) {
                count += usize::from(self.correct(place, islands, scratch, plain, correction));
            }
            count
        });
        counts.sum()
    }

    /// True where the correction had to be computed.
    fn correct(
        &self,
        place: usize,
        islands: &[Island],
        scratch: &[IslandScratch],
        plain: &PlainSkin<'_>,
        correction: &mut Vec3,
    ) -> bool {
        let vertex = self.vertices[place] as usize;
        let row = plain.weights.row(vertex);
        let mut skinned = plain.skinned.map(|skinned| skinned[vertex]);
        let mut computed = false;
        for &(island, point) in &self.points[self.starts[place] as usize..self.starts[place + 1] as usize] {
            let scratch = &scratch[island as usize];
            let Some(frame) = &scratch.frame else { continue };
            let point = &islands[island as usize].surface[point as usize];
            if scratch.solver.concerns(point, row.0) {
                let solved = frame.transform_point3(point.position(&scratch.solver.particles));
                let skinned = *skinned.get_or_insert_with(|| plain.skinning.vertex(plain.rest[vertex], row));
                *correction += point.share * (solved - skinned);
                computed = true;
            }
        }
        computed
    }
}
