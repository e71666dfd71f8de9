//! Computes the layout of a composite, in millimetres from the upper left corner.
//!
//! All images of a row have the same width p = (W - 2 edge - row headings - Σ space next to the columns -
//! (n - 1) gap) / n. An image that spans k columns also covers the space between these columns. The space next
//! to a column is the sum of two widths. The first is the width of the axis to the left of the column. The
//! second is the width of the colour bar to the right of the column. Every row is computed separately, so that
//! every row fills the width of the figure. Only with column headings, all rows have the same columns, and the
//! space next to a column is that of the widest axis and of the widest colour bar.
//!
//! Adjacent panels of a row with equal scales share one colour bar, to the right of the last of these panels.
//! Captions are as wide as their panel with its axis and its colour bar.

use super::parts::{Composite, Inset, Part, letter};
use crate::drawing::{Point, Rect};
use crate::error::FigureError;
use crate::layout::{BAR_STEPS, Bar};
use crate::spec::SignedScale;
use crate::text::{INK, Style, width, wrap};
use crate::ticks::Ticks;
use crate::tile::{Lines, Scaled, Tile};

/// Millimetres per point.
const POINT: f64 = 25.4 / 72.0;
/// Margin of the figure in millimetres.
pub const EDGE: f64 = 1.2;
/// Gap between columns in millimetres.
pub const GAP: f64 = 2.4;
pub const ROW_GAP: f64 = 2.2;
/// Gap between images of one panel in millimetres.
pub const CELL_GAP: f64 = 0.4;
/// Font size (em) of captions in millimetres.
pub const CAPTION: f64 = 7.0 * POINT;
/// Font size (em) of headings in millimetres.
pub const HEADING: f64 = 7.5 * POINT;
/// Font size (em) of tick labels and of text in images, in millimetres.
pub const TICK: f64 = 6.0 * POINT;
/// Font size (em) of axis names in millimetres.
pub const NAME: f64 = 6.5 * POINT;
/// Length of a tick in millimetres.
pub const MARK: f64 = 0.7;
/// Space between adjacent items in millimetres.
pub const SPACE: f64 = 0.6;
/// Width of a colour bar in millimetres.
pub const BAR: f64 = 1.6;
/// Line spacing of text, in em.
pub const LINE: f64 = 1.28;
/// Assumed length of an axis in millimetres. The ticks are measured with this length before the actual length
/// is known.
const NOMINAL: f64 = 30.0;
/// Length of a series' sample in a legend, in millimetres.
pub const SAMPLE: f64 = 5.0;
/// Space between the entries of a legend, in millimetres.
const APART: f64 = 2.6;
/// Maximum height of a colour bar in millimetres.
const HIGHEST_BAR: f64 = 60.0;

/// Space under an image for an axis, in millimetres.
const UNDER: f64 = MARK + SPACE + TICK + SPACE + NAME;

/// The positions of a panel's items, in millimetres.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    pub part: usize,
    /// Rectangle of the image or the plot.
    pub picture: Rect,
    /// Rectangle of each image.
    pub cells: Vec<Rect>,
    /// Rectangle and label of the colour bar.
    pub bar: Option<(Rect, String)>,
    /// Entries of a chart's legend. Each entry has the index of the series and the position of the left end
    /// of the sample. The position is at half the height of capital letters.
    pub legend: Vec<(usize, Point)>,
    /// Caption lines, and the position of the left end of each line at half the height of capital letters.
    pub caption: Vec<(String, Point)>,
    /// For each inset, the rectangle of the crop and the rectangle of the magnified copy.
    pub insets: Vec<(Rect, Rect)>,
    /// For each arrow, the start and the tip.
    pub arrows: Vec<(Point, Point)>,
    /// For each circle, the centre and the radius.
    pub circles: Vec<(Point, f64)>,
    pub scale_bar: Option<Rect>,
}

/// Layout of a composite figure, in millimetres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    pub width: f64,
    pub height: f64,
    pub panels: Vec<Placed>,
    /// Lines of column headings, and the position of the centre of each line.
    pub columns: Vec<(String, Point)>,
    /// Row headings, with the position of the centre and the length of the row. The text is rotated to read
    /// upward.
    pub rows: Vec<(String, Point, f64)>,
    /// Lines of the note below the panels, and the position of the left end of each line.
    pub note: Vec<(String, Point)>,
}

/// Returns a style with the given em in millimetres.
pub(super) fn style(em: f64) -> Style {
    Style { em, colour: INK }
}

/// Returns ticks of pixels or bins along an axis of `length` millimetres.
pub(super) fn ticks(axis: &Scaled, length: f64, across: bool) -> Ticks {
    // `Ticks` assumes a text height of 15 pixels.
    Ticks::coordinates(&axis.coords, length * 15.0 / TICK, across)
}

