//! Tests with simulated cameras of known imperfections. Fitted values are compared with true values, and
//! actual errors with stated errors.

use super::super::z_scores::{ZScores, repeats};
use super::RadiometricError;
use super::apply::{Options, Radiometry, calibrate};
use super::stack::Stack;
use optics::sampling::stream::Stream;
use polarimetry::capture::detector::cmos::Cmos;
use polarimetry::capture::detector::random::stream;
use polarimetry::capture::spectral_value::SpectralValue;
use proptest::prelude::*;
use rand_distr::{Distribution, Poisson, StandardNormal};
use rayon::prelude::*;

const TOP: u32 = 4095;
const PIXELS: usize = 400;
const PRNU: f64 = 0.01;

/// A camera with all imperfections that the calibration estimates.
struct Camera {
    gain: f64,
    read_e: f64,
    full_e: f64,
    /// Coefficients c₁ and c₂ of the nonlinearity. y (1 + c₁ u + c₂ u²) is linear in the light, with u =
    /// y/(`full_e`/gain).
    bend: [f64; 2],
    /// Electrons per unit of light.
    efficiency: f64,
    offset_dn: Vec<f64>,
    dark_e_s: Vec<f64>,
    response: Vec<f64>,
}

fn normal(random: &mut Stream) -> f64 {
    StandardNormal.sample(random)
}

impl Camera {
    fn new(key: u32) -> Self {
        let mut random = stream(31, 0, key);
        let gain = 2.6 * (1.0 + 0.1 * normal(&mut random));
        let mut each = |mean: f64, sigma: f64| -> Vec<f64> {
            (0..PIXELS).map(|_| (mean + sigma * normal(&mut random)).max(0.0)).collect()
        };
        let (offset_dn, dark_e_s, response) = (each(64.0, 1.5), each(60.0, 10.0), each(1.0, PRNU));
        let mean = response.iter().sum::<f64>() / PIXELS as f64;
        Self {
            gain,
            read_e: 2.4 * (1.0 + 0.1 * normal(&mut random)),
            full_e: 9_000.0 * gain / 2.6,
            bend: [0.02 * normal(&mut random), 0.02 * normal(&mut random)],
            efficiency: 1e5,
            offset_dn,
            dark_e_s,
            response: response.iter().map(|r| r / mean).collect(),
        }
    }

    fn scale_dn(&self) -> f64 {
        self.full_e / self.gain
    }

    fn frame(&self, light: f64, exposure_s: f64, random: &mut Stream) -> Vec<u32> {
        let pixel = |p: usize| {
            let mean =
                self.response[p] * self.efficiency * light * exposure_s + self.dark_e_s[p] * exposure_s;
            let made: f64 = Poisson::new(mean).map_or(0.0, |d| d.sample(random));
            let read = made.min(self.full_e) + self.read_e * normal(random);
            let linear = read / self.gain;
            let mut y = linear;
            for _ in 0..4 {
                let u = y / self.scale_dn();
                let value = y * (1.0 + self.bend[0] * u + self.bend[1] * u * u) - linear;
                y -= value / (1.0 + 2.0 * self.bend[0] * u + 3.0 * self.bend[1] * u * u);
            }
            (y + self.offset_dn[p]).round().clamp(0.0, f64::from(TOP)) as u32
        };
        (0..PIXELS).map(pixel).collect()
    }

    fn stack(&self, light: f64, exposure_s: f64, frames: u32, random: &mut Stream) -> Stack {
        let mut stack = Stack::new(PIXELS, exposure_s, light, TOP).expect("a stack");
        for _ in 0..frames {
            stack.add(&self.frame(light, exposure_s, random)).expect("a frame");
        }
        stack
    }

    /// Returns dark frames at two exposures, and lit frames from low levels to beyond the full well.
    fn captures(&self, random: &mut Stream) -> (Vec<Stack>, Vec<Stack>) {
        let dark = [0.01, 1.0].map(|t| self.stack(0.0, t, 32, random)).to_vec();
        let full = self.full_e / self.efficiency / 0.01;
        let part = [0.01, 0.03, 0.06, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.2];
        let light = part.iter().map(|f| self.stack(f * full, 0.01, 16, random)).collect();
        (dark, light)
    }
}

