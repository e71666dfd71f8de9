//! Pictures of files → texels and weights, and what is drawn → files.

use image::{DynamicImage, ImageError, ImageFormat};
use optics::spectrum::{Spectral, Wavelengths};

/// What the three channels of an image mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Channels {
    /// Red, green and blue, sRGB-encoded where the file holds whole numbers, as they are where it holds real ones.
    Colours,
    /// Red, green and blue as they are.
    LinearColours,
    /// Numbers.
    Numbers,
}

/// A value of a picture, decoded from sRGB (IEC 61966-2-1) if it is `encoded`.
#[must_use]
pub fn linear(value: f32, encoded: bool) -> f32 {
    if !encoded {
        value
    } else if value <= 0.04045 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}

/// Appends the texels of a picture, top row first: colours as red, green or blue for each wavelength, numbers as they are.
pub fn texels(image: &DynamicImage, channels: Channels, wavelengths: &Wavelengths, out: &mut Vec<[f32; 4]>) {
    let channel = |nm: f64| match nm {
        nm if nm < 500.0 => 2,
        nm if nm < 590.0 => 1,
        _ => 0,
    };
    let encoded = !matches!(
        image,
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_)
    );
    out.extend(image.to_rgb32f().pixels().map(|p| {
        match channels {
            Channels::Numbers => [p.0[0], p.0[1], p.0[2], 0.0],
            _ => wavelengths
                .map(|nm| linear(p.0[channel(nm)], encoded && channels == Channels::Colours))
                .to_array(),
        }
    }));
}

/// Brightness of every pixel, as it is encoded, 0..1, top row first.
#[must_use]
pub fn weights(image: &DynamicImage) -> Vec<f32> {
    let luma = image.to_luma16();
    luma.pixels().map(|p| f32::from(p.0[0]) / 65535.0).collect()
}

/// Multiplies texels by a factor for each wavelength; false if one is no light (0..1e30) then.
#[must_use]
pub fn scale(texels: &mut [[f32; 4]], by: Spectral) -> bool {
    let by = by.to_array();
    texels.iter_mut().all(|texel| {
        for (value, factor) in texel.iter_mut().zip(by) {
            *value *= factor;
        }
        texel.iter().all(|v| (0.0..=1e30).contains(v))
    })
}

/// Rows of `width` texels of which the first and the last are at the poles → twice as many, less two, each in the middle of its share: a quarter
/// and three quarters of the way from one to the next.
#[must_use]
pub fn from_poles(width: usize, texels: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let rows: Vec<&[[f32; 4]]> = texels.chunks(width).collect();
    let mixed = |a: &[[f32; 4]], b: &[[f32; 4]], t: f32| -> Vec<[f32; 4]> {
        let pairs = a.iter().zip(b);
        let mix = |(a, b): (&[f32; 4], &[f32; 4])| std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t);
        pairs.map(mix).collect()
    };
    rows.windows(2)
        .flat_map(|w| [0.25, 0.75].map(|t| mixed(w[0], w[1], t)))
        .flatten()
        .collect()
}

/// A picture as a file.
///
/// # Errors
/// [`ImageError`] if the format cannot hold it.
pub fn encoded(image: &DynamicImage, format: ImageFormat) -> Result<Vec<u8>, ImageError> {
    let mut bytes = std::io::Cursor::new(vec![]);
    image.write_to(&mut bytes, format)?;
    Ok(bytes.into_inner())
}
