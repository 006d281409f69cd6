//! numpy arrays to and from the core's types. Every check names the argument.

use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::intern;
use pyo3::prelude::*;

/// Float argument of any float or integer type as contiguous float64.
pub(crate) fn floats<'py>(
    argument: &Bound<'py, PyAny>,
    name: &str,
    shape: &[Option<usize>],
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let array = convert(argument, name, "fiu", "float64", "numbers")?;
    checked(array.extract()?, name, shape)
}

/// Integer argument of any integer type as contiguous int64.
pub(crate) fn integers<'py>(
    argument: &Bound<'py, PyAny>,
    name: &str,
    shape: &[Option<usize>],
) -> PyResult<PyReadonlyArrayDyn<'py, i64>> {
    let array = convert(argument, name, "iu", "int64", "integers")?;
    checked(array.extract()?, name, shape)
}

fn convert<'py>(
    argument: &Bound<'py, PyAny>,
    name: &str,
    kinds: &str,
    dtype: &str,
    wanted: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let numpy = argument.py().import(intern!(argument.py(), "numpy"))?;
    let array = numpy.call_method1("asarray", (argument,))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if !kinds.contains(&kind) {
        return Err(PyValueError::new_err(format!(
            "{name} must be an array of {wanted}, got dtype {}",
            array.getattr("dtype")?
        )));
    }
    numpy.call_method1("ascontiguousarray", (array, dtype))
}

fn checked<'py, T: numpy::Element>(
    array: PyReadonlyArrayDyn<'py, T>,
    name: &str,
    shape: &[Option<usize>],
) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    let found = array.shape();
    let fits =
        found.len() == shape.len() && found.iter().zip(shape).all(|(&n, want)| want.is_none_or(|w| w == n));
    if fits {
        return Ok(array);
    }
    let wanted: Vec<String> =
        shape.iter().map(|want| want.map_or_else(|| "n".to_owned(), |w| w.to_string())).collect();
    let found: Vec<String> = found.iter().map(ToString::to_string).collect();
    let tuple =
        |parts: Vec<String>| format!("({}{})", parts.join(", "), if parts.len() == 1 { "," } else { "" });
    Err(PyValueError::new_err(format!("{name} must have shape {}, got {}", tuple(wanted), tuple(found))))
}

/// Points (n,3).
pub(crate) fn points(argument: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<DVec3>> {
    let array = floats(argument, name, &[None, Some(3)])?;
    Ok(array.as_slice()?.as_chunks::<3>().0.iter().copied().map(DVec3::from_array).collect())
}

/// One-dimensional integers.
pub(crate) fn indices(argument: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<i64>> {
    Ok(integers(argument, name, &[None])?.as_slice()?.to_vec())
}

/// Points as an array (n,3).
pub(crate) fn points_array<'py>(py: Python<'py>, points: &[DVec3]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat: Vec<f64> = points.iter().flat_map(|p| p.to_array()).collect();
    matrix(py, flat, points.len(), 3)
}

/// Rows as an array (n,k).
pub(crate) fn matrix<T: numpy::Element>(
    py: Python<'_>,
    flat: Vec<T>,
    rows: usize,
    columns: usize,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    PyArray1::from_vec(py, flat).reshape([rows, columns])
}

/// A mask of booleans over all `count` elements. `name` is the argument's.
pub(crate) fn mask(
    argument: &Bound<'_, PyAny>,
    name: &str,
    expected: &str,
    count: usize,
) -> PyResult<Vec<bool>> {
    let mask = convert(argument, name, "b", "bool", expected)?;
    let mask: PyReadonlyArrayDyn<'_, bool> = checked(mask.extract()?, name, &[Some(count)])?;
    Ok(mask.as_slice()?.to_vec())
}

/// A choice among `count` elements, as a mask of booleans or as indices (n,), as a mask. `name` is the
/// argument's, `elements` what is chosen.
pub(crate) fn chosen(
    argument: &Bound<'_, PyAny>,
    name: &str,
    elements: &str,
    count: usize,
) -> PyResult<Vec<bool>> {
    let numpy = argument.py().import(intern!(argument.py(), "numpy"))?;
    let array = numpy.call_method1("asarray", (argument,))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if kind == "b" {
        return mask(&array, name, "booleans or indices", count);
    }
    let mut mask = vec![false; count];
    if array.len()? > 0 {
        for (at, index) in indices(&array, name)?.into_iter().enumerate() {
            let slot = usize::try_from(index).ok().and_then(|index| mask.get_mut(index));
            *slot.ok_or_else(|| {
                PyValueError::new_err(format!("{name}[{at}] is {index}, but there are {count} {elements}"))
            })? = true;
        }
    }
    Ok(mask)
}