/// Over repetitions with different true values and 400 pixels, all errors agree with the stated standard
/// errors.
#[test]
fn stated_errors_match_actual_errors() {
    let one = |repeat: u32| {
        let camera = Camera::new(repeat);
        let (dark, light) = camera.captures(&mut stream(32, 0, repeat));
        let found = calibrate(&dark, &light, &Options::default()).expect("a calibration");
        (camera, found)
    };
    let all: Vec<(Camera, Radiometry)> = (0..repeats(64)).into_par_iter().map(one).collect();
    let mut scores = ZScores::default();
    let (mut chi, mut freedom) = ([0.0; 2], [0.0; 2]);
    for (camera, found) in &all {
        assert!(found.dark.hot.is_empty() && found.dark.noisy.is_empty() && found.dark.stuck.is_empty());
        let t = found.transfer.as_ref().expect("a gain");
        scores.add("gain", t.gain_e_per_dn - camera.gain, t.gain_sigma);
        scores.add("read noise", t.read_noise_e - camera.read_e, t.read_noise_sigma);
        let l = found.linearity.as_ref().expect("a curve");
        for (j, want) in camera.bend.iter().enumerate() {
            let over = (camera.scale_dn() / l.scale_dn).powi(j as i32 + 1);
            let name = format!("linearity, coefficient {}", j + 1);
            scores.add(&name, l.coefficients[j] * over - want, l.sigma[j] * over);
        }
        scores.add("response to light", l.response - camera.efficiency / camera.gain, l.response_sigma);
        scores.add("stray light", l.stray_dn, l.stray_sigma);
        let (d, f) = (&found.dark, found.flat.as_ref().expect("a flat field"));
        let rate = d.rate.as_ref().expect("two exposures");
        let rate_sigma = d.rate_sigma.as_ref().expect("so");
        // All pixels of a camera share the errors of the linearity curve and the gain, so their errors
        // count as one independent value.
        let pixels = |errors: &dyn Fn(usize) -> (f64, f64)| (0..PIXELS).map(errors).collect::<Vec<_>>();
        let offset = |p: usize| (d.offset.at(p) - camera.offset_dn[p], d.offset_sigma.at(p));
        scores.add_together("offset", pixels(&offset));
        let current = |p: usize| (rate.at(p) - camera.dark_e_s[p] / camera.gain, rate_sigma.at(p));
        scores.add_together("dark current", pixels(&current));
        let noise = |p: usize| {
            let dark_e = 0.01 * camera.dark_e_s[p];
            let variance = (camera.read_e.powi(2) + dark_e) / camera.gain.powi(2) + 1.0 / 12.0;
            let sigma = variance / d.variance.at(p) * d.variance_sigma.at(p);
            (d.variance.at(p) - variance, sigma)
        };
        scores.add_together("variance in the dark", pixels(&noise));
        let field = |p: usize| (f.response.at(p) - camera.response[p], f.sigma.at(p));
        scores.add_together("flat field", pixels(&field));
        scores.add("PRNU", f.prnu - PRNU, f.prnu_sigma);
        chi[0] += t.chi_squared;
        chi[1] += l.chi_squared;
        freedom[0] += t.freedom as f64;
        freedom[1] += l.freedom as f64;
        let full = t.full_well_e.expect("it saturates");
        assert!((0.85..1.05).contains(&(full / camera.full_e)), "{full} of {}", camera.full_e);
    }
    scores.hold("camera");
    for k in 0..2 {
        let ratio = chi[k] / freedom[k];
        println!("chi-squared over freedom {ratio:.3}");
        assert!((ratio - 1.0).abs() < 5.0 * (2.0 / freedom[k]).sqrt(), "{k}: {ratio}");
    }
}

