//! Maps values to colours, based on their wavelengths, an exposure and colour maps.
//!
//! The wavelength rule assigns wavelengths to primaries (660 nm red, 550 nm green, 450 nm blue). Each primary
//! shows the mean of the wavelengths for which the primary is the nearest. A primary that is nearest to no
//! wavelength shows the single nearest wavelength. There are two exceptions. Three wavelengths are assigned
//! by order (lowest blue, middle green, highest red), and a single wavelength is grey. The weights of each
//! primary sum to 1, so a spectrally flat image is grey.

use super::white::White;
use crate::spec::SignedScale;
use base::spectral_table;
use image::Rgb;

/// Colour of values that are not finite, and of values that are divided by an M00 that is not positive.
pub const UNDEFINED: Rgb<u8> = Rgb([178, 178, 178]);

/// Wavelengths in nanometres shown as red, green and blue.
pub const PRIMARIES_NM: [f64; 3] = [660.0, 550.0, 450.0];

/// Returns the weight of every wavelength in red, green and blue: `weights[channel][wavelength]`.
/// Each row sums to 1. The module documentation states the rule.
pub fn rgb_weights(nm: &[f64]) -> [Vec<f32>; 3] {
    let n = nm.len();
    let mut weights = [(); 3].map(|()| vec![0.0; n]);
    match n {
        0 => {}
        1 => weights.iter_mut().for_each(|w| w[0] = 1.0),
        3 => {
            let mut order = [0, 1, 2];
            order.sort_by(|&a, &b| nm[b].total_cmp(&nm[a]));
            for (channel, wavelength) in order.into_iter().enumerate() {
                weights[channel][wavelength] = 1.0;
            }
        }
        _ => {
            for (channel, row) in weights.iter_mut().enumerate() {
                let mine: Vec<usize> = (0..n).filter(|&i| primary(nm[i]) == channel).collect();
                if mine.is_empty() {
                    row[nearest(nm, PRIMARIES_NM[channel])] = 1.0;
                }
                for &i in &mine {
                    row[i] = 1.0 / mine.len() as f32;
                }
            }
        }
    }
    weights
}

/// Returns the index of the primary (0 red, 1 green, 2 blue) nearest to a wavelength.
pub fn primary(nm: f64) -> usize {
    nearest(&PRIMARIES_NM, nm)
}

/// Returns the index of the value nearest to `wanted`. Of several nearest values, the first is used. Returns
/// 0 for an empty list.
pub fn nearest(values: &[f64], wanted: f64) -> usize {
    spectral_table::nearest(values, wanted).unwrap_or(0)
}

/// Returns line colours that are distinct on white. For several wavelengths, the colour is that of the
/// primary, darker for the second wavelength of a primary. A single wavelength is dark grey.
pub fn line_colours(nm: &[f64]) -> Vec<Rgb<u8>> {
    const SHADES: [[[u8; 3]; 2]; 3] =
        [[[204, 44, 38], [120, 20, 50]], [[40, 140, 60], [10, 82, 70]], [[38, 96, 190], [92, 48, 150]]];
    if nm.len() == 1 {
        return vec![Rgb([45, 45, 55])];
    }
    let mut used = [0; 3];
    let weights = rgb_weights(nm);
    (0..nm.len())
        .map(|i| {
            let channel = if nm.len() == 3 {
                (0..3).find(|&c| weights[c][i] > 0.0).unwrap_or(0)
            } else {
                primary(nm[i])
            };
            let shade = SHADES[channel][used[channel] % 2];
            used[channel] += 1;
            Rgb(shade)
        })
        .collect()
}

/// Returns the quantile `q` (0..1) of the finite values, or `None` if no value is finite.
pub fn percentile(values: impl Iterator<Item = f32>, q: f64) -> Option<f32> {
    let mut finite: Vec<f32> = values.filter(|v| v.is_finite()).collect();
    if finite.is_empty() {
        return None;
    }
    let rank = ((finite.len() - 1) as f64 * q.clamp(0.0, 1.0)).round() as usize;
    Some(*finite.select_nth_unstable_by(rank, f32::total_cmp).1)
}

/// Returns the white level of an image. The white level is the 99th percentile of the image's values, or the
/// maximum if that percentile is not positive.
pub fn exposure(values: impl Iterator<Item = f32> + Clone) -> White {
    let positive = |v: &f32| *v > 0.0;
    percentile(values.clone(), 0.99).filter(positive).or_else(|| percentile(values, 1.0)).into()
}

