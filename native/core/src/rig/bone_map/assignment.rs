//! The assignment problem: which row takes which column so that the sum of costs is smallest
//! (Kuhn 1955, in the shortest path form of Jonker and Volgenant 1987).

/// Column of each row of a square cost matrix, row after row, with the smallest sum.
pub(super) fn assign(costs: &[f64], size: usize) -> Vec<usize> {
    let mut row_of = vec![usize::MAX; size + 1];
    let (mut row_price, mut column_price) = (vec![0.0; size], vec![0.0; size + 1]);
    for row in 0..size {
        // Column `size` stands for the row that still looks for its place.
        row_of[size] = row;
        let mut shortest = vec![f64::INFINITY; size];
        let mut came_from = vec![size; size];
        let mut visited = vec![false; size + 1];
        let mut at = size;
        while row_of[at] != usize::MAX {
            visited[at] = true;
            let (current, mut next, mut step) = (row_of[at], size, f64::INFINITY);
            for column in (0..size).filter(|&column| !visited[column]) {
                let reduced = costs[current * size + column] - row_price[current] - column_price[column];
                if reduced < shortest[column] {
                    (shortest[column], came_from[column]) = (reduced, at);
                }
                if shortest[column] < step {
                    (step, next) = (shortest[column], column);
                }
            }
            for column in 0..=size {
                if visited[column] {
                    row_price[row_of[column]] += step;
                    column_price[column] -= step;
                } else if column < size {
                    shortest[column] -= step;
                }
            }
            at = next;
        }
        while at != size {
            let before = came_from[at];
            row_of[at] = row_of[before];
            at = before;
        }
    }
    let mut column_of = vec![0; size];
    for (column, &row) in row_of[..size].iter().enumerate() {
        column_of[row] = column;
    }
    column_of
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn best_by_trying(costs: &[f64], size: usize, row: usize, used: &mut Vec<bool>) -> f64 {
        if row == size {
            return 0.0;
        }
        let mut best = f64::INFINITY;
        for column in 0..size {
            if !used[column] {
                used[column] = true;
                best = best.min(costs[row * size + column] + best_by_trying(costs, size, row + 1, used));
                used[column] = false;
            }
        }
        best
    }

    proptest! {
        #[test]
        fn finds_the_smallest_sum(size in 1usize..6, values in prop::collection::vec(0.0f64..9.0, 36)) {
            let costs = &values[..size * size];
            let found = assign(costs, size);
            let mut used = vec![false; size];
            for &column in &found {
                prop_assert!(!used[column]);
                used[column] = true;
            }
            let sum: f64 = found.iter().enumerate().map(|(row, &column)| costs[row * size + column]).sum();
            let best = best_by_trying(costs, size, 0, &mut vec![false; size]);
            prop_assert!((sum - best).abs() < 1e-9);
        }
    }
}