/// The calibration recovers every parameter of an independently simulated camera within five standard errors.
#[test]
fn settings_of_a_simulated_camera_are_recovered() {
    let cmos = Cmos {
        quantum_efficiency: SpectralValue::Same(0.5),
        photons_per_unit: 1e6,
        dark_current_e_s: 200.0,
        ..Cmos::default()
    };
    let pixels = 1000;
    let mut key = 0;
    let mut stack = |radiance: f64, factor: f64| {
        let mut out = Stack::new(pixels, 0.01 * factor, radiance, TOP).expect("a stack");
        for _ in 0..20 {
            key += 1;
            let image = vec![radiance; pixels];
            let frame = cmos.frame(&image, 0..pixels as u32, 550.0, factor, 9, key).expect("a frame");
            out.add(&frame).expect("a frame");
        }
        out
    };
    let dark = [1.0, 50.0].map(|f| stack(0.0, f));
    let light = [0.02, 0.1, 0.3, 0.6, 1.0, 1.3, 1.6, 1.9, 2.5].map(|l| stack(l, 1.0));
    let found = calibrate(&dark, &light, &Options::default()).expect("a calibration");
    let near = |value: f64, want: f64, sigma: f64| {
        assert!((value - want).abs() < 5.0 * sigma, "found {value}, expected {want} ± {sigma}");
    };
    let gain = cmos.full_well_e / 4095.0;
    let t = found.transfer.expect("a gain");
    near(t.gain_e_per_dn, gain, t.gain_sigma);
    near(t.read_noise_e, 2.4, t.read_noise_sigma);
    assert!(t.gain_sigma < 0.01 * gain && t.read_noise_sigma < 0.03, "{t:?}");
    let l = found.linearity.expect("a curve");
    for (c, sigma) in l.coefficients.iter().zip(&l.sigma) {
        near(*c, 0.0, *sigma);
    }
    assert!(l.linearity_error < 1e-3, "{}", l.linearity_error);
    let mean = |m: &crate::pixel_map::PixelMap| (0..pixels).map(|p| m.at(p)).sum::<f64>() / pixels as f64;
    let of = |m: &crate::pixel_map::PixelMap| mean(m) / (pixels as f64).sqrt();
    near(mean(&found.dark.offset), 16.0, of(&found.dark.offset_sigma));
    let (rate, sigma) = (found.dark.rate.expect("two"), found.dark.rate_sigma.expect("two"));
    near(mean(&rate), 200.0 / gain, of(&sigma));
    let flat = found.flat.expect("a field");
    near(flat.prnu, 0.0, flat.prnu_sigma);
}

/// After correction, a uniform frame is uniform in electrons and has the stated variance.
#[test]
fn corrected_frames_match_the_light() {
    let camera = Camera::new(1000);
    let mut random = stream(33, 0, 0);
    let (dark, light) = camera.captures(&mut random);
    let found = calibrate(&dark, &light, &Options::default()).expect("a calibration");
    let gain_error = found.transfer.as_ref().map_or(1.0, |t| t.gain_sigma / t.gain_e_per_dn);
    for share in [0.02, 0.3, 0.75] {
        let want = share * camera.full_e;
        let mut scores = ZScores::default();
        let (mut sum, mut count) = (0.0, 0.0);
        for _ in 0..20 {
            let frame = camera.frame(want / camera.efficiency / 0.02, 0.02, &mut random);
            let corrected = found.correct(&frame, 0.02).expect("a frame");
            for (signal, variance) in corrected.signal.iter().zip(&corrected.variance) {
                scores.add("signal", signal - want, variance.sqrt());
                sum += signal;
                count += 1.0;
            }
        }
        scores.hold(&format!("corrected, {share} of full"));
        let (mean, sigma) = (sum / count, (want / count).sqrt() + gain_error * want);
        assert!((mean - want).abs() < 5.0 * sigma, "found {mean}, expected {want} ± {sigma}");
    }
    let over = found.correct(&camera.frame(1e4, 0.02, &mut random), 0.02).expect("a frame");
    assert!(over.signal.iter().all(|v| v.is_nan()) && over.variance.iter().all(|v| v.is_infinite()));
    assert!(matches!(found.correct(&[1, 2], 0.02), Err(RadiometricError::Size { found: 2, .. })));
    assert!(found.correct(&[1; PIXELS], f64::NAN).is_err());
}

/// The calibration lists three hot pixels, a noisy pixel and a stuck pixel, and no other pixels.
#[test]
fn bad_pixels_are_named() {
    let mut camera = Camera::new(101);
    for p in [5, 77, 300] {
        camera.dark_e_s[p] = 2_000.0;
    }
    let mut random = stream(34, 0, 0);
    let mut dark = vec![];
    for t in [0.01, 1.0] {
        let mut stack = Stack::new(PIXELS, t, 0.0, TOP).expect("a stack");
        for k in 0..32 {
            let mut frame = camera.frame(0.0, t, &mut random);
            frame[11] = 64 + 40 * (k % 2);
            frame[12] = 3;
            stack.add(&frame).expect("a frame");
        }
        dark.push(stack);
    }
    let found = calibrate(&dark, &[], &Options::default()).expect("a dark frame");
    assert_eq!((found.dark.hot, found.dark.noisy, found.dark.stuck), (vec![5, 77, 300], vec![11], vec![12]));
}

