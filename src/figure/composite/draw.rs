//! Draws a composite from its layout.

use super::layout::{CAPTION, HEADING, Layout, MARK, NAME, Placed, SAMPLE, SPACE, TICK, layout, ticks};
use super::parts::{Composite, Ink, Part};
use crate::chart::legend::sample;
use crate::chart::{self, Marks, Nib, Scales};
use crate::drawing::{Drawing, Pen, Point, Rect};
use crate::error::FigureError;
use crate::layout::{BAR_STEPS, Bar, GRID};
use crate::polarization::{RADIUS, project};
use crate::text::{Align, INK, Style, fit, width};
use crate::ticks::Ticks;
use crate::tile::{Lines, Tile};
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use std::borrow::Cow;
use std::f64::consts::TAU;

/// Pixels per inch of a figure. The resolution is doubled if an image has more pixels than its rectangle.
const PER_INCH: f64 = 300.0;
const MM_PER_INCH: f64 = 25.4;
/// Width of thin lines in millimetres.
const THIN: f64 = 0.25;
/// Width of curves in millimetres.
const CURVE: f64 = 0.35;
/// Radius of the markers of curves, in millimetres.
const DOT: f64 = 0.7;
/// Width of an arrow's shaft in millimetres.
const SHAFT: f64 = 0.5;
/// Length and half width of the head of an arrow, in millimetres.
const HEAD: (f64, f64) = (1.9, 0.8);
/// Width of the outline around arrows and circles, in millimetres.
const RIM: f64 = 0.25;
/// Opacity of the background of text in images.
const GROUND: f64 = 0.75;
/// Number of segments of a circle.
const CIRCLE: usize = 96;
/// Distance of the names of states from the centre of the Poincaré sphere, in radii.
const NAMES: f64 = 1.14;
/// Colour of hidden halves of circles.
const HIDDEN: Rgb<u8> = Rgb([190, 190, 194]);
const WHITE: Rgb<u8> = Rgb([255; 3]);

/// Draws a composite figure.
///
/// # Errors
/// The same errors as [`layout()`].
pub fn draw(figure: &Composite) -> Result<Drawing, FigureError> {
    let places = layout(figure)?;
    let per_inch = per_inch(figure, &places);
    let scale = per_inch / MM_PER_INCH;
    let page = Drawing::new(places.width * scale, places.height * scale, &figure.title);
    let mut pen = Scribe { page: page.printed_at(per_inch), scale };
    for (text, at) in &places.columns {
        pen.text(text, *at, Align::Middle, HEADING);
    }
    for (text, (x, y), length) in &places.rows {
        let (text, style) = fit(text, pen.style(HEADING), length * scale);
        pen.page.text_up(&text, (x * scale, y * scale), style);
    }
    for (text, at) in &places.note {
        pen.text(text, *at, Align::Start, TICK);
    }
    for placed in &places.panels {
        if let Some(part) = &figure.parts[placed.part] {
            pen.part(part, placed);
        }
    }
    Ok(pen.page)
}

/// Returns [`PER_INCH`], or twice this number if a camera image has more pixels than its rectangle.
fn per_inch(figure: &Composite, places: &Layout) -> f64 {
    let crowded = places.panels.iter().any(|placed| {
        let part = figure.parts[placed.part].as_ref();
        let of_camera = part.filter(|p| p.tile.axes.is_none());
        let first = of_camera.and_then(|p| p.tile.cells.first()).zip(placed.cells.first());
        first.is_some_and(|((image, _), r)| {
            let room = PER_INCH / MM_PER_INCH;
            f64::from(image.width()) > r.w * room || f64::from(image.height()) > r.h * room
        })
    });
    if crowded { 2.0 * PER_INCH } else { PER_INCH }
}

/// Reduces an image to at most the number of pixels of its rectangle, by averaging colours. Images that are
/// not maps never have more pixels than the rectangle.
fn shrunk(image: &RgbImage, place: Rect) -> Cow<'_, RgbImage> {
    let [w, h] = [place.w, place.h].map(|v| v as u32);
    if image.width() <= w && image.height() <= h {
        return Cow::Borrowed(image);
    }
    let (w, h) = (image.width().min(w), image.height().min(h));
    Cow::Owned(imageops::resize(image, w, h, FilterType::Triangle))
}

