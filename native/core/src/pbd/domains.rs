//! The domains of an island: halves that share no constraint are solved at the same time, and then what
//! lies across the cut between them.
//!
//! An island is cut by its own size alone, so that the order of its constraints, and with it the result,
//! is the same on any number of threads.

use std::ops::Range;

use glam::Vec3;

use super::batches::Batches;
use super::island::Bind;
use super::lanes::{BATCH, Particle};

/// Tetrahedra of a domain that is not cut, at most. A cut costs quality where it meets a fold, so that only
/// islands are cut that would keep one core busy long after all others are done.
const MOST_TETRAHEDRA: usize = 12_000;

/// A cut that leaves less than this part of the tetrahedra in one half, as 1 / so many, is none.
const LEAST_HALF: usize = 8;

/// Constraints of one domain. Particles are counted from the first of the domain's own.
#[derive(Debug, Clone, Default)]
pub(super) struct Domain {
    /// Places of its particles in the island. The last one has no mass: idle lanes name it.
    pub particles: Range<usize>,
    /// Particles of the first half, and domains that it consists of; 0 where there are no halves.
    first_half: usize,
    first_domains: usize,
    pub edges: Batches<2>,
    /// Rest lengths of the edges in each batch.
    pub rest_lengths: Vec<[[f32; BATCH]; 1]>,
    pub tetrahedra: Batches<4>,
    /// Distances of the corners from the barycentre in rest, for the tetrahedra of each batch.
    pub spring_lengths: Vec<[[f32; BATCH]; 4]>,
    /// Shares of the stiffness in the tetrahedra of each batch; empty where it is 1 everywhere.
    pub stiffness_shares: Vec<[[f32; BATCH]; 1]>,
    pub binds: Vec<Bind>,
}

impl Domain {
    /// False for a domain that is not cut.
    pub(super) fn has_halves(&self) -> bool {
        self.first_domains > 0
    }
}

/// What the constraints of an island are made of, by the places of its particles.
pub(super) struct Constraints<'a> {
    pub edges: &'a [[u32; 2]],
    pub edge_lengths: &'a [f32],
    pub tetrahedra: &'a [[u32; 4]],
    pub spring_lengths: &'a [[f32; 4]],
    /// One for each tetrahedron, or none.
    pub stiffness_shares: &'a [f32],
    pub binds: &'a [Bind],
}

/// Where the particles of an island lie, and which constraints each domain has.
#[derive(Debug, Clone, Default)]
pub(super) struct Layout {
    /// The particle at each place; `None` for those without mass, one at the end of each domain without halves.
    pub order: Vec<Option<u32>>,
    /// Halves come before what is across them.
    domains: Vec<Members>,
}

#[derive(Debug, Clone, Default)]
struct Members {
    particles: Range<usize>,
    first_half: usize,
    first_domains: usize,
    edges: Vec<u32>,
    tetrahedra: Vec<u32>,
}

impl Layout {
    /// Cuts an island of particles at `positions` until no domain has too many tetrahedra.
    pub(super) fn new(positions: &[Vec3], edges: &[[u32; 2]], tetrahedra: &[[u32; 4]]) -> Self {
        Self::cut_to(MOST_TETRAHEDRA, positions, edges, tetrahedra)
    }

    fn cut_to(most: usize, positions: &[Vec3], edges: &[[u32; 2]], tetrahedra: &[[u32; 4]]) -> Self {
        let mut layout = Self::default();
        let all = Members {
            edges: (0..edges.len() as u32).collect(),
            tetrahedra: (0..tetrahedra.len() as u32).collect(),
            ..Members::default()
        };
        let particles = (0..positions.len() as u32).collect();
        let shape = Shape { most, positions, edges, tetrahedra };
        layout.lay(&shape, particles, all, None, &mut vec![false; positions.len()]);
        layout
    }

