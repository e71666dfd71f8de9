//! Known Mueller matrices as a rig sees them: pixels in rows and columns, with the ray of each wavelength.
//!
//! An array of matrices, or a slice of a stored tensor, has axes in some order; [`simulate`] wants rows, columns, whatever is
//! a capture of its own, and wavelengths. A [`MuellerImage`] is the matrices with what leads from the one to the other.

use super::detector::error::DetectorError;
use super::detector::file::{Detector, with_bins};
use super::detector::polarizer_array::Method;
use super::directions::Directions;
use super::element::Ray;
use super::scheme::Scheme;
use super::simulate::{Captured, Layout, Noise, simulate};
use tensor::axes::{Axis, AxisKind};

/// The wavelength of matrices that come without one, nanometres.
pub const DEFAULT_NM: f64 = 550.0;

/// Why matrices are no image, or an instrument cannot look at them.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ImageError {
    /// A wavelength is not positive and finite.
    #[error("invalid wavelength {0}; expected nanometres, such as 450,550,660")]
    Wavelength(f64),
    /// The last axis is not that of the wavelengths.
    #[error("expected {wavelengths} wavelengths on the last axis before the matrices, got shape {shape:?}")]
    Wavelengths {
        /// Lengths of the axes before the two of Stokes elements.
        shape: Vec<usize>,
        /// Number of wavelengths.
        wavelengths: usize,
    },
    /// Light that is kept in parts, which no sensor sees apart.
    #[error(
        "the slice has an axis {0}, which sensors cannot resolve; select an entry with -k {0}=0, or use a slice summed over it"
    )]
    Parts(&'static str),
    /// An axis without entries.
    #[error("there are no matrices; keep at least one entry of each axis")]
    Empty,
    /// The elements do not fill the shape.
    #[error("{found} elements do not fill matrices of shape {shape:?} with 16 elements each")]
    Elements {
        /// Lengths of the axes before the two of Stokes elements.
        shape: Vec<usize>,
        /// Number of elements.
        found: usize,
    },
    /// Binning and superpixels take two rows and two columns.
    #[error(
        "an image of {height} x {width} is too small for binning or demosaicking; remove `binning` and `demosaic`"
    )]
    TooSmall {
        /// Rows.
        height: usize,
        /// Columns.
        width: usize,
    },
    /// A diode counts photons in time bins, and there are none.
    #[error(
        "a [spad] counts photons in time bins; use a slice with time bins and without projector axes, or use [cmos]"
    )]
    NoTimeBins,
    /// The counter's bins are not those of the image.
    #[error("{cause}; the slice has {bins} bins of {bin_ps} ps")]
    TimeBins {
        /// What does not agree.
        cause: DetectorError,
        /// Time bins of the image.
        bins: usize,
        /// Their width, ps.
        bin_ps: f64,
    },
}

/// Mueller matrices, their order, and the rays that they are seen along.
#[derive(Clone, Debug, PartialEq)]
pub struct MuellerImage {
    /// 16 elements a pixel, row-major (Stokes out first), pixels in the order of `layout`.
    pub matrices: Vec<f64>,
    /// Rows, columns, captures besides and wavelengths.
    pub layout: Layout,
    /// The ray of each wavelength, or of each place and wavelength ([`Self::seen_by`]): those of `view`.
    pub rays: Vec<Ray>,
    /// Where pixels look.
    pub view: Directions,
    /// Width of the time bins, ps, where there is nothing but these besides rows, columns and wavelengths.
    pub bin_ps: Option<f64>,
    /// Lengths of the pixels' axes, and which of them are rows and columns.
    shape: Vec<usize>,
    y: Option<usize>,
    x: Option<usize>,
}

