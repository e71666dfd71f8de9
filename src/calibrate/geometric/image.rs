//! Grayscale images for corner detection, read from 8-bit or 16-bit PNG, JPEG or .npy files.

use image::codecs::jpeg::JpegDecoder;
use image::codecs::png::PngDecoder;
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, Limits};
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use store::numpy::NumpyReader;

/// A grayscale image, stored row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

/// An error while reading an image.
#[derive(Debug, thiserror::Error)]
#[error("{}: {message}", path.display())]
pub struct ImageError {
    pub path: PathBuf,
    pub message: String,
}

/// Maximum number of pixels of an image.
const MOST: usize = 1 << 30;

impl Image {
    /// Creates an image from its values row by row. Returns `None` unless there are width × height values.
    pub fn new(width: usize, height: usize, values: Vec<f32>) -> Option<Self> {
        (width.checked_mul(height) == Some(values.len())).then_some(Self { width, height, values })
    }

    pub fn size(&self) -> [u32; 2] {
        [self.width as u32, self.height as u32]
    }

    /// Returns the value of a pixel. Coordinates are clamped to the image.
    #[inline]
    pub fn at(&self, x: isize, y: isize) -> f32 {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        self.values[y * self.width + x]
    }

    /// Returns the bilinearly interpolated value at a position. The centre of the first pixel is at (0.5,
    /// 0.5).
    #[inline]
    pub fn between(&self, x: f64, y: f64) -> f32 {
        let (x, y) = (x - 0.5, y - 0.5);
        let (i, j) = (x.floor(), y.floor());
        let (a, b) = ((x - i) as f32, (y - j) as f32);
        let (i, j) = (i as isize, j as isize);
        let row = |j| self.at(i, j) * (1.0 - a) + self.at(i + 1, j) * a;
        row(j) * (1.0 - b) + row(j + 1) * b
    }

    /// Returns the image blurred with a Gaussian of standard deviation `sigma` in pixels.
    pub fn blurred(&self, sigma: f32) -> Self {
        let reach = (3.0 * sigma).ceil() as isize;
        let mut kernel: Vec<f32> =
            (-reach..=reach).map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp()).collect();
        let sum: f32 = kernel.iter().sum();
        kernel.iter_mut().for_each(|k| *k /= sum);
        let pass = |image: &Self, dx: isize, dy: isize| {
            let mut out = Vec::with_capacity(image.values.len());
            for y in 0..image.height as isize {
                for x in 0..image.width as isize {
                    let taps = kernel.iter().zip(-reach..=reach);
                    out.push(taps.map(|(k, i)| k * image.at(x + i * dx, y + i * dy)).sum());
                }
            }
            Self { values: out, ..*image }
        };
        pass(&pass(self, 1, 0), 0, 1)
    }

    /// Reads an 8-bit or 16-bit .png, a .jpg, or a .npy of shape (height, width) with at most one more axis.
    ///
    /// The value of a pixel is the mean of red, green and blue, or the mean over the third axis of a .npy
    /// array. PNG and JPEG images are rotated according to their EXIF orientation.
    ///
    /// # Errors
    /// Returns [`ImageError`] if the format is not supported, the file is damaged, or values are not finite.
    pub fn load(path: &Path) -> Result<Loaded, ImageError> {
        let error = |message: String| ImageError { path: path.to_owned(), message };
        let loaded = match extension(path).as_str() {
            "png" => photo(path, ImageFormat::Png),
            "jpg" | "jpeg" => photo(path, ImageFormat::Jpeg),
            "npy" => npy(path).map(|image| Loaded { image, orientation: 1 }),
            other => Err(format!(
                "expected a .png (8 or 16 bits), .jpg or .npy image, got the extension {other:?}: convert the file"
            )),
        };
        let loaded = loaded.map_err(error)?;
        let values = &loaded.image.values;
        if values.is_empty() {
            return Err(error("the image has no pixels: use an image with at least one pixel".into()));
        }
        if let Some(v) = values.iter().find(|v| !v.is_finite()) {
            return Err(error(format!("the pixel value {v} is not a finite number: correct the image")));
        }
        Ok(loaded)
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// The image with the EXIF orientation applied.
    pub image: Image,
    /// EXIF orientation of the stored image (1 to 8), or 1 if no rotation is needed.
    pub orientation: u8,
}

/// Returns whether [`Image::load`] reads files with this extension.
pub fn is_image(path: &Path) -> bool {
    ["png", "jpg", "jpeg", "npy"].contains(&extension(path).as_str())
}

fn extension(path: &Path) -> String {
    let extension = path.extension().and_then(|e| e.to_str());
    extension.unwrap_or("").to_ascii_lowercase()
}

