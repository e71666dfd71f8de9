//! Tests that the positions of panels, arrows and insets equal values computed by hand.

use super::layout::{
    BAR, CAPTION, CELL_GAP, EDGE, GAP, HEADING, LINE, Layout, ROW_GAP, SAMPLE, SPACE, TICK, layout,
};
use super::*;
use crate::chart::{Chart, ChartAxis, Series};
use crate::spec::{MuellerView, SignedScale, View};
use crate::tile::{Scale, Tile, of_chart, of_values, of_view};
use crate::{Panel, Rect};
use image::{Rgb, RgbImage};
use proptest::prelude::*;
use tensor::array::Tensor;
use tensor::axes::{Axis, AxisKind};

fn part(tile: Tile) -> Part {
    Part {
        tile,
        span: 1,
        caption: String::new(),
        denoised: false,
        insets: vec![],
        arrows: vec![],
        circles: vec![],
        scale_bar: None,
    }
}

/// Returns an image in which all pixels differ.
fn numbered(w: u32, h: u32) -> RgbImage {
    RgbImage::from_fn(w, h, |x, y| Rgb([x as u8 + 1, y as u8 + 1, 200]))
}

fn figure(columns: usize, parts: Vec<Option<Part>>) -> Composite {
    Composite {
        title: "t".into(),
        width_mm: 84.0,
        columns,
        column_headings: vec![],
        row_headings: vec![],
        letters: true,
        parts,
    }
}

fn image(w: u32, h: u32) -> Option<Part> {
    Some(part(Tile::image(numbered(w, h))))
}

/// Returns a logarithmic chart of two named lines and one unnamed line. The chart can have a legend.
fn curves(legend: bool) -> Tile {
    let axis = |label: &str, log, range| ChartAxis {
        label: label.into(),
        log,
        range: Some(range),
        ..ChartAxis::default()
    };
    let series = |name: &str, y: f64, colour| Series {
        name: name.into(),
        points: vec![(1.0, y), (10.0, y), (1000.0, y)],
        colour,
        ..Series::default()
    };
    let chart = Chart {
        x: axis("electrons", true, (1.0, 1000.0)),
        y: axis("worth", false, (0.0, 1.0)),
        series: vec![series("ours", 0.25, 0), series("theirs", 0.75, 1), series("", 0.5, 2)],
        ..Chart::default()
    };
    of_chart(chart, legend).expect("a chart")
}

/// Tests that the legend is under the axis. Each name must be next to the line's colour, and markers must be
/// at logarithmic positions.
#[test]
fn charts_have_a_legend_and_logarithmic_positions() {
    let with = layout(&figure(1, vec![Some(part(curves(true)))])).expect("places");
    let without = layout(&figure(1, vec![Some(part(curves(false)))])).expect("places");
    assert!(without.panels[0].legend.is_empty());
    let placed = &with.panels[0];
    assert_eq!(placed.legend.iter().map(|e| e.0).collect::<Vec<_>>(), [0, 1]);
    assert!(near(with.height - without.height, SPACE + LINE * TICK));
    let f = figure(1, vec![Some(part(curves(true)))]);
    let (img, _, scale) = pixels(&f);
    let r = placed.picture;
    for (y, colour) in [(0.25, [0, 114, 178]), (0.75, [213, 94, 0]), (0.5, [0, 158, 115])] {
        let third = (r.x + r.w / 3.0, r.y + (1.0 - y) * r.h);
        assert_eq!(at(&img, third, scale), Rgb(colour));
    }
    for ((_, (x, y)), colour) in placed.legend.iter().zip([[0, 114, 178], [213, 94, 0]]) {
        assert!(*y > r.y + r.h && *y < with.height && *x >= r.x - 1e-9);
        assert_eq!(at(&img, (x + SAMPLE / 2.0, *y), scale), Rgb(colour));
    }
    // In a figure that is as narrow as a word, each name has a row of its own.
    let narrow = Composite { width_mm: 31.0, ..figure(1, vec![Some(part(curves(true)))]) };
    let rows = layout(&narrow).expect("places").panels[0].legend.clone();
    assert!(near(rows[1].1.1 - rows[0].1.1, LINE * TICK) && near(rows[1].1.0, rows[0].1.0));
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-9
}

