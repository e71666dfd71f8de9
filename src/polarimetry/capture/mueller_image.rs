//! Known Mueller matrices in the order that capture simulation needs. The order is row, column, separate
//! capture and wavelength.
//!
//! An array of matrices or a slice of a stored tensor can have its axes in any order. [`simulate`] expects
//! rows, columns, axes of separate captures, and wavelengths. A [`MuellerImage`] holds the reordered matrices
//! and the mapping between the two orders.

use super::detector::error::DetectorError;
use super::detector::file::{Detector, with_bins};
use super::detector::polarizer_array::Method;
use super::directions::Directions;
use super::element::Ray;
use super::scheme::Scheme;
use super::simulate::{Captured, Layout, Noise, simulate};
use tensor::axes::{Axis, AxisKind};

/// Wavelength in nanometres that is assumed for matrices without a wavelength.
pub const DEFAULT_NM: f64 = 550.0;

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ImageError {
    #[error("invalid wavelength {0}; expected positive numbers of nanometres, such as 450,550,660")]
    Wavelength(f64),
    /// The last axis does not match the wavelengths.
    #[error(
        "the array has shape {shape:?}, but expected {wavelengths} wavelengths on the last axis before the matrices"
    )]
    Wavelengths {
        /// Lengths of the axes before the two Stokes axes.
        shape: Vec<usize>,
        wavelengths: usize,
    },
    /// The slice has an axis that no sensor can resolve.
    #[error(
        "the slice has an axis {0}, which sensors cannot resolve; select an entry with -k {0}=0, or use a slice that is summed over this axis"
    )]
    Parts(&'static str),
    #[error("the selection contains no matrices; keep at least one entry of each axis")]
    Empty,
    /// The number of elements does not match the shape.
    #[error(
        "the array has {found} elements; expected 16 elements for each matrix of an array of shape {shape:?}"
    )]
    Elements {
        /// Lengths of the axes before the two Stokes axes.
        shape: Vec<usize>,
        found: usize,
    },
    /// Binning and superpixels need at least two rows and two columns.
    #[error(
        "an image of {height} x {width} pixels is too small for binning or demosaicking, which need at least 2 x 2 pixels; remove \
         `binning` and `demosaic`"
    )]
    TooSmall { height: usize, width: usize },
    /// A photon counter needs time bins, and the image has none.
    #[error(
        "a [spad] counts photons in time bins, but the image has no time bins or has projector axes; use a slice with time bins and \
         without projector axes, or use [cmos]"
    )]
    NoTimeBins,
    /// The time bins of the photon counter and the image differ.
    #[error("{cause}; the slice has {bins} bins of {bin_ps} ps")]
    TimeBins {
        cause: DetectorError,
        /// Number of time bins of the image.
        bins: usize,
        /// Width of the image's time bins in picoseconds.
        bin_ps: f64,
    },
}

/// An image of Mueller matrices. The image consists of the matrices, their layout, and the rays at which the
/// matrices are captured.
#[derive(Clone, Debug, PartialEq)]
pub struct MuellerImage {
    /// 16 elements per pixel, row-major (Stokes out first). The pixels are in the order of `layout`.
    pub matrices: Vec<f64>,
    /// Rows, columns, further captures and wavelengths.
    pub layout: Layout,
    /// The ray of each wavelength, or the ray of each pixel and wavelength ([`Self::seen_by`]). Rays are
    /// computed from `view`.
    pub rays: Vec<Ray>,
    pub view: Directions,
    /// Width of the time bins in picoseconds. The width is known if time is the only axis in addition to
    /// rows, columns and wavelengths.
    pub bin_ps: Option<f64>,
    /// Lengths of the pixels' axes. `y` and `x` are the indices of the axes of rows and columns.
    shape: Vec<usize>,
    y: Option<usize>,
    x: Option<usize>,
}

/// Properties of the axes of an array of matrices.
struct Frame {
    shape: Vec<usize>,
    has_lanes: bool,
    y: Option<usize>,
    x: Option<usize>,
    bin_ps: Option<f64>,
}

fn check_wavelengths(nm: &[f64]) -> Result<(), ImageError> {
    match nm.iter().find(|nm| !(**nm > 0.0 && nm.is_finite())) {
        Some(bad) => Err(ImageError::Wavelength(*bad)),
        None => Ok(()),
    }
}

impl MuellerImage {
    /// Builds an image from an array of shape (..., 4, 4). `shape` holds the leading axes: rows, columns and
    /// axes of separate captures. If `wavelengths_nm` is not empty, `shape` also contains the wavelengths. If
    /// `wavelengths_nm` is empty, all light has the wavelength [`DEFAULT_NM`].
    ///
    /// # Errors
    /// Returns [`ImageError`] if a wavelength is invalid, if lengths do not match `shape`, or if there are no
    /// matrices.
    pub fn of_array(
        matrices: Vec<f64>,
        shape: Vec<usize>,
        wavelengths_nm: &[f64],
    ) -> Result<Self, ImageError> {
        let nm = match wavelengths_nm {
            [] => vec![DEFAULT_NM],
            list => list.to_vec(),
        };
        check_wavelengths(&nm)?;
        let has_lanes = !wavelengths_nm.is_empty() && (nm.len() > 1 || shape.last() == Some(&1));
        let places = shape.len() - usize::from(has_lanes && !shape.is_empty());
        let (y, x) = match places {
            0 => (None, None),
            1 => (None, Some(0)),
            _ => (Some(0), Some(1)),
        };
        let frame = Frame { shape, has_lanes, y, x, bin_ps: None };
        Self::new(matrices, frame, nm)
    }

