//! Computes means over a box of pixels around each pixel.

use super::Size;
use rayon::prelude::*;

/// Returns, around each pixel, the means of each channel over the `known` pixels that are at most `radius`
/// rows and columns away. The mean is zero if there is no known pixel in this box. Values of unknown pixels
/// must be zero.
pub fn around(
    values: &[f32],
    [height, width]: Size,
    channels: usize,
    radius: usize,
    known: &[bool],
) -> Vec<f32> {
    let row = width * channels;
    let mut across = vec![0.0; values.len()];
    let mut out = vec![0.0; values.len()];
    if values.is_empty() {
        return out;
    }
    across.par_chunks_mut(row).zip(values.par_chunks(row)).for_each(|(sums, values)| {
        for (x, sum) in sums.chunks_mut(channels).enumerate() {
            for near in x.saturating_sub(radius)..(x + radius + 1).min(width) {
                add(sum, &values[near * channels..][..channels]);
            }
        }
    });
    out.par_chunks_mut(row).enumerate().for_each(|(y, sums)| {
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(height);
        for near in rows.clone() {
            add(sums, &across[near * row..][..row]);
        }
        for (x, sum) in sums.chunks_mut(channels).enumerate() {
            let columns = x.saturating_sub(radius)..(x + radius + 1).min(width);
            let inside = |y: usize| known[y * width..][columns.clone()].iter().filter(|k| **k).count();
            let n = rows.clone().map(inside).sum::<usize>().max(1) as f32;
            sum.iter_mut().for_each(|s| *s /= n);
        }
    });
    out
}

fn add(sum: &mut [f32], values: &[f32]) {
    for (s, v) in sum.iter_mut().zip(values) {
        *s += v;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_use_only_known_neighbours() {
        let size = [3, 4];
        let mut values: Vec<f32> = (0..24).map(|i| i as f32).collect();
        let mut known = [true; 12];
        known[5] = false;
        values[10..12].fill(0.0);
        let got = around(&values, size, 2, 1, &known);
        for y in 0..3_i32 {
            for x in 0..4_i32 {
                let near = |a: i32, b: i32| (y - a).abs() <= 1 && (x - b).abs() <= 1 && (a, b) != (1, 1);
                let all: Vec<f32> = (0..12).filter(|i| near(i / 4, i % 4)).map(|i| (2 * i) as f32).collect();
                let want = all.iter().sum::<f32>() / all.len() as f32;
                let at = (y * 4 + x) as usize;
                assert!((got[2 * at] - want).abs() < 1e-5, "{y} {x}: {} not {want}", got[2 * at]);
                assert!((got[2 * at + 1] - want - 1.0).abs() < 1e-5);
            }
        }
        assert!(around(&[], [0, 4], 2, 1, &[]).is_empty());
    }
}
