//! The methods of Fig. 11 and the parameters of these methods. Each method computes depth and normals from
//! the inputs.
//!
//! All methods use the same render: T(s, u) and the Mueller images, for all light and for the epipolar band.

use super::column_light::{CodeError, ColumnLight, Decoded};
use super::fusion::{Believed, fuse};
use super::joint::{Options, Surface, reconstruct};
use super::likelihood::{Measured, Weights, corrected, entering, leaving};
use super::polarization::{Reflection, cues, stokes};
use super::surface_normals::{Window, normals, scatter};
use super::triangulation::{depth, depth_per_column};
use super::{gray_code, logical_codes, micro_phase_shift, phase_shift, propagation};
use crate::map::Map;
use crate::pinhole::Rig;
use thiserror::Error;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Code {
    /// Gray code with inverse patterns.
    Gray,
    /// Multi-frequency phase shifting.
    Phase,
    /// Micro phase shifting.
    Micro,
    /// Consensus of XOR-02, XOR-04 and Gray code.
    Logical,
}

/// The light that a method uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Light {
    All,
    /// Light from projector pixels near the epipolar line.
    Epipolar,
}

/// The Stokes elements that weighted polarization uses. Each set is used for the light that leaves the object,
/// and for the light that enters the object if `entering`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cues {
    pub entering: bool,
    /// Whether all light is used in addition to epipolar light. Methods of all light always use all light alone.
    pub both_lights: bool,
}

/// A method of shape reconstruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Structured light. A code yields the depth, and planes that are fitted to the depth yield the normals.
    StructuredLight(Code, Light),
    /// Shape from polarization alone, which yields normals but no depth (Atkinson & Hancock 2006).
    Polarization(Light),
    /// Joint optimization of structured light and polarization. The method uses all light (Baek et al. 2018)
    /// or epipolar light (Baek & Heide 2021).
    Joint(Code, Light),
    /// Structured light with a robust fit of a smooth surface to depths and to the scan's own normals. The
    /// method has the same spatial help as the weighted joint methods, but no polarization.
    Smoothed(Code, Light),
    /// Smoothed structured light, whose normals are corrected by polarization that is weighted pixel by pixel
    /// ([`super::likelihood`]; new here).
    Weighted(Code, Light),
}

impl Method {
    /// Returns the method's name in tables.
    pub fn name(self) -> String {
        let code = |code| match code {
            Code::Gray => "Gray code",
            Code::Phase => "phase shift",
            Code::Micro => "micro phase shift",
            Code::Logical => "XOR codes",
        };
        let light = |light| match light {
            Light::All => "",
            Light::Epipolar => "epipolar ",
        };
        match self {
            Self::StructuredLight(c, l) => format!("{}{}", light(l), code(c)),
            Self::Polarization(l) => format!("{}polarization", light(l)),
            Self::Joint(c, l) => format!("{}{} + polarization", light(l), code(c)),
            Self::Smoothed(c, l) => format!("{}{}, smoothed", light(l), code(c)),
            Self::Weighted(_, Light::Epipolar) => "joint".to_owned(),
            Self::Weighted(_, Light::All) => "joint, all light".to_owned(),
        }
    }
}

/// Input from a render or a rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Inputs {
    pub rig: Rig,
    /// T(s, u) of all light, summed over projector rows.
    pub columns: ColumnLight,
    /// T(s, u) of the epipolar band.
    pub epipolar_columns: ColumnLight,
    /// Mueller images of all light.
    pub mueller: Measured,
    /// Mueller images of the epipolar band. If the rig is time-gated, the images contain the light of one
    /// time bin.
    pub epipolar_mueller: Measured,
    /// Mask of the object: 1 inside, 0 outside.
    pub mask: Map,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// Minimum contrast of a code's captures.
    pub least_contrast: f64,
    /// Mean period of micro phase shifting, in columns.
    pub micro_period: f64,
    /// Refractive index, or `None` to fit the index to a scan. With `None`, methods without a scan use 1.5.
    pub index: Option<f64>,
    pub scan_window: Window,
    /// Window for the normals of fused surfaces.
    pub fused_window: Window,
    /// Standard deviation of decoded columns, in columns.
    pub sigma_columns: f64,
    /// Standard deviation of the normals from polarization, in degrees.
    pub sigma_normals_deg: f64,
    /// Standard deviation of the fused surface's normals, in degrees.
    pub sigma_surface_deg: f64,
    /// Whether specular reflection is excluded from the degree of polarization.
    pub mirrored_off: bool,
    /// Whether normals of smoothed scans are fitted to the smooth surface instead of the scan.
    pub of_smooth_surface: bool,
    /// Standard deviation of the scan's normals for weighted polarization, as a multiple of the scatter of the
    /// scan. The value 0 excludes polarization.
    pub trust: f64,
    /// Options of weighted polarization.
    pub model_error: f64,
    pub polarization_radius: usize,
    pub cues: Cues,
}

