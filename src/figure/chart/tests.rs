//! Tests the positions of known series in a chart. Also tests degenerate series.

use image::RgbImage;
use proptest::prelude::*;

use super::*;

const WHITE: Rgb<u8> = Rgb([255; 3]);

fn series(name: &str, points: &[(f64, f64)], style: SeriesStyle, colour: usize) -> Series {
    Series { name: name.into(), points: points.to_vec(), errors: None, style, colour }
}

fn axis(label: &str, log: bool, range: Option<(f64, f64)>) -> ChartAxis {
    ChartAxis { label: label.into(), log, range, named: vec![] }
}

fn square(series: Vec<Series>) -> Chart {
    Chart {
        x: axis("x", false, Some((0.0, 10.0))),
        y: axis("y", false, Some((0.0, 10.0))),
        series,
        ..Chart::default()
    }
}

fn seen(chart: &Chart) -> (RgbImage, Scales) {
    let (drawing, scales) = draw_in(chart, &palette).unwrap();
    (drawing.pixels().unwrap(), scales)
}

/// Draws a chart and returns the colours of the pixels at the given data points.
fn colours(chart: &Chart, points: &[(f64, f64)]) -> Vec<Rgb<u8>> {
    let (img, scales) = seen(chart);
    let pixel = |&p| {
        let (x, y) = scales.point(p).unwrap();
        *img.get_pixel(x as u32, y as u32)
    };
    points.iter().map(pixel).collect()
}

fn message(chart: &Chart) -> String {
    draw(chart).expect_err("was drawn").to_string()
}

#[test]
fn lines_and_markers_are_at_their_positions() {
    let chart = square(vec![
        series("", &[(0.0, 3.3), (10.0, 3.3)], SeriesStyle::Line, 0),
        series("", &[(4.3, 0.0), (4.3, 10.0)], SeriesStyle::Line, 1),
        series("", &[(1.3, 8.3), (6.7, 8.3)], SeriesStyle::Markers, 2),
    ]);
    let near = |a: Rgb<u8>, b: Rgb<u8>| a.0.iter().zip(b.0).all(|(a, b)| a.abs_diff(b) < 60);
    let seen = colours(&chart, &[(2.2, 3.3), (7.7, 3.3), (4.3, 6.2), (1.3, 8.3), (6.7, 8.3)]);
    for (seen, colour) in seen.into_iter().zip([0, 0, 1, 2, 2]) {
        assert!(near(seen, palette(colour)), "{seen:?} {colour}");
    }
    let empty = colours(&chart, &[(2.2, 3.6), (2.2, 2.7), (4.6, 6.2), (3.3, 8.3)]);
    assert_eq!(empty, [WHITE; 4]);
}

#[test]
fn log_axes_place_ten_between_one_and_a_hundred() {
    let mut chart = square(vec![series("", &[(10.0, 10.0)], SeriesStyle::Markers, 0)]);
    chart.x = axis("x", true, Some((1.0, 100.0)));
    chart.y = axis("y", true, Some((1.0, 100.0)));
    let (img, scales) = seen(&chart);
    let (x, y) = scales.plot.centre();
    assert_eq!(*img.get_pixel(x as u32, y as u32), palette(0));
}

#[test]
fn missing_values_leave_gaps() {
    let y = [5.2, 5.2, f64::NAN, 5.2, 5.2, f64::INFINITY, 5.2];
    let points: Vec<(f64, f64)> = y.iter().enumerate().map(|(i, &y)| (1.0 + i as f64, y)).collect();
    let chart = square(vec![series("", &points, SeriesStyle::Line, 0)]);
    let at = [1.5, 2.5, 3.2, 4.5, 5.6, 6.5, 7.0].map(|x| (x, 5.2));
    let drawn: Vec<bool> = colours(&chart, &at).into_iter().map(|c| c != WHITE).collect();
    assert_eq!(drawn, [true, false, false, true, false, false, true]);
}

