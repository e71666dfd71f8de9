//! Tests the photon counter against closed forms.

use super::super::random::stream;
use super::super::testing::Moments;
use super::*;
use proptest::prelude::*;

const NM: f64 = 640.0;

/// Returns a diode whose period has 80 bins.
fn diode(mode: Mode) -> Spad {
    Spad {
        mode,
        bins: 60,
        period_ps: 2000.0,
        pulses: 20_000,
        photons_per_unit: 0.5,
        dark_counts_per_s: 2e8,
        dead_time_ps: 1330.0,
        after_pulsing: 0.0,
        irf_fwhm_ps: 60.0,
        irf_tail_ps: 80.0,
        ..Spad::default()
    }
}

fn light() -> Vec<f64> {
    let mut light = vec![0.02; 80];
    light[20] = 2.0;
    light[79] = 0.5;
    light
}

#[test]
fn response_has_unit_sum_and_its_mean() {
    let diode = Spad { period_ps: 10_000.0, ..diode(Mode::Synchronous) };
    let response = diode.response().expect("is checked");
    assert_eq!(response.len(), 400);
    assert!((response.iter().sum::<f64>() - 1.0).abs() < 1e-13);
    let time = |k: usize| if k < 200 { k as f64 } else { k as f64 - 400.0 };
    let mean: f64 = response.iter().enumerate().map(|(k, v)| 25.0 * time(k) * v).sum();
    assert!((mean - diode.response_mean_ps()).abs() < 1e-6 && diode.response_mean_ps() == 16.0);
}

#[test]
fn rates_add_up_to_light_and_dark_counts() {
    let rates = diode(Mode::Synchronous).rates(&light(), NM).expect("is checked");
    let want = 0.3 * 0.5 * light().iter().sum::<f64>() + 2e8 * 2000e-12;
    assert!((rates.iter().sum::<f64>() - want).abs() < 1e-12);
    // Light in the next period is equivalent to light in the current period.
    let mut late = vec![0.0; 80];
    late.extend(light());
    let again = diode(Mode::Synchronous).rates(&late, NM).expect("is checked");
    assert!(rates.iter().zip(&again).all(|(a, b)| (a - b).abs() < 1e-15));
    // Without jitter, light stays in its bin.
    let sharp = Spad { irf_fwhm_ps: 0.0, irf_tail: 0.0, dark_counts_per_s: 0.0, ..diode(Mode::Synchronous) };
    let rates = sharp.rates(&light(), NM).expect("is checked");
    assert!(rates.iter().zip(light()).all(|(rate, light)| (rate - 0.15 * light).abs() < 1e-15));
}

/// Verifies that, in each mode, estimates are unbiased after conversion from radiance to counts and back. The
/// test uses 500 captures of 20 000 pulses with 0.2 light and 0.4 dark detections per pulse. Estimates match
/// the light convolved with the response within 5 stated standard errors.
#[test]
fn estimates_are_unbiased_with_their_stated_variance() {
    for (mode, pixel) in [(Mode::Synchronous, 0), (Mode::FreeRunning, 1)] {
        let diode = diode(mode);
        let rates = diode.rates(&light(), NM).expect("is checked");
        let capture = |key| {
            let counts = diode.count(&rates, &mut stream(31, pixel, key)).expect("is checked");
            diode.estimate(&counts, NM).expect("is checked")
        };
        let all: Vec<_> = (0..500).map(capture).collect();
        assert_eq!(all[0].len(), 60);
        for (i, rate) in rates.iter().enumerate().take(60) {
            let want = (rate - 2e8 * 25e-12) / 0.15;
            let stated = Moments::of(all.iter().map(|e| e[i].variance)).mean;
            let seen = Moments::of(all.iter().map(|e| e[i].radiance));
            seen.assert_mean(want, stated);
            seen.assert_variance(stated, 0.1 * stated * stated);
        }
    }
}

#[test]
fn too_much_light_saturates() {
    for mode in [Mode::Synchronous, Mode::FreeRunning] {
        let diode = diode(mode);
        let mut counts = vec![0; 80];
        counts[0] = diode.pulses;
        let estimates = diode.estimate(&counts, NM).expect("is checked");
        assert!(estimates[5].saturated && estimates[5].radiance.is_nan(), "{mode:?}");
    }
    let blind = Spad { detection_efficiency: SpectralValue::Same(0.0), ..diode(Mode::FreeRunning) };
    assert_eq!(blind.estimate(&[0; 80], NM).expect("is checked")[3].variance, f64::INFINITY);
}

