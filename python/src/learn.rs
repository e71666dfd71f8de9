//! Learns capture schemes.

use crate::capture::{Scheme, rays};
use crate::error::{bail, failed, input, located};
use crate::off_python::off_python;
use crate::watch::watched;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use std::path::PathBuf;
use sunstone::pbrdf::data_set;
use sunstone::pbrdf::stand_ins::{BandedError, BandedMaterials};
use sunstone::polarimetry::reconstruct::cross_validation::{self, Frames, learn_and_validate};
use sunstone::polarimetry::reconstruct::learn::Search;
use sunstone::polarimetry::reconstruct::loss::{Estimator, Objective};
use sunstone::polarimetry::reconstruct::pca::data_set::Settings;
use sunstone::polarimetry::reconstruct::second_moment::{self, Moment, SecondMoment};
use sunstone::transport::material::measured::axes::Axes;

/// Data for learning. The data are the second moment of all materials, and the second moments of the folds
/// for cross-validation.
#[pyclass(frozen, module = "pysunstone._native")]
pub struct LearningData(cross_validation::LearningData);

fn array<'py>(py: Python<'py>, s: &Moment) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    PyArray1::from_vec(py, s.transpose().iter().copied().collect()).reshape(vec![16, 16])
}

#[pymethods]
impl LearningData {
    /// Create the data from a folder of measured tables, or from the built-in substitutes for the KAIST data
    /// set.
    #[staticmethod]
    fn materials(
        py: Python<'_>,
        folder: Option<PathBuf>,
        bands: Vec<u16>,
        plane: bool,
        resolution: [usize; 3],
        folds: usize,
    ) -> PyResult<Self> {
        if !resolution.iter().all(|n| (2..=4096).contains(n)) {
            bail!("resolution: expected three numbers from 2 to 4096, got {resolution:?}");
        }
        if let Some(nm) = bands.iter().find(|nm| **nm < 100) {
            bail!("bands: expected wavelengths of at least 100 nm, got {nm} nm");
        }
        let settings = Settings { samples: 0, ..Settings::default() };
        let frames = if plane { Frames::Plane } else { Frames::Any };
        let data = off_python(py, 0, || match &folder {
            Some(folder) => {
                let nm: Vec<f64> = bands.iter().copied().map(f64::from).collect();
                Ok(data_set::read(folder, &nm, &settings))
            }
            None => BandedMaterials::load(None, &bands).map(|banded| {
                let axes = Axes::even(resolution, bands.clone());
                data_set::evaluate(&axes, &banded.analytic(), &settings)
            }),
        })?;
        let data = data.map_err(|e| match e {
            BandedError::File(e) => located(e),
            other => input(other),
        })?;
        let data = data.map_err(input)?;
        cross_validation::LearningData::new(&data, folds, frames).map(Self).map_err(input)
    }

    /// Create the data from a second moment, without folds. If `turn` is true, the moment is averaged
    /// over rotations of the Stokes frames.
    #[staticmethod]
    fn of_moment(given: PyReadonlyArray2<'_, f64>, turn: bool) -> PyResult<Self> {
        let s = moment(&given)?;
        Ok(Self(cross_validation::LearningData {
            all: if turn { second_moment::in_any_frames(&s) } else { s },
            folds: vec![],
        }))
    }

    /// Create the data from a file that contains a second moment.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let all = second_moment::load(&path).map_err(located)?;
        Ok(Self(cross_validation::LearningData { all, folds: vec![] }))
    }

    /// Write the second moment to a file.
    fn save(&self, path: PathBuf, name: &str) -> PyResult<()> {
        second_moment::save(&path, name, &self.0.all).map_err(|e| failed(format!("{}: {e}", path.display())))
    }

    /// Second moment of all materials, of shape (16, 16).
    #[getter]
    fn prior<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, &self.0.all)
    }
}

/// Settings of the learning.
#[derive(FromPyObject)]
pub struct Asked {
    prior: bool,
    noise: f64,
    angle_error_deg: f64,
    wavelengths_nm: Vec<f64>,
    starts: u32,
    iterations: u64,
    adam_steps: usize,
    seed: u64,
}

/// A learned scheme with its errors and descents. Errors are the loss on validation materials, the standard
/// error of this loss, and the loss on training materials. A descent, which is one run of the optimizer, has
/// a name, the lowest loss, and the loss at every evaluation.
type Found<'py> = (Scheme, (f64, f64, f64), Vec<(String, f64, Bound<'py, PyArray1<f64>>)>);

/// Learn the settings of a template that vary between captures.
#[pyfunction]
pub fn learn<'py>(
    py: Python<'py>,
    template: &Scheme,
    data: Option<&LearningData>,
    asked: Asked,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Found<'py>> {
    if template.0.motors().is_empty() {
        bail!(
            "template: no setting of the scheme changes between captures; list angles or retardances in the scheme"
        );
    }
    if !(1e-9..=1e6).contains(&asked.noise) {
        bail!("noise: expected a number from 1e-9 to 1e6, got {}", asked.noise);
    }
    if !(0.0..=90.0).contains(&asked.angle_error_deg) {
        bail!("angle_error_deg: expected a number from 0 to 90, in degrees, got {}", asked.angle_error_deg);
    }
    for (name, n, most) in [
        ("starts", u64::from(asked.starts), 100_000),
        ("iterations", asked.iterations, 10_000_000),
        ("adam_steps", asked.adam_steps as u64, 10_000_000),
    ] {
        if n > most {
            bail!("{name}: expected at most {most}, got {n}");
        }
    }
    let search = Search {
        starts: asked.starts,
        iterations: asked.iterations,
        adam_steps: asked.adam_steps,
        seed: asked.seed,
    };
    let objective = Objective {
        sigma: asked.noise,
        angle_error: asked.angle_error_deg.to_radians(),
        second_moment: SecondMoment::new(data.map_or_else(Moment::identity, |d| d.0.all)),
        estimator: if asked.prior { Estimator::Prior } else { Estimator::LeastSquares },
        rays: rays(&asked.wavelengths_nm)?,
        metric: None,
    };
    let folds = data.map_or(&[][..], |d| &d.0.folds);
    let found = watched(py, progress, |onlooker| {
        let pool = rayon::ThreadPoolBuilder::new().build();
        pool.map(|pool| {
            pool.install(|| learn_and_validate(&template.0, &objective, &search, folds, onlooker))
        })
    })?;
    let found = found.map_err(|e| failed(format!("cannot start threads: {e}; use fewer threads")))?;
    let descents = found.descents.into_iter();
    Ok((
        Scheme(found.scheme),
        (found.unseen, found.spread, found.seen),
        descents.map(|d| (d.name, d.loss, PyArray1::from_vec(py, d.history))).collect(),
    ))
}

/// Converts an array (16, 16) to a second moment.
pub fn moment(given: &PyReadonlyArray2<'_, f64>) -> PyResult<Moment> {
    let view = given.as_array();
    if view.shape() != [16, 16] {
        bail!(
            "prior: the shape of the second moment is {:?}; expected (16, 16), or the path of a file",
            view.shape()
        );
    }
    let s = Moment::from_fn(|i, j| view[(i, j)]);
    match second_moment::fault(&s) {
        None => Ok(s),
        Some(fault) => bail!("prior: the second moment {fault}"),
    }
}
