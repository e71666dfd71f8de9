//! Second moments of Mueller matrices as priors.

use crate::error::bail;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use sunstone::polarimetry::reconstruct::second_moment::{self, Moment};

/// Converts an array (16, 16) to a second moment.
pub fn moment(given: &PyReadonlyArray2<'_, f64>) -> PyResult<Moment> {
    let view = given.as_array();
    if view.shape() != [16, 16] {
        bail!(
            "the shape of the second moment is {:?}; expected (16, 16), or the path of a file",
            view.shape()
        );
    }
    let s = Moment::from_fn(|i, j| view[(i, j)]);
    match second_moment::fault(&s) {
        None => Ok(s),
        Some(fault) => bail!("the second moment {fault}"),
    }
}
