//! Surface matching (eq. 20–22): a vertex is known by its distances to the landmarks, and matches
//! the vertices of the other surface whose distances are most alike.

use std::collections::BTreeMap;

use kdtree::KdTree;
use kdtree::distance::squared_euclidean;
use rayon::prelude::*;

use crate::rig::Region;

/// Distance vectors of V vertices, row after row, each divided by its largest entry (eq. 20, 21).
/// The division makes the vectors independent of the size of the character.
#[derive(Debug, Clone, PartialEq)]
pub struct Descriptors {
    values: Vec<f64>,
    dimension: usize,
}

impl Descriptors {
    /// Takes, for each landmark, its distances to all vertices.
    #[must_use]
    pub fn new(columns: &[Vec<f64>]) -> Self {
        let dimension = columns.len();
        let vertex_count = columns.first().map_or(0, Vec::len);
        let mut values = Vec::with_capacity(dimension * vertex_count);
        for vertex in 0..vertex_count {
            let largest = columns.iter().map(|column| column[vertex]).fold(0.0, f64::max);
            let scale = if largest > 0.0 { 1.0 / largest } else { 0.0 };
            values.extend(columns.iter().map(|column| column[vertex] * scale));
        }
        Self { values, dimension }
    }

    /// Number of vertices.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.values.len().checked_div(self.dimension).unwrap_or(0)
    }

    /// Distance vector of a vertex.
    #[must_use]
    pub fn row(&self, vertex: usize) -> &[f64] {
        &self.values[vertex * self.dimension..(vertex + 1) * self.dimension]
    }
}

/// A candidate and the value of the prediction function (eq. 22, all w_i = 1) for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Source vertex.
    pub vertex: u32,
    /// Norm of the difference of the two distance vectors; no unit.
    pub difference: f64,
}

/// Regions of the source's and of the target's vertices.
pub type Regions<'a> = (&'a [Option<Region>], &'a [Option<Region>]);

/// For each target vertex its `count` best source vertices, best first, the lower vertex first
/// where two are equal.
///
/// `candidate` marks the source vertices that may be chosen. With regions, the search stays in the
/// vertex's own region (figure 3) unless that region has no candidate.
#[must_use]
pub fn best_matches(
    source: &Descriptors,
    target: &Descriptors,
    candidate: &[bool],
    regions: Option<Regions<'_>>,
    count: usize,
) -> Vec<Vec<Match>> {
    let everywhere = Forest::new(source, (0..source.vertex_count()).filter(|&v| candidate[v]));
    let mut by_region = BTreeMap::new();
    if let Some((source_regions, _)) = regions {
        let mut members: BTreeMap<Region, Vec<usize>> = BTreeMap::new();
        for vertex in (0..source.vertex_count()).filter(|&v| candidate[v]) {
            if let Some(region) = source_regions[vertex] {
                members.entry(region).or_default().push(vertex);
            }
        }
        by_region =
            members.into_iter().map(|(region, m)| (region, Forest::new(source, m.into_iter()))).collect();
    }
    (0..target.vertex_count())
        .into_par_iter()
        .map(|vertex| {
            let region = regions.and_then(|(_, target_regions)| target_regions[vertex]);
            let forest = region.and_then(|r| by_region.get(&r)).unwrap_or(&everywhere);
            forest.nearest(target.row(vertex), count)
        })
        .collect()
}

/// Candidates in a k-d tree over their distance vectors.
struct Forest<'a> {
    tree: KdTree<f64, u32, &'a [f64]>,
}

impl<'a> Forest<'a> {
    fn new(descriptors: &'a Descriptors, vertices: impl Iterator<Item = usize>) -> Self {
        let mut tree = KdTree::new(descriptors.dimension);
        for vertex in vertices {
            // Rows are finite and of the tree's dimension, the only two reasons to be refused.
            let _ = tree.add(descriptors.row(vertex), vertex as u32);
        }
        Self { tree }
    }

    fn nearest(&self, query: &[f64], count: usize) -> Vec<Match> {
        // One more than asked shows whether the last place is shared by several candidates.
        let mut reach = count + 1;
        loop {
            let found = self.tree.nearest(query, reach, &squared_euclidean).unwrap_or_default();
            let complete = found.len() < reach || found[found.len() - 1].0 > found[count - 1].0;
            if !complete {
                reach *= 2;
                continue;
            }
            let mut found: Vec<(f64, u32)> =
                found.iter().map(|&(square, &vertex)| (square, vertex)).collect();
            found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            found.truncate(count);
            return found
                .into_iter()
                .map(|(square, vertex)| Match { vertex, difference: square.sqrt() })
                .collect();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn columns(rows: &[[f64; 3]]) -> Vec<Vec<f64>> {
        (0..3).map(|k| rows.iter().map(|row| row[k]).collect()).collect()
    }

    #[test]
    fn descriptors_do_not_depend_on_size() {
        let small = Descriptors::new(&columns(&[[1.0, 2.0, 4.0], [0.0, 0.0, 0.0]]));
        let large = Descriptors::new(&columns(&[[10.0, 20.0, 40.0], [0.0, 0.0, 0.0]]));
        assert_eq!(small, large);
        assert_eq!(small.row(0), [0.25, 0.5, 1.0]);
        assert_eq!(small.row(1), [0.0; 3]);
    }

    #[test]
    fn regions_limit_the_search_unless_they_are_empty() {
        let source = Descriptors::new(&columns(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]));
        let target = Descriptors::new(&columns(&[[1.0, 0.1, 0.0], [1.0, 0.1, 0.0]]));
        let (a, b) = (Some(Region::Bone(0)), Some(Region::Bone(1)));
        let found =
            best_matches(&source, &target, &[true; 2], Some((&[a, b], &[b, Some(Region::Joint(0))])), 1);
        assert_eq!((found[0][0].vertex, found[1][0].vertex), (1, 0));
    }

    #[test]
    fn many_equal_candidates_are_no_obstacle() {
        let source = Descriptors::new(&columns(&[[1.0, 0.5, 0.25]; 200]));
        let found = best_matches(&source, &source, &[true; 200], None, 5);
        let first: Vec<u32> = found[150].iter().map(|m| m.vertex).collect();
        assert_eq!(first, [0, 1, 2, 3, 4]);
    }

    proptest! {
        #[test]
        fn agrees_with_trying_every_candidate(
            // Few different values, so that ties are common.
            source in prop::collection::vec(prop::array::uniform3((1u8..4).prop_map(f64::from)), 1..40),
            target in prop::collection::vec(prop::array::uniform3((1u8..4).prop_map(f64::from)), 1..10),
            usable in prop::collection::vec(any::<bool>(), 40),
        ) {
            let (s, t) = (Descriptors::new(&columns(&source)), Descriptors::new(&columns(&target)));
            let found = best_matches(&s, &t, &usable, None, 5);
            for (vertex, matches) in found.iter().enumerate() {
                let mut all: Vec<(f64, u32)> = (0..source.len()).filter(|&v| usable[v]).map(|v| {
                    (squared_euclidean(s.row(v), t.row(vertex)), v as u32)
                }).collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                let expected: Vec<u32> = all.iter().take(5).map(|m| m.1).collect();
                prop_assert_eq!(matches.iter().map(|m| m.vertex).collect::<Vec<_>>(), expected);
            }
        }
    }
}
