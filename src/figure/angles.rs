//! Draws the angles of rotating elements over the captures of a scheme, as in figure 4(c, d) of Baek & Heide
//! (2021). Each element has its own panel.
//!
//! Angles are drawn modulo the period of the element, which is 180° for polarizers and retarders.

use super::drawing::{Drawing, Point, Rect};
use super::error::FigureError;
use super::layout::{Axis, GRID, Page, Panels};
use super::marker::{Marker, palette};
use super::text::{INK, LABEL, NAME, TICK, fit, width};
use super::ticks::{Ticks, brief};

/// Width and height of a panel in pixels.
const SIZE: (f64, f64) = (900.0, 140.0);
/// Space above a panel for the name, in pixels.
const HEAD: f64 = 34.0;
/// Fraction of the period by which a panel extends beyond each end. The extension prevents clipping of
/// markers at the ends.
const BEYOND: f64 = 0.08;
/// Maximum number of panels on a page.
const MOST: usize = 8;

/// Draws the angles of a scheme. `elements` contains the name, the axis label with unit (`"angle / °"`) and
/// the period of the angle of every element. `values[capture][element]` is the angle in the units of the
/// label. Non-finite angles leave gaps.
///
/// # Errors
/// [`FigureError::Option`] in the following cases:
/// - There is no capture.
/// - There is no element, or there are more than eight.
/// - A capture has the wrong number of angles.
/// - A period is not a finite positive number.
pub fn draw(
    title: &str,
    elements: &[(&str, &str, f64)],
    values: &[Vec<f64>],
) -> Result<Drawing, FigureError> {
    check(elements, values)?;
    let panels = Panels { size: SIZE, head: HEAD, gap: 0.0, columns: 1 };
    let (wide, high) = panels.extent(elements.len());
    // The page has one long axis with the ticks of all panels. The labels of the panels replace the label of
    // this axis.
    let quarters = || (0..=4).map(|quarter| f64::from(quarter) / 4.0);
    let ticks = |i: usize| {
        let (top, period) = (panels.corner(i).1, elements[i].2);
        quarters().map(move |part| (1.0 - (top + row(part)) / high, brief(part * period)))
    };
    let marks: Vec<(f64, String)> = (0..elements.len()).flat_map(ticks).collect();
    let widest = marks.iter().map(|m| width(&m.1, TICK)).fold(0.0, f64::max);
    let page = Page {
        title,
        x: Axis::new("capture", captures(values.len())),
        y: Axis::new(" ", Ticks { marks, exponent: 0 }),
        frameless: true,
        ..Page::default()
    };
    let mut page = page.draw(wide, high);
    let label_x = (page.data.x - widest.ceil() - 22.0 - LABEL.em / 2.0).max(LABEL.em / 2.0);
    let radius = (0.4 * SIZE.0 / values.len() as f64).clamp(1.2, 4.8);
    for (i, (name, label, period)) in elements.iter().enumerate() {
        let panel = panels.place(&page, i);
        for part in quarters() {
            page.tick((panel.x, panel.y + row(part)), (panel.w, 0.0), GRID);
        }
        page.frame(panel, INK);
        panels.name(&mut page, i, &[(name, NAME)]);
        let (text, style) = fit(label, LABEL, panel.h);
        page.text_up(&text, (label_x, panel.centre().1), style);
        for (k, angles) in values.iter().enumerate() {
            if let Some(part) = part(angles[i], *period) {
                page.marker(Marker::of(i), place(panel, k, values.len(), part), radius, palette(i));
            }
        }
    }
    Ok(page)
}

/// Returns the position on the page of capture `k` of `n`. `part` is the angle as a fraction of the element's
/// period.
fn place(panel: Rect, k: usize, n: usize, part: f64) -> Point {
    (panel.x + (k as f64 + 0.5) / n as f64 * panel.w, panel.y + row(part))
}

/// Returns an angle as a fraction of the period, from 0 to below 1.
fn part(angle: f64, period: f64) -> Option<f64> {
    let part = angle.rem_euclid(period) / period;
    part.is_finite().then_some(if part < 1.0 { part } else { 0.0 })
}

/// Returns the distance of a fraction of the period from the upper edge of the panel, in pixels.
fn row(part: f64) -> f64 {
    (1.0 + BEYOND - part) / (1.0 + 2.0 * BEYOND) * SIZE.1
}

