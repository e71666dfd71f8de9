//! Tests the camera against closed forms.

use super::super::random::stream;
use super::super::testing::Moments;
use super::*;
use proptest::prelude::*;

const NM: f64 = 550.0;

/// Returns a camera with 650 e⁻ per unit of radiance and 2.6 e⁻/DN.
fn camera() -> Cmos {
    Cmos { photons_per_unit: 1e5, dark_current_e_s: 400.0, ..Cmos::default() }
}

/// Returns the moments of 100 000 readings at one level.
fn readings(camera: &Cmos, radiance: f64, key: u32) -> Moments {
    let mut stream = stream(3, 0, key);
    Moments::of((0..100_000).map(|_| f64::from(camera.sample(radiance, NM, 1.0, &mut stream).dn)))
}

/// Verifies that readings have the expected mean and variance, for 0 to 9100 of 10 700 e⁻ and for two gains.
/// The fourth cumulant κ₄ of the readings equals that of a Poisson distribution.
#[test]
fn readings_have_the_expected_mean_and_variance() {
    for gain in [None, Some(1.3)] {
        let camera =
            Cmos { gain_e_per_dn: gain, bit_depth: if gain.is_some() { 16 } else { 12 }, ..camera() };
        for (key, radiance) in [0.0, 0.1, 1.0, 5.0, 14.0].into_iter().enumerate() {
            let seen = readings(&camera, radiance, key as u32);
            let (mean, variance) = camera.expected(radiance, NM, 1.0);
            seen.assert_mean(mean, variance);
            let electrons = (mean - camera.black_level_dn) * camera.gain();
            seen.assert_variance(variance, electrons / camera.gain().powi(4));
        }
    }
}

/// Verifies that the slope of variance over mean (photon transfer) is 1/K. The test fits the slope by least
/// squares over 8 levels of 100 000 readings. The relative error of each variance is √(2/n). The errors of
/// the variances determine the error of the slope.
#[test]
fn photon_transfer_has_the_gain_as_slope() {
    let camera = camera();
    let levels: Vec<_> = (1..=8).map(|k| readings(&camera, 1.5 * f64::from(k), 100 + k)).collect();
    let centre = levels.iter().map(|m| m.mean).sum::<f64>() / 8.0;
    let spread: f64 = levels.iter().map(|m| (m.mean - centre).powi(2)).sum();
    let slope: f64 = levels.iter().map(|m| (m.mean - centre) * m.variance).sum::<f64>() / spread;
    let error: f64 = levels.iter().map(|m| ((m.mean - centre) * m.variance).powi(2) * 2.0 / m.n).sum::<f64>()
        / spread.powi(2);
    let off = (slope - 1.0 / camera.gain()) / error.sqrt();
    assert!(off.abs() < 5.0, "{slope}: {off} sigma");
}

#[test]
fn without_shot_noise_only_read_noise_remains() {
    let camera = Cmos { shot_noise: false, read_noise_e: 6.0, ..camera() };
    let seen = readings(&camera, 8.0, 200);
    let (mean, variance) = camera.expected(8.0, NM, 1.0);
    assert!((variance - camera.read_out() / camera.gain().powi(2)).abs() < 1e-12);
    seen.assert_mean(mean, variance);
    seen.assert_variance(variance, 0.0);
}

/// Verifies that estimates are unbiased, and that the mean of the stated variances is the true variance. The
/// estimate and its variance are linear in the reading above the dark level. The test uses 100 000 readings.
/// The scatter of the stated variance is due to shot noise.
#[test]
fn estimates_are_unbiased_with_their_stated_variance() {
    let camera = camera();
    let radiance = 3.0;
    let mut stream = stream(4, 0, 0);
    let all: Vec<_> = (0..100_000)
        .map(|_| camera.estimate(camera.sample(radiance, NM, 1.0, &mut stream).dn, NM, 1.0))
        .collect();
    let (_, variance) = camera.expected(radiance, NM, 1.0);
    let (per_unit, _) = camera.electrons(NM, 1.0);
    let scale = camera.gain() / per_unit;
    let want = variance * scale.powi(2);
    let seen = Moments::of(all.iter().map(|e| e.radiance));
    seen.assert_mean(radiance, want);
    seen.assert_variance(want, radiance * per_unit / per_unit.powi(4));
    Moments::of(all.iter().map(|e| e.variance)).assert_mean(want, want / per_unit.powi(2));
}

#[test]
fn too_much_light_saturates() {
    let mut stream = stream(5, 0, 0);
    let clipped_by_the_well = Cmos { gain_e_per_dn: Some(5.0), ..camera() };
    for camera in [camera(), clipped_by_the_well] {
        for radiance in [30.0, 1e6, 1e300, f64::INFINITY] {
            for _ in 0..1000 {
                let reading = camera.sample(radiance, NM, 1.0, &mut stream);
                assert!(reading.saturated, "{reading:?}");
                assert!(camera.estimate(reading.dn, NM, 1.0).radiance.is_nan());
            }
        }
        assert!(!camera.sample(10.0, NM, 1.0, &mut stream).saturated);
        let out = camera.capture(&[1e6, 1.0], 2, 1, NM, 0, 0).expect("is taken");
        assert_eq!(out.saturated, [true, false]);
        assert!(out.radiance[0].is_nan() && out.variance[0].is_infinite());
    }
}

