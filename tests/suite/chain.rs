//! Tests the capture chain of applications. The chain creates a rig from a seed, and calibrates the rig with
//! known samples. Tests that invalid input is refused.

use crate::harness::{run, stderr};
use std::path::Path;
use sunstone::applications::chain::{Link, calibrated};
use sunstone::applications::links::Part;
use sunstone::apply::chain::file::{Belief, Chain, Sample, from_toml};
use sunstone::polarimetry::capture::detector::cmos::Cmos;
use sunstone::polarimetry::capture::scheme::Scheme;
use sunstone::polarimetry::capture::simulate::Noise;
use sunstone::rig::calibrate::polarimetric::parameters::Parameter;

fn chain(more: &str) -> Chain {
    let text = format!(
        "scheme = {{ kind = \"drr\", captures = 36 }}\n\
         optics = {{ axis_error_deg = 1, retardance_error_deg = 3, extinction = 1e-3 }}\n{more}"
    );
    from_toml(Path::new("chain.toml"), &text).expect("a chain")
}

/// Calibrates axes, retardances and extinctions of 8 rigs from noisy captures of air, a mirror and a
/// polarizer. Tests that the errors are far smaller than the imperfections of the rigs.
#[test]
fn rigs_are_calibrated_by_known_samples() {
    let chain = chain("[cmos]\nbracket = [1, 0.1]\n");
    let samples = [Sample::Air, Sample::Mirror, Sample::Polarizer];
    let plan = Scheme::quad(36, false).expect("a scheme");
    let noise = Noise::Cmos { camera: Cmos { photons_per_unit: 2e6, ..Cmos::default() }, demosaic: None };
    let (mut left, mut planted) = (0.0, 0.0);
    for rig in 0..8 {
        let real = chain.laboratory.optics.of(&plan, rig);
        let found = calibrated(&plan, &real, &samples, &noise, &[450.0, 650.0], rig).expect("a calibration");
        for p in Parameter::all(&plan) {
            let [want, is] = [&real, &found].map(|s| p.get(s, 450.0));
            if !p.unit().is_empty() {
                left += (is - want).powi(2);
                planted += want.powi(2);
            }
            let most = if p.unit().is_empty() { 1e-3 } else { 0.1 };
            assert!((is - want).abs() < most, "{}: {is} is not {want}", p.name(&plan));
        }
    }
    assert!(left < 1e-3 * planted, "{left} of {planted}");
    // Two samples leave one rotation undetermined or provide too few captures, so the third sample is
    // necessary.
    let real = chain.laboratory.optics.of(&plan, 1);
    let air = calibrated(&plan, &real, &samples[..1], &noise, &[550.0], 1).expect("a calibration");
    let off = |s: &Scheme| (s.generator()[0].axis_offset - real.generator()[0].axis_offset).abs();
    let all = calibrated(&plan, &real, &samples, &noise, &[550.0], 1).expect("a calibration");
    assert!(off(&all) < off(&air), "{} {}", off(&all), off(&air));
}

#[test]
fn a_rig_depends_on_its_seed() {
    let link =
        |belief| Link { label: String::new(), chain: chain("seed = 4\n"), belief, prior: None, only: None };
    let rig = |belief, seed| format!("{:?}", link(belief).rig(seed, &[550.0]).expect("a rig"));
    assert_eq!(rig(Belief::Calibrated, 1), rig(Belief::Calibrated, 1));
    assert_ne!(rig(Belief::Exact, 1), rig(Belief::Exact, 2));
    assert_ne!(rig(Belief::Exact, 1), rig(Belief::Nominal, 1));
}

#[test]
fn parts_are_swept_by_name() {
    assert_eq!(Part::parse("photons=30,3e3"), Ok((Part::Photons, vec![30.0, 3000.0])));
    for part in Part::ALL {
        let (found, values) = Part::parse(part.name()).expect("a part");
        assert_eq!((found, values.as_slice()), (part, part.values()));
        assert!(values.iter().all(|v| part.with(&chain(""), *v).is_some()));
    }
    let (_, inf) = Part::parse("extinction=100,inf").expect("a part");
    let clean = Part::Extinction.with(&chain(""), inf[1]).expect("a chain");
    let real = clean.laboratory.optics.of(&clean.nominal, 1);
    let leak = Parameter::all(&real)
        .into_iter()
        .filter(|p| matches!(p, Parameter::Extinction(..)))
        .map(|p| p.get(&real, 550.0))
        .fold(0.0, f64::max);
    assert_eq!(leak, 0.0);
    for bad in [
        "photon",
        "photons=0",
        "axis=x",
        "extinction=0.5",
        "axis=1,,2",
        "photons=1e-308",
        "photons=",
        "calibration=1",
        "axis=1,1.0",
    ] {
        assert!(Part::parse(bad).is_err(), "{bad}");
    }
}

#[test]
fn invalid_captures_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("chain.toml"), "scheme = { kind = \"drr\", captures = 36 }\noptic = 3\n")
        .expect("writes");
    let scenes = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("scenes");
    let scenes = scenes.to_str().expect("UTF-8");
    let message = |more: &[&str]| {
        let fixed = ["apply", "metamerism", "--preview", "--scenes", scenes];
        stderr(&run(at, &[&fixed[..], more].concat(), 2))
    };
    assert!(message(&["--capture", "nowhere.toml"]).contains("cannot read the chain"));
    assert!(message(&["--capture", "chain.toml"]).contains("chain.toml:2:1"));
    assert!(message(&["--sweep", "photons"]).contains("--capture"));
    assert!(message(&["--capture", "chain.toml", "--sweep", "photos"]).contains("photons, extinction"));
    assert!(message(&["--capture", "chain.toml", "--captures", "0-3"]).contains("1-16"));
    for example in std::fs::read_dir(Path::new(scenes).join("../rigs/chains")).expect("examples") {
        let path = example.expect("an example").path();
        sunstone::apply::chain::file::load(&path).expect("a chain");
    }
}
