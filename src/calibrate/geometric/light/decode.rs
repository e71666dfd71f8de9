//! Decodes camera images of the patterns. The results are the projector coordinates of each camera pixel, or
//! NaN for unreliable pixels.

use super::patterns::{Axis, Pattern, Sequence};
use crate::geometric::image::Image;
use std::f64::consts::TAU;

/// Projector coordinates of each camera pixel, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// Number of camera pixels per row.
    pub width: usize,
    pub height: usize,
    /// Continuous column coordinate in the projector, or NaN for unreliable pixels.
    pub u: Vec<f32>,
    /// Continuous row coordinate in the projector, or NaN for unreliable pixels.
    pub v: Vec<f32>,
}

/// Minimum contrast between white and black, relative to the contrast of the brightest pixels.
const LEAST: f32 = 0.03;
/// Minimum difference between a bit and its inverse, relative to the contrast. At pattern edges the
/// difference is smaller.
const SURE: f32 = 0.2;

impl Decoded {
    /// Returns the number of pixels for which both coordinates are known.
    pub fn count(&self) -> usize {
        self.u.iter().zip(&self.v).filter(|(u, v)| u.is_finite() && v.is_finite()).count()
    }
}

/// Decodes the images of a pattern sequence, in the order of the patterns.
///
/// The coordinates of a pixel are NaN in these cases:
/// - The white pattern is only slightly brighter than the black pattern.
/// - More than one bit of an axis is uncertain, because the pixel receives light from projector pixels that
///   are not neighbours.
/// - The decoded coordinate is outside the projector's image.
///
/// # Errors
/// Returns a message if the numbers of images and patterns differ, or if image sizes differ.
pub fn decode(sequence: &Sequence, images: &[Image]) -> Result<Decoded, String> {
    let patterns = sequence.patterns();
    if images.len() != patterns.len() {
        return Err(format!(
            "got {} images, but the sequence for {} × {} pixels with {} shifts has {} patterns; pass one image per pattern",
            images.len(),
            sequence.size[0],
            sequence.size[1],
            sequence.shifts,
            patterns.len()
        ));
    }
    let (width, height) = (images[0].width, images[0].height);
    if let Some(i) = images.iter().position(|i| i.width != width || i.height != height) {
        return Err(format!(
            "image {} has {} × {} pixels, but the first image has {width} × {height} pixels; use images of equal size",
            i + 1,
            images[i].width,
            images[i].height
        ));
    }
    let n = width * height;
    let contrast: Vec<f32> = (0..n).map(|i| images[0].values[i] - images[1].values[i]).collect();
    let mut sorted = contrast.clone();
    sorted.sort_by(f32::total_cmp);
    let bright = sorted[(n - 1) * 99 / 100];
    let axis = |axis: Axis| -> Vec<f32> {
        let frames: Vec<(Pattern, &Image)> = patterns.iter().copied().zip(images).collect();
        let bits: Vec<[&Image; 2]> = (0..sequence.bits(axis))
            .rev()
            .filter_map(|b| {
                let of = |inverted| {
                    frames.iter().find(|(p, _)| *p == Pattern::Bit(axis, b, inverted)).map(|(_, i)| *i)
                };
                Some([of(false)?, of(true)?])
            })
            .collect();
        let waves: Vec<&Image> = frames
            .iter()
            .filter(|(p, _)| matches!(p, Pattern::Wave(a, _) if *a == axis))
            .map(|(_, i)| *i)
            .collect();
        let length = sequence.size[usize::from(axis == Axis::Row)];
        (0..n)
            .map(|i| {
                let lit = contrast[i];
                if lit.is_nan() || lit <= LEAST * bright || lit <= 0.0 {
                    return f32::NAN;
                }
                let steps = bits.iter().map(|[on, off]| (on.values[i] - off.values[i]) / lit);
                let coarse = gray(steps, length);
                let waves = waves.iter().map(|w| f64::from(w.values[i]));
                fine(coarse, waves, sequence, f64::from(lit)) as f32
            })
            .collect()
    };
    Ok(Decoded { width, height, u: axis(Axis::Column), v: axis(Axis::Row) })
}

/// Returns the coordinate that Gray code bits encode, or NaN if the code is invalid. `steps` holds the
/// difference between each bit and its inverse relative to the contrast, most significant bit first.
fn gray(steps: impl Iterator<Item = f32>, length: u32) -> f64 {
    let (mut code, mut bits, mut unsure) = (0_u32, 0_u32, None);
    for step in steps {
        let bit = u32::from(step > 0.0);
        code = (code << 1) | bit;
        bits += 1;
        if step.is_nan() || step.abs() < SURE {
            if unsure.is_some() {
                return f64::NAN;
            }
            unsure = Some(bits);
        }
    }
    let plain = |gray: u32| {
        let mut x = gray;
        for shift in [1, 2, 4, 8, 16] {
            x ^= x >> shift;
        }
        x
    };
    let x = plain(code);
    let Some(place) = unsure else {
        return if x < length { f64::from(x) + 0.5 } else { f64::NAN };
    };
    // At an edge, both codes must be neighbours. The pixel then observes the border between two projector
    // pixels.
    let y = plain(code ^ (1 << (bits - place)));
    if x.abs_diff(y) == 1 && x.max(y) < length { f64::from(x.max(y)) } else { f64::NAN }
}