#[test]
fn values_that_a_log_axis_cannot_show_are_counted() {
    let mut chart = square(vec![series(
        "",
        &[(1.0, 0.0), (2.0, -3.0), (3.0, 1.0), (f64::NAN, 0.0)],
        SeriesStyle::LineMarkers,
        0,
    )]);
    assert_eq!(left_out(&chart), None);
    chart.y = axis("y", true, None);
    let note = left_out(&chart).unwrap();
    assert_eq!(note, "2 points at or below 0 are not shown on the logarithmic vertical axis.");
    let with = draw(&chart).unwrap();
    chart.series[0].points.drain(..2);
    assert!(draw(&chart).unwrap().height() < with.height(), "the note has room");
}

#[test]
fn error_bars_reach_one_standard_error() {
    let mut s = series("", &[(2.3, 5.0), (5.3, 5.0), (8.3, 5.0)], SeriesStyle::Markers, 0);
    s.errors = Some(vec![2.0, f64::NAN, 20.0]);
    let chart = square(vec![s]);
    let at = [(2.3, 6.7), (2.3, 3.4), (2.3, 7.3), (5.3, 6.7), (8.3, 9.7), (8.3, 0.3)];
    let drawn: Vec<bool> = colours(&chart, &at).into_iter().map(|c| c != WHITE).collect();
    assert_eq!(drawn, [true, true, false, false, true, true]);
}

#[test]
fn dashes_are_black_with_gaps() {
    let chart = square(vec![series("", &[(0.0, 3.3), (10.0, 3.3)], SeriesStyle::Dashed, BLACK)]);
    let at: Vec<(f64, f64)> = (1..999).map(|i| (f64::from(i) / 100.0, 3.3)).collect();
    let row = colours(&chart, &at);
    let dark = row.iter().filter(|c| c.0[0] < 90).count();
    let white = row.iter().filter(|c| **c == WHITE).count();
    assert!((450..750).contains(&dark) && white > 150, "{dark} {white}");
}

/// Tests that the legend avoids the data. The legend is outside the plot if there is no free corner or if
/// there are too many names.
#[test]
fn legends_avoid_the_data() {
    let across: Vec<(f64, f64)> = (0..40).map(|i| (f64::from(i) / 4.0, 9.5)).collect();
    let line = |k: usize| series("some name", &across, SeriesStyle::LineMarkers, k);
    let (bare, _) = seen(&square(vec![series("", &across, SeriesStyle::LineMarkers, 0)]));
    let (named, scales) = seen(&square(vec![line(0)]));
    let (x0, y0) = scales.plot.centre();
    assert_eq!(named.width(), bare.width());
    for (x, y, p) in named.enumerate_pixels().filter(|(x, y, p)| *p != bare.get_pixel(*x, *y)) {
        let lower_right = f64::from(x) > x0 && f64::from(y) > y0;
        assert!(lower_right, "{x} {y} {p:?}");
    }
    let full: Vec<(f64, f64)> =
        (0..400).map(|i| (f64::from(i % 20) / 2.0, f64::from(i / 20) / 2.0)).collect();
    let full = square(vec![series("name", &full, SeriesStyle::Markers, 0)]);
    assert!(draw(&full).unwrap().width() > bare.width());
    let many = draw(&square((0..30).map(line).collect())).unwrap();
    assert!(many.width() > bare.width() && many.height() == bare.height());
}