/// Tests two columns and two rows of 4:3 images in 84 mm without a colour bar. The expected positions are
/// computed by hand.
#[test]
fn positions_match_the_closed_form() {
    let places = layout(&figure(2, (0..4).map(|_| image(40, 30)).collect())).expect("places");
    let p = (84.0 - 2.0 * EDGE - GAP) / 2.0;
    let row = 0.75 * p + SPACE + LINE * CAPTION + ROW_GAP;
    for (i, placed) in places.panels.iter().enumerate() {
        let (column, line) = ((i % 2) as f64, (i / 2) as f64);
        let r = placed.picture;
        assert!(near(r.x, EDGE + column * (p + GAP)), "{i}: {r:?}");
        assert!(near(r.y, EDGE + line * row), "{i}: {r:?}");
        assert!(near(r.w, p) && near(r.h, 0.75 * p), "{i}: {r:?}");
        let (text, (x, y)) = &placed.caption[0];
        assert_eq!(*text, letter(i));
        assert!(near(*x, r.x) && near(*y, r.y + r.h + SPACE + LINE * CAPTION / 2.0));
    }
    assert!(near(places.width, 84.0) && near(places.height, 2.0 * row - ROW_GAP + 2.0 * EDGE));
}

/// Tests that a colour bar narrows all images equally. Headings must take space at the edges, and a span must
/// cover the gap between columns.
#[test]
fn colour_bars_headings_and_spans_take_space() {
    let with_bar = |x: f32| {
        let scale = Scale::Linear { low: 0.0, high: x };
        part(of_values("", 4, &[0.0; 16], scale).expect("a map"))
    };
    let mut wide = part(Tile::image(numbered(8, 4)));
    wide.span = 2;
    let mut f = figure(3, vec![image(4, 4), None, Some(with_bar(1.0)), Some(wide)]);
    f.column_headings = vec!["a".into(), "b".into(), "c".into()];
    f.row_headings = vec!["r".into()];
    let places = layout(&f).expect("places");
    let [one, two, three] = &places.panels[..] else { panic!("{places:?}") };
    let p = one.picture.w;
    let head = HEADING + 2.0 * SPACE;
    assert!(near(one.picture.x, EDGE + head) && near(one.picture.y, EDGE + HEADING + SPACE));
    assert!(near(two.picture.x, EDGE + head + 2.0 * (p + GAP)), "the free place is kept");
    let (bar, _) = two.bar.clone().expect("a bar");
    assert!(near(bar.x, two.picture.x + p + 1.0) && near(bar.w, BAR) && near(bar.h, p));
    assert!(bar.x + bar.w < 84.0 - EDGE);
    assert!(near(two.picture.w, p));
    assert!(near(three.picture.w, 2.0 * p + GAP) && near(three.picture.h, p + GAP / 2.0));
    let middles: Vec<f64> = places.columns.iter().map(|c| c.1.0).collect();
    assert!(near(middles[1] - middles[0], p + GAP) && near(middles[0], one.picture.x + p / 2.0));
    assert!(near(places.rows[0].1.1, one.picture.y + p / 2.0));
}

