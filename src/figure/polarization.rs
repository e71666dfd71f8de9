//! Draws quantities of the light that leaves the scene, for a state of the incoming light: degrees and angles of
//! polarization, and points on the Poincaré sphere.
//!
//! The Stokes vector of the outgoing light is s = M g, where g is the Stokes vector of the incoming light.
//! Definitions and signs are those of `CONVENTIONS.md` and of the explorer (`stokes.ts`):
//!
//! - DoLP = √(s1² + s2²) / s0
//! - AoLP = atan2(s2, s1) / 2, from 0 to below 180°
//! - DoCP = s3 / s0. Positive values are right circular.
//! - ellipticity angle = atan2(s3, √(s1² + s2²)) / 2, from -45° to 45°
//!
//! Quantities are undefined (grey) where s0 is not positive. With a mask, pixels are also grey where the polarized
//! part of the light is below a number of its standard errors. The polarized part is √(s1² + s2²) for DoLP and
//! AoLP, |s3| for DoCP, and √(s1² + s2² + s3²) for the ellipticity angle and the sphere. Its standard error is
//! propagated linearly from those of the Mueller elements, which are assumed to be independent.

use super::colour::{exposure, sequential};
use super::error::FigureError;
use super::layout::{Bar, CAMERA_UNIT};
use super::mueller::Matrices;
use super::panel::Panel;
use super::ticks::Ticks;
use super::tile::{Scale, Tile, of_values};
use crate::spec::SignedScale;
use image::{Rgb, RgbImage};
use serde::Deserialize;

/// A quantity of the outgoing light of a slice, summed over all projector pixels and times.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolarizationView {
    /// Slice with Mueller matrices.
    pub slice: String,
    pub quantity: Quantity,
    /// Stokes vector of the incoming light. Default: unpolarized.
    #[serde(default = "unpolarized")]
    pub stokes: [f32; 4],
    /// Wavelength to draw in nanometres, at most 0.5 nm from a wavelength of the slice. Default: the middle
    /// wavelength.
    pub wavelength_nm: Option<f64>,
    /// Pixels whose polarized light is below this number of its standard errors are grey. The slice must have
    /// standard errors. Default: no mask.
    pub mask_sigmas: Option<f32>,
    /// Value at the end of the scale of DoLP and DoCP. Default: 1.
    pub limit: Option<f32>,
    /// Scale of DoCP.
    #[serde(default)]
    pub scale: SignedScale,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Degree of linear polarization.
    Dolp,
    /// Angle of linear polarization in degrees.
    Aolp,
    /// Signed degree of circular polarization.
    Docp,
    /// Ellipticity angle in degrees.
    Ellipticity,
}

/// Points of the pixels on the Poincaré sphere, at (s1, s2, s3) / s0. Points of partially polarized light are
/// inside the sphere.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoincareView {
    /// Slice with Mueller matrices.
    pub slice: String,
    /// Stokes vector of the incoming light. Default: unpolarized.
    #[serde(default = "unpolarized")]
    pub stokes: [f32; 4],
    /// Wavelength to draw in nanometres. Default: the middle wavelength.
    pub wavelength_nm: Option<f64>,
    /// Pixels whose polarized light is below this number of its standard errors are not drawn.
    pub mask_sigmas: Option<f32>,
    #[serde(default)]
    pub colour: PointColour,
}

/// The quantity that the colour of a point shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PointColour {
    /// Intensity s0.
    #[default]
    Intensity,
    /// Position in the image: red increases to the right, and blue increases downward.
    Position,
}

fn unpolarized() -> [f32; 4] {
    [1.0, 0.0, 0.0, 0.0]
}

/// Returns the degree of linear polarization, or NaN without light.
pub fn dolp([s0, s1, s2, _]: [f32; 4]) -> f32 {
    if s0 > 0.0 { s1.hypot(s2) / s0 } else { f32::NAN }
}

/// Returns the angle of linear polarization in degrees, from 0 to below 180. Returns NaN without light or
/// without linear polarization.
pub fn aolp([s0, s1, s2, _]: [f32; 4]) -> f32 {
    let linear = s1 != 0.0 || s2 != 0.0;
    if s0 <= 0.0 || s0.is_nan() || !linear {
        return f32::NAN;
    }
    let angle = 0.5 * s2.atan2(s1).to_degrees();
    // A small negative angle plus 180 rounds to 180.
    if angle < 0.0 { (angle + 180.0) % 180.0 } else { angle }
}

/// Returns the signed degree of circular polarization, or NaN without light. Right circular light is positive.
pub fn docp([s0, _, _, s3]: [f32; 4]) -> f32 {
    if s0 > 0.0 { s3 / s0 } else { f32::NAN }
}

