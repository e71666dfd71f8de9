//! Structured rows for tests.

use super::moments::MatrixRow;
use optics::sampling::stream::Stream;

/// Returns `n` rows around a mean. The rows have four strong directions and weak variance in all other
/// directions.
pub fn rows(n: u32, seed: u64) -> Vec<MatrixRow> {
    (0..n)
        .map(|k| {
            let mut stream = Stream::new(seed, k, 0);
            let mut uniform = || f64::from(stream.uniform()) - 0.5;
            let strong: [f64; 4] = std::array::from_fn(|_| uniform());
            std::array::from_fn(|i| {
                let x = i as f64;
                let waves = strong.iter().zip(1..).map(|(s, f)| s * (x * f64::from(f)).cos() / f64::from(f));
                0.2 * x + waves.sum::<f64>() + 0.01 * uniform()
            })
        })
        .collect()
}
