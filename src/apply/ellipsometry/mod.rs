//! Evaluates learned rotating ellipsometry (Baek & Heide 2021, section 4, Fig. 4, 9 and 10). The application
//! measures the reconstruction error of schemes with few captures and learned angles. The samples are a gold
//! mirror and materials that were not used for learning.
//!
//! The paper tests its 15 captures with a polarizer array (L-QRPR-P) against a pseudo truth. The pseudo truth
//! consists of 50 captures of dual rotating retarders (DRR; Azzam 1978) with separate noise. In this
//! application, the true matrices are known. Errors are computed with respect to the true matrices and to the
//! pseudo truth. The difference between these two errors is due to the error of the pseudo truth.
//!
//! The renderer computes the light without detector noise. As in the paper, the standard deviation of the
//! detector noise is 5e-4 of the mean T00. The seeds select this noise. Angles and the prior are learned from
//! the training variants. The prior is the second moment of the matrices, whose principal components the
//! paper shows.

mod bench;
mod errors;
mod family;

use crate::application::{Application, Method, Metric, Outcome, Picture, Plan, Score, Size, Truth, itself};
use crate::error::ApplyError;
use crate::map::Map;
use crate::observation::{self, Observation};
use bench::{Bench, LIGHT, OBJECT, second_moment};
use errors::{ALL, Of, rms, share};
use family::{Family, NOISE, Ready, bound};
use rayon::prelude::*;

/// Number of captures in the paper. `PSEUDO` is the number of captures in the paper's pseudo truth.
const SHOWN: usize = 15;
const PSEUDO: usize = 50;

/// Name of the images of the pseudo truth.
const PSEUDO_TRUTH: &str = "DRR, 50 captures";

/// Index of the element (2,3). The paper's figure 10 shows the negative of this element. The mirror is object
/// 0 of the scene.
const ELEMENT_23: usize = 11;
const MIRROR: i64 = 0;

const UNIT: &str = "1e-3 of the mean M00";

const METRICS: [Metric; 10] = [
    metric("error, 15 captures", UNIT),
    metric("against 50 captures of DRR, 15 captures", UNIT),
    metric("the same over the true error, 15 captures", ""),
    metric("error on gold, 15 captures", "1e-3 of gold's mean M00"),
    metric("error of (2,3), 15 captures", UNIT),
    metric("error, 7 captures", UNIT),
    metric("error, 10 captures", UNIT),
    metric("error, 20 captures", UNIT),
    metric("error, 25 captures", UNIT),
    metric("error, 36 captures", UNIT),
];

/// For each metric that measures an error with respect to the truth: the metric's index, and the number of
/// captures.
const CURVE: [(usize, usize); 5] = [(5, 7), (6, 10), (7, 20), (8, 25), (9, 36)];

const fn metric(name: &'static str, unit: &'static str) -> Metric {
    Metric { name, unit, more_is_better: false }
}

#[derive(Clone, Copy)]
enum Kind {
    Captures(Family),
    /// The lower bound without a prior, for a sensor with (true) or without (false) a polarizer array.
    Bound(bool),
}

const fn captures(array: bool, learnt: bool, prior: bool) -> Kind {
    Kind::Captures(Family { array, learnt, prior })
}

const METHODS: [(Method, Kind); 9] = [
    (Method::new("L-QRPR-P", "Baek & Heide 2021"), captures(true, true, false)),
    (Method::new("L-QRPR-P with a prior", "the same, and what is expected"), captures(true, true, true)),
    (Method::new("L-QRPR", "Baek & Heide 2021"), captures(false, true, false)),
    (Method::new("L-QRPR with a prior", "the same, and what is expected"), captures(false, true, true)),
    (Method::new("DRR-P", "Azzam 1978 with a polarizer array"), captures(true, false, false)),
    (Method::new("DRR-P with a prior", "the same, and what is expected"), captures(true, false, true)),
    (Method::new("DRR", "Azzam 1978"), captures(false, false, false)),
    (Method::new("DRR with a prior", "the same, and what is expected"), captures(false, false, true)),
    (Method::new("A-optimal bound, array", "closed form"), Kind::Bound(true)),
];

pub(crate) fn application() -> Application {
    Application {
        name: "ellipsometry",
        shows: "Mueller matrices of gold and of unseen materials from few captures at learned angles (Fig. 4, 9, 10)",
        plan: Plan {
            scene: "materials/variants.toml",
            train: (0..10).collect(),
            test: (10..20).collect(),
            slices: vec![],
            truth: vec![
                Truth::Slice { name: LIGHT, slice: "polarimetric", of: itself, samples: 16 },
                Truth::Object(OBJECT),
            ],
            preview: Size { pixels: 48, spp: 16 },
            full: Size { pixels: 128, spp: 64 },
        },
        methods: METHODS.iter().map(|(m, _)| *m).collect(),
        drawn: vec![PSEUDO_TRUTH],
        metrics: METRICS.to_vec(),
        run,
        task: None,
    }
}

