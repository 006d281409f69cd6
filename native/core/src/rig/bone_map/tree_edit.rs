//! The cheapest way to turn one tree of bones into another by leaving bones out (constrained edit
//! distance between unordered trees, Zhang 1996): bones that are paired keep who is above whom, and
//! separate branches stay separate. Where sums are equal the lower index wins.

use super::assignment::assign;

/// Cost of leaving a bone out on either side.
pub(super) const LEFT_OUT: f64 = 0.35;

/// Cost of leaving out the last bone of a chain, which often only gives the one before it a tail.
const TIP_LEFT_OUT: f64 = 0.32;

/// A cost that no sum of others reaches.
pub(super) const NEVER: f64 = 1e6;

/// A forest of bones under one root that stands for none of them.
pub(super) struct Tree {
    children: Vec<Vec<usize>>,
    /// Children before parents, the added root last.
    order: Vec<usize>,
    left_out: Vec<f64>,
}

impl Tree {
    /// Takes a forest: parents and all bones with parents before children.
    pub(super) fn new(parents: &[Option<u32>], depth_order: &[u32]) -> Self {
        let root = parents.len();
        let mut children = vec![Vec::new(); root + 1];
        for (bone, parent) in parents.iter().enumerate() {
            children[parent.map_or(root, |p| p as usize)].push(bone);
        }
        let order = depth_order.iter().rev().map(|&bone| bone as usize).chain([root]).collect();
        let is_tip = |bone: usize| {
            let only = parents[bone].is_some_and(|parent| children[parent as usize].len() == 1);
            only && children[bone].is_empty()
        };
        let cost = |bone: usize| if bone < root && is_tip(bone) { TIP_LEFT_OUT } else { LEFT_OUT };
        let left_out = (0..=root).map(cost).collect();
        Self { children, order, left_out }
    }
}

/// Costs of all pairs of subtrees and of the forests below two bones.
struct Costs {
    columns: usize,
    trees: Vec<f64>,
    forests: Vec<f64>,
    /// Cost of leaving out all below a bone, and the bone too.
    without: [Vec<f64>; 2],
    below: [Vec<f64>; 2],
}

/// Pairs of bones and the cost of the whole; `pair_cost` of two bones is at most [`NEVER`].
pub(super) fn match_trees(
    from: &Tree,
    to: &Tree,
    pair_cost: &dyn Fn(usize, usize) -> f64,
) -> (Vec<(u32, u32)>, f64) {
    let left_out = |tree: &Tree| {
        let mut below = vec![0.0; tree.children.len()];
        for &bone in &tree.order {
            below[bone] = tree.children[bone].iter().map(|&child| below[child] + tree.left_out[child]).sum();
        }
        (below.iter().zip(&tree.left_out).map(|(below, own)| below + own).collect::<Vec<f64>>(), below)
    };
    let (from_without, from_below) = left_out(from);
    let (to_without, to_below) = left_out(to);
    let columns = to.children.len();
    let size = from.children.len() * columns;
    let mut costs = Costs {
        columns,
        trees: vec![0.0; size],
        forests: vec![0.0; size],
        without: [from_without, to_without],
        below: [from_below, to_below],
    };
    let roots = (from.children.len() - 1, columns - 1);
    let own_cost = |i: usize, j: usize| match (i == roots.0, j == roots.1) {
        (true, true) => 0.0,
        (false, false) => pair_cost(i, j),
        _ => NEVER,
    };
    for &i in &from.order {
        for &j in &to.order {
            costs.forests[i * columns + j] = costs.forest_choice(from, to, i, j).0;
            costs.trees[i * columns + j] = costs.tree_choice(from, to, i, j, own_cost(i, j)).0;
        }
    }
    let mut pairs = Vec::new();
    let mut open = vec![(true, roots.0, roots.1)];
    while let Some((is_tree, i, j)) = open.pop() {
        let choice = if is_tree {
            costs.tree_choice(from, to, i, j, own_cost(i, j)).1
        } else {
            costs.forest_choice(from, to, i, j).1
        };
        match choice {
            Choice::Pair => {
                if i != roots.0 {
                    pairs.push((i as u32, j as u32));
                }
                open.push((false, i, j));
            }
            Choice::Into(next_i, next_j) => open.push((is_tree, next_i, next_j)),
            Choice::Children(matched) => open.extend(matched.into_iter().map(|(a, b)| (true, a, b))),
        }
    }
    pairs.sort_unstable();
    (pairs, costs.trees[roots.0 * columns + roots.1])
}