#[test]
fn undetermined_quantities_are_reported() {
    let camera = Camera::new(102);
    let mut random = stream(35, 0, 0);
    let dark = [camera.stack(0.0, 0.01, 8, &mut random)];
    let options = Options::default();
    let alone = calibrate(&dark, &[], &options).expect("a dark frame");
    let reported = alone.undetermined.join("\n");
    for word in ["dark current", "saturation", "linearity", "gain"] {
        assert!(reported.contains(word), "{word}: {reported}");
    }
    assert!(alone.transfer.is_none() && alone.linearity.is_none() && alone.flat.is_none());
    // Without a gain, the signal is in linear DN.
    let frame = camera.frame(100.0, 0.01, &mut random);
    let corrected = alone.correct(&frame, 0.01).expect("a frame");
    assert!((corrected.signal[3] - (f64::from(frame[3]) - alone.dark.offset.at(3))).abs() < 1e-9);
    // One level determines the gain, but not the curve.
    let one = [camera.stack(40.0 * camera.full_e / camera.efficiency, 0.01, 16, &mut random)];
    let found = calibrate(&dark, &one, &options).expect("a gain");
    assert!(found.transfer.is_some() && found.linearity.is_none() && found.flat.is_some());
    // Unlit frames in place of lit frames.
    let unlit = [camera.stack(1e-9, 0.01, 8, &mut random)];
    assert!(calibrate(&dark, &unlit, &options).expect("a dark frame").transfer.is_none());
    // Frames in which all pixels are saturated.
    let over = [camera.stack(1e4, 0.01, 8, &mut random)];
    let found = calibrate(&dark, &over, &options).expect("a dark frame");
    assert!(found.linearity.is_none() && found.flat.is_none(), "{:?}", found.undetermined);

    assert_eq!(calibrate(&[], &one, &options), Err(RadiometricError::NoDark));
    let few = [camera.stack(0.0, 0.01, 1, &mut random)];
    assert!(matches!(calibrate(&few, &[], &options), Err(RadiometricError::Frames { frames: 1, .. })));
    let mut same = Stack::new(4, 0.01, 0.0, TOP).expect("a stack");
    for _ in 0..5 {
        same.add(&[7; 4]).expect("a frame");
    }
    assert!(matches!(calibrate(&[same.clone()], &[], &options), Err(RadiometricError::Constant { .. })));
    assert!(matches!(calibrate(&dark, &[same.clone()], &options), Err(RadiometricError::Size { .. })));
    assert!(same.add(&[4096; 4]).is_err() && same.add(&[1; 5]).is_err());
    for (exposure, light) in [(f64::NAN, 1.0), (0.0, 1.0), (0.01, f64::INFINITY), (0.01, -1.0)] {
        assert!(Stack::new(4, exposure, light, TOP).is_err());
    }
    let bad = Options { light_sigma: f64::NAN, ..options };
    assert!(matches!(calibrate(&dark, &one, &bad), Err(RadiometricError::Setting { .. })));
}

#[test]
fn calibrations_round_trip_through_files() {
    let camera = Camera::new(103);
    let (dark, light) = camera.captures(&mut stream(36, 0, 0));
    let found = calibrate(&dark, &light, &Options::default()).expect("a calibration");
    let text = toml::to_string(&found).expect("a text");
    assert_eq!(toml::from_str::<Radiometry>(&text).expect("a calibration"), found);
    let alone = calibrate(&dark[..1], &[], &Options::default()).expect("a calibration");
    let text = toml::to_string(&alone).expect("a text");
    assert_eq!(toml::from_str::<Radiometry>(&text).expect("a calibration"), alone);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Arbitrary readings yield a calibration or an error, without a panic.
    #[test]
    fn arbitrary_frames_never_panic(
        stacks in prop::collection::vec(
            (
                prop::collection::vec(prop::collection::vec(0_u32..=TOP, 3), 0..4),
                prop_oneof![Just(0.01), 1e-6..1e6_f64, proptest::num::f64::ANY],
                prop_oneof![1 => Just(0.0), 2 => 0.0..10.0_f64, 1 => proptest::num::f64::ANY],
            ),
            0..8,
        ),
        dark in 0_usize..4,
        degree in 0_usize..10,
    ) {
        let of = |(frames, exposure, light): &(Vec<Vec<u32>>, f64, f64)| -> Option<Stack> {
            let mut out = Stack::new(3, *exposure, *light, TOP).ok()?;
            frames.iter().try_for_each(|f| out.add(f)).ok()?;
            Some(out)
        };
        let stacks: Vec<Stack> = stacks.iter().filter_map(of).collect();
        let (dark, light) = stacks.split_at(dark.min(stacks.len()));
        let options = Options { degree, ..Options::default() };
        if let Ok(found) = calibrate(dark, light, &options) {
            let corrected = found.correct(&[0, 2000, TOP], 0.01).expect("a frame");
            prop_assert_eq!(corrected.signal.len(), 3);
        }
    }
}
