//! Numbers about a skin and its last pose.

use super::PbdSettings;
use super::island::Island;

/// What a skin consists of and what a pose took.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stats {
    /// Vertices of the surface.
    pub vertices: usize,
    /// Vertices that islands can move.
    pub moved_vertices: usize,
    /// Tetrahedra of all islands.
    pub tetrahedra: usize,
    /// Islands.
    pub islands: usize,
    /// Islands whose bones had moved relative to each other.
    pub active_islands: usize,
    /// Constraints of all islands by kind; 0 for kinds that are off.
    pub constraints: ConstraintCounts,
    /// Tetrahedra of active islands that are inside out.
    pub inverted: usize,
    /// Where the time went.
    pub milliseconds: Milliseconds,
    /// What was computed. Like the time, and unlike the result, it depends on the poses before.
    pub work: Work,
}

/// Counted work of a pose: the same on every machine and on any number of threads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Work {
    /// Islands that were solved.
    pub solved_islands: usize,
    /// Islands that were as the pose before had left them.
    pub reused_islands: usize,
    /// Constraints projected, idle lanes included, in all sweeps.
    pub projections: usize,
    /// Contact candidates looked at in all sweeps over the cage.
    pub contact_candidates: usize,
    /// Vertices whose correction was computed.
    pub corrected_vertices: usize,
}

impl Work {
    /// The work of both.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            solved_islands: self.solved_islands + other.solved_islands,
            reused_islands: self.reused_islands + other.reused_islands,
            projections: self.projections + other.projections,
            contact_candidates: self.contact_candidates + other.contact_candidates,
            corrected_vertices: self.corrected_vertices + other.corrected_vertices,
        }
    }
}

/// Constraints by kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ConstraintCounts {
    /// Edges (eq. 6).
    pub stretch: usize,
    /// Tetrahedra (eq. 7).
    pub volume: usize,
    /// Particles with an anchor on a bone.
    pub bind: usize,
    /// Tetrahedra (eq. 9).
    pub energy: usize,
    /// Vertices that can touch the other side of a joint (eq. 12).
    pub self_collision: usize,
}

/// Milliseconds of each phase.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Milliseconds {
    /// Building the skin, once.
    pub build: f64,
    /// Plain skinning of the surface, in part at the same time as the islands are solved.
    pub skinning: f64,
    /// Solving the islands.
    pub solve: f64,
    /// Surface from cage, smoothing, contacts.
    pub surface: f64,
    /// The whole pose.
    pub total: f64,
}

impl ConstraintCounts {
    pub(super) fn of(islands: &[Island], settings: &PbdSettings) -> Self {
        let mut counts = [0; 5];
        for island in islands {
            counts.iter_mut().zip(island.constraint_counts()).for_each(|(sum, count)| *sum += count);
        }
        let on = [
            settings.stretch > 0.0,
            settings.volume > 0.0,
            settings.bind > 0.0,
            settings.energy > 0.0,
            settings.self_collision,
        ];
        counts.iter_mut().zip(on).for_each(|(count, on)| *count *= usize::from(on));
        let [stretch, volume, bind, energy, self_collision] = counts;
        Self { stretch, volume, bind, energy, self_collision }
    }
}
