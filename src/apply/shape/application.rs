//! The application of Fig. 11. Every method reconstructs the normals and depths of statues of translucent
//! stone.
//!
//! All methods process the pixels that the statue covers completely, and ignore all other pixels. Errors are
//! means over those pixels for which a method has a result. `coverage` is the fraction of pixels with a
//! result.

use super::errors::{Errors, angular, depth_errors};
use super::joint::Surface;
use super::learning::Route;
use super::methods::{Code, Light, Method as Way, ShapeError};
use super::seen::Seen;
use crate::application::{Application, Method, Metric, Outcome, Picture, Plan, Score, Size, Truth};
use crate::error::ApplyError;
use crate::map::Map;
use crate::observation::{self, Observation};
use rayon::prelude::*;

pub(super) const METRICS: [Metric; 6] = [
    Metric::new("normals, mean error", "deg", false),
    Metric::new("normals, median error", "deg", false),
    Metric::new("depth, mean error", "mm", false),
    Metric::new("depth, median error", "mm", false),
    Metric::new("coverage", "", true),
    Metric::new("normals, mean error where the scan has normals", "deg", false),
];

/// The method whose pixels the last metric uses. Methods with a larger coverage also have normals where a scan
/// fails, and errors are large there.
const SCAN: Route = Route { method: Way::StructuredLight(Code::Micro, Light::Epipolar), sprayed: false };

const fn route(name: &'static str, source: &'static str, method: Way, sprayed: bool) -> (Method, Route) {
    (Method { name, source }, Route { method, sprayed })
}

/// All methods. The first method is the method of Baek & Heide (2021). The last four methods are two baselines
/// with the spatial help of the joint methods, and two joint methods that weight polarization by its errors.
pub(super) const METHODS: [(Method, Route); 13] = [
    route(
        "epipolar micro phase shift + polarization",
        "Baek & Heide 2021",
        Way::Joint(Code::Micro, Light::Epipolar),
        false,
    ),
    route("Gray code", "Inokuchi et al. 1984", Way::StructuredLight(Code::Gray, Light::All), false),
    route("phase shift", "Srinivasan et al. 1984", Way::StructuredLight(Code::Phase, Light::All), false),
    route("micro phase shift", "Gupta & Nayar 2012", Way::StructuredLight(Code::Micro, Light::All), false),
    route("XOR codes", "Gupta et al. 2011", Way::StructuredLight(Code::Logical, Light::All), false),
    route(
        "epipolar micro phase shift",
        "O'Toole et al. 2014",
        Way::StructuredLight(Code::Micro, Light::Epipolar),
        false,
    ),
    route("polarization", "Atkinson & Hancock 2006", Way::Polarization(Light::All), false),
    route("micro phase shift + polarization", "Baek et al. 2018", Way::Joint(Code::Micro, Light::All), false),
    route(
        "Gray code of the sprayed twin",
        "the paper's pseudo truth",
        Way::StructuredLight(Code::Gray, Light::All),
        true,
    ),
    route("micro phase shift, smoothed", "Nehab et al. 2005", Way::Smoothed(Code::Micro, Light::All), false),
    route(
        "epipolar micro phase shift, smoothed",
        "O'Toole et al. 2014; Nehab et al. 2005",
        Way::Smoothed(Code::Micro, Light::Epipolar),
        false,
    ),
    route("joint, all light", "new here", Way::Weighted(Code::Micro, Light::All), false),
    route("joint", "new here", Way::Weighted(Code::Micro, Light::Epipolar), false),
];

/// Returns the number of the variant with the sprayed object ([`Truth::Slice`]).
fn sprayed(variant: u64) -> u64 {
    variant + 1
}

fn unsolved(method: &'static str) -> impl Fn(ShapeError) -> ApplyError {
    move |e| ApplyError::Unsolved { method, cause: e.to_string() }
}