/// Returns the ellipticity angle in degrees, -45 (left circular) to 45 (right circular). Returns NaN without
/// light or without polarization.
pub fn ellipticity([s0, s1, s2, s3]: [f32; 4]) -> f32 {
    let polarized = s1 != 0.0 || s2 != 0.0 || s3 != 0.0;
    if s0 > 0.0 && polarized { 0.5 * s3.atan2(s1.hypot(s2)).to_degrees() } else { f32::NAN }
}

/// Checks the Stokes vector of incoming light.
///
/// # Errors
/// [`FigureError::Option`] if the vector is not finite, has no intensity, or has a degree of polarization above 1.
pub fn check_stokes(stokes: [f32; 4]) -> Result<(), FigureError> {
    let [s0, s1, s2, s3] = stokes.map(f64::from);
    let polarized = (s1 * s1 + s2 * s2 + s3 * s3).sqrt();
    if s0 > 0.0 && s0.is_finite() && polarized <= s0 * (1.0 + 1e-6) {
        return Ok(());
    }
    let must = "[s0, s1, s2, s3] with s0 > 0 and √(s1² + s2² + s3²) ≤ s0, such as [1, 0, 0, 0] for unpolarized light";
    Err(FigureError::option("stokes", format!("{stokes:?}"), must))
}

impl PolarizationView {
    /// Checks the options that do not depend on the slice.
    ///
    /// # Errors
    /// [`FigureError::Option`] if the Stokes vector is not that of light, or if the scale does not apply.
    pub fn check(&self) -> Result<(), FigureError> {
        check_stokes(self.stokes)?;
        if self.scale == SignedScale::Arctan && self.quantity != Quantity::Docp {
            return Err(FigureError::option(
                "scale",
                "arctan",
                "`linear`, because only `docp` has a signed scale",
            ));
        }
        let degree = matches!(self.quantity, Quantity::Dolp | Quantity::Docp);
        match self.limit {
            Some(v) if !degree => {
                Err(FigureError::option("limit", v, "absent, because angles have a scale of fixed length"))
            }
            Some(v) if !(v > 0.0 && v.is_finite()) => {
                Err(FigureError::option("limit", v, "a positive number"))
            }
            _ => Ok(()),
        }
    }
}

/// The Stokes vectors of the pixels, row-major. Masked vectors are NaN.
struct Light {
    width: usize,
    stokes: Vec<[f32; 4]>,
}

/// Returns the outgoing light. `part` lists the Stokes components whose magnitude the mask considers.
fn light(
    (slice, stokes, nm): (&str, [f32; 4], Option<f64>),
    mask_sigmas: Option<f32>,
    part: &[usize],
    panel: &Panel,
) -> Result<Light, FigureError> {
    check_stokes(stokes)?;
    let image = Matrices::read(slice, nm, mask_sigmas, panel)?;
    let times = |m: &[f32; 16], g: [f32; 4]| -> [f32; 4] {
        std::array::from_fn(|i| (0..4).map(|j| m[4 * i + j] * g[j]).sum())
    };
    let mut out: Vec<[f32; 4]> = image.elements.iter().map(|m| times(m, stokes)).collect();
    if let (Some(sigmas), Some(variances)) = (mask_sigmas, &image.variances) {
        let squares = stokes.map(|g| g * g);
        for (s, m) in out.iter_mut().zip(variances) {
            let variance = times(m, squares);
            let square = part.iter().map(|&i| s[i] * s[i]).sum::<f32>();
            // The derivative of the magnitude √Σ sᵢ² is sᵢ / √Σ sᵢ².
            let weighted = part.iter().map(|&i| s[i] * s[i] * variance[i]).sum::<f32>();
            let error = (weighted / square).sqrt();
            if !error.is_finite() || square.sqrt() < sigmas * error {
                *s = [f32::NAN; 4];
            }
        }
    }
    Ok(Light { width: image.width, stokes: out })
}

/// Returns the view as a tile.
///
/// # Errors
/// [`FigureError`] if the slice has no image of Mueller matrices, or if an option is invalid.
pub fn tile(view: &PolarizationView, panel: &Panel) -> Result<Tile, FigureError> {
    view.check()?;
    let limit = view.limit.unwrap_or(1.0);
    let signed = |limit| Scale::Signed { limit, scale: view.scale };
    let of: fn([f32; 4]) -> f32;
    let (name, scale, part): (_, _, &[usize]) = match view.quantity {
        Quantity::Dolp => {
            of = dolp;
            ("DoLP", Scale::Linear { low: 0.0, high: limit }, &[1, 2])
        }
        Quantity::Aolp => {
            of = aolp;
            ("AoLP [°]", Scale::Axial, &[1, 2])
        }
        Quantity::Docp => {
            of = docp;
            ("DoCP", signed(limit), &[3])
        }
        Quantity::Ellipticity => {
            of = ellipticity;
            ("ellipticity angle [°]", signed(45.0), &[1, 2, 3])
        }
    };
    let light = light((&view.slice, view.stokes, view.wavelength_nm), view.mask_sigmas, part, panel)?;
    let values: Vec<f32> = light.stokes.into_iter().map(of).collect();
    of_values(name, light.width, &values, scale)
}

