//! Tests of slices that are captured by rigs with known elements and noise.

use super::exposure::{Exposure, Laboratory, Meter};
use super::few::{Choice, Expected, Task, chosen, objective};
use super::light::Light;
use super::optics::{Optics, Tolerances, with_elements};
use super::readings::Readings;
use crate::observation::{Observation, Slice, tests::slice};
use polarimetry::capture::detector::cmos::Cmos;
use polarimetry::capture::detector::spad::Spad;
use polarimetry::capture::element::ElementKind;
use polarimetry::capture::scheme::{Scheme, Side};
use polarimetry::capture::simulate::Noise;
use polarimetry::capture::spectral_value::SpectralValue;
use tensor::array::Tensor;
use tensor::axes::AxisKind;

/// Returns a slice of asymmetric matrices at three wavelengths. The brightness increases along rows. If there
/// are several bins, the bins have picosecond widths.
fn some(size: [usize; 4]) -> Slice {
    let mut s = slice(size, 0.0, |p, b, e, k| {
        let bright = 1.0 + 0.1 * (p % 4) as f64 + 0.2 * b as f64 + 0.1 * k as f64;
        let share = if e == 0 { 1.0 } else { 0.25 * (1.7 * e as f64 + 0.3 * p as f64).sin() };
        bright * share
    });
    for tensor in [&mut s.mean, &mut s.error] {
        for axis in &mut tensor.axes {
            match axis.kind {
                AxisKind::Wavelength => axis.coords.iter_mut().for_each(|c| *c = 450.0 + 100.0 * *c),
                AxisKind::T => axis.coords.iter_mut().for_each(|c| *c = 1000.0 + 120.0 * *c),
                _ => {}
            }
        }
    }
    s
}

fn laboratory(tolerances: Tolerances, electrons: Option<f64>) -> Laboratory {
    Laboratory {
        optics: Optics::Drawn(tolerances),
        camera: electrons.map(|_| Cmos::default()),
        counter: electrons.map(|_| Spad { irf_fwhm_ps: 1e-3, irf_tail: 0.0, ..Spad::default() }),
        exposure: Exposure {
            meter: Meter::Mean,
            electrons: electrons.unwrap_or(3000.0),
            counts: electrons.unwrap_or(3000.0),
            ..Exposure::default()
        },
    }
}

/// Captures a slice with the exposure of `photograph` and reconstructs it.
fn through(
    s: &Slice,
    photograph: &Slice,
    lab: &Laboratory,
    [real, believed]: [&Scheme; 2],
    seed: u64,
) -> Slice {
    let light = Light::of(photograph).expect("light");
    let detectors = lab.exposed(&[&light], real).expect("an exposure");
    let readings = Readings::of(s, real, &detectors, seed).expect("captures");
    readings.reconstructed(believed, None).expect("rank 16").0
}

fn off(a: &Tensor, b: &Tensor) -> f64 {
    let pairs = a.data.iter().zip(&b.data);
    pairs.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
}

fn intensities(s: &Slice) -> Slice {
    let only = |t: &Tensor| t.select(AxisKind::StokesOut, 0).select(AxisKind::StokesIn, 0);
    Slice { mean: only(&s.mean), error: only(&s.error) }
}

#[test]
fn perfect_rigs_return_the_slice() {
    let real = Scheme::drr(36, false).expect("a scheme");
    let array = Scheme::quad(12, true).expect("a scheme");
    let lab = laboratory(Tolerances::default(), None);
    for size in [[5, 3, 1, 3], [4, 2, 6, 2]] {
        let s = some(size);
        for scheme in [&real, &array] {
            let found = through(&s, &s, &lab, [scheme, scheme], 1);
            assert!(off(&found.mean, &s.mean) < 2e-5, "{}", off(&found.mean, &s.mean));
            assert_eq!(found.error, s.error);
        }
        let plain = intensities(&s);
        let found = through(&plain, &s, &lab, [&real, &real], 1);
        assert!(off(&found.mean, &plain.mean) < 1e-6);
    }
}

