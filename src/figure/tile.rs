//! Defines the contents of one panel of a composite, before scaling. A panel contains images or a chart, with
//! the axes and the colour bar.
//!
//! Images have one pixel per value. The composite scales them.

use image::{Rgb, RgbImage, imageops};

use super::chart::{self, Chart, Marks, Scale as Along, label, marks};
use super::colour::{self, UNDEFINED, cyclic, photo, sequential, signed};
use super::composite::pixels_of;
use super::error::FigureError;
use super::layout::Bar;
use super::marker::{DISTINCT, palette};
use super::panel::Panel;
use super::raster::{Factor, Raster};
use super::reduce::Source;
use super::ticks::Ticks;
use super::white::White;
use super::{flight, map, mueller, profile};
use crate::spec::{FlightView, MuellerView, PhotoView, ProfileView, SignedScale, View};

/// The contents of a panel.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Images of equal size with the labels in their corners, row by row. The list is empty for a chart.
    pub(crate) cells: Vec<(RgbImage, String)>,
    /// Number of images per row.
    pub(crate) columns: usize,
    /// The horizontal axis and the vertical axis. The vertical axis points up or down.
    pub(crate) axes: Option<[Scaled; 2]>,
    pub bar: Option<Bar>,
    /// Chart to draw instead of images.
    pub(crate) chart: Option<Lines>,
    /// Whether the image shows points of the Poincaré sphere. The circles of the sphere are drawn on the image.
    pub(crate) sphere: bool,
    /// Ratio of height to width of a map or a chart. Images have their own ratio.
    pub aspect: Option<f64>,
    /// The value shown as white, or at the end of a signed scale. The value exists if the tile has such a
    /// scale.
    pub white: Option<White>,
}

/// An axis whose ticks depend on its length.
#[derive(Clone, Debug)]
pub(crate) struct Scaled {
    pub label: String,
    pub coords: Vec<f64>,
}

/// A chart with its scales.
#[derive(Clone, Debug)]
pub(crate) struct Lines {
    pub chart: Chart,
    pub x: Along,
    pub y: Along,
    /// Colour palette of the series, at least one colour.
    pub palette: Vec<Rgb<u8>>,
    /// Whether the names of the series are listed under the axis.
    pub legend: bool,
}

/// Maximum number of labels of a chart's vertical axis.
const UPWARD: usize = 5;

impl Lines {
    /// Returns the ticks of the horizontal axis, with approximately `most` labels or fewer.
    pub fn across(&self, most: usize) -> Marks {
        marks(&self.chart.x, &self.x, |x| x.marks(most))
    }

    /// Returns the ticks of the vertical axis.
    pub fn up(&self) -> Ticks {
        marks(&self.chart.y, &self.y, |y| y.marks(UPWARD)).major
    }

    /// Returns the labels of the horizontal and vertical axes. Each label contains the power of ten of the
    /// ticks.
    pub fn labels(&self) -> [String; 2] {
        let Chart { x, y, .. } = &self.chart;
        [label(&x.label, &self.across(UPWARD).major), label(&y.label, &self.up())]
    }

    /// Returns the colour of a series by index.
    pub fn colour(&self, i: usize) -> Rgb<u8> {
        self.palette[i % self.palette.len().max(1)]
    }
}

/// The kind of a map's values, which determines the colour map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// Values on a linear scale between two ends.
    Linear {
        /// Value at the dark end of the scale.
        low: f32,
        /// Value at the bright end of the scale.
        high: f32,
    },
    /// Positive values on a logarithmic scale between two ends. Smaller values have the colour of the dark end.
    Log {
        /// Value at the dark end of the scale.
        low: f32,
        /// Value at the bright end of the scale.
        high: f32,
    },
    Signed {
        /// Value at the upper end of the scale. The lower end is the negative of this value.
        limit: f32,
        scale: SignedScale,
    },
    /// Angles in degrees with a period of 180°, drawn with a cyclic colour map.
    Axial,
    /// Indices of objects, counted from 0. Negative values mean no object.
    Things,
}

impl Tile {
    pub fn image(image: RgbImage) -> Self {
        Self::images(vec![(image, String::new())], 1)
    }

