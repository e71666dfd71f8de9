//! Measures the retardance of crystals (Baek & Heide 2021, Fig. 7). The matrices of epipolar and non-epipolar
//! light of quartz and calcite slabs are decomposed. The measured retardance is compared with the theoretical
//! retardance 2π L (n_e(ψ) - n_o)/λ.
//!
//! A decomposition gives a retardance between 0 and π, so the true retardance is folded to this range. Three
//! wavelengths together determine the number of whole waves ([`predicted::order`]).
//!
//! Each method learns one number from the training variants. This number is the error that is not due to
//! Monte Carlo noise. This systematic error has three sources:
//! - changes of retardance within a pixel,
//! - internal reflections,
//! - light from the plate next to the observed point.
//!
//! The learned error is added to the standard errors so that half of the errors are within 0.6745 standard
//! errors. The test slabs then show whether the learned error is correct: the report states the fraction of
//! errors within two standard errors.

pub mod faces;
pub mod measured;
pub mod mineral;
pub mod predicted;
mod seen;

use crate::application::{Application, Method, Metric, Outcome, Picture, Plan, Score, Size, Truth};
use crate::error::ApplyError;
use crate::map::Map;
use crate::observation::{self, Observation};
use predicted::{MIDDLE, folded, order};
use rayon::prelude::*;
use seen::{Probe, Seen};

const METRICS: [Metric; 5] = [
    Metric::new("retardance, median error", "deg", false),
    Metric::new("retardance, mean error", "deg", false),
    Metric::new("coverage", "", true),
    Metric::new("order found", "", true),
    Metric::new("errors within two stated ones", "", true),
];

const fn method(name: &'static str, source: &'static str, probe: Probe) -> (Method, Probe) {
    (Method { name, source }, probe)
}

const METHODS: [(Method, Probe); 6] = [
    method("brighter of both", "epipolar or not, pixel by pixel", Probe::Brighter),
    method("epipolar", "Baek & Heide 2021", Probe::Epipolar),
    method("non-epipolar", "Baek & Heide 2021", Probe::NonEpipolar),
    method("all light", "Lu & Chipman 1996", Probe::All),
    method("all light, an ideal mirror taken out", "Lu & Chipman 1996", Probe::AllBeforeMirror),
    method("all light as it is", "Lu & Chipman 1996", Probe::AllAsItIs),
];

/// Maximum optical path difference of the search, in wavelengths at [`MIDDLE`].
const MOST_WAVES: f64 = 12.0;

/// Maximum error of a correct path difference, in wavelengths.
const NEAR_WAVES: f64 = 0.1;

/// Limit, in standard deviations, below which half of normally distributed absolute errors are.
const HALF: f64 = 0.6745;

/// Returns the variant without the slab ([`Truth::Slice`]).
fn without(variant: u64) -> u64 {
    variant + 1
}

pub(crate) fn application() -> Application {
    let layer = |name, layer, through| Truth::Layer { name, layer, through };
    Application {
        name: "crystals",
        shows: "retardance of quartz and calcite from decompositions of epipolar and other light, compared with theory (Fig. 7)",
        plan: Plan {
            scene: "crystals/variants.toml",
            train: vec![0, 2, 4, 6],
            test: (8..20).step_by(2).collect(),
            slices: vec!["polarimetric", "epipolar", "nonepipolar"],
            truth: vec![
                layer("optical length", "optical_length", true),
                layer("length", "depth", true),
                layer("normal", "geometric_normal", false),
                Truth::Slice { name: "without", slice: "polarimetric", of: without, samples: 1 },
            ],
            preview: Size { pixels: 48, spp: 64 },
            full: Size { pixels: 128, spp: 256 },
        },
        methods: METHODS.iter().map(|m| m.0).collect(),
        drawn: vec![],
        metrics: METRICS.to_vec(),
        run,
        task: None,
    }
}

