//! The contents of one panel of a composite, before scaling: images or a chart, with axes and a colour bar.
//!
//! Images have one pixel per value, so that the composite determines their size.

use image::{Rgb, RgbImage};

use super::chart::{self, Chart, ChartAxis, Scale as Along, Series, label};
use super::colour::{self, UNDEFINED, photo, sequential, signed};
use super::error::FigureError;
use super::layout::Bar;
use super::marker::{DISTINCT, palette};
use super::panel::Panel;
use super::raster::Raster;
use super::reduce::Source;
use super::ticks::Ticks;
use super::white::White;
use super::{flight, map, mueller, profile};
use crate::spec::{FlightView, MuellerView, PhotoView, ProfileView, View};

/// Number of colours of a bar.
const STEPS: u32 = 256;

/// The contents of a panel.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// Images of one size with their corner labels, row by row; empty for a chart.
    pub(crate) cells: Vec<(RgbImage, String)>,
    /// Images per row.
    pub(crate) columns: usize,
    /// Axes to the right and upward, or downward.
    pub(crate) axes: Option<[Scaled; 2]>,
    pub(crate) bar: Option<Ramp>,
    /// Chart instead of images.
    pub(crate) chart: Option<Lines>,
    /// Ratio of height to width of a map or a chart; images have their own.
    pub(crate) aspect: Option<f64>,
    white: Option<White>,
}

/// An axis whose ticks depend on its length.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Scaled {
    pub label: String,
    pub coords: Vec<f64>,
}

/// A colour bar.
#[derive(Clone, Debug, PartialEq)]
pub struct Ramp {
    pub(crate) label: String,
    pub(crate) ticks: Ticks,
    /// One pixel wide, upper end first.
    pub(crate) colours: RgbImage,
}

/// Lines with their axes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Lines {
    pub x: Ruled,
    pub y: Ruled,
    pub series: Vec<Series>,
    /// Colour palette of the series, at least one colour.
    pub palette: Vec<Rgb<u8>>,
    /// Whether the names of series are listed under the axis.
    pub legend: bool,
}

/// An axis of a chart.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Ruled {
    pub label: String,
    pub scale: Along,
    named: Vec<(f64, String)>,
}

/// Maximum number of labels of a chart's vertical axis.
const UPWARD: usize = 5;

impl Ruled {
    /// Creates an axis whose label contains the power of ten of at most `most` ticks.
    fn new(axis: &ChartAxis, scale: Along, most: usize) -> Self {
        let mut out = Self { label: String::new(), scale, named: axis.named.clone() };
        out.label = label(&axis.label, &out.marks(most).0);
        out
    }

    /// Returns labelled ticks, about `most` at most, and the positions of the others.
    pub fn marks(&self, most: usize) -> (Ticks, Vec<f64>) {
        let own = || self.scale.marks(most);
        let marks = self.scale.named(&self.named).unwrap_or_else(own);
        (marks.major, marks.minor)
    }
}

impl Lines {
    /// Returns the ticks of the vertical axis.
    pub fn up(&self) -> Ticks {
        self.y.marks(UPWARD).0
    }

    /// Returns the colour of a series by index.
    pub fn colour(&self, i: usize) -> Rgb<u8> {
        self.palette[i % self.palette.len().max(1)]
    }
}

/// The kind of a map's values, which determines the colour map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// Values between two ends.
    Linear {
        /// Value at the dark end.
        low: f32,
        /// Value at the bright end.
        high: f32,
    },
    Signed {
        /// Value at the upper end.
        limit: f32,
    },
    /// Angles with a period.
    Angle { period: f32 },
    /// Indices of objects, from 0 on; negative ones mean no object.
    Things,
}

impl Ramp {
    pub(crate) fn of(bar: &Bar) -> Self {
        Self {
            label: bar.label.clone(),
            ticks: bar.ticks.clone(),
            colours: RgbImage::from_fn(1, STEPS, |_, y| (bar.colour)(1.0 - (y as f32 + 0.5) / STEPS as f32)),
        }
    }
}

