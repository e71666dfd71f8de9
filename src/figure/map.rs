//! Draws two-dimensional maps of one camera scanline. The second dimension is projector pixels (s–s') or
//! travel time (x–t).
//!
//! Camera columns increase to the right. Projector pixels and time increase upward. M00 has a square-root
//! scale, or a logarithmic scale if the ratio of two percentiles of its positive values exceeds [`LOG_FROM`].
//! The colour bar states the kind of scale. Other elements are signed and divided by M00 (the quotient of
//! sums).

use image::{Rgb, RgbImage};

use super::colour::{UNDEFINED, percentile, quotient, rgb_weights, sequential};
use super::drawing::Drawing;
use super::error::FigureError;
use super::layout::{Axis, Bar, CAMERA_UNIT, Page};
use super::panel::Panel;
use super::photo::channels;
use super::raster::{Factor, Raster};
use super::reduce::Source;
use super::ticks::Ticks;
use crate::spec::{MapView, SignedScale};
use tensor::axes::AxisKind;

/// Ratio of the 99.9th to the 5th percentile of positive values. The scale is logarithmic above this ratio.
const LOG_FROM: f32 = 300.0;
/// Maximum number of decades on a logarithmic scale.
const DECADES: f32 = 4.0;

/// Maps intensities to positions 0..1 on the colour bar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scale {
    Sqrt { top: f32 },
    Log { low: f32, high: f32 },
}

impl Scale {
    /// Returns a logarithmic scale if the 99.9th percentile of positive values is more than `ratio` times the
    /// 5th percentile. If not, returns a square-root scale.
    pub(super) fn log_from(values: impl Iterator<Item = f32> + Clone, ratio: f32) -> Self {
        let positive = values.filter(|v| *v > 0.0);
        let top = percentile(positive.clone(), 0.999).unwrap_or(1.0);
        let low = percentile(positive, 0.05).unwrap_or(1.0);
        if top / low > ratio {
            let high = top.log10();
            Self::Log { low: low.log10().max(high - DECADES), high }
        } else {
            Self::Sqrt { top }
        }
    }

    /// Returns the position, 0..1, of a value on the colour bar.
    pub(super) fn place(self, v: f32) -> f32 {
        match self {
            _ if v.is_nan() => v,
            _ if v <= 0.0 => 0.0,
            Self::Sqrt { top } => (v / top).sqrt().min(1.0),
            Self::Log { low, high } => ((v.log10() - low) / (high - low)).clamp(0.0, 1.0),
        }
    }

    pub(super) fn ticks(self) -> Ticks {
        match self {
            Self::Sqrt { top } => {
                let mut ticks = Ticks::linear(0.0, f64::from(top), 5);
                ticks.marks.iter_mut().for_each(|m| m.0 = m.0.max(0.0).sqrt());
                ticks
            }
            Self::Log { low, high } => Ticks::decades(f64::from(low), f64::from(high)),
        }
    }

    /// Returns the name of the kind of scale, for labels.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Sqrt { .. } => "square-root",
            Self::Log { .. } => "log",
        }
    }

    /// Returns the colour bar of M00.
    fn bar(self, colour: fn(f32) -> Rgb<u8>) -> Bar {
        let ticks = self.ticks();
        let label = format!("M00, {} scale [{}]", self.name(), ticks.unit(CAMERA_UNIT));
        Bar { label, ticks, colour }
    }

    /// Returns a colour with the hue of `rgb`. The brightness of the colour is the position of the largest
    /// channel on the scale.
    fn colour(self, rgb: [f32; 3]) -> Rgb<u8> {
        if !rgb.iter().all(|v| v.is_finite()) {
            return UNDEFINED;
        }
        let most = rgb.into_iter().fold(0.0, f32::max);
        let bright = self.place(most) * 255.0;
        Rgb(rgb.map(|v| {
            if most > 0.0 { ((v.max(0.0) / most).powf(1.0 / 2.2) * bright).round() as u8 } else { 0 }
        }))
    }
}

