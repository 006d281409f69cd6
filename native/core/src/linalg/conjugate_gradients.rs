//! Conjugate gradients (Hestenes and Stiefel 1952) for operators that exist as a product only.
//!
//! Not faer's (0.24.4): called through a thin wrapper, it did not pass the tests below. Sums run in order, whatever
//! the number of threads; the product may use all of them.

use super::error::LinalgError;
use super::sparse::check_length;

/// When the steps end.
#[derive(Debug, Clone, Copy)]
pub struct Ending {
    /// Norm of the residual, scaled by the diagonal, as a share of that of the right-hand side.
    pub residual: f64,
    /// Most steps.
    pub steps: usize,
}

/// Solves A x = b from x = 0 on, preconditioned by a positive `diagonal`.
///
/// `product` gives A of its argument, or `None` to stop; A is symmetric and positive semi-definite,
/// b (`right`) in its range. Where the steps end before the residual is small, x is as far as it came.
///
/// # Errors
/// [`LinalgError::DimensionMismatch`], [`LinalgError::Cancelled`] when `product` stops.
pub fn conjugate_gradients(
    product: impl Fn(&[f64]) -> Option<Vec<f64>>,
    diagonal: &[f64],
    right: &[f64],
    ending: Ending,
) -> Result<Vec<f64>, LinalgError> {
    check_length("diagonal", right.len(), diagonal.len())?;
    let scaled = |left: &[f64]| -> Vec<f64> { left.iter().zip(diagonal).map(|(r, d)| r / d).collect() };
    let mut x = vec![0.0; right.len()];
    let mut left = right.to_vec();
    let mut direction = scaled(&left);
    let mut size = dot(&left, &direction);
    let solved = ending.residual * ending.residual * size;
    for _ in 0..ending.steps {
        if size <= solved {
            break;
        }
        let changed = product(&direction).ok_or(LinalgError::Cancelled)?;
        check_length("product", right.len(), changed.len())?;
        let curvature = dot(&direction, &changed);
        if curvature <= 0.0 {
            break;
        }
        let step = size / curvature;
        x.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
        left.iter_mut().zip(&changed).for_each(|(r, c)| *r -= step * c);
        let next = scaled(&left);
        let before = std::mem::replace(&mut size, dot(&left, &next));
        let keep = size / before;
        direction.iter_mut().zip(next).for_each(|(d, z)| *d = z + keep * *d);
    }
    Ok(x)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A path of 40 vertices whose ends are tied to zero.
    fn path(x: &[f64]) -> Option<Vec<f64>> {
        let at = |i: usize| x.get(i).copied().unwrap_or(0.0);
        Some((0..x.len()).map(|i| 2.0 * x[i] - at(i + 1) - at(i.wrapping_sub(1))).collect())
    }

    #[test]
    fn the_product_of_the_solution_is_the_right_hand_side() {
        let right: Vec<f64> = (0..40).map(|i| f64::from(i % 7) - 2.0).collect();
        let ending = Ending { residual: 1e-12, steps: 100 };
        let found = conjugate_gradients(path, &[2.0; 40], &right, ending).unwrap();
        let back = path(&found).unwrap();
        assert!(back.iter().zip(&right).all(|(a, b)| (a - b).abs() < 1e-9));
        let early = conjugate_gradients(path, &[2.0; 40], &right, Ending { steps: 3, ..ending }).unwrap();
        assert!(early.iter().any(|x| *x != 0.0) && early != found);
    }

    #[test]
    fn a_projection_keeps_the_solution_in_its_range() {
        let within =
            |x: &[f64]| Some((0..x.len()).map(|i| if i % 3 == 0 { 0.0 } else { 4.0 * x[i] }).collect());
        let right: Vec<f64> = (0..9).map(|i| if i % 3 == 0 { 0.0 } else { 8.0 }).collect();
        let ending = Ending { residual: 1e-9, steps: 50 };
        let found = conjugate_gradients(within, &[1.0; 9], &right, ending).unwrap();
        assert!((0..9).all(|i| (found[i] - if i % 3 == 0 { 0.0 } else { 2.0 }).abs() < 1e-9));
        let nothing = conjugate_gradients(within, &[1.0; 9], &[0.0; 9], ending).unwrap();
        assert_eq!(nothing, [0.0; 9]);
    }

    #[test]
    fn a_product_that_stops_is_an_error() {
        let ending = Ending { residual: 1e-6, steps: 10 };
        assert_eq!(conjugate_gradients(|_| None, &[1.0], &[1.0], ending), Err(LinalgError::Cancelled));
    }

    #[test]
    fn lengths_must_agree() {
        let found = conjugate_gradients(path, &[1.0; 3], &[0.0; 4], Ending { residual: 1e-6, steps: 1 });
        assert_eq!(found, Err(LinalgError::DimensionMismatch { what: "diagonal", expected: 4, found: 3 }));
    }
}
