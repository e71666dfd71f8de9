//! Angles of rotating elements over the captures of an acquisition scheme, one panel per element, as in figure 4(c, d)
//! of Baek & Heide 2021.
//!
//! Angles are drawn modulo the period of their element: 180° for polarizers and retarders.

use image::{Rgb, RgbImage};

use super::FigureError;
use super::layout::{Axis, Page, Rect, fill, frame};
use super::stroke::{Marker, Mask, palette};
use super::text::{Align, INK, LABEL, Style, TICK, fit, width, write, write_up};
use super::ticks::{Ticks, brief};

/// Width and height of a panel, and the room above it for the name, in pixels.
const WIDTH: u32 = 900;
const HEIGHT: u32 = 140;
const NAME: u32 = 34;
/// A panel goes on beyond 0 and beyond the period by this share of it, so that markers there are whole.
const BEYOND: f64 = 0.08;
/// A page has at most this many panels.
const MOST: usize = 8;
const GRID: Rgb<u8> = Rgb([232, 232, 236]);
const HEAD: Style = Style {
    em: 16.0,
    bold: true,
    colour: INK,
};

/// Draws the angles of a scheme. Every element has a name, the label of its axis with unit (`"angle / °"`) and the
/// period of its angle; `values[capture][element]` are the angles in that unit. Angles that are not finite leave gaps.
///
/// # Errors
/// [`FigureError::Option`] if there is no capture, no element or more than eight, a capture has another number of
/// angles than there are elements, or a period is not a finite number above zero.
pub fn draw(
    title: &str,
    elements: &[(&str, &str, f64)],
    values: &[Vec<f64>],
) -> Result<RgbImage, FigureError> {
    Ok(draw_with_panels(title, elements, values)?.0)
}

/// As [`draw`], together with the rectangles of the panels.
fn draw_with_panels(
    title: &str,
    elements: &[(&str, &str, f64)],
    values: &[Vec<f64>],
) -> Result<(RgbImage, Vec<Rect>), FigureError> {
    check(elements, values)?;
    let n = elements.len() as u32;
    let high = n * (NAME + HEIGHT);
    let top = |i: usize| i as u32 * (NAME + HEIGHT) + NAME;
    // The page has the ticks of all panels on one long axis; the labels of the panels go into the room of its label.
    let mut marks = Vec::new();
    let mut widest = 0.0_f32;
    for (i, (_, _, period)) in elements.iter().enumerate() {
        for quarter in 0..=4 {
            let part = f64::from(quarter) / 4.0;
            let from_top = f64::from(top(i)) + row(part);
            let label = brief(part * period);
            widest = widest.max(width(&label, TICK)?);
            marks.push((1.0 - from_top / f64::from(high), label));
        }
    }
    let page = Page {
        title,
        x: Axis {
            label: "capture".into(),
            ticks: captures(values.len()),
            downward: false,
        },
        y: Axis {
            label: " ".into(),
            ticks: Ticks { marks, exponent: 0 },
            downward: false,
        },
        frameless: true,
        ..Page::default()
    };
    let (mut img, all) = page.draw(WIDTH, high)?;
    let label_x = (all.x as f32 - widest.ceil() - 22.0 - LABEL.em / 2.0).max(LABEL.em / 2.0);
    let mut panels = Vec::with_capacity(elements.len());
    for (i, (name, label, period)) in elements.iter().enumerate() {
        let panel = Rect {
            y: all.y + top(i),
            h: HEIGHT,
            ..all
        };
        for quarter in 0..=4 {
            let y = panel.y + (row(f64::from(quarter) / 4.0) - 0.5).round() as u32;
            fill(&mut img, Rect { y, h: 1, ..panel }, GRID);
        }
        frame(&mut img, panel, INK);
        let (text, style) = fit(name, HEAD, panel.w as f32)?;
        let at = (panel.x as f32, (panel.y - NAME / 2) as f32 + 2.0);
        write(&mut img, &text, at, Align::Start, style)?;
        let (text, style) = fit(label, LABEL, HEIGHT as f32)?;
        let at = (label_x, panel.y as f32 + panel.h as f32 / 2.0);
        write_up(&mut img, &text, at, Align::Middle, style)?;
        let mut mask = Mask::over(panel);
        let radius = (0.4 * WIDTH as f32 / values.len() as f32).clamp(1.2, 4.8);
        for (k, angles) in values.iter().enumerate() {
            let Some(part) = angles.get(i).and_then(|a| part(*a, *period)) else {
                continue;
            };
            let x = (k as f64 + 0.5) / values.len() as f64 * f64::from(WIDTH) - 0.5;
            let at = (x as f32, (row(part) - 0.5) as f32);
            mask.marker(Marker::of(i), at, radius);
        }
        mask.paint(&mut img, palette(i));
        panels.push(panel);
    }
    Ok((img, panels))
}

