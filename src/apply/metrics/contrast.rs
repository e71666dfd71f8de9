//! Computes the contrast of marks as a function of depth. The contrast is the Michelson contrast (bright -
//! dark) / (bright + dark).
//!
//! The ground truth selects bright and dark pixels. If the evaluated image selected these pixels, noise would
//! be treated as contrast.

use crate::map::Map;

/// Returns the contrast of `image` at the bright and dark pixels of `truth`, in `bins` equal intervals of
/// `depth`. The intervals range from the minimum to the maximum depth within the mask. The contrast of an
/// interval is NaN if the truth's contrast is below `least`. The contrast is also NaN if the interval has
/// fewer than four bright or four dark pixels.
pub fn by_depth(image: &Map, truth: &Map, depth: &[f64], mask: &[bool], bins: usize, least: f64) -> Vec<f64> {
    let mean = |m: &Map, i: usize| {
        let pixel = &m.data[i * m.channels..(i + 1) * m.channels];
        pixel.iter().sum::<f64>() / m.channels as f64
    };
    let n = mask.len().min(depth.len()).min(image.width * image.height).min(truth.width * truth.height);
    let inside: Vec<usize> = (0..n).filter(|i| mask[*i] && depth[*i].is_finite()).collect();
    let (low, high) = inside
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), i| (a.min(depth[*i]), b.max(depth[*i])));
    let step = |i: usize| (((depth[i] - low) / (high - low) * bins as f64) as usize).min(bins - 1);
    (0..bins)
        .map(|bin| {
            let here: Vec<usize> = inside.iter().copied().filter(|i| high > low && step(*i) == bin).collect();
            let mut sorted: Vec<f64> = here.iter().map(|i| mean(truth, *i)).collect();
            sorted.sort_by(f64::total_cmp);
            let (Some(first), Some(last)) = (sorted.first(), sorted.last()) else {
                return f64::NAN;
            };
            // Values between the two thresholds are neither bright nor dark.
            let third = (last - first) / 3.0;
            let (dark, bright): (Vec<_>, Vec<_>) = (
                here.iter().copied().filter(|i| mean(truth, *i) <= first + third).collect(),
                here.iter().copied().filter(|i| mean(truth, *i) >= last - third).collect(),
            );
            let of = |m: &Map| {
                let level = |all: &[usize]| all.iter().map(|i| mean(m, *i)).sum::<f64>() / all.len() as f64;
                let (b, d) = (level(&bright), level(&dark));
                (b - d) / (b + d)
            };
            let enough = dark.len() >= 4 && bright.len() >= 4 && of(truth) >= least;
            if enough { of(image) } else { f64::NAN }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contrast_under_a_veil_matches_the_closed_form() {
        // The image has stripes of values 1 and 3 under a veil v that increases with depth (with the row).
        // The contrast of the stripes is 2 / (4 + 2 v).
        let truth = Map::from_fn(16, 40, 1, |x, _, out| out[0] = if x % 2 == 0 { 1.0 } else { 3.0 });
        let veil = |y: usize| (y / 10) as f64;
        let seen = Map::from_fn(16, 40, 1, |x, y, out| out[0] = truth.at(x, y)[0] + veil(y));
        let depth: Vec<f64> = (0..640).map(|i| f64::from(i / 16)).collect();
        let mask = vec![true; 640];
        let got = by_depth(&seen, &truth, &depth, &mask, 4, 0.1);
        for (bin, c) in got.iter().enumerate() {
            approx::assert_relative_eq!(*c, 2.0 / (4.0 + 2.0 * bin as f64), epsilon = 1e-12);
        }
        // An image without marks has no contrast.
        let plain = Map::from_fn(16, 40, 1, |_, _, out| out[0] = 1.0);
        assert!(by_depth(&seen, &plain, &depth, &mask, 4, 0.1).iter().all(|c| c.is_nan()));
    }

    #[test]
    fn noise_has_no_contrast() {
        let truth = Map::from_fn(64, 64, 1, |x, _, out| out[0] = if x % 2 == 0 { 1.0 } else { 3.0 });
        let mut state = 7_u64;
        let noise = Map::from_fn(64, 64, 1, |_, _, out| {
            state = (state * 1103515245 + 12345) % (1 << 31);
            out[0] = 1.0 + state as f64 / f64::from(1_u32 << 31);
        });
        let depth: Vec<f64> = (0..4096).map(|i| f64::from(i % 64)).collect();
        // The noise has mean 1.5 and standard deviation 1/√12. For 4096 pixels in two halves, the tolerance
        // of 5 σ is 5 · (0.289 / 1.5) / √4096.
        let c = by_depth(&noise, &truth, &depth, &[true; 4096], 1, 0.1)[0];
        assert!(c.abs() < 5.0 * 0.289 / 1.5 / 64.0, "{c}");
    }
}
