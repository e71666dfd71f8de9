//! Decomposes arrays of Mueller matrices.

use crate::error::{bail, input};
use crate::off_python::off_python;
use numpy::{Element, PyArray1, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sunstone::polarimetry::decompose::maps::{Quantity, Real, WITH_ERRORS, errors, maps};

/// Return the names of all quantities that a decomposition computes.
#[pyfunction]
pub fn quantities() -> Vec<&'static str> {
    Quantity::ALL.into_iter().map(Quantity::name).collect()
}

/// An array in single or double precision.
#[derive(FromPyObject)]
pub enum Either<'py> {
    Single(PyReadonlyArrayDyn<'py, f32>),
    Double(PyReadonlyArrayDyn<'py, f64>),
}

impl Either<'_> {
    /// Returns NumPy's name of the dtype.
    pub fn dtype(&self) -> &'static str {
        match self {
            Self::Single(_) => "float32",
            Self::Double(_) => "float64",
        }
    }
}

/// Returns the values of a contiguous array. The Python package always passes contiguous arrays.
pub fn slice<'a, T: Element>(what: &str, a: &'a PyReadonlyArrayDyn<'_, T>) -> PyResult<&'a [T]> {
    a.as_slice().map_err(|_| {
        input(format!("{what}: the array is not C-contiguous; pass numpy.ascontiguousarray(array)"))
    })
}

/// Decompose C-contiguous matrices (..., 4, 4). Return arrays by name, and the number of matrices without
/// a decomposition.
#[pyfunction]
pub fn decompose<'py>(
    py: Python<'py>,
    matrices: Either<'py>,
    std_error: Option<Either<'py>>,
    only: Vec<String>,
) -> PyResult<(Bound<'py, PyDict>, usize)> {
    match (matrices, std_error) {
        (Either::Single(m), None) => all(py, &m, None, &only),
        (Either::Double(m), None) => all(py, &m, None, &only),
        (Either::Single(m), Some(Either::Single(e))) => all(py, &m, Some(&e), &only),
        (Either::Double(m), Some(Either::Double(e))) => all(py, &m, Some(&e), &only),
        (m, Some(e)) => bail!(
            "std_error: the dtype of std_error is {}, but the dtype of the matrices is {}; pass both arrays with one dtype",
            e.dtype(),
            m.dtype()
        ),
    }
}

fn all<'py, T: Real + Element>(
    py: Python<'py>,
    matrices: &PyReadonlyArrayDyn<'py, T>,
    sigmas: Option<&PyReadonlyArrayDyn<'py, T>>,
    only: &[String],
) -> PyResult<(Bound<'py, PyDict>, usize)> {
    let shape = matrices.shape();
    let [leading @ .., 4, 4] = shape else {
        bail!("matrices: the shape of the matrices is {shape:?}; expected (..., 4, 4)");
    };
    if let Some(other) = sigmas.map(|s| s.shape()).filter(|s| *s != shape) {
        bail!(
            "std_error: the shape of std_error is {other:?}, but the shape of the matrices is {shape:?}; pass arrays of equal shape"
        );
    }
    let mut wanted = vec![];
    for name in only {
        let found = Quantity::ALL.into_iter().find(|q| q.name() == name);
        wanted.push(found.ok_or_else(|| {
            input(format!("`only`: unknown quantity `{name}`; choose from {}", quantities().join(", ")))
        })?);
    }
    let elements = slice("matrices", matrices)?;
    let sigmas = sigmas.map(|s| slice("std_error", s)).transpose()?;
    if let Some(bad) = sigmas.and_then(|s| s.iter().map(|e| e.get()).find(|e| *e < 0.0)) {
        bail!("std_error: expected values of 0 or more, got {bad}");
    }
    let ((found, missing), spread) =
        off_python(py, 0, || (maps(elements, &wanted), sigmas.map(|s| errors(elements, s))))?;
    let out = PyDict::new(py);
    for (q, values) in wanted.iter().zip(found) {
        let tail = q.shape().iter().map(|n| *n as usize);
        let shape: Vec<usize> = leading.iter().copied().chain(tail).collect();
        out.set_item(q.name(), PyArray1::from_vec(py, values).reshape(shape)?)?;
    }
    for (q, values) in WITH_ERRORS.iter().zip(spread.into_iter().flatten()) {
        if wanted.contains(q) {
            let values = PyArray1::from_vec(py, values).reshape(leading.to_vec())?;
            out.set_item(format!("{}_error", q.name()), values)?;
        }
    }
    Ok((out, missing))
}
