//! Imaging through scattering media (Baek & Heide 2021, section 6.3, Fig. 12 and the equation for W and b).
//!
//! The camera receives light from the milk, T_b, and light from the objects behind the milk, T_o. For each
//! wavelength, every method estimates the image without milk as a linear function of several features of a
//! pixel. Methods differ in the features. The gains and offsets of all methods, including the baselines, are
//! learned only from the training variants.
//!
//! The features contain noise from the render, as captures contain noise. Noise in the features makes learned
//! weights too small (see [`crate::regression::least_squares`]). Ridge regression and the errors-in-variables
//! solution are therefore compared with ordinary least squares.
//!
//! A photograph is not a linear function of epipolar elements, so the paper's method can be worse than a
//! photograph even on the images to which it is fitted. The features of the joint methods include those of
//! all baselines. Methods whose names end in 3 × 3 also use the means of their features over 3 × 3 pixels. Methods
//! whose names end in `same scene` are fitted to the truth of the test variant itself, as upper bounds.

mod descattering;
mod seen;

use crate::application::{Application, Metric, Outcome, Picture, Plan, Score, Size, Truth};
use crate::chain::few::Task;
use crate::error::ApplyError;
use crate::map::Map;
use crate::metrics::{contrast, psnr::psnr, ssim::ssim};
use crate::observation::{self, Observation};
use crate::regression::moments::Linear;
use descattering::{BASELINES, Descattering, METHODS, Table};
use rayon::prelude::*;
use seen::Seen;

/// Number of variants per arrangement of objects. The first variant has no milk, and the following five
/// variants have different concentrations of milk.
const CONCENTRATIONS: u64 = 6;

/// Number of depth intervals of the ruler.
const PARTS: usize = 3;

/// Minimum contrast in clear water. Marks with a lower contrast are not evaluated.
const LEAST_CONTRAST: f64 = 0.2;

const METRICS: [Metric; 2 + PARTS] = [
    metric("PSNR", "dB"),
    metric("SSIM", ""),
    metric("contrast kept, near marks", ""),
    metric("contrast kept, middle marks", ""),
    metric("contrast kept, far marks", ""),
];

const fn metric(name: &'static str, unit: &'static str) -> Metric {
    Metric { name, unit, more_is_better: true }
}

pub(crate) fn application() -> Application {
    let of = |things: &[u64], milk: &[u64]| {
        things.iter().flat_map(|t| milk.iter().map(move |m| t * CONCENTRATIONS + m)).collect()
    };
    Application {
        name: "scattering",
        shows: "a doll and a ruler in milky water: weights and biases of all epipolar Mueller elements, compared with descattering by space, \
         polarization and time (Fig. 12), and with joint methods of all three",
        plan: Plan {
            scene: "milky_tank/variants.toml",
            train: of(&[0, 2], &[2, 4]),
            test: of(&[1, 3], &[1, 3, 5]),
            slices: vec!["polarimetric", "epipolar", "gated", "transient"],
            truth: vec![
                Truth::Slice {
                    name: seen::CLEAR,
                    slice: "polarimetric",
                    of: |variant| variant - variant % CONCENTRATIONS,
                    samples: 4,
                },
                Truth::Slice {
                    name: seen::CLEAR_IN_TIME,
                    slice: "transient",
                    of: |variant| variant - variant % CONCENTRATIONS,
                    samples: 1,
                },
                Truth::Material { name: "inside", of: &["apple", "card", "doll", "pear", "ruler"] },
                Truth::Material { name: "ruler", of: &["ruler"] },
                Truth::Texture("texture"),
            ],
            preview: Size { pixels: 72, spp: 16 },
            full: Size { pixels: 240, spp: 64 },
        },
        methods: METHODS.iter().map(|m| m.method).collect(),
        drawn: vec![],
        metrics: METRICS.to_vec(),
        run,
        task: Some(task),
    }
}