/// An angle modulo its period, 0 to below 1.
fn part(angle: f64, period: f64) -> Option<f64> {
    let part = angle.rem_euclid(period) / period;
    part.is_finite().then_some(if part < 1.0 { part } else { 0.0 })
}

/// Distance of a part of the period from the upper edge of its panel, in pixels.
fn row(part: f64) -> f64 {
    (1.0 + BEYOND - part) / (1.0 + 2.0 * BEYOND) * f64::from(HEIGHT)
}

/// Ticks at the first and at round captures, counted from 1.
fn captures(n: usize) -> Ticks {
    const MOST_LABELS: usize = 18;
    let step = (0..)
        .take(19)
        .flat_map(|e| [1, 2, 5].map(|m| m * 10_usize.pow(e)))
        .find(|s| n / s <= MOST_LABELS)
        .unwrap_or(n);
    let first = (step >= 5).then_some(1);
    let rest = (1..=n / step.max(1)).map(|i| i * step);
    let marks = first
        .into_iter()
        .chain(rest)
        .map(|k| ((k as f64 - 0.5) / n as f64, k.to_string()))
        .collect();
    Ticks { marks, exponent: 0 }
}

fn check(elements: &[(&str, &str, f64)], values: &[Vec<f64>]) -> Result<(), FigureError> {
    let refuse = |option, value, must| Err(FigureError::Option { option, value, must });
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
        let value = format!("{} angles long at capture {}", row.len(), k + 1);
        return refuse("values", value, "one angle per element at every capture");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TWO: [(&str, &str, f64); 2] = [
        ("polarizer 1", "angle / °", 180.0),
        ("retarder 2", "angle / °", 180.0),
    ];

    /// Every angle is a marker in its panel, column and row, and so is the same angle a period later.
    #[test]
    fn angles_are_in_their_places() {
        let values = vec![
            vec![45.0, 0.0],
            vec![f64::NAN, 90.0],
            vec![-45.0, 270.0],
            vec![0.0, 180.0],
        ];
        let (img, panels) = draw_with_panels("t", &TWO, &values).unwrap();
        let pixel = |panel: usize, capture: usize, degrees: f64| {
            let r = panels[panel];
            let x = r.x as f64 + (capture as f64 + 0.5) / 4.0 * f64::from(r.w) - 0.5;
            let y = r.y as f64 + row(degrees / 180.0) - 0.5;
            *img.get_pixel(x.round() as u32, y.round() as u32)
        };
        for (panel, capture, degrees) in [
            (0, 0, 45.0),
            (0, 2, 135.0),
            (0, 3, 0.0),
            (1, 0, 0.0),
            (1, 1, 90.0),
            (1, 2, 90.0),
            (1, 3, 0.0),
        ] {
            assert_eq!(
                pixel(panel, capture, degrees),
                palette(panel),
                "{panel} {capture}"
            );
            assert_ne!(pixel(panel, capture, degrees + 22.0), palette(panel));
        }
        for degrees in 0..180 {
            assert_ne!(
                pixel(0, 1, f64::from(degrees)),
                palette(0),
                "no marker without an angle"
            );
        }
        assert_eq!(draw("t", &TWO, &values).unwrap(), img, "the same pixels again");
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
    fn what_is_no_table_of_angles_is_refused() {
        let message = |elements: &[(&str, &str, f64)], values: &[Vec<f64>]| {
            draw("t", elements, values).expect_err("was drawn").to_string()
        };
        assert!(message(&[], &[vec![]]).contains("1 to 8"));
        assert!(message(&TWO, &[]).contains("at least one capture"));
        assert!(message(&TWO, &[vec![1.0; 2], vec![1.0]]).contains("1 angles long at capture 2"));
        for period in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(message(&[("a", "b", period)], &[vec![1.0]]).contains("`a`"));
        }
    }

    /// A scheme of four elements; look at it as at the gallery of the other figures.
    #[test]
    fn example_comes_out_at_a_useful_size() {
        let elements =
            ["polarizer 1", "retarder 2", "retarder 3", "polarizer 4"].map(|n| (n, "angle / °", 180.0));
        let values: Vec<Vec<f64>> = (0..36)
            .map(|k| {
                vec![
                    0.0,
                    5.0 * f64::from(k),
                    25.0 * f64::from(k),
                    (f64::from(k) * 0.7).sin() * 80.0,
                ]
            })
            .collect();
        let img = draw(
            "Angles of the dual rotating retarder scheme, K = 36",
            &elements,
            &values,
        )
        .unwrap();
        assert!((900..1100).contains(&img.width()) && (600..900).contains(&img.height()));
        if let Ok(folder) = std::env::var("FIGURE_GALLERY") {
            crate::save_png(&img, &std::path::Path::new(&folder).join("angles.png")).unwrap();
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn no_table_panics(
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
