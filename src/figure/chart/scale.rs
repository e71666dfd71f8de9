//! Computes the scale of a chart's axis. The scale consists of the range, the positions of values along the
//! axis, and the ticks.

use super::series::ChartAxis;
use crate::drawing::{Point, Rect};
use crate::error::FigureError;
use crate::ticks::{Ticks, brief};

/// Maximum magnitude of the ends of automatic ranges. With this limit, the difference of the ends stays
/// finite.
const LARGEST: f64 = 1e300;
/// Margin beyond the outermost values, as a fraction of the range of values.
const MARGIN: f64 = 0.04;
/// Minimum range relative to the values. The labels of a narrower range would be equal.
const NARROWEST: f64 = 1e-9;

/// Maps values to positions 0..1 along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    log: bool,
    /// Value at the low end of the axis, or the base-10 logarithm of this value if the axis is logarithmic.
    low: f64,
    high: f64,
}

/// Maps data coordinates to pixels of the page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scales {
    pub(crate) x: Scale,
    pub(crate) y: Scale,
    pub(crate) plot: Rect,
}

impl Scales {
    /// Returns the page position in pixels of a point. The position may be far outside the plot.
    pub(crate) fn point(&self, (x, y): (f64, f64)) -> Option<Point> {
        let (x, y) = (self.x.place(x)?, self.y.place(y)?);
        let r = self.plot;
        Some((r.x + x * r.w, r.y + (1.0 - y) * r.h))
    }
}

/// The labelled and unlabelled ticks of an axis.
#[derive(Clone, Debug, Default)]
pub struct Marks {
    pub major: Ticks,
    /// Positions of unlabelled ticks, 0..1 along the axis.
    pub minor: Vec<f64>,
}