/// Optical errors that are known exactly are compensated. Reconstruction with nominal optics does not
/// compensate optical errors. Retardance of the wrong sign (a retarder with exchanged axes) reverses the
/// handedness. The resulting error of the matrices is much larger than the tolerance for known optics.
#[test]
fn only_known_optical_errors_are_compensated() {
    let nominal = Scheme::quad(24, false).expect("a scheme");
    let tolerances = Tolerances { axis_error_deg: 1.0, retardance_error_deg: 3.0, extinction: 1e-3 };
    let lab = laboratory(tolerances, None);
    let s = some([5, 3, 1, 3]);
    let real = lab.optics.of(&nominal, 5);
    assert_ne!(real, lab.optics.of(&nominal, 6));
    let found = through(&s, &s, &lab, [&real, &real], 1);
    assert!(off(&found.mean, &s.mean) < 5e-5);
    let found = through(&s, &s, &lab, [&real, &nominal], 1);
    assert!(off(&found.mean, &s.mean) > 1e-2);
    for side in [Side::Generator, Side::Analyzer] {
        let mut wrong = nominal.clone();
        wrong.imperfect(side, usize::from(side == Side::Generator), |e| {
            if let ElementKind::Retarder { error, .. } = &mut e.kind {
                *error = SpectralValue::Same(-std::f64::consts::PI);
            }
        });
        let found = through(&s, &s, &lab, [&nominal, &wrong], 1);
        assert!(off(&found.mean, &s.mean) > 0.2, "{side:?}");
        // Imperfections of elements, but not settings, are copied from one scheme to another.
        let few = Scheme::drr(7, false).expect("a scheme");
        let moved = with_elements(&few, &wrong);
        assert_eq!((moved.captures(), moved.parameters()), (7, few.parameters()));
        assert_eq!(with_elements(&wrong, &nominal), nominal);
    }
}

/// A polarizer with leakage ε transmits ½(1 + ε, (1 - ε)u) of unpolarized light, instead of ½(1, u). The
/// reconstructed matrices are therefore D T D with D = diag(1 + ε, 1 - ε, 1 - ε, 1 - ε).
#[test]
fn leaking_polarizers_bias_in_closed_form() {
    let epsilon = 0.05;
    let nominal = Scheme::quad(40, false).expect("a scheme");
    let tolerances = Tolerances { extinction: epsilon, ..Tolerances::default() };
    let lab = laboratory(tolerances, None);
    let real = lab.optics.of(&nominal, 1);
    let mut depolarizer = some([2, 2, 1, 1]);
    for (i, v) in depolarizer.mean.data.iter_mut().enumerate() {
        *v = if i % 16 == 0 { 1.0 } else { 0.0 };
    }
    let found = through(&depolarizer, &depolarizer, &lab, [&real, &nominal], 1);
    for (i, v) in found.mean.data.iter().enumerate() {
        let want = if i % 16 == 0 { (1.0 + epsilon).powi(2) } else { 0.0 };
        assert!((f64::from(*v) - want).abs() < 1e-5, "{i}: found {v}, expected {want}");
    }
    // The polarized part of diag(1, a, a, a) is measured through the diattenuations of two polarizers.
    let a = 0.6;
    let mut diagonal = depolarizer;
    for (i, v) in diagonal.mean.data.iter_mut().enumerate() {
        *v = [1.0, a, a, a][i % 16 / 5] as f32 * f32::from(u8::from(i % 16 % 5 == 0));
    }
    let found = through(&diagonal, &diagonal, &lab, [&real, &nominal], 1);
    for (i, v) in found.mean.data.iter().enumerate() {
        let want = match i % 16 {
            0 => (1.0 + epsilon).powi(2),
            5 | 10 | 15 => a * (1.0 - epsilon).powi(2),
            _ => 0.0,
        };
        assert!((f64::from(*v) - want).abs() < 1e-5, "{i}: found {v}, expected {want}");
    }
}