pub(crate) fn application() -> Application {
    let layer = |name, layer| Truth::Layer { name, layer, through: false };
    Application {
        name: "shape",
        shows: "normals and depths of translucent statues from epipolar structured light combined with polarization (Fig. 11)",
        // Even variants are translucent. Odd variants are the same statues after spraying. Each group of six
        // variants includes all materials and statues.
        plan: Plan {
            scene: "sss_statue/variants.toml",
            train: vec![0, 4, 8],
            test: (12..24).step_by(2).collect(),
            slices: vec!["columns", "epipolar_columns", "polarimetric", "epipolar"],
            truth: vec![
                Truth::Material { name: "statue", of: &["statue", "spray"] },
                layer("position", "position"),
                layer("normal", "geometric_normal"),
                Truth::Slice { name: "sprayed columns", slice: "columns", of: sprayed, samples: 1 },
            ],
            preview: Size { pixels: 64, spp: 32 },
            full: Size { pixels: 128, spp: 256 },
        },
        methods: METHODS.iter().map(|m| m.0).collect(),
        drawn: vec![],
        metrics: METRICS.to_vec(),
        run,
        task: None,
    }
}

pub(super) fn run(train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError> {
    let [train, test] = observation::seen(train, test, Seen::new)?;
    let mut outcome = Outcome::default();
    let mut known = vec![];
    let mut surfaces = |route: Route| -> Result<(Vec<Surface>, String), ShapeError> {
        let (parameters, words) = route.learn(&train, &mut known)?;
        let all: Result<_, _> = test.par_iter().map(|seen| route.run(seen, &parameters)).collect();
        Ok((all?, words))
    };
    let (scans, _) = surfaces(SCAN).map_err(unsolved("epipolar micro phase shift"))?;
    for (method, route) in METHODS {
        let (found, words) = surfaces(route).map_err(unsolved(method.name))?;
        for ((seen, surface), scan) in test.iter().zip(found).zip(&scans) {
            outcome.scores.extend(scores(method.name, seen, &surface, scan));
            outcome.pictures.extend(pictures(method.name, seen, &surface));
        }
        outcome.notes.push(format!("{}, seed {}: {words}", method.name, test[0].seed));
    }
    let truths = test.iter().map(|seen| colours("truth", seen.variant, &seen.normals));
    outcome.pictures.extend(truths);
    Ok(outcome)
}

fn scores(method: &'static str, seen: &Seen, surface: &Surface, scan: &Surface) -> Vec<Score> {
    let n = angular(&surface.normals, &seen.normals, None);
    let z = depth_errors(&surface.depth, &seen.depth, None);
    let scanned = Map::from_fn(seen.depth.width, seen.depth.height, 1, |x, y, out| {
        out[0] = f64::from(u8::from(scan.normals.at(x, y)[0].is_finite()));
    });
    let common = angular(&surface.normals, &seen.normals, Some(&scanned));
    let known = |e: Errors, value: f64| if e.coverage > 0.0 { value } else { f64::NAN };
    let values = [
        known(n, n.mean),
        known(n, n.median),
        known(z, 1e3 * z.mean),
        known(z, 1e3 * z.median),
        n.coverage,
        known(common, common.mean),
    ];
    Score::each(method, seen.variant, &METRICS, values).collect()
}

/// Draws normals as colours ½(1 + n). Red is x (to the right), green is y (up), and blue is z (toward the
/// camera).
fn colours(method: &'static str, variant: u64, normals: &Map) -> Picture {
    let map = Map::from_fn(normals.width, normals.height, 3, |x, y, out| {
        let n = normals.at(x, y);
        // Channels of images are sorted by wavelength, so blue is the first channel.
        out.copy_from_slice(&[-n[2], -n[1], n[0]].map(|v| 0.5 * (1.0 + v)));
    });
    Picture { method, name: "normals", variant: Some(variant), shared: true, map }
}

/// Draws normals as colours, and draws the angular errors of the normals.
fn pictures(method: &'static str, seen: &Seen, surface: &Surface) -> [Picture; 2] {
    let (w, h) = (surface.normals.width, surface.normals.height);
    let off = Map::from_fn(w, h, 1, |x, y, out| {
        let [n, t] = [&surface.normals, &seen.normals].map(|m| m.at(x, y));
        out[0] = crate::metrics::angle::angle_deg(n, t);
    });
    let error =
        Picture { method, name: "error of normals", variant: Some(seen.variant), shared: false, map: off };
    [colours(method, seen.variant, &surface.normals), error]
}
