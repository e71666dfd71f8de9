//! Decodes image files to texels and encodes images to files. This module reads all images that scenes name.
//!
//! Formats: PNG, JPEG, GIF, BMP, TGA and PNM (integers, sRGB-encoded), OpenEXR, Radiance HDR and PFM
//! (floating point, linear).

mod openexr;
mod pfm;
mod pixels;
mod primaries;
mod radiance;
#[cfg(test)]
mod tests;

pub use pixels::{PictureError, Pixels};

use image::{DynamicImage, ImageError, ImageFormat};
use optics::spectrum::{Spectral, Wavelengths};
use std::io::Cursor;

/// Interpretation of the three channels of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Channels {
    /// Red, green and blue: sRGB-encoded if the file contains integers, linear if the file contains
    /// floating-point values.
    Colours,
    /// Linear red, green and blue.
    LinearColours,
    Numbers,
    /// The luminance of colours encoded like [`Self::Colours`], as one number per texel.
    Luminance,
    /// The luminance of linear colours, as one number per texel.
    LinearLuminance,
}

/// Returns a linear value. If `encoded` is set, decodes the value from sRGB (IEC 61966-2-1).
pub fn linear(value: f32, encoded: bool) -> f32 {
    if !encoded {
        value
    } else if value <= 0.04045 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}

/// Decodes an image file. The first bytes identify the format, except for TGA files, which `name`
/// identifies. `layer` selects a layer of an OpenEXR file.
///
/// # Errors
/// Returns [`PictureError`] if the format is not supported, the file is damaged, or the image channels are
/// ambiguous.
pub fn decode(name: &str, bytes: &[u8], layer: Option<&str>) -> Result<Pixels, PictureError> {
    if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        return openexr::decode(bytes, layer);
    }
    if let Some(layer) = layer {
        return Err(PictureError::new(
            format!("layer `{layer}` is selected, but the file is not an OpenEXR file"),
            "remove `layer`: only OpenEXR files have layers",
        ));
    }
    if bytes.starts_with(b"#?") {
        return radiance::decode(bytes);
    }
    if bytes.starts_with(b"PF\n")
        || bytes.starts_with(b"Pf\n")
        || bytes.starts_with(b"PF ")
        || bytes.starts_with(b"Pf ")
    {
        return pfm::decode(bytes);
    }
    whole_numbers(name, bytes)
}

fn whole_numbers(name: &str, bytes: &[u8]) -> Result<Pixels, PictureError> {
    const FORMATS: &str = "use a PNG, JPEG, OpenEXR, Radiance HDR, PFM, BMP, TGA, PNM or GIF file";
    let is_tga = || std::path::Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("tga"));
    let format = match image::guess_format(bytes) {
        Ok(format) => format,
        Err(_) if is_tga() => ImageFormat::Tga,
        Err(_) => {
            return Err(PictureError::new("unknown image format", FORMATS));
        }
    };
    if !format.reading_enabled() {
        return Err(PictureError::new(format!("{format:?} images are not supported"), FORMATS));
    }
    let name = format!("{format:?}").to_uppercase();
    let damaged = |e: ImageError| PictureError::damaged(&name, e);
    let mut notes = vec![];
    let image = image::load_from_memory_with_format(bytes, format).map_err(damaged)?;
    // As in Mitsuba, glTF and browsers, PNG colours are read as sRGB, because many programs write a wrong
    // gAMA chunk.
    if format == ImageFormat::Png
        && let Some(gamma) = png_gamma(bytes)
        && (gamma - 1.0 / 2.2).abs() > 0.02
    {
        notes.push(format!(
            "the gAMA chunk ({gamma}) is ignored and colours are read as sRGB; if they are linear, set `raw`"
        ));
    }
    let (width, height) = (image.width() as usize, image.height() as usize);
    let wide = image.color().bytes_per_pixel() > image.color().channel_count();
    let values = if wide {
        let all = image.into_rgb16();
        all.pixels().map(|p| p.0.map(|v| f32::from(v) / 65535.0)).collect()
    } else {
        let all = image.into_rgb8();
        all.pixels().map(|p| p.0.map(|v| f32::from(v) / 255.0)).collect()
    };
    Ok(Pixels { width, height, values, encoded: true, to_rgb: None, notes })
}

