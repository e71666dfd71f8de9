//! Detects outliers. An outlier is a pixel of one render whose value is far above the values of its
//! neighbours and of the same pixel in the other render.
//!
//! A rare strong path gives a pixel a value whose standard error is about as large as the value. Relative to
//! this standard error, the pixel does not differ from other pixels. A weighted mean therefore includes the
//! pixel, and one bright pixel becomes a faint spot as wide as the window. A true highlight appears in each
//! render, but an outlier appears in a single render. A pixel of one render is an outlier if at some
//! wavelength
//!
//! > M00(p) > 5 max(M00 of the neighbours of p in both renders, M00(p) in the other render).
//!
//! Two further conditions must hold. The standard error of the pixel must be more than a quarter of the
//! pixel's value, and most of the neighbours must have received light. (If most neighbours are dark, rare
//! paths are the only light in the region.) The outlier is replaced by the mean of its neighbours, which is
//! realizable. The removed light is a bias of the denoised value and contributes to the stated error
//! ([`super::average`]).

use super::{Size, Values};

/// Threshold of an outlier relative to the other pixels. In regions that few paths reach, single
/// contributions make up most of the light. In a room scene with a mirror (`tests/suite/denoise.rs`), a
/// factor of three removed correct highlights. A factor of five removes none.
const ABOVE: f32 = 5.0;

/// Minimum standard error of an outlier relative to its value. This ratio is the relative standard error if
/// 16 of many samples have equal contributions and all other samples have none.
const UNSURE: f32 = 0.25;

/// Returns the outliers of each of two renders. The first `lanes` channels, which are M00 at each wavelength,
/// determine the outliers. Returns no outliers for a single render.
pub fn outliers(renders: &[Values], lanes: usize, known: &[bool]) -> Vec<Vec<bool>> {
    let [a, b] = renders else {
        return vec![vec![false; known.len()]; renders.len()];
    };
    let is = |own: &Values, other: &Values, p: usize| {
        known[p]
            && (0..lanes).any(|lane| {
                let at = |p: usize| p * own.channels + lane;
                let here = own.mean[at(p)];
                if own.error[at(p)] <= UNSURE * here {
                    return false;
                }
                let near = neighbours(p, own.size).filter(|q| known[*q]);
                let others = near.flat_map(|q| [own.mean[at(q)], other.mean[at(q)]]);
                let (mut most, mut lit, mut all) = (0.0_f32, 0, 0);
                for m in others.chain([other.mean[at(p)]]) {
                    most = most.max(m);
                    lit += usize::from(m > 0.0);
                    all += 1;
                }
                2 * lit > all && here > ABOVE * most
            })
    };
    let of = |own, other| (0..known.len()).map(|p| is(own, other, p)).collect();
    vec![of(a, b), of(b, a)]
}

/// Replaces each outlier's value and variance by means over the outlier's neighbours. The means include known
/// neighbours that are not outliers. Returns the removed amounts.
pub fn replace(values: &mut Values, outliers: &[bool], known: &[bool]) -> Vec<f32> {
    let n = values.channels;
    let mut taken = vec![0.0; values.mean.len()];
    for p in (0..outliers.len()).filter(|p| outliers[*p]) {
        let near: Vec<usize> = neighbours(p, values.size).filter(|q| known[*q] && !outliers[*q]).collect();
        if near.is_empty() {
            continue;
        }
        let mean = |of: &dyn Fn(usize) -> f32| near.iter().map(|q| of(*q)).sum::<f32>() / near.len() as f32;
        for c in 0..n {
            let light = mean(&|q| values.mean[q * n + c]);
            let variance = mean(&|q| values.error[q * n + c].powi(2));
            taken[p * n + c] = values.mean[p * n + c] - light;
            values.mean[p * n + c] = light;
            values.error[p * n + c] = variance.sqrt();
        }
    }
    taken
}

/// Returns the neighbours (at most eight) of pixel `p` within the image.
pub(super) fn neighbours(p: usize, [height, width]: Size) -> impl Iterator<Item = usize> {
    let (y, x) = (p / width, p % width);
    let rows = y.saturating_sub(1)..(y + 2).min(height);
    let columns = x.saturating_sub(1)..(x + 2).min(width);
    let all = rows.flat_map(move |y| columns.clone().map(move |x| y * width + x));
    all.filter(move |q| *q != p)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = [5, 5];
    const SPOT: usize = 12;

    /// Returns a grey image with one bright pixel of the given value and error.
    fn spot(value: f32, error: f32) -> Values {
        let (mut mean, mut errors) = (vec![1.0; 25], vec![0.1; 25]);
        (mean[SPOT], errors[SPOT]) = (value, error);
        Values { size: SIZE, channels: 1, mean, error: errors }
    }

    fn found(renders: &[Values]) -> Vec<Vec<usize>> {
        let all = outliers(renders, 1, &[true; 25]);
        all.iter().map(|of| (0..25).filter(|p| of[*p]).collect()).collect()
    }

    #[test]
    fn a_contribution_in_only_one_render_is_an_outlier() {
        let plain = spot(1.0, 0.1);
        assert_eq!(found(&[spot(50.0, 49.0), plain.clone()]), [vec![SPOT], vec![]]);
        assert_eq!(found(&[plain.clone(), spot(50.0, 49.0)]), [vec![], vec![SPOT]]);
        // The following values are not outliers:
        // - a highlight in the two renders,
        // - a value with a small error,
        // - slightly more light,
        // - pixels of a single render.
        for renders in [
            &[spot(50.0, 49.0), spot(30.0, 29.0)][..],
            &[spot(50.0, 2.0), plain.clone()],
            &[spot(1.9, 1.0), plain.clone()],
            &[spot(50.0, 49.0)],
        ] {
            assert!(found(renders).iter().all(Vec::is_empty));
        }
        // In dark regions, rare paths are the only light.
        let dark = Values { mean: vec![0.0; 25], ..plain };
        let mut once = dark.clone();
        (once.mean[SPOT], once.error[SPOT]) = (1.0, 1.0);
        assert!(found(&[once, dark]).iter().all(Vec::is_empty));
    }

    #[test]
    fn outliers_are_replaced_by_their_neighbours() {
        let mut values = spot(50.0, 49.0);
        let of: Vec<bool> = (0..25).map(|p| p == SPOT).collect();
        let taken = replace(&mut values, &of, &[true; 25]);
        assert_eq!((values.mean[SPOT], taken[SPOT]), (1.0, 49.0));
        assert!((values.error[SPOT] - 0.1).abs() < 1e-6);
        assert_eq!(taken.iter().filter(|t| **t != 0.0).count(), 1);
        // A pixel without neighbours keeps its value.
        let mut alone = Values { size: [1, 1], channels: 1, mean: vec![50.0], error: vec![49.0] };
        assert_eq!(replace(&mut alone, &[true], &[true]), [0.0]);
        assert_eq!(alone.mean, [50.0]);
    }
}