#[test]
fn grids_divide_their_panel_evenly() {
    let axis = |kind, n: usize| Axis { kind, coords: (0..n).map(|i| i as f64).collect(), chunk: 1 };
    let kinds = [(AxisKind::Y, 2), (AxisKind::X, 2), (AxisKind::StokesOut, 4), (AxisKind::StokesIn, 4)];
    let mean = Tensor::zeros("s", kinds.map(|(k, n)| axis(k, n)).into());
    let view = View::Mueller(MuellerView {
        slice: "s".into(),
        wavelength_nm: None,
        time_ps: None,
        normalized: true,
        limit: None,
        scale: crate::spec::SignedScale::Linear,
        mask_sigmas: None,
    });
    let panel = Panel { mean: &mean, std_error: None, overflow: None };
    let tile = Tile { bar: None, ..of_view(&view, &panel).expect("a grid") };
    let places = layout(&figure(1, vec![Some(part(tile))])).expect("places");
    let (r, cells) = (places.panels[0].picture, &places.panels[0].cells);
    let cell = (r.w - 3.0 * CELL_GAP) / 4.0;
    assert_eq!(cells.len(), 16);
    assert!(near(cells[6].x, r.x + 2.0 * (cell + CELL_GAP)) && near(cells[6].y, r.y + cell + CELL_GAP));
    assert!(near(cells[15].x + cells[15].w, r.x + r.w) && near(cells[15].y + cells[15].h, r.y + r.h));
}

fn pixels(f: &Composite) -> (RgbImage, Layout, f64) {
    let drawing = draw(f).expect("a drawing");
    let places = layout(f).expect("places");
    (drawing.pixels().expect("pixels"), places, 300.0 / 25.4)
}

fn at(img: &RgbImage, (x, y): (f64, f64), scale: f64) -> Rgb<u8> {
    *img.get_pixel((x * scale) as u32, (y * scale) as u32)
}

/// Tests that the inset contains every pixel of the crop at the magnified position. The inset must contain no
/// other pixel.
#[test]
fn insets_show_the_pixels_of_their_crop() {
    let mut one = part(Tile::image(numbered(20, 10)));
    one.insets = vec![Inset {
        crop: [0.1, 0.2, 0.2, 0.3],
        magnify: 3.0,
        corner: Corner { right: true, lower: true },
        ink: Ink([1, 2, 3]),
    }];
    assert_eq!(one.insets[0].pixels([20, 10]), [2, 2, 4, 3]);
    let (img, places, scale) = pixels(&figure(1, vec![Some(one)]));
    let placed = &places.panels[0];
    let (crop, large) = placed.insets[0];
    let (r, px) = (placed.picture, placed.picture.w / 20.0);
    assert!(near(crop.x, r.x + 2.0 * px) && near(crop.y, r.y + 2.0 * px));
    assert!(near(crop.w, 4.0 * px) && near(crop.h, 3.0 * px));
    assert!(near(large.w, 12.0 * px) && near(large.x + large.w, r.x + r.w));
    assert!(near(large.h, 9.0 * px) && near(large.y + large.h, r.y + r.h));
    for (i, j) in (0..4_u8).flat_map(|i| (0..3_u8).map(move |j| (i, j))) {
        let middle = (large.x + (f64::from(i) + 0.5) * 3.0 * px, large.y + (f64::from(j) + 0.5) * 3.0 * px);
        assert_eq!(at(&img, middle, scale), Rgb([i + 3, j + 3, 200]), "({i}, {j})");
    }
    // The rest of the image does not change.
    let first = (r.x + 0.5 * px, r.y + 0.5 * px);
    assert_eq!(at(&img, first, scale), Rgb([1, 1, 200]));
}

