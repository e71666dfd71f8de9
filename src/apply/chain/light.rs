//! A slice as light that a rig looks at: Mueller matrices, pixel by pixel and wavelength by wavelength, and back.

use super::error::ChainError;
use crate::observation::Slice;
use polarimetry::capture::mueller_image::{DEFAULT_NM, MuellerImage};
use tensor::array::Tensor;
use tensor::axes::{Axis, AxisKind};

/// What a slice shows.
#[derive(Clone, Debug)]
pub struct Light {
    /// Its matrices. Intensities are matrices with T00 alone.
    pub image: MuellerImage,
    /// Whether it holds whole matrices.
    pub polarized: bool,
}

impl Light {
    /// Of a slice: rows, columns, what is a capture of its own, Stokes elements and wavelengths.
    ///
    /// # Errors
    /// [`ChainError::Axes`] and [`ChainError::Image`]: it is nothing that a camera sees.
    pub fn of(slice: &Slice) -> Result<Self, ChainError> {
        let t = &slice.mean;
        let wrong = |what| ChainError::Axes {
            slice: t.name.clone(),
            what,
        };
        let (out, inn) = (t.extent(AxisKind::StokesOut), t.extent(AxisKind::StokesIn));
        let polarized = match [out, inn] {
            [4, 4] => true,
            [1, 1] => false,
            _ => return Err(wrong("only some of the Stokes elements")),
        };
        if [AxisKind::Y, AxisKind::X].map(|k| t.find(k)) != [Some(0), Some(1)] {
            return Err(wrong("no leading row and column axes"));
        }
        let places: Vec<Axis> = t.axes.iter().filter(|a| !is_stokes(a.kind)).cloned().collect();
        let nm = t
            .find(AxisKind::Wavelength)
            .map_or_else(|| vec![DEFAULT_NM], |i| t.axes[i].coords.clone());
        let bin_ps = t.find(AxisKind::T).and_then(|i| match t.axes[i].coords[..] {
            [first, second, ..] => Some(second - first),
            _ => None,
        });
        let lanes = t.extent(AxisKind::Wavelength);
        let elements = out * inn;
        let mut matrices = vec![0.0; t.data.len() / elements.max(1) * 16];
        for (i, v) in t.data.iter().enumerate() {
            matrices[place(i, elements, lanes)] = f64::from(*v);
        }
        let image =
            MuellerImage::of_slice(matrices, &places, nm, bin_ps).map_err(|cause| ChainError::Image {
                slice: t.name.clone(),
                cause,
            })?;
        Ok(Self { image, polarized })
    }

    /// Matrices in the order of the image, as a tensor like the slice's.
    #[must_use]
    pub fn tensor(like: &Tensor, matrices: &[f32]) -> Tensor {
        let elements = like.extent(AxisKind::StokesOut) * like.extent(AxisKind::StokesIn);
        let lanes = like.extent(AxisKind::Wavelength);
        let mut out = like.clone();
        for (i, v) in out.data.iter_mut().enumerate() {
            *v = matrices[place(i, elements, lanes)];
        }
        out
    }
}

fn is_stokes(kind: AxisKind) -> bool {
    matches!(kind, AxisKind::StokesOut | AxisKind::StokesIn)
}

/// Where a value of a slice, whose last axes are Stokes elements and then wavelengths, stands among matrices.
fn place(i: usize, elements: usize, lanes: usize) -> usize {
    let (lane, rest) = (i % lanes, i / lanes);
    (rest / elements * lanes + lane) * 16 + rest % elements
}