enum Choice {
    /// The two bones are a pair; their forests are matched.
    Pair,
    /// All but these subtrees (or the forests below these bones) is left out.
    Into(usize, usize),
    /// Subtrees are matched with subtrees.
    Children(Vec<(usize, usize)>),
}

impl Costs {
    fn tree_choice(&self, from: &Tree, to: &Tree, i: usize, j: usize, own: f64) -> (f64, Choice) {
        let [from_without, to_without] = &self.without;
        let mut best = (self.forests[i * self.columns + j] + own, Choice::Pair);
        for &child in &to.children[j] {
            let cost = to_without[j] - to_without[child] + self.trees[i * self.columns + child];
            if cost < best.0 {
                best = (cost, Choice::Into(i, child));
            }
        }
        for &child in &from.children[i] {
            let cost = from_without[i] - from_without[child] + self.trees[child * self.columns + j];
            if cost < best.0 {
                best = (cost, Choice::Into(child, j));
            }
        }
        best
    }

    fn forest_choice(&self, from: &Tree, to: &Tree, i: usize, j: usize) -> (f64, Choice) {
        let [from_below, to_below] = &self.below;
        let mut best = self.children_choice(&from.children[i], &to.children[j]);
        for &child in &to.children[j] {
            let cost = to_below[j] - to_below[child] + self.forests[i * self.columns + child];
            if cost < best.0 {
                best = (cost, Choice::Into(i, child));
            }
        }
        for &child in &from.children[i] {
            let cost = from_below[i] - from_below[child] + self.forests[child * self.columns + j];
            if cost < best.0 {
                best = (cost, Choice::Into(child, j));
            }
        }
        best
    }

    fn children_choice(&self, rows: &[usize], columns: &[usize]) -> (f64, Choice) {
        let [from_without, to_without] = &self.without;
        let size = rows.len() + columns.len();
        let mut table = vec![0.0; size * size];
        for r in 0..size {
            for c in 0..size {
                table[r * size + c] = match (rows.get(r), columns.get(c)) {
                    (Some(&i), Some(&j)) => self.trees[i * self.columns + j],
                    (Some(&i), None) => from_without[i],
                    (None, Some(&j)) => to_without[j],
                    (None, None) => 0.0,
                };
            }
        }
        let assigned = assign(&table, size);
        let total = assigned.iter().enumerate().map(|(r, &c)| table[r * size + c]).sum();
        let matched = rows.iter().zip(&assigned).filter_map(|(&i, &c)| Some((i, *columns.get(c)?))).collect();
        (total, Choice::Children(matched))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(parents: &[i64]) -> Tree {
        let parents: Vec<Option<u32>> = parents.iter().map(|&p| u32::try_from(p).ok()).collect();
        Tree::new(&parents, &(0..parents.len() as u32).collect::<Vec<_>>())
    }

    #[test]
    fn leaves_out_what_the_other_lacks() {
        // A trunk with two branches; in the other tree the trunk has a joint more and a twig.
        let from = tree(&[-1, 0, 1, 1]);
        let to = tree(&[-1, 0, 1, 2, 2, 1]);
        let alike = [(0, 0), (1, 2), (2, 4), (3, 3)];
        let (pairs, cost) = match_trees(&from, &to, &|i, j| if alike.contains(&(i, j)) { 0.0 } else { 1.0 });
        assert_eq!(pairs, [(0, 0), (1, 2), (2, 4), (3, 3)]);
        assert!((cost - 2.0 * LEFT_OUT).abs() < 1e-12);
    }

    #[test]
    fn pairs_keep_ancestors_and_branches_apart() {
        // What lies on one chain here lies on two branches there: only one of the two can be paired.
        let (pairs, _) =
            match_trees(&tree(&[-1, 0, 1]), &tree(&[-1, 0, 0]), &|i, j| if i == j { 0.0 } else { NEVER });
        assert_eq!(pairs.len(), 2);
        assert_eq!(pairs[0], (0, 0));
    }

    #[test]
    fn nothing_against_something() {
        let (pairs, cost) = match_trees(&tree(&[]), &tree(&[-1, 0]), &|_, _| 0.0);
        assert!(pairs.is_empty());
        assert!((cost - LEFT_OUT - TIP_LEFT_OUT).abs() < 1e-12);
    }
}
