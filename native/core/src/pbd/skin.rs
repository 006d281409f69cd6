//! The skin: built once from mesh, skeleton and weights, then a pure function from poses to
//! vertices.

use std::borrow::Cow;
use std::sync::Mutex;
use std::time::Instant;

use glam::{Affine3A, Vec3};
use rayon::prelude::*;

use super::build::build_islands;
use super::contact_shape::reshaped;
use super::island::Island;
use super::limb_contact::LimbContacts;
use super::pose_scratch::{IslandScratch, PoseScratch, SurfaceScratch};
use super::smoothing::smooth_correction;
use super::stats::{ConstraintCounts, Milliseconds, Stats, Work};
use super::stiffness::check_shares;
use super::surface::{MovedVertices, PlainSkin};
use super::surface_contact::{PosedIsland, SurfaceContacts, separate};
use super::surface_crease::SurfaceCreases;
use super::surface_stretch::{PosedSurface, SurfaceStretch};
use super::{PbdError, PbdSettings, SkinningMethod};
use crate::cage::TetMesh;
use crate::mesh::{Adjacency, TriangleMesh};
use crate::rig::Skeleton;
use crate::skinning::{
    RestSpaceOffsets, SkinWeights, Skinning, SkinningError, check_transforms, to_rest_space,
};

/// A character's skin with volume-keeping joints. History-free: the same arguments give the same
/// bits, whatever was solved before and on any number of threads.
pub struct PbdSkin {
    settings: PbdSettings,
    rest: Vec<Vec3>,
    weights: SkinWeights,
    bone_rest: Option<Vec<Affine3A>>,
    adjacency: Adjacency,
    islands: Vec<Island>,
    contacts: Vec<SurfaceContacts>,
    limbs: LimbContacts,
    creases: SurfaceCreases,
    stretch: SurfaceStretch,
    moved: MovedVertices,
    constraints: ConstraintCounts,
    build_milliseconds: f64,
    pool: Option<rayon::ThreadPool>,
    /// What solves that are over have left, for the next ones.
    scratch: Mutex<Vec<PoseScratch>>,
}

/// A solved pose.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedSkin {
    /// Positions (V).
    pub vertices: Vec<Vec3>,
    /// What it took.
    pub stats: Stats,
}

/// A solved pose as offsets of the vertices before they are skinned.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedOffsets {
    /// Offsets (V).
    pub offsets: Vec<Vec3>,
    /// Vertices whose offset is limited, because their blended matrix is nearly singular.
    pub limited: usize,
    /// What it took.
    pub stats: Stats,
}

/// What a surface is skinned by, and its rest positions where they are not the mesh's.
struct Pose<'a> {
    skinning: &'a Skinning<'a>,
    transforms: &'a [Affine3A],
    vertices: Option<&'a [Vec3]>,
}

impl PbdSkin {
    /// Builds cages, islands and constraints. A mesh without triangles or without blending joints
    /// is a skin too: it is only ever skinned plainly.
    ///
    /// # Errors
    /// [`PbdError`] when counts differ, a setting is out of range, or the cage would be too large.
    pub fn new(
        mesh: &TriangleMesh,
        skeleton: &Skeleton,
        weights: &SkinWeights,
        settings: &PbdSettings,
    ) -> Result<Self, PbdError> {
        Self::with_stiffness(mesh, skeleton, weights, settings, None)
    }

