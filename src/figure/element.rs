//! Draws single elements of Mueller matrices. The elements are named as in the paper by Baek & Heide (2021):
//! `(0,1)`, `-(3,3)`, `±(0,2)`.
//!
//! For a name with one sign, values of that sign are shown as intensity. All other values are black. Elements
//! with `±` and normalized elements use the diverging colour map.

use super::colour::{exposure, photo, quotient, rgb_weights, signed};
use super::error::FigureError;
use super::layout::{Bar, CAMERA_UNIT};
use super::mueller::bin;
use super::panel::Panel;
use super::photo::{limit, white};
use super::raster::Raster;
use super::reduce::Source;
use super::tile::Tile;
use crate::spec::SignedScale;
use serde::Deserialize;
use std::str::FromStr;
use tensor::axes::AxisKind;

/// A Mueller element with the displayed sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct Element {
    /// Displayed sign. The value is +1 or -1, or 0 for both signs.
    pub sign: i8,
    /// Row (Stokes out) and column (Stokes in), 0 to 3.
    pub at: [usize; 2],
}

impl FromStr for Element {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bad =
            || format!("`{text}` is not an element; write (0,1), -(3,3) or ±(0,2), with indices 0 to 3");
        let compact: String = text.chars().filter(|c| !c.is_whitespace()).collect();
        let at = compact.find('(').ok_or_else(bad)?;
        let sign = match &compact[..at] {
            "" | "+" => 1,
            "-" | "−" => -1,
            "±" | "+-" => 0,
            _ => return Err(bad()),
        };
        let mut digits = compact[at..].chars();
        let mut next = || digits.next();
        let element = match [next(), next(), next(), next(), next(), next()] {
            [Some('('), Some(i), Some(','), Some(j), Some(')'), None] => i.to_digit(4).zip(j.to_digit(4)),
            _ => None,
        };
        let (i, j) = element.ok_or_else(bad)?;
        Ok(Self { sign, at: [i as usize, j as usize] })
    }
}

impl TryFrom<String> for Element {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

/// One element of a slice, summed over all projector pixels and times.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ElementView {
    pub slice: String,
    pub element: Element,
    /// Wavelength to draw, in nanometres, at most 0.5 nm from a wavelength of the slice. `None` combines all
    /// wavelengths into a colour image. For signed values, `None` selects the middle wavelength.
    pub wavelength_nm: Option<f64>,
    /// Whether to divide the element by M00. The values are then signed.
    #[serde(default)]
    pub normalized: bool,
    /// Time in picoseconds that selects the time bin to draw. `None` sums all bins.
    pub time_ps: Option<f64>,
    /// Value shown as white, or value at the ends of the signed scale. `None` selects 1 if normalized,
    /// otherwise the 99th percentile.
    pub limit: Option<f32>,
    /// Scale of signed values.
    #[serde(default)]
    pub scale: SignedScale,
}

impl ElementView {
    fn is_signed(&self) -> bool {
        self.normalized || self.element.sign == 0
    }

    /// Checks the options that do not depend on the slice.
    ///
    /// # Errors
    /// [`FigureError::Option`] if the view has a scale for signed values but shows values of one sign as light.
    pub fn check(&self) -> Result<(), FigureError> {
        if self.scale == SignedScale::Linear || self.is_signed() {
            return Ok(());
        }
        let must = "`linear`, or the element normalized or with the sign ±, because light of one sign has no signed scale";
        Err(FigureError::option("scale", "arctan", must))
    }
}