/// Returns the width of a column of ticks with labels, in millimetres.
fn beside(ticks: &Ticks) -> f64 {
    let widest = ticks.marks.iter().map(|m| width(&m.1, style(TICK)));
    widest.reduce(f64::max).map_or(0.0, |w| MARK + SPACE + w)
}

/// Returns the space that a tile needs to the left of its image, in millimetres.
fn left(tile: &Tile) -> f64 {
    let ticks = match (&tile.axes, &tile.chart) {
        (Some([_, y]), _) => ticks(y, NOMINAL, false),
        (None, Some(lines)) => lines.up(),
        (None, None) => return 0.0,
    };
    NAME + SPACE + beside(&ticks)
}

/// Returns the space for a colour bar to the right of an image, in millimetres.
fn right(bar: Option<&Bar>) -> f64 {
    bar.map_or(0.0, |bar| {
        let name = if bar.label.is_empty() { 0.0 } else { NAME + SPACE };
        1.0 + BAR + beside(&bar.ticks) + name
    })
}

/// A panel of a row.
struct Item<'a> {
    /// Index of the panel.
    number: usize,
    part: &'a Part,
    /// First column.
    column: usize,
    /// The colour bar to draw, with the labels of all panels that share the bar.
    bar: Option<Bar>,
}

impl Item<'_> {
    fn last(&self) -> usize {
        self.column + self.part.span - 1
    }
}

/// Removes the colour bars of panels whose right neighbour has the same scale. The bar of the neighbour
/// receives the labels of all these panels.
fn share_bars(row: &mut [Item]) {
    for i in 1..row.len() {
        let [.., left, right] = &mut row[..=i] else { continue };
        if let (Some(a), Some(b)) = (&left.bar, &mut right.bar)
            && left.column + left.part.span == right.column
            && a.ticks == b.ticks
            && a.colours(BAR_STEPS) == b.colours(BAR_STEPS)
        {
            b.label = joined(&a.label, &b.label);
            left.bar = None;
        }
    }
}

/// End of the labels of normalized elements.
const NORMALIZED: &str = " / M00";

/// Joins the labels of two bars of equal scales. The name of the scale and equal labels occur only once. The
/// label of several normalized elements is that of any element.
fn joined(a: &str, b: &str) -> String {
    let scale = SignedScale::Arctan.words();
    let (a, b, scale) = match (a.strip_suffix(scale), b.strip_suffix(scale)) {
        (Some(a), Some(b)) => (a, b, scale),
        _ => (a, b, ""),
    };
    if a.split(", ").any(|label| label == b) {
        format!("{a}{scale}")
    } else if a.ends_with(NORMALIZED) && b.ends_with(NORMALIZED) {
        format!("Mij{NORMALIZED}{scale}")
    } else {
        format!("{a}, {b}{scale}")
    }
}

/// The columns of one or several rows, in millimetres.
struct Columns {
    /// Left edge of each column's images.
    xs: Vec<f64>,
    /// Width of an image.
    p: f64,
}

/// Returns the columns for rows of a figure. `head` is the width of the row headings.
fn columns<'a>(
    figure: &Composite,
    items: impl Iterator<Item = &'a Item<'a>>,
    head: f64,
) -> Result<Columns, FigureError> {
    let n = figure.columns;
    let (mut lefts, mut rights) = (vec![0.0_f64; n], vec![0.0_f64; n]);
    for item in items {
        lefts[item.column] = lefts[item.column].max(left(&item.part.tile));
        rights[item.last()] = rights[item.last()].max(right(item.bar.as_ref()));
    }
    let beside = lefts.iter().chain(&rights).sum::<f64>();
    let p = (figure.width_mm - 2.0 * EDGE - head - beside - (n - 1) as f64 * GAP) / n as f64;
    if p < 4.0 {
        let must = "small enough that every image is at least 4 mm wide";
        return Err(FigureError::option("columns", n, must));
    }
    let mut x = EDGE + head;
    let place = |(left, right): (&f64, &f64)| {
        let at = x + left;
        x = at + p + right + GAP;
        at
    };
    Ok(Columns { xs: lefts.iter().zip(&rights).map(place).collect(), p })
}

/// Returns the space under an image of width `w` for the axis and the legend, in millimetres.
fn below(tile: &Tile, w: f64) -> f64 {
    let legend = tile.chart.as_ref().map_or(0.0, |lines| {
        let last = legend(lines, w).pop();
        last.map_or(0.0, |(_, (_, y))| y + 0.5 * LINE * TICK)
    });
    if tile.axes.is_some() || tile.chart.is_some() { UNDER + legend } else { 0.0 }
}