/// Returns the angle of a point of a circle, in radians.
fn turn(i: usize) -> f64 {
    TAU * i as f64 / CIRCLE as f64
}

fn outline((x, y): Point, radius: f64) -> Vec<Point> {
    (0..=CIRCLE).map(|i| (x + radius * turn(i).cos(), y + radius * turn(i).sin())).collect()
}

/// Returns the colour of the outline around arrows and circles, which contrasts with their own colour.
fn rim(ink: Ink) -> Rgb<u8> {
    let bright: u32 = ink.0.iter().map(|c| u32::from(*c)).sum();
    if bright > 600 { INK } else { WHITE }
}

/// Draws on a page with lengths in millimetres.
struct Scribe {
    page: Drawing,
    scale: f64,
}

impl Scribe {
    fn style(&self, em: f64) -> Style {
        Style { em: em * self.scale, colour: INK }
    }

    fn point(&self, (x, y): Point) -> Point {
        (x * self.scale, y * self.scale)
    }

    /// Returns the rectangle with edges rounded to pixel boundaries. The edges of images are rounded in the
    /// same way.
    fn snapped(&self, r: Rect) -> Rect {
        let snap = |v: f64| (v * self.scale).round();
        let (x, y) = (snap(r.x), snap(r.y));
        Rect { x, y, w: (snap(r.x + r.w) - x).max(1.0), h: (snap(r.y + r.h) - y).max(1.0) }
    }

    fn text(&mut self, text: &str, at: Point, align: Align, em: f64) {
        self.page.text(text, self.point(at), align, self.style(em));
    }

    fn line(&mut self, points: &[Point], colour: Rgb<u8>, width: f64) {
        let points: Vec<_> = points.iter().map(|p| Some(self.point(*p))).collect();
        let width = width * self.scale;
        let pen = Pen { colour, width, dashed: false };
        self.page.line(&points, pen);
    }

    fn frame(&mut self, r: Rect, colour: Rgb<u8>, width: f64) {
        let (right, bottom) = (r.x + r.w, r.y + r.h);
        let corners = [(r.x, r.y), (right, r.y), (right, bottom), (r.x, bottom), (r.x, r.y)];
        self.line(&corners, colour, width);
    }

    fn part(&mut self, part: &Part, placed: &Placed) {
        let tile = &part.tile;
        for ((image, tag), r) in tile.cells.iter().zip(&placed.cells) {
            let place = self.snapped(*r);
            self.page.image(place, &shrunk(image, place));
            self.tag(tag, *r);
        }
        if let Some(lines) = &tile.chart {
            self.chart(lines, placed.picture);
            self.legend(lines, &placed.legend, placed.picture);
        }
        if tile.sphere {
            self.sphere(placed.picture);
        }
        self.axes(tile, placed.picture);
        if let (Some(bar), Some((r, label))) = (&tile.bar, &placed.bar) {
            self.bar(bar, *r, label);
        }
        for (inset, (crop, large)) in part.insets.iter().zip(&placed.insets) {
            if let (Some([w, h]), Some((image, _))) = (tile.size(), tile.cells.first()) {
                let [x, y, w, h] = inset.pixels([w, h]);
                let cut = imageops::crop_imm(image, x, y, w, h).to_image();
                let place = self.snapped(*large);
                self.page.image(place, &cut);
            }
            for r in [crop, large] {
                self.frame(*r, Rgb(inset.ink.0), 0.35);
            }
        }
        for (arrow, (from, to)) in part.arrows.iter().zip(&placed.arrows) {
            self.arrow(*from, *to, arrow.ink);
        }
        for (circle, (centre, radius)) in part.circles.iter().zip(&placed.circles) {
            let points = outline(*centre, *radius);
            self.line(&points, rim(circle.ink), SHAFT + 2.0 * RIM);
            self.line(&points, Rgb(circle.ink.0), SHAFT);
        }
        if let (Some(bar), Some(r)) = (&part.scale_bar, placed.scale_bar) {
            self.scale_bar(&bar.label, r);
        }
        for (line, at) in &placed.caption {
            self.text(line, *at, Align::Start, CAPTION);
        }
    }