/// Returns ticks at the first capture and at round capture numbers, counted from 1.
fn captures(n: usize) -> Ticks {
    const MOST_LABELS: usize = 18;
    let step = (0..)
        .take(19)
        .flat_map(|e| [1, 2, 5].map(|m| m * 10_usize.pow(e)))
        .find(|s| n / s <= MOST_LABELS)
        .unwrap_or(n);
    let first = (step >= 5).then_some(1);
    let rest = (1..=n / step.max(1)).map(|i| i * step);
    let marks = first.into_iter().chain(rest).map(|k| ((k as f64 - 0.5) / n as f64, k.to_string())).collect();
    Ticks { marks, exponent: 0 }
}

fn check(elements: &[(&str, &str, f64)], values: &[Vec<f64>]) -> Result<(), FigureError> {
    let refuse = |option, value: String, must| Err(FigureError::option(option, value, must));
    if elements.is_empty() || elements.len() > MOST {
        return refuse("elements", elements.len().to_string(), "1 to 8 rotating elements");
    }
    if values.is_empty() {
        return refuse("values", "empty".into(), "the angles of at least one capture");
    }
    if let Some((name, _, period)) = elements.iter().find(|e| !(e.2.is_normal() && e.2 > 0.0)) {
        let value = format!("{period} for `{name}`");
        return refuse("period", value, "a finite number above zero");
    }
    if let Some((k, row)) = values.iter().enumerate().find(|v| v.1.len() != elements.len()) {
        let value = format!("{} angles at capture {}", row.len(), k + 1);
        return refuse("values", value, "one angle per element at every capture");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TWO: [(&str, &str, f64); 2] =
        [("polarizer 1", "angle / °", 180.0), ("retarder 2", "angle / °", 180.0)];

    /// Tests that every angle has a marker in the correct panel, column and row. An angle plus one period
    /// must have the same position.
    #[test]
    fn angles_are_drawn_at_their_positions() {
        let values = vec![vec![45.0, 0.0], vec![f64::NAN, 90.0], vec![-45.0, 270.0], vec![0.0, 180.0]];
        let drawing = draw("t", &TWO, &values).unwrap();
        let img = drawing.pixels().unwrap();
        let pixel = |panel: usize, capture: usize, degrees: f64| {
            let top = panel as f64 * (HEAD + SIZE.1) + HEAD;
            let panel = drawing.data.within((0.0, top), SIZE);
            let (x, y) = place(panel, capture, 4, degrees / 180.0);
            *img.get_pixel(x as u32, y as u32)
        };
        for (panel, capture, degrees) in
            [(0, 0, 45.0), (0, 2, 135.0), (0, 3, 0.0), (1, 0, 0.0), (1, 1, 90.0), (1, 2, 90.0), (1, 3, 0.0)]
        {
            assert_eq!(pixel(panel, capture, degrees), palette(panel), "{panel} {capture}");
            assert_ne!(pixel(panel, capture, degrees + 22.0), palette(panel));
        }
        for degrees in 0..180 {
            assert_ne!(pixel(0, 1, f64::from(degrees)), palette(0), "no marker without an angle");
        }
    }

    #[test]
    fn captures_are_counted_from_one() {
        let labels = |n| -> Vec<String> { captures(n).marks.into_iter().map(|m| m.1).collect() };
        assert_eq!(labels(3), ["1", "2", "3"]);
        assert_eq!(labels(1), ["1"]);
        assert_eq!(labels(100)[..3], ["1", "10", "20"]);
        assert!(labels(usize::MAX).len() < 30);
    }

    #[test]
    fn invalid_tables_are_refused() {
        let message = |elements: &[(&str, &str, f64)], values: &[Vec<f64>]| {
            draw("t", elements, values).expect_err("was drawn").to_string()
        };
        assert!(message(&[], &[vec![]]).contains("1 to 8"));
        assert!(message(&TWO, &[]).contains("at least one capture"));
        assert!(message(&TWO, &[vec![1.0; 2], vec![1.0]]).contains("1 angles at capture 2"));
        for period in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(message(&[("a", "b", period)], &[vec![1.0]]).contains("`a`"));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn arbitrary_tables_never_panic(
            n in 1_usize..5,
            period in prop_oneof![Just(180.0), Just(1e-300), Just(f64::MAX), any::<f64>()],
            angles in prop::collection::vec(any::<f64>(), 4..200),
            name in ".{0,60}",
        ) {
            let elements: Vec<(&str, &str, f64)> = (0..n).map(|_| (name.as_str(), name.as_str(), period)).collect();
            let values: Vec<Vec<f64>> = angles.chunks_exact(n).map(<[f64]>::to_vec).collect();
            let _ = draw(&name, &elements, &values);
        }
    }
}
