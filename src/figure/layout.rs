//! One plot on a white page: title, frame, ticks, axis labels, colour bar and notes, with margins made to measure.

use image::{Rgb, RgbImage};

use super::FigureError;
use super::text::{Align, INK, LABEL, NOTE, Style, TICK, TITLE, blend, fit, width, wrap, write, write_up};
use super::ticks::Ticks;

/// Unit of every camera value.
pub const CAMERA_UNIT: &str = "W/(m² sr nm)";
/// A page is never narrower than this, so that titles and notes have room.
const PAGE_LEAST: u32 = 480;
/// Plots up to this width have text of the nominal size; on wider ones it grows, up to [`LARGEST`] times.
const NOMINAL: f32 = 900.0;
const LARGEST: f32 = 1.6;
/// Margin of the page.
const EDGE: u32 = 18;

/// Text and distances at the size that suits a plot.
#[derive(Clone, Copy, Debug)]
pub struct Measure {
    /// Times the nominal size.
    pub k: f32,
    title: Style,
    label: Style,
    /// Tick labels.
    pub tick: Style,
    note: Style,
    tick_length: u32,
    space: u32,
    gap: u32,
    bar_gap: u32,
    bar_width: u32,
    note_line: u32,
}

impl Measure {
    /// For a plot of this width.
    #[must_use]
    pub fn of(plot_width: usize) -> Self {
        let k = (plot_width as f32 / NOMINAL).clamp(1.0, LARGEST);
        let px = |v: f32| (v * k).round() as u32;
        Self {
            k,
            title: TITLE.scaled(k),
            label: LABEL.scaled(k),
            tick: TICK.scaled(k),
            note: NOTE.scaled(k),
            tick_length: px(6.0),
            space: px(10.0),
            gap: px(6.0),
            bar_gap: px(22.0),
            bar_width: px(20.0),
            note_line: px(21.0),
        }
    }
}

/// A rectangle of picture pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub w: u32,
    /// Rows.
    pub h: u32,
}

/// An axis with its label.
#[derive(Clone, Debug, Default)]
pub struct Axis {
    /// Label with unit; empty for none.
    pub label: String,
    /// Ticks; places count from the left or from the bottom.
    pub ticks: Ticks,
    /// Places count from the top instead.
    pub downward: bool,
}

/// A colour bar right of the plot.
pub struct Bar<'a> {
    /// Label with unit.
    pub label: String,
    /// Ticks; places count from the bottom.
    pub ticks: Ticks,
    /// Colour at a place 0..1 from the bottom.
    pub colour: &'a dyn Fn(f32) -> Rgb<u8>,
}

/// Everything around the data.
#[derive(Default)]
pub struct Page<'a> {
    /// Title; empty for none.
    pub title: &'a str,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Colour bar.
    pub bar: Option<Bar<'a>>,
    /// Notes under the plot, one paragraph each.
    pub notes: Vec<String>,
    /// Leave the frame around the plot out.
    pub frameless: bool,
}

fn widest(ticks: &Ticks, style: Style) -> Result<u32, FigureError> {
    ticks
        .marks
        .iter()
        .try_fold(0, |m, (_, label)| Ok(m.max(width(label, style)?.ceil() as u32)))
}

/// Fills a rectangle.
pub fn fill(img: &mut RgbImage, r: Rect, colour: Rgb<u8>) {
    for y in r.y..(r.y + r.h).min(img.height()) {
        for x in r.x..(r.x + r.w).min(img.width()) {
            img.put_pixel(x, y, colour);
        }
    }
}

/// Draws a frame of one pixel just outside a rectangle.
pub fn frame(img: &mut RgbImage, r: Rect, colour: Rgb<u8>) {
    let (x0, y0) = (i64::from(r.x) - 1, i64::from(r.y) - 1);
    let (x1, y1) = (i64::from(r.x + r.w), i64::from(r.y + r.h));
    for x in x0..=x1 {
        blend(img, x, y0, colour, 1.0);
        blend(img, x, y1, colour, 1.0);
    }
    for y in y0 + 1..y1 {
        blend(img, x0, y, colour, 1.0);
        blend(img, x1, y, colour, 1.0);
    }
}

