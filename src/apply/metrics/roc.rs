//! Computes the area under the receiver operating characteristic. The area is the probability that a positive
//! has a higher score than a negative. A tie contributes one half.
//!
//! The variance of the area is computed with the equation of DeLong, DeLong & Clarke-Pearson (1988, eq. 5).
//! The equation uses placements, which are fractions of the other class with lower or higher scores. The
//! placements are computed from ranks (Sun & Xu 2014). For dependent scores, such as pixels of one object,
//! the variance is estimated by bootstrap over groups.

use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::{Rng, SeedableRng};

/// An area under the ROC curve with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// The area in the range 0..1, or NaN without positives or negatives.
    pub area: f64,
    pub error: f64,
    /// Lower and upper ends of the 95 % confidence interval, within 0..1.
    pub interval: [f64; 2],
}

/// Half the width of a 95 % interval of a normal distribution, in standard deviations.
const NORMAL_95: f64 = 1.959963984540054;

/// Returns the area for scores of positives and negatives (the normalized Mann–Whitney statistic).
pub fn area(positive: &[f64], negative: &[f64]) -> f64 {
    let negative = sorted(negative);
    positive.iter().map(|x| below(&negative, *x)).sum::<f64>() / positive.len() as f64
}

/// Returns the area with DeLong's standard error. The scores must be independent.
pub fn delong(positive: &[f64], negative: &[f64]) -> Area {
    let (of_positive, of_negative) = placements(positive, negative);
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let area = mean(&of_positive);
    let variance = |v: &[f64]| {
        let m = mean(v);
        v.iter().map(|x| (x - m).powi(2)).sum::<f64>() / (v.len() as f64 - 1.0)
    };
    let of = |v: &[f64]| variance(v) / v.len() as f64;
    let error = (of(&of_positive) + of(&of_negative)).sqrt();
    Area { area, error, interval: [-1.0, 1.0].map(|side| (area + side * NORMAL_95 * error).clamp(0.0, 1.0)) }
}

/// Returns two lists of fractions. The first contains, for each positive, the fraction of negatives with
/// lower scores. The second contains, for each negative, the fraction of positives with higher scores. A tie
/// contributes one half.
fn placements(positive: &[f64], negative: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (p, n) = (sorted(positive), sorted(negative));
    let of_positive = positive.iter().map(|x| below(&n, *x)).collect();
    let of_negative = negative.iter().map(|x| 1.0 - below(&p, *x)).collect();
    (of_positive, of_negative)
}

fn sorted(v: &[f64]) -> Vec<f64> {
    let mut v = v.to_vec();
    v.sort_unstable_by(f64::total_cmp);
    v
}

/// Returns the fraction of sorted values that are below `x`. A tie contributes one half.
fn below(all: &[f64], x: f64) -> f64 {
    let less = all.partition_point(|v| *v < x);
    let not_more = all.partition_point(|v| *v <= x);
    0.5 * (less + not_more) as f64 / all.len() as f64
}

/// Scores of the pixels of one group, such as an object or a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Group {
    pub positive: Vec<f64>,
    pub negative: Vec<f64>,
}