/// Verifies that estimates from exposure brackets are unbiased at low light (read noise), at high light (shot
/// noise), and with saturated long exposures. The test uses 40 000 captures for each level.
#[test]
fn bracketing_is_unbiased_with_its_stated_variance() {
    let camera = Cmos { bracket: vec![0.125, 1.0, 8.0], read_noise_e: 5.0, ..camera() };
    for (key, radiance) in [0.0, 0.02, 0.3, 5.0, 60.0].into_iter().enumerate() {
        let n = 40_000;
        let out = camera.capture(&vec![radiance; n], 200, 200, NM, 6, key as u32).expect("is taken");
        assert!(out.saturated.iter().all(|s| !s));
        let single = |factor: f64| {
            let (per_unit, dark) = camera.electrons(NM, factor);
            let electrons = per_unit * radiance + dark;
            (electrons < 0.9 * camera.full_well_e).then(|| per_unit.powi(2) / (electrons + camera.read_out()))
        };
        let want = 1.0 / camera.bracket.iter().filter_map(|f| single(*f)).sum::<f64>();
        let seen = Moments::of(out.radiance.iter().copied());
        seen.assert_mean(radiance, want);
        // κ₄ ≤ σ⁴ holds because each exposure has at least one electron.
        seen.assert_variance(want, want * want);
        // The lower bound 0 of the pooled radiance makes the variances of dark pixels slightly too high.
        let floor = if radiance < 0.1 { 0.1 } else { 0.01 };
        let stated = Moments::of(out.variance.iter().copied()).mean / want;
        assert!((0.99..1.0 + floor).contains(&stated), "{stated} at {radiance}");
    }
}

/// Verifies that weights from the variances of the single readings cause a bias of more than a tenth of a
/// standard deviation.
#[test]
fn weights_by_measured_variances_would_be_biased() {
    let camera = Cmos { bracket: vec![1.0; 4], ..camera() };
    let (radiance, n) = (0.05, 20_000);
    let mut stream = stream(7, 0, 0);
    let (mut ours, mut naive) = (Vec::new(), Vec::new());
    for _ in 0..n {
        let one = |_| camera.estimate(camera.sample(radiance, NM, 1.0, &mut stream).dn, NM, 1.0);
        let all: Vec<_> = (0..4).map(one).collect();
        ours.push(camera.combine(&all, NM).radiance);
        let weights: f64 = all.iter().map(|e| 1.0 / e.variance).sum();
        naive.push(all.iter().map(|e| e.radiance / e.variance).sum::<f64>() / weights);
    }
    let (ours, naive) = (Moments::of(ours.into_iter()), Moments::of(naive.into_iter()));
    ours.assert_mean(radiance, ours.variance);
    assert!(naive.mean < radiance - 0.1 * naive.variance.sqrt(), "{}", naive.mean);
}

#[test]
fn combining_ignores_saturated_estimates() {
    let camera = Cmos { bracket: vec![1.0, 4.0], ..camera() };
    let known = camera.estimate(400, NM, 1.0);
    let both = camera.combine(&[known, Estimate::SATURATED], NM);
    assert!((both.radiance - known.radiance).abs() < 1e-12);
    assert!((both.variance / known.variance - 1.0).abs() < 1e-12);
    assert!(camera.combine(&[Estimate::SATURATED; 2], NM).saturated);
    assert!(camera.combine(&[], NM).radiance.is_nan());
}

/// Verifies that binning of 2×2 pixels divides the variance by four and drops odd last rows and columns. The
/// test uses 10 000 binned pixels.
#[test]
fn binning_quarters_the_variance() {
    let camera = Cmos { binning: 2, ..camera() };
    let out = camera.capture(&vec![2.0; 201 * 201], 201, 201, NM, 8, 0).expect("is taken");
    assert_eq!((out.width, out.height, out.radiance.len()), (100, 100, 10_000));
    let (_, variance) = camera.expected(2.0, NM, 1.0);
    let want = variance * (camera.gain() / camera.electrons(NM, 1.0).0).powi(2) / 4.0;
    let seen = Moments::of(out.radiance.iter().copied());
    seen.assert_mean(2.0, want);
    seen.assert_variance(want, 0.0);
    assert!((Moments::of(out.variance.iter().copied()).mean / want - 1.0).abs() < 0.01);
}

#[test]
fn binning_averages_neighbours() {
    let camera = Cmos { binning: 2, shot_noise: false, read_noise_e: 0.0, ..camera() };
    let image = [1.0, 3.0, 7.0, 5.0, 7.0, 7.0];
    let out = camera.capture(&image, 3, 2, NM, 0, 0).expect("is taken");
    assert_eq!((out.width, out.height), (1, 1));
    assert!((out.radiance[0] - 4.0).abs() < 0.5 * camera.gain() / camera.electrons(NM, 1.0).0);
}