    /// Draws a text on a light background in the upper left corner of a rectangle.
    fn tag(&mut self, text: &str, r: Rect) {
        if text.is_empty() {
            return;
        }
        let style = self.style(TICK);
        let (text, style) = fit(text, style, r.w * self.scale);
        let (w, h) = (width(&text, style) / self.scale + 0.6, 1.1 * TICK);
        let ground = self.snapped(r.within((0.0, 0.0), (w.min(r.w), h.min(r.h))));
        self.page.fill(ground, WHITE, GROUND);
        let at = self.point((r.x + 0.3, r.y + h / 2.0));
        self.page.text(&text, at, Align::Start, style);
    }

    fn axes(&mut self, tile: &Tile, r: Rect) {
        let (names, across, up) = match (&tile.axes, &tile.chart) {
            (Some([x, y]), _) => {
                let across = Marks { major: ticks(x, r.w, true), minor: vec![] };
                ([x.label.clone(), y.label.clone()], across, ticks(y, r.h, false))
            }
            (None, Some(l)) => (l.labels(), l.across((r.w / 11.0).clamp(2.0, 8.0) as usize), l.up()),
            (None, None) => return,
        };
        let bottom = r.y + r.h;
        self.frame(r, INK, THIN);
        for (at, label) in &across.major.marks {
            let x = r.x + at * r.w;
            self.line(&[(x, bottom), (x, bottom + MARK)], INK, THIN);
            self.text(label, (x, bottom + MARK + SPACE + TICK / 2.0 - 0.3), Align::Middle, TICK);
        }
        for x in across.minor.iter().map(|at| r.x + at * r.w) {
            self.line(&[(x, bottom), (x, bottom + MARK / 2.0)], INK, THIN / 2.0);
        }
        let middle = bottom + MARK + 2.0 * SPACE + TICK + NAME / 2.0 - 0.6;
        let (name, style) = fit(&names[0], self.style(NAME), r.w * self.scale);
        let at = self.point((r.x + r.w / 2.0, middle));
        self.page.text(&name, at, Align::Middle, style);
        self.beside(&up, (r.x, -1.0), r, &names[1]);
    }

    /// Draws ticks and an axis name next to a rectangle, at the edge `x`. The ticks are on the left if `way`
    /// is -1, and on the right if `way` is 1.
    fn beside(&mut self, ticks: &Ticks, (x, way): (f64, f64), r: Rect, name: &str) {
        let align = if way < 0.0 { Align::End } else { Align::Start };
        let mut widest = 0.0_f64;
        for (at, label) in &ticks.marks {
            let y = r.y + (1.0 - at) * r.h;
            self.line(&[(x, y), (x + way * MARK, y)], INK, THIN);
            self.text(label, (x + way * (MARK + SPACE / 2.0), y), align, TICK);
            widest = widest.max(width(label, self.style(TICK)) / self.scale);
        }
        let at = x + way * (MARK + SPACE + widest + NAME / 2.0 + SPACE / 2.0);
        let (name, style) = fit(name, self.style(NAME), r.h * self.scale);
        let at = self.point((at, r.y + r.h / 2.0));
        self.page.text_up(&name, at, style);
    }

    fn bar(&mut self, bar: &Bar, r: Rect, label: &str) {
        let place = self.snapped(r);
        self.page.image(place, &bar.colours(BAR_STEPS));
        self.frame(r, INK, THIN / 2.0);
        self.beside(&bar.ticks, (r.x + r.w, 1.0), r, label);
    }

    fn chart(&mut self, lines: &Lines, r: Rect) {
        for (at, _) in &lines.up().marks {
            let y = r.y + (1.0 - at) * r.h;
            self.line(&[(r.x, y), (r.x + r.w, y)], GRID, THIN);
        }
        let scales = Scales { x: lines.x, y: lines.y, plot: self.snapped(r) };
        let (palette, nib) = (|i| lines.colour(i), self.nib());
        chart::curves(&mut self.page, &lines.chart.series, scales, &palette, nib);
        chart::markers(&mut self.page, &lines.chart.series, scales, &palette, nib);
    }

