//! A regular grid over the projection plane of a joint, and what is done with values at its nodes.

/// A place on the grid: the node below it and where it is from there, in steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Located {
    pub node: usize,
    pub s: f32,
    pub t: f32,
}

/// The larger of two numbers, the first where the other is none. One instruction, where `f32::max` takes four.
#[inline(always)]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// The smaller of two numbers, the first where the other is none.
#[inline(always)]
pub(super) fn smaller(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

#[inline(always)]
pub(super) fn smoothstep(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The nodes. In this order, because vector registers load what lies next to the origin as well, and
/// integers read as floats are denormal and slow.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C)]
pub(super) struct Grid {
    pub origin: [f32; 2],
    pub step: f32,
    pub per_step: f32,
    /// Last node that a place may be at, which leaves one more for a kernel around it.
    pub last: [f32; 2],
    /// Nodes along each axis, at least 4.
    pub size: [usize; 2],
}

impl Grid {
    /// Where coordinates are on the grid: never in the outermost cells, but in those next to them.
    #[inline(always)]
    pub(super) fn locate(&self, coordinates: [f32; 2]) -> Located {
        let along = |axis: usize| {
            let t = (coordinates[axis] - self.origin[axis]) * self.per_step;
            let t = smaller(larger(1.0, t), self.last[axis]);
            // Through 32 bits, which takes a third of the instructions.
            let node = (t as i32 as usize).min(self.size[axis] - 3);
            (node, t - node as f32)
        };
        let ((i, s), (j, t)) = (along(0), along(1));
        Located { node: j * self.size[0] + i, s, t }
    }

    /// Bilinear interpolation of the nodes' values.
    #[inline]
    pub(super) fn at(&self, values: &[f32], Located { node, s, t }: Located) -> f32 {
        let (a, b) = (&values[node..node + 2], &values[node + self.size[0]..][..2]);
        let (a, b) = (a[0] + s * (a[1] - a[0]), b[0] + s * (b[1] - b[0]));
        a + t * (b - a)
    }
}

/// Continues heights over all nodes with a slope of 1, in two passes over the grid.
pub(super) fn spread(heights: &mut [f32], [row, lines]: [usize; 2], step: f32) {
    for j in 0..lines {
        let (before, line) = heights.split_at_mut(j * row);
        let line = &mut line[..row];
        if j > 0 {
            spread_across(line, &before[(j - 1) * row..], step);
        }
        let mut last = f32::NEG_INFINITY;
        for height in line {
            *height = larger(*height, last - step);
            last = *height;
        }
    }
    for j in (0..lines).rev() {
        let (line, after) = heights[j * row..].split_at_mut(row);
        if j + 1 < lines {
            spread_across(line, &after[..row], step);
        }
        let mut last = f32::NEG_INFINITY;
        for height in line.iter_mut().rev() {
            *height = larger(*height, last - step);
            last = *height;
        }
    }
}

/// Continues the heights of one line to the next.
fn spread_across(line: &mut [f32], other: &[f32], step: f32) {
    let diagonal = step * std::f32::consts::SQRT_2;
    let continued = |line: &mut [f32], other: &[f32], step: f32| {
        line.iter_mut().zip(other).for_each(|(height, other)| *height = larger(*height, other - step));
    };
    continued(line, other, step);
    continued(&mut line[1..], other, diagonal);
    continued(line, &other[1..], diagonal);
}

/// One round of binomial smoothing along both axes.
pub(super) fn blur(values: &mut [f32], buffer: &mut Vec<f32>, [row, lines]: [usize; 2]) {
    buffer.clear();
    for line in values.chunks(row) {
        buffer.extend((0..row).map(|i| {
            let (a, b) = (line[i.saturating_sub(1)], line[(i + 1).min(row - 1)]);
            0.25 * (a + b) + 0.5 * line[i]
        }));
    }
    for j in 0..lines {
        let (above, below) = (j.saturating_sub(1) * row, (j + 1).min(lines - 1) * row);
        for i in 0..row {
            values[j * row + i] = 0.25 * (buffer[above + i] + buffer[below + i]) + 0.5 * buffer[j * row + i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        Grid { origin: [-1.0, 2.0], step: 0.5, per_step: 2.0, last: [6.0, 4.0], size: [8, 6] }
    }

    #[test]
    fn linear_values_are_interpolated_exactly() {
        let grid = grid();
        let values: Vec<f32> = (0..48).map(|n| (n % 8) as f32 * 0.5 - 3.0 * (n / 8) as f32 * 0.5).collect();
        for [x, y] in [[-0.5, 2.5], [0.3, 3.1], [2.0, 4.0]] {
            let value = grid.at(&values, grid.locate([x, y]));
            assert!((value - (x + 1.0 - 3.0 * (y - 2.0))).abs() < 1e-5, "{x} {y} {value}");
        }
    }

    #[test]
    fn what_is_outside_is_at_the_last_cell_but_one() {
        let grid = grid();
        for far in [1e9, f32::INFINITY, -1e9, f32::NEG_INFINITY, f32::NAN] {
            let Located { node, s, t } = grid.locate([far, far]);
            assert!((1..=5).contains(&(node % 8)) && (1..=3).contains(&(node / 8)));
            assert!((0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t));
        }
    }

    #[test]
    fn heights_spread_with_a_slope_of_one() {
        let mut heights = vec![f32::NEG_INFINITY; 49];
        heights[24] = 1.0;
        spread(&mut heights, [7, 7], 0.5);
        assert!((heights[27] + 0.5).abs() < 1e-6 && (heights[3] + 0.5).abs() < 1e-6);
        assert!((heights[0] - (1.0 - 1.5 * std::f32::consts::SQRT_2)).abs() < 1e-5);
    }
}
