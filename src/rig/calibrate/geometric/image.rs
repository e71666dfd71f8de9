//! Grey images to find things in: PNG of 8 or 16 bits, and .npy.

use std::path::{Path, PathBuf};
use store::numpy::NumpyReader;

/// A grey image, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Values, in any unit.
    pub values: Vec<f32>,
}

/// Why there is no image.
#[derive(Debug, thiserror::Error)]
#[error("{}: {message}", path.display())]
pub struct ImageError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it, and the mend.
    pub message: String,
}

/// Most pixels of an image.
const MOST: usize = 1 << 30;

impl Image {
    /// Of values, row by row; `None` if their number is not width × height.
    #[must_use]
    pub fn new(width: usize, height: usize, values: Vec<f32>) -> Option<Self> {
        (width.checked_mul(height) == Some(values.len())).then_some(Self {
            width,
            height,
            values,
        })
    }

    /// Width and height.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        [self.width as u32, self.height as u32]
    }

    /// The value of a pixel, that of the nearest one beyond the edges.
    #[inline]
    #[must_use]
    pub fn at(&self, x: isize, y: isize) -> f32 {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        self.values[y * self.width + x]
    }

    /// Between pixels, bilinearly; (0.5, 0.5) is the centre of the first one.
    #[inline]
    #[must_use]
    pub fn between(&self, x: f64, y: f64) -> f32 {
        let (x, y) = (x - 0.5, y - 0.5);
        let (i, j) = (x.floor(), y.floor());
        let (a, b) = ((x - i) as f32, (y - j) as f32);
        let (i, j) = (i as isize, j as isize);
        let row = |j| self.at(i, j) * (1.0 - a) + self.at(i + 1, j) * a;
        row(j) * (1.0 - b) + row(j + 1) * b
    }

    /// Blurred by a Gaussian of standard deviation `sigma`, pixels.
    #[must_use]
    pub fn blurred(&self, sigma: f32) -> Self {
        let reach = (3.0 * sigma).ceil() as isize;
        let mut kernel: Vec<f32> = (-reach..=reach)
            .map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp())
            .collect();
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
            Self {
                values: out,
                ..*image
            }
        };
        pass(&pass(self, 1, 0), 0, 1)
    }

    /// Reads a .png of 8 or 16 bits (of colours their mean), or a .npy of shape (height, width), with one further axis at
    /// most, over which it is averaged.
    ///
    /// # Errors
    /// [`ImageError`] if it is none of these, damaged, or has values that are not finite.
    pub fn load(path: &Path) -> Result<Self, ImageError> {
        let error = |message: String| ImageError {
            path: path.to_owned(),
            message,
        };
        let extension = path
            .extension()
            .and_then(|e| e.to_str())
            .unwrap_or("")
            .to_ascii_lowercase();
        let image = match extension.as_str() {
            "png" => png(path),
            "npy" => npy(path),
            _ => Err("images are read as .png (8 or 16 bits) or .npy: convert it".into()),
        };
        let image = image.map_err(error)?;
        if image.values.is_empty() || !image.values.iter().all(|v| v.is_finite()) {
            return Err(error(
                "it has no pixels, or some that are not finite numbers".into(),
            ));
        }
        Ok(image)
    }
}

fn png(path: &Path) -> Result<Image, String> {
    let file = base::input::open(path).map_err(|e| e.to_string())?;
    let mut decoder = png::Decoder::new(std::io::BufReader::new(file));
    decoder.set_transformations(png::Transformations::EXPAND);
    let bad = |e: png::DecodingError| format!("it is no PNG that can be read: {e}");
    let mut reader = decoder.read_info().map_err(bad)?;
    let size = reader
        .output_buffer_size()
        .filter(|n| *n <= 8 * MOST)
        .ok_or("it is too large")?;
    let mut bytes = vec![0; size];
    let info = reader.next_frame(&mut bytes).map_err(bad)?;
    let colours = match info.color_type {
        png::ColorType::Grayscale | png::ColorType::GrayscaleAlpha => 1,
        _ => 3,
    };
    let samples = info.color_type.samples();
    let wide = info.bit_depth == png::BitDepth::Sixteen;
    let value = |i: usize| {
        if wide {
            f32::from(u16::from_be_bytes([bytes[2 * i], bytes[2 * i + 1]]))
        } else {
            f32::from(bytes[i])
        }
    };
    let (width, height) = (info.width as usize, info.height as usize);
    let grey = |p: usize| (0..colours).map(|c| value(p * samples + c)).sum::<f32>() / colours as f32;
    let values = (0..width * height).map(grey).collect();
    Image::new(width, height, values).ok_or_else(|| "it is damaged".into())
}

fn npy(path: &Path) -> Result<Image, String> {
    let reader = NumpyReader::open(path).map_err(|e| e.to_string())?;
    let (height, width, depth) = match reader.shape[..] {
        [h, w] => (h, w, 1),
        [h, w, d] if d > 0 => (h, w, d),
        _ => {
            return Err(format!(
                "its shape is {:?}, where (height, width) is wanted",
                reader.shape
            ));
        }
    };
    if reader.len() > MOST {
        return Err("it is too large".into());
    }
    let mut all = vec![0.0_f32; reader.len()];
    reader.read(0, &mut all).map_err(|e| e.to_string())?;
    let values = all
        .chunks_exact(depth)
        .map(|c| c.iter().sum::<f32>() / depth as f32)
        .collect();
    Image::new(width, height, values).ok_or_else(|| "it is damaged".into())
}

/// An image as the bytes of a grey PNG of 8 bits.
#[must_use]
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
        fn images_come_back(w in 1_u32..20, h in 1_u32..20, seed in 0_u8..255) {
            let values: Vec<u8> = (0..w * h).map(|i| (i as u8).wrapping_mul(37).wrapping_add(seed)).collect();
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.png");
            std::fs::write(&path, png_bytes(w, h, &values).unwrap()).unwrap();
            let back = Image::load(&path).unwrap();
            prop_assert_eq!(back.size(), [w, h]);
            prop_assert!(back.values.iter().zip(&values).all(|(a, b)| *a == f32::from(*b)));
        }

        #[test]
        fn any_bytes_are_survived(mut bytes in prop::collection::vec(any::<u8>(), 0..200), head in any::<bool>(), npy in any::<bool>()) {
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
    fn between_pixels_is_linear() {
        let image = Image::new(
            4,
            3,
            (0..12).map(|i| (i % 4) as f32 + 10.0 * (i / 4) as f32).collect(),
        )
        .unwrap();
        for (x, y) in [(0.5, 0.5), (1.7, 2.1), (3.5, 2.5)] {
            assert!((f64::from(image.between(x, y)) - (x - 0.5 + 10.0 * (y - 0.5))).abs() < 1e-5);
        }
        assert!((image.blurred(0.8).at(1, 1) - 11.0).abs() < 0.8);
    }
}