    /// Like [`Self::new`], with a share (V), 0 to 1, of the settings' stiffness at each vertex.
    ///
    /// # Errors
    /// Those of [`Self::new`], and [`PbdError::Share`] naming a vertex.
    pub fn with_stiffness(
        mesh: &TriangleMesh,
        skeleton: &Skeleton,
        weights: &SkinWeights,
        settings: &PbdSettings,
        stiffness_shares: Option<&[f32]>,
    ) -> Result<Self, PbdError> {
        let begin = Instant::now();
        settings.check()?;
        if let Some(shares) = stiffness_shares {
            check_shares("stiffness_shares", shares, mesh.vertex_count())?;
        }
        for (element, left, left_count, right, right_count) in [
            ("vertices", "mesh", mesh.vertex_count(), "weights", weights.vertex_count()),
            ("bones", "skeleton", skeleton.bone_count(), "weights", weights.bone_count()),
        ] {
            if left_count != right_count {
                return Err(PbdError::Mismatch { element, left, left_count, right, right_count });
            }
        }
        let pool = settings.threads.map(|count| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build();
            pool.map_err(|e| PbdError::Threads { count, reason: e.to_string() })
        });
        let pool = pool.transpose()?;
        let topology = mesh.topology();
        let adjacency = Adjacency::new(mesh.vertex_count(), &topology);
        let build =
            || build_islands(mesh, skeleton, weights, settings, stiffness_shares, &topology, &adjacency);
        let islands = pool.as_ref().map_or_else(build, |pool| pool.install(build))?;
        let moved = MovedVertices::new(&islands);
        let contacts = islands.par_iter().map(|island| SurfaceContacts::new(mesh, island)).collect();
        let limbs = || match settings.self_collision && !islands.is_empty() {
            true => LimbContacts::new(mesh, &mesh.outward_normals(&topology), &adjacency, skeleton, weights),
            false => LimbContacts::default(),
        };
        let limbs = pool.as_ref().map_or_else(limbs, |pool| pool.install(limbs));
        let creases = SurfaceCreases::new(mesh, &adjacency, &moved.vertices);
        let stretch = SurfaceStretch::new(mesh, &adjacency, weights, &moved.vertices);
        let constraints = ConstraintCounts::of(&islands, settings);
        Ok(Self {
            settings: settings.clone(),
            rest: mesh.vertices().iter().map(|v| v.as_vec3()).collect(),
            weights: weights.clone(),
            bone_rest: None,
            adjacency,
            islands,
            contacts,
            limbs,
            creases,
            stretch,
            moved,
            constraints,
            build_milliseconds: milliseconds(begin),
            pool,
            scratch: Mutex::new(Vec::new()),
        })
    }

    /// Lets scaled bones keep their direction in dual quaternion skinning, as in Blender's Preserve
    /// Volume: `rest` (B) are the bones' rest matrices, see [`DualQuaternion::from_transform`].
    ///
    /// [`DualQuaternion::from_transform`]: crate::skinning::DualQuaternion::from_transform
    ///
    /// # Errors
    /// [`PbdError::Skinning`] for a wrong count or a matrix that is not finite.
    pub fn with_bone_rest(mut self, rest: Vec<Affine3A>) -> Result<Self, PbdError> {
        check_count("rest matrices", self.weights.bone_count(), rest.len())?;
        check_transforms(&rest)?;
        self.bone_rest = Some(rest);
        Ok(self)
    }

    /// Solves a pose. `transforms` (B) are pose · rest⁻¹; `vertices` (V) replace the rest positions
    /// of the surface, for shape keys that act before the armature.
    ///
    /// # Errors
    /// [`PbdError::Skinning`] naming a bone or vertex that is not finite, or a wrong count.
    pub fn solve(&self, transforms: &[Affine3A], vertices: Option<&[Vec3]>) -> Result<SolvedSkin, PbdError> {
        self.check_pose(transforms, vertices)?;
        Ok(self.on_threads(|| {
            let begin = Instant::now();
            let skinning = self.skinning(transforms);
            let pose = Pose { skinning: &skinning, transforms, vertices };
            let mut positions = vec![Vec3::ZERO; self.rest.len()];
            let mut scratch = self.take_scratch();
            let PoseScratch { islands, plain, surface, .. } = &mut scratch;
            plain.resize(self.rest.len(), Vec3::ZERO);
            let mut stats = self.skin_and_solve(&pose, islands, plain, &mut positions);
            let surface_begin = Instant::now();
            if stats.active_islands > 0 {
                self.correct(&pose, islands, plain, surface, &mut positions, &mut stats.work);
            }
            stats.milliseconds.surface = milliseconds(surface_begin);
            stats.milliseconds.total = milliseconds(begin);
            self.give_scratch(scratch);
            SolvedSkin { vertices: positions, stats }
        }))
    }

    /// Solves a pose like [`Self::solve`], as offsets that plain skinning turns into the solved
    /// skin. Where only `shares` (V), 0 to 1, of the vertices follow the skinning, they get as much
    /// of the correction.
    ///
    /// # Errors
    /// Those of [`Self::solve`], and [`PbdError::Share`] naming a vertex.
    pub fn solve_offsets(
        &self,
        transforms: &[Affine3A],
        vertices: Option<&[Vec3]>,
        shares: Option<&[f32]>,
    ) -> Result<SolvedOffsets, PbdError> {
        self.check_pose(transforms, vertices)?;
        if let Some(shares) = shares {
            check_shares("shares", shares, self.rest.len())?;
        }
        Ok(self.on_threads(|| {
            let begin = Instant::now();
            let skinning = self.skinning(transforms);
            let mut scratch = self.take_scratch();
            let PoseScratch { islands, plain, solved, surface } = &mut scratch;
            let pose = Pose { skinning: &skinning, transforms, vertices };
            plain.resize(self.rest.len(), Vec3::ZERO);
            solved.resize(self.rest.len(), Vec3::ZERO);
            // Unless it is stretched, what moves as a whole has no active island and needs no plain skin.
            let moves_as_one = transforms.windows(2).all(|pair| pair[0] == pair[1]);
            let mut stats = match moves_as_one {
                true => self.solve_islands(transforms, islands),
                false => self.skin_and_solve(&pose, islands, plain, solved),
            };
            let rest = if stats.active_islands > 0 {
                if moves_as_one {
                    skinning.all_into(vertices.unwrap_or(&self.rest), &self.weights, plain);
                    solved.copy_from_slice(plain);
                }
                let surface_begin = Instant::now();
                self.correct(&pose, islands, plain, surface, solved, &mut stats.work);
                let share = |vertex: usize| shares.map_or(1.0, |shares| shares[vertex]);
                let offset = |vertex: usize| (solved[vertex] - plain[vertex]) * share(vertex);
                let rest = to_rest_space(&skinning, &self.weights, offset, shares);
                stats.milliseconds.surface = milliseconds(surface_begin);
                rest
            } else {
                RestSpaceOffsets::zero(self.rest.len())
            };
            stats.milliseconds.total = milliseconds(begin);
            self.give_scratch(scratch);
            SolvedOffsets { offsets: rest.offsets, limited: rest.limited, stats }
        }))
    }

    fn on_threads<T: Send>(&self, solve: impl FnOnce() -> T + Send) -> T {
        match &self.pool {
            Some(pool) => pool.install(solve),
            // On a thread of the pool, where handing work to others costs least.
            None => rayon::scope(|_| solve()),
        }
    }

    fn check_pose(&self, transforms: &[Affine3A], vertices: Option<&[Vec3]>) -> Result<(), SkinningError> {
        let vertex_count = vertices.map_or(self.rest.len(), <[Vec3]>::len);
        check_count("transforms", self.weights.bone_count(), transforms.len())?;
        check_count("vertices", self.rest.len(), vertex_count)?;
        check_transforms(transforms)?;
        match vertices.and_then(|v| v.iter().position(|v| !v.is_finite())) {
            Some(vertex) => Err(SkinningError::NonFiniteVertex { vertex }),
            None => Ok(()),
        }
    }

    fn skinning<'a>(&self, transforms: &'a [Affine3A]) -> Skinning<'a> {
        match self.settings.skinning {
            SkinningMethod::Linear => Skinning::linear(transforms),
            SkinningMethod::DualQuaternion => {
                Skinning::dual_quaternion(transforms, self.bone_rest.as_deref())
            }
        }
    }

    /// Solves the islands while a thread that is free skins the surface (V) plainly, twice the same.
    fn skin_and_solve(
        &self,
        pose: &Pose<'_>,
        islands: &mut [IslandScratch],
        plain: &mut [Vec3],
        solved: &mut [Vec3],
    ) -> Stats {
        let skin = || {
            let begin = Instant::now();
            pose.skinning.all_into(pose.vertices.unwrap_or(&self.rest), &self.weights, plain);
            solved.copy_from_slice(plain);
            milliseconds(begin)
        };
        let (mut stats, skinned) = rayon::join(|| self.solve_islands(pose.transforms, islands), skin);
        stats.milliseconds.skinning = skinned;
        stats
    }

    fn solve_islands(&self, transforms: &[Affine3A], scratch: &mut [IslandScratch]) -> Stats {
        let begin = Instant::now();
        // Whichever thread is free takes the next island, the largest first.
        self.islands.iter().zip(scratch.iter_mut()).par_bridge().for_each(|(island, scratch)| {
            scratch.solve(island, &self.settings, transforms);
        });
        let active = || scratch.iter().filter(|s| s.frame.is_some());
        Stats {
            active_islands: active().count(),
            inverted: active().map(|s| s.inverted).sum(),
            work: scratch.iter().fold(Work::default(), |sum, s| sum.plus(s.work)),
            milliseconds: Milliseconds {
                build: self.build_milliseconds,
                solve: milliseconds(begin),
                ..Milliseconds::default()
            },
            ..self.build_stats()
        }
    }

    /// Moves the plainly skinned surface to where its islands have solved it.
    fn correct(
        &self,
        pose: &Pose<'_>,
        scratch: &[IslandScratch],
        skinned: &[Vec3],
        surface: &mut SurfaceScratch,
        positions: &mut [Vec3],
        work: &mut Work,
    ) {
        let Pose { skinning, transforms, vertices } = *pose;
        let vertices = vertices.unwrap_or(&self.rest);
        let is_rest = pose.vertices.is_none_or(|given| given == self.rest);
        let SurfaceScratch { corrections, all, smoothed, contact, creases, limbs, stretch } = surface;
        let plain = PlainSkin {
            skinning,
            weights: &self.weights,
            rest: &self.rest,
            skinned: is_rest.then_some(skinned),
        };
        work.corrected_vertices = self.moved.correct(&self.islands, scratch, &plain, corrections);
        let chosen = &self.moved.vertices;
        let moved = if self.settings.smoothing > 0.0 {
            all.resize(positions.len(), Vec3::ZERO);
            let given = chosen.iter().zip(&corrections.all);
            given.for_each(|(&vertex, &correction)| all[vertex as usize] = correction);
            smooth_correction(all, chosen, &self.adjacency, self.settings.smoothing, smoothed);
            for (&vertex, &correction) in chosen.iter().zip(&*smoothed) {
                positions[vertex as usize] += correction;
            }
            &*smoothed
        } else {
            for &place in corrections.computed.iter().flatten() {
                positions[chosen[place as usize] as usize] += corrections.all[place as usize];
            }
            &corrections.all
        };
        if self.settings.self_collision {
            let pairs = self.islands.par_iter().zip(&self.contacts).zip(scratch);
            let posed = pairs.filter_map(|((island, surface), scratch)| {
                let frame = scratch.frame.as_ref()?;
                let contacts = match is_rest {
                    true => Cow::Borrowed(island.contacts.as_slice()),
                    false => Cow::Owned(reshaped(island, &scratch.local, vertices)),
                };
                Some(PosedIsland { contacts, surface, frame, local: &scratch.local })
            });
            let posed: Vec<PosedIsland<'_>> = posed.collect();
            separate(&posed, positions, contact);
            self.creases.open(&contact.touched, &self.adjacency, positions, creases);
            let shape = (!is_rest).then_some(vertices);
            self.limbs.separate(transforms, shape, &self.adjacency, positions, limbs);
        }
        if self.settings.stretch > 0.0 && self.settings.anneal_stretch {
            let posed = PosedSurface {
                transforms,
                rest: &self.rest,
                plain: skinned,
                adjacency: &self.adjacency,
                moved: &self.moved.vertices,
                corrections: moved,
            };
            self.stretch.limit(&posed, positions, stretch);
        }
    }

    fn take_scratch(&self) -> PoseScratch {
        let kept = self.scratch.lock().map_or(None, |mut pool| pool.pop());
        let mut scratch = kept.unwrap_or_default();
        scratch.islands.resize_with(self.islands.len(), IslandScratch::default);
        scratch
    }

    fn give_scratch(&self, scratch: PoseScratch) {
        if let Ok(mut pool) = self.scratch.lock() {
            pool.push(scratch);
        }
    }

    /// The cage tetrahedra of all islands, in rest; islands do not share vertices.
    #[must_use]
    pub fn cage(&self) -> TetMesh {
        let mut cage = TetMesh::default();
        for island in &self.islands {
            cage.append(&island.cage());
        }
        cage
    }

    /// The settings that the skin was built with.
    #[must_use]
    pub fn settings(&self) -> &PbdSettings {
        &self.settings
    }

    /// What was built, before any pose is solved.
    #[must_use]
    pub fn build_stats(&self) -> Stats {
        Stats {
            vertices: self.rest.len(),
            moved_vertices: self.moved.vertices.len(),
            tetrahedra: self.islands.iter().map(|i| i.tetrahedra.len()).sum(),
            islands: self.islands.len(),
            constraints: self.constraints,
            milliseconds: Milliseconds { build: self.build_milliseconds, ..Milliseconds::default() },
            ..Stats::default()
        }
    }
}

fn check_count(element: &'static str, expected: usize, given: usize) -> Result<(), SkinningError> {
    if expected == given { Ok(()) } else { Err(SkinningError::Count { element, expected, given }) }
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