impl Scale {
    /// Returns the scale of an axis with the given range. Without a given range, the range contains all
    /// values that the axis can show.
    ///
    /// # Errors
    /// [`FigureError::Option`] with the name `option` if the given range is invalid. A range is invalid in
    /// the following cases:
    /// - The range is not finite or is empty.
    /// - The range is narrower than a billionth of its values.
    /// - The range is not positive, and the axis is logarithmic.
    pub fn new(
        axis: &ChartAxis,
        option: &'static str,
        values: impl Iterator<Item = f64>,
    ) -> Result<Self, FigureError> {
        let log = axis.log;
        let along = |v: f64| if log { v.log10() } else { v };
        if let Some((low, high)) = axis.range {
            let (a, b) = (along(low), along(high));
            let wide = (b - a).is_finite() && b - a > NARROWEST * a.abs().max(b.abs()).max(1e-290);
            if !wide {
                let must = if log {
                    "two finite numbers above zero, the smaller one first"
                } else {
                    "two finite numbers, the smaller one first"
                };
                return Err(FigureError::option(option, format!("{low:e} to {high:e}"), must));
            }
            return Ok(Self { log, low: a, high: b });
        }
        let shown = values.map(along).filter(|v| v.is_finite());
        let (a, b) = shown.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            let v = v.clamp(-LARGEST, LARGEST);
            (a.min(v), b.max(v))
        });
        let (a, b) = if a <= b { (a, b) } else { (0.0, 1.0) };
        let largest = a.abs().max(b.abs());
        let least = if log { 0.02 } else { (NARROWEST * largest).max(1e-290) };
        // If all values are equal, the range is extended so that the axis has ticks.
        let pad = if b - a > least {
            MARGIN * (b - a)
        } else if log {
            0.2
        } else if largest > 1e-290 {
            0.1 * largest
        } else {
            1.0
        };
        Ok(Self { log, low: a - pad, high: b + pad })
    }

    /// Returns the position of a value, 0..1 from the low end of the axis. Returns `None` if the value is not
    /// finite. On a logarithmic axis, also returns `None` for a value that is not positive.
    pub fn place(&self, value: f64) -> Option<f64> {
        let v = if self.log { value.log10() } else { value };
        // Distant values are clamped, so that later differences stay finite.
        let place = ((v - self.low) / (self.high - self.low)).clamp(-1e3, 1e3);
        v.is_finite().then_some(place)
    }

    /// Returns ticks with approximately `most` labels or fewer.
    pub fn marks(&self, most: usize) -> Marks {
        let mut marks = if !self.log {
            Marks { major: Ticks::linear(self.low, self.high, most), minor: vec![] }
        } else if self.high - self.low >= 2.0 {
            self.decades(most)
        } else {
            self.within_decades(most)
        };
        let on = |at: f64| (-1e-6..=1.0 + 1e-6).contains(&at);
        marks.major.marks.retain(|m| on(m.0));
        marks.minor.retain(|&at| on(at));
        marks
    }

    /// Returns ticks as in [`Scale::marks`]. The number of labels is the largest that fits into `length`
    /// pixels without overlap.
    pub fn marks_across(&self, length: f64) -> Marks {
        let mut most = 10;
        while most > 2 && !self.marks(most).major.fit_side_by_side(length) {
            most -= 1;
        }
        self.marks(most)
    }

    /// Returns the values `m` × 10ⁿ in the range of the axis, and the positions of these values.
    fn multiples(&self, m: f64) -> impl Iterator<Item = (f64, f64)> {
        let (low, span) = (self.low, self.high - self.low);
        (self.low.floor() as i32..=self.high.ceil() as i32).map(move |e| {
            let at = (f64::from(e) + m.log10() - low) / span;
            (m * 10_f64.powi(e), at)
        })
    }

    fn decades(&self, most: usize) -> Marks {
        let mut major = Ticks::decades(self.low, self.high);
        let every = major.marks.len().div_ceil(most.max(1)).max(1);
        if every > 1 {
            let first = (self.low - 1e-6).ceil() as i32;
            let mut e = first - 1;
            major.marks.retain(|_| {
                e += 1;
                e.rem_euclid(every as i32) == 0
            });
            let minor = self.multiples(1.0).map(|t| t.1).collect();
            return Marks { major, minor };
        }
        let minor = (2..10).flat_map(|m| self.multiples(f64::from(m))).map(|t| t.1);
        Marks { minor: minor.collect(), major }
    }

    /// Returns ticks with labels at 1, 2 and 5 times powers of ten. If the axis contains few of these values,
    /// the labels are at round steps.
    fn within_decades(&self, most: usize) -> Marks {
        let on = |t: &(f64, f64)| (0.0..=1.0).contains(&t.1);
        let mut round: Vec<(f64, f64)> =
            [1.0, 2.0, 5.0].into_iter().flat_map(|m| self.multiples(m)).filter(on).collect();
        round.sort_by(|a, b| a.1.total_cmp(&b.1));
        let minor = (1..10).flat_map(|m| self.multiples(f64::from(m))).map(|t| t.1).collect();
        if round.len() >= 3 {
            let marks = round.into_iter().map(|(v, at)| (at, brief(v))).collect();
            let major = Ticks { marks, exponent: 0 };
            return Marks { major, minor };
        }
        let (low, high) = (10_f64.powf(self.low), 10_f64.powf(self.high));
        let mut major = Ticks::linear(low, high, most.min(6));
        for (at, _) in &mut major.marks {
            *at = self.place(low + *at * (high - low)).unwrap_or(-1.0);
        }
        Marks { major, minor: vec![] }
    }
}

/// Returns ticks at the named values of an axis, or the ticks of the scale if there are no named values.
pub fn marks(axis: &ChartAxis, scale: &Scale, default: impl FnOnce(&Scale) -> Marks) -> Marks {
    if axis.named.is_empty() {
        return default(scale);
    }
    let mark = |(v, name): &(f64, String)| {
        let at = scale.place(*v).filter(|at| (0.0..=1.0).contains(at))?;
        Some((at, name.clone()))
    };
    let marks = axis.named.iter().filter_map(mark).collect();
    Marks { major: Ticks { marks, exponent: 0 }, minor: vec![] }
}

