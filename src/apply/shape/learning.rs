//! Learns free parameters of methods on training variants. The parameters are chosen one after another, each
//! from a short list of values. The chosen value minimizes the mean angular error of normals. A pixel without
//! a normal contributes an error of 90°. For smoothed scans and weighted joint methods, the chosen value
//! minimizes the geometric mean of the errors of normals and depths. A pixel without a depth contributes an error
//! of the height of the statue.

use super::errors::{Errors, angular, depth_errors};
use super::joint::Surface;
use super::methods::{Code, Light, Method, Parameters, ShapeError, run};
use super::seen::Seen;
use rayon::prelude::*;

/// Height of the statue, in metres.
const STATUE: f64 = 0.05;

/// A method, and whether the method uses the scene with the sprayed object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Route {
    pub method: Method,
    /// Whether the method uses the scene with the sprayed object.
    pub sprayed: bool,
}

/// A learned parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Free {
    /// Radius of the window for normals of scans, in pixels.
    ScanRadius,
    /// Radius of the window for normals of fused surfaces, in pixels.
    FusedRadius,
    /// Mean period of micro phase shifting, in columns.
    MicroPeriod,
    /// Refractive index, for methods without a scan.
    Index,
    /// Whether specular reflection is excluded from the degree of polarization: 1 if so, otherwise 0.
    MirroredOff,
    /// Standard deviation of decoded columns, in columns.
    SigmaColumns,
    /// Standard deviation of the normals from polarization, in degrees.
    SigmaNormals,
    /// Standard deviation of the fused surface's normals, in degrees.
    SigmaSurface,
    /// Whether normals are those of the smooth surface instead of the scan: 1 if so, otherwise 0.
    OfSmoothSurface,
    /// Standard deviation of the scan's normals, as a multiple of the scatter of the scan.
    Trust,
    /// Error of the model of q and u.
    ModelError,
    /// Radius of the window over which weighted polarization is summed, in pixels.
    PolarizationRadius,
    /// Whether light that enters the object is used: 1 if so, otherwise 0.
    Entering,
    /// Whether all light is used in addition to epipolar light: 1 if so, otherwise 0.
    BothLights,
}

impl Free {
    /// Returns the values to try for this parameter.
    pub(super) const fn values(self) -> &'static [f64] {
        match self {
            Self::ScanRadius => &[1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0],
            Self::FusedRadius => &[1.0, 2.0, 3.0, 5.0],
            Self::MicroPeriod => &[10.0, 16.0, 24.0],
            Self::Index => &[1.3, 1.4, 1.5, 1.6],
            Self::MirroredOff => &[0.0, 1.0],
            Self::SigmaColumns => &[0.25, 0.5, 1.0],
            Self::SigmaNormals => &[10.0, 20.0, 40.0],
            Self::SigmaSurface => &[2.5, 5.0, 10.0],
            Self::OfSmoothSurface | Self::Entering | Self::BothLights => &[0.0, 1.0],
            Self::Trust => &[0.0, 0.35, 0.5, 0.7, 1.0, 1.4],
            Self::ModelError => &[0.005, 0.02, 0.05],
            Self::PolarizationRadius => &[0.0, 1.0, 2.0],
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::ScanRadius => "radius of the scan's window",
            Self::FusedRadius => "of the surface's window",
            Self::MicroPeriod => "period",
            Self::Index => "index",
            Self::MirroredOff => "mirrored light left out",
            Self::SigmaColumns => "deviation of columns",
            Self::SigmaNormals => "of polarization's normals",
            Self::SigmaSurface => "of the surface's normals",
            Self::OfSmoothSurface => "normals of the smooth surface",
            Self::Trust => "deviation of the scan's normals",
            Self::ModelError => "model error",
            Self::PolarizationRadius => "radius of polarization's window",
            Self::Entering => "light that enters the object",
            Self::BothLights => "all light and epipolar light",
        }
    }

    fn set(self, p: &mut Parameters, value: f64) {
        match self {
            Self::ScanRadius => p.scan_window.radius = value as usize,
            Self::FusedRadius => p.fused_window.radius = value as usize,
            Self::MicroPeriod => p.micro_period = value,
            Self::Index => p.index = Some(value),
            Self::MirroredOff => p.mirrored_off = value > 0.5,
            Self::SigmaColumns => p.sigma_columns = value,
            Self::SigmaNormals => p.sigma_normals_deg = value,
            Self::SigmaSurface => p.sigma_surface_deg = value,
            Self::OfSmoothSurface => p.of_smooth_surface = value > 0.5,
            Self::Trust => p.trust = value,
            Self::ModelError => p.model_error = value,
            Self::PolarizationRadius => p.polarization_radius = value as usize,
            Self::Entering => p.cues.entering = value > 0.5,
            Self::BothLights => p.cues.both_lights = value > 0.5,
        }
    }
}