    /// Builds an image from the axes of a tensor slice. The wavelength axis, if any, is last.
    /// `wavelengths_nm` holds the wavelengths of this axis, or the single wavelength of the slice. `bin_ps`
    /// is the width of the slice's time bins in picoseconds.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::of_array`], and [`ImageError::Parts`] if the slice resolves
    /// bounces, components or labels.
    pub fn of_slice(
        matrices: Vec<f64>,
        axes: &[Axis],
        wavelengths_nm: Vec<f64>,
        bin_ps: Option<f64>,
    ) -> Result<Self, ImageError> {
        check_wavelengths(&wavelengths_nm)?;
        let shape: Vec<usize> = axes.iter().map(|axis| axis.coords.len()).collect();
        let has_lanes = axes.iter().any(|a| a.kind == AxisKind::Wavelength);
        check_lanes(&shape, has_lanes, wavelengths_nm.len())?;
        let (mut y, mut x) = (None, None);
        for (i, axis) in axes.iter().enumerate() {
            match axis.kind {
                AxisKind::Y => y = Some(i),
                AxisKind::X => x = Some(i),
                AxisKind::Bounces | AxisKind::Component | AxisKind::Label if axis.len() > 1 => {
                    return Err(ImageError::Parts(axis.kind.name()));
                }
                _ => {}
            }
        }
        let by_projector = |a: &Axis| matches!(a.kind, AxisKind::V | AxisKind::U) && a.len() != 1;
        let frame =
            Frame { shape, has_lanes, y, x, bin_ps: bin_ps.filter(|_| !axes.iter().any(by_projector)) };
        Self::new(matrices, frame, wavelengths_nm)
    }

    fn new(matrices: Vec<f64>, frame: Frame, nm: Vec<f64>) -> Result<Self, ImageError> {
        let Frame { shape, has_lanes, y, x, bin_ps } = frame;
        check_lanes(&shape, has_lanes, nm.len())?;
        let places = shape.len() - usize::from(has_lanes);
        let of = |axis: Option<usize>| axis.map_or(1, |i| shape[i]);
        let besides = (0..places).filter(|i| Some(*i) != y && Some(*i) != x);
        let layout = Layout {
            height: of(y),
            width: of(x),
            times: besides.map(|i| shape[i]).product(),
            lanes: nm.len(),
        };
        if layout.pixels() == 0 {
            return Err(ImageError::Empty);
        }
        if matrices.len() != layout.pixels().saturating_mul(16) {
            let found = matrices.len();
            return Err(ImageError::Elements { shape, found });
        }
        Ok(Self {
            matrices,
            layout,
            rays: nm.into_iter().map(Ray::axial).collect(),
            view: Directions::Axial,
            bin_ps,
            shape,
            y,
            x,
        })
    }

    /// Returns the lengths of the image's axes, with the rows and columns of the layout `captured`. Binning
    /// and superpixels halve rows and columns.
    pub fn captured_shape(&self, captured: Layout) -> Vec<usize> {
        let mut shape = self.shape.clone();
        for (axis, len) in [(self.y, captured.height), (self.x, captured.width)] {
            if let Some(i) = axis {
                shape[i] = len;
            }
        }
        shape
    }

    /// Returns the same matrices with rays through a pinhole. `fov_x` is the horizontal field of view in
    /// radians.
    pub fn seen_by(mut self, fov_x: f64) -> Self {
        self.view = Directions::pinhole(fov_x, self.layout.width, self.layout.height);
        self.rays = self.view.rays(self.layout, &self.wavelengths_nm());
        self
    }

    /// Returns the wavelengths of the image in nanometres.
    pub fn wavelengths_nm(&self) -> Vec<f64> {
        self.rays.iter().take(self.layout.lanes).map(|r| r.nm).collect()
    }

    /// Returns the mean of all finite T00 in the units of the matrices. The mean is NaN if no T00 is finite.
    pub fn mean(&self) -> f64 {
        let lit = self.matrices.iter().step_by(16).filter(|v| v.is_finite());
        let (n, sum) = lit.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
        sum / n
    }

