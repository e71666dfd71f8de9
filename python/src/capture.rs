//! Provides capture schemes, simulated captures and reconstruction to Python.

use crate::analysis::{Either, slice};
use crate::error::{bail, input, located};
use crate::learn::moment;
use crate::off_python::off_python;
use numpy::{
    Element, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray2, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyRuntimeWarning;
use pyo3::prelude::*;
use std::ffi::CString;
use std::path::PathBuf;
use sunstone::Ray;
use sunstone::polarimetry::capture::design_matrix::{DesignMatrix, a_optimal_bound};
use sunstone::polarimetry::capture::directions::Directions;
use sunstone::polarimetry::capture::scheme_file;
use sunstone::polarimetry::capture::simulate::{self as simulation, Layout, Noise};
use sunstone::polarimetry::reconstruct::along_rays::{self, Places};
use sunstone::polarimetry::reconstruct::pixels::{Options, PixelNumber};

/// Settings of the polarizing elements for each capture.
#[pyclass(frozen, module = "pysunstone._native")]
pub struct Scheme(pub sunstone::Scheme);

/// Maximum number of captures in a scheme. The command line has the same limit.
const MOST: usize = 100_000;

#[pymethods]
impl Scheme {
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        scheme_file::load(&path).map(Self).map_err(located)
    }

    #[staticmethod]
    fn from_toml(text: &str) -> PyResult<Self> {
        let path = PathBuf::from("scheme");
        scheme_file::from_toml(&path, text).map(Self).map_err(located)
    }

    /// Return a preset: drr, qrpr, lc, or quad (drr with all four elements variable, the initial scheme
    /// for learning).
    #[staticmethod]
    fn preset(name: &str, captures: usize, polarizer_array: bool) -> PyResult<Self> {
        if captures > MOST {
            bail!("captures: expected at most {MOST}, got {captures}");
        }
        let scheme = match name {
            "drr" => sunstone::Scheme::drr(captures, polarizer_array),
            "qrpr" => sunstone::Scheme::qrpr(captures, polarizer_array),
            "quad" => sunstone::Scheme::quad(captures, polarizer_array),
            "lc" => sunstone::Scheme::liquid_crystal(captures, polarizer_array),
            _ => bail!("unknown preset `{name}`; choose from drr, qrpr, lc, quad"),
        };
        scheme.map(Self).map_err(input)
    }

    fn to_toml(&self) -> PyResult<String> {
        scheme_file::to_toml(&self.0).map_err(input)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    #[getter]
    fn captures(&self) -> usize {
        self.0.captures()
    }

    #[getter]
    fn channels(&self) -> usize {
        self.0.sensor.channels()
    }

    /// Smallest number of captures for which the scheme's design matrix has rank 16.
    #[getter]
    fn least_captures(&self) -> usize {
        self.0.least_captures()
    }

    /// Lower bound of the error variance for the scheme's number of captures (A-optimality).
    #[getter]
    fn bound(&self) -> f64 {
        a_optimal_bound(&self.0)
    }

    /// Return rank, condition number and error variance (infinite below rank 16).
    fn quality(&self, wavelength_nm: f64) -> PyResult<(usize, f64, f64)> {
        let design = DesignMatrix::new(&self.0, &rays(&[wavelength_nm])?[0]);
        let variance = design.error_variance().unwrap_or(f64::INFINITY);
        Ok((design.rank(), design.condition(), variance))
    }

    /// Return the design matrix, of shape (captures × channels, 16).
    fn design_matrix<'py>(
        &self,
        py: Python<'py>,
        wavelength_nm: f64,
        incidence_deg: f64,
        azimuth_deg: f64,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        if !(0.0..90.0).contains(&incidence_deg) {
            bail!("incidence_deg: expected an angle from 0 to less than 90 degrees, got {incidence_deg}");
        }
        if !(-360.0..=360.0).contains(&azimuth_deg) {
            bail!("azimuth_deg: expected an angle from -360 to 360 degrees, got {azimuth_deg}");
        }
        let ray = Ray {
            incidence: incidence_deg.to_radians(),
            azimuth: azimuth_deg.to_radians(),
            ..rays(&[wavelength_nm])?[0]
        };
        let a = DesignMatrix::new(&self.0, &ray).a;
        let values: Vec<f64> = a.transpose().iter().copied().collect();
        PyArray1::from_vec(py, values).reshape(vec![a.nrows(), a.ncols()])
    }
}

