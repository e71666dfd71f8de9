//! Tests fitted values, stated errors, and undetermined parameters with simulated imperfections.

use super::super::least_squares::FitError;
use super::super::z_scores::{ZScores, repeats};
use super::parameters::Parameter;
use super::samples::{Calibrated, CalibrationError, Found, Sample, calibrate};
use nalgebra::DVector;
use polarimetry::capture::coaxial::{Arm, Coaxial, Galvo};
use polarimetry::capture::design_matrix::DesignMatrix;
use polarimetry::capture::detector::random::stream;
use polarimetry::capture::element::Ray;
use polarimetry::capture::scheme::Scheme;
use polarimetry::capture::spectral_value::SpectralValue;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

const AIR: [f64; 16] = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
const MIRROR: [f64; 16] = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., -1., 0., 0., 0., 0., -1.];

/// Mueller matrix of an ideal polarizer at 0°.
const POLARIZER: [f64; 16] = [0.5, 0.5, 0., 0., 0.5, 0.5, 0., 0., 0., 0., 0., 0., 0., 0., 0., 0.];

/// Mueller matrix of a plate that rotates linear polarization by 22.5°.
const PLATE: [f64; 16] = {
    let h = std::f64::consts::FRAC_1_SQRT_2;
    [1., 0., 0., 0., 0., h, h, 0., 0., -h, h, 0., 0., 0., 0., 1.0]
};

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
            Parameter::GalvoIndex | Parameter::GalvoAbsorption => p.get(nominal, 550.0) * (1.0 + 0.02 * z),
            _ => z,
        };
        p.set(&mut out, value);
        values.push(value);
    }
    (out, values)
}

fn sample(name: &str, mueller: [f64; 16], nominal: &Scheme, truth: &Scheme, sigma: f64, key: u32) -> Sample {
    sample_along(name, mueller, nominal, truth, Ray::axial(550.0), sigma, key)
}

fn sample_along(
    name: &str,
    mueller: [f64; 16],
    nominal: &Scheme,
    truth: &Scheme,
    ray: Ray,
    sigma: f64,
    key: u32,
) -> Sample {
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
        readings: nominal.measurements(),
        left_out: 0,
    }
}

/// Over repetitions with different true values and noise, the ratio of actual to stated error has variance 1
/// for every parameter.
#[test]
#[ignore = "slow: tools/check --all"]
fn stated_errors_match_actual_errors() {
    let count = repeats(32);
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
            assert!(found.undetermined.is_empty(), "{:?}", found.undetermined);
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
                scores.add(&f.name, f.value - want, f.sigma.expect("an error estimate"));
            }
            chi += found.fit.chi_squared;
            freedom += found.fit.freedom as f64;
        }
        scores.hold(what);
        let ratio = chi / freedom;
        assert!((ratio - 1.0).abs() < 5.0 * (2.0 / freedom).sqrt(), "{what}: {ratio}");
    }
}

#[test]
fn air_alone_does_not_determine_a_common_rotation() {
    let nominal = Scheme::quad(24, false).expect("a scheme");
    let (real, _) = truth(&nominal, 3);
    let air = sample("air", AIR, &nominal, &real, 1e-4, 1);
    let found = calibrate(&[air], &Parameter::all(&nominal)).expect("a calibration");
    let words = found.undetermined.join("; ");
    assert!(words.contains("polarizer_1 axis offset") && words.contains("together"), "{words}");
    let message = |name: &str| found.found.iter().find(|f| f.name == name).expect("a parameter").sigma;
    assert_eq!(message("retarder_2 axis offset"), None);
    assert!(message("retarder_2 retardance error").is_some());
}

/// Returns one arm of an ideal 50:50 beamsplitter.
fn arm() -> Arm {
    Arm {
        efficiency: SpectralValue::Same(0.5),
        diattenuation: SpectralValue::Same(0.0),
        retardance_deg: SpectralValue::Same(0.0),
    }
}

