//! Detects unreliable error estimates.
//!
//! If a few bright samples contribute most of the light, a pixel without bright samples underestimates both
//! its light and its error. Neither the samples of a pixel nor their fourth moment indicate that bright
//! samples are missing. Neighbouring pixels receive similar light, and some of the neighbours have bright
//! samples. A pixel is therefore marked as unreliable if its error is less than half of the root mean square
//! of the errors around it.

use super::array::Tensor;
use super::axes::Axis;

/// Minimum ratio of a reliable error to the root mean square of the errors around it.
const LEAST: f64 = 0.5;

/// The number of lit pixels of a slice, and the number of lit pixels with unreliable errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Doubt {
    /// Number of lit pixels. A pixel is lit if its error is nonzero or unknown (NaN).
    pub lit: usize,
    /// Number of lit pixels whose error is unreliable or unknown.
    pub doubtful: usize,
}

impl Doubt {
    /// Counts pixels. `errors` are the standard errors of totals (axes `y`, `x`), and `doubtful` are the
    /// marks that [`doubtful`] returns.
    pub fn of(errors: &[f32], doubtful: &[bool]) -> Self {
        let lit = errors.iter().zip(doubtful).filter(|(e, _)| **e != 0.0);
        lit.fold(Self::default(), |all, (_, doubtful)| Self {
            lit: all.lit + 1,
            doubtful: all.doubtful + usize::from(*doubtful),
        })
    }

    /// Returns the fraction of the lit pixels with unreliable errors, 0 to 1.
    pub fn share(&self) -> f64 {
        self.doubtful as f64 / self.lit.max(1) as f64
    }
}

/// Returns, for each of the standard errors of totals (axes `y`, `x`), whether it is unreliable. If `single`
/// is true, each value belongs to one pixel, and pixels whose coordinates differ by more than 1 are not
/// neighbours.
pub fn doubtful(errors: &Tensor, single: bool) -> Vec<bool> {
    let [rows, columns] = &errors.axes[..] else {
        return vec![false; errors.data.len()];
    };
    let width = columns.coords.len();
    let around = |axis: &Axis, i: usize| {
        let beside = |a: usize, b: usize| !single || axis.coords[b] - axis.coords[a] <= 1.0;
        let first = if i > 0 && beside(i - 1, i) { i - 1 } else { i };
        let last = if i + 1 < axis.coords.len() && beside(i, i + 1) { i + 1 } else { i };
        first..=last
    };
    let columns: Vec<_> = (0..width).map(|x| around(columns, x)).collect();
    let mut all = Vec::with_capacity(errors.data.len());
    for y in 0..rows.coords.len() {
        for x in &columns {
            let (mut squares, mut lit) = (0.0, 0_u32);
            for row in around(rows, y) {
                for error in &errors.data[row * width + x.start()..=row * width + x.end()] {
                    // Skip errors that are 0 or unknown.
                    if *error > 0.0 {
                        squares += f64::from(*error).powi(2);
                        lit += 1;
                    }
                }
            }
            let own = f64::from(errors.data[all.len()]);
            all.push(own.is_nan() || own * own * f64::from(lit) < LEAST * LEAST * squares);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axes::AxisKind;

    fn errors(rows: &[f64], data: &[f32]) -> Tensor {
        let axis = |kind, coords: &[f64]| Axis { kind, coords: coords.into(), chunk: 1 };
        let columns: Vec<f64> = (0..data.len() / rows.len()).map(|x| x as f64).collect();
        Tensor {
            name: "s".into(),
            axes: vec![axis(AxisKind::Y, rows), axis(AxisKind::X, &columns)],
            data: data.into(),
        }
    }

    #[test]
    fn errors_much_smaller_than_their_neighbours_are_doubtful() {
        // The centre of 3 × 3 pixels is unreliable if 9 · 1² < ¼ · Σ e². If the condition holds, the error is
        // less than half of the root mean square.
        let mut data = [2.2; 9];
        data[4] = 1.0;
        let marks = doubtful(&errors(&[0.0, 1.0, 2.0], &data), true);
        assert_eq!(marks.iter().filter(|m| **m).count(), 1);
        assert!(marks[4]);
        assert_eq!(Doubt::of(&data, &marks), Doubt { lit: 9, doubtful: 1 });
        data[4] = 1.2;
        assert_eq!(doubtful(&errors(&[0.0, 1.0, 2.0], &data), true), [false; 9]);
    }

    #[test]
    fn dark_pixels_are_not_counted_and_nan_pixels_are() {
        let data = [0.0, 1.0, f32::NAN, 1.0];
        let marks = doubtful(&errors(&[0.0], &data), true);
        assert_eq!(marks, [true, false, true, false]);
        assert_eq!(Doubt::of(&data, &marks), Doubt { lit: 3, doubtful: 1 });
        assert_eq!(Doubt::default().share(), 0.0);
    }

    #[test]
    fn distant_rows_are_not_neighbours() {
        let data = [0.1, 0.1, 0.1, 9.0, 9.0, 9.0];
        assert_eq!(doubtful(&errors(&[1.0, 5.0], &data), true), [false; 6]);
        // Boxes of several pixels at a distance of 4 pixels count as neighbours.
        let marks = doubtful(&errors(&[1.5, 5.5], &data), false);
        assert_eq!(marks, [true, true, true, false, false, false]);
    }
}