/// Returns the area for the scores of all groups together. The error and the percentile interval are computed
/// from `draws` bootstrap samples of whole groups (Efron & Tibshirani 1993, chapter 13). Samples without
/// positives or negatives are drawn again.
pub fn bootstrap(groups: &[Group], draws: usize, seed: u64) -> Area {
    let pooled = |chosen: &[usize]| {
        let take = |f: fn(&Group) -> &Vec<f64>| -> Vec<f64> {
            chosen.iter().flat_map(|i| f(&groups[*i]).iter().copied()).collect()
        };
        area(&take(|g| &g.positive), &take(|g| &g.negative))
    };
    let all: Vec<usize> = (0..groups.len()).collect();
    let whole = pooled(&all);
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut found = vec![];
    // At least one of this number of samples contains positives and negatives, unless all groups lack
    // positives or all groups lack negatives.
    for _ in 0..10 * draws {
        if found.len() == draws || !whole.is_finite() {
            break;
        }
        let chosen: Vec<usize> =
            all.iter().map(|_| (random.next_u64() % groups.len().max(1) as u64) as usize).collect();
        let value = pooled(&chosen);
        if value.is_finite() {
            found.push(value);
        }
    }
    found.sort_by(f64::total_cmp);
    let n = found.len() as f64;
    let mean = found.iter().sum::<f64>() / n;
    let error = (found.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let at = |share: f64| {
        let place = (share * (n - 1.0)).round().max(0.0) as usize;
        found.get(place).copied().unwrap_or(f64::NAN)
    };
    Area { area: whole, error, interval: [at(0.025), at(0.975)] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(seed: u64, n: usize) -> Vec<f64> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        (0..n).map(|_| (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64).collect()
    }

    #[test]
    fn small_cases_match_hand_calculation() {
        assert_eq!(area(&[3.0, 4.0], &[1.0, 2.0]), 1.0);
        assert_eq!(area(&[1.0, 2.0], &[3.0, 4.0]), 0.0);
        assert_eq!(area(&[1.0, 3.0], &[2.0, 2.0]), 0.5);
        // The pairs are 2 > 1, 2 = 2, 5 > 1 and 5 > 2.
        assert_eq!(area(&[2.0, 5.0], &[1.0, 2.0]), 3.5 / 4.0);
        assert!(area(&[], &[1.0]).is_nan() && area(&[1.0], &[]).is_nan());
        // DeLong's components are computed by hand. The placements are (0.75, 1) and (1, 0.75). Each of the
        // two variances is 1/32, which is divided by 2.
        let a = delong(&[2.0, 5.0], &[1.0, 2.0]);
        approx::assert_relative_eq!(a.error, (2.0 * (1.0 / 32.0) / 2.0_f64).sqrt(), epsilon = 1e-12);
    }

    /// Areas and their errors agree with the closed form 1 - (1 - d)²/2. The positives are uniformly
    /// distributed on 0..1, and the negatives are uniformly distributed on -d..1-d.
    #[test]
    fn delong_intervals_cover_the_closed_form() {
        let d = 0.3;
        let truth = 1.0 - (1.0_f64 - d).powi(2) / 2.0;
        let trials = 2000;
        let (mut covered, mut stated, mut seen) = (0, 0.0, 0.0);
        for k in 0..trials {
            let positive = numbers(2 * k, 60);
            let negative: Vec<f64> = numbers(2 * k + 1, 40).iter().map(|x| x - d).collect();
            let a = delong(&positive, &negative);
            covered += i32::from(a.interval[0] <= truth && truth <= a.interval[1]);
            stated += a.error * a.error;
            seen += (a.area - truth).powi(2);
        }
        let n = trials as f64;
        // The estimated variance equals the variance of the areas. The relative standard error of a variance
        // from n samples is √(2/n).
        assert!((stated / seen - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{}", stated / seen);
        let share = f64::from(covered) / n;
        // The coverage is 95 % minus the error of the normal approximation at these counts.
        assert!((0.92..0.97).contains(&share), "{share}");
    }

    #[test]
    fn correlated_groups_have_larger_errors_than_delong() {
        // Every group has a random shift that is common to the twenty scores of the group.
        let shifts = numbers(5, 40);
        let groups: Vec<Group> = shifts
            .chunks_exact(2)
            .map(|s| Group { positive: vec![s[0] + 0.2; 20], negative: vec![s[1]; 20] })
            .collect();
        let take = |f: fn(&Group) -> &Vec<f64>| groups.iter().flat_map(|g| f(g).clone()).collect::<Vec<_>>();
        let naive = delong(&take(|g| &g.positive), &take(|g| &g.negative));
        let grouped = bootstrap(&groups, 2000, 1);
        assert_eq!(naive.area, grouped.area);
        // The effective number of independent scores is the number of groups, so DeLong's method is
        // applied with one score per group.
        let single = delong(
            &groups.iter().map(|g| g.positive[0]).collect::<Vec<_>>(),
            &groups.iter().map(|g| g.negative[0]).collect::<Vec<_>>(),
        );
        assert!((grouped.error / single.error - 1.0).abs() < 0.15, "{} {}", grouped.error, single.error);
        assert!(naive.error < 0.3 * grouped.error);
        assert!(bootstrap(&groups, 2000, 1) == grouped, "the same seed, the same draws");
        assert!(bootstrap(&[], 100, 1).area.is_nan());
    }
}