/// Returns a coaxial rig whose optical parameters depend on the wavelength.
fn dispersive() -> Scheme {
    let mut nominal = Scheme::quad(16, false).expect("a scheme");
    // Assumed optical constants of protected silver.
    nominal.coaxial = Some(Coaxial {
        transmission: arm(),
        reflection: arm(),
        galvo: Some(Galvo {
            n: SpectralValue::Table(vec![[450.0, 0.04], [660.0, 0.05]]),
            k: SpectralValue::Table(vec![[450.0, 2.65], [660.0, 4.49]]),
        }),
    });
    nominal
}

const WAVELENGTHS: [f64; 2] = [450.0, 660.0];

/// Returns a true scheme with random values per wavelength, and these values in the order of the fitted
/// numbers.
fn dispersive_truth(nominal: &Scheme, seed: u32) -> (Scheme, Vec<f64>) {
    let mut random = stream(12, 0, seed);
    let (mut out, mut values) = (nominal.clone(), vec![]);
    for p in Parameter::all(nominal) {
        let mut rows: Vec<[f64; 2]> = vec![];
        for nm in WAVELENGTHS {
            let z: f64 = StandardNormal.sample(&mut random);
            let value = match p {
                Parameter::Extinction(..) => 2e-3 * z.abs(),
                Parameter::Diattenuation(_) => 0.05 * z,
                Parameter::GalvoIndex | Parameter::GalvoAbsorption => p.get(nominal, nm) * (1.0 + 0.1 * z),
                _ => z,
            };
            rows.push([nm, value]);
        }
        if !p.is_spectral() {
            rows.truncate(1);
        }
        p.set_table(&mut out, &rows);
        values.extend(rows.iter().map(|r| r[1]));
    }
    (out, values)
}

fn dispersive_samples(
    nominal: &Scheme,
    real: &Scheme,
    directions: usize,
    sigma: f64,
    key: u32,
) -> Vec<Sample> {
    let things = [("air", AIR), ("mirror", MIRROR), ("plate", PLATE)];
    let mut samples = vec![];
    for nm in WAVELENGTHS {
        for direction in 0..directions {
            let azimuth = std::f64::consts::FRAC_PI_2 * direction as f64;
            let incidence = if direction == 0 { 0.0 } else { 8.0_f64.to_radians() };
            for (name, mueller) in things {
                let ray = Ray { nm, incidence, azimuth };
                let n = samples.len() as u32;
                samples.push(sample_along(name, mueller, nominal, real, ray, sigma, 64 * key + n));
            }
        }
    }
    samples
}

/// The test fits n and k of the mirrors and the properties of both arms at two wavelengths, jointly with the
/// elements. After whitening by the full covariance, the errors of all determined parameters have variance 1.
#[test]
#[ignore = "slow: tools/check --all"]
fn dispersion_is_recovered_with_correct_errors() {
    let nominal = dispersive();
    let one = |repeat: u32| {
        let (real, values) = dispersive_truth(&nominal, repeat);
        let samples = dispersive_samples(&nominal, &real, 3, 1e-5, repeat);
        let found = calibrate(&samples, &Parameter::all(&nominal)).expect("a calibration");
        (real, values, found)
    };
    let all: Vec<_> = (0..repeats(4)).into_par_iter().map(one).collect();
    let mut scores = ZScores::default();
    for (_, values, found) in &all {
        assert!(found.undetermined.is_empty(), "{:?}", found.undetermined);
        let n = values.len();
        assert_eq!(found.found.len(), n);
        let off = DVector::from_fn(n, |i, _| found.fit.values[i] - values[i]);
        let covariance = found.fit.covariance.view((0, 0), (n, n)).into_owned();
        scores.add_whitened("all together", &off, &covariance);
        for (f, want) in found.found.iter().zip(values) {
            scores.add(&f.name, f.value - want, f.sigma.expect("an error estimate"));
        }
    }
    scores.hold("two wavelengths");
    // The calibration file contains a table of values by wavelength.
    let (real, _, found) = &all[0];
    let galvo = |s: &Scheme| s.coaxial.as_ref().and_then(|c| c.galvo.clone()).expect("a galvo");
    let sigma = |p: Parameter, nm: f64| {
        let of = |f: &&Found| f.parameter == p && f.nm == Some(nm);
        found.found.iter().find(of).and_then(|f| f.sigma).expect("an error estimate")
    };
    let (was, is) = (galvo(real), galvo(&found.scheme));
    for nm in WAVELENGTHS {
        let [n, k] = [is.n.at(nm) - was.n.at(nm), is.k.at(nm) - was.k.at(nm)];
        let [sn, sk] = [Parameter::GalvoIndex, Parameter::GalvoAbsorption].map(|p| sigma(p, nm));
        assert!(n.abs() < 5.0 * sn && k.abs() < 5.0 * sk, "{nm}: {n} ± {sn}, {k} ± {sk}");
    }
    assert!(is.k.at(660.0) > 1.2 * is.k.at(450.0));
    // Samples of unknown brightness do not change the brightness of the optics, although n and k of the
    // mirrors change.
    let believed = nominal.coaxial.as_ref().expect("coaxial optics");
    let optics = found.scheme.coaxial.as_ref().expect("coaxial optics");
    for nm in WAVELENGTHS {
        let axis = Ray::axial(nm);
        let both = |c: &Coaxial| c.outward(&axis)[(0, 0)] * c.inward(&axis)[(0, 0)];
        assert!((both(optics) / both(believed) - 1.0).abs() < 1e-5);
        assert!(
            (optics.transmission.efficiency.at(nm) / believed.transmission.efficiency.at(nm) - 1.0).abs()
                > 1e-3
        );
    }
}

