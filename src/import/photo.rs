//! Decodes photographs for measurements: stored values without a transfer curve, as the mean of the colour channels.

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::io::Cursor;

/// Maximum size, in bytes, of a decoded image.
const MOST_BYTES: u64 = 8 << 30;

/// A decoded photograph with its EXIF orientation applied.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    pub width: usize,
    pub height: usize,
    /// Mean of red, green and blue per pixel, top row first, in units of the stored integers.
    pub values: Vec<f32>,
    /// EXIF orientation of the stored image (1 to 8); 1 if no rotation is needed.
    pub orientation: u8,
}

impl Photo {
    /// Decodes a PNG of 8 or 16 bits or a JPEG. Opacity is dropped.
    ///
    /// # Errors
    /// A message if the file has another format, or is truncated or damaged.
    pub fn decode(bytes: &[u8], format: ImageFormat) -> Result<Self, String> {
        let name = match format {
            ImageFormat::Jpeg => "JPEG",
            _ => "PNG",
        };
        let other = image::guess_format(bytes).ok().filter(|found| *found != format);
        if let Some(other) = other {
            return Err(format!("the file contains {other:?} data, not {name}: change the extension"));
        }
        if format == ImageFormat::Jpeg && is_cut_off(bytes) {
            return Err("the JPEG file is truncated: copy the file again".into());
        }
        let bad = |e: image::ImageError| format!("cannot read the file as {name}: {e}");
        let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
        let mut limits = Limits::default();
        limits.max_alloc = Some(MOST_BYTES);
        reader.limits(limits);
        let mut decoder = reader.into_decoder().map_err(bad)?;
        let orientation = decoder.orientation().map_err(bad)?;
        let mut photo = DynamicImage::from_decoder(decoder).map_err(bad)?;
        photo.apply_orientation(orientation);
        let samples: Vec<f32> = match photo.color() {
            ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 => {
                photo.as_bytes().iter().map(|b| f32::from(*b)).collect()
            }
            ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
                photo.as_bytes().as_chunks().0.iter().map(|b| f32::from(u16::from_ne_bytes(*b))).collect()
            }
            other => {
                return Err(format!("unsupported pixel format {other:?}: convert the image to 8 or 16 bits"));
            }
        };
        let channels = usize::from(photo.color().channel_count());
        let colours = if channels < 3 { 1 } else { 3 };
        let mean = |p: &[f32]| p[..colours].iter().sum::<f32>() / colours as f32;
        Ok(Self {
            width: photo.width() as usize,
            height: photo.height() as usize,
            values: samples.chunks_exact(channels).map(mean).collect(),
            orientation: orientation.to_exif(),
        })
    }
}

/// Returns whether a JPEG ends within its last scan. The decoder would fill the missing part.
fn is_cut_off(jpeg: &[u8]) -> bool {
    let marker = |bytes: &[u8], kind: u8| bytes.windows(2).rposition(|w| w == [0xff, kind]);
    let (scan, end) = (marker(jpeg, 0xda), marker(jpeg, 0xd9));
    scan.is_some_and(|scan| end.is_none_or(|end| end < scan))
}
