//! Encodes arrays as image files that scenes read.

use crate::error::{bail, input};
use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::io::Cursor;

/// Encode an array (h, w) or (h, w, 3) as PNG (8 bits) or OpenEXR (single precision).
#[pyfunction]
pub fn encode_image<'py>(py: Python<'py>, values: Values<'py>) -> PyResult<Bound<'py, PyBytes>> {
    use image::ImageFormat::{OpenExr, Png};
    let shape = match &values {
        Values::Bytes(a) => a.shape().to_vec(),
        Values::Single(a) => a.shape().to_vec(),
    };
    let (height, width, channels) = match *shape {
        [h, w] => (h, w, 1),
        [h, w, 3] => (h, w, 3),
        _ => bail!("the shape of an image is {shape:?}; expected (h, w) or (h, w, 3)"),
    };
    if height == 0 || width == 0 {
        bail!("an image of shape {shape:?} has no pixels; pass at least one row and one column");
    }
    let lost = || input(format!("an image of shape {shape:?} is too large; pass fewer rows or columns"));
    let size = |n: usize| u32::try_from(n).map_err(|_| lost());
    let (w, h) = (size(width)?, size(height)?);
    let (picture, format) = match values {
        Values::Bytes(a) => {
            let data: Vec<u8> = a.as_array().iter().copied().collect();
            let picture = if channels == 1 {
                image::GrayImage::from_raw(w, h, data).map(image::DynamicImage::from)
            } else {
                image::RgbImage::from_raw(w, h, data).map(image::DynamicImage::from)
            };
            (picture, Png)
        }
        Values::Single(a) => {
            let all = a.as_array();
            let data: Vec<f32> = if channels == 1 {
                all.iter().flat_map(|v| [*v; 3]).collect()
            } else {
                all.iter().copied().collect()
            };
            (image::Rgb32FImage::from_raw(w, h, data).map(image::DynamicImage::from), OpenExr)
        }
    };
    let mut bytes = Cursor::new(vec![]);
    picture.ok_or_else(lost)?.write_to(&mut bytes, format).map_err(input)?;
    Ok(PyBytes::new(py, bytes.get_ref()))
}

#[derive(FromPyObject)]
pub enum Values<'py> {
    /// 8-bit values 0 to 255, sRGB-encoded.
    Bytes(PyReadonlyArrayDyn<'py, u8>),
    /// Linear values in single precision.
    Single(PyReadonlyArrayDyn<'py, f32>),
}

/// Return the weights of wavelengths in red, green and blue, as in photographs that the command draws.
#[pyfunction]
pub fn rgb_weights(wavelengths_nm: Vec<f64>) -> [Vec<f32>; 3] {
    sunstone::figure::colour::rgb_weights(&wavelengths_nm)
}