impl Tile {
    #[must_use]
    pub fn image(image: RgbImage) -> Self {
        Self::images(vec![(image, String::new())], 1)
    }

    fn images(cells: Vec<(RgbImage, String)>, columns: usize) -> Self {
        Self { cells, columns: columns.max(1), axes: None, bar: None, chart: None, aspect: None, white: None }
    }

    /// Sets the value shown as white.
    #[must_use]
    pub fn with_white(mut self, white: White) -> Self {
        self.white = Some(white);
        self
    }

    pub(crate) fn with_bar(mut self, bar: Ramp) -> Self {
        self.bar = Some(bar);
        self
    }

    /// Removes the colour bar, for a panel whose neighbour has the same one.
    #[must_use]
    pub fn without_bar(mut self) -> Self {
        self.bar = None;
        self
    }

    /// Sets the ratio of height to width of a map or a chart; images keep their own.
    #[must_use]
    pub fn with_aspect(mut self, aspect: f64) -> Self {
        if self.aspect.is_some() {
            self.aspect = Some(aspect);
        }
        self
    }

    /// Returns the value shown as white, or at the end of a signed scale, if the tile has such a scale.
    #[must_use]
    pub fn white(&self) -> Option<White> {
        self.white
    }

    /// Returns the size in pixels of a single image.
    #[must_use]
    pub fn size(&self) -> Option<[u32; 2]> {
        match &self.cells[..] {
            [(image, _)] => Some([image.width(), image.height()]),
            _ => None,
        }
    }
}

/// Returns the tile of a view of a slice.
///
/// # Errors
/// As [`crate::draw`].
pub fn of_view(view: &View, panel: &Panel) -> Result<Tile, FigureError> {
    match view {
        View::Photo(v) => of_photo(v, panel),
        View::Mueller(v) => of_mueller(v, panel),
        View::SpaceSpace(v) => Ok(of_map(&map::space_space(v, panel)?)),
        View::SpaceTime(v) => Ok(of_map(&map::space_time(v, panel)?)),
        View::Flight(v) => of_flight(v, panel),
        View::Profile(v) => of_profile(v, panel),
    }
}

fn of_photo(view: &PhotoView, panel: &Panel) -> Result<Tile, FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let read = super::photo::read(view, source)?;
    let image = read.raster.image(|rgb| photo(rgb, read.white.value()));
    Ok(Tile::image(image).with_white(read.white))
}

fn of_mueller(view: &MuellerView, panel: &Panel) -> Result<Tile, FigureError> {
    let grid = mueller::read(view, panel)?;
    let cell = |i: usize| {
        let image = grid
            .raster
            .image(|m| mueller::pixel(&m, i, view.normalized, grid.white.value(), grid.limit.value()));
        (image, format!("{}{}", i / 4, i % 4))
    };
    let bar = mueller::bar(view.normalized, grid.limit.value());
    Ok(Tile::images((0..16).map(cell).collect(), 4).with_white(grid.white).with_bar(Ramp::of(&bar)))
}

fn of_map(content: &map::Content) -> Tile {
    let axis = |label: &str, coords: &[f64]| Scaled { label: label.to_owned(), coords: coords.to_vec() };
    let mut tile = Tile::image(content.image()).with_bar(Ramp::of(&content.bar()));
    tile.axes = Some([axis("camera column [pixel]", content.xs), axis(content.label, content.ups)]);
    tile.aspect = Some(1.0);
    tile
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
    Ok(Tile::images(cells, columns).with_white(white))
}

fn of_profile(view: &ProfileView, panel: &Panel) -> Result<Tile, FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let errors = panel.std_error.map(|t| Source::new(&view.slice, t)).transpose()?;
    let chart = profile::chart(view, source, errors)?;
    lines(&chart, profile::colours(source), false)
}