/// Compares the scatter over 150 seeds with the estimated errors. χ²/n is 1 within 5 standard errors, which
/// are computed from the spread of the squares over seeds. The limit for every bias is the sum of 5 standard
/// errors of the bias and a tenth of a standard error of the data. The test covers:
/// - a camera,
/// - a polarizer array,
/// - a counter,
/// - intensities of camera and counter.
///
/// The counter receives equal light in all bins, because the variances are averaged over neighbouring bins,
/// as in a rig's scans. The rate is far below one photon per pulse, because the variances neglect pile-up.
#[test]
#[ignore = "slow: tools/check --all"]
fn stated_errors_match_the_scatter() {
    let tolerances = Tolerances { axis_error_deg: 0.5, retardance_error_deg: 2.0, extinction: 1e-3 };
    let mut lab = laboratory(tolerances, Some(2000.0));
    lab.exposure.counts_per_pulse = 2e-4;
    let photograph = some([4, 3, 1, 2]);
    let mut timed = some([4, 3, 4, 2]);
    let (bin, all) = (16 * 2, 4 * 16 * 2);
    for i in 0..timed.mean.data.len() {
        timed.mean.data[i] = timed.mean.data[i / all * all + i % bin];
    }
    let drr = lab.optics.of(&Scheme::drr(36, false).expect("a scheme"), 3);
    let array = lab.optics.of(&Scheme::quad(10, true).expect("a scheme"), 3);
    for (name, s, real) in [
        ("camera", photograph.clone(), &drr),
        ("array", photograph.clone(), &array),
        ("counter", timed.clone(), &drr),
        ("photograph", intensities(&photograph), &drr),
        ("counts", intensities(&timed), &drr),
    ] {
        let seeds = 150;
        let (mut sum, mut squares) = (0.0, 0.0);
        let mut bias = vec![0.0; s.mean.data.len()];
        for seed in 0..seeds {
            let found = through(&s, &photograph, &lab, [real, real], 1000 + seed);
            let z =
                |i: usize| f64::from(found.mean.data[i] - s.mean.data[i]) / f64::from(found.error.data[i]);
            let chi2 = (0..bias.len()).map(|i| z(i).powi(2)).sum::<f64>() / bias.len() as f64;
            bias.iter_mut().enumerate().for_each(|(i, b)| *b += z(i) / seeds as f64);
            sum += chi2;
            squares += chi2 * chi2;
        }
        let n = seeds as f64;
        let mean = sum / n;
        let error = ((squares / n - mean * mean) / (n - 1.0)).sqrt();
        println!("{name}: χ²/n = {mean:.4} ± {error:.4}");
        assert!((mean - 1.0).abs() < 5.0 * error, "{name}: {mean} ± {error}");
        let worst = bias.iter().fold(0.0, |m: f64, b| m.max(b.abs()));
        assert!(worst < 5.0 / n.sqrt() + 0.1, "{name}: bias of {worst}");
    }
}

#[test]
fn captures_depend_on_the_seed_and_not_on_threads() {
    let lab = laboratory(Tolerances::default(), Some(500.0));
    let real = Scheme::drr(20, false).expect("a scheme");
    let (s, timed) = (some([9, 7, 1, 3]), some([5, 3, 4, 2]));
    let all = || {
        [&s, &timed].map(|x| {
            let found = through(x, &s, &lab, [&real, &real], 7);
            (found.mean.data, found.error.data)
        })
    };
    let with = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build();
        pool.expect("threads").install(all)
    };
    let first = with(1);
    assert_eq!(first, with(3));
    assert_ne!(first[0], {
        let found = through(&s, &s, &lab, [&real, &real], 8);
        (found.mean.data, found.error.data)
    });
}

/// Highlights far above the full well are reconstructed from unsaturated readings, or are clipped. No value
/// is lost.
#[test]
fn highlights_are_clipped_and_counted() {
    let lab = laboratory(Tolerances::default(), Some(3000.0));
    let real = Scheme::drr(36, false).expect("a scheme");
    let photograph = some([5, 3, 1, 3]);
    let mut s = photograph.clone();
    for (i, v) in s.mean.data.iter_mut().enumerate() {
        *v *= if i < 48 { 100.0 } else { 1.0 };
    }
    let light = Light::of(&photograph).expect("light");
    let detectors = lab.exposed(&[&light], &real).expect("an exposure");
    let readings = Readings::of(&s, &real, &detectors, 1).expect("captures");
    let (found, count) = readings.reconstructed(&real, None).expect("rank 16");
    assert_eq!((count.pixels, count.clipped), (45, 3));
    assert!(found.mean.data.iter().all(|v| v.is_finite()));
    assert!(found.mean.data[0] < s.mean.data[0]);
}