impl Default for Parameters {
    /// Returns the default parameters. The parameters of the fusion were chosen for a sphere and a marble
    /// doll. The doll is 5 cm high in images of 64 × 64 pixels.
    fn default() -> Self {
        Self {
            least_contrast: 0.02,
            micro_period: 16.0,
            index: None,
            scan_window: Window { radius: 2, robust: true },
            fused_window: Window { radius: 1, robust: false },
            sigma_columns: 1.0,
            sigma_normals_deg: 10.0,
            sigma_surface_deg: 5.0,
            mirrored_off: true,
            of_smooth_surface: false,
            trust: 0.7,
            model_error: 0.02,
            polarization_radius: 0,
            cues: Cues { entering: true, both_lights: false },
        }
    }
}

/// The reason why a method fails.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ShapeError {
    #[error(transparent)]
    Code(#[from] CodeError),
    /// A map does not have the camera's size.
    #[error(
        "{what} has {got:?} pixels, but the camera has {want:?}; use maps with the resolution of the camera"
    )]
    Size {
        what: &'static str,
        /// Size of the map.
        got: [usize; 2],
        /// Size of the camera.
        want: [usize; 2],
    },
}

fn check(inputs: &Inputs) -> Result<(), ShapeError> {
    let want = inputs.rig.camera.resolution;
    let maps = [
        ("the light of columns", &inputs.columns.light),
        ("the epipolar light of columns", &inputs.epipolar_columns.light),
        ("the Mueller image", &inputs.mueller.mean),
        ("the errors of the Mueller image", &inputs.mueller.error),
        ("the epipolar Mueller image", &inputs.epipolar_mueller.mean),
        ("the errors of the epipolar Mueller image", &inputs.epipolar_mueller.error),
        ("the mask", &inputs.mask),
    ];
    for (what, map) in maps {
        let got = [map.width, map.height];
        if got != want || map.data.len() != got[0] * got[1] * map.channels || map.channels == 0 {
            return Err(ShapeError::Size { what, got, want });
        }
    }
    Ok(())
}

/// Captures the patterns of a code under T(s, u) and decodes the columns.
///
/// # Errors
/// Returns an error if the light has too few columns for the code.
pub fn scan(light: &ColumnLight, code: Code, parameters: &Parameters) -> Result<Decoded, CodeError> {
    let (n, least) = (light.light.channels, parameters.least_contrast);
    let logical = |base| {
        let captures = light.capture(&logical_codes::patterns(n, base))?;
        logical_codes::decode(&captures, n, base, least)
    };
    let gray = || gray_code::decode(&light.capture(&gray_code::patterns(n))?, n, least);
    match code {
        Code::Gray => gray(),
        Code::Phase => {
            let periods = phase_shift::periods(n);
            phase_shift::decode(&light.capture(&phase_shift::patterns(n, &periods))?, n, &periods, least)
        }
        Code::Micro => {
            let periods = micro_phase_shift::periods(n, parameters.micro_period, 5);
            let captures = light.capture(&micro_phase_shift::patterns(n, &periods))?;
            micro_phase_shift::decode(&captures, n, &periods, least)
        }
        Code::Logical => {
            let first = gray()?;
            let all =
                [logical(logical_codes::Base::Xor02)?, logical(logical_codes::Base::Xor04)?, first.clone()];
            Ok(logical_codes::consensus(&all).unwrap_or(first))
        }
    }
}

/// Replaces values outside the mask by NaN.
fn masked(map: &Map, mask: &Map) -> Map {
    Map::from_fn(map.width, map.height, map.channels, |x, y, out| {
        if mask.at(x, y)[0] == 0.0 {
            out.fill(f64::NAN);
        } else {
            out.copy_from_slice(map.at(x, y));
        }
    })
}

/// Fits a smooth surface to a scan and to normals of the scan, which `correct` may change. `correct` has the
/// surface from which the normals were computed as first argument.
fn smoothed(
    inputs: &Inputs,
    parameters: &Parameters,
    depth: &Map,
    sigma: &Map,
    correct: impl Fn(&Map, Map) -> Map,
) -> Surface {
    let camera = &inputs.rig.camera;
    let believed =
        Believed { depth: sigma.clone(), normals: parameters.sigma_surface_deg.to_radians(), robust: true };
    let of_scan = normals(camera, depth, parameters.scan_window);
    let smooth = fuse(camera, depth, &of_scan, &believed);
    let window = Window { radius: parameters.fused_window.radius, robust: true };
    let of_smooth = normals(camera, &smooth, window);
    // Pixels without a depth have a normal only on the smooth surface.
    let first = if parameters.of_smooth_surface { &of_smooth } else { &of_scan };
    let mut found = first.clone();
    for (n, other) in found.data.iter_mut().zip(&of_smooth.data) {
        *n = if n.is_nan() { *other } else { *n };
    }
    let normals = correct(&smooth, found);
    Surface { depth: fuse(camera, depth, &normals, &believed), normals }
}