    /// Lays out a domain, its halves first; `towards` is the way to the cut that it lies at. `beyond` is
    /// false everywhere, a buffer.
    fn lay(
        &mut self,
        shape: &Shape<'_>,
        particles: Vec<u32>,
        mut members: Members,
        towards: Option<Vec3>,
        beyond: &mut Vec<bool>,
    ) {
        let start = self.order.len();
        if let Some((across, halves)) = shape.cut(&particles, &members) {
            halves[1].iter().for_each(|&particle| beyond[particle as usize] = true);
            let edges = part(&mut members.edges, shape.edges, beyond);
            let tetrahedra = part(&mut members.tetrahedra, shape.tetrahedra, beyond);
            halves[1].iter().for_each(|&particle| beyond[particle as usize] = false);
            let domains = self.domains.len();
            for (half, (particles, (edges, tetrahedra))) in
                halves.into_iter().zip(edges.into_iter().zip(tetrahedra)).enumerate()
            {
                let towards = Some(if half == 0 { across } else { -across });
                let members_of_half = Members { edges, tetrahedra, ..Members::default() };
                self.lay(shape, particles, members_of_half, towards, beyond);
                if half == 0 {
                    members.first_half = self.order.len() - start;
                    members.first_domains = self.domains.len() - domains;
                }
            }
        } else {
            if let Some(towards) = towards {
                // A sweep carries a change to the cut, and one backwards carries it on into the other half.
                shape.sort(&mut members.edges, shape.edges, towards);
                shape.sort(&mut members.tetrahedra, shape.tetrahedra, towards);
            }
            self.order.extend(particles.into_iter().map(Some));
            self.order.push(None);
        }
        members.particles = start..self.order.len();
        self.domains.push(members);
    }

    /// The domains with their constraints, which name places.
    pub(super) fn domains(&self, constraints: &Constraints<'_>) -> Vec<Domain> {
        self.domains.iter().map(|members| members.domain(constraints)).collect()
    }
}

impl Members {
    fn domain(&self, all: &Constraints<'_>) -> Domain {
        let Range { start, end } = self.particles;
        let idle = (end - start - 1) as u32;
        let edges = own(&self.edges, all.edges, start);
        let tetrahedra = own(&self.tetrahedra, all.tetrahedra, start);
        let edge_batches = Batches::new(&edges, idle);
        let tetrahedron_batches = Batches::new(&tetrahedra, idle);
        let edge = |index: usize| self.edges[index] as usize;
        let tetrahedron = |index: usize| self.tetrahedra[index] as usize;
        let stiffness_shares = match all.stiffness_shares {
            [] => Vec::new(),
            shares => tetrahedron_batches.gather(|index| [shares[tetrahedron(index)]]),
        };
        // What is across a cut has no particles of its own.
        let is_own =
            |bind: &&Bind| self.first_domains == 0 && self.particles.contains(&(bind.particle as usize));
        let binds = all.binds.iter().filter(is_own);
        Domain {
            particles: self.particles.clone(),
            first_half: self.first_half,
            first_domains: self.first_domains,
            rest_lengths: edge_batches.gather(|index| [all.edge_lengths[edge(index)]]),
            edges: edge_batches,
            spring_lengths: tetrahedron_batches.gather(|index| all.spring_lengths[tetrahedron(index)]),
            tetrahedra: tetrahedron_batches,
            stiffness_shares,
            binds: binds.map(|bind| Bind { particle: bind.particle - start as u32, ..*bind }).collect(),
        }
    }
}

/// Constraints of a domain, counted from its first particle.
fn own<const K: usize>(members: &[u32], constraints: &[[u32; K]], start: usize) -> Vec<[u32; K]> {
    members.iter().map(|&index| constraints[index as usize].map(|place| place - start as u32)).collect()
}

/// Takes the constraints that lie in one half out of `members`.
fn part<const K: usize>(members: &mut Vec<u32>, constraints: &[[u32; K]], beyond: &[bool]) -> [Vec<u32>; 2] {
    let mut halves = [Vec::new(), Vec::new()];
    members.retain(|&index| {
        let corners = constraints[index as usize];
        let count = corners.iter().filter(|&&corner| beyond[corner as usize]).count();
        if count > 0 && count < K {
            return true;
        }
        halves[usize::from(count > 0)].push(index);
        false
    });
    halves
}

/// An island that is cut.
struct Shape<'a> {
    most: usize,
    positions: &'a [Vec3],
    edges: &'a [[u32; 2]],
    tetrahedra: &'a [[u32; 4]],
}