/// Returns the element as a tile.
///
/// # Errors
/// [`FigureError`] in the following cases:
/// - The slice lacks an axis that the view needs.
/// - The slice is empty or damaged.
/// - An option is out of range.
pub fn tile(view: &ElementView, panel: &Panel) -> Result<Tile, FigureError> {
    view.check()?;
    let source = Source::new(&view.slice, panel.mean)?;
    let (ys, xs) = (source.need(AxisKind::Y)?, source.need(AxisKind::X)?);
    let (w, h) = (xs.len(), ys.len());
    let time = view.time_ps.map(|ps| bin(source, ps).map(|i| (AxisKind::T, i))).transpose()?;
    let sign = if view.element.sign < 0 { -1.0 } else { 1.0 };
    let of = |element: [usize; 2], lane: Option<usize>| -> Result<_, FigureError> {
        let mut pick: Vec<(AxisKind, usize)> = source.element(element)?.into();
        pick.extend(time);
        pick.extend(lane.map(|l| (AxisKind::Wavelength, l)));
        let keep = [AxisKind::Y, AxisKind::X, AxisKind::Wavelength];
        Ok(source.sum(&keep[..if lane.is_some() { 2 } else { 3 }], &pick, |v| sign * f64::from(v)))
    };
    if !view.is_signed() {
        let (values, weights) = if view.wavelength_nm.is_some() {
            let lane = source.wavelength(view.wavelength_nm)?;
            (of(view.element.at, Some(lane))?, rgb_weights(&[0.0]))
        } else {
            (of(view.element.at, None)?, rgb_weights(source.wavelengths()))
        };
        let raster = Raster::colour(w, h, &values, &weights);
        let white = white("limit", view.limit, || exposure(raster.data.iter().flatten().copied()))?;
        let image =
            raster.image(|rgb| photo(rgb.map(|v| if v.is_nan() { v } else { v.max(0.0) }), white.value()));
        return Ok(Tile { white: Some(white), ..Tile::image(image) });
    }
    let lane = source.wavelength(view.wavelength_nm)?;
    let element = of(view.element.at, Some(lane))?;
    // The sign is applied to the quotient instead of M00.
    let m00 = of([0, 0], Some(lane))?;
    let pairs = element.data.iter().zip(&m00.data);
    let raster = Raster::new(&view.slice, w, pairs.map(|(m, m00)| [*m, sign as f32 * m00]).collect())?;
    let limit = limit(view.limit, view.normalized, raster.data.iter().map(|v| v[0]))?;
    let end = limit.value();
    let scale = view.scale;
    let image = raster.image(|[m, m00]| {
        if view.normalized { quotient(m, m00, end, scale) } else { signed(scale.place(m / end)) }
    });
    let [i, j] = view.element.at;
    let name = format!("{}M{i}{j}", if sign < 0.0 { "−" } else { "" });
    let words = scale.words();
    let bar = Bar::scaled(scale, end.into(), |ticks| {
        if view.normalized {
            format!("{name} / M00{words}")
        } else {
            format!("{name}{words} [{}]", ticks.unit(CAMERA_UNIT))
        }
    });
    Ok(Tile { white: Some(limit), bar: Some(bar), ..Tile::image(image) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::UNDEFINED;
    use proptest::prelude::*;
    use tensor::array::Tensor;
    use tensor::axes::Axis;

    fn matrices(pixels: &[[f32; 16]]) -> Tensor {
        let axis = |kind, n: usize| Axis { kind, coords: (0..n).map(|i| i as f64).collect(), chunk: 1 };
        let axes = vec![
            axis(AxisKind::Y, 1),
            axis(AxisKind::X, pixels.len()),
            axis(AxisKind::StokesOut, 4),
            axis(AxisKind::StokesIn, 4),
        ];
        let mut t = Tensor::zeros("s", axes);
        t.data.copy_from_slice(pixels.as_flattened());
        t
    }

    fn drawn(element: &str, normalized: bool, t: &Tensor) -> Vec<[u8; 3]> {
        let view = ElementView {
            slice: "s".into(),
            element: element.parse().expect("an element"),
            wavelength_nm: None,
            normalized,
            time_ps: None,
            limit: Some(1.0),
            scale: SignedScale::Linear,
        };
        let panel = Panel { mean: t, std_error: None, overflow: None };
        let tile = tile(&view, &panel).expect("a picture");
        tile.cells[0].0.pixels().map(|p| p.0).collect()
    }

    /// Tests that a name with one sign shows no values of the opposite sign, and that `±` shows all values. A
    /// quotient must have the requested sign.
    #[test]
    fn signs_follow_the_name() {
        let with = |m00: f32, m23: f32| {
            let mut m = [0.0; 16];
            (m[0], m[11]) = (m00, m23);
            m
        };
        let t = matrices(&[with(1.0, 1.0), with(1.0, -1.0), with(-1.0, 0.5)]);
        let (black, bright) = ([0; 3], [255; 3]);
        assert_eq!(drawn("(2,3)", false, &t)[..2], [bright, black]);
        assert_eq!(drawn("-(2,3)", false, &t)[..2], [black, bright]);
        let (red, blue) = (signed(1.0).0, signed(-1.0).0);
        assert_eq!(drawn("±(2,3)", false, &t)[..2], [red, blue]);
        assert_eq!(drawn("(2,3)", true, &t), [red, blue, UNDEFINED.0]);
        assert_eq!(drawn("-(2,3)", true, &t), [blue, red, UNDEFINED.0]);
        // An image of a different element is a different image.
        assert_eq!(drawn("(3,2)", false, &t)[..2], [black, black]);
    }

    /// Tests that the arctan scale changes colours but not the values at the colour bar, and that light of one
    /// sign has no such scale.
    #[test]
    fn signed_elements_have_an_arctan_scale() {
        let mut m = [0.0; 16];
        (m[0], m[11]) = (2.0, 0.1);
        let t = matrices(&[m]);
        let panel = Panel { mean: &t, std_error: None, overflow: None };
        let view = |element: &str, normalized| ElementView {
            slice: "s".into(),
            element: element.parse().expect("an element"),
            wavelength_nm: None,
            normalized,
            time_ps: None,
            limit: Some(0.5),
            scale: SignedScale::Arctan,
        };
        for (element, normalized, value) in
            [("(2,3)", true, 0.05), ("-(2,3)", true, -0.05), ("±(2,3)", false, 0.1)]
        {
            let tile = tile(&view(element, normalized), &panel).expect("a picture");
            let place = (8.0 * value / 0.5_f32).atan() / 8_f32.atan();
            assert_eq!(tile.cells[0].0.get_pixel(0, 0), &signed(place), "{element}");
            let bar = tile.bar.expect("a bar");
            assert!(bar.label.contains("arctan scale"), "{}", bar.label);
            let (last, label) = bar.ticks.marks.last().expect("ticks");
            assert!((last - 1.0).abs() < 1e-6 && label.parse::<f32>() == Ok(0.5), "{last} {label}");
        }
        assert!(matches!(
            tile(&view("(2,3)", false), &panel),
            Err(FigureError::Option { option: "scale", .. })
        ));
    }

    proptest! {
        /// Tests that invalid names are rejected and valid names are parsed.
        #[test]
        fn names_of_elements(text in "\\PC{0,8}", sign in 0..3_usize, i in 0..9_usize, j in 0..9_usize) {
            let _ = text.parse::<Element>();
            let (written, sign) = [("", 1), ("-", -1), ("±", 0)][sign];
            let read = format!("{written}({i}, {j})").parse::<Element>();
            if i < 4 && j < 4 {
                prop_assert_eq!(read, Ok(Element { sign, at: [i, j] }));
            } else {
                prop_assert!(read.is_err());
            }
        }
    }
}