impl Route {
    /// Returns the method's free parameters, in the order of learning.
    pub(super) const fn free(self) -> &'static [Free] {
        match self.method {
            Method::StructuredLight(Code::Micro, _) => &[Free::ScanRadius, Free::MicroPeriod],
            Method::StructuredLight(..) => &[Free::ScanRadius],
            Method::Polarization(_) => &[Free::Index, Free::MirroredOff],
            Method::Joint(..) => &[
                Free::FusedRadius,
                Free::SigmaColumns,
                Free::SigmaNormals,
                Free::SigmaSurface,
                Free::MirroredOff,
            ],
            Method::Smoothed(..) => {
                &[Free::OfSmoothSurface, Free::FusedRadius, Free::SigmaColumns, Free::SigmaSurface]
            }
            Method::Weighted(_, Light::All) => {
                &[Free::PolarizationRadius, Free::Trust, Free::ModelError, Free::Entering, Free::Trust]
            }
            Method::Weighted(_, Light::Epipolar) => &[
                Free::PolarizationRadius,
                Free::Trust,
                Free::ModelError,
                Free::Entering,
                Free::BothLights,
                Free::Trust,
            ],
        }
    }

    /// Returns depth and normals of a variant.
    pub(super) fn run(self, seen: &Seen, parameters: &Parameters) -> Result<Surface, ShapeError> {
        let inputs = if self.sprayed { &seen.sprayed } else { &seen.inputs };
        run(self.method, inputs, parameters)
    }

    fn loss(self, train: &[Seen], parameters: &Parameters) -> Result<f64, ShapeError> {
        let of = |seen: &Seen| -> Result<f64, ShapeError> {
            let surface = self.run(seen, parameters)?;
            let with = |e: Errors, missing: f64| {
                let mean = if e.coverage > 0.0 { e.mean } else { 0.0 };
                e.coverage * mean + (1.0 - e.coverage) * missing
            };
            let normals = with(angular(&surface.normals, &seen.normals, None), 90.0);
            Ok(match self.method {
                Method::Smoothed(..) | Method::Weighted(..) => {
                    let depth = with(depth_errors(&surface.depth, &seen.depth, None), STATUE);
                    (normals * depth).sqrt()
                }
                _ => normals,
            })
        };
        let all: Result<Vec<f64>, _> = train.par_iter().map(of).collect();
        Ok(all?.iter().sum::<f64>() / train.len() as f64)
    }

    /// Returns the parameters with the least loss on training variants, and a description of these
    /// parameters. `known` contains the results for other routes, and receives the result.
    pub(super) fn learn(
        self,
        train: &[Seen],
        known: &mut Vec<(Self, (Parameters, String))>,
    ) -> Result<(Parameters, String), ShapeError> {
        if let Some((_, found)) = known.iter().find(|(route, _)| *route == self) {
            return Ok(found.clone());
        }
        // A joint method uses the best parameters of the structured-light scan alone. The parameters of a
        // scan can be learned much faster.
        let mut within = |method| {
            let (parameters, words) = Self { method, ..self }.learn(train, known)?;
            Ok::<_, ShapeError>((parameters, vec![words]))
        };
        let (mut best, mut words) = match self.method {
            Method::Joint(code, light) | Method::Smoothed(code, light) => {
                within(Method::StructuredLight(code, light))?
            }
            // The joint method with weight 0 for polarization is its own baseline.
            Method::Weighted(code, light) => within(Method::Smoothed(code, light))?,
            _ => (Parameters::default(), vec![]),
        };
        for free in self.free() {
            let tried: Result<Vec<_>, ShapeError> = free
                .values()
                .par_iter()
                .map(|value| {
                    let mut p = best.clone();
                    free.set(&mut p, *value);
                    Ok((self.loss(train, &p)?, *value, p))
                })
                .collect();
            // Of equally good values, the first one is used. The result therefore does not depend on the
            // number of threads.
            if let Some((_, value, p)) = tried?.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) {
                words.push(format!("{} {value}", free.name()));
                best = p;
            }
        }
        let found = (best, words.join(", "));
        known.push((self, found.clone()));
        Ok(found)
    }
}