fn run(train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError> {
    let [train, test] = observation::seen(train, test, Seen::new)?;
    let wavelengths = seen::wavelengths(&train, &test)?;
    let mut outcome = Outcome::default();
    for method in &METHODS {
        let name = method.method.name;
        let fitted = |to: &[Seen]| -> Result<Vec<Linear>, ApplyError> {
            (0..wavelengths).into_par_iter().map(|lane| method.learn(to, lane)).collect()
        };
        if method.same_scene {
            for seen in &test {
                let map = image(method, &fitted(std::slice::from_ref(seen))?, seen);
                outcome.scores.extend(scores(name, &map, seen));
            }
            continue;
        }
        let fits = fitted(&train)?;
        outcome.notes.extend(method.note(&fits));
        if let Some(map) = method.uses_elements().then(|| weight_map(&fits)).flatten() {
            outcome.pictures.push(Picture {
                method: name,
                name: "weights",
                variant: None,
                shared: false,
                map,
            });
        }
        for seen in &test {
            let map = image(method, &fits, seen);
            outcome.scores.extend(scores(name, &map, seen));
            outcome.pictures.push(Picture {
                method: name,
                name: "image",
                variant: Some(seen.variant),
                shared: true,
                map,
            });
        }
    }
    for seen in &test {
        outcome.pictures.push(Picture {
            method: "truth: clear water",
            name: "image",
            variant: Some(seen.variant),
            shared: true,
            map: seen.truth.clone(),
        });
    }
    outcome.notes.push(
        "gains and offsets of every method are learned from the training variants; negative estimates count as dark; only pixels that \
         see an object in the milk count"
            .into(),
    );
    Ok(outcome)
}

fn task(train: &[Observation]) -> Result<Task, ApplyError> {
    let train = train.iter().map(Seen::new).collect::<Result<Vec<_>, _>>()?;
    let wavelengths = seen::wavelengths(&train, &[])?;
    let functional = |lane| -> Result<[f64; 16], ApplyError> {
        let fit = METHODS[0].learn(&train, lane)?;
        Ok(std::array::from_fn(|e| fit.weights[e]))
    };
    Ok(Task {
        slice: "epipolar",
        method: METHODS[0].method.name,
        baselines: METHODS[BASELINES].iter().filter(|m| !m.around).map(|m| m.method.name).collect(),
        functionals: (0..wavelengths).map(functional).collect::<Result<_, _>>()?,
    })
}

/// Returns the image of a method for a variant. Negative radiance is set to 0.
fn image(method: &Descattering, fits: &[Linear], seen: &Seen) -> Map {
    let (w, h) = (seen.truth.width, seen.truth.height);
    let tables: Vec<Table> = (0..fits.len()).map(|lane| method.table(seen, lane)).collect();
    Map::from_fn(w, h, fits.len(), |x, y, out| {
        for (o, (fit, table)) in out.iter_mut().zip(fits.iter().zip(&tables)) {
            let value = fit.of(table.of(y * w + x));
            *o = if value < 0.0 { 0.0 } else { value };
        }
    })
}

/// Returns an image of the weights of the 16 elements. If the features have time bins, the bins are side by
/// side. The image has four rows, four columns per bin, and one channel per wavelength.
fn weight_map(fits: &[Linear]) -> Option<Map> {
    let n = fits.first()?.weights.len();
    if n % 16 != 0 {
        return None;
    }
    Some(Map::from_fn(n / 4, 4, fits.len(), |x, y, out| {
        let at = x / 4 * 16 + y * 4 + x % 4;
        out.iter_mut().zip(fits).for_each(|(o, fit)| *o = fit.weights[at]);
    }))
}

fn scores(method: &'static str, map: &Map, seen: &Seen) -> Vec<Score> {
    let truth = &seen.truth;
    let kept = {
        let by = |m: &Map| contrast::by_depth(m, truth, &seen.depth, &seen.ruler, PARTS, LEAST_CONTRAST);
        let (found, there) = (by(map), by(truth));
        found.into_iter().zip(there).map(|(a, b)| a / b)
    };
    let values = [psnr(map, truth, &seen.mask, seen.peak), ssim(map, truth, &seen.mask, seen.peak)];
    Score::each(method, seen.variant, &METRICS, values.into_iter().chain(kept)).collect()
}

#[cfg(test)]
mod tests;
