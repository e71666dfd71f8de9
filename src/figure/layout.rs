//! Lays out one plot on a white page. The page has a title, a frame, ticks, axis labels, a colour bar and
//! notes. The margins fit these items.

use image::{Rgb, RgbImage};

use super::colour::signed;
use super::drawing::{Drawing, Point, Rect};
use super::text::{Align, INK, LABEL, NOTE, Style, TICK, TITLE, fit, width, wrap};
use super::ticks::{Ticks, brief};
use super::white::White;
use crate::spec::SignedScale;

/// Unit of camera values, which are spectral radiances.
pub const CAMERA_UNIT: &str = "W/(m² sr nm)";
/// Colour of grid lines in a plot.
pub const GRID: Rgb<u8> = Rgb([232, 232, 236]);
/// Minimum width of a page in pixels. A page of this width has space for titles and notes.
const PAGE_LEAST: f64 = 480.0;
/// Maximum plot width, in pixels, for text of the nominal size. On wider plots, the text is enlarged by a
/// factor of at most [`LARGEST`].
const NOMINAL: f64 = 900.0;
const LARGEST: f64 = 1.6;
/// Margin of the page in pixels.
const EDGE: f64 = 18.0;
/// Number of colours in a colour bar.
pub const BAR_STEPS: u32 = 256;

/// Returns the scale factor of text and distances for a plot that is `plot_width` pixels wide.
pub fn growth(plot_width: f64) -> f64 {
    (plot_width / NOMINAL).clamp(1.0, LARGEST)
}

/// Returns the text of a note on the value shown as white. The note contains the value in the camera's units,
/// and the origin of the value.
pub fn white_words(white: White, origin: &str) -> String {
    match white {
        White::Value(v) => format!("{} {CAMERA_UNIT}{origin}", brief(f64::from(v))),
        White::Nothing => "undefined (no positive values)".into(),
    }
}

#[derive(Clone, Debug, Default)]
pub struct Axis {
    /// Label of the axis, with the unit. The label may be empty.
    pub label: String,
    /// Ticks of the axis. Positions are measured from the left or from the bottom.
    pub ticks: Ticks,
    /// Whether positions are measured from the top instead of the bottom.
    pub downward: bool,
}

impl Axis {
    /// Creates an axis that points right or up.
    pub fn new(label: impl Into<String>, ticks: Ticks) -> Self {
        let label = label.into();
        Self { label, ticks, downward: false }
    }
}

/// A colour bar to the right of the plot.
#[derive(Clone, Debug)]
pub struct Bar {
    /// Label of the colour bar, with the unit.
    pub label: String,
    /// Ticks of the colour bar. Positions are measured from the bottom.
    pub ticks: Ticks,
    /// Function that returns the colour at a position 0..1 from the bottom.
    pub colour: fn(f32) -> Rgb<u8>,
}

/// A page with all items around the data.
#[derive(Default)]
pub struct Page<'a> {
    /// Title of the page. The title may be empty.
    pub title: &'a str,
    pub x: Axis,
    pub y: Axis,
    pub bar: Option<Bar>,
    /// Notes under the plot, one paragraph each.
    pub notes: Vec<String>,
    /// Whether to omit the frame around the plot.
    pub frameless: bool,
}

/// Text styles and distances for the size of a plot.
struct Measure {
    title: Style,
    label: Style,
    tick: Style,
    note: Style,
    tick_length: f64,
    /// Distance between ticks and their labels, in pixels.
    gap: f64,
    /// Distance between tick labels and the label of the axis, in pixels.
    space: f64,
    bar_gap: f64,
    bar_width: f64,
    note_line: f64,
}

impl Measure {
    fn of(plot_width: f64) -> Self {
        let k = growth(plot_width);
        let px = |v: f64| (v * k).round();
        Self {
            title: TITLE.scaled(k),
            label: LABEL.scaled(k),
            tick: TICK.scaled(k),
            note: NOTE.scaled(k),
            tick_length: px(6.0),
            gap: px(6.0),
            space: px(10.0),
            bar_gap: px(22.0),
            bar_width: px(20.0),
            note_line: px(21.0),
        }
    }