/// Returns an axis label that contains the power of ten factored out of the tick labels. If a bracketed unit
/// ends the label, the power is inserted before the unit.
pub fn label(text: &str, ticks: &Ticks) -> String {
    let text = text.trim();
    let unit = text.strip_suffix(']').and_then(|t| t.rsplit_once('['));
    match (ticks.exponent, unit) {
        (0, _) => text.to_owned(),
        (_, Some((name, unit))) => format!("{name}[{}]", ticks.unit(unit)),
        (_, None) => format!("{text} (× {})", ticks.unit("").trim()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(log: bool, range: Option<(f64, f64)>) -> ChartAxis {
        ChartAxis { label: String::new(), log, range, named: vec![] }
    }

    fn labels(axis: &ChartAxis) -> Vec<String> {
        let marks = Scale::new(axis, "y range", [].into_iter()).unwrap().marks(8);
        marks.major.marks.into_iter().map(|m| m.1).collect()
    }

    #[test]
    fn log_scales_mark_powers_of_ten() {
        let s = Scale::new(&axis(true, Some((1.0, 100.0))), "y range", [].into_iter()).unwrap();
        assert_eq!(s.place(10.0), Some(0.5));
        assert_eq!((s.place(0.0), s.place(-1.0), s.place(f64::NAN)), (None, None, None));
        let marks = s.marks(8);
        assert_eq!(marks.major.marks[1], (0.5, "10¹".to_owned()));
        assert_eq!(marks.minor.len(), 16);
    }

    #[test]
    fn labels_suit_the_span() {
        assert_eq!(labels(&axis(true, Some((3.0, 40.0)))), ["5", "10", "20"]);
        assert_eq!(labels(&axis(true, Some((0.01, 0.5)))), ["0.01", "0.02", "0.05", "0.1", "0.2", "0.5"]);
        assert_eq!(
            labels(&axis(true, Some((1.1, 1.4)))),
            ["1.10", "1.15", "1.20", "1.25", "1.30", "1.35", "1.40"]
        );
        let far = labels(&axis(true, Some((1e-200, 1e200))));
        assert!((4..=9).contains(&far.len()), "{far:?}");
        assert_eq!(
            labels(&axis(false, Some((0.0, 4.0)))),
            ["0.0", "0.5", "1.0", "1.5", "2.0", "2.5", "3.0", "3.5", "4.0"]
        );
    }

    #[test]
    fn powers_of_ten_are_moved_to_the_unit() {
        let ticks = Ticks { marks: vec![], exponent: -6 };
        assert_eq!(label("power [W]", &ticks), "power [10⁻⁶ W]");
        assert_eq!(label("loss ", &ticks), "loss (× 10⁻⁶)");
        assert_eq!(label("loss", &Ticks::default()), "loss");
    }

    #[test]
    fn empty_and_invalid_ranges_are_refused() {
        for (log, range) in [
            (false, (1.0, 1.0)),
            (false, (2.0, 1.0)),
            (false, (f64::NAN, 1.0)),
            (false, (0.0, f64::INFINITY)),
            (false, (1.0, 1.0 + 1e-12)),
            (false, (-1.7e308, 1.7e308)),
            (true, (0.0, 1.0)),
            (true, (-1.0, 1.0)),
        ] {
            let e = Scale::new(&axis(log, Some(range)), "x range", [].into_iter());
            assert!(matches!(e, Err(FigureError::Option { .. })), "{log} {range:?}");
        }
    }

    #[test]
    fn automatic_ranges_hold_every_value() {
        let values = [0.0, -0.0, 1e-310, 5.0, 5.0 + 1e-15, -3e307, f64::MAX, f64::NAN];
        for log in [false, true] {
            for a in values {
                for b in values {
                    let s = Scale::new(&axis(log, None), "y range", [a, b].into_iter()).unwrap();
                    for v in [a, b] {
                        let far = !log && v.abs() > LARGEST;
                        assert!(far || s.place(v).is_none_or(|p| (0.0..=1.0).contains(&p)), "{a} {b} {s:?}");
                    }
                    assert!(s.high > s.low && (s.high - s.low).is_finite(), "{a} {b} {s:?}");
                    let _ = s.marks_across(900.0);
                }
            }
        }
    }
}
