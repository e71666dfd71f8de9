//! Compares voltages and paths with closed forms, and tests the scanner on a simulated card with and without
//! failures.

use super::scanner::AnalogGalvo;
use super::wiring::{Travel, Wiring};
use crate::conformance;
use crate::conformance::analog_output::analog_output;
use crate::instrument::{AnalogLimits, Fault, GalvoScanner, Instrument};
use crate::session::assemble::{bench, scenery};
use crate::session::{plan, rig_file};
use crate::simulated::analog_card::SimulatedCard;
use crate::simulated::faults::{FaultAt, Mishap};
use crate::simulated::world::Shared;
use proptest::prelude::*;
use std::path::Path;
use std::time::Duration;

const WITHIN: Duration = Duration::from_secs(5);

const CARD: AnalogLimits =
    AnalogLimits { channels: 3, volts: [-10.0, 10.0], bits: 16, rate_hz: [1.0, 1e6], samples: 65_536 };

/// Wiring for the tests, in which the y mirror is mounted in reverse and has a smaller gain.
const WIRING: Wiring = Wiring {
    channels: [2, 0],
    volts_per_degree: [0.8, -0.5],
    range_deg: [20.0, 15.0],
    rate_hz: 1e4,
    travel: Travel::Smooth(2000.0),
    settle: Duration::from_micros(300),
};

fn world(faults: &[(Mishap, u64)]) -> Shared {
    let text = "[bench]\nsample = \"air\"\nwavelength_nm = 550\n";
    let rig = rig_file::from_toml(Path::new("r.toml"), text).expect("a rig");
    let text = "scheme = { kind = \"quad\", captures = 4 }\n[scan]\npoints = [2, 2]\nfov_x_deg = 10\ndwell_ms = 1\nbins = 4\nbin_ps = 25\n";
    let plan = plan::from_toml(Path::new("p.toml"), text).expect("a plan");
    let of_rig = rig.bench.as_ref().expect("a bench");
    let light = scenery(of_rig, [2, 2], None).expect("a sample");
    let world = bench(&rig, of_rig, &plan, light).expect("a bench");
    let faults = faults.iter().map(|(kind, at)| FaultAt { kind: *kind, instrument: "galvo".into(), at: *at });
    world.plan_faults(faults.collect());
    world
}

fn card(world: &Shared) -> SimulatedCard {
    let beam = world.clone();
    let terminals = move |volts: &[f64]| {
        let angles = WIRING.angles([volts[2], volts[0]]);
        beam.with(|w| w.pointing_deg = angles);
    };
    SimulatedCard::new("galvo", world.clone(), CARD, Box::new(terminals))
}

fn scanner(world: &Shared, wiring: Wiring) -> AnalogGalvo {
    AnalogGalvo::new(Box::new(card(world)), world.clock(), wiring).expect("a scanner")
}

/// The output steps are those of 16 bits over ±10 V. 0 V is an exact step, and the largest output is one step
/// below 10 V.
#[test]
fn steps_match_the_number_of_bits() {
    assert_eq!(CARD.step(), 20.0 / 65_536.0);
    assert_eq!(CARD.nearest(0.0), 0.0);
    assert_eq!(CARD.nearest(-10.0), -10.0);
    assert_eq!(CARD.nearest(10.0), 10.0 - CARD.step());
    assert_eq!(CARD.nearest(0.4 * CARD.step()), 0.0);
    assert_eq!(CARD.nearest(0.6 * CARD.step()), CARD.step());
    // A mirror angle of 5° deflects the beam by 10°.
    assert_eq!(WIRING.volts([10.0, 10.0]), [4.0, -2.5]);
}

proptest! {
    /// Volts convert back to degrees. A path ends at its goal, is straight and symmetric, and does not exceed
    /// the maximum speed.
    #[test]
    fn moves_end_at_the_goal_within_the_speed_limit(from in [-20.0..20.0, -15.0..15.0], to in [-20.0..20.0, -15.0..15.0]) {
        let (a, b) = (WIRING.volts(from), WIRING.volts(to));
        let back = WIRING.angles(b);
        prop_assert!((back[0] - to[0]).abs() < 1e-12 && (back[1] - to[1]).abs() < 1e-12);
        let way = WIRING.way(a, b);
        let n = way[0].len();
        prop_assert_eq!([way[0][n - 1], way[1][n - 1]], b);
        let mut last = from;
        let mut fastest = 0.0_f64;
        for k in 0..n {
            let at = WIRING.angles([way[0][k], way[1][k]]);
            let speed = (0..2).map(|i| (at[i] - last[i]).abs() * WIRING.rate_hz).fold(0.0, f64::max);
            fastest = fastest.max(speed);
            let cross = (at[0] - from[0]) * (to[1] - from[1]) - (at[1] - from[1]) * (to[0] - from[0]);
            prop_assert!(cross.abs() < 1e-9, "{} degrees off the straight line", cross);
            if k + 1 < n {
                let mirrored = way[0][n - 2 - k] + way[0][k];
                prop_assert!((mirrored - a[0] - b[0]).abs() < 1e-9);
            }
            last = at;
        }
        prop_assert!(fastest <= 2000.0 * (1.0 + 1e-9), "{} degrees per second", fastest);
        // The number of samples n is rounded up, so a path takes up to one sample longer than necessary. In
        // the worst case, the fastest sample covers the interval of length 1/n next to the midpoint. Near the
        // midpoint the speed decreases as (1 - 4x²)² ≥ 1 - 8x². The mean speed is therefore at least 1 -
        // 8/(3n²) of the maximum.
        let n = n as f64;
        let least = 2000.0 * (1.0 - 1.0 / n) * (1.0 - 8.0 / (3.0 * n * n));
        prop_assert!(fastest >= least * (1.0 - 1e-9), "{} of {} degrees per second", fastest, least);
    }
}