/// Returns whether a JPEG file is truncated within its last scan. The decoder would fill the missing part of
/// the image without an error.
fn is_cut_off(jpeg: &[u8]) -> bool {
    let marker = |bytes: &[u8], kind: u8| bytes.windows(2).rposition(|w| w == [0xff, kind]);
    let (scan, end) = (marker(jpeg, 0xda), marker(jpeg, 0xd9));
    scan.is_some_and(|scan| end.is_none_or(|end| end < scan))
}

fn photo(path: &Path, format: ImageFormat) -> Result<Loaded, String> {
    let mut bytes = vec![];
    base::input::open(path).and_then(|mut file| file.read_to_end(&mut bytes)).map_err(|e| e.to_string())?;
    let name = match format {
        ImageFormat::Jpeg => "JPEG",
        _ => "PNG",
    };
    let other = image::guess_format(&bytes).ok().filter(|found| *found != format);
    if let Some(other) = other {
        return Err(format!("the file contains {other:?} data, not {name}: change the extension"));
    }
    if format == ImageFormat::Jpeg && is_cut_off(&bytes) {
        return Err("the JPEG file is truncated: copy the file again".into());
    }
    let bad = |e: image::ImageError| format!("cannot read the file as {name}: {e}");
    let mut limits = Limits::default();
    limits.max_alloc = Some(8 * MOST as u64);
    // With `ImageReader`, the decoders of all formats would be compiled again.
    let bytes = Cursor::new(&bytes);
    let mut decoder: Box<dyn ImageDecoder> = match format {
        ImageFormat::Jpeg => Box::new(JpegDecoder::new(bytes).map_err(bad)?),
        _ => Box::new(PngDecoder::with_limits(bytes, limits.clone()).map_err(bad)?),
    };
    decoder.set_limits(limits).map_err(bad)?;
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
    // The mean of the colour channels, without opacity.
    let channels = usize::from(photo.color().channel_count());
    let colours = if channels < 3 { 1 } else { 3 };
    let mean = |p: &[f32]| p[..colours].iter().sum::<f32>() / colours as f32;
    let values = samples.chunks_exact(channels).map(mean).collect();
    let image = Image::new(photo.width() as usize, photo.height() as usize, values)
        .ok_or("the file is damaged: copy the file again")?;
    Ok(Loaded { image, orientation: orientation.to_exif() })
}

fn npy(path: &Path) -> Result<Image, String> {
    let reader = NumpyReader::open(path).map_err(|e| e.to_string())?;
    let (height, width, depth) = match reader.shape[..] {
        [h, w] => (h, w, 1),
        [h, w, d] if d > 0 => (h, w, d),
        _ => {
            return Err(format!(
                "the array has shape {:?}; expected [height, width] or [height, width, channels]",
                reader.shape
            ));
        }
    };
    if reader.len() > MOST {
        return Err("the image is too large".into());
    }
    let mut all = vec![0.0_f32; reader.len()];
    reader.read(0, &mut all).map_err(|e| e.to_string())?;
    let values = all.chunks_exact(depth).map(|c| c.iter().sum::<f32>() / depth as f32).collect();
    Image::new(width, height, values).ok_or_else(|| "the file is damaged: copy the file again".into())
}

