//! Ticks at round numbers for axes and colour bars.

use super::reduce::ruler;
use super::text::{TICK, width};
use crate::spec::SignedScale;

/// Minimum distance between two ticks of an arctan scale, as a fraction of the length of the bar.
const CLOSEST: f64 = 0.05;

/// Ticks of an axis. The ticks have positions (0..1 from the low end of the axis) and labels. A power of ten
/// is factored out of the labels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ticks {
    /// Position (0..1 along the axis) and label of each tick.
    pub marks: Vec<(f64, String)>,
    /// Power of ten that multiplies the labels.
    pub exponent: i32,
}

impl Ticks {
    /// Returns approximately `most` ticks or fewer between `low` and `high`. The ticks are at 1, 2 or 5 times
    /// powers of ten.
    pub fn linear(low: f64, high: f64, most: usize) -> Self {
        let span = high - low;
        if !(span.is_finite() && span > 0.0) {
            return Self::default();
        }
        let largest = low.abs().max(high.abs());
        let magnitude = largest.log10().floor() as i32;
        let exponent = if (-2..=4).contains(&magnitude) { 0 } else { magnitude };
        let step = nice_step(span / most.max(1) as f64);
        let first = (low / step - 1e-9).ceil() as i64;
        let last = (high / step + 1e-9).floor() as i64;
        if !step.is_normal() || last < first || last.saturating_sub(first) > 1000 {
            return Self::default();
        }
        let decimals = (-(step.log10() + 1e-9).floor() as i32 + exponent).clamp(0, 12) as usize;
        let scale = 10_f64.powi(exponent);
        let marks = (first..=last)
            .map(|i| {
                let value = i as f64 * step;
                ((value - low) / span, number(value / scale, decimals))
            })
            .collect();
        Self { marks, exponent }
    }

    /// Returns ticks at whole powers of ten between two powers of ten.
    pub fn decades(low_exp: f64, high_exp: f64) -> Self {
        let span = high_exp - low_exp;
        if !(span.is_finite() && span > 0.0) {
            return Self::default();
        }
        let marks = ((low_exp - 1e-6).ceil() as i32..=(high_exp + 1e-6).floor() as i32)
            .map(|e| ((f64::from(e) - low_exp) / span, format!("10{}", superscript(e))))
            .collect();
        Self { marks, exponent: 0 }
    }

    /// Returns ticks between ± `limit` on [`SignedScale::Arctan`]. The ticks are at 0 and at 1, 2 or 5 times
    /// powers of ten. Ticks that are too close to a tick of larger magnitude are omitted.
    pub fn arctan(limit: f64) -> Self {
        if !(limit.is_normal() && limit > 0.0) {
            return Self::default();
        }
        let magnitude = (limit * (1.0 + 1e-6)).log10().floor() as i32;
        let exponent = if (-2..=4).contains(&magnitude) { 0 } else { magnitude };
        // Position above the middle of the bar, 0..0.5.
        let place = |v: f64| 0.5 * f64::from(SignedScale::Arctan.place((v / limit) as f32));
        let candidates = (magnitude - 2..=magnitude)
            .rev()
            .flat_map(|e| [5.0, 2.0, 1.0].map(|m| m * 10_f64.powi(e)))
            .filter(|v| (0.04..=1.0 + 1e-6).contains(&(v / limit)));
        let mut kept: Vec<f64> = vec![];
        for v in candidates {
            if kept.last().is_none_or(|last| place(*last) - place(v) >= CLOSEST) {
                kept.push(v);
            }
        }
        let least = kept.last().copied().unwrap_or(limit);
        let decimals = (exponent - (least.log10() + 1e-9).floor() as i32).clamp(0, 12) as usize;
        let scale = 10_f64.powi(exponent);
        let mark = |v: f64| ((0.5 + place(v)).clamp(0.0, 1.0), number(v / scale, decimals));
        let negative = kept.iter().map(|v| mark(-v));
        let marks = negative.chain([mark(0.0)]).chain(kept.iter().rev().map(|v| mark(*v))).collect();
        Self { marks, exponent }
    }

    /// Returns ticks of pixel or bin coordinates along `length` image pixels. Labels of a horizontal axis do
    /// not overlap. If the coordinates are not evenly spaced, a subset of the coordinates has labels.
    pub fn coordinates(coords: &[f64], length: f64, horizontal: bool) -> Self {
        let ticks = |most: usize| match ruler(coords) {
            // If all coordinates are whole numbers, all ticks are at whole numbers.
            Some((low, high)) if coords.len() > 1 && coords.iter().all(|c| c.fract() == 0.0) => {
                Self::linear(low, high, most.min((high - low) as usize))
            }
            Some((low, high)) if coords.len() > 1 => Self::linear(low, high, most),
            _ => Self::listed(coords, most),
        };
        let spacing = if horizontal { 70.0 } else { 45.0 };
        let mut most = ((length / spacing) as usize).clamp(1, 10);
        while horizontal && most > 1 && !ticks(most).fit_side_by_side(length) {
            most -= 1;
        }
        ticks(most)
    }

    /// Returns whether the labels fit next to each other into `length` pixels without overlap.
    pub fn fit_side_by_side(&self, length: f64) -> bool {
        self.marks.iter().map(|m| width(&m.1, TICK) + 16.0).sum::<f64>() <= length
    }

