//! Simulates captures with an instrument. The model includes a camera or a photon counter, relative noise,
//! and the rays of a lens.

use crate::analysis::slice;
use crate::capture::{Scheme, check_wavelengths};
use crate::error::{bail, input, located};
use crate::off_python::off_python;
use crate::scene::toml_of_json;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use sunstone::Ray;
use sunstone::polarimetry::capture::detector::file;
use sunstone::polarimetry::capture::mueller_image::MuellerImage;
use sunstone::polarimetry::capture::simulate::Noise;

/// Instrument that converts light to digital numbers.
#[derive(FromPyObject)]
pub struct Instrument {
    /// Path of a detector file. The alternative `detector_text` is the content of a detector file as JSON.
    detector_file: Option<PathBuf>,
    detector_text: Option<String>,
    /// Standard deviation of Gaussian noise. The alternative `relative_noise` is the standard deviation
    /// as a fraction of the mean T00.
    noise: Option<f64>,
    relative_noise: Option<f64>,
    /// Horizontal field of view, in degrees. None means that all rays are axial.
    fov_x_deg: Option<f64>,
    /// Width of the time bins in picoseconds. The time axis comes after the axes of rows and columns.
    bin_ps: Option<f64>,
    seed: u64,
}

/// An array of intensities or variances.
type Numbers<'py> = Bound<'py, PyArrayDyn<f32>>;

/// Simulate the capture of matrices (..., 4, 4). Return the intensities (measurements, pixels), their
/// variances (only for a camera), and the shape of the pixel axes. Binning and superpixels halve the numbers
/// of rows and columns. `lanes` states whether the last axis before the matrices is the wavelength.
#[pyfunction]
pub fn capture<'py>(
    py: Python<'py>,
    scheme: &Scheme,
    matrices: PyReadonlyArrayDyn<'py, f64>,
    wavelengths_nm: Vec<f64>,
    lanes: bool,
    with: Instrument,
) -> PyResult<(Numbers<'py>, Option<Numbers<'py>>, Vec<usize>)> {
    check_wavelengths(&wavelengths_nm)?;
    let [leading @ .., 4, 4] = matrices.shape() else {
        bail!("matrices: the shape of the matrices is {:?}; expected (..., 4, 4)", matrices.shape());
    };
    let values = slice("matrices", &matrices)?.to_vec();
    let listed = if lanes { &wavelengths_nm[..] } else { &[] };
    let mut image = MuellerImage::of_array(values, leading.to_vec(), listed).map_err(input)?;
    if !lanes {
        image.rays = wavelengths_nm.iter().copied().map(Ray::axial).collect();
    }
    if let Some(bin) = with.bin_ps {
        if leading.len() != 3 + usize::from(lanes) {
            bail!(
                "bin_ps: the shape of the matrices is {:?}; expected (rows, columns, bins, 4, 4), or (rows, columns, bins, \
                 wavelengths, 4, 4)",
                matrices.shape()
            );
        }
        if !(bin > 0.0 && bin.is_finite()) {
            bail!("bin_ps: expected a positive width of the time bins, in ps, got {bin}");
        }
        image.bin_ps = Some(bin);
    }
    if let Some(degrees) = with.fov_x_deg {
        if !(degrees > 0.0 && degrees < 180.0) {
            bail!("fov_x_deg: expected an angle above 0 and below 180 degrees, got {degrees}");
        }
        image = image.seen_by(degrees.to_radians());
    }
    let noise = noise(&image, &with)?;
    let captured = off_python(py, 0, || image.capture(&scheme.0, &noise, with.seed))?.map_err(input)?;
    let pixels = captured.layout.pixels();
    let array =
        |values: Vec<f32>| PyArray1::from_vec(py, values).reshape(vec![scheme.0.measurements(), pixels]);
    let variances = captured.variances.map(array).transpose()?;
    let shape = image.captured_shape(captured.layout);
    Ok((array(captured.intensities)?, variances, shape))
}

fn noise(image: &MuellerImage, with: &Instrument) -> PyResult<Noise> {
    let good = |name: &str, sigma: f64| {
        if sigma == 0.0 || (1e-30..=1e30).contains(&sigma) {
            Ok(sigma)
        } else {
            Err(input(format!("{name}: expected 0 or a number from 1e-30 to 1e30, got {sigma}")))
        }
    };
    let detector = match (&with.detector_file, &with.detector_text) {
        (Some(path), _) => Some(file::load(path, image.is_timed())),
        (_, Some(json)) => {
            Some(file::from_toml(Path::new("detector in a dict"), &toml_of_json(json)?, image.is_timed()))
        }
        _ => None,
    };
    match (detector, with.noise, with.relative_noise) {
        (Some(detector), None, None) => {
            image.noise_of(detector.map_err(located)?).map_err(|e| input(format!("detector: {e}")))
        }
        (None, Some(sigma), None) => Ok(Noise::Gaussian { sigma: good("noise", sigma)? }),
        (None, None, Some(relative)) => {
            let sigma = good("relative_noise", relative)? * image.mean();
            if sigma >= 0.0 && sigma.is_finite() {
                Ok(Noise::Gaussian { sigma })
            } else {
                Err(input(format!(
                    "relative_noise: the mean M00 of the matrices is {}; expected a positive number; pass `noise`, in the unit of the \
                     matrices, instead of `relative_noise`",
                    image.mean()
                )))
            }
        }
        (None, None, None) => Ok(Noise::None),
        _ => {
            bail!("got more than one of detector, noise and relative_noise; pass only one of these arguments")
        }
    }
}