/// Captures can be optimized for one functional or for all elements. Each optimized set of captures has the
/// smaller error in the quantity for which the set is optimized.
#[test]
fn captures_are_optimized_for_the_functional() {
    let mut o = Observation::default();
    o.slices.insert("epipolar".into(), some([8, 6, 1, 1]));
    let expected = Expected::of(&[o], "epipolar").expect("a moment");
    assert!((expected.moment[(0, 0)] - 1.0).abs() < 1e-12 && expected.nm == [450.0]);
    let task = Task {
        slice: "epipolar",
        method: "it",
        baselines: vec![],
        functionals: vec![std::array::from_fn(|e| f64::from(u8::from(e == 10)))],
    };
    let sigma = 5e-3;
    let loss = |by: Choice, chosen_by: Choice| {
        let scheme = chosen(chosen_by, 2, &task, &expected, sigma, 1).expect("a scheme");
        assert_eq!(scheme.captures(), 2);
        objective(by, &task, &expected, sigma).loss(&scheme)
    };
    for (by, other) in [(Choice::Task, Choice::All), (Choice::All, Choice::Task)] {
        for worse in [other, Choice::Dual] {
            assert!(loss(by, by) <= loss(by, worse) * (1.0 + 1e-9), "{by:?} {worse:?}");
        }
    }
}

/// The photograph is the sum over time bins of a time-resolved slice if no other slice is suitable.
#[test]
fn the_sum_over_time_bins_replaces_a_missing_photograph() {
    let lab = laboratory(Tolerances::default(), Some(500.0));
    let real = Scheme::drr(36, false).expect("a scheme");
    let timed = some([4, 3, 5, 2]);
    let summed = Slice { mean: timed.mean.sum(AxisKind::T), error: timed.error.sum(AxisKind::T) };
    let [timed, summed] = [&timed, &summed].map(|s| Light::of(s).expect("light"));
    let exposed = |lights: &[&Light]| -> [f64; 2] {
        let detectors = lab.exposed(lights, &real).expect("an exposure");
        let of = |light| match detectors.noise(light).expect("noise") {
            Noise::Spad(diode) => diode.photons_per_unit,
            Noise::Cmos { camera, .. } => camera.photons_per_unit,
            Noise::None | Noise::Gaussian { .. } => f64::NAN,
        };
        [of(&timed), of(&summed)]
    };
    let near = |[a, b]: [f64; 2], [c, d]: [f64; 2]| (a / c - 1.0).abs() < 1e-6 && (b / d - 1.0).abs() < 1e-6;
    assert!(near(exposed(&[&timed]), exposed(&[&summed])));
    let mut dim = summed.clone();
    dim.image.matrices.iter_mut().for_each(|m| *m *= 0.25);
    let four = exposed(&[&summed]).map(|v| 4.0 * v);
    assert!(near(exposed(&[&timed, &dim]), four));
}

#[test]
fn dark_and_partial_slices_are_refused() {
    let s = some([4, 3, 1, 2]);
    let part =
        Slice { mean: s.mean.select(AxisKind::StokesIn, 0), error: s.error.select(AxisKind::StokesIn, 0) };
    assert!(Light::of(&part).expect_err("a part").to_string().contains("only some of the Stokes"));
    let lab = laboratory(Tolerances::default(), Some(100.0));
    let mut dark = s.clone();
    dark.mean.data.fill(0.0);
    let light = Light::of(&dark).expect("light");
    let real = Scheme::drr(36, false).expect("a scheme");
    let message = lab.exposed(&[&light], &real).expect_err("no light").to_string();
    assert!(message.contains("no exposure"), "{message}");
}