#[test]
fn card_and_scanner_conform() {
    analog_output(&mut card(&world(&[]))).assert_passed("simulated card", 21);
    for travel in [Travel::Smooth(2000.0), Travel::Stepped] {
        let mut galvo = scanner(&world(&[]), Wiring { travel, ..WIRING });
        conformance::galvo_scanner(&mut galvo).assert_passed(&format!("galvo, {travel:?}"), 10);
    }
}

/// The card outputs each sample at its time and on its channel, rounded to the card's steps. After the last
/// sample, the mirrors settle at the goal.
#[test]
fn every_sample_is_output_at_its_time() {
    let world = world(&[]);
    let mut card = card(&world);
    let recording = card.record();
    let mut galvo = AnalogGalvo::new(Box::new(card), world.clock(), WIRING).expect("a scanner");
    galvo.point([0.0, 0.0], WITHIN).expect("points");
    let (begun, before) = (world.clock().now(), recording.lock().expect("it").len());
    let at = galvo.point([10.0, -6.0], WITHIN).expect("points");
    assert!((at[0] - 10.0).abs() < 4e-4 && (at[1] + 6.0).abs() < 7e-4, "{at:?}");
    assert_eq!(world.with(|w| w.pointing_deg), at);
    // The number of samples is 1.875 · 10° / 2000°/s · 10 kHz. A sample deviates by at most half a step, plus
    // half a step for the rounded goal.
    let n = 94;
    let stood = recording.lock().expect("it")[before..].to_vec();
    assert_eq!(stood.len(), n);
    for (k, (time, volts)) in stood.iter().enumerate() {
        assert_eq!(*time, begun + Duration::from_secs_f64(k as f64 / 1e4));
        let u = (k + 1) as f64 / n as f64;
        let s = 10.0 * u.powi(3) - 15.0 * u.powi(4) + 6.0 * u.powi(5);
        assert!((volts[2] - 4.0 * s).abs() <= 1.0001 * CARD.step(), "{k}: {volts:?}");
        assert!((volts[0] - 1.5 * s).abs() <= 1.0001 * CARD.step(), "{k}: {volts:?}");
        assert_eq!(volts[1], 0.0);
        assert_eq!(volts[2], CARD.nearest(volts[2]));
    }
    let took = world.clock().now().saturating_sub(begun);
    assert_eq!(took, Duration::from_secs_f64(n as f64 / 1e4) + WIRING.settle);
    // A move to the present position takes one sample.
    galvo.point([10.0, -6.0], WITHIN).expect("points");
    assert_eq!(recording.lock().expect("it").len(), before + n + 1);
}

/// The scanner reports each failure of the card with its cause. The next move reaches its goal and waits for
/// the maximum settling time.
#[test]
fn card_failures_are_reported_and_the_next_move_succeeds() {
    for (mishap, fault) in [
        (Mishap::Stall, Fault::Stalled),
        (Mishap::Timeout, Fault::Timeout),
        (Mishap::CableOut, Fault::Disconnected),
        (Mishap::PowerCut, Fault::Disconnected),
        (Mishap::Interlock, Fault::Refused),
    ] {
        let world = world(&[(mishap, 2)]);
        let mut galvo = scanner(&world, WIRING);
        galvo.point([-20.0, 0.0], WITHIN).expect("points");
        let failure = galvo.point([20.0, 5.0], WITHIN).expect_err("it fails");
        assert_eq!(failure.fault, fault, "{failure}");
        if fault == Fault::Disconnected {
            let again = galvo.point([20.0, 5.0], WITHIN).expect_err("the line is dead");
            assert_eq!(again.fault, Fault::Disconnected);
            galvo.reconnect(WITHIN).expect("connects");
        }
        let begun = world.clock().now();
        let at = galvo.point([20.0, 5.0], WITHIN).expect("points");
        assert_eq!(world.with(|w| w.pointing_deg), at, "{mishap:?}");
        assert!((at[0] - 20.0).abs() < 4e-4 && (at[1] - 5.0).abs() < 7e-4);
        assert!(world.clock().now().saturating_sub(begun) >= WIRING.longest() + WIRING.settle);
    }
    let mut galvo = scanner(&world(&[]), WIRING);
    galvo.point([0.0, 0.0], WITHIN).expect("points");
    let short = galvo.point([20.0, 0.0], Duration::from_millis(1)).expect_err("too short");
    assert_eq!(short.fault, Fault::Timeout);
    assert!((galvo.point([20.0, 0.0], WITHIN).expect("points")[0] - 20.0).abs() < 4e-4);
}

/// The scanner refuses wiring that the card cannot drive, before any mirror moves.
#[test]
fn invalid_wiring_is_refused() {
    for (wiring, words) in [
        (Wiring { volts_per_degree: [1.2, 0.5], ..WIRING }, "reduce the range"),
        (Wiring { volts_per_degree: [0.0, 0.5], ..WIRING }, "invalid volts_per_degree"),
        (Wiring { channels: [3, 0], ..WIRING }, "more different numbers"),
        (Wiring { channels: [1, 1], ..WIRING }, "more different numbers"),
        (Wiring { rate_hz: 2e6, ..WIRING }, "samples per second"),
        (Wiring { travel: Travel::Smooth(-1.0), ..WIRING }, "invalid speed"),
        (Wiring { travel: Travel::Smooth(10.0), ..WIRING }, "the longest move"),
    ] {
        let found = wiring.check(&CARD).expect_err(words);
        assert!(found.contains(words), "{found}");
    }
    assert_eq!(WIRING.check(&CARD), Ok(()));
}
