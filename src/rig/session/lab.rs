//! The instruments of a rig by their roles in a session.

use crate::clock::Clock;
use crate::instrument::{
    AreaCamera, Failure, GalvoScanner, Instrument, PatternProjector, PhotonCounter, PulsedLaser,
    RotationStage,
};
use std::collections::BTreeMap;

/// A stage, and the overshoot with which it approaches its goals.
pub struct Stage {
    pub device: Box<dyn RotationStage>,
    /// Overshoot in degrees with which the stage approaches each goal from below. The overshoot is 0 for a
    /// stage without backlash.
    pub approach_deg: f64,
}

pub struct Rig {
    pub name: String,
    /// The clock that all instruments share.
    pub clock: Clock,
    /// The stages. The key of each stage is the name of the element that it carries.
    pub stages: BTreeMap<String, Stage>,
    pub projector: Option<Box<dyn PatternProjector>>,
    pub camera: Option<Box<dyn AreaCamera>>,
    pub galvo: Option<Box<dyn GalvoScanner>>,
    pub laser: Option<Box<dyn PulsedLaser>>,
    pub counter: Option<Box<dyn PhotonCounter>>,
    /// Function that is called with the number of every frame before the frame is captured. A simulated bench
    /// uses this number as the key of its noise.
    pub on_frame: Option<Box<dyn FnMut(u32) + Send>>,
    /// Function that is called before every write to disk. If the function returns true, the write fails as
    /// on a full disk (for tests).
    pub disk_full: Option<Box<dyn FnMut() -> bool + Send>>,
}

impl Rig {
    pub fn new(name: &str, clock: Clock) -> Self {
        Self {
            name: name.to_owned(),
            clock,
            stages: BTreeMap::new(),
            projector: None,
            camera: None,
            galvo: None,
            laser: None,
            counter: None,
            on_frame: None,
            disk_full: None,
        }
    }

    pub fn instruments(&mut self) -> Vec<&mut dyn Instrument> {
        let stages = self.stages.values_mut().map(|s| s.device.as_mut() as &mut dyn Instrument);
        let mut all: Vec<&mut dyn Instrument> = stages.collect();
        all.extend(self.projector.as_deref_mut().map(|i| i as &mut dyn Instrument));
        all.extend(self.camera.as_deref_mut().map(|i| i as &mut dyn Instrument));
        all.extend(self.galvo.as_deref_mut().map(|i| i as &mut dyn Instrument));
        all.extend(self.laser.as_deref_mut().map(|i| i as &mut dyn Instrument));
        all.extend(self.counter.as_deref_mut().map(|i| i as &mut dyn Instrument));
        all
    }

    pub fn instrument(&mut self, name: &str) -> Option<&mut dyn Instrument> {
        self.instruments().into_iter().find(|i| i.name() == name)
    }
}

/// Returns the failure for a missing instrument.
pub fn absent(role: &str) -> Failure {
    Failure::new(
        crate::instrument::Fault::Refused,
        role,
        format!("the plan needs a {role}, but the rig has none; add a {role} to the rig file"),
    )
}