/// Tests that the tip of an arrow is at its target. The pixel behind the tip has the arrow's colour, and the
/// pixel in front of the tip does not.
#[test]
fn arrow_tips_are_at_their_targets() {
    for to in [[0.5, 0.5], [0.25, 0.75], [0.9, 0.1]] {
        let mut one = part(Tile::image(numbered(20, 20)));
        one.arrows = vec![Arrow { from: [0.05, 0.05], to, ink: Ink([213, 94, 0]) }];
        let (img, places, scale) = pixels(&figure(1, vec![Some(one)]));
        let placed = &places.panels[0];
        let (from, tip) = placed.arrows[0];
        let r = placed.picture;
        assert!(near(tip.0, r.x + to[0] * r.w) && near(tip.1, r.y + to[1] * r.h));
        let length = (tip.0 - from.0).hypot(tip.1 - from.1);
        let along =
            |mm: f64| (tip.0 + mm * (tip.0 - from.0) / length, tip.1 + mm * (tip.1 - from.1) / length);
        for mm in [-0.5, -1.0, -3.0, -0.9 * length] {
            assert_eq!(at(&img, along(mm), scale), Rgb([213, 94, 0]), "{to:?} {mm}");
        }
        let beyond = at(&img, along(1.0), scale);
        assert_eq!(beyond.0[2], 200, "{to:?}: {beyond:?}");
    }
}

/// Tests that a logarithmic scale shows decades at equal distances, and shows smaller values as its lower end.
#[test]
fn a_logarithmic_scale_shows_decades() {
    let scale = Scale::Log { low: 0.01, high: 1.0 };
    let tile = of_values("error", 5, &[1e-9, 0.01, 0.1, 1.0, 9.0], scale).expect("a map");
    let image = &tile.cells[0].0;
    let colours = [0.0, 0.0, 0.5, 1.0, 1.0].map(crate::colour::sequential);
    assert!(image.pixels().zip(colours).all(|(p, c)| *p == c), "{image:?}");
    assert_eq!(tile.bar.expect("a bar").ticks.marks.len(), 3);
    for (low, high) in [(0.0, 1.0), (-1.0, 1.0), (1.0, 1.0), (f32::NAN, 1.0)] {
        assert!(of_values("error", 1, &[1.0], Scale::Log { low, high }).is_err(), "{low} {high}");
    }
}

/// Tests that a circle is drawn at its radius around its centre, and that its inside does not change.
#[test]
fn circles_surround_their_centre() {
    let mut one = part(Tile::image(numbered(20, 20)));
    one.circles = vec![Circle { at: [0.525, 0.475], radius: 0.25, ink: Ink([213, 94, 0]) }];
    let (img, places, scale) = pixels(&figure(1, vec![Some(one)]));
    let placed = &places.panels[0];
    let (centre, radius) = placed.circles[0];
    let r = placed.picture;
    assert!(near(centre.0, r.x + 0.525 * r.w) && near(centre.1, r.y + 0.475 * r.h));
    assert!(near(radius, 0.25 * r.w));
    for angle in (0..8).map(|i| f64::from(i) * 0.8) {
        let away = |mm: f64| (centre.0 + mm * angle.cos(), centre.1 + mm * angle.sin());
        assert_eq!(at(&img, away(radius), scale), Rgb([213, 94, 0]), "{angle}");
        assert_eq!(at(&img, away(0.9 * radius), scale)[2], 200, "{angle}");
        assert_eq!(at(&img, away(1.1 * radius), scale)[2], 200, "{angle}");
    }
    assert_eq!(at(&img, centre, scale), Rgb([11, 10, 200]));
}

#[test]
fn letters_continue_after_z() {
    assert_eq!([0, 25, 26, 52].map(letter), ["(a)", "(z)", "(aa)", "(ba)"]);
}

/// Tests the physical size of a figure. The SVG states 84 mm, and the PDF has the same size in points.
#[test]
fn figures_have_the_requested_physical_size() {
    let drawing = draw(&figure(1, vec![image(4, 4)])).expect("a drawing");
    let svg = drawing.svg();
    let width: f64 = svg
        .split_once("width=\"")
        .and_then(|(_, rest)| rest.split_once("mm\""))
        .and_then(|(mm, _)| mm.parse().ok())
        .expect("millimetres");
    assert!((width - 84.0).abs() < 0.1, "{width}");
    let pdf = String::from_utf8_lossy(&drawing.pdf().expect("a PDF")).into_owned();
    let page = pdf.split_once("/MediaBox [").expect("a page").1;
    let points: f64 = page.split_whitespace().nth(2).and_then(|v| v.parse().ok()).expect("a width");
    assert!((points - 84.0 * 72.0 / 25.4).abs() < 0.3, "{points}");
    let again = draw(&figure(1, vec![image(4, 4)])).expect("a drawing");
    assert_eq!(again.png().expect("PNG"), drawing.png().expect("PNG"));
}