/// Returns the gamma exponent of a PNG file, unless the file also declares sRGB. The crate `png` 0.18 does
/// not return the exponent.
fn png_gamma(bytes: &[u8]) -> Option<f64> {
    let mut rest = bytes.get(8..)?;
    let mut gamma = None;
    loop {
        let (length, after) = rest.split_first_chunk()?;
        let (kind, data) = after.split_first_chunk::<4>()?;
        let length = u32::from_be_bytes(*length) as usize;
        match kind {
            b"gAMA" => gamma = Some(f64::from(u32::from_be_bytes(*data.first_chunk()?)) / 1e5),
            b"sRGB" => return None,
            b"IDAT" => return gamma,
            _ => {}
        }
        rest = data.get(length.checked_add(4)?..)?;
    }
}

/// Appends the texels of an image, top row first. For colours, each wavelength receives the red, green or
/// blue value. Numbers are unchanged.
pub fn texels(image: &Pixels, channels: Channels, wavelengths: &Wavelengths, out: &mut Vec<[f32; 4]>) {
    let encoded = image.encoded && !matches!(channels, Channels::LinearColours | Channels::LinearLuminance);
    out.extend(image.values.iter().map(|p| {
        if channels == Channels::Numbers {
            return [p[0], p[1], p[2], 0.0];
        }
        let rgb = image.to_rgb.map_or(*p, |m| primaries::times(&m, *p));
        if matches!(channels, Channels::Luminance | Channels::LinearLuminance) {
            let number = luminance(rgb.map(|v| linear(v, encoded)));
            return [number, number, number, 0.0];
        }
        texel(wavelengths, rgb.map(|v| linear(v, encoded)))
    }));
}

/// Returns the value of a colour per wavelength: red above 590 nm, green from 500 to 590 nm, and blue below
/// 500 nm.
pub fn texel(wavelengths: &Wavelengths, rgb: [f32; 3]) -> [f32; 4] {
    let channel = |nm: f64| match nm {
        nm if nm < 500.0 => 2,
        nm if nm < 590.0 => 1,
        _ => 0,
    };
    wavelengths.map(|nm| rgb[channel(nm)]).to_array()
}

/// Returns the luminance of a colour with sRGB primaries (Rec. ITU-R BT.709).
fn luminance([r, g, b]: [f32; 3]) -> f32 {
    // Return grey values exactly, without rounding errors of the weights.
    if r == g && g == b { r } else { 0.2126 * r + 0.7152 * g + 0.0722 * b }
}

/// Returns the brightness of every pixel as encoded in the file, top row first.
pub fn weights(image: &Pixels) -> Vec<f32> {
    let brightness = |p: &[f32; 3]| luminance(image.to_rgb.map_or(*p, |m| primaries::times(&m, *p)));
    image.values.iter().map(brightness).collect()
}

/// Multiplies texels by a factor per wavelength. Returns false if a result is outside the valid range of
/// radiances, 0..1e30.
pub fn scale(texels: &mut [[f32; 4]], by: Spectral) -> bool {
    let by = by.to_array();
    texels.iter_mut().all(|texel| {
        for (value, factor) in texel.iter_mut().zip(by) {
            *value *= factor;
        }
        texel.iter().all(|v| (0.0..=1e30).contains(v))
    })
}

/// Encodes an image as a file in the given format.
///
/// # Errors
/// Returns [`ImageError`] if the format does not support the image.
pub fn encoded(image: &DynamicImage, format: ImageFormat) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Cursor::new(vec![]);
    image.write_to(&mut bytes, format)?;
    Ok(bytes.into_inner())
}