/// Returns rays along the optical axis, one for each wavelength in nanometres.
pub fn rays(nm: &[f64]) -> PyResult<Vec<Ray>> {
    check_wavelengths(nm)?;
    Ok(nm.iter().copied().map(Ray::axial).collect())
}

/// Checks that there is at least one wavelength, and that all wavelengths are valid.
pub fn check_wavelengths(nm: &[f64]) -> PyResult<()> {
    if let Some(bad) = nm.iter().find(|nm| !(nm.is_finite() && **nm > 0.0)) {
        bail!("wavelengths_nm: expected positive numbers, in nm, got {bad}");
    }
    if nm.is_empty() {
        bail!("wavelengths_nm: expected at least one wavelength, got none");
    }
    Ok(())
}

/// Simulate intensities (measurements, pixels) of matrices (pixels, 16). The wavelengths repeat cyclically
/// from pixel to pixel.
#[pyfunction]
pub fn simulate<'py>(
    py: Python<'py>,
    scheme: &Scheme,
    matrices: PyReadonlyArrayDyn<'py, f64>,
    wavelengths_nm: Vec<f64>,
    noise: f64,
    seed: u64,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let rays = rays(&wavelengths_nm)?;
    let values = slice("matrices", &matrices)?;
    let pixels = values.len() / 16;
    if pixels % rays.len() != 0 {
        bail!(
            "matrices: the number of matrices, {pixels}, is not a multiple of the number of wavelengths, {}; pass an array whose last \
             axis before the matrices has one entry per wavelength",
            rays.len()
        );
    }
    let layout = Layout { height: 1, width: pixels / rays.len(), times: 1, lanes: rays.len() };
    let noise = Noise::Gaussian { sigma: noise };
    let captured =
        off_python(py, 0, || simulation::simulate(values, layout, &scheme.0, &rays, &noise, seed))?
            .map_err(input)?;
    PyArray1::from_vec(py, captured.intensities).reshape(vec![scheme.0.measurements(), pixels])
}

/// Reconstruct matrices (pixels, 16), and optionally standard errors, from intensities (measurements,
/// pixels).
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "Python names them")]
pub fn reconstruct<'py>(
    py: Python<'py>,
    scheme: &Scheme,
    intensities: Either<'py>,
    variances: Option<Either<'py>>,
    wavelengths_nm: Vec<f64>,
    noise: Option<f64>,
    saturation: Option<f64>,
    realizable: bool,
    with_errors: bool,
    prior: Option<PyReadonlyArray2<'py, f64>>,
    view: Option<(f64, usize, usize)>,
) -> PyResult<(Bound<'py, PyAny>, Option<Bound<'py, PyAny>>)> {
    if let Some(n) = noise.filter(|n| !(1e-18..=1e18).contains(n)) {
        bail!("noise: expected a number from 1e-18 to 1e18, in units of the intensities, got {n}");
    }
    if let Some(s) = saturation.filter(|s| !(*s > 0.0 && s.is_finite())) {
        bail!("saturation: expected a positive number, in units of the intensities, got {s}");
    }
    let prior = prior.as_ref().map(moment).transpose()?;
    if prior.is_some() && noise.is_none() {
        bail!(
            "prior: a prior requires the standard deviation of the intensities; pass the standard deviation with the argument `noise`"
        );
    }
    let options = Options { noise, saturation, realizable, prior };
    let lanes = wavelengths_nm.len();
    let rays = match view {
        None => rays(&wavelengths_nm)?,
        Some((degrees, height, width)) => {
            check_wavelengths(&wavelengths_nm)?;
            if !(degrees > 0.0 && degrees < 180.0) {
                bail!("fov_x_deg: expected an angle above 0 and below 180 degrees, got {degrees}");
            }
            let layout = Layout { height, width, times: 1, lanes };
            Directions::pinhole(degrees.to_radians(), width, height).rays(layout, &wavelengths_nm)
        }
    };
    let rays = Along { rays: &rays, lanes };
    match (intensities, variances) {
        (Either::Single(i), None) => solve(py, scheme, &i, None, rays, options, with_errors),
        (Either::Double(i), None) => solve(py, scheme, &i, None, rays, options, with_errors),
        (Either::Single(i), Some(Either::Single(v))) => {
            solve(py, scheme, &i, Some(&v), rays, options, with_errors)
        }
        (Either::Double(i), Some(Either::Double(v))) => {
            solve(py, scheme, &i, Some(&v), rays, options, with_errors)
        }
        (i, Some(v)) => bail!(
            "variance: the dtype of the variance is {}, but the dtype of the intensities is {}; pass both arrays with one dtype",
            v.dtype(),
            i.dtype()
        ),
    }
}

