//! The fit: captures of known samples → imperfections of the elements, with covariances.

use super::super::least_squares::{Fit, FitError, fit};
use super::parameters::Parameter;
use polarimetry::capture::design_matrix::DesignMatrix;
use polarimetry::capture::element::Ray;
use polarimetry::capture::scheme::Scheme;

/// Captures of something that is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// What it is, e.g. `air`.
    pub name: String,
    /// Its Mueller matrix, row-major, up to brightness.
    pub mueller: [f64; 16],
    /// The elements as their stages stood, with imperfections as they are believed.
    pub scheme: Scheme,
    /// The ray on which it was captured.
    pub ray: Ray,
    /// Intensities, one a measurement.
    pub intensities: Vec<f64>,
    /// Their standard deviations.
    pub sigmas: Vec<f64>,
}

/// Why there is no calibration.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CalibrationError {
    /// Nothing was measured.
    #[error("there is no sample; capture air, a mirror or a known plate")]
    NoSample,
    /// A sample has not a number for each measurement.
    #[error("sample `{name}` has {found} intensities, its scheme {want} measurements")]
    Lengths {
        /// The sample.
        name: String,
        /// Its intensities.
        found: usize,
        /// Measurements.
        want: usize,
    },
    /// A sample shows nothing.
    #[error(
        "sample `{name}` is dark, or its noise is not positive; light it, and leave saturated captures out"
    )]
    Dark {
        /// The sample.
        name: String,
    },
    /// Samples are of different rigs.
    #[error("samples `{first}` and `{other}` were captured with other elements")]
    Elements {
        /// A sample.
        first: String,
        /// Another.
        other: String,
    },
    /// The fit failed.
    #[error(transparent)]
    Fit(#[from] FitError),
}

/// A found imperfection.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// What.
    pub parameter: Parameter,
    /// By its element's name.
    pub name: String,
    /// Value, in its unit.
    pub value: f64,
    /// Standard deviation; `None` where the samples do not tell it alone.
    pub sigma: Option<f64>,
}

/// A calibrated scheme.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibrated {
    /// The first sample's scheme with what was found.
    pub scheme: Scheme,
    /// Everything that was free.
    pub found: Vec<Found>,
    /// What these samples cannot tell, in words.
    pub untold: Vec<String>,
    /// The fit: parameters in the order of `found`, then a brightness for each sample.
    pub fit: Fit,
}

/// Fits imperfections to samples; `free` are those that may differ from what the schemes believe.
///
/// # Errors
/// [`CalibrationError`].
pub fn calibrate(samples: &[Sample], free: &[Parameter]) -> Result<Calibrated, CalibrationError> {
    let Some(first) = samples.first() else {
        return Err(CalibrationError::NoSample);
    };
    let names = |s: &Scheme| -> Vec<String> {
        s.generator()
            .iter()
            .chain(s.analyzer())
            .map(|e| e.name.clone())
            .collect()
    };
    for s in samples {
        let want = s.scheme.measurements();
        if s.intensities.len() != want || s.sigmas.len() != want {
            return Err(CalibrationError::Lengths {
                name: s.name.clone(),
                found: s.intensities.len(),
                want,
            });
        }
        let lit = s.intensities.iter().sum::<f64>() > 0.0;
        if !lit || !s.sigmas.iter().all(|v| *v > 0.0) || s.mueller.iter().any(|v| !v.is_finite()) {
            return Err(CalibrationError::Dark { name: s.name.clone() });
        }
        if names(&s.scheme) != names(&first.scheme) {
            return Err(CalibrationError::Elements {
                first: first.name.clone(),
                other: s.name.clone(),
            });
        }
    }
    let with = |scheme: &Scheme, p: &[f64]| {
        let mut scheme = scheme.clone();
        for (parameter, value) in free.iter().zip(p) {
            parameter.set(&mut scheme, *value);
        }
        scheme
    };
    let predicted =
        |s: &Sample, p: &[f64]| DesignMatrix::new(&with(&s.scheme, p), &s.ray).intensities(&s.mueller);
    let mut start: Vec<f64> = free.iter().map(|p| p.get(&first.scheme, first.ray.nm)).collect();
    let mut steps: Vec<f64> = free.iter().map(Parameter::step).collect();
    for s in samples {
        let dark = predicted(s, &start);
        let (mut of, mut squares) = (0.0, 0.0);
        for ((i, d), sigma) in s.intensities.iter().zip(&dark).zip(&s.sigmas) {
            of += i * d / sigma.powi(2);
            squares += d * d / sigma.powi(2);
        }
        let brightness = of / squares;
        start.push(brightness);
        steps.push(1e-4 * brightness.abs().max(1e-30));
    }
    let residuals = |p: &[f64]| -> Vec<f64> {
        let mut out = vec![];
        for (k, s) in samples.iter().enumerate() {
            let scale = p[free.len() + k];
            let clean = predicted(s, p);
            let all = s.intensities.iter().zip(&clean).zip(&s.sigmas);
            out.extend(all.map(|((i, d), sigma)| (i - scale * d) / sigma));
        }
        out
    };
    let fit = fit(&start, &steps, &residuals)?;
    let mut names: Vec<String> = free.iter().map(|p| p.name(&first.scheme)).collect();
    names.extend(samples.iter().map(|s| format!("brightness of {}", s.name)));
    let mut scheme = first.scheme.clone();
    let mut found = vec![];
    for (i, parameter) in free.iter().enumerate() {
        parameter.set(&mut scheme, parameter.possible(fit.values[i]));
        found.push(Found {
            parameter: *parameter,
            name: names[i].clone(),
            value: fit.values[i],
            sigma: fit.sigma(i),
        });
    }
    Ok(Calibrated {
        scheme,
        found,
        untold: fit.untold_in_words(&names),
        fit,
    })
}

