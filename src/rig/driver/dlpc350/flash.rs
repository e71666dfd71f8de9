//! Images of the controller's flash as PNG files. Each image holds 24 one-bit patterns, one per plane.
//!
//! TI's program builds the firmware from these images. Planes are numbered as in the controller (programmer's
//! guide DLPU010, pattern display LUT). Planes 0 to 7 are the bits of green, 8 to 15 those of red, and 16 to
//! 23 those of blue. Each range begins with the lowest bit.

use super::projector::{Flash, SIZE};
use crate::instrument::Pattern;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Number of one-bit planes per image.
const PLANES: usize = 24;

/// Returns the index of the byte of an RGB pixel that contains a plane, and the index of the bit in this
/// byte.
fn place(plane: usize) -> (usize, usize) {
    ([1, 0, 2][plane / 8], plane % 8)
}

/// Reads flash images. Each image is a PNG file with 8 bits per colour and the size of the mirror array.
///
/// # Errors
/// Returns a message that names the file, if the file cannot be read or does not have the required format.
pub fn load<P: AsRef<Path>>(files: &[P]) -> Result<Flash, String> {
    let image = |path: &P| -> Result<Vec<Pattern>, String> {
        let path = path.as_ref();
        let rgb = rgb(path).map_err(|e| format!("{}: {e}", path.display()))?;
        let pattern = |plane| {
            let (colour, bit) = place(plane);
            Pattern {
                width: SIZE[0],
                height: SIZE[1],
                pixels: rgb
                    .chunks_exact(3)
                    .map(|p| if p[colour] >> bit & 1 == 1 { 255 } else { 0 })
                    .collect(),
            }
        };
        Ok((0..PLANES).map(pattern).collect())
    };
    files.iter().map(image).collect::<Result<_, _>>().map(Flash)
}

fn rgb(path: &Path) -> Result<Vec<u8>, String> {
    let file: File = base::input::open(path).map_err(|e| e.to_string())?;
    let bad = |e: png::DecodingError| format!("cannot read the file as PNG: {e}");
    let mut reader = png::Decoder::new(BufReader::new(file)).read_info().map_err(bad)?;
    let info = reader.info();
    let known = (info.color_type, info.bit_depth) == (png::ColorType::Rgb, png::BitDepth::Eight);
    let [w, h] = SIZE;
    if !known || (info.width, info.height) != (w, h) {
        return Err(format!(
            "expected an RGB image of {w} x {h} pixels with 8 bits per channel, got {:?} of {} x {} pixels with {} bits; create the \
             image with `sunstone rig flash`",
            info.color_type, info.width, info.height, info.bit_depth as u8
        ));
    }
    let mut bytes = vec![0; 3 * w as usize * h as usize];
    reader.next_frame(&mut bytes).map_err(bad)?;
    Ok(bytes)
}

/// Packs one-bit patterns into RGB images and returns the bytes of each image. Skips duplicates, and also
/// white, black and negatives of other patterns, which the controller generates itself.
pub fn images(patterns: &[Pattern]) -> Vec<Vec<u8>> {
    let mut kept: Vec<&Pattern> = vec![];
    for p in patterns {
        let plain = p.pixels.windows(2).all(|w| w[0] == w[1]);
        let negative = |q: &&Pattern| p.pixels.iter().zip(&q.pixels).all(|(a, b)| *a == 255 - *b);
        if !plain && !kept.iter().any(|q| q.pixels == p.pixels || negative(q)) {
            kept.push(p);
        }
    }
    let image = |planes: &[&Pattern]| {
        let mut bytes = vec![0; 3 * planes[0].pixels.len()];
        for (plane, pattern) in planes.iter().enumerate() {
            let (colour, bit) = place(plane);
            for (pixel, on) in bytes.chunks_exact_mut(3).zip(&pattern.pixels) {
                pixel[colour] |= u8::from(*on > 127) << bit;
            }
        }
        bytes
    };
    kept.chunks(PLANES).map(image).collect()
}

/// Encodes an image as PNG. Returns `None` if the image's size differs from that of the mirror array.
pub fn to_png(rgb: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = vec![];
    let mut encoder = png::Encoder::new(&mut bytes, SIZE[0], SIZE[1]);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().ok()?.write_image_data(rgb).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pattern(of: impl Fn(u32, u32) -> bool) -> Pattern {
        let [w, h] = SIZE;
        let pixel = |i: u32| if of(i % w, i / w) { 255 } else { 0 };
        Pattern { width: w, height: h, pixels: (0..w * h).map(pixel).collect() }
    }

    #[test]
    #[ignore = "slow: tools/check --all"]
    fn patterns_are_stored_once_and_read_back() {
        let mut all: Vec<Pattern> = (1..=30).map(|k| pattern(|x, y| (x / k + y) % 2 == 0)).collect();
        let made = all.clone();
        all.push(pattern(|_, _| true));
        all.push(pattern(|x, y| (x / 3 + y) % 2 != 0));
        all.push(made[4].clone());
        let folder = tempfile::tempdir().expect("a folder");
        let files: Vec<_> = images(&all)
            .iter()
            .enumerate()
            .map(|(i, rgb)| {
                let path = folder.path().join(format!("{i}.png"));
                std::fs::write(&path, to_png(rgb).expect("a PNG")).expect("writes");
                path
            })
            .collect();
        assert_eq!(files.len(), 2);
        let flash = load(&files).expect("images");
        let held: Vec<&Pattern> = flash.0.iter().flatten().take(30).collect();
        assert_eq!(held, made.iter().collect::<Vec<_>>());
    }

    /// Planes are numbered as in the controller. Plane 0 is the lowest bit of green, plane 8 the lowest bit
    /// of red, and plane 23 the highest bit of blue.
    #[test]
    fn planes_are_numbered_as_in_the_controller() {
        let rgb = &images(&(1..=24).map(|k| pattern(|x, _| x == k)).collect::<Vec<_>>())[0];
        assert_eq!(rgb[3..6], [0, 1, 0]);
        assert_eq!(rgb[27..30], [1, 0, 0]);
        assert_eq!(rgb[72..75], [0, 0, 128]);
    }

    #[test]
    fn invalid_images_are_reported() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.png");
        assert!(load(&[&path]).expect_err("none").contains("a.png"));
        std::fs::write(&path, b"no image").expect("writes");
        assert!(load(&[&path]).expect_err("none").contains("as PNG"));
    }
}