/// The contents of a map, before scaling.
pub(super) struct Content<'a> {
    /// Camera column coordinates, drawn to the right.
    pub xs: &'a [f64],
    /// Projector pixels or times in picoseconds, drawn upward.
    pub ups: &'a [f64],
    /// Label of the vertical axis.
    pub label: &'static str,
    note: String,
    values: Values,
    pub bar: Bar,
}

/// Values of a map and their scale.
enum Values {
    /// Red, green and blue values of M00.
    Colour(Raster<3>, Scale),
    Size(Raster<1>, Scale),
    /// Values of the drawn element and of M00.
    Signed(Raster<2>, SignedScale),
}

fn rising<const C: usize>(
    raster: &Raster<C>,
    factors: (Factor, Factor),
    colour: impl Fn([f32; C]) -> Rgb<u8>,
) -> RgbImage {
    raster.clone().shrink(factors).flipped().image(colour)
}

impl Content<'_> {
    /// Returns the image after averaging by the factors. Pixels are not repeated. Rows run upward.
    pub fn image(&self, factors: (Factor, Factor)) -> RgbImage {
        match &self.values {
            Values::Colour(r, scale) => rising(r, factors, |rgb| scale.colour(rgb)),
            Values::Size(r, scale) => rising(r, factors, |[v]| sequential(scale.place(v))),
            Values::Signed(r, scale) => rising(r, factors, |[m, m00]| quotient(m, m00, 1.0, *scale)),
        }
    }

    pub fn draw(self, title: &str) -> Drawing {
        let (xs, ups) = (self.xs, self.ups);
        let fx = Factor::new(xs.len(), 900, 1600).at_least(40, xs.len());
        let fy = Factor::new(ups.len(), 640, 1600).at_least(40, ups.len());
        let (w, h) = (fx.length(xs.len()), fy.length(ups.len()));
        let image = self.image((fx, fy));
        let page = Page {
            title,
            x: Axis::new("camera column [pixel]", Ticks::coordinates(xs, w, true)),
            y: Axis::new(self.label, Ticks::coordinates(ups, h, false)),
            bar: Some(self.bar),
            notes: vec![self.note],
            ..Page::default()
        };
        let mut page = page.draw(w, h);
        let size = (f64::from(image.width()) * fx.up as f64, f64::from(image.height()) * fy.up as f64);
        page.image(page.data.within((0.0, 0.0), size), &image);
        page
    }
}

/// Returns a map of camera columns and projector columns for one camera scanline. If the slice resolves
/// projector rows but no projector columns, the map has projector rows instead.
pub(super) fn space_space<'a>(view: &'a MapView, panel: &Panel<'a>) -> Result<Content<'a>, FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    let len = |kind| source.coords(kind).map_or(0, <[f64]>::len);
    let (u, v) = (len(AxisKind::U), len(AxisKind::V));
    let (kind, label) = if v > 0 && (u == 0 || u == 1 && v > 1) {
        (AxisKind::V, "projector row [pixel]")
    } else {
        (AxisKind::U, "projector column [pixel]")
    };
    content(view, source, kind, label)
}

/// Returns a map of camera columns and travel times for one camera scanline.
pub(super) fn space_time<'a>(view: &'a MapView, panel: &Panel<'a>) -> Result<Content<'a>, FigureError> {
    let source = Source::new(&view.slice, panel.mean)?;
    content(view, source, AxisKind::T, "travel time [ps]")
}

