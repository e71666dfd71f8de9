//! Which error bars cannot be trusted yet.
//!
//! Where few samples bring most of the light, a pixel that has met none of them knows neither their light nor that it lacks it:
//! its error is too short, and nothing in its own samples tells. (The fourth moment does not either: it is large in those pixels
//! that have met one, whose errors are long.) Its neighbours see much the same light, and some have met it. So a pixel is in doubt
//! whose error is less than half of the root mean square of the errors around it.

use super::array::Tensor;
use super::axes::Axis;

/// Least share of the errors around.
const LEAST: f64 = 0.5;

/// How many pixels of a slice are in doubt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Doubt {
    /// Pixels with an error: those that have met light which varies, or may have (NaN).
    pub lit: usize,
    /// Those of them whose error is in doubt, or not known.
    pub doubtful: usize,
}

impl Doubt {
    /// Of the standard errors of totals over `y`, `x`, and what [`doubtful`] says of them.
    #[must_use]
    pub fn of(errors: &[f32], doubtful: &[bool]) -> Self {
        let lit = errors.iter().zip(doubtful).filter(|(e, _)| **e != 0.0);
        lit.fold(Self::default(), |all, (_, doubtful)| Self {
            lit: all.lit + 1,
            doubtful: all.doubtful + usize::from(*doubtful),
        })
    }

    /// Share of the lit pixels that is in doubt, 0 to 1.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.doubtful as f64 / self.lit.max(1) as f64
    }
}

/// Whether each of the standard errors of totals (axes `y`, `x`) is in doubt. `single`: each is of one pixel, and those whose
/// coordinates differ by more than one are no neighbours.
#[must_use]
pub fn doubtful(errors: &Tensor, single: bool) -> Vec<bool> {
    let [rows, columns] = &errors.axes[..] else {
        return vec![false; errors.data.len()];
    };
    let width = columns.coords.len();
    let around = |axis: &Axis, i: usize| {
        let beside = |a: usize, b: usize| !single || axis.coords[b] - axis.coords[a] <= 1.0;
        let first = if i > 0 && beside(i - 1, i) { i - 1 } else { i };
        let last = if i + 1 < axis.coords.len() && beside(i, i + 1) {
            i + 1
        } else {
            i
        };
        first..=last
    };
    let columns: Vec<_> = (0..width).map(|x| around(columns, x)).collect();
    let mut all = Vec::with_capacity(errors.data.len());
    for y in 0..rows.coords.len() {
        for x in &columns {
            let (mut squares, mut lit) = (0.0, 0_u32);
            for row in around(rows, y) {
                for error in &errors.data[row * width + x.start()..=row * width + x.end()] {
                    // What is not known tells nothing of its neighbours.
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
        let axis = |kind, coords: &[f64]| Axis {
            kind,
            coords: coords.into(),
            chunk: 1,
        };
        let columns: Vec<f64> = (0..data.len() / rows.len()).map(|x| x as f64).collect();
        Tensor {
            name: "s".into(),
            axes: vec![axis(AxisKind::Y, rows), axis(AxisKind::X, &columns)],
            data: data.into(),
        }
    }

    #[test]
    fn short_errors_beside_long_ones_are_in_doubt() {
        // The middle one among eight: 1 < 9 · ¼ / 9 · Σ e², less than half of their root mean square.
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
    fn dark_ones_are_not_counted_and_unknown_ones_are() {
        let data = [0.0, 1.0, f32::NAN, 1.0];
        let marks = doubtful(&errors(&[0.0], &data), true);
        assert_eq!(marks, [true, false, true, false]);
        assert_eq!(Doubt::of(&data, &marks), Doubt { lit: 3, doubtful: 1 });
        assert_eq!(Doubt::default().share(), 0.0);
    }

    #[test]
    fn rows_apart_are_no_neighbours() {
        let data = [0.1, 0.1, 0.1, 9.0, 9.0, 9.0];
        assert_eq!(doubtful(&errors(&[1.0, 5.0], &data), true), [false; 6]);
        // As boxes of pixels they are.
        let marks = doubtful(&errors(&[1.5, 5.5], &data), false);
        assert_eq!(marks, [true, true, true, false, false, false]);
    }
}
