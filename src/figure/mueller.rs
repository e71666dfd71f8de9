//! Draws the sixteen Mueller elements at one wavelength as a 4×4 grid. Rows are outgoing Stokes elements, and
//! columns are incoming Stokes elements.
//!
//! If normalized, M00 is shown as intensity, and every other element is divided by M00. Elements are
//! undefined (grey) for pixels at which M00 is not positive. If not normalized, all sixteen elements have the
//! same signed scale.
//!
//! With a mask, signed elements below a number of standard errors are also grey. The standard error of
//! Mij / M00 is that of Mij, divided by M00. Standard errors of summed values (projector pixels, time bins) and
//! of averaged pixels are added in quadrature. The values are assumed to be independent.

use image::Rgb;

use super::colour::{UNDEFINED, exposure, nearest, signed, srgb};
use super::drawing::{Drawing, Rect};
use super::error::FigureError;
use super::layout::{Bar, CAMERA_UNIT, Panels, growth, white_words};
use super::panel::Panel;
use super::photo;
use super::raster::{Factor, Raster};
use super::reduce::Source;
use super::text::{Align, NAME, Style, width};
use super::ticks::Ticks;
use super::white::White;
use crate::spec::MuellerView;
use tensor::axes::AxisKind;

/// Colour of lines around panels.
const EDGES: Rgb<u8> = Rgb([120, 120, 124]);

/// Returns the panels of a grid of sixteen elements. Each panel has `size` pixels, and `gap` pixels separate
/// the panels.
pub fn panels(size: (f64, f64), gap: f64) -> Panels {
    Panels { size, head: 0.0, gap, columns: 4 }
}

/// The contents of a grid, before scaling.
pub(super) struct Grid<'a> {
    source: Source<'a>,
    lane: usize,
    view: &'a MuellerView,
    /// The sixteen Mueller elements of each pixel.
    raster: Raster<16>,
    /// Variances of the elements, and the number of standard errors below which an element is masked.
    mask: Option<(Raster<16>, f32)>,
    /// Value of M00 shown as white, if normalized.
    pub white: White,
    /// Value at the ends of the signed scale.
    pub limit: White,
}

/// Returns the index of the time bin that contains a time in picoseconds.
///
/// # Errors
/// [`FigureError`] if the slice has no time bins, or if no bin contains the time.
pub(super) fn bin(source: Source, ps: f64) -> Result<usize, FigureError> {
    let times = source.need(AxisKind::T)?;
    let half = match times {
        [a, b, ..] => (b - a) / 2.0,
        _ => f64::INFINITY,
    };
    let at = nearest(times, ps);
    if (times[at] - ps).abs() <= half * (1.0 + 1e-9) {
        return Ok(at);
    }
    Err(FigureError::option("time_ps", ps, "within the time bins of the slice"))
}

/// Returns the Mueller matrix of every pixel at the entries `pick` of axes, summed over all other axes. The
/// function `f` is applied to every value before summation.
fn matrices(
    source: Source,
    pick: &[(AxisKind, usize)],
    f: impl Fn(f32) -> f64,
) -> Result<Raster<16>, FigureError> {
    let xs = source.need(AxisKind::X)?;
    source.need(AxisKind::Y)?;
    for kind in [AxisKind::StokesOut, AxisKind::StokesIn] {
        source.index("Stokes elements", 3, source.need(kind)?.len())?;
    }
    let keep = [AxisKind::Y, AxisKind::X, AxisKind::StokesOut, AxisKind::StokesIn];
    let values = source.sum(&keep, pick, f);
    // From longer Stokes axes, the first four entries are used.
    let (so, si) = (values.shape[2], values.shape[3]);
    let pixels = values.data.chunks_exact(so * si);
    let data = pixels.map(|m| std::array::from_fn(|i| m[i / 4 * si + i % 4]));
    Raster::new(source.slice, xs.len(), data.collect())
}