    fn images(cells: Vec<(RgbImage, String)>, columns: usize) -> Self {
        Self {
            cells,
            columns: columns.max(1),
            axes: None,
            bar: None,
            chart: None,
            sphere: false,
            aspect: None,
            white: None,
        }
    }

    /// Returns one tile per image, for an animation.
    pub fn frames(&self) -> Vec<Self> {
        let frame =
            |cell: &(RgbImage, String)| Self { cells: vec![cell.clone()], columns: 1, ..self.clone() };
        self.cells.iter().map(frame).collect()
    }

    /// Crops every image to `[x, y, width, height]`, which are fractions of the image. The crop is rounded to
    /// whole pixels. Returns false if the tile has no photographs that can be cropped, because the tile is a
    /// map with axes, a chart or a Poincaré sphere.
    pub fn crop(&mut self, [x, y, w, h]: [f64; 4]) -> bool {
        if self.axes.is_some() || self.chart.is_some() || self.sphere {
            return false;
        }
        for (image, _) in &mut self.cells {
            let [x, y, w, h] = pixels_of([x, y, w, h], [image.width(), image.height()]);
            *image = imageops::crop_imm(image, x, y, w, h).to_image();
        }
        true
    }

    /// Returns the size in pixels of a single image.
    pub fn size(&self) -> Option<[u32; 2]> {
        match &self.cells[..] {
            [(image, _)] => Some([image.width(), image.height()]),
            _ => None,
        }
    }
}

/// Returns a view of a slice as a tile.
///
/// # Errors
/// The same errors as [`crate::draw`].
pub fn of_view(view: &View, panel: &Panel) -> Result<Tile, FigureError> {
    match view {
        View::Photo(v) => of_photo(v, panel),
        View::Mueller(v) => of_mueller(v, panel),
        View::SpaceSpace(v) => Ok(of_map(map::space_space(v, panel)?)),
        View::SpaceTime(v) => Ok(of_map(map::space_time(v, panel)?)),
        View::Flight(v) => of_flight(v, panel),
        View::Profile(v) => of_profile(v, panel),
    }
}

fn of_photo(view: &PhotoView, panel: &Panel) -> Result<Tile, FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let read = super::photo::read(view, source)?;
    let image = read.raster.image(|rgb| photo(rgb, read.white.value()));
    Ok(Tile { white: Some(read.white), ..Tile::image(image) })
}

fn of_mueller(view: &MuellerView, panel: &Panel) -> Result<Tile, FigureError> {
    let grid = mueller::read(view, panel)?;
    let whole = Factor { down: 1, up: 1 };
    let raster = grid.elements((whole, whole));
    let cell = |i: usize| (raster.image(|m| grid.colour(&m, i)), format!("{}{}", i / 4, i % 4));
    let images = Tile::images((0..16).map(cell).collect(), 4);
    Ok(Tile { white: Some(grid.white), bar: Some(grid.bar()), ..images })
}

fn of_map(content: map::Content) -> Tile {
    let axis = |label: &str, coords: &[f64]| Scaled { label: label.to_owned(), coords: coords.to_vec() };
    let whole = Factor { down: 1, up: 1 };
    let image = content.image((whole, whole));
    Tile {
        axes: Some([axis("camera column [pixel]", content.xs), axis(content.label, content.ups)]),
        bar: Some(content.bar),
        aspect: Some(1.0),
        ..Tile::image(image)
    }
}

fn of_flight(view: &FlightView, panel: &Panel) -> Result<Tile, FigureError> {
    let frames = flight::read(view, panel)?;
    let white = frames.white;
    let cells: Vec<(RgbImage, String)> = frames
        .shown
        .iter()
        .map(|(time, raster)| (raster.image(|rgb| photo(rgb, white.value())), time.clone()))
        .collect();
    let columns = (cells.len() as f64).sqrt().ceil() as usize;
    Ok(Tile { white: Some(white), ..Tile::images(cells, columns) })
}

fn of_profile(view: &ProfileView, panel: &Panel) -> Result<Tile, FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let errors = panel.std_error.map(|t| Source::new(&view.slice, t)).transpose()?;
    let chart = profile::chart(view, source, errors)?;
    lines(chart, profile::colours(source), false)
}