impl Page<'_> {
    /// Lays the page out around a plot of `w` × `h` pixels and draws all but the data, whose place is returned.
    pub fn draw(&self, w: u32, h: u32) -> Result<(RgbImage, Rect), FigureError> {
        let m = Measure::of(w as usize);
        let (line, space, gap) = (m.label.em as u32, m.space, m.gap);
        let has_y = !self.y.ticks.marks.is_empty();
        let has_x = !self.x.ticks.marks.is_empty();
        let y_ticks = if has_y {
            m.tick_length + gap + widest(&self.y.ticks, m.tick)?
        } else {
            0
        };
        let y_label = if self.y.label.is_empty() { 0 } else { line + space };
        let x_ticks = if has_x {
            m.tick_length + gap + m.tick.em as u32
        } else {
            0
        };
        let x_label = if self.x.label.is_empty() { 0 } else { line + space };
        let right = match &self.bar {
            Some(bar) => {
                m.bar_gap
                    + m.bar_width
                    + m.tick_length
                    + gap
                    + widest(&bar.ticks, m.tick)?
                    + space
                    + line
                    + EDGE
            }
            None => EDGE + 8,
        };
        let left = EDGE + y_label + y_ticks;
        let mut page_w = left + w + right;
        let shift = PAGE_LEAST.saturating_sub(page_w) / 2;
        page_w = page_w.max(PAGE_LEAST);
        // A short plot still leaves room for the labels that run along its height.
        let mut along: f32 = width(&self.y.label, m.label)?;
        if let Some(bar) = &self.bar {
            along = along.max(width(&bar.label, m.label)?);
        }
        let sag = (along as u32).saturating_sub(h).div_ceil(2);
        let room = (page_w - 2 * EDGE) as f32;
        let mut lines = Vec::new();
        for note in &self.notes {
            lines.extend(wrap(note, m.note, room)?);
        }
        let top = if self.title.trim().is_empty() {
            EDGE
        } else {
            EDGE + m.title.em as u32 + 16
        } + sag;
        let below = (x_ticks + x_label).max(sag + 4);
        let notes = if lines.is_empty() {
            0
        } else {
            10 + m.note_line * lines.len() as u32
        };
        let page_h = top + h + below + notes + EDGE;
        let mut img = RgbImage::from_pixel(page_w, page_h, Rgb([255; 3]));
        let plot = Rect {
            x: left + shift,
            y: top,
            w,
            h,
        };
        let centre = plot.x as f32 + w as f32 / 2.0;

        if !self.title.trim().is_empty() {
            let (title, style) = fit(self.title.trim(), m.title, room)?;
            let half = width(&title, style)? / 2.0;
            let edge = EDGE as f32 + half;
            let x = centre.clamp(edge, (page_w as f32 - edge).max(edge));
            write(
                &mut img,
                &title,
                (x, EDGE as f32 + m.title.em / 2.0),
                Align::Middle,
                style,
            )?;
        }
        if !self.frameless {
            frame(&mut img, plot, INK);
        }
        let bottom = plot.y + h;
        for (at, label) in &self.x.ticks.marks {
            let x = f64::from(plot.x) + at * f64::from(w) - 0.5;
            vertical(&mut img, x, bottom + 1, m.tick_length);
            let y = (bottom + m.tick_length + m.gap - 1) as f32 + m.tick.em / 2.0;
            write(&mut img, label, (x as f32 + 0.5, y), Align::Middle, m.tick)?;
        }
        if !self.x.label.is_empty() {
            let y = (bottom + x_ticks + space) as f32 + m.label.em / 2.0 - 2.0;
            page_text(&mut img, &self.x.label, (centre, y), m.label)?;
        }
        for (at, label) in &self.y.ticks.marks {
            let at = if self.y.downward { *at } else { 1.0 - at };
            let y = f64::from(plot.y) + at * f64::from(h) - 0.5;
            horizontal(
                &mut img,
                i64::from(plot.x) - 1 - i64::from(m.tick_length),
                y,
                m.tick_length,
            );
            let x = plot.x as f32 - (m.tick_length + m.gap) as f32;
            write(&mut img, label, (x, y as f32 + 0.5), Align::End, m.tick)?;
        }
        let middle = plot.y as f32 + h as f32 / 2.0;
        if !self.y.label.is_empty() {
            let x = (plot.x - y_ticks - y_label) as f32 + m.label.em / 2.0;
            write_up(&mut img, &self.y.label, (x, middle), Align::Middle, m.label)?;
        }
        if let Some(bar) = &self.bar {
            let place = Rect {
                x: plot.x + w + m.bar_gap,
                y: plot.y,
                w: m.bar_width,
                h,
            };
            bar.draw(&mut img, place, &m)?;
        }
        let mut y = (bottom + below + 10) as f32 + m.note_line as f32 / 2.0;
        for text in lines {
            let (text, style) = fit(&text, m.note, room)?;
            write(&mut img, &text, (EDGE as f32, y), Align::Start, style)?;
            y += m.note_line as f32;
        }
        Ok((img, plot))
    }
}

impl Bar<'_> {
    /// Draws the bar into its rectangle, ticks and label right of it.
    fn draw(&self, img: &mut RgbImage, r: Rect, m: &Measure) -> Result<(), FigureError> {
        for y in 0..r.h {
            let v = 1.0 - (y as f32 + 0.5) / r.h as f32;
            fill(
                img,
                Rect {
                    y: r.y + y,
                    h: 1,
                    ..r
                },
                (self.colour)(v),
            );
        }
        frame(img, r, INK);
        let edge = r.x + r.w;
        for (at, label) in &self.ticks.marks {
            let y = f64::from(r.y) + (1.0 - at) * f64::from(r.h) - 0.5;
            horizontal(img, i64::from(edge) + 1, y, m.tick_length);
            let at = ((edge + m.tick_length + m.gap) as f32, y as f32 + 0.5);
            write(img, label, at, Align::Start, m.tick)?;
        }
        let x =
            (edge + m.tick_length + m.gap + widest(&self.ticks, m.tick)? + m.space) as f32 + m.label.em / 2.0;
        write_up(
            img,
            &self.label,
            (x, r.y as f32 + r.h as f32 / 2.0),
            Align::Middle,
            m.label,
        )
    }
}

/// A text centred at a point, but kept on the page.
fn page_text(img: &mut RgbImage, text: &str, (x, y): (f32, f32), style: Style) -> Result<(), FigureError> {
    let room = img.width() as f32 - 2.0 * EDGE as f32;
    let (text, style) = fit(text, style, room)?;
    let edge = EDGE as f32 + width(&text, style)? / 2.0;
    let x = x.clamp(edge, (img.width() as f32 - edge).max(edge));
    write(img, &text, (x, y), Align::Middle, style)
}

fn vertical(img: &mut RgbImage, x: f64, top: u32, length: u32) {
    for y in 0..length {
        blend(img, x.round() as i64, i64::from(top + y), INK, 1.0);
    }
}

fn horizontal(img: &mut RgbImage, left: i64, y: f64, length: u32) {
    for x in 0..i64::from(length) {
        blend(img, left + x, y.round() as i64, INK, 1.0);
    }
}
