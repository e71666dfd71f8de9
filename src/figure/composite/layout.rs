//! Computes the layout of a composite, in millimetres from the upper left corner.
//!
//! All images have the same width p = (W - 2 edge - row headings - Σ space next to the columns - (n - 1)
//! gap) / n. An image that spans k columns also covers the space between these columns. The space next to a
//! column is the sum of two widths. The first is the width of the widest axis to the left of the column. The
//! second is the width of the widest colour bar to the right of the column. The space above and below a row
//! is computed in the same way.

use super::parts::{Composite, Inset, Part, letter};
use crate::drawing::{Point, Rect};
use crate::error::FigureError;
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
    pub bar: Option<Rect>,
    /// Entries of a chart's legend. Each entry has the index of the series and the position of the left end
    /// of the sample. The position is at half the height of capital letters.
    pub legend: Vec<(usize, Point)>,
    /// Caption lines, and the position of the left end of each line at half the height of capital letters.
    pub caption: Vec<(String, Point)>,
    /// For each inset, the rectangle of the crop and the rectangle of the magnified copy.
    pub insets: Vec<(Rect, Rect)>,
    /// For each arrow, the start and the tip.
    pub arrows: Vec<(Point, Point)>,
    pub scale_bar: Option<Rect>,
}

/// Layout of a composite figure, in millimetres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    pub width: f64,
    pub height: f64,
    pub panels: Vec<Placed>,
    /// Column headings, and the position of the centre of each heading.
    pub columns: Vec<(String, Point)>,
    /// Row headings, and the position of the centre of each heading. The text is rotated to read upward.
    pub rows: Vec<(String, Point)>,
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

/// Returns the space that a tile needs to the right of its image, in millimetres.
fn right(tile: &Tile) -> f64 {
    tile.bar.as_ref().map_or(0.0, |bar| {
        let name = if bar.label.is_empty() { 0.0 } else { NAME + SPACE };
        1.0 + BAR + beside(&bar.ticks) + name
    })
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

/// Returns the rows of the grid as lists of panels. Each panel has its index, part and column. Empty
/// positions are skipped.
fn rows(figure: &Composite) -> Vec<Vec<(usize, &Part, usize)>> {
    let (mut rows, mut column) = (vec![vec![]], 0);
    for (i, part) in figure.parts.iter().enumerate() {
        let span = part.as_ref().map_or(1, |p| p.span);
        if column + span > figure.columns {
            rows.push(vec![]);
            column = 0;
        }
        let row = rows.last_mut();
        row.expect("begins with one row").extend(part.iter().map(|part| (i, part, column)));
        column += span;
    }
    rows
}

/// Computes the layout of a figure.
///
/// # Errors
/// [`FigureError::Option`] if there is no panel, if a number is out of range, or if no space remains for
/// images.
pub fn layout(figure: &Composite) -> Result<Layout, FigureError> {
    figure.check()?;
    let n = figure.columns;
    let rows = rows(figure);
    let (mut lefts, mut rights) = (vec![0.0_f64; n], vec![0.0_f64; n]);
    for &(_, part, column) in rows.iter().flatten() {
        lefts[column] = lefts[column].max(left(&part.tile));
        let last = column + part.span - 1;
        rights[last] = rights[last].max(right(&part.tile));
    }
    let head = if figure.row_headings.is_empty() { 0.0 } else { HEADING + 2.0 * SPACE };
    let taken: f64 =
        2.0 * EDGE + head + lefts.iter().sum::<f64>() + rights.iter().sum::<f64>() + (n - 1) as f64 * GAP;
    let p = (figure.width_mm - taken) / n as f64;
    if p < 4.0 {
        let must = "small enough that every image is at least 4 mm wide";
        return Err(FigureError::option("columns", n, must));
    }
    // Left edge of each column's image.
    let mut xs = vec![];
    let mut x = EDGE + head;
    for column in 0..n {
        x += lefts[column];
        xs.push(x);
        x += p + rights[column] + GAP;
    }
    let mut out = Layout { width: figure.width_mm, ..Layout::default() };
    let mut y = EDGE;
    if !figure.column_headings.is_empty() {
        let middle = y + HEADING / 2.0;
        for (heading, x) in figure.column_headings.iter().zip(&xs) {
            out.columns.push((heading.clone(), (x + p / 2.0, middle)));
        }
        y += HEADING + SPACE;
    }
    for (number, row) in rows.iter().enumerate() {
        let mut under = 0.0_f64;
        let mut tallest = 0.0_f64;
        let first = out.panels.len();
        for &(i, part, column) in row {
            let last = column + part.span - 1;
            let w = xs[last] + p - xs[column];
            let placed = place(part, i, (xs[column], y), w);
            tallest = tallest.max(placed.picture.h);
            under = under.max(below(&part.tile, w));
            out.panels.push(placed);
        }
        let mut captions = 0.0_f64;
        for (i, (placed, (_, part, _))) in (first..).zip(out.panels[first..].iter_mut().zip(row)) {
            let name =
                if figure.letters { format!("{} {}", letter(i), part.caption) } else { part.caption.clone() };
            let room = placed.picture.w + right(&part.tile);
            let top = y + tallest + under + SPACE;
            let lines = wrap(&name, style(CAPTION), room);
            for (k, line) in lines.into_iter().enumerate() {
                let middle = top + (k as f64 + 0.5) * LINE * CAPTION;
                captions = captions.max(SPACE + (k as f64 + 1.0) * LINE * CAPTION);
                placed.caption.push((line, (placed.picture.x, middle)));
            }
        }
        if let Some(heading) = figure.row_headings.get(number) {
            let middle = (EDGE + HEADING / 2.0, y + tallest / 2.0);
            out.rows.push((heading.clone(), middle));
        }
        y += tallest + under + captions + ROW_GAP;
    }
    out.height = y - ROW_GAP + EDGE;
    Ok(out)
}

/// Returns the layout of a part. The part's image has its upper left corner at `(x, y)` and the width `w`, in
/// millimetres.
fn place(part: &Part, number: usize, (x, y): Point, w: f64) -> Placed {
    let tile = &part.tile;
    let (h, (cell, high)) = heights(tile, w);
    let picture = Rect { x, y, w, h };
    let cells = (0..tile.cells.len()).map(|i| {
        let (column, row) = ((i % tile.columns) as f64, (i / tile.columns) as f64);
        picture.within((column * (cell + CELL_GAP), row * (high + CELL_GAP)), (cell, high))
    });
    let at = |[x, y]: [f64; 2]| (picture.x + x * w, picture.y + y * h);
    Placed {
        part: number,
        picture,
        cells: cells.collect(),
        bar: tile.bar.as_ref().map(|_| picture.within((w + 1.0, 0.0), (BAR, h.min(HIGHEST_BAR)))),
        legend: tile.chart.as_ref().map_or(vec![], |lines| {
            let all = legend(lines, w).into_iter();
            all.map(|(i, at)| (i, (x + at.0, y + h + UNDER + at.1))).collect()
        }),
        caption: vec![],
        insets: part.insets.iter().map(|i| inset(i, tile, picture)).collect(),
        arrows: part.arrows.iter().map(|a| (at(a.from), at(a.to))).collect(),
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