/// Along one direction, mirrors and beamsplitter are not determined separately, and the calibration reports
/// this direction.
#[test]
fn one_direction_does_not_separate_mirrors_from_the_beamsplitter() {
    let nominal = dispersive();
    let (real, _) = dispersive_truth(&nominal, 1);
    let samples = dispersive_samples(&nominal, &real, 1, 1e-5, 1);
    let found = calibrate(&samples, &Parameter::all(&nominal)).expect("a calibration");
    let words = found.undetermined.join("; ");
    assert!(words.contains("galvo absorption at 450 nm") && words.contains("together"), "{words}");
}

/// A mirror and a plate determine a coaxial rig's beamsplitter.
#[test]
fn a_beamsplitter_is_recovered() {
    let mut nominal = Scheme::quad(40, false).expect("a scheme");
    nominal.coaxial = Some(Coaxial { transmission: arm(), reflection: arm(), galvo: None });
    let free = Parameter::all(&nominal);
    let (real, values) = truth(&nominal, 8);
    let samples = [
        sample("mirror", MIRROR, &nominal, &real, 1e-4, 3),
        sample("plate", PLATE, &nominal, &real, 1e-4, 4),
    ];
    let found = calibrate(&samples, &free).expect("a calibration");
    for (f, want) in found.found.iter().zip(&values) {
        if let Some(sigma) = f.sigma {
            assert!((f.value - want).abs() < 6.0 * sigma + 1e-9, "{}: {} {want} {sigma}", f.name, f.value);
        }
    }
    println!("{:?}", found.undetermined);
}

#[test]
fn invalid_samples_are_refused() {
    let nominal = Scheme::drr(9, false).expect("a scheme");
    let free = Parameter::all(&nominal);
    assert_eq!(calibrate(&[], &free), Err(CalibrationError::NoSample));
    let good = sample("air", AIR, &nominal, &nominal, 1e-3, 0);
    let mut dark = good.clone();
    dark.intensities.fill(0.0);
    assert!(matches!(calibrate(&[dark], &free), Err(CalibrationError::Dark { .. })));
    let mut short = good.clone();
    short.intensities.pop();
    assert!(matches!(calibrate(&[short], &free), Err(CalibrationError::Lengths { .. })));
    let mut lost = good.clone();
    lost.intensities[3] = f64::NAN;
    assert!(calibrate(&[lost], &free).is_err());
    let few = Scheme::drr(3, false).expect("a scheme");
    let three = sample("air", AIR, &few, &few, 1e-3, 0);
    assert!(matches!(calibrate(&[three], &free), Err(CalibrationError::Fit(FitError::TooFew { .. }))));
}