    /// Returns the noise model of a detector for this image. A photon counter receives the image's time bins.
    ///
    /// # Errors
    /// Returns [`ImageError`] if the detector cannot capture this image.
    pub fn noise_of(&self, detector: Detector) -> Result<Noise, ImageError> {
        match detector {
            Detector::Cmos { camera, demosaic } => {
                let halves = camera.binning > 1 || demosaic == Some(Method::Superpixel);
                let (height, width) = (self.layout.height, self.layout.width);
                if (halves || demosaic.is_some()) && height.min(width) < 2 {
                    return Err(ImageError::TooSmall { height, width });
                }
                Ok(Noise::Cmos { camera, demosaic })
            }
            Detector::Spad(diode) => {
                let bin_ps = self.bin_ps.ok_or(ImageError::NoTimeBins)?;
                let bins = self.layout.times;
                let diode = with_bins(&diode, bins, bin_ps).map_err(|cause| ImageError::TimeBins {
                    cause,
                    bins,
                    bin_ps,
                })?;
                Ok(Noise::Spad(diode))
            }
        }
    }

    /// Returns whether the image has time bins, as a photon counter requires.
    pub fn is_timed(&self) -> bool {
        self.bin_ps.is_some()
    }

    /// Simulates all captures of a scheme as described for [`simulate`].
    ///
    /// # Errors
    /// Returns the same errors as [`simulate`].
    pub fn capture(&self, scheme: &Scheme, noise: &Noise, seed: u64) -> Result<Captured, DetectorError> {
        simulate(&self.matrices, self.layout, scheme, &self.rays, noise, seed)
    }
}

fn check_lanes(shape: &[usize], has_lanes: bool, wavelengths: usize) -> Result<(), ImageError> {
    if has_lanes && shape.last() != Some(&wavelengths) {
        return Err(ImageError::Wavelengths { shape: shape.to_vec(), wavelengths });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::detector::cmos::Cmos;

    fn image(shape: &[usize], wavelengths: &[f64]) -> Result<MuellerImage, ImageError> {
        let elements = 16 * shape.iter().product::<usize>();
        MuellerImage::of_array(vec![0.5; elements], shape.to_vec(), wavelengths)
    }

    #[test]
    fn array_layout_follows_the_shape() {
        let layout = |shape: &[usize], nm: &[f64]| {
            let l = image(shape, nm).expect("an image").layout;
            [l.height, l.width, l.times, l.lanes]
        };
        assert_eq!(layout(&[], &[]), [1, 1, 1, 1]);
        assert_eq!(layout(&[5], &[]), [1, 5, 1, 1]);
        assert_eq!(layout(&[3, 5], &[]), [3, 5, 1, 1]);
        assert_eq!(layout(&[3, 5, 7, 2], &[]), [3, 5, 14, 1]);
        assert_eq!(layout(&[3, 5, 7, 2], &[450.0, 650.0]), [3, 5, 7, 2]);
        assert_eq!(layout(&[3, 5], &[633.0]), [3, 5, 1, 1]);
        let halved = Layout { height: 1, width: 2, times: 7, lanes: 2 };
        let of = image(&[3, 5, 7, 2], &[450.0, 650.0]).expect("an image");
        assert_eq!(of.captured_shape(halved), [1, 2, 7, 2]);
        assert_eq!(of.mean(), 0.5);
    }

    #[test]
    fn slice_layout_follows_the_axes() {
        let axis = |kind, n: usize| Axis { kind, coords: (0..n).map(|i| i as f64).collect(), chunk: 1 };
        let of = |axes: &[Axis]| {
            let elements = 16 * axes.iter().map(|a| a.coords.len()).product::<usize>();
            MuellerImage::of_slice(vec![1.0; elements], axes, vec![550.0], Some(25.0))
        };
        let timed = of(&[axis(AxisKind::X, 4), axis(AxisKind::T, 3)]).expect("an image");
        assert_eq!((timed.layout.width, timed.layout.times, timed.bin_ps), (4, 3, Some(25.0)));
        let projected = of(&[axis(AxisKind::Y, 2), axis(AxisKind::U, 3)]).expect("an image");
        assert_eq!((projected.layout.height, projected.bin_ps), (2, None));
        assert_eq!(of(&[axis(AxisKind::Bounces, 2)]), Err(ImageError::Parts("bounces")));
        assert_eq!(of(&[axis(AxisKind::X, 0)]), Err(ImageError::Empty));
    }

    #[test]
    fn invalid_images_are_refused() {
        assert_eq!(image(&[2], &[-1.0]), Err(ImageError::Wavelength(-1.0)));
        assert!(matches!(
            image(&[2, 3], &[450.0, 650.0]),
            Err(ImageError::Wavelengths { wavelengths: 2, .. })
        ));
        assert!(matches!(image(&[], &[450.0, 650.0]), Err(ImageError::Wavelengths { .. })));
        assert!(matches!(
            MuellerImage::of_array(vec![0.0; 17], vec![], &[]),
            Err(ImageError::Elements { found: 17, .. })
        ));
        let small = image(&[1, 8], &[]).expect("an image");
        let camera = |binning| Detector::Cmos { camera: Cmos { binning, ..Cmos::default() }, demosaic: None };
        assert!(small.noise_of(camera(1)).is_ok());
        assert!(matches!(small.noise_of(camera(2)), Err(ImageError::TooSmall { .. })));
    }
}