impl Shape<'_> {
    /// Two halves with as many tetrahedra each, about: of the cuts across the three axes, the one that the
    /// fewest tetrahedra lie across, with the way from the first to the second. None for what is small enough, or cannot be cut.
    fn cut(&self, particles: &[u32], members: &Members) -> Option<(Vec3, [Vec<u32>; 2])> {
        let count = members.tetrahedra.len();
        if count <= self.most {
            return None;
        }
        let corners = || members.tetrahedra.iter().map(|&index| self.tetrahedra[index as usize]);
        let cuts = (0..3).filter_map(|axis| {
            let at = |particle: u32| self.positions[particle as usize][axis];
            let mut places: Vec<f32> = corners().flatten().map(at).collect();
            let middle = places.len() / 2;
            let cut = *places.select_nth_unstable_by(middle, f32::total_cmp).1;
            // Tetrahedra by the number of corners beyond the cut.
            let mut tally = [0; 5];
            corners().for_each(|corners| tally[corners.into_iter().filter(|&c| at(c) > cut).count()] += 1);
            let halves = [tally[0], tally[4]];
            (LEAST_HALF * halves[0].min(halves[1]) >= count).then_some((
                count - halves[0] - halves[1],
                axis,
                cut,
            ))
        });
        let (_, axis, cut) = cuts.min_by_key(|&(across, ..)| across)?;
        let (beyond, within): (Vec<u32>, Vec<u32>) =
            particles.iter().partition(|&&particle| self.positions[particle as usize][axis] > cut);
        Some((Vec3::AXES[axis], [within, beyond]))
    }

    /// Sorts constraints so that they run in a direction.
    fn sort<const K: usize>(&self, members: &mut [u32], constraints: &[[u32; K]], towards: Vec3) {
        let along = |index: &u32| {
            let corners = constraints[*index as usize].iter();
            corners.map(|&corner| self.positions[corner as usize].dot(towards)).sum::<f32>()
        };
        members.sort_by(|a, b| along(a).total_cmp(&along(b)));
    }
}

