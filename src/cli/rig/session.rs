//! Defines errors, summaries and simulated instruments for planning, which the rig commands share.

use crate::Failure;
use sunstone::polarimetry::capture::scheme::Scheme;
use sunstone::rig::session::assemble;
use sunstone::rig::session::lab::Rig;
use sunstone::rig::session::rig_file::{BenchPlan, Driver, Scene};
use sunstone::rig::session::steps::Steps;
use sunstone::rigs::prepared::{PrepareError, Prepared};

/// Folder in which simulated benches store the tensors of their scenes.
pub(super) const BENCH: &str = "out/bench";

impl From<PrepareError> for Failure {
    fn from(e: PrepareError) -> Self {
        match e {
            PrepareError::Input(e) => Self::from(e),
            PrepareError::Wrong(e) => Self::Input(e),
            PrepareError::Failed(e) => Self::Failed(e),
            PrepareError::Interrupted(e) => Self::Interrupted(e),
        }
    }
}

/// Returns the rig with simulated instruments that have the same limits. This rig is used only for planning.
pub(super) fn stand_in(session: &Prepared) -> Result<Rig, Failure> {
    let mut rig = session.rig.clone();
    rig.stages.values_mut().for_each(|s| s.driver = Driver::Simulated);
    let (projector, camera) = (rig.projector.as_mut(), rig.camera.as_mut());
    projector.into_iter().for_each(|p| p.0 = Driver::Simulated);
    camera.into_iter().for_each(|c| c.0 = Driver::Simulated);
    (rig.galvo, rig.laser, rig.counter) = (None, None, None);
    let size = rig.camera.as_ref().map_or([1, 1], |(_, c)| c.size);
    let bench = BenchPlan {
        scene: Scene::Sample([0.0; 16]),
        slice: String::new(),
        brightness: 1.0,
        nm: rig.wavelength_nm,
        optics: None,
        fov_deg: [None; 2],
        seed: 0,
        real_time: false,
        cmos: rig.cmos.clone(),
        spad: rig.spad.clone(),
        faults: vec![],
    };
    let scenery = assemble::scenery(&bench, size.map(|n| n as usize), None).map_err(Failure::input)?;
    let world = assemble::bench(&rig, &bench, &session.plan, scenery).map_err(Failure::input)?;
    assemble::assemble(&rig, Some(&world)).map_err(Failure::failed)
}

/// Formats the summary that is printed before a run.
pub(super) fn summary(scheme: &Scheme, steps: &Steps, rig: &Rig) -> String {
    let cost = steps.cost(rig);
    let mut text = format!(
        "plan       {}\nrig        {}\nscheme     {}, {} captures\nframes     {}\nduration   {} of rig time, including {} of stage motion\n\
         raw data   {:.1} MB\n",
        steps.plan.name,
        rig.name,
        scheme.name,
        scheme.captures(),
        cost.frames,
        time(cost.duration.as_secs_f64()),
        time(cost.moving.as_secs_f64()),
        cost.bytes as f64 / 1e6,
    );
    for mask in &steps.masks {
        text.push_str(&format!(
            "mask       {}, {} frames per capture and exposure\n",
            mask.name,
            mask.shots.len()
        ));
    }
    text
}

/// Formats a duration in seconds.
pub(super) fn time(seconds: f64) -> String {
    let s = seconds.round() as u64;
    if s >= 3600 {
        format!("{} h {:02} min", s / 3600, s / 60 % 60)
    } else if s >= 60 {
        format!("{} min {:02} s", s / 60, s % 60)
    } else {
        format!("{seconds:.1} s")
    }
}

/// Returns the name of a driver.
pub(super) fn driver(d: &Driver) -> &'static str {
    match d {
        Driver::Simulated => "simulated",
        Driver::Apt => "Thorlabs APT",
        Driver::Analog => "analog output",
        Driver::Dlpc350 => "TI DLPC350",
        Driver::GenICam => "GenICam",
        Driver::Scpi => "SCPI",
        Driver::Vendor => "vendor's library",
        Driver::Python => "Python",
    }
}