/// Returns the entries of a legend in rows whose width is at most `w`. Positions are relative to the upper
/// left corner of the legend.
fn legend(lines: &Lines, w: f64) -> Vec<(usize, Point)> {
    let (mut out, mut x, mut row) = (vec![], 0.0, 0.0);
    let named = lines.chart.series.iter().enumerate();
    for (i, s) in named.filter(|(_, s)| lines.legend && !s.name.trim().is_empty()) {
        let wide = SAMPLE + SPACE + width(s.name.trim(), style(TICK));
        if x > 0.0 && x + wide > w {
            (x, row) = (0.0, row + 1.0);
        }
        out.push((i, (x, SPACE + (row + 0.5) * LINE * TICK)));
        x += wide + APART;
    }
    out
}

/// Returns the height of a tile of width `w`. Also returns the width and height of each image in the tile.
/// All lengths are in millimetres.
fn heights(tile: &Tile, w: f64) -> (f64, (f64, f64)) {
    let Some((image, _)) = tile.cells.first() else {
        return (w * tile.aspect.unwrap_or(1.0), (0.0, 0.0));
    };
    let (columns, rows) = (tile.columns, tile.cells.len().div_ceil(tile.columns));
    let cell = (w - (columns - 1) as f64 * CELL_GAP) / columns as f64;
    let high = match tile.aspect {
        Some(aspect) => cell * aspect,
        // Images with few rows have a minimum height, so that the images remain visible.
        None => (cell * f64::from(image.height()) / f64::from(image.width())).max(1.0),
    };
    (rows as f64 * high + (rows - 1) as f64 * CELL_GAP, (cell, high))
}

/// Returns the rows of the grid. Empty positions are skipped.
fn rows(figure: &Composite) -> Vec<Vec<Item<'_>>> {
    let (mut rows, mut column) = (vec![vec![]], 0);
    for (number, part) in figure.parts.iter().enumerate() {
        let span = part.as_ref().map_or(1, |p| p.span);
        if column + span > figure.columns {
            rows.push(vec![]);
            column = 0;
        }
        let row = rows.last_mut();
        let item = |part| Item { number, part, column, bar: part.tile.bar.clone() };
        row.expect("begins with one row").extend(part.iter().map(item));
        column += span;
    }
    rows.iter_mut().for_each(|row| share_bars(row));
    rows
}

/// Computes the layout of a figure.
///
/// # Errors
/// [`FigureError::Option`] if there is no panel, if a number is out of range, or if no space remains for
/// images.
pub fn layout(figure: &Composite) -> Result<Layout, FigureError> {
    figure.check()?;
    let rows = rows(figure);
    let head = if figure.row_headings.is_empty() { 0.0 } else { HEADING + 2.0 * SPACE };
    let common = if figure.column_headings.is_empty() {
        None
    } else {
        Some(columns(figure, rows.iter().flatten(), head)?)
    };
    let mut out = Layout { width: figure.width_mm, ..Layout::default() };
    let mut y = EDGE;
    if let Some(Columns { xs, p }) = &common {
        let mut bottom = y;
        for (heading, x) in figure.column_headings.iter().zip(xs) {
            let mut top = y;
            for line in wrap(heading, style(HEADING), *p) {
                out.columns.push((line, (x + p / 2.0, top + HEADING / 2.0)));
                top += LINE * HEADING;
            }
            bottom = bottom.max(top - (LINE - 1.0) * HEADING);
        }
        y = bottom + SPACE;
    }
    for (number, row) in rows.iter().enumerate() {
        let own = match common {
            Some(_) => None,
            None => Some(columns(figure, row.iter(), head)?),
        };
        let Some(Columns { xs, p }) = own.as_ref().or(common.as_ref()) else { continue };
        let (mut tallest, mut bottom) = (0.0_f64, y);
        for item in row {
            let w = xs[item.last()] + p - xs[item.column];
            let mut placed = place(item, (xs[item.column], y), w);
            tallest = tallest.max(placed.picture.h);
            let under = placed.picture.y + placed.picture.h + below(&item.part.tile, w);
            let name = if figure.letters {
                format!("{} {}", letter(out.panels.len()), item.part.caption)
            } else {
                item.part.caption.clone()
            };
            let left = left(&item.part.tile);
            let lines = wrap(&name, style(CAPTION), left + w + right(item.bar.as_ref()));
            let line = |k: usize| under + SPACE + k as f64 * LINE * CAPTION;
            bottom = bottom.max(if lines.is_empty() { under } else { line(lines.len()) });
            let x = placed.picture.x - left;
            let at = |(k, text)| (text, (x, line(k) + LINE * CAPTION / 2.0));
            placed.caption = lines.into_iter().enumerate().map(at).collect();
            out.panels.push(placed);
        }
        if let Some(heading) = figure.row_headings.get(number) {
            let middle = (EDGE + HEADING / 2.0, y + tallest / 2.0);
            out.rows.push((heading.clone(), middle, tallest));
        }
        y = bottom + ROW_GAP;
    }
    let text = denoised(figure, &out.panels);
    for line in wrap(&text, style(TICK), figure.width_mm - 2.0 * EDGE) {
        out.note.push((line, (EDGE, y + LINE * TICK / 2.0)));
        y += LINE * TICK;
    }
    out.height = if text.is_empty() { y - ROW_GAP } else { y } + EDGE;
    Ok(out)
}