/// Runs a task on each domain with its own particles and its own buffers: halves at the same time, then
/// what is across them, or the other way round.
pub(super) fn sweep<S: Send>(
    domains: &[Domain],
    particles: &mut [Particle],
    buffers: &mut [S],
    backwards: bool,
    task: &(impl Fn(&Domain, &mut [Particle], &mut S) + Sync),
) {
    let (Some((domain, halves)), Some((buffer, half_buffers))) =
        (domains.split_last(), buffers.split_last_mut())
    else {
        return;
    };
    if backwards || halves.is_empty() {
        task(domain, particles, buffer);
    }
    if !halves.is_empty() {
        let (first, second) = halves.split_at(domain.first_domains);
        let (first_particles, second_particles) = particles.split_at_mut(domain.first_half);
        let (first_buffers, second_buffers) = half_buffers.split_at_mut(domain.first_domains);
        rayon::join(
            || sweep(first, first_particles, first_buffers, backwards, task),
            || sweep(second, second_particles, second_buffers, backwards, task),
        );
        if !backwards {
            task(domain, particles, buffer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use wide::f32x4;

    /// A row of cubes along x, each cut into six tetrahedra around its diagonal, and their edges.
    fn row(cubes: u32) -> (Vec<Vec3>, Vec<[u32; 2]>, Vec<[u32; 4]>) {
        let corner = |i: u32| Vec3::new((i / 4) as f32, (i / 2 % 2) as f32, (i % 2) as f32);
        let positions = (0..4 * cubes + 4).map(corner).collect();
        let around = [1, 3, 2, 6, 4, 5];
        let cube = |c: u32| (0..6).map(move |k| [0, 7, around[k], around[(k + 1) % 6]].map(|v| v + 4 * c));
        let tetrahedra: Vec<[u32; 4]> = (0..cubes).flat_map(cube).collect();
        let pairs = |t: &[u32; 4]| {
            let t = *t;
            (0..4).flat_map(move |i| (0..i).map(move |j| [t[i].min(t[j]), t[i].max(t[j])]))
        };
        let edges: BTreeSet<[u32; 2]> = tetrahedra.iter().flat_map(pairs).collect();
        (positions, edges.into_iter().collect(), tetrahedra)
    }

    /// Domains of a row, and the place of each particle.
    fn domains(cubes: u32, most: usize) -> (Vec<Domain>, Vec<u32>, Layout) {
        let (positions, edges, tetrahedra) = row(cubes);
        let layout = Layout::cut_to(most, &positions, &edges, &tetrahedra);
        let mut places = vec![u32::MAX; positions.len()];
        (0..).zip(&layout.order).for_each(|(place, p)| p.iter().for_each(|&p| places[p as usize] = place));
        let edges: Vec<[u32; 2]> = edges.iter().map(|e| e.map(|p| places[p as usize])).collect();
        let tetrahedra: Vec<[u32; 4]> = tetrahedra.iter().map(|t| t.map(|p| places[p as usize])).collect();
        let binds: Vec<Bind> = places
            .iter()
            .map(|&particle| Bind { particle, bone: 0, anchor: Vec3::ZERO, rest_length: 1.0 })
            .collect();
        let constraints = Constraints {
            edges: &edges,
            edge_lengths: &vec![1.0; edges.len()],
            tetrahedra: &tetrahedra,
            spring_lengths: &vec![[1.0; 4]; tetrahedra.len()],
            stiffness_shares: &[],
            binds: &binds,
        };
        (layout.domains(&constraints), places, layout)
    }

    #[test]
    fn every_constraint_is_in_one_domain_and_small_islands_are_whole() {
        let (_, edges, tetrahedra) = row(40);
        for (most, count) in [(240, 1), (239, 3), (100, 7)] {
            let (domains, places, layout) = domains(40, most);
            assert_eq!(domains.len(), count);
            let mut seen: Vec<u32> = layout.order.iter().copied().flatten().collect();
            seen.sort_unstable();
            assert_eq!(seen, Vec::from_iter(0..places.len() as u32));
            let ends = domains.iter().filter(|domain| domain.first_domains == 0);
            assert!(ends.clone().all(|domain| layout.order[domain.particles.end - 1].is_none()));
            assert_eq!(layout.order.len(), places.len() + ends.count());
            let mut found: Vec<[u32; 4]> = Vec::new();
            let mut lines = 0;
            for domain in &domains {
                let idle = domain.particles.len() as u32 - 1;
                for batch in domain.tetrahedra.corners.batches() {
                    for lane in (0..BATCH).filter(|&lane| batch[0][lane] != idle) {
                        let particle =
                            |k: usize| layout.order[domain.particles.start + batch[k][lane] as usize];
                        found.push(std::array::from_fn(|k| particle(k).unwrap()));
                    }
                }
                let lanes = domain.edges.corners.batches().flat_map(|[a, _]| a);
                lines += lanes.filter(|&a| a != idle).count();
            }
            found.sort_unstable();
            let mut wanted = tetrahedra.clone();
            wanted.sort_unstable();
            assert_eq!((found, lines), (wanted, edges.len()));
            assert_eq!(domains.iter().map(|domain| domain.binds.len()).sum::<usize>(), places.len());
        }
    }

    #[test]
    fn a_cut_is_thin_and_halves_are_alike() {
        let (domains, ..) = domains(40, 239);
        let count = |domain: &Domain| {
            let idle = domain.particles.len() as u32 - 1;
            domain.tetrahedra.corners.batches().flat_map(|[a, ..]| a).filter(|&a| a != idle).count()
        };
        let [first, second, across] = [0, 1, 2].map(|index| count(&domains[index]));
        assert_eq!(first + second + across, 240);
        assert!(across <= 6 && first.abs_diff(second) <= 12, "{first} {second} {across}");
    }

    #[test]
    fn halves_are_swept_before_what_is_across_them_and_after_it_on_the_way_back() {
        let (domains, places, layout) = domains(40, 100);
        for backwards in [false, true] {
            for threads in [1, 4] {
                // Each particle remembers the last domain that has swept it.
                let mut particles = vec![f32x4::splat(0.0); layout.order.len()];
                let mut buffers: Vec<f32> = (1..=domains.len()).map(|index| index as f32).collect();
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    sweep(&domains, &mut particles, &mut buffers, backwards, &|domain, particles, buffer| {
                        assert_eq!(particles.len(), domain.particles.len());
                        particles.fill(f32x4::splat(*buffer));
                    });
                });
                for &place in &places {
                    let last = particles[place as usize].to_array()[0] as usize - 1;
                    let holds = |domain: &&Domain| domain.particles.contains(&(place as usize));
                    let mut around = domains.iter().filter(holds);
                    let expected = if backwards { around.next() } else { around.next_back() };
                    assert_eq!(domains[last].particles, expected.unwrap().particles);
                }
            }
        }
    }
}
