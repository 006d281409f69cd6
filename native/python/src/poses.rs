//! Poses and positions of the per-frame path, in f32; float32 arrays are read without a conversion.

use glam::{Affine3A, Mat3A, Vec3, Vec3A};
use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::arrays::{floats, matrix};
use crate::errors::value_error;

/// Largest difference of a matrix's last row from (0, 0, 0, 1).
const AFFINE: f32 = 1e-4;

/// Matrices (B,4,4) of `name`.
pub(crate) fn transforms(argument: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<Affine3A>> {
    let read = |rows: &[[f32; 16]]| rows.iter().enumerate().map(|(bone, m)| affine(m, name, bone)).collect();
    if let Ok(array) = argument.extract::<PyReadonlyArray3<'_, f32>>()
        && array.as_array().shape()[1..] == [4, 4]
        && let Ok(flat) = array.as_slice()
    {
        return read(flat.as_chunks::<16>().0);
    }
    let array = floats(argument, name, &[None, Some(4), Some(4)])?;
    let rows: Vec<[f32; 16]> = array.as_slice()?.as_chunks::<16>().0.iter().map(|m| m.map(single)).collect();
    read(&rows)
}

fn affine(m: &[f32; 16], name: &str, bone: usize) -> PyResult<Affine3A> {
    let last = [m[12], m[13], m[14], m[15] - 1.0];
    if last.iter().any(|x| x.abs() > AFFINE) {
        return Err(value_error(format!("the last row of {name}[{bone}] must be (0, 0, 0, 1)")));
    }
    let column = |j: usize| Vec3A::new(m[j], m[4 + j], m[8 + j]);
    let matrix3 = Mat3A::from_cols(column(0), column(1), column(2));
    Ok(Affine3A { matrix3, translation: column(3) })
}

/// Positions (n,3) of `name`.
pub(crate) fn positions(argument: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<Vec3>> {
    if let Ok(array) = argument.extract::<PyReadonlyArray2<'_, f32>>()
        && array.as_array().shape()[1] == 3
        && let Ok(flat) = array.as_slice()
    {
        return Ok(flat.as_chunks::<3>().0.iter().copied().map(Vec3::from_array).collect());
    }
    let array = floats(argument, name, &[None, Some(3)])?;
    Ok(array.as_slice()?.as_chunks::<3>().0.iter().map(|p| Vec3::from_array(p.map(single))).collect())
}

/// Numbers (n) of `name`.
pub(crate) fn numbers(argument: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<f32>> {
    if let Ok(array) = argument.extract::<PyReadonlyArray1<'_, f32>>()
        && let Ok(flat) = array.as_slice()
    {
        return Ok(flat.to_vec());
    }
    Ok(floats(argument, name, &[None])?.as_slice()?.iter().copied().map(single).collect())
}

fn single(x: f64) -> f32 {
    x as f32
}

/// Positions as an array (n,3).
pub(crate) fn positions_array<'py>(
    py: Python<'py>,
    positions: Vec<Vec3>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let count = positions.len();
    // Owned, so that the same memory holds the rows.
    let rows: Vec<[f32; 3]> = positions.into_iter().map(|position| position.to_array()).collect();
    matrix(py, rows.into_flattened(), count, 3)
}