fn run(train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError> {
    let [train, test] = observation::seen(train, test, Bench::new)?;
    let moment = second_moment(&train)?;
    let drr = Family { array: false, learnt: false, prior: false };
    let pseudo_truth = drr.with(PSEUDO, &moment)?;
    // As in a laboratory, all methods are compared with the same captures of the pseudo truth.
    let pseudo: Vec<Vec<f64>> =
        test.par_iter().map(|bench| bench.estimate(&pseudo_truth, 0)).collect::<Result<_, _>>()?;
    let mut outcome = Outcome::default();
    for (i, (method, kind)) in METHODS.iter().enumerate() {
        let schemes = match kind {
            Kind::Bound(_) => vec![],
            Kind::Captures(family) => [SHOWN]
                .into_iter()
                .chain(CURVE.map(|(_, captures)| captures))
                .map(|captures| family.with(captures, &moment))
                .collect::<Result<Vec<_>, _>>()?,
        };
        let judged: Vec<Judged> = test
            .par_iter()
            .zip(&pseudo)
            .map(|(bench, pseudo)| match kind {
                Kind::Bound(array) => Ok(judge_bound(bench, *array)),
                Kind::Captures(_) => judge(bench, &schemes, pseudo, 256 * (i as u64 + 1)),
            })
            .collect::<Result<_, ApplyError>>()?;
        for (bench, judged) in test.iter().zip(judged) {
            outcome.scores.extend(Score::each(method.name, bench.variant, &METRICS, judged.values));
            if let Some(found) = judged.found {
                outcome.pictures.extend(pictures(method.name, bench, &found));
            }
        }
    }
    for (bench, pseudo) in test.iter().zip(&pseudo) {
        let [element, _] = pictures("truth", bench, bench.truth());
        outcome.pictures.push(element);
        outcome.pictures.extend(pictures(PSEUDO_TRUTH, bench, pseudo));
    }
    outcome.notes.extend(notes(&moment));
    Ok(outcome)
}

/// The metrics of a method on a variant, and the matrices that the method estimates from 15 captures.
struct Judged {
    values: [f64; METRICS.len()],
    found: Option<Vec<f64>>,
}

/// Computes the metrics of a family. `schemes` contains the scheme of 15 captures, followed by the schemes of
/// the curve. `pseudo` contains the matrices of the pseudo truth.
fn judge(bench: &Bench, schemes: &[Ready], pseudo: &[f64], stream: u64) -> Result<Judged, ApplyError> {
    let mut values = [f64::NAN; METRICS.len()];
    let found = bench.estimate(&schemes[0], stream)?;
    let per_mille = |against: &[f64], of: &Of<'_>| 1e3 * rms(bench, &found, against, of);
    values[0] = per_mille(bench.truth(), &ALL);
    values[1] = per_mille(pseudo, &ALL);
    values[2] = values[1] / values[0];
    values[3] = per_mille(bench.truth(), &Of { object: Some(MIRROR), ..ALL });
    values[4] = per_mille(bench.truth(), &Of { elements: &[ELEMENT_23], object: None });
    for ((metric, _), (ready, stream)) in CURVE.iter().zip(schemes[1..].iter().zip(stream + 1..)) {
        values[*metric] = 1e3 * rms(bench, &bench.estimate(ready, stream)?, bench.truth(), &ALL);
    }
    Ok(Judged { values, found: Some(found) })
}

/// Returns the metrics of the bound. The brightness of gold is the only property of the variant that affects
/// these metrics.
fn judge_bound(bench: &Bench, array: bool) -> Judged {
    let mut values = [f64::NAN; METRICS.len()];
    let at = |captures| bound(captures, array).map_or(f64::NAN, |b| 1e3 * NOISE * b);
    values[0] = at(SHOWN);
    values[3] = at(SHOWN) / share(bench, MIRROR);
    for (metric, captures) in CURVE {
        values[metric] = at(captures);
    }
    Judged { values, found: None }
}

/// Draws -(2,3) and the magnitude of the error of all elements, relative to the mean T00 of all pixels. The
/// images have one channel per wavelength.
fn pictures(method: &'static str, bench: &Bench, found: &[f64]) -> [Picture; 2] {
    let mean = bench.brightness();
    let map = |value: &dyn Fn(&[f64], &[f64]) -> f64| {
        Map::from_fn(bench.width, bench.height, bench.lanes, |x, y, out| {
            for (lane, o) in out.iter_mut().enumerate() {
                let at = ((y * bench.width + x) * bench.lanes + lane) * 16;
                *o = value(&found[at..at + 16], &bench.truth()[at..at + 16]) / mean;
            }
        })
    };
    let picture = |name, map| Picture { method, name, variant: Some(bench.variant), shared: true, map };
    [
        picture("minus 23", map(&|found, _| -found[ELEMENT_23])),
        picture(
            "error",
            map(&|found, truth| {
                let squares = found.iter().zip(truth).map(|(f, t)| (f - t).powi(2));
                squares.sum::<f64>().sqrt()
            }),
        ),
    ]
}

/// Returns notes on the learned second moment.
fn notes(moment: &polarimetry::reconstruct::second_moment::Moment) -> Vec<String> {
    let mut values: Vec<f64> = moment.symmetric_eigenvalues().iter().copied().collect();
    values.sort_by(|a, b| b.total_cmp(a));
    let whole: f64 = values.iter().sum();
    let share = |n: usize| 100.0 * values[..n].iter().sum::<f64>() / whole;
    vec![
        format!(
            "the first 1, 4 and 9 principal components (including the mean) contain {:.2} %, {:.2} % and {:.3} % of the training matrices",
            share(1),
            share(4),
            share(9)
        ),
        "without a prior, the angles of 16 or more captures (8 with an array) do not depend on the materials: the estimate is unbiased, \
         and its error is due to noise only"
            .to_owned(),
    ]
}

#[cfg(test)]
mod tests;