/// Returns a chart as a tile, without its title and notes. If `legend` is true, the names of the chart's
/// series are listed under the chart.
///
/// # Errors
/// The same errors as [`chart::draw`].
pub fn of_chart(chart: Chart, legend: bool) -> Result<Tile, FigureError> {
    chart::check(&chart)?;
    lines(chart, (0..DISTINCT).map(palette).collect(), legend)
}

fn lines(chart: Chart, palette: Vec<Rgb<u8>>, legend: bool) -> Result<Tile, FigureError> {
    let (x, y) = chart::ranges(&chart)?;
    let chart = Some(Lines { chart, x, y, palette, legend });
    Ok(Tile { aspect: Some(0.7), chart, ..Tile::images(vec![], 1) })
}

/// Returns a map of one value per pixel, row-major from the top with `width` columns. `name` labels
/// the colour bar. Non-finite values are grey.
///
/// # Errors
/// [`FigureError::Damaged`] if the values do not fill the rows. [`FigureError::Option`] if the ends of the
/// scale are invalid.
pub fn of_values(name: &str, width: usize, values: &[f32], scale: Scale) -> Result<Tile, FigureError> {
    let raster = Raster::new(name, width, values.iter().map(|v| [*v]).collect())?;
    let positive = |value: f32| {
        if value.is_finite() && value > 0.0 {
            Ok(value)
        } else {
            Err(FigureError::option("limits", value, "finite, and a valid range"))
        }
    };
    let label = |ticks: &Ticks| match ticks.exponent {
        0 => name.to_owned(),
        _ => format!("{name} [{}]", ticks.unit("").trim_end()),
    };
    let (image, white, bar) = match scale {
        Scale::Linear { low, high } => {
            let span = positive(high - low)?;
            let ticks = Ticks::linear(low.into(), high.into(), 5);
            let bar = Bar { label: label(&ticks), ticks, colour: sequential };
            (raster.image(|[v]| sequential((v - low) / span)), Some(high), Some(bar))
        }
        Scale::Log { low, high } => {
            positive(high - positive(low)?)?;
            let scale = map::Scale::Log { low: low.log10(), high: high.log10() };
            let ticks = scale.ticks();
            let bar = Bar { label: name.to_owned(), ticks, colour: sequential };
            (raster.image(|[v]| sequential(scale.place(v))), Some(high), Some(bar))
        }
        Scale::Signed { limit, scale } => {
            let label = |ticks: &Ticks| label(ticks) + scale.words();
            let bar = Bar::scaled(scale, positive(limit)?.into(), label);
            (raster.image(|[v]| signed(scale.place(v / limit))), Some(limit), Some(bar))
        }
        Scale::Axial => {
            let ticks = Ticks::linear(0.0, 180.0, 4);
            let bar = Bar { label: label(&ticks), ticks, colour: cyclic };
            (raster.image(|[v]| cyclic(v / 180.0)), None, Some(bar))
        }
        Scale::Things => {
            let thing = |v: f32| if v.is_finite() && v >= 0.0 { palette(v as usize) } else { UNDEFINED };
            (raster.image(|[v]| thing(v)), None, None)
        }
    };
    Ok(Tile { white: white.map(White::Value), bar, ..Tile::image(image) })
}

/// Returns an image of linear colours. Each pixel has a red, a green and a blue value. The value `white` is
/// shown as white.
///
/// # Errors
/// [`FigureError::Damaged`] if the values do not fill the rows. [`FigureError::Option`] if `white` is not a
/// positive number.
pub fn of_colours(
    name: &str,
    width: usize,
    values: Vec<[f32; 3]>,
    white: White,
) -> Result<Tile, FigureError> {
    if let White::Value(v) = white {
        super::photo::white("white", Some(v), || white)?;
    }
    let raster = Raster::new(name, width, values)?;
    let image = raster.image(|rgb| photo(rgb, white.value()));
    Ok(Tile { white: Some(white), ..Tile::image(image) })
}

/// Returns the common white level of several images. The white level is the 99th percentile of all values, or
/// the maximum if that percentile is not positive.
pub fn common_white(values: impl Iterator<Item = f32> + Clone) -> White {
    colour::exposure(values)
}