/// Returns a chart as a tile, without its title and notes. If `legend` is set, the names of its series are
/// listed under it.
///
/// # Errors
/// As [`chart::draw`].
pub fn of_chart(chart: &Chart, legend: bool) -> Result<Tile, FigureError> {
    chart::check(chart)?;
    lines(chart, (0..DISTINCT).map(palette).collect(), legend)
}

fn lines(chart: &Chart, palette: Vec<Rgb<u8>>, legend: bool) -> Result<Tile, FigureError> {
    let (x, y) = chart::ranges(chart)?;
    let mut tile = Tile::images(vec![], 1);
    tile.aspect = Some(0.7);
    tile.chart = Some(Lines {
        x: Ruled::new(&chart.x, x, UPWARD),
        y: Ruled::new(&chart.y, y, UPWARD),
        series: chart.series.clone(),
        palette,
        legend,
    });
    Ok(tile)
}

/// Returns a map of one value per pixel, `width` columns, rows from the top; `name` labels its colour bar.
/// Non-finite values are grey.
///
/// # Errors
/// [`FigureError::Damaged`] if the values do not fill the rows; [`FigureError::Option`] if the ends of the
/// scale are invalid.
pub fn of_values(name: &str, width: usize, values: &[f32], scale: Scale) -> Result<Tile, FigureError> {
    let raster = Raster::new(name, width, values.iter().map(|v| [*v]).collect())?;
    let must = |ok: bool, option, value: f32| {
        if ok { Ok(()) } else { Err(FigureError::option(option, value, "finite, and a valid range")) }
    };
    Ok(match scale {
        Scale::Linear { low, high } => {
            let span = high - low;
            must(span.is_finite() && span > 0.0, "limits", span)?;
            let ticks = Ticks::linear(low.into(), high.into(), 5);
            let label = labelled(name, &ticks);
            let bar = Bar::new(label, ticks, &sequential);
            let image = raster.image(|[v]| sequential((v - low) / span));
            Tile::image(image).with_white(White::Value(high)).with_bar(Ramp::of(&bar))
        }
        Scale::Signed { limit } => {
            must(limit.is_finite() && limit > 0.0, "limits", limit)?;
            let bar = Bar::signed(limit.into(), |ticks| labelled(name, ticks));
            let image = raster.image(|[v]| signed(v / limit));
            Tile::image(image).with_white(White::Value(limit)).with_bar(Ramp::of(&bar))
        }
        Scale::Angle { period } => {
            must(period.is_finite() && period > 0.0, "limits", period)?;
            let ticks = Ticks::linear(0.0, period.into(), 4);
            let label = labelled(name, &ticks);
            let bar = Bar::new(label, ticks, &colour::cyclic);
            let image = raster.image(|[v]| colour::cyclic(v / period));
            Tile::image(image).with_bar(Ramp::of(&bar))
        }
        Scale::Things => Tile::image(
            raster.image(|[v]| if v.is_finite() && v >= 0.0 { palette(v as usize) } else { UNDEFINED }),
        ),
    })
}

fn labelled(name: &str, ticks: &Ticks) -> String {
    match ticks.exponent {
        0 => name.to_owned(),
        _ => format!("{name} [{}]", ticks.unit("").trim_end()),
    }
}

/// Returns an image of linear colours, red, green and blue per pixel; `white` is shown as white.
///
/// # Errors
/// [`FigureError::Damaged`] if the values do not fill the rows; [`FigureError::Option`] if white is not a
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
    Ok(Tile::image(raster.image(|rgb| photo(rgb, white.value()))).with_white(white))
}

/// Returns the common white level of several images: the 99th percentile of all values, or their maximum if
/// that is not positive.
#[must_use]
pub fn common_white(values: impl Iterator<Item = f32> + Clone) -> White {
    colour::exposure(values)
}
