//! A plan and its rig, on their way to instruments.

use super::super::failure::Failure;
use std::path::{Path, PathBuf};
use sunstone::polarimetry::capture::scheme::Scheme;
use sunstone::rig::session::assemble;
use sunstone::rig::session::lab::Rig;
use sunstone::rig::session::plan::{self, Plan, Work};
use sunstone::rig::session::rig_file::{self, BenchPlan, Driver, RigPlan, Scene};
use sunstone::rig::session::steps::Steps;
use sunstone::rigs::{self, BenchError};
use sunstone::transport::render::schedule::Watch;

/// A plan with its rig.
pub(super) struct Session {
    pub(super) plan: Plan,
    pub(super) rig: RigPlan,
    /// Files that are read.
    pub(super) inputs: Vec<PathBuf>,
}

impl Session {
    pub(super) fn load(path: &Path, rig: Option<&PathBuf>) -> Result<Self, Failure> {
        let plan = plan::load(path)?;
        let named = rig.or(plan.rig.as_ref()).cloned().ok_or_else(|| {
            Failure::input(format!(
                "{}: the plan names no rig; add rig = \"rig.toml\", or give --rig",
                path.display()
            ))
        })?;
        let rig = rig_file::load(&named)?;
        Ok(Self {
            plan,
            rig,
            inputs: vec![path.to_owned(), named],
        })
    }

    /// The instruments. A bench that plays a scene renders it first, unless `dry`.
    pub(super) fn assemble(&self, dry: bool, watch: &dyn Watch) -> Result<Rig, Failure> {
        let Some(bench) = &self.rig.bench else {
            if let Some(name) = assemble::simulated(&self.rig) {
                return Err(Failure::input(format!(
                    "{}: `{name}` is simulated, and there is no [bench]; add one, with the tensor, scene or sample that it plays",
                    self.inputs[1].display()
                )));
            }
            return assemble::assemble(&self.rig, None).map_err(Failure::failed);
        };
        let size = match &self.plan.work {
            Work::Camera(_) => self.rig.camera.as_ref().map_or([1, 1], |(_, c)| c.size),
            Work::Scan(work) => work.points,
        };
        let size = size.map(|n| n as usize);
        let scenery = if dry {
            // Nothing is taken: what the light would meet is of no matter.
            sunstone::rig::simulated::light::Scenery::sample([0.0; 16], size)
        } else {
            let tensor = rigs::tensor_of(&self.rig, &self.plan, bench, Path::new("out/bench"), watch);
            let tensor = tensor.map_err(|e| match e {
                BenchError::Scene(e) => Failure::from(e),
                BenchError::Interrupted => Failure::Interrupted(e.to_string()),
                BenchError::Render(e) => Failure::failed(e),
            })?;
            assemble::scenery(bench, size, tensor.as_deref()).map_err(Failure::input)?
        };
        let world = assemble::bench(&self.rig, bench, &self.plan, scenery).map_err(Failure::input)?;
        assemble::assemble(&self.rig, Some(&world)).map_err(Failure::failed)
    }

    /// The rig with simulated instruments of the same limits in the place of its own: to plan, not to take anything.
    pub(super) fn stand_in(&self) -> Result<Rig, Failure> {
        let mut rig = self.rig.clone();
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
        let world = assemble::bench(&rig, &bench, &self.plan, scenery).map_err(Failure::input)?;
        assemble::assemble(&rig, Some(&world)).map_err(Failure::failed)
    }

    pub(super) fn steps(&self, rig: &Rig) -> Result<Steps, Failure> {
        let made = match &self.rig.geometry {
            Some(geometry) => geometry.with(|g| Steps::new(self.plan.clone(), rig, Some(g))),
            None => Steps::new(self.plan.clone(), rig, None),
        };
        made.map_err(Failure::input)
    }
}

/// What stands in front of a run.
pub(super) fn summary(scheme: &Scheme, steps: &Steps, rig: &Rig) -> String {
    let cost = steps.cost(rig);
    let mut text = format!(
        "plan       {}\nrig        {}\nscheme     {}, {} captures\nframes     {}\nduration   {} on the rig, {} of it moving\nraw bytes  {:.1} MB\n",
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
            "mask       {}, {} frames a capture and exposure\n",
            mask.name,
            mask.shots.len()
        ));
    }
    text
}

/// Seconds as people read them.
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

/// What drives an instrument, in words.
pub(super) fn driver(d: &Driver) -> &'static str {
    match d {
        Driver::Simulated => "simulated",
        Driver::Apt => "Thorlabs APT",
        Driver::Analog => "analog output",
        Driver::Dlpc350 => "TI DLPC350",
        Driver::GenICam => "GenICam",
        Driver::Scpi => "SCPI",
        Driver::Vendor => "vendor's library",
    }
}
