//! Computes the differences between two methods on the same renders, and the standard errors of the
//! differences.
//!
//! The difference d(v, s) on variant v at seed s has two crossed random effects, variants and seeds: d = μ +
//! a(v) + b(s) + e. The variance of the mean over V variants and S seeds is σa²/V + σb²/S + σe²/(V S). The
//! unbiased estimate of this variance is (MSa + MSb - MSe)/(V S). MSa, MSb and MSe are the mean squares of
//! the two-way analysis of variance (Searle, Casella & McCulloch 1992, section 4.3). The estimate is limited
//! to at least MSe/(V S). With one seed, the estimate is MSa/V.

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Mean over variants and seeds.
    pub mean: f64,
    /// Standard error, or NaN if the table has a single number.
    pub error: f64,
    /// Number of variants, and number of seeds.
    pub counts: [usize; 2],
}

/// Returns the mean of a table with a row per variant and a column per seed. Rows with a non-finite value are
/// ignored. The result is NaN if all rows are ignored.
pub fn estimate(table: &[Vec<f64>]) -> Estimate {
    let seeds = table.iter().map(Vec::len).min().unwrap_or(0);
    let rows: Vec<&[f64]> =
        table.iter().map(|row| &row[..seeds]).filter(|row| row.iter().all(|v| v.is_finite())).collect();
    let (v, s) = (rows.len() as f64, seeds as f64);
    let counts = [rows.len(), seeds];
    let mean = rows.iter().flat_map(|r| r.iter()).sum::<f64>() / (v * s);
    let row_means: Vec<f64> = rows.iter().map(|r| r.iter().sum::<f64>() / s).collect();
    let column_means: Vec<f64> = (0..seeds).map(|j| rows.iter().map(|r| r[j]).sum::<f64>() / v).collect();
    let spread = |means: &[f64]| means.iter().map(|m| (m - mean).powi(2)).sum::<f64>();
    let of_rows = s * spread(&row_means) / (v - 1.0);
    let of_columns = v * spread(&column_means) / (s - 1.0);
    let error = match (rows.len(), seeds) {
        (0 | 1, 0 | 1) => f64::NAN,
        (_, 1) => (of_rows / v).sqrt(),
        (1, _) => (of_columns / s).sqrt(),
        _ => {
            let rest = rows.iter().zip(&row_means).flat_map(|(row, m)| {
                let column = row.iter().zip(&column_means);
                column.map(move |(d, c)| (d - m - c + mean).powi(2))
            });
            let rest = rest.sum::<f64>() / ((v - 1.0) * (s - 1.0));
            ((of_rows + of_columns - rest).max(rest) / (v * s)).sqrt()
        }
    };
    Estimate { mean, error, counts }
}

/// Returns the mean difference between two tables of equal shape.
pub fn difference(a: &[Vec<f64>], b: &[Vec<f64>]) -> Estimate {
    let rows = a.iter().zip(b);
    let table: Vec<Vec<f64>> = rows.map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect();
    estimate(&table)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn one_seed_gives_the_standard_error_of_the_mean() {
        let table: Vec<Vec<f64>> = [1.0, 2.0, 4.0, 5.0].iter().map(|v| vec![*v]).collect();
        let e = estimate(&table);
        assert_eq!(e.mean, 3.0);
        approx::assert_relative_eq!(e.error, (10.0 / 3.0 / 4.0_f64).sqrt(), epsilon = 1e-12);
        assert!(estimate(&[vec![1.0]]).error.is_nan() && estimate(&[]).mean.is_nan());
    }

    /// The estimated variance is unbiased for crossed effects with known variances.
    #[test]
    fn variance_of_crossed_effects_is_unbiased() {
        let (variants, seeds) = (6, 5);
        let mut state = 12345_u64;
        let mut normal = || {
            // The sum of twelve uniform random numbers in [0, 1), minus six, has mean 0 and variance 1.
            let mut sum = -6.0;
            for _ in 0..12 {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                sum += (state >> 33) as f64 / f64::from(1_u32 << 31);
            }
            sum
        };
        let (sa, sb, se) = (1.0, 0.7, 0.5);
        let truth: f64 = sa * sa / 6.0 + sb * sb / 5.0 + se * se / 30.0;
        let trials = 4000;
        let (mut stated, mut squares, mut seen) = (0.0, 0.0, 0.0);
        for _ in 0..trials {
            let b: Vec<f64> = (0..seeds).map(|_| sb * normal()).collect();
            let table: Vec<Vec<f64>> = (0..variants)
                .map(|_| {
                    let a = sa * normal();
                    b.iter().map(|b| a + b + se * normal()).collect()
                })
                .collect();
            let e = estimate(&table);
            stated += e.error * e.error;
            squares += e.error.powi(4);
            seen += e.mean * e.mean;
        }
        let n = f64::from(trials);
        let error = ((squares / n - (stated / n).powi(2)) / n).sqrt();
        assert!((stated / n - truth).abs() < 5.0 * error, "{} ± {error}, truth {truth}", stated / n);
        // The estimated variance agrees with the variance of the means. The relative standard error of a
        // variance from n samples is √(2/n).
        assert!((seen / n / truth - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
        // As a deliberate error, all numbers are treated as independent. The resulting variance is far too
        // small.
        assert!(truth > 2.0 * (sa * sa + sb * sb + se * se) / 30.0);
    }

    proptest! {
        #[test]
        fn common_variation_cancels_in_differences(rows in prop::collection::vec(prop::collection::vec(-9.0..9.0_f64, 4), 2..8), shift in -3.0..3.0_f64) {
            let moved: Vec<Vec<f64>> = rows.iter().map(|r| r.iter().map(|v| v + shift).collect()).collect();
            let d = difference(&moved, &rows);
            prop_assert!((d.mean - shift).abs() < 1e-9 && d.error < 1e-9);
        }
    }
}