/// Encodes a linear value, clamped to 0..1, with the sRGB transfer function.
pub fn srgb(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

/// Returns the sRGB colour of linear values, relative to the white level `white`.
pub fn photo(rgb: [f32; 3], white: f32) -> Rgb<u8> {
    if rgb.iter().all(|v| v.is_finite()) { Rgb(rgb.map(|v| srgb(v / white))) } else { UNDEFINED }
}

/// Returns the colour of a value in a diverging colour map. The colour is blue for -1, nearly white for 0 and
/// red for +1. Other values are clamped to -1..1.
pub fn signed(v: f32) -> Rgb<u8> {
    gradient(colorous::RED_BLUE, v, 0.5 - 0.5 * v.clamp(-1.0, 1.0))
}

/// Returns the colour of the quotient `element` / `m00` on the scale ± `limit`.
pub fn quotient(element: f32, m00: f32, limit: f32, scale: SignedScale) -> Rgb<u8> {
    if m00 > 0.0 && m00.is_finite() { signed(scale.place(element / m00 / limit)) } else { UNDEFINED }
}

/// Samples of Matplotlib's cyclic colour map twilight. Both ends are equal. The explorer uses the same samples.
#[rustfmt::skip]
const TWILIGHT: [u32; 33] = [
    0xe2d9e2, 0xd6d7dd, 0xc2ced4, 0xaac2cc, 0x93b4c6, 0x80a5c3, 0x7297c1, 0x6887be, 0x6276ba, 0x5f64b5, 0x5e51ad,
    0x5d3da1, 0x592a8f, 0x511b77, 0x45135c, 0x381145, 0x301437, 0x3a113a, 0x4a1342, 0x5f174a, 0x741e4f, 0x872750,
    0x983550, 0xa64550, 0xb25652, 0xbb6958, 0xc27c63, 0xc78f72, 0xcca287, 0xd1b5a1, 0xd8c6bd, 0xded3d4, 0xe2d9e2,
];

/// Returns the colour of an angle in a cyclic colour map. The angle has a period of 1. Returns [`UNDEFINED`] if
/// the angle is not finite.
pub fn cyclic(turn: f32) -> Rgb<u8> {
    if !turn.is_finite() {
        return UNDEFINED;
    }
    let last = TWILIGHT.len() - 1;
    let at = turn.rem_euclid(1.0) * last as f32;
    let i = (at as usize).min(last - 1);
    let [low, high] = [TWILIGHT[i], TWILIGHT[i + 1]].map(u32::to_be_bytes);
    let between = |c: usize| f32::from(low[c]) + (at - i as f32) * (f32::from(high[c]) - f32::from(low[c]));
    Rgb([1, 2, 3].map(|c| between(c).round() as u8))
}

/// Returns the colour of a value in a perceptually uniform sequential colour map. The colour is black for 0
/// and pale yellow for 1. Values outside 0..1 are clamped.
pub fn sequential(v: f32) -> Rgb<u8> {
    gradient(colorous::INFERNO, v, v.clamp(0.0, 1.0))
}

/// Returns the colour at the position `at` (0..1) of a colour map, or [`UNDEFINED`] if `value` is not finite.
fn gradient(map: colorous::Gradient, value: f32, at: f32) -> Rgb<u8> {
    if !value.is_finite() {
        return UNDEFINED;
    }
    let c = map.eval_continuous(at.into());
    Rgb([c.r, c.g, c.b])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_wavelengths_are_blue_green_red_in_order() {
        let w = rgb_weights(&[450.0, 550.0, 660.0]);
        assert_eq!(w, [vec![0.0, 0.0, 1.0], vec![0.0, 1.0, 0.0], vec![1.0, 0.0, 0.0]]);
        assert_eq!(rgb_weights(&[635.0]), [(); 3].map(|()| vec![1.0]));
    }

    #[test]
    fn every_list_of_wavelengths_keeps_flat_light_grey() {
        for nm in [vec![450.0, 635.0], vec![400.0, 450.0, 550.0, 660.0], vec![700.0, 800.0], vec![1.0; 4]] {
            for row in rgb_weights(&nm) {
                assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-6, "{nm:?} {row:?}");
            }
        }
        assert_eq!(rgb_weights(&[400.0, 450.0, 550.0, 660.0])[2], [0.5, 0.5, 0.0, 0.0]);
    }

    #[test]
    fn colour_maps_show_sign_and_centre() {
        let (red, zero, blue) = (signed(1.0).0, signed(0.0).0, signed(-1.0).0);
        assert!(red[0] > 2 * red[2] && blue[2] > 2 * blue[0]);
        assert!(zero.iter().all(|&c| c > 230));
        assert_eq!(signed(f32::NAN), UNDEFINED);
        assert_eq!(signed(7.0), signed(1.0));
        assert!(sequential(0.0).0.iter().all(|&c| c < 10));
        assert_eq!(srgb(1.0), 255);
        assert_eq!((cyclic(0.0), cyclic(0.5)), (Rgb([0xe2, 0xd9, 0xe2]), Rgb([0x30, 0x14, 0x37])));
        assert_eq!((cyclic(1.25), cyclic(-0.75)), (cyclic(0.25), cyclic(0.25)));
        assert_eq!(srgb(0.215_861), 128);
    }

    #[test]
    fn exposure_ignores_values_that_are_not_finite() {
        let v = [f32::NAN, 0.0, f32::INFINITY, 2.0];
        assert_eq!(exposure(v.iter().copied()), White::Value(2.0));
        assert_eq!(exposure([0.0; 4].iter().copied()), White::Nothing);
        assert_eq!(exposure([-2.0, f32::NAN].iter().copied()), White::Nothing);
        assert_eq!(exposure([].iter().copied()), White::Nothing);
        let sparse = (0..1000).map(|i| if i == 7 { 3.0 } else { 0.0 });
        assert_eq!(exposure(sparse), White::Value(3.0));
    }

    #[test]
    fn lines_of_one_primary_differ() {
        let c = line_colours(&[440.0, 460.0, 550.0, 660.0]);
        assert_ne!(c[0], c[1]);
        assert_eq!(line_colours(&[450.0, 550.0, 660.0]).len(), 3);
    }
}