/// Verifies that, without noise, the error of an estimate is at most half a DN.
#[test]
fn without_noise_half_a_dn_is_the_bound() {
    let camera = Cmos { shot_noise: false, read_noise_e: 0.0, ..camera() };
    let bound = 0.5 * camera.gain() / camera.electrons(NM, 1.0).0;
    let image: Vec<_> = (0..1500).map(|k| f64::from(k) * 0.01).collect();
    let out = camera.capture(&image, 1500, 1, NM, 0, 0).expect("is taken");
    for (got, want) in out.radiance.iter().zip(&image) {
        assert!((got - want).abs() <= bound * (1.0 + 1e-9), "{got} for {want}");
    }
}

#[test]
fn captures_differ_by_key_and_repeat_by_seed() {
    let image = [1.0; 100];
    let take = |seed, key| camera().capture(&image, 10, 10, NM, seed, key).expect("is taken").radiance;
    assert_eq!(take(1, 1), take(1, 1));
    assert_ne!(take(1, 1), take(1, 2));
    assert_ne!(take(1, 1), take(2, 1));
}

#[test]
fn settings_read_from_toml_and_are_checked_by_name() {
    let camera: Cmos =
        toml::from_str("exposure_s = 0.5\nquantum_efficiency = [[500, 0.5], [600, 0.6]]").expect("reads");
    assert_eq!(camera.exposure_s, 0.5);
    assert_eq!(camera.check(), Ok(()));
    assert!(toml::from_str::<Cmos>("exposure = 0.5").is_err());
    let text = toml::to_string(&camera).expect("writes");
    assert_eq!(toml::from_str::<Cmos>(&text).expect("reads"), camera);
    let bad = |text: &str| {
        let camera: Cmos = toml::from_str(text).expect("reads");
        camera.check().expect_err("is bad").to_string()
    };
    for field in
        ["exposure_s", "photons_per_unit", "read_noise_e", "dark_current_e_s", "full_well_e", "gain_e_per_dn"]
    {
        for value in ["-1.0", "nan", "inf"] {
            let error = bad(&format!("{field} = {value}"));
            assert!(error.starts_with(&format!("`{field}`")), "{error}");
        }
    }
    for text in [
        "bracket = []",
        "bracket = [0.0]",
        "bit_depth = 0",
        "bit_depth = 25",
        "binning = 3",
        "black_level_dn = 4095",
    ] {
        assert!(bad(text).starts_with(&format!("`{}`", text.split(' ').next().expect("has a name"))));
    }
}

#[test]
fn images_of_another_size_are_refused() {
    let take = |image: &[f64], [w, h]: [usize; 2]| camera().capture(image, w, h, NM, 0, 0);
    assert!(matches!(take(&[1.0; 5], [2, 2]), Err(DetectorError::Count { .. })));
    assert!(matches!(take(&[1.0; 4], [usize::MAX, 2]), Err(DetectorError::Count { .. })));
    assert!(matches!(take(&[1.0, f64::NAN], [2, 1]), Err(DetectorError::Radiance { index: 1, .. })));
    assert!(take(&[], [0, 0]).expect("is taken").radiance.is_empty());
}

/// Generates valid and invalid values of a setting.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => 1e-3..1e4,
        1 => proptest::num::f64::ANY,
        1 => prop_oneof![Just(0.0), Just(f64::NAN), Just(f64::INFINITY), Just(-1.0), Just(f64::MAX)],
    ]
}

proptest! {
    #[test]
    fn arbitrary_settings_never_panic(
        v in prop::array::uniform9(number()),
        bracket in prop::collection::vec(number(), 0..4),
        curve in prop::collection::vec(prop::array::uniform2(number()), 0..4),
        gain in prop::option::of(number()),
        (bit_depth, binning, shot_noise) in (0_u32..40, 0_u32..4, any::<bool>()),
        dn in any::<u32>(),
    ) {
        let camera = Cmos {
            exposure_s: v[0], bracket, quantum_efficiency: SpectralValue::Table(curve), photons_per_unit: v[1],
            read_noise_e: v[2], dark_current_e_s: v[3], full_well_e: v[4], bit_depth, gain_e_per_dn: gain,
            black_level_dn: v[5], binning, shot_noise,
        };
        let good = camera.check().is_ok();
        let mut stream = stream(0, 0, 0);
        let _ = camera.expected(v[6], v[7], v[8]);
        let reading = camera.sample(v[6], v[7], v[8], &mut stream);
        let estimates = [camera.estimate(dn, v[7], v[8]), camera.estimate(reading.dn, v[7], v[8])];
        let _ = camera.combine(&estimates, v[7]);
        let taken = camera.capture(&[v[6]; 4], 2, 2, v[7], 0, 0);
        prop_assert_eq!(taken.is_ok(), good && v[6].is_finite());
    }
}