fn signed_map(name: &str, limit: f32) -> Part {
    let scale = Scale::Signed { limit, scale: SignedScale::Linear };
    part(of_values(name, 4, &[0.0; 16], scale).expect("a map"))
}

/// Tests that adjacent panels with equal scales have one bar, with all labels, and that panels with different
/// scales, or with a panel between them, have their own bars.
#[test]
fn equal_scales_share_a_bar() {
    let labels = |parts: Vec<Option<Part>>| -> Vec<Option<String>> {
        let places = layout(&Composite { width_mm: 178.0, ..figure(3, parts) }).expect("places");
        places.panels.into_iter().map(|p| p.bar.map(|(_, label)| label)).collect()
    };
    let map = |name, limit| Some(signed_map(name, limit));
    let text = |label: &str| Some(label.to_owned());
    assert_eq!(labels(vec![map("a", 1.0), map("b", 1.0), map("b", 1.0)]), [None, None, text("a, b")]);
    let normalized = vec![map("M22 / M00", 1.0), map("−M33 / M00", 1.0), image(4, 4)];
    assert_eq!(labels(normalized), [None, text("Mij / M00"), None]);
    assert_eq!(labels(vec![map("a", 1.0), map("a", 2.0), map("a", 1.0)]), [text("a"), text("a"), text("a")]);
    assert_eq!(labels(vec![map("a", 1.0), image(4, 4), map("a", 1.0)]), [text("a"), None, text("a")]);
    assert_eq!(labels(vec![map("a", 1.0), None, map("a", 1.0)]), [text("a"), text("a")]);
    // Panels of different rows do not share a bar.
    let rows = vec![image(4, 4), image(4, 4), map("a", 1.0), map("a", 1.0)];
    assert_eq!(labels(rows), [None, None, text("a"), text("a")]);
}

/// Tests that every row fills the width of the figure, although only one row has a colour bar. With column
/// headings, the columns of all rows are aligned.
#[test]
fn rows_have_no_empty_gutters() {
    let mut f = figure(2, vec![Some(signed_map("a", 1.0)), image(4, 4), image(4, 4), image(4, 4)]);
    let places = layout(&f).expect("places");
    let right = |i: usize| places.panels[i].picture.x + places.panels[i].picture.w;
    assert!(near(right(1), 84.0 - EDGE) && near(right(3), 84.0 - EDGE));
    assert!(near(places.panels[3].picture.x - right(2), GAP));
    assert!(places.panels[2].picture.w > places.panels[0].picture.w);
    f.column_headings = vec!["a".into(), "b".into()];
    let places = layout(&f).expect("places");
    assert!(near(places.panels[0].picture.w, places.panels[2].picture.w));
    assert!(near(places.panels[1].picture.x, places.panels[3].picture.x));
}

/// Tests that captions of any words, including words that are wider than the panel, end before the next panel.
#[test]
fn captions_stay_within_their_panels() {
    let long = "polarization-resolved-transient-measurement of a very small and remarkably noisy mirror";
    let parts = (0..4).map(|i| {
        let mut one = if i % 2 == 0 { image(4, 4)? } else { signed_map("b", 1.0) };
        one.caption = long.into();
        Some(one)
    });
    let f = figure(4, parts.collect());
    let places = layout(&f).expect("places");
    for (i, placed) in places.panels.iter().enumerate() {
        let next = places.panels.get(i + 1).map_or(84.0 - EDGE, |p| p.picture.x);
        assert!(placed.caption.len() > 4);
        for (line, (x, y)) in &placed.caption {
            let end = x + crate::text::width(line, super::layout::style(CAPTION));
            assert!(end <= next + 1e-9, "{i}: {line} ends at {end}, the next panel begins at {next}");
            assert!(*y > placed.picture.y + placed.picture.h && *y < places.height);
        }
    }
}