#[test]
fn endless_simulations_are_refused() {
    let diode = Spad { dead_time_ps: 1e-3, pulses: 1_000_000_000, ..diode(Mode::FreeRunning) };
    let mut stream = stream(0, 0, 0);
    let endless = diode.count(&[1e3; 80], &mut stream).expect_err("is endless");
    assert!(matches!(endless, DetectorError::Detections { .. }));
    for setting in ["`pulses`", "`photons_per_unit`", "`dark_counts_per_s`", "`dead_time_ps`"] {
        assert!(endless.to_string().contains(setting), "{endless}");
    }
    // The limit applies to single detections. With a long dead time or few photons, the number of detections
    // stays low in a long capture.
    for (rate, dead_time_ps) in [(1e3, 1e9), (1e-12, 1e-3)] {
        let diode = Spad { dead_time_ps, ..diode.clone() };
        assert!(diode.count(&[rate; 80], &mut stream).is_ok());
    }
    assert!(matches!(diode.count(&[1e3; 8], &mut stream), Err(DetectorError::Count { .. })));
    assert!(diode.estimate(&[0; 8], NM).is_err());
    assert!(diode.rates(&[f64::NAN], NM).is_err());
}

#[test]
fn settings_read_from_toml_and_are_checked_by_name() {
    let diode: Spad = toml::from_str("mode = \"free_running\"\nbins = 100").expect("reads");
    assert_eq!((diode.mode, diode.bins), (Mode::FreeRunning, 100));
    assert_eq!(diode.check(), Ok(()));
    assert!(toml::from_str::<Spad>("bin = 0.5").is_err());
    let text = toml::to_string(&diode).expect("writes");
    assert_eq!(toml::from_str::<Spad>(&text).expect("reads"), diode);
    for text in [
        "bin_ps = 0.0",
        "bins = 0",
        "bins = 4001",
        "period_ps = 100_010.0",
        "period_ps = inf",
        "pulses = 0",
        "photons_per_unit = nan",
        "detection_efficiency = 1.1",
        "dark_counts_per_s = -1.0",
        "dead_time_ps = nan",
        "after_pulsing = 1.0",
        "after_pulse_time_ps = inf",
        "irf_fwhm_ps = 1e6",
        "irf_tail = -0.1",
        "irf_tail_ps = nan",
    ] {
        let diode: Spad = toml::from_str(text).expect("reads");
        let error = diode.check().expect_err("is bad").to_string();
        let field = text.split(' ').next().expect("has a name");
        assert!(error.starts_with(&format!("`{field}`")), "{error}");
    }
}

/// Generates valid and invalid values of a setting.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => 1e-3..1e3,
        1 => proptest::num::f64::ANY,
        1 => prop_oneof![Just(0.0), Just(f64::NAN), Just(f64::INFINITY), Just(-1.0), Just(f64::MAX)],
    ]
}

proptest! {
    #[test]
    fn arbitrary_settings_never_panic(
        v in prop::array::uniform12(number()),
        (free, whole, keep) in any::<(bool, bool, bool)>(),
        periods in 1_u32..50,
        bins in prop_oneof![4 => 1_usize..5, 1 => any::<usize>()],
        pulses in prop_oneof![4 => 0_u64..100, 1 => any::<u64>()],
        after_pulsing in prop_oneof![4 => 0.0..1.0, 1 => number()],
    ) {
        let diode = Spad {
            mode: if free { Mode::FreeRunning } else { Mode::Synchronous },
            bin_ps: v[0], bins, pulses, photons_per_unit: v[2], after_pulsing,
            period_ps: if whole { v[0] * f64::from(periods) } else { v[1] },
            detection_efficiency: SpectralValue::Same(if keep { 0.5 } else { v[3] }),
            dark_counts_per_s: v[4], dead_time_ps: v[5], after_pulse_time_ps: v[6],
            irf_fwhm_ps: if keep { 0.1 * v[0] } else { v[7] }, irf_tail: if keep { 0.5 } else { v[8] },
            irf_tail_ps: if keep { 0.2 * v[0] } else { v[9] },
        };
        let good = diode.check().is_ok();
        prop_assert_eq!(diode.response().is_ok(), good);
        prop_assert_eq!(diode.estimate(&[3, 2], v[10]).is_ok(), good && diode.period_bins() == 2);
        let mut stream = stream(0, 0, 0);
        let _ = diode.count(&[v[10]; 3], &mut stream);
        let Ok(rates) = diode.rates(&[v[10], v[11]], 500.0) else { return Ok(()) };
        if let Ok(counts) = diode.count(&rates, &mut stream) {
            prop_assert!(diode.estimate(&counts, v[11]).is_ok());
        }
    }
}