    /// Returns the width in pixels of a column of ticks with labels.
    fn beside(&self, ticks: &Ticks) -> f64 {
        let widest = ticks.marks.iter().map(|m| width(&m.1, self.tick).ceil());
        widest.reduce(f64::max).map_or(0.0, |w| self.tick_length + self.gap + w)
    }

    /// Returns the space in pixels for the label of an axis, or 0 for an empty label.
    fn name(&self, label: &str) -> f64 {
        if label.is_empty() { 0.0 } else { self.label.em.floor() + self.space }
    }
}

impl Page<'_> {
    /// Lays out the page around a plot of `w` × `h` pixels, and draws all items except the data.
    /// The returned drawing contains the rectangle of the data.
    pub fn draw(&self, w: f64, h: f64) -> Drawing {
        let m = Measure::of(w);
        let (y_ticks, y_label) = (m.beside(&self.y.ticks), m.name(&self.y.label));
        let x_ticks =
            if self.x.ticks.marks.is_empty() { 0.0 } else { m.tick_length + m.gap + m.tick.em.floor() };
        let left = EDGE + y_label + y_ticks;
        let right = self
            .bar
            .as_ref()
            .map_or(EDGE + 8.0, |bar| m.bar_gap + m.bar_width + m.beside(&bar.ticks) + m.name("|") + EDGE);
        let page_w = (left + w + right).max(PAGE_LEAST);
        let left = left + ((page_w - left - w - right) / 2.0).floor();
        // The page is high enough for the label along a short plot.
        let along = width(&self.y.label, m.label)
            .max(self.bar.as_ref().map_or(0.0, |bar| width(&bar.label, m.label)));
        let sag = ((along - h) / 2.0).ceil().max(0.0);
        let room = page_w - 2.0 * EDGE;
        let lines: Vec<String> = self.notes.iter().flat_map(|note| wrap(note, m.note, room)).collect();
        let title = self.title.trim();
        let top = EDGE + sag + if title.is_empty() { 0.0 } else { m.title.em.floor() + 16.0 };
        let below = (x_ticks + m.name(&self.x.label)).max(sag + 4.0);
        let notes = if lines.is_empty() { 0.0 } else { 10.0 + m.note_line * lines.len() as f64 };
        let mut page = Drawing::new(page_w, top + h + below + notes + EDGE, self.title);
        page.data = Rect { x: left, y: top, w, h };
        let centre = page.data.centre();
        let bottom = top + h;

        // Draws a text centred on the plot. The text is shifted if necessary to stay on the page.
        let across = |page: &mut Drawing, text: &str, y: f64, style: Style| {
            let (text, style) = fit(text, style, room);
            let half = EDGE + width(&text, style) / 2.0;
            let x = centre.0.min(page_w - half).max(half);
            page.text(&text, (x, y), Align::Middle, style);
        };
        across(&mut page, title, EDGE + m.title.em / 2.0, m.title);
        if !self.frameless {
            page.frame_data();
        }
        for (at, label) in &self.x.ticks.marks {
            let x = left + at * w;
            page.tick((x, bottom + 1.0), (0.0, m.tick_length), INK);
            let y = bottom + m.tick_length + m.gap - 1.0 + m.tick.em / 2.0;
            page.text(label, (x, y), Align::Middle, m.tick);
        }
        let y = bottom + x_ticks + m.space + m.label.em / 2.0 - 2.0;
        across(&mut page, &self.x.label, y, m.label);
        for (at, label) in &self.y.ticks.marks {
            let y = top + h * if self.y.downward { *at } else { 1.0 - at };
            page.tick((left - 1.0 - m.tick_length, y), (m.tick_length, 0.0), INK);
            let x = left - m.tick_length - m.gap;
            page.text(label, (x, y), Align::End, m.tick);
        }
        let x = left - y_ticks - y_label + m.label.em / 2.0;
        page.text_up(&self.y.label, (x, centre.1), m.label);
        if let Some(bar) = &self.bar {
            let place = page.data.within((w + m.bar_gap, 0.0), (m.bar_width, h));
            bar.draw(&mut page, place, &m);
        }
        let mut y = bottom + below + 10.0 + m.note_line / 2.0;
        for line in lines {
            let (line, style) = fit(&line, m.note, room);
            page.text(&line, (EDGE, y), Align::Start, style);
            y += m.note_line;
        }
        page
    }
}