/// Returns a text that lists the denoised panels, or an empty text if no panel is denoised. Without letters,
/// panels are numbered from 1.
fn denoised(figure: &Composite, panels: &[Placed]) -> String {
    let is = |p: &Placed| figure.parts[p.part].as_ref().is_some_and(|part| part.denoised);
    let name = |i: usize| if figure.letters { letter(i) } else { (i + 1).to_string() };
    let mut runs: Vec<(usize, usize)> = vec![];
    for i in (0..panels.len()).filter(|i| is(&panels[*i])) {
        match runs.last_mut() {
            Some((_, last)) if *last + 1 == i => *last = i,
            _ => runs.push((i, i)),
        }
    }
    if runs[..] == [(0, panels.len() - 1)] {
        return "Denoised.".into();
    }
    let texts: Vec<String> = runs
        .iter()
        .map(|(a, b)| match b - a {
            0 => name(*a),
            1 => format!("{}, {}", name(*a), name(*b)),
            _ => format!("{}–{}", name(*a), name(*b)),
        })
        .collect();
    match (&texts[..], figure.letters) {
        ([], _) => String::new(),
        (texts, true) => format!("Denoised: {}.", texts.join(", ")),
        (texts, false) => format!("Denoised panels: {}.", texts.join(", ")),
    }
}

/// Returns the layout of a panel. The panel's image has its upper left corner at `(x, y)` and the width `w`, in
/// millimetres.
fn place(item: &Item, (x, y): Point, w: f64) -> Placed {
    let part = item.part;
    let tile = &part.tile;
    let (h, (cell, high)) = heights(tile, w);
    let picture = Rect { x, y, w, h };
    let cells = (0..tile.cells.len()).map(|i| {
        let (column, row) = ((i % tile.columns) as f64, (i / tile.columns) as f64);
        picture.within((column * (cell + CELL_GAP), row * (high + CELL_GAP)), (cell, high))
    });
    let at = |[x, y]: [f64; 2]| (picture.x + x * w, picture.y + y * h);
    Placed {
        part: item.number,
        picture,
        cells: cells.collect(),
        bar: item.bar.as_ref().map(|bar| {
            let place = picture.within((w + 1.0, 0.0), (BAR, h.min(HIGHEST_BAR)));
            (place, bar.label.clone())
        }),
        legend: tile.chart.as_ref().map_or(vec![], |lines| {
            let all = legend(lines, w).into_iter();
            all.map(|(i, at)| (i, (x + at.0, y + h + UNDER + at.1))).collect()
        }),
        caption: vec![],
        insets: part.insets.iter().map(|i| inset(i, tile, picture)).collect(),
        arrows: part.arrows.iter().map(|a| (at(a.from), at(a.to))).collect(),
        circles: part.circles.iter().map(|c| (at(c.at), c.radius * w)).collect(),
        scale_bar: part.scale_bar.as_ref().map(|s| {
            let length = s.share * w;
            picture.within((1.2, h - 1.6), (length, 0.5))
        }),
    }
}

/// Returns two rectangles: an inset's crop, rounded to whole pixels, and the magnified copy.
fn inset(inset: &Inset, tile: &Tile, picture: Rect) -> (Rect, Rect) {
    let size = tile.size().unwrap_or([1, 1]);
    let [px, py] = [picture.w / f64::from(size[0]), picture.h / f64::from(size[1])];
    let [x, y, w, h] = inset.pixels(size).map(f64::from);
    let crop = picture.within((x * px, y * py), (w * px, h * py));
    let large = (crop.w * inset.magnify, crop.h * inset.magnify);
    let to = (
        if inset.corner.right { picture.w - large.0 } else { 0.0 },
        if inset.corner.lower { picture.h - large.1 } else { 0.0 },
    );
    (crop, picture.within(to, large))
}