#[test]
fn invalid_charts_are_refused() {
    let nowhere = [(f64::NAN, 1.0), (1.0, f64::INFINITY)];
    assert_eq!(DISTINCT, 56, "the number in the refusal");
    assert!(message(&Chart::default()).contains("number of series"));
    let many = vec![series("", &[(1.0, 1.0)], SeriesStyle::Line, 0); DISTINCT + 1];
    assert!(message(&square(many)).contains(&format!("1 to {DISTINCT}")));
    assert!(message(&square(vec![series("a", &[], SeriesStyle::Line, 0)])).contains("`a`"));
    assert!(message(&square(vec![series("a", &nowhere, SeriesStyle::Line, 0)])).contains("one point"));
    let mut short = series("b", &[(1.0, 1.0)], SeriesStyle::Line, 0);
    short.errors = Some(vec![]);
    assert!(message(&square(vec![short])).contains("a list of 0 values for `b`"));
    let mut chart = square(vec![series("", &[(1.0, 1.0)], SeriesStyle::Line, 0)]);
    chart.y.range = Some((2.0, 1.0));
    assert!(message(&chart).contains("`y range`"));
    chart.y = axis("", true, None);
    chart.series[0].points = vec![(1.0, -1.0)];
    assert!(message(&chart).contains("above 0"));
}

/// Tests charts of every style on linear and logarithmic axes. Each chart must have a useful size and contain
/// its text. Drawing must be deterministic.
#[test]
fn charts_have_a_useful_size_and_are_deterministic() {
    let styles = [SeriesStyle::Dashed, SeriesStyle::Band, SeriesStyle::LineMarkers, SeriesStyle::Line];
    for log in [false, true] {
        let chart = Chart {
            title: "Loss over captures".into(),
            x: axis("captures K", false, None),
            y: axis("loss [W]", log, None),
            series: (0..8)
                .map(|k| {
                    let loss = |i: usize| 1e-6 * (0.3 * k as f64 - 0.2 * i as f64).exp();
                    let points: Vec<(f64, f64)> = (4..20).map(|i| (i as f64, loss(i))).collect();
                    Series {
                        errors: Some(points.iter().map(|p| 0.1 * p.1).collect()),
                        ..series(&format!("series {k}"), &points, styles[k % 4], k)
                    }
                })
                .collect(),
            notes: vec!["Bars: ±1 standard error.".into()],
        };
        let drawing = draw(&chart).unwrap();
        assert!((900..1400).contains(&drawing.width()) && (540..720).contains(&drawing.height()));
        assert_eq!(drawing, draw(&chart).unwrap());
        for text in ["Loss over captures", "captures K", "series 7", "Bars: ±1 standard error."] {
            assert!(drawing.svg().contains(&format!(">{text}<")), "{text}");
        }
    }
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -10.0..10.0,
        1 => any::<f64>(),
        1 => prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::MAX, -f64::MAX, 0.0, 1e-320, 1e300]),
    ]
}

fn any_axis() -> impl Strategy<Value = ChartAxis> {
    let range = prop::option::weighted(0.3, (number(), number()));
    (".{0,40}", any::<bool>(), range).prop_map(|(label, log, range)| ChartAxis {
        label,
        log,
        range,
        named: vec![],
    })
}

fn any_series() -> impl Strategy<Value = Series> {
    use SeriesStyle::{Band, Dashed, Line, LineMarkers, Markers};
    let style = prop::sample::select(vec![Line, Markers, LineMarkers, Dashed, Band]);
    let points = prop::collection::vec((number(), number(), number()), 0..20);
    (".{0,40}", points, any::<bool>(), style, any::<usize>()).prop_map(
        |(name, points, bars, style, colour)| {
            let places: Vec<(f64, f64)> = points.iter().map(|p| (p.0, p.1)).collect();
            Series {
                errors: bars.then(|| points.iter().map(|p| p.2).collect()),
                ..series(&name, &places, style, colour)
            }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    #[ignore = "slow: tools/check --all"]
    fn arbitrary_charts_never_panic(
        title in ".{0,80}",
        x in any_axis(),
        y in any_axis(),
        series in prop::collection::vec(any_series(), 0..5),
        notes in prop::collection::vec(".{0,80}", 0..3),
    ) {
        if let Ok(d) = draw(&Chart { title, x, y, series, notes }) {
            let (w, h) = (d.width(), d.height());
            prop_assert!((900..2300).contains(&w) && h < 2300, "{w} × {h}");
            prop_assert!(d.pixels().is_ok() && crate::tests::numbers(&d.svg()));
        }
    }
}
