//! Distances through the body: fast marching (Sethian 1996) over the voxels of the distance field.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use glam::IVec3;

use super::distance_field::DistanceField;
use super::voxel_grid::neighbours;

/// Ways between voxels: to all 26 neighbours and over bridges.
pub(super) struct Ways<'a> {
    pub(super) field: &'a DistanceField,
    bridges: HashMap<u32, Vec<u32>>,
    steps: Vec<IVec3>,
}

impl<'a> Ways<'a> {
    pub(super) fn new(field: &'a DistanceField) -> Self {
        let mut bridges: HashMap<u32, Vec<u32>> = HashMap::new();
        for &(a, b) in &field.bridges {
            bridges.entry(a).or_default().push(b);
            bridges.entry(b).or_default().push(a);
        }
        Self { field, bridges, steps: neighbours().collect() }
    }

    /// Neighbours of a voxel, those over bridges last.
    pub(super) fn neighbours(&self, id: u32) -> impl Iterator<Item = u32> + '_ {
        let place = self.field.voxels[id as usize];
        let near = self.steps.iter().filter_map(move |&step| self.field.id(place + step));
        near.chain(self.bridges.get(&id).into_iter().flatten().copied())
    }

    /// Distance of every voxel (N) from sources that start with a distance of their own; infinite
    /// where there is no way. `slowness` (N) stretches lengths; `None` is 1 everywhere.
    pub(super) fn distances(&self, sources: &[(u32, f64)], slowness: Option<&[f64]>) -> Vec<f64> {
        let count = self.field.voxels.len();
        // In voxels, so that what is equally far in one grid is so in any other of the same voxels.
        let slow = |id: u32| slowness.map_or(1.0, |s| s[id as usize]);
        let mut distances = vec![f64::INFINITY; count];
        let mut accepted = vec![false; count];
        // Distances are not negative, so their bits are in the order of their values.
        let mut heap = BinaryHeap::new();
        for &(id, distance) in sources {
            let distance = distance / self.field.cell;
            if distance < distances[id as usize] {
                distances[id as usize] = distance;
                heap.push(Reverse((distance.to_bits(), id)));
            }
        }
        while let Some(Reverse((_, id))) = heap.pop() {
            if std::mem::replace(&mut accepted[id as usize], true) {
                continue;
            }
            for next in self.neighbours(id) {
                if accepted[next as usize] {
                    continue;
                }
                let step = self.field.voxels[next as usize] - self.field.voxels[id as usize];
                let length = step.as_dvec3().length() * 0.5 * (slow(id) + slow(next));
                let mut distance = distances[id as usize] + length;
                if step.abs().element_sum() == 1 {
                    distance = distance.min(self.upwind(next, slow(next), &distances, &accepted));
                }
                if distance < distances[next as usize] {
                    distances[next as usize] = distance;
                    heap.push(Reverse((distance.to_bits(), next)));
                }
            }
        }
        distances.iter_mut().for_each(|distance| *distance *= self.field.cell);
        distances
    }

    /// Solution of the Eikonal equation at a voxel from its accepted neighbours along the axes.
    fn upwind(&self, id: u32, slow: f64, distances: &[f64], accepted: &[bool]) -> f64 {
        let place = self.field.voxels[id as usize];
        let mut lowest = [IVec3::X, IVec3::Y, IVec3::Z].map(|axis| {
            [axis, -axis]
                .into_iter()
                .filter_map(|step| self.field.id(place + step))
                .filter(|&n| accepted[n as usize])
                .map(|n| distances[n as usize])
                .fold(f64::INFINITY, f64::min)
        });
        lowest.sort_by(f64::total_cmp);
        let length = slow;
        let mut best = lowest[0] + length;
        for used in 2..=3 {
            if best <= lowest[used - 1] || !lowest[used - 1].is_finite() {
                break;
            }
            let sum: f64 = lowest[..used].iter().sum();
            let squares: f64 = lowest[..used].iter().map(|d| d * d).sum();
            let n = used as f64;
            let root = sum * sum - n * (squares - length * length);
            if root >= 0.0 {
                best = (sum + root.sqrt()) / n;
            }
        }
        best
    }

    /// Voxels from one voxel down to a source of a distance field.
    pub(super) fn path(&self, from: u32, distances: &[f64]) -> Vec<u32> {
        let mut path = vec![from];
        let mut id = from;
        loop {
            let here = self.field.voxels[id as usize];
            // Steepest descent: the fall per length, so that no direction is preferred.
            let fall = |next: u32| {
                let step = self.field.voxels[next as usize] - here;
                let length = step.as_dvec3().length().max(f64::MIN_POSITIVE);
                (distances[id as usize] - distances[next as usize]) / length
            };
            let best = self
                .neighbours(id)
                .filter(|&n| distances[n as usize] < distances[id as usize])
                .max_by(|&a, &b| fall(a).total_cmp(&fall(b)).then(b.cmp(&a)));
            let Some(next) = best else { return path };
            id = next;
            path.push(id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::test_bodies::{field, tubes};
    use glam::DVec3;

    #[test]
    fn ways_go_through_the_body_and_are_hardly_too_long() {
        let corner = DVec3::X * 2.0;
        let field = field(&tubes(&[(DVec3::ZERO, corner, 0.15), (corner, DVec3::new(2.0, 2.0, 0.0), 0.15)]));
        let ways = Ways::new(&field);
        let start = field.voxel_at(DVec3::ZERO).unwrap();
        let distances = ways.distances(&[(start, 0.0)], None);
        let at = |point: DVec3| distances[field.voxel_at(point).unwrap() as usize];
        assert!((at(corner) - 2.0).abs() < 0.05, "{}", at(corner));
        // Around the corner, cutting it; the straight way would be 2.83.
        let around = at(DVec3::new(2.0, 2.0, 0.0));
        assert!((3.6..4.05).contains(&around), "{around}");
        let diagonal = field.voxel_at(DVec3::new(1.0, 0.1, 0.0)).unwrap();
        assert!((distances[diagonal as usize] - 1.005).abs() < 0.03, "{}", distances[diagonal as usize]);
        let path = ways.path(field.voxel_at(corner).unwrap(), &distances);
        assert_eq!(path.last(), Some(&start));
        assert!(path.windows(2).all(|p| distances[p[1] as usize] < distances[p[0] as usize]));
    }
}
