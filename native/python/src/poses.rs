//! Poses and positions of the per-frame path, in f32.

use glam::{Affine3A, Mat3A, Vec3, Vec3A};
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::arrays::{floats, matrix};
use crate::errors::value_error;

/// Largest difference of a matrix's last row from (0, 0, 0, 1).
const AFFINE: f64 = 1e-4;

/// Matrices (B,4,4) of `name`.
pub(crate) fn transforms(argument: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<Affine3A>> {
    let array = floats(argument, name, &[None, Some(4), Some(4)])?;
    let rows = array.as_slice()?.as_chunks::<16>().0;
    rows.iter().enumerate().map(|(bone, m)| affine(m, name, bone)).collect()
}

fn affine(m: &[f64; 16], name: &str, bone: usize) -> PyResult<Affine3A> {
    let last = [m[12], m[13], m[14], m[15] - 1.0];
    if last.iter().any(|x| x.abs() > AFFINE) {
        return Err(value_error(format!("the last row of {name}[{bone}] must be (0, 0, 0, 1)")));
    }
    let column = |j: usize| Vec3A::new(m[j] as f32, m[4 + j] as f32, m[8 + j] as f32);
    let matrix3 = Mat3A::from_cols(column(0), column(1), column(2));
    Ok(Affine3A { matrix3, translation: column(3) })
}

/// Positions (n,3) of `name`.
pub(crate) fn positions(argument: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<Vec3>> {
    let array = floats(argument, name, &[None, Some(3)])?;
    let rows = array.as_slice()?.as_chunks::<3>().0;
    Ok(rows.iter().map(|p| Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32)).collect())
}

/// Positions as an array (n,3).
pub(crate) fn positions_array<'py>(
    py: Python<'py>,
    positions: &[Vec3],
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let flat: Vec<f32> = positions.iter().flat_map(|p| p.to_array()).collect();
    matrix(py, flat, positions.len(), 3)
}