/// Refines a coarse coordinate to subpixel resolution from the phases of the waves.
fn fine(coarse: f64, waves: impl Iterator<Item = f64>, sequence: &Sequence, contrast: f64) -> f64 {
    let (mut c, mut s) = (0.0, 0.0);
    for (n, value) in waves.enumerate() {
        let (sin, cos) = (TAU * n as f64 / f64::from(sequence.shifts)).sin_cos();
        c += value * cos;
        s += value * sin;
    }
    if sequence.shifts == 0 || coarse.is_nan() {
        return coarse;
    }
    // The peak-to-peak amplitude of the waves, which ideally equals the contrast.
    let swing = 4.0 * c.hypot(s) / f64::from(sequence.shifts);
    if swing.is_nan() || swing < 0.2 * contrast {
        return f64::NAN;
    }
    let period = f64::from(sequence.period);
    let within = s.atan2(c) / TAU * period;
    let fine = within + period * ((coarse - within) / period).round();
    // The error of the coarse coordinate is at most one pixel.
    if (fine - coarse).abs() < 2.0 { fine } else { f64::NAN }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns one-row images whose pixel i receives light from the projector coordinates (u_i, v_i), by
    /// linear interpolation.
    fn seen(sequence: &Sequence, at: &[(f64, f64)], noise: f32) -> Vec<Image> {
        let mut x = 9_u32;
        let patterns = sequence.patterns();
        let mut image = |p: &Pattern| {
            let values = at.iter().map(|(u, v)| {
                x = x.wrapping_mul(1664525).wrapping_add(1013904223);
                let random = (x >> 8) as f32 / (1 << 24) as f32 - 0.5;
                let one = |u: f64, v: f64| {
                    let [w, h] = sequence.size.map(f64::from);
                    sequence.drive(*p, u.clamp(0.0, w - 1.0) as u32, v.clamp(0.0, h - 1.0) as u32)
                };
                let (fu, fv) = ((u - 0.5).rem_euclid(1.0), (v - 0.5).rem_euclid(1.0));
                let (iu, iv) = ((u - 0.5).floor(), (v - 0.5).floor());
                let mix = (one(iu, iv) * (1.0 - fu) + one(iu + 1.0, iv) * fu) * (1.0 - fv)
                    + (one(iu, iv + 1.0) * (1.0 - fu) + one(iu + 1.0, iv + 1.0) * fu) * fv;
                5.0 + 90.0 * mix as f32 + noise * random
            });
            Image::new(at.len(), 1, values.collect()).unwrap()
        };
        patterns.iter().map(&mut image).collect()
    }

    proptest! {
        #[test]
        fn decoded_coordinates_match(w in 5_u32..300, h in 5_u32..300, a in 0.0..1.0_f64, b in 0.0..1.0_f64, waves in any::<bool>()) {
            let sequence = Sequence::with_waves([w, h], if waves { 4 } else { 0 }, 16).unwrap();
            let at: Vec<(f64, f64)> = (0..50)
                .map(|i| (f64::from(i), f64::from(i)))
                .map(|(x, y)| ((a * 77.0 + 1.13 * x) % (f64::from(w) - 1.0) + 0.5, (b * 55.0 + 0.7 * y) % (f64::from(h) - 1.0) + 0.5))
                .collect();
            let found = decode(&sequence, &seen(&sequence, &at, 2.0)).unwrap();
            for (i, (u, v)) in at.iter().enumerate() {
                let off = (f64::from(found.u[i]) - u).abs().max((f64::from(found.v[i]) - v).abs());
                prop_assert!(off < if waves { 0.15 } else { 0.8 }, "{off} {u} {v}");
            }
        }

        #[test]
        fn arbitrary_values_never_panic(values in prop::collection::vec(prop::num::f32::ANY, 12 * 4)) {
            let sequence = Sequence::gray([4, 3]).unwrap();
            let images: Vec<_> = values.chunks(4).take(sequence.patterns().len()).map(|c| Image::new(2, 2, c.to_vec()).unwrap()).collect();
            let _ = decode(&sequence, &images);
        }
    }

    #[test]
    fn dark_and_mixed_pixels_are_excluded() {
        let sequence = Sequence::gray([64, 64]).unwrap();
        let mut images = seen(&sequence, &[(10.5, 20.5), (10.5, 20.5), (10.5, 20.5)], 0.0);
        // The second pixel receives light from no projector pixel, and the third receives light from two
        // distant projector pixels.
        let other = seen(&sequence, &[(53.5, 41.5)], 0.0);
        for (image, far) in images.iter_mut().zip(&other) {
            image.values[1] = 5.0;
            image.values[2] = 0.5 * (image.values[2] + far.values[0]);
        }
        let found = decode(&sequence, &images).unwrap();
        assert_eq!((found.u[0], found.v[0]), (10.5, 20.5));
        assert!(found.u[1].is_nan() && found.u[2].is_nan() && found.count() == 1);
        assert!(decode(&sequence, &images[1..]).unwrap_err().contains("patterns"));
    }

    #[test]
    fn neighbours_differ_in_one_bit() {
        let sequence = Sequence::gray([1000, 7]).unwrap();
        assert_eq!((sequence.bits(Axis::Column), sequence.bits(Axis::Row)), (10, 3));
        let bits: Vec<Pattern> = sequence
            .patterns()
            .into_iter()
            .filter(|p| matches!(p, Pattern::Bit(Axis::Column, _, false)))
            .collect();
        for u in 0..999 {
            let changed =
                bits.iter().filter(|p| sequence.drive(**p, u, 0) != sequence.drive(**p, u + 1, 0)).count();
            assert_eq!(changed, 1);
        }
    }
}
