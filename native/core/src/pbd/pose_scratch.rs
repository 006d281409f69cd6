//! What solving a pose leaves behind: buffers for the next one, and the last solution of every
//! island, which serves again where the bones have the same place relative to each other. A solution
//! is a pure function of those places, so the bits are the same either way.

use glam::{Affine3A, Vec3};

use super::PbdSettings;
use super::island::Island;
use super::limb_contact::LimbScratch;
use super::solver::{Scratch, solve_island};
use super::stats::Work;
use super::surface::Corrections;
use super::surface_contact::SeparationBuffers;
use super::surface_crease::CreaseScratch;
use super::surface_stretch::StretchScratch;

/// Buffers of a pose.
#[derive(Default)]
pub(super) struct PoseScratch {
    pub islands: Vec<IslandScratch>,
    /// The plainly skinned and the solved surface (V).
    pub plain: Vec<Vec3>,
    pub solved: Vec<Vec3>,
    pub surface: SurfaceScratch,
}

/// Buffers of the surface's correction.
#[derive(Default)]
pub(super) struct SurfaceScratch {
    /// Corrections of the vertices that islands move, and those that are smoothed.
    pub corrections: Corrections,
    /// Corrections of all vertices (V), where they are smoothed.
    pub all: Vec<Vec3>,
    pub smoothed: Vec<Vec3>,
    pub limbs: LimbScratch,
    pub contact: SeparationBuffers,
    pub creases: CreaseScratch,
    pub stretch: StretchScratch,
}

/// One island in a pose.
#[derive(Default)]
pub(super) struct IslandScratch {
    /// The frame in which the island is solved, where it is active.
    pub frame: Option<Affine3A>,
    /// Transforms (B) relative to the frame.
    pub local: Vec<Affine3A>,
    pub solver: Scratch,
    /// Tetrahedra that are inside out.
    pub inverted: usize,
    pub work: Work,
    /// Transforms of the bones that the solution depends on, as bits; empty without one.
    solved_for: Vec<[u32; 12]>,
    /// False where absurd transforms made the solution overflow.
    is_finite: bool,
}

impl IslandScratch {
    /// Solves the island for a pose, unless it is at rest or solved already.
    pub(super) fn solve(&mut self, island: &Island, settings: &PbdSettings, transforms: &[Affine3A]) {
        self.work = Work::default();
        self.frame = island.frame(transforms);
        let Some(frame) = self.frame else { return };
        let inverse = frame.inverse();
        self.local.clear();
        self.local.extend(transforms.iter().map(|t| inverse * *t));
        if island.is_at_rest(&self.local) {
            self.frame = None;
        } else if self.is_solved(island) {
            self.work.reused_islands = 1;
        } else {
            self.solved_for.clear();
            solve_island(island, settings, &self.local, &mut self.solver);
            self.solved_for.extend(island.dependencies().map(|bone| bits(&self.local[bone])));
            self.work = self.solver.work;
            self.inverted = self.solver.inverted(island);
            self.is_finite = self.solver.is_finite();
        }
        if !self.is_finite {
            // Overflow: the plain skin is all that can be shown.
            self.frame = None;
        }
    }

    fn is_solved(&self, island: &Island) -> bool {
        !self.solved_for.is_empty()
            && island.dependencies().map(|bone| bits(&self.local[bone])).eq(self.solved_for.iter().copied())
    }
}

fn bits(transform: &Affine3A) -> [u32; 12] {
    transform.to_cols_array().map(f32::to_bits)
}