/// Side of the image of the points, in pixels.
const SIDE: u32 = 320;
/// Radius of the sphere, as a fraction of the side of the image.
pub(crate) const RADIUS: f64 = 0.4;
/// Direction of view: angle from s1 toward s2, and elevation above the equator, in radians. The explorer starts
/// with the same direction.
const YAW: f64 = 0.6;
const PITCH: f64 = 0.35;

/// Returns the position of a point on the page, relative to the centre of the sphere: right and down, in radii.
/// The third value is the depth toward the viewer.
pub(crate) fn project([s1, s2, s3]: [f64; 3]) -> [f64; 3] {
    let toward = YAW.cos() * s1 + YAW.sin() * s2;
    let right = -YAW.sin() * s1 + YAW.cos() * s2;
    let up = PITCH.cos() * s3 - PITCH.sin() * toward;
    [right, -up, PITCH.cos() * toward + PITCH.sin() * s3]
}

/// Returns the points on the sphere as a tile. Points that are farther from the viewer are drawn first.
///
/// # Errors
/// [`FigureError`] if the slice has no image of Mueller matrices, or if an option is invalid.
pub fn sphere(view: &PoincareView, panel: &Panel) -> Result<Tile, FigureError> {
    let light = light((&view.slice, view.stokes, view.wavelength_nm), view.mask_sigmas, &[1, 2, 3], panel)?;
    let white = exposure(light.stokes.iter().map(|s| s[0]));
    let rows = light.stokes.len().div_ceil(light.width);
    let colour = |i: usize, s0: f32| match view.colour {
        PointColour::Intensity => sequential(s0 / white.value()),
        PointColour::Position => {
            let along = |at: usize, n: usize| (40 + 200 * at / n.max(2).saturating_sub(1)).min(240) as u8;
            Rgb([along(i % light.width, light.width), 60, along(i / light.width, rows)])
        }
    };
    let mut points: Vec<([f64; 3], Rgb<u8>)> = vec![];
    for (i, s) in light.stokes.iter().enumerate() {
        let unit = [s[1], s[2], s[3]].map(|v| f64::from(v / s[0]));
        // Noise can cause degrees of polarization far above 1, which would be outside the image.
        let inside = unit.iter().map(|v| v * v).sum::<f64>() <= 1.2;
        if s[0] > 0.0 && inside {
            points.push((project(unit), colour(i, s[0])));
        }
    }
    points.sort_by(|a, b| a.0[2].total_cmp(&b.0[2]));
    let mut image = RgbImage::from_pixel(SIDE, SIDE, Rgb([255; 3]));
    let at = |v: f64| (f64::from(SIDE) * (0.5 + RADIUS * v)) as u32;
    for ([right, down, _], colour) in points {
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = (at(right) + x, at(down) + y);
            if x < SIDE && y < SIDE {
                image.put_pixel(x, y, colour);
            }
        }
    }
    let bar = (view.colour == PointColour::Intensity).then(|| {
        let ticks = Ticks::linear(0.0, white.value().into(), 5);
        Bar { label: format!("s0 [{}]", ticks.unit(CAMERA_UNIT)), ticks, colour: sequential }
    });
    let white = bar.is_some().then_some(white);
    Ok(Tile { white, bar, sphere: true, ..Tile::image(image) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::{UNDEFINED, cyclic, signed};
    use tensor::array::Tensor;
    use tensor::axes::{Axis, AxisKind};

    /// Tests the definitions on states of light with known values, with the signs of `CONVENTIONS.md`.
    #[test]
    fn quantities_of_known_states() {
        for (s, expected) in [
            ([2.0, 2.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]),
            ([2.0, -1.0, 0.0, 0.0], [0.5, 90.0, 0.0, 0.0]),
            ([1.0, 0.0, 1.0, 0.0], [1.0, 45.0, 0.0, 0.0]),
            ([1.0, 0.0, -1.0, 0.0], [1.0, 135.0, 0.0, 0.0]),
            ([1.0, 0.0, 0.0, 1.0], [0.0, f32::NAN, 1.0, 45.0]),
            ([1.0, 0.0, 0.0, -0.5], [0.0, f32::NAN, -0.5, -45.0]),
            ([1.0, 0.6, 0.0, 0.6], [0.6, 0.0, 0.6, 22.5]),
            ([0.0, 1.0, 0.0, 0.0], [f32::NAN; 4]),
            ([-1.0, 1.0, 0.0, 1.0], [f32::NAN; 4]),
        ] {
            let found = [dolp(s), aolp(s), docp(s), ellipticity(s)];
            for (a, b) in found.iter().zip(expected) {
                assert!((a - b).abs() < 1e-5 || a.is_nan() && b.is_nan(), "{s:?}: {found:?}");
            }
        }
        assert!(aolp([1.0, 1.0, -1e-20, 0.0]) < 180.0);
    }

    /// Returns an image of two pixels, with standard errors. The first pixel is a polarizer at 45°. The second
    /// pixel reverses the handedness of circular light.
    fn two_pixels() -> (Tensor, Tensor) {
        let axis = |kind, n: usize| Axis { kind, coords: (0..n).map(|i| i as f64).collect(), chunk: 1 };
        let axes = vec![
            axis(AxisKind::Y, 1),
            axis(AxisKind::X, 2),
            axis(AxisKind::StokesOut, 4),
            axis(AxisKind::StokesIn, 4),
        ];
        let mut mean = Tensor::zeros("s", axes.clone());
        for at in [0, 2, 8, 10] {
            mean.data[at] = 0.5;
        }
        for (i, v) in [1.0, 1.0, -1.0, -1.0].into_iter().enumerate() {
            mean.data[16 + 5 * i] = v;
        }
        let mut error = Tensor::zeros("s", axes);
        error.data.fill(0.01);
        (mean, error)
    }

    #[test]
    fn views_show_the_light_for_the_incoming_state() {
        let (mean, error) = two_pixels();
        let panel = Panel { mean: &mean, std_error: Some(&error), overflow: None };
        let drawn = |quantity, stokes, mask_sigmas| -> Vec<Rgb<u8>> {
            let slice = "s".to_owned();
            let scale = SignedScale::Linear;
            let view = PolarizationView {
                slice,
                quantity,
                stokes,
                wavelength_nm: None,
                mask_sigmas,
                limit: None,
                scale,
            };
            tile(&view, &panel).expect("a tile").cells[0].0.pixels().copied().collect()
        };
        let unpolarized = unpolarized();
        assert_eq!(drawn(Quantity::Dolp, unpolarized, None), [sequential(1.0), sequential(0.0)]);
        assert_eq!(drawn(Quantity::Aolp, unpolarized, None), [cyclic(0.25), UNDEFINED]);
        let right = [1.0, 0.0, 0.0, 1.0];
        assert_eq!(drawn(Quantity::Docp, right, None), [signed(0.0), signed(-1.0)]);
        assert_eq!(drawn(Quantity::Ellipticity, right, None), [signed(0.0), signed(-1.0)]);
        // A polarizer turns horizontal light into light at 45°. The second pixel keeps horizontal light.
        assert_eq!(drawn(Quantity::Aolp, [1.0, 1.0, 0.0, 0.0], None), [cyclic(0.25), cyclic(0.0)]);
        // The polarized light of the first pixel is 0.5 ± 0.01.
        assert_eq!(drawn(Quantity::Dolp, unpolarized, Some(49.0)), [sequential(1.0), UNDEFINED]);
        assert_eq!(drawn(Quantity::Dolp, unpolarized, Some(51.0)), [UNDEFINED, UNDEFINED]);
    }

    #[test]
    fn states_that_are_not_light_are_refused() {
        assert!(check_stokes([1.0, 0.6, 0.0, 0.8]).is_ok());
        for bad in [[0.0; 4], [-1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.5, 0.0], [f32::NAN, 0.0, 0.0, 0.0]] {
            assert!(check_stokes(bad).is_err(), "{bad:?}");
        }
    }

    /// Tests that the points of the sphere are at the projections of their states.
    #[test]
    fn points_are_at_their_projections() {
        let (mean, _) = two_pixels();
        let panel = Panel { mean: &mean, std_error: None, overflow: None };
        let view = PoincareView {
            slice: "s".into(),
            stokes: [1.0, 0.0, 0.0, 1.0],
            wavelength_nm: None,
            mask_sigmas: None,
            colour: PointColour::Position,
        };
        let drawn = sphere(&view, &panel).expect("a tile");
        let image = &drawn.cells[0].0;
        let at = |unit| {
            let [right, down, _] = project(unit);
            let place = |v: f64| (f64::from(SIDE) * (0.5 + RADIUS * v)) as u32;
            *image.get_pixel(place(right), place(down))
        };
        assert_eq!(at([0.0, 1.0, 0.0]), Rgb([40, 60, 40]));
        assert_eq!(at([0.0, 0.0, -1.0]), Rgb([240, 60, 40]));
        assert_eq!(at([0.0, 0.0, 1.0]), Rgb([255; 3]));
        assert_eq!(image.pixels().filter(|p| **p != Rgb([255; 3])).count(), 8);
    }
}