    /// Returns line widths and marker size of series.
    fn nib(&self) -> Nib {
        Nib { line: CURVE * self.scale, bar: THIN * self.scale, radius: DOT * self.scale }
    }

    fn legend(&mut self, lines: &Lines, entries: &[(usize, Point)], r: Rect) {
        let nib = self.nib();
        for (i, at) in entries {
            let series = &lines.chart.series[*i];
            let place = (self.point(*at), SAMPLE * self.scale);
            let colour = lines.colour(series.colour);
            sample(&mut self.page, place, series, colour, nib);
            let x = at.0 + SAMPLE + SPACE;
            let room = (r.x + r.w - x) * self.scale;
            let (name, style) = fit(series.name.trim(), self.style(TICK), room);
            let at = self.point((x, at.1));
            self.page.text(&name, at, Align::Start, style);
        }
    }

    /// Draws the outline, the equator, two meridians and the poles of the Poincaré sphere. Hidden halves of
    /// circles are pale.
    fn sphere(&mut self, r: Rect) {
        let radius = RADIUS * r.w.min(r.h);
        let (x, y) = r.centre();
        let place = |[right, down, _]: [f64; 3]| (x + radius * right, y + radius * down);
        self.line(&outline((x, y), radius), INK, THIN);
        for plane in [[0, 1], [0, 2], [1, 2]] {
            let point = |i: usize| {
                let mut s = [0.0; 3];
                (s[plane[0]], s[plane[1]]) = (turn(i).cos(), turn(i).sin());
                project(s)
            };
            for i in 0..CIRCLE {
                let (a, b) = (point(i), point(i + 1));
                let colour = if a[2] + b[2] >= 0.0 { INK } else { HIDDEN };
                self.line(&[place(a), place(b)], colour, THIN / 2.0);
            }
        }
        for (i, names) in [["H", "V"], ["+45°", "−45°"], ["R", "L"]].into_iter().enumerate() {
            for (name, v) in names.into_iter().zip([NAMES, -NAMES]) {
                let mut s = [0.0; 3];
                s[i] = v;
                self.text(name, place(project(s)), Align::Middle, TICK);
            }
        }
    }

    /// Draws a shaft and a head whose tip is at `to`, with an outline of contrasting brightness.
    fn arrow(&mut self, from: Point, to: Point, ink: Ink) {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let length = dx.hypot(dy);
        if length <= 0.0 || !length.is_finite() {
            return;
        }
        let (dx, dy) = (dx / length, dy / length);
        let long = HEAD.0.min(length);
        let foot = (to.0 - long * dx, to.1 - long * dy);
        let head =
            [to, (foot.0 - HEAD.1 * dy, foot.1 + HEAD.1 * dx), (foot.0 + HEAD.1 * dy, foot.1 - HEAD.1 * dx)];
        let rim = rim(ink);
        let end = (to.0 - 0.9 * long * dx, to.1 - 0.9 * long * dy);
        self.line(&[from, end], rim, SHAFT + 2.0 * RIM);
        self.line(&[head[0], head[1], head[2], head[0]], rim, 2.0 * RIM);
        self.line(&[from, end], Rgb(ink.0), SHAFT);
        let corners: Vec<Point> = head.iter().map(|p| self.point(*p)).collect();
        self.page.area(corners.into_iter(), Rgb(ink.0), 1.0);
    }

    /// Draws a scale bar, which is a white line under a label on a dark background.
    fn scale_bar(&mut self, label: &str, r: Rect) {
        let wide = width(label, self.style(TICK)) / self.scale;
        let ground = Rect { x: r.x - 0.5, y: r.y - TICK - 0.4, w: r.w.max(wide) + 1.0, h: TICK + r.h + 0.8 };
        let ground = self.snapped(ground);
        self.page.fill(ground, Rgb([0; 3]), 0.5);
        let bar = self.snapped(r);
        self.page.fill(bar, WHITE, 1.0);
        let style = Style { colour: WHITE, ..self.style(TICK) };
        let at = self.point((r.x, r.y - TICK / 2.0 - 0.1));
        self.page.text(label, at, Align::Start, style);
    }
}