impl Bar {
    /// Creates a colour bar for signed values between ± `limit`. `label` returns the label for the given
    /// ticks.
    pub fn signed(limit: f64, label: impl FnOnce(&Ticks) -> String) -> Self {
        let ticks = Ticks::linear(-limit, limit, 8);
        Self { label: label(&ticks), ticks, colour: |v| signed(2.0 * v - 1.0) }
    }

    /// Creates a colour bar for signed values between ± `limit` on a scale. `label` returns the label for the
    /// given ticks, without the name of the scale.
    pub fn scaled(scale: SignedScale, limit: f64, label: impl FnOnce(&Ticks) -> String) -> Self {
        let bar = Self::signed(limit, |_| String::new());
        let ticks = match scale {
            SignedScale::Linear => bar.ticks,
            SignedScale::Arctan => Ticks::arctan(limit),
        };
        Self { label: label(&ticks), ticks, ..bar }
    }

    /// Returns an image of the bar's colours. The image is one pixel wide, with the upper end of the bar
    /// first.
    pub fn colours(&self, steps: u32) -> RgbImage {
        RgbImage::from_fn(1, steps, |_, y| (self.colour)(1.0 - (y as f32 + 0.5) / steps as f32))
    }

    /// Draws the bar into a rectangle, with ticks and label to the right of the rectangle.
    fn draw(&self, page: &mut Drawing, r: Rect, m: &Measure) {
        let steps = (r.h as u32).clamp(1, BAR_STEPS);
        page.image(r, &self.colours(steps));
        page.frame(r, INK);
        let edge = r.x + r.w;
        for (at, label) in &self.ticks.marks {
            let y = r.y + (1.0 - at) * r.h;
            page.tick((edge + 1.0, y), (m.tick_length, 0.0), INK);
            page.text(label, (edge + m.tick_length + m.gap, y), Align::Start, m.tick);
        }
        let x = edge + m.beside(&self.ticks) + m.space + m.label.em / 2.0;
        page.text_up(&self.label, (x, r.centre().1), m.label);
    }
}

/// A grid of panels of equal size. Each panel has a name above it.
pub struct Panels {
    pub size: (f64, f64),
    /// Space for the name above a panel, in pixels.
    pub head: f64,
    /// Space between panels, in pixels.
    pub gap: f64,
    /// Number of panels per row, at least 1.
    pub columns: usize,
}

impl Panels {
    /// Returns the width and height, in pixels, of a plot with `count` panels (at least one).
    pub fn extent(&self, count: usize) -> (f64, f64) {
        let (across, _) = self.corner(count.min(self.columns) - 1);
        let (_, down) = self.corner(count - 1);
        (across + self.size.0, down + self.size.1)
    }

    /// Returns the upper left corner of a panel relative to the upper left corner of the plot.
    pub fn corner(&self, i: usize) -> Point {
        let (column, row) = ((i % self.columns) as f64, (i / self.columns) as f64);
        (column * (self.size.0 + self.gap), self.head + row * (self.size.1 + self.gap + self.head))
    }

    /// Returns the rectangle of a panel on a page.
    pub fn place(&self, page: &Drawing, i: usize) -> Rect {
        page.data.within(self.corner(i), self.size)
    }

    /// Creates a page for `count` panels (at least one) with a bar and notes.
    pub fn page(&self, count: usize, title: &str, bar: Option<Bar>, notes: Vec<String>) -> Drawing {
        let page = Page { title, bar, notes, frameless: true, ..Page::default() };
        let (w, h) = self.extent(count);
        page.draw(w, h)
    }

    /// Draws the lines of a panel's name above the panel. Each line has its own style.
    pub fn name(&self, page: &mut Drawing, i: usize, lines: &[(&str, Style)]) {
        let place = self.place(page, i);
        let line = self.head / lines.len().max(1) as f64;
        for (k, (text, style)) in lines.iter().enumerate() {
            let (text, style) = fit(text, *style, self.size.0);
            let y = place.y - self.head + (k as f64 + 0.5) * line;
            page.text(&text, (place.x, y - 1.0), Align::Start, style);
        }
    }
}