/// Returns the variance of every element of [`matrices`] for a mask of `sigmas` standard errors. Standard errors
/// of summed values are added in quadrature.
fn variances(
    slice: &str,
    pick: &[(AxisKind, usize)],
    sigmas: f32,
    panel: &Panel,
) -> Result<Raster<16>, FigureError> {
    if !(sigmas > 0.0 && sigmas.is_finite()) {
        return Err(FigureError::option("mask_sigmas", sigmas, "a positive number"));
    }
    let error = panel.std_error.filter(|e| e.shape() == panel.mean.shape());
    let error = error.ok_or_else(|| FigureError::NoErrors { slice: slice.to_owned() })?;
    matrices(Source::new(slice, error)?, pick, |v| f64::from(v) * f64::from(v))
}

/// An image of Mueller matrices at one wavelength.
#[derive(Clone, Debug)]
pub struct Matrices {
    /// Number of pixels in a row.
    pub width: usize,
    /// The sixteen elements of each pixel, row by row, in the camera's units.
    pub elements: Vec<[f32; 16]>,
    /// Variances of the elements, if a mask needs them.
    pub variances: Option<Vec<[f32; 16]>>,
}

impl Matrices {
    /// Reads the matrices of a slice at a wavelength in nanometres (default: the middle wavelength), summed over all
    /// other axes. The variances are read if `mask_sigmas` sets a number of standard errors.
    ///
    /// # Errors
    /// [`FigureError`] in the following cases:
    /// - The slice lacks an axis or the wavelength, or is empty or damaged.
    /// - The number of standard errors is not positive, or the slice has no standard errors.
    pub fn read(
        slice: &str,
        nm: Option<f64>,
        mask_sigmas: Option<f32>,
        panel: &Panel,
    ) -> Result<Self, FigureError> {
        let source = Source::new(slice, panel.mean)?;
        let pick = [(AxisKind::Wavelength, source.wavelength(nm)?)];
        let raster = matrices(source, &pick, f64::from)?;
        let variances = mask_sigmas.map(|n| variances(slice, &pick, n, panel)).transpose()?;
        Ok(Self { width: raster.w, elements: raster.data, variances: variances.map(|v| v.data) })
    }
}

pub(super) fn read<'a>(view: &'a MuellerView, panel: &Panel<'a>) -> Result<Grid<'a>, FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let lane = source.wavelength(view.wavelength_nm)?;
    let mut pick = vec![(AxisKind::Wavelength, lane)];
    if let Some(ps) = view.time_ps {
        pick.push((AxisKind::T, bin(source, ps)?));
    }
    let raster = matrices(source, &pick, f64::from)?;
    let mask = view.mask_sigmas.map(|n| Ok((variances(&view.slice, &pick, n, panel)?, n))).transpose()?;
    let white = exposure(raster.data.iter().map(|m| m[0]));
    let limit = photo::limit(view.limit, view.normalized, raster.data.iter().flatten().copied())?;
    Ok(Grid { source, lane, view, raster, mask, white, limit })
}