fn content<'a>(
    view: &MapView,
    source: Source<'a>,
    upward: AxisKind,
    label: &'static str,
) -> Result<Content<'a>, FigureError> {
    let (ups, xs) = (source.need(upward)?, source.need(AxisKind::X)?);
    let rows = source.coords(AxisKind::Y);
    source.index("camera rows", view.row, rows.map_or(1, <[f64]>::len))?;
    let element = source.element(view.element)?;
    let nm = source.wavelengths();
    let lane = source.wavelength(view.wavelength_nm)?;
    let row = rows.map_or(String::new(), |ys| format!("Camera row {}. ", ys[view.row]));
    let one = |[out, inn]: [(AxisKind, usize); 2]| {
        let pick = [(AxisKind::Y, view.row), out, inn, (AxisKind::Wavelength, lane)];
        source.sum(&[upward, AxisKind::X], &pick, f64::from).data
    };
    let at = nm.get(lane).map_or(String::new(), |nm| format!("{nm} nm."));
    let (note, values, bar) = if view.wavelength_nm.is_none() && view.element == [0, 0] && nm.len() > 1 {
        let keep = [upward, AxisKind::X, AxisKind::Wavelength];
        let values = source.sum(&keep, &[(AxisKind::Y, view.row), element[0], element[1]], f64::from);
        let raster = Raster::colour(xs.len(), ups.len(), &values, &rgb_weights(nm));
        let scale =
            Scale::log_from(raster.data.iter().map(|c| c.iter().copied().fold(0.0, f32::max)), LOG_FROM);
        let note = format!("{row}{}; the colour bar is for the brightest channel.", channels(nm));
        let bar = scale.bar(|v| Rgb([(v * 255.0).round() as u8; 3]));
        (note, Values::Colour(raster, scale), bar)
    } else if view.element == [0, 0] {
        let data = one(element).into_iter().map(|v| [v]).collect();
        let raster = Raster::new(&view.slice, xs.len(), data)?;
        let scale = Scale::log_from(raster.data.iter().map(|v| v[0]), LOG_FROM);
        (format!("{row}{at}"), Values::Size(raster, scale), scale.bar(sequential))
    } else {
        let m00 = one(element.map(|(kind, _)| (kind, 0)));
        let data = one(element).into_iter().zip(m00).map(|(m, m00)| [m, m00]);
        let raster = Raster::new(&view.slice, xs.len(), data.collect())?;
        let note = format!("{row}{at} Grey: undefined (M00 is not positive).");
        let [out, inn] = view.element;
        let bar = Bar::scaled(view.scale, 1.0, |_| format!("M{out}{inn} / M00{}", view.scale.words()));
        (note, Values::Signed(raster, view.scale), bar)
    };
    Ok(Content { xs, ups, label, note, values, bar })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_is_log_only_for_wide_ranges() {
        let narrow = Scale::log_from([0.0, 1.0, 2.0, 3.0, f32::NAN].into_iter(), LOG_FROM);
        assert_eq!(narrow, Scale::Sqrt { top: 3.0 });
        assert_eq!(narrow.place(0.75), 0.5);
        let wide = Scale::log_from((0..=100).map(|i| 10_f32.powf(i as f32 / 20.0 - 3.0)), LOG_FROM);
        let Scale::Log { low, high } = wide else { panic!("{wide:?}") };
        assert!((low + 2.0).abs() < 0.3 && (high - 2.0).abs() < 0.01);
        assert_eq!((wide.place(1e-9), wide.place(1e9), wide.place(-1.0)), (0.0, 1.0, 0.0));
        assert_eq!(Scale::log_from([0.0; 3].into_iter(), LOG_FROM), Scale::Sqrt { top: 1.0 });
    }

    #[test]
    fn colours_keep_their_hue_at_every_brightness() {
        let s = Scale::Sqrt { top: 4.0 };
        assert_eq!(s.colour([4.0, 0.0, 0.0]).0, [255, 0, 0]);
        assert_eq!(s.colour([1.0, 0.0, -1.0]).0, [128, 0, 0]);
        assert_eq!(s.colour([0.0; 3]).0, [0, 0, 0]);
        assert_eq!(s.colour([1.0, f32::NAN, 0.0]), UNDEFINED);
    }
}