    /// Returns labels at approximately `most` entries of a list.
    fn listed(coords: &[f64], most: usize) -> Self {
        let n = coords.len();
        let every = n.div_ceil(most.max(1)).max(1);
        let marks = (0..n)
            .step_by(every)
            .filter(|&i| coords[i].is_finite())
            .map(|i| {
                let decimals = usize::from(coords[i].fract() != 0.0);
                ((i as f64 + 0.5) / n as f64, number(coords[i], decimals))
            })
            .collect();
        Self { marks, exponent: 0 }
    }

    /// Returns a unit with the power of ten that is factored out of the labels.
    pub fn unit(&self, unit: &str) -> String {
        match self.exponent {
            0 => unit.to_owned(),
            e => format!("10{} {unit}", superscript(e)),
        }
    }
}

/// Returns the smallest value of the form 1, 2 or 5 times a power of ten that is at least `raw`.
fn nice_step(raw: f64) -> f64 {
    let base = 10_f64.powf(raw.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * base).find(|s| *s >= raw * (1.0 - 1e-9)).unwrap_or(raw)
}

/// Formats a number with the Unicode minus sign.
fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|b| b == b'0' || b == b'.') => rest.to_owned(),
        Some(rest) => format!("−{rest}"),
        None => text,
    }
}

/// Formats a value with up to three digits, for notes. Examples are `0.0123` and `4.56×10⁻⁷`.
pub fn brief(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let e = value.abs().log10().floor() as i32;
    let short = |v: f64, decimals: usize| {
        let text = number(v, decimals);
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    };
    if (-3..5).contains(&e) {
        return short(value, (2 - e).max(0) as usize);
    }
    format!("{}×10{}", short(value / 10_f64.powi(e), 2), superscript(e))
}

/// Formats an exponent in superscript digits.
fn superscript(e: i32) -> String {
    e.to_string()
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            d => char::from_u32(0x2070 + d.to_digit(10).unwrap_or(0)).unwrap_or(d),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(t: &Ticks) -> Vec<&str> {
        t.marks.iter().map(|m| m.1.as_str()).collect()
    }

    #[test]
    fn linear_ticks_are_round_and_symmetric() {
        let t = Ticks::linear(-1.0, 1.0, 5);
        assert_eq!(labels(&t), ["−1.0", "−0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(t.marks[2].0, 0.5);
        let t = Ticks::linear(0.0, 3.2e-6, 4);
        assert_eq!((labels(&t), t.exponent), (vec!["0", "1", "2", "3"], -6));
        assert_eq!(t.unit("W"), "10⁻⁶ W");
        assert_eq!(labels(&Ticks::linear(-0.5, 319.5, 4)), ["0", "100", "200", "300"]);
        assert_eq!(labels(&Ticks::decades(-3.5, -1.0)), ["10⁻³", "10⁻²", "10⁻¹"]);
    }

    /// Tests that every tick of an arctan scale is at the position of its value.
    #[test]
    fn arctan_ticks_are_at_the_positions_of_their_values() {
        let t = Ticks::arctan(1.0);
        let want = ["−1.00", "−0.20", "−0.10", "−0.05", "0.00", "0.05", "0.10", "0.20", "1.00"];
        assert_eq!(labels(&t), want);
        for (at, label) in &t.marks {
            let v: f64 = label.replace('−', "-").parse().unwrap();
            assert!((at - 0.5 - 0.5 * (8.0 * v).atan() / 8_f64.atan()).abs() < 1e-6, "{at} {label}");
        }
        let t = Ticks::arctan(3.2e-6);
        assert_eq!((t.unit("W"), t.marks.last().unwrap().1.as_str()), ("10⁻⁶ W".into(), "2.0"));
        assert!(t.marks.windows(2).all(|m| m[1].0 - m[0].0 >= CLOSEST - 1e-9), "{t:?}");
        for limit in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-310] {
            assert!(Ticks::arctan(limit).marks.is_empty());
        }
        for e in -300..300 {
            assert!(Ticks::arctan(3.7 * 10_f64.powi(e)).marks.iter().all(|m| (0.0..=1.0).contains(&m.0)));
        }
    }

    #[test]
    fn no_range_has_no_ticks() {
        for (a, b) in [(0.0, 0.0), (1.0, 0.0), (f64::NAN, 1.0), (0.0, f64::INFINITY), (1e300, 1.1e300)] {
            let _ = Ticks::linear(a, b, 5);
        }
        assert!(Ticks::linear(0.0, 0.0, 5).marks.is_empty());
        assert!(Ticks::decades(0.0, f64::NAN).marks.is_empty());
        let t = Ticks::coordinates(&[3.0, 9.0, 40.0], 400.0, true);
        assert_eq!(labels(&t), ["3", "9", "40"]);
        assert!(Ticks::coordinates(&[], 400.0, true).marks.is_empty());
    }

    #[test]
    fn brief_numbers_have_three_digits() {
        assert_eq!(brief(0.012_345), "0.0123");
        assert_eq!(brief(123.4), "123");
        assert_eq!(brief(-4.56e-7), "−4.56×10⁻⁷");
        assert_eq!(brief(0.0), "0");
        assert_eq!((brief(25.0), brief(1e-9)), ("25".into(), "1×10⁻⁹".into()));
    }
}