/// Corrects normals of a surface with weighted polarization.
fn weighted(inputs: &Inputs, parameters: &Parameters, light: Light, surface: &Map, normals: &Map) -> Map {
    let lights: &[&Measured] = match light {
        Light::All => &[&inputs.mueller],
        Light::Epipolar if parameters.cues.both_lights => &[&inputs.epipolar_mueller, &inputs.mueller],
        Light::Epipolar => &[&inputs.epipolar_mueller],
    };
    let mut cues: Vec<_> = lights.iter().map(|m| leaving(&inputs.rig, m)).collect();
    if parameters.cues.entering {
        cues.extend(lights.iter().map(|m| entering(&inputs.rig, surface, m)));
    }
    let radius = parameters.scan_window.radius;
    let scan = parameters.trust * scatter(&inputs.rig.camera, surface, normals, radius);
    let (model, radius) = (parameters.model_error, parameters.polarization_radius);
    corrected(normals, &cues, Weights { scan, model, radius })
}

/// Runs a method. Shape from polarization alone yields a depth of NaN.
///
/// # Errors
/// Returns an error if the resolution of a map differs from that of the camera. Also returns an error if the
/// light has too many or too few columns for the code.
pub fn run(method: Method, inputs: &Inputs, parameters: &Parameters) -> Result<Surface, ShapeError> {
    check(inputs)?;
    let camera = &inputs.rig.camera;
    let columns = |light| match light {
        Light::All => &inputs.columns,
        Light::Epipolar => &inputs.epipolar_columns,
    };
    let polarized = |light| {
        let mueller = match light {
            Light::All => &inputs.mueller.mean,
            Light::Epipolar => &inputs.epipolar_mueller.mean,
        };
        masked(&stokes(mueller, parameters.mirrored_off), &inputs.mask)
    };
    let scanned = |code, light| -> Result<[Map; 2], ShapeError> {
        let column = masked(&scan(columns(light), code, parameters)?.column, &inputs.mask);
        let sigma = Map::from_fn(column.width, column.height, 1, |x, y, out| {
            let per = depth_per_column(&inputs.rig, x, y, column.at(x, y)[0]);
            out[0] = per.unwrap_or(f64::NAN) * parameters.sigma_columns;
        });
        Ok([depth(&inputs.rig, &column), sigma])
    };
    Ok(match method {
        Method::StructuredLight(code, light) => {
            let [depth, _] = scanned(code, light)?;
            Surface { normals: normals(camera, &depth, parameters.scan_window), depth }
        }
        Method::Polarization(light) => {
            let angles = cues(&polarized(light), parameters.index.unwrap_or(1.5), Reflection::Diffuse);
            Surface {
                depth: Map::from_fn(inputs.mask.width, inputs.mask.height, 1, |_, _, o| {
                    o[0] = f64::NAN;
                }),
                normals: propagation::outward(camera, &angles, &inputs.mask),
            }
        }
        Method::Joint(code, light) => {
            let [depth, sigma] = scanned(code, light)?;
            let options = Options {
                index: parameters.index,
                coarse: parameters.scan_window,
                fine: parameters.fused_window,
                sigma_normals: parameters.sigma_normals_deg.to_radians(),
                sigma_surface: parameters.sigma_surface_deg.to_radians(),
            };
            reconstruct(camera, &depth, &sigma, &polarized(light), &options).surface
        }
        Method::Smoothed(code, light) => {
            let [depth, sigma] = scanned(code, light)?;
            smoothed(inputs, parameters, &depth, &sigma, |_, normals| normals)
        }
        Method::Weighted(code, light) => {
            let [depth, sigma] = scanned(code, light)?;
            smoothed(inputs, parameters, &depth, &sigma, |surface, normals| {
                weighted(inputs, parameters, light, surface, &normals)
            })
        }
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::shape::errors::{angular, depth_errors};
    use crate::shape::polarization::tests::mueller;
    use crate::shape::synthetic::{Shape, rig};

    const COLUMNS: usize = 512;
    /// Side length of the camera image in pixels.
    const SIDE: usize = 32;

    /// Returns the inputs and the true shape of a sphere of diffuse glass. Each lit pixel receives direct
    /// light from one or two columns. All other pixels are dark. The fraction `blurred` of all light comes
    /// uniformly from 36 columns to the left. The light from the left is not epipolar.
    pub(in crate::shape) fn scene(blurred: f64) -> (Inputs, Shape) {
        let rig = rig(SIDE, COLUMNS);
        let shape = Shape::sphere(&rig.camera, 0.04);
        let columns = shape.columns(&rig);
        let light = |blurred: f64| ColumnLight {
            light: Map::from_fn(SIDE, SIDE, COLUMNS, |x, y, out| {
                let c = columns.at(x, y)[0] - 0.5;
                if c.is_finite() {
                    let (first, part) = (c.floor() as usize, c.fract());
                    out[first] += (1.0 - blurred) * (1.0 - part);
                    out[first + 1] += (1.0 - blurred) * part;
                    out[first - 36..first].iter_mut().for_each(|v| *v += blurred / 36.0);
                }
            }),
        };
        let matrices = mueller(&rig.camera, &shape, 1.5, Reflection::Diffuse);
        let mask = Map::from_fn(SIDE, SIDE, 1, |x, y, o| {
            o[0] = f64::from(u8::from(shape.depth.at(x, y)[0].is_finite()));
        });
        let matrices = Map::from_fn(SIDE, SIDE, 16, |x, y, o| {
            let known = mask.at(x, y)[0] != 0.0;
            o.iter_mut().zip(matrices.at(x, y)).for_each(|(o, m)| *o = if known { *m } else { 0.0 });
        });
        let measured = Measured { error: matrices.clone(), mean: matrices };
        let inputs = Inputs {
            columns: light(blurred),
            epipolar_columns: light(0.0),
            mueller: measured.clone(),
            epipolar_mueller: measured,
            mask,
            rig,
        };
        (inputs, shape)
    }

    /// Depth is as accurate as the code. In this test, half a column of Gray code is 0.25 mm (z²/bf). The
    /// error of sinusoids is a thirtieth of this value. The normals of joint methods are accurate within the
    /// limits of a window of 3 × 3 pixels on a sphere.
    #[test]
    #[ignore = "slow: tools/check --all"]
    fn every_method_reconstructs_a_sphere() {
        let (inputs, shape) = scene(0.0);
        let all = [Code::Gray, Code::Phase, Code::Micro, Code::Logical];
        for code in all {
            let method = Method::StructuredLight(code, Light::All);
            let got = run(method, &inputs, &Parameters::default()).expect("a surface");
            let depth = depth_errors(&got.depth, &shape.depth, None);
            let bound = if matches!(code, Code::Gray | Code::Logical) { 2.5e-4 } else { 1e-5 };
            assert!(depth.median < bound && depth.coverage > 0.95, "{code:?}: {depth:?}");
            let method = Method::Joint(code, Light::Epipolar);
            let got = run(method, &inputs, &Parameters::default()).expect("a surface");
            let off = angular(&got.normals, &shape.normals, None);
            assert!(off.median < 2.0 && off.coverage > 0.95, "{code:?}: {off:?}");
        }
        let alone = run(Method::Polarization(Light::All), &inputs, &Parameters::default()).expect("normals");
        let off = angular(&alone.normals, &shape.normals, None);
        assert!(off.mean < 0.01 && off.coverage == 1.0, "{off:?}");
        assert!(alone.depth.data.iter().all(|z| z.is_nan()));
    }

    /// If two thirds of the light are indirect, the phase shift is biased and the Gray code fails. The
    /// epipolar band does not contain the indirect light.
    #[test]
    fn epipolar_light_excludes_the_light_that_breaks_codes() {
        let (inputs, shape) = scene(0.67);
        for code in [Code::Gray, Code::Phase] {
            let depth = |light| {
                let got = run(Method::StructuredLight(code, light), &inputs, &Parameters::default());
                depth_errors(&got.expect("a surface").depth, &shape.depth, None)
            };
            let (all, epipolar) = (depth(Light::All), depth(Light::Epipolar));
            assert!(all.mean > 5.0 * epipolar.mean, "{code:?}: {all:?} {epipolar:?}");
        }
    }

    #[test]
    fn maps_of_other_cameras_are_refused() {
        let (inputs, _) = scene(0.0);
        let small = Inputs { mask: Map::from_fn(2, 2, 1, |_, _, o| o[0] = 1.0), ..inputs };
        let error =
            run(Method::Polarization(Light::All), &small, &Parameters::default()).expect_err("a misfit");
        assert!(error.to_string().contains("the mask has [2, 2]"), "{error}");
    }
}