fn run(train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError> {
    let [train, test] = observation::seen(train, test, Seen::new)?;
    let mut outcome = Outcome::default();
    for (method, probe) in METHODS {
        let floor = floor(&train, probe);
        for seen in &test {
            outcome.scores.extend(scores(method.name, probe, seen, floor));
            outcome.pictures.extend(pictures(method.name, probe, seen));
        }
        outcome.notes.push(format!(
            "{}, seed {}: an error of {:.2}° is not due to sampling noise",
            method.name,
            test[0].seed,
            floor.to_degrees()
        ));
    }
    Ok(outcome)
}

/// Returns the error and the standard error of the retardance, in radians, for every pixel and wavelength
/// with a decomposition.
fn errors(seen: &Seen, probe: Probe) -> Vec<[f64; 2]> {
    let of = |i: usize| {
        let truth = seen.pixels[i].retardance.iter();
        let found = seen.found(probe, i).iter();
        truth.zip(found).filter_map(|(delta, found)| {
            let d = found.as_ref()?;
            Some([d.properties.retardance - folded(*delta), d.error])
        })
    };
    (0..seen.pixels.len()).flat_map(of).collect()
}

/// Returns the error floor in radians. With this floor, half of all errors are below [`HALF`] times the
/// stated error.
fn floor(train: &[Seen], probe: Probe) -> f64 {
    let all: Vec<[f64; 2]> = train.iter().flat_map(|seen| errors(seen, probe)).collect();
    let within = |floor: f64| {
        let inside = all.iter().filter(|[e, s]| e.abs() < HALF * s.hypot(floor)).count();
        2 * inside >= all.len()
    };
    let (mut low, mut high) = (0.0, std::f64::consts::PI);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if within(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

fn scores(method: &'static str, probe: Probe, seen: &Seen, floor: f64) -> Vec<Score> {
    let all = errors(seen, probe);
    let n = all.len() as f64;
    let mut sizes: Vec<f64> = all.iter().map(|[e, _]| e.abs().to_degrees()).collect();
    sizes.sort_by(f64::total_cmp);
    let message = (0..seen.pixels.len()).into_par_iter().filter(|i| {
        let known: Option<Vec<[f64; 2]>> = seen
            .found(probe, *i)
            .iter()
            .map(|d| d.as_ref().map(|d| [d.properties.retardance, d.error.hypot(floor).max(1e-3)]))
            .collect();
        known.is_some_and(|known| {
            let part = |k: usize| known.iter().map(|d| d[k]).collect::<Vec<f64>>();
            let wave = MIDDLE * 1e-9;
            let path = order(seen.mineral, &seen.wavelengths, &part(0), &part(1), MOST_WAVES * wave);
            (path - seen.pixels[*i].path.abs()).abs() < NEAR_WAVES * wave
        })
    });
    let stated = all.iter().filter(|[e, s]| e.abs() < 2.0 * s.hypot(floor)).count() as f64;
    let values = [
        sizes.get(sizes.len() / 2).copied().unwrap_or(f64::NAN),
        sizes.iter().sum::<f64>() / n,
        n / (seen.pixels.len() * seen.wavelengths.len()) as f64,
        message.count() as f64 / seen.pixels.len() as f64,
        stated / n,
    ];
    Score::each(method, seen.variant, &METRICS, values).collect()
}

/// Draws the measured retardance in degrees, the theoretical retardance, polarizance and diattenuation. The
/// images have one channel per wavelength.
fn pictures(method: &'static str, probe: Probe, seen: &Seen) -> Vec<Picture> {
    let draw = |name, value: &dyn Fn(usize, usize) -> Option<f64>| {
        let channels = seen.wavelengths.len();
        let mut map = Map::from_fn(seen.size[0], seen.size[1], channels, |_, _, o| o.fill(f64::NAN));
        for (i, p) in seen.pixels.iter().enumerate() {
            for k in 0..channels {
                map.data[p.pixel * channels + k] = value(i, k).unwrap_or(f64::NAN);
            }
        }
        Picture { method, name, variant: Some(seen.variant), shared: true, map }
    };
    let of = |f: fn(&measured::Decomposed) -> f64| {
        move |i: usize, k: usize| seen.found(probe, i)[k].as_ref().map(f)
    };
    vec![
        draw("retardance", &of(|d| d.properties.retardance.to_degrees())),
        draw("polarizance", &of(|d| d.properties.polarizance)),
        draw("diattenuation", &of(|d| d.properties.diattenuation)),
        draw("retardance by theory", &|i, k| Some(folded(seen.pixels[i].retardance[k]).to_degrees())),
    ]
}

#[cfg(test)]
mod tests;