impl Grid<'_> {
    /// Returns the elements after averaging by the factors. Masked elements are NaN.
    pub fn elements(&self, factors: (Factor, Factor)) -> Raster<16> {
        let mut raster = self.raster.clone().shrink(factors);
        let Some((variances, sigmas)) = &self.mask else {
            return raster;
        };
        let variances = variances.clone().shrink(factors);
        // The variance of the mean of n pixels is their mean variance, divided by n.
        let (fx, fy) = (factors.0.down, factors.1.down);
        let (w, h) = (self.raster.w, self.raster.h);
        for (at, (m, variance)) in raster.data.iter_mut().zip(&variances.data).enumerate() {
            let (x, y) = (at % raster.w, at / raster.w);
            let n = fx.min(w - x * fx) * fy.min(h - y * fy);
            // M00 is shown as intensity if normalized, and is then not masked.
            for i in usize::from(self.view.normalized)..16 {
                let least = sigmas * (variance[i] / n as f32).sqrt();
                // An element whose standard error is not finite is also masked.
                if !least.is_finite() || m[i].abs() < least {
                    m[i] = f32::NAN;
                }
            }
        }
        raster
    }

    /// Returns the colour of element `i` of a matrix.
    pub fn colour(&self, m: &[f32; 16], i: usize) -> Rgb<u8> {
        let place = |v: f32| self.view.scale.place(v);
        pixel(m, i, self.view.normalized, (self.white.value(), self.limit.value()), place)
    }

    pub fn bar(&self) -> Bar {
        let scale = self.view.scale.words();
        let label = |ticks: &Ticks| {
            if self.view.normalized {
                format!("Mij / M00{scale}")
            } else {
                format!("Mij{scale} [{}]", ticks.unit(CAMERA_UNIT))
            }
        };
        Bar::scaled(self.view.scale, self.limit.value().into(), label)
    }

    /// Returns the notes on the wavelength, on white and on grey pixels.
    fn notes(&self) -> Vec<String> {
        let at = match self.source.wavelengths().get(self.lane) {
            Some(nm) => format!(" at {nm} nm"),
            None => String::new(),
        };
        let time = self.view.time_ps.map_or(String::new(), |ps| format!(", in the time bin of {ps} ps"));
        let mut notes =
            vec![format!("Mueller elements{at}{time}; row i: outgoing Stokes, column j: incoming Stokes.")];
        let masked = self.mask.as_ref().map(|(_, n)| format!("magnitude below {n} standard errors"));
        if self.view.normalized {
            let masked = masked.map_or(String::new(), |m| format!(", or {m}"));
            notes.push(format!(
                "M00 is shown as intensity, white {}; grey: undefined (M00 is not positive){masked}.",
                white_words(self.white, " (99th percentile)")
            ));
        } else {
            notes.extend(masked.map(|m| format!("Grey: {m}.")));
        }
        notes
    }
}

pub fn draw(view: &MuellerView, title: &str, panel: &Panel) -> Result<Drawing, FigureError> {
    let content = read(view, panel)?;
    let (w, h) = (content.raster.w, content.raster.h);
    let factors = Factor::square(w, h, 400, 440, 40);
    let raster = content.elements(factors);
    let grid = panels((factors.0.length(w), factors.1.length(h)), 8.0);

    let mut page = grid.page(16, title, Some(content.bar()), content.notes());
    let style = NAME.scaled(growth(page.data.w));
    for i in 0..16 {
        raster.paint(&mut page, grid.corner(i), factors, |m| content.colour(&m, i));
        let place = grid.place(&page, i);
        page.frame(place, EDGES);
        tag(&mut page, place, &format!("M{}{}", i / 4, i % 4), style);
    }
    Ok(page)
}

/// Returns the colour of element `i` of a matrix. If normalized, M00 is an intensity. `ends` are the value
/// shown as white and the limit of the signed scale. `place` maps a quotient of a value and the limit to a
/// position on the colour bar, -1..1.
pub fn pixel(
    m: &[f32; 16],
    i: usize,
    normalized: bool,
    (white, limit): (f32, f32),
    place: impl Fn(f32) -> f32,
) -> Rgb<u8> {
    match (normalized, i) {
        (true, 0) if m[0].is_finite() => Rgb([srgb(m[0] / white); 3]),
        (true, _) if i == 0 || !(m[0] > 0.0 && m[0].is_finite()) => UNDEFINED,
        (true, _) => signed(place(m[i] / m[0] / limit)),
        (false, _) => signed(place(m[i] / limit)),
    }
}

/// Draws the name of an element on a light background in the upper left corner of its panel.
fn tag(page: &mut Drawing, place: Rect, text: &str, style: Style) {
    let (w, h) = (width(text, style) + 8.0, style.em + 5.0);
    let ground = place.within((0.0, 0.0), (w.min(place.w), h.min(place.h)));
    page.fill(ground, Rgb([255; 3]), 0.8);
    let at = (place.x + 4.0, place.y + h / 2.0);
    page.text(text, at, Align::Start, style);
}