/// What is known of the axes of some matrices.
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
    /// An array of matrices of shape (..., 4, 4), of which `shape` is what stands before the two last: rows, columns,
    /// whatever is a capture of its own, and, with `wavelengths_nm`, the wavelengths. Without these there is no such axis
    /// and all light has [`DEFAULT_NM`].
    ///
    /// # Errors
    /// [`ImageError`]: a wavelength that is none, lengths that do not agree, no matrices.
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
        let frame = Frame {
            shape,
            has_lanes,
            y,
            x,
            bin_ps: None,
        };
        Self::new(matrices, frame, nm)
    }

    /// Matrices over the axes of a tensor's slice, wavelengths last if there is such an axis; `wavelengths_nm` are those of
    /// that axis, or the one at which the slice was taken, and `bin_ps` is the width of its time bins.
    ///
    /// # Errors
    /// As [`Self::of_array`], and [`ImageError::Parts`] if light is kept in parts by bounces, component or label.
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
        let frame = Frame {
            shape,
            has_lanes,
            y,
            x,
            bin_ps: bin_ps.filter(|_| !axes.iter().any(by_projector)),
        };
        Self::new(matrices, frame, wavelengths_nm)
    }

    fn new(matrices: Vec<f64>, frame: Frame, nm: Vec<f64>) -> Result<Self, ImageError> {
        let Frame {
            shape,
            has_lanes,
            y,
            x,
            bin_ps,
        } = frame;
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

    /// The shape of the pixels of what was captured with a layout: binning and superpixels halve rows and columns.
    #[must_use]
    pub fn captured_shape(&self, captured: Layout) -> Vec<usize> {
        let mut shape = self.shape.clone();
        for (axis, len) in [(self.y, captured.height), (self.x, captured.width)] {
            if let Some(i) = axis {
                shape[i] = len;
            }
        }
        shape
    }

    /// The same matrices seen along rays of a pinhole with this horizontal field of view, radians, instead of along the axis.
    #[must_use]
    pub fn seen_by(mut self, fov_x: f64) -> Self {
        self.view = Directions::pinhole(fov_x, self.layout.width, self.layout.height);
        self.rays = self.view.rays(self.layout, &self.wavelengths_nm());
        self
    }

    /// Wavelengths, one a lane.
    #[must_use]
    pub fn wavelengths_nm(&self) -> Vec<f64> {
        self.rays.iter().take(self.layout.lanes).map(|r| r.nm).collect()
    }

    /// Mean of T00 over all pixels where it is finite, in the unit of the matrices; NaN if it is nowhere.
    #[must_use]
    pub fn mean(&self) -> f64 {
        let lit = self.matrices.iter().step_by(16).filter(|v| v.is_finite());
        let (n, sum) = lit.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
        sum / n
    }

    /// What an instrument does to light of this image; a diode's counter gets the image's time bins.
    ///
    /// # Errors
    /// [`ImageError`] if the instrument cannot look at such an image.
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

    /// Whether it has time bins, so that a photon counter reads it.
    #[must_use]
    pub fn is_timed(&self) -> bool {
        self.bin_ps.is_some()
    }

    /// All captures of a scheme; see [`simulate`].
    ///
    /// # Errors
    /// Those of [`simulate`].
    pub fn capture(&self, scheme: &Scheme, noise: &Noise, seed: u64) -> Result<Captured, DetectorError> {
        simulate(&self.matrices, self.layout, scheme, &self.rays, noise, seed)
    }
}

fn check_lanes(shape: &[usize], has_lanes: bool, wavelengths: usize) -> Result<(), ImageError> {
    if has_lanes && shape.last() != Some(&wavelengths) {
        return Err(ImageError::Wavelengths {
            shape: shape.to_vec(),
            wavelengths,
        });
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
    fn arrays_have_rows_columns_and_what_else_there_is() {
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
        let halved = Layout {
            height: 1,
            width: 2,
            times: 7,
            lanes: 2,
        };
        let of = image(&[3, 5, 7, 2], &[450.0, 650.0]).expect("an image");
        assert_eq!(of.captured_shape(halved), [1, 2, 7, 2]);
        assert_eq!(of.mean(), 0.5);
    }

    #[test]
    fn slices_say_which_axes_they_have() {
        let axis = |kind, n: usize| Axis {
            kind,
            coords: (0..n).map(|i| i as f64).collect(),
            chunk: 1,
        };
        let of = |axes: &[Axis]| {
            let elements = 16 * axes.iter().map(|a| a.coords.len()).product::<usize>();
            MuellerImage::of_slice(vec![1.0; elements], axes, vec![550.0], Some(25.0))
        };
        let timed = of(&[axis(AxisKind::X, 4), axis(AxisKind::T, 3)]).expect("an image");
        assert_eq!(
            (timed.layout.width, timed.layout.times, timed.bin_ps),
            (4, 3, Some(25.0))
        );
        let projected = of(&[axis(AxisKind::Y, 2), axis(AxisKind::U, 3)]).expect("an image");
        assert_eq!((projected.layout.height, projected.bin_ps), (2, None));
        assert_eq!(
            of(&[axis(AxisKind::Bounces, 2)]),
            Err(ImageError::Parts("bounces"))
        );
        assert_eq!(of(&[axis(AxisKind::X, 0)]), Err(ImageError::Empty));
    }

    #[test]
    fn what_is_no_image_is_refused() {
        assert_eq!(image(&[2], &[-1.0]), Err(ImageError::Wavelength(-1.0)));
        assert!(matches!(
            image(&[2, 3], &[450.0, 650.0]),
            Err(ImageError::Wavelengths { wavelengths: 2, .. })
        ));
        assert!(matches!(
            image(&[], &[450.0, 650.0]),
            Err(ImageError::Wavelengths { .. })
        ));
        assert!(matches!(
            MuellerImage::of_array(vec![0.0; 17], vec![], &[]),
            Err(ImageError::Elements { found: 17, .. })
        ));
        let small = image(&[1, 8], &[]).expect("an image");
        let camera = |binning| Detector::Cmos {
            camera: Cmos {
                binning,
                ..Cmos::default()
            },
            demosaic: None,
        };
        assert!(small.noise_of(camera(1)).is_ok());
        assert!(matches!(
            small.noise_of(camera(2)),
            Err(ImageError::TooSmall { .. })
        ));
    }
}