/// Tests that a note lists the denoised panels by their letters.
#[test]
fn a_note_lists_denoised_panels() {
    let note = |denoised: &[bool], letters| {
        let mark = |d: &bool| Some(Part { denoised: *d, ..image(4, 4)? });
        let parts = denoised.iter().map(mark).collect();
        let places = layout(&Composite { letters, ..figure(2, parts) }).expect("places");
        let lines: Vec<&str> = places.note.iter().map(|(line, _)| line.as_str()).collect();
        assert!(places.note.iter().all(|(_, (_, y))| *y < places.height));
        lines.join(" ")
    };
    assert_eq!(note(&[false, false], true), "");
    assert_eq!(note(&[true, true], true), "Denoised.");
    assert_eq!(note(&[true, true, true, false, true], true), "Denoised: (a)–(c), (e).");
    assert_eq!(note(&[true, false, true, true], false), "Denoised panels: 1, 3, 4.");
    let drawing = draw(&figure(1, vec![Some(Part { denoised: true, ..image(4, 4).expect("a part") })]));
    assert!(drawing.expect("a drawing").svg().contains("Denoised."));
}

#[test]
fn crops_keep_the_pixels_of_the_crop() {
    let mut tile = Tile::image(numbered(8, 8));
    assert!(tile.crop([0.25, 0.5, 0.5, 0.25]));
    let image = &tile.cells[0].0;
    assert_eq!((image.width(), image.height(), image.get_pixel(0, 0).0), (4, 2, [3, 5, 200]));
    assert!(!curves(false).crop([0.0, 0.0, 0.5, 0.5]), "a chart is not cropped");
}

fn overlap(a: Rect, b: Rect) -> bool {
    a.x < b.x + b.w - 1e-9 && b.x < a.x + a.w - 1e-9 && a.y < b.y + b.h - 1e-9 && b.y < a.y + a.h - 1e-9
}

proptest! {
    /// Tests that panels do not overlap and are within the page, for any grid.
    #[test]
    fn panels_do_not_overlap(columns in 1..7_usize, shapes in prop::collection::vec((1..60_u32, 1..60_u32, 1..4_usize, 0..3_u8), 1..20), width in 30.0..400.0_f64) {
        let parts = shapes.iter().map(|(w, h, span, kind)| match kind {
            0 => None,
            1 => {
                let mut p = image(*w, *h)?;
                p.span = (*span).min(columns);
                p.caption = "some words under the picture".into();
                Some(p)
            }
            _ => {
                let values = vec![0.5; (w * h) as usize];
                let scale = Scale::Signed { limit: 1.0, scale: SignedScale::Linear };
                Some(part(of_values("name", *w as usize, &values, scale).ok()?))
            }
        });
        let mut f = figure(columns, parts.collect());
        f.width_mm = width;
        match layout(&f) {
            Ok(places) => {
                for (i, a) in places.panels.iter().enumerate() {
                    prop_assert!(a.picture.x >= EDGE - 1e-9 && a.picture.x + a.picture.w <= width - EDGE + 1e-6);
                    prop_assert!(a.picture.y + a.picture.h <= places.height);
                    for b in &places.panels[..i] {
                        prop_assert!(!overlap(a.picture, b.picture), "{a:?} {b:?}");
                        prop_assert!(b.bar.as_ref().is_none_or(|(bar, _)| !overlap(a.picture, *bar)));
                    }
                }
            }
            Err(e) => {
                let message = e.to_string();
                prop_assert!(message.contains("number of panels") || message.contains("columns"), "{}", message);
            }
        }
    }
}
