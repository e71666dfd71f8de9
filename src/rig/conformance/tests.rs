//! Tests that simulated instruments pass the conformance suite and that a faulty instrument fails.

use super::*;
use crate::instrument::{Identity, LaserLimits, LaserState};
use crate::session::assemble::{assemble, bench, scenery};
use crate::session::lab::Rig;
use crate::session::{plan, rig_file};
use std::path::Path;

/// Returns a simulated rig with every kind of instrument.
fn rig() -> Rig {
    let text = "[stages.a]\n[projector]\nsize = [8, 6]\n[camera]\nsize = [12, 10]\nstep = [4, 2]\n[galvo]\n[laser]\nnm = 550\n\
                [counter]\n[bench]\nsample = \"air\"\nwavelength_nm = 550\n";
    let rig = rig_file::from_toml(Path::new("r.toml"), text).expect("a rig");
    let text =
        "scheme = { kind = \"drr\", captures = 4 }\n[camera]\nexposures_ms = [1]\nmasks = [\"full\"]\n";
    let plan = plan::from_toml(Path::new("p.toml"), text).expect("a plan");
    let bench_plan = rig.bench.as_ref().expect("a bench");
    let light = scenery(bench_plan, [12, 10], None).expect("a sample");
    let world = bench(&rig, bench_plan, &plan, light).expect("a bench");
    assemble(&rig, Some(&world)).expect("instruments")
}

#[test]
fn simulated_instruments_conform() {
    let mut rig = rig();
    let stage = rig.stages.get_mut("a").expect("a stage");
    let reports = [
        ("stage", rotation_stage(stage.device.as_mut())),
        ("projector", pattern_projector(rig.projector.as_mut().expect("one").as_mut())),
        ("camera", area_camera(rig.camera.as_mut().expect("one").as_mut())),
        ("galvo", galvo_scanner(rig.galvo.as_mut().expect("one").as_mut())),
        ("laser", pulsed_laser(rig.laser.as_mut().expect("one").as_mut())),
        ("counter", photon_counter::photon_counter(rig.counter.as_mut().expect("one").as_mut())),
    ];
    for (name, report) in &reports {
        report.assert_passed(&format!("simulated {name}"), 10);
    }
}

/// The suite detects a stage that reports its goal but does not move.
#[test]
fn a_stage_that_does_not_move_is_detected() {
    struct Liar;
    impl Instrument for Liar {
        fn name(&self) -> &'static str {
            "liar"
        }
        fn identify(&mut self, _: Duration) -> Result<Identity, Failure> {
            Ok(Identity { maker: String::new(), model: "m".into(), serial: "s".into(), firmware: "f".into() })
        }
        fn reconnect(&mut self, _: Duration) -> Result<(), Failure> {
            Ok(())
        }
    }
    impl PulsedLaser for Liar {
        fn limits(&self) -> LaserLimits {
            LaserLimits { nm: 635.0, rate_hz: [1e6, 1e7] }
        }
        fn emit(&mut self, _: bool, _: f64, _: Duration) -> Result<(), Failure> {
            Ok(())
        }
        fn state(&mut self, _: Duration) -> Result<LaserState, Failure> {
            Ok(LaserState { emitting: true, rate_hz: 1e6, power: 1.0 })
        }
    }
    let report = pulsed_laser(&mut Liar);
    let names: Vec<&str> = report.faults().map(|c| c.name).collect();
    assert_eq!(
        names,
        [
            "reports its identity",
            "emits at its lowest and highest rates",
            "refuses rates outside its limits",
            "refuses rates outside its limits",
            "turns off"
        ]
    );
}