/// Returns an image encoded as an 8-bit grayscale PNG, or `None` if the encoder fails.
pub fn png_bytes(width: u32, height: u32, values: &[u8]) -> Option<Vec<u8>> {
    let mut out = vec![];
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().ok()?;
    writer.write_image_data(values).ok()?;
    writer.finish().ok()?;
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn images_round_trip(w in 1_u32..20, h in 1_u32..20, seed in 0_u8..255) {
            let values: Vec<u8> = (0..w * h).map(|i| (i as u8).wrapping_mul(37).wrapping_add(seed)).collect();
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.png");
            std::fs::write(&path, png_bytes(w, h, &values).unwrap()).unwrap();
            let back = Image::load(&path).unwrap().image;
            prop_assert_eq!(back.size(), [w, h]);
            prop_assert!(back.values.iter().zip(&values).all(|(a, b)| *a == f32::from(*b)));
        }

        #[test]
        fn arbitrary_bytes_never_panic(mut bytes in prop::collection::vec(any::<u8>(), 0..200), head in any::<bool>(), npy in any::<bool>()) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join(if npy { "a.npy" } else { "a.png" });
            if head {
                let mut whole = png_bytes(7, 5, &[9; 35]).unwrap();
                if let Some(at) = bytes.first() {
                    let at = *at as usize % whole.len();
                    whole[at] ^= bytes[bytes.len() - 1];
                    whole.truncate(whole.len() - bytes.len() % 5);
                }
                bytes = whole;
            }
            std::fs::write(&path, bytes).unwrap();
            let _ = Image::load(&path);
        }
    }

    #[test]
    fn interpolation_between_pixels_is_linear() {
        let image =
            Image::new(4, 3, (0..12).map(|i| (i % 4) as f32 + 10.0 * (i / 4) as f32).collect()).unwrap();
        for (x, y) in [(0.5, 0.5), (1.7, 2.1), (3.5, 2.5)] {
            assert!((f64::from(image.between(x, y)) - (x - 0.5 + 10.0 * (y - 0.5))).abs() < 1e-5);
        }
        assert!((image.blurred(0.8).at(1, 1) - 11.0).abs() < 0.8);
    }

    /// Returns the value of a pixel in a smooth image. Compression changes the image little, and the values
    /// of the four corners differ.
    fn smooth(x: u32, y: u32) -> u8 {
        (20.0 + 4.0 * f64::from(x) + 2.0 * f64::from(y)) as u8
    }

    /// Returns a JPEG of 24 × 16 pixels, with an EXIF orientation unless `orientation` is 0.
    fn jpeg(colours: bool, orientation: u8) -> Vec<u8> {
        let grey = image::GrayImage::from_fn(24, 16, |x, y| image::Luma([smooth(x, y)]));
        let mut photo = DynamicImage::ImageLuma8(grey);
        if colours {
            photo = DynamicImage::ImageRgb8(photo.to_rgb8());
        }
        let mut bytes = vec![];
        let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 98);
        photo.write_with_encoder(encoder).unwrap();
        if orientation > 0 {
            // Segment APP1 contains a little-endian TIFF header and one entry, the orientation tag 0x0112 of
            // type SHORT.
            let mut exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
            exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
            let mut segment = vec![0xff, 0xe1];
            segment.extend((exif.len() as u16 + 2).to_be_bytes());
            segment.extend(exif);
            bytes.splice(2..2, segment);
        }
        bytes
    }

    fn loaded(name: &str, bytes: &[u8]) -> Result<Loaded, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        Image::load(&path).map_err(|e| e.to_string())
    }

    #[test]
    fn jpeg_images_are_read() {
        for (name, colours) in [("a.jpg", false), ("a.jpeg", true), ("A.JPG", true)] {
            let found = loaded(name, &jpeg(colours, 0)).unwrap();
            assert_eq!((found.image.size(), found.orientation), ([24, 16], 1));
            for (x, y) in [(0, 0), (23, 0), (0, 15), (23, 15), (11, 7)] {
                let off = found.image.at(x, y) - f32::from(smooth(x as u32, y as u32));
                assert!(off.abs() < 4.0, "{name} {x} {y}: {off}");
            }
        }
    }

    /// For all eight orientations of EXIF 2.32 (4.6.5, tag 274), the first stored row and column are at
    /// the correct side of the image.
    #[test]
    fn images_are_rotated_by_exif_orientation() {
        for orientation in 1..=8 {
            let found = loaded("a.jpg", &jpeg(true, orientation)).unwrap();
            assert_eq!(found.orientation, orientation);
            let turned = orientation > 4;
            let [w, h] = found.image.size().map(|n| n as isize);
            assert_eq!([w, h], if turned { [16, 24] } else { [24, 16] });
            // Compare each corner of the rotated image with the stored pixel.
            for (x, y) in [(0, 0), (w - 1, 0), (0, h - 1)] {
                let (u, v) = match orientation {
                    1 => (x, y),
                    2 => (23 - x, y),
                    3 => (23 - x, 15 - y),
                    4 => (x, 15 - y),
                    5 => (y, x),
                    6 => (y, 15 - x),
                    7 => (23 - y, 15 - x),
                    _ => (23 - y, x),
                };
                let off = found.image.at(x, y) - f32::from(smooth(u as u32, v as u32));
                assert!(off.abs() < 4.0, "orientation {orientation} at {x}, {y}: {off}");
            }
        }
    }

    /// Truncated images are rejected, although the decoder would fill the missing part with grey.
    #[test]
    fn damaged_and_misnamed_images_are_refused() {
        let whole = jpeg(true, 0);
        for keep in 1..whole.len() - 2 {
            assert!(loaded("a.jpg", &whole[..keep]).is_err(), "{keep} bytes of {}", whole.len());
        }
        let message = loaded("a.png", &whole).unwrap_err();
        assert!(message.contains("the file contains Jpeg data, not PNG"), "{message}");
        let message = loaded("a.tif", &whole).unwrap_err();
        assert!(message.contains(".png"), "{message}");
    }

    #[test]
    fn pixels_of_16_bits_keep_their_values() {
        let values: Vec<u16> = (0..35).map(|i| i * 1801).collect();
        let image = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(7, 5, values.clone()).unwrap();
        let mut bytes = vec![];
        DynamicImage::ImageLuma16(image).write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).unwrap();
        let found = loaded("a.png", &bytes).unwrap().image;
        assert!(found.values.iter().zip(&values).all(|(a, b)| *a == f32::from(*b)));
    }
}
