//! Converts between slices and the light that a rig captures. The light is an image of Mueller matrices by
//! pixel and wavelength.

use super::error::ChainError;
use crate::observation::Slice;
use polarimetry::capture::mueller_image::{DEFAULT_NM, MuellerImage};
use tensor::array::Tensor;
use tensor::axes::{Axis, AxisKind};

#[derive(Clone, Debug)]
pub struct Light {
    /// The matrices. Intensities are matrices in which all elements except T00 are zero.
    pub image: MuellerImage,
    /// Whether the slice contains complete matrices.
    pub polarized: bool,
}

impl Light {
    /// Converts a slice to light. The axes of the slice are rows, columns, separately captured axes, Stokes
    /// elements and wavelengths.
    ///
    /// # Errors
    /// [`ChainError::Axes`] or [`ChainError::Image`] if the slice is not an image.
    pub fn of(slice: &Slice) -> Result<Self, ChainError> {
        let t = &slice.mean;
        let wrong = |what| ChainError::Axes { slice: t.name.clone(), what };
        let (out, inn) = (t.extent(AxisKind::StokesOut), t.extent(AxisKind::StokesIn));
        let polarized = match [out, inn] {
            [4, 4] => true,
            [1, 1] => false,
            _ => return Err(wrong("the slice has only some of the Stokes elements")),
        };
        if [AxisKind::Y, AxisKind::X].map(|k| t.find(k)) != [Some(0), Some(1)] {
            return Err(wrong("the first two axes are not `y` and `x`"));
        }
        let places: Vec<Axis> = t.axes.iter().filter(|a| !is_stokes(a.kind)).cloned().collect();
        let nm = t.find(AxisKind::Wavelength).map_or_else(|| vec![DEFAULT_NM], |i| t.axes[i].coords.clone());
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
        let image = MuellerImage::of_slice(matrices, &places, nm, bin_ps)
            .map_err(|cause| ChainError::Image { slice: t.name.clone(), cause })?;
        Ok(Self { image, polarized })
    }

    /// Converts matrices in the pixel order of the image to a tensor with the axes of the tensor `like`.
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

/// Converts the index `i` of a value in a slice to the index of this value in the matrices. The last axes of
/// the slice are Stokes elements and wavelengths.
fn place(i: usize, elements: usize, lanes: usize) -> usize {
    let (lane, rest) = (i % lanes, i / lanes);
    (rest / elements * lanes + lane) * 16 + rest % elements
}