/// The rays of a reconstruction. There is one ray per wavelength, or one ray per pixel position and
/// wavelength.
#[derive(Clone, Copy)]
struct Along<'a> {
    rays: &'a [Ray],
    lanes: usize,
}

type Solved<'py> = (Bound<'py, PyAny>, Option<Bound<'py, PyAny>>);

fn solve<'py, T: PixelNumber + Element>(
    py: Python<'py>,
    scheme: &Scheme,
    intensities: &PyReadonlyArrayDyn<'py, T>,
    variances: Option<&PyReadonlyArrayDyn<'py, T>>,
    Along { rays, lanes }: Along<'_>,
    options: Options,
    with_errors: bool,
) -> PyResult<Solved<'py>> {
    let shape = intensities.shape();
    let [measurements, pixels] = *shape else {
        bail!("intensities: the shape of the intensities is {shape:?}; expected (measurements, pixels)");
    };
    if measurements != scheme.0.measurements() || pixels % rays.len().max(1) != 0 {
        bail!(
            "intensities: the shape of the intensities is {shape:?}, but the scheme has {} measurements, and there are {} \
             wavelengths; pass one row per measurement, and one column per pixel and wavelength",
            scheme.0.measurements(),
            lanes
        );
    }
    if let Some(other) = variances.map(|v| v.shape()).filter(|s| *s != shape) {
        bail!(
            "variance: the shape of the variance is {other:?}, but the shape of the intensities is {shape:?}; pass arrays of equal \
             shape"
        );
    }
    let read = slice("intensities", intensities)?;
    let variances = variances.map(|v| slice("variance", v)).transpose()?;
    let (found, errors, lost) = off_python(py, 0, || {
        let places =
            Places { rays, times: if rays.len() == lanes { 1 } else { pixels / rays.len().max(1) }, lanes };
        let mut found = vec![T::default(); pixels * 16];
        let mut errors = with_errors.then(|| vec![T::default(); pixels * 16]);
        let out = errors.as_deref_mut();
        let tally = along_rays::reconstruct(&scheme.0, places, &options, read, variances, &mut found, out)?;
        Ok((found, errors, tally.lost))
    })?
    .map_err(|e: sunstone::polarimetry::capture::design_matrix::RankError| input(e))?;
    if lost > 0 {
        let text = format!(
            "{lost} of {pixels} pixels are NaN, because saturated or missing measurements leave the matrices of these pixels \
             undetermined"
        );
        PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &CString::new(text)?, 1)?;
    }
    let array = |values: Vec<T>| Ok(PyArray1::from_vec(py, values).reshape(vec![pixels, 16])?.into_any());
    let errors: Option<PyResult<_>> = errors.map(array);
    Ok((array(found)?, errors.transpose()?))
}