#[cfg(test)]
mod tests {
    use super::super::super::z_scores::{ZScores, repeats};
    use super::*;
    use nalgebra::DVector;
    use polarimetry::capture::coaxial::{Arm, Coaxial};
    use polarimetry::capture::detector::random::stream;
    use polarimetry::capture::spectral_value::SpectralValue;
    use rand_distr::{Distribution, StandardNormal};
    use rayon::prelude::*;

    const AIR: [f64; 16] = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
    const MIRROR: [f64; 16] = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., -1., 0., 0., 0., 0., -1.];

    /// At 0°.
    const POLARIZER: [f64; 16] = [0.5, 0.5, 0., 0., 0.5, 0.5, 0., 0., 0., 0., 0., 0., 0., 0., 0., 0.];

    fn truth(nominal: &Scheme, seed: u32) -> (Scheme, Vec<f64>) {
        let mut out = nominal.clone();
        let all = Parameter::all(nominal);
        let mut random = stream(11, 0, seed);
        let mut values = vec![];
        for p in &all {
            let z: f64 = StandardNormal.sample(&mut random);
            let value = match p {
                Parameter::Extinction(..) | Parameter::SensorExtinction => 2e-3 * z.abs(),
                Parameter::Diattenuation(_) => 0.05 * z,
                Parameter::GalvoIndex | Parameter::GalvoAbsorption => {
                    p.get(nominal, 550.0) * (1.0 + 0.02 * z)
                }
                _ => z,
            };
            p.set(&mut out, value);
            values.push(value);
        }
        (out, values)
    }

    fn sample(
        name: &str,
        mueller: [f64; 16],
        nominal: &Scheme,
        truth: &Scheme,
        sigma: f64,
        key: u32,
    ) -> Sample {
        let ray = Ray::axial(550.0);
        let mut random = stream(5, 1, key);
        let mut noisy = |v: f64| {
            let z: f64 = StandardNormal.sample(&mut random);
            0.3 * v + sigma * z
        };
        let clean = DesignMatrix::new(truth, &ray).intensities(&mueller);
        Sample {
            name: name.into(),
            mueller,
            scheme: nominal.clone(),
            ray,
            intensities: clean.iter().map(|v| noisy(*v)).collect(),
            sigmas: vec![sigma; nominal.measurements()],
        }
    }

    /// Repeats with other truths and other noise: errors over stated sigmas have variance 1, for every parameter by itself.
    #[test]
    fn stated_errors_are_those_that_are_made() {
        let count = repeats(128);
        for (array, what) in [(false, "intensities"), (true, "polarizer array")] {
            let nominal = Scheme::quad(24, array).expect("a scheme");
            let free = Parameter::all(&nominal);
            let one = |repeat: u32| {
                let (real, values) = truth(&nominal, repeat);
                let samples = [("air", AIR), ("mirror", MIRROR), ("polarizer", POLARIZER)];
                let samples: Vec<Sample> = (3 * repeat..)
                    .zip(samples)
                    .map(|(key, (name, mueller))| sample(name, mueller, &nominal, &real, 2e-4, key))
                    .collect();
                let found = calibrate(&samples, &free).expect("a calibration");
                assert!(found.untold.is_empty(), "{:?}", found.untold);
                (found, values)
            };
            let all: Vec<(Calibrated, Vec<f64>)> = (0..count).into_par_iter().map(one).collect();
            let mut scores = ZScores::default();
            let (mut chi, mut freedom) = (0.0, 0.0);
            for (found, values) in &all {
                let n = free.len();
                let off = DVector::from_fn(n, |i, _| found.fit.values[i] - values[i]);
                let covariance = found.fit.covariance.view((0, 0), (n, n)).into_owned();
                scores.add_whitened("all together", &off, &covariance);
                for (f, want) in found.found.iter().zip(values) {
                    scores.add(&f.name, f.value - want, f.sigma.expect("told"));
                }
                chi += found.fit.chi_squared;
                freedom += found.fit.freedom as f64;
            }
            scores.hold(what);
            let ratio = chi / freedom;
            assert!(
                (ratio - 1.0).abs() < 5.0 * (2.0 / freedom).sqrt(),
                "{what}: {ratio}"
            );
        }
    }

    #[test]
    fn air_alone_cannot_tell_a_common_rotation() {
        let nominal = Scheme::quad(24, false).expect("a scheme");
        let (real, _) = truth(&nominal, 3);
        let air = sample("air", AIR, &nominal, &real, 1e-4, 1);
        let found = calibrate(&[air], &Parameter::all(&nominal)).expect("a calibration");
        let words = found.untold.join("; ");
        assert!(
            words.contains("polarizer_1 axis offset") && words.contains("together"),
            "{words}"
        );
        let told = |name: &str| {
            found
                .found
                .iter()
                .find(|f| f.name == name)
                .expect("a parameter")
                .sigma
        };
        assert_eq!(told("retarder_2 axis offset"), None);
        assert!(told("retarder_2 retardance error").is_some());
    }

    /// A coaxial rig's beamsplitter is found with a mirror and a plate.
    #[test]
    fn a_beamsplitter_is_found() {
        let mut nominal = Scheme::quad(40, false).expect("a scheme");
        let arm = || Arm {
            efficiency: SpectralValue::Same(0.5),
            diattenuation: SpectralValue::Same(0.0),
            retardance_deg: SpectralValue::Same(0.0),
        };
        nominal.coaxial = Some(Coaxial {
            transmission: arm(),
            reflection: arm(),
            galvo: None,
        });
        let free = Parameter::all(&nominal);
        let (real, values) = truth(&nominal, 8);
        // A quarter-wave plate at 22.5° passed twice is a half-wave plate before the mirror.
        let plate = {
            let h = 0.5_f64.sqrt();
            [1., 0., 0., 0., 0., h, h, 0., 0., -h, h, 0., 0., 0., 0., 1.0]
        };
        let samples = [
            sample("mirror", MIRROR, &nominal, &real, 1e-4, 3),
            sample("plate", plate, &nominal, &real, 1e-4, 4),
        ];
        let found = calibrate(&samples, &free).expect("a calibration");
        for (f, want) in found.found.iter().zip(&values) {
            if let Some(sigma) = f.sigma {
                assert!(
                    (f.value - want).abs() < 6.0 * sigma + 1e-9,
                    "{}: {} {want} {sigma}",
                    f.name,
                    f.value
                );
            }
        }
        println!("{:?}", found.untold);
    }

    #[test]
    fn what_cannot_be_calibrated_is_refused() {
        let nominal = Scheme::drr(9, false).expect("a scheme");
        let free = Parameter::all(&nominal);
        assert_eq!(calibrate(&[], &free), Err(CalibrationError::NoSample));
        let good = sample("air", AIR, &nominal, &nominal, 1e-3, 0);
        let mut dark = good.clone();
        dark.intensities.fill(0.0);
        assert!(matches!(
            calibrate(&[dark], &free),
            Err(CalibrationError::Dark { .. })
        ));
        let mut short = good.clone();
        short.intensities.pop();
        assert!(matches!(
            calibrate(&[short], &free),
            Err(CalibrationError::Lengths { .. })
        ));
        let mut lost = good.clone();
        lost.intensities[3] = f64::NAN;
        assert!(calibrate(&[lost], &free).is_err());
        let few = Scheme::drr(3, false).expect("a scheme");
        let three = sample("air", AIR, &few, &few, 1e-3, 0);
        assert!(matches!(
            calibrate(&[three], &free),
            Err(CalibrationError::Fit(FitError::TooFew { .. }))
        ));
    }
}
