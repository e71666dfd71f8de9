//! The instruments of one rig, by the roles that a session knows, whoever made them.

use crate::clock::Clock;
use crate::instrument::{
    AreaCamera, Failure, GalvoScanner, Instrument, PatternProjector, PhotonCounter, PulsedLaser,
    RotationStage,
};
use std::collections::BTreeMap;

/// How a stage is driven.
pub struct Stage {
    /// The stage.
    pub device: Box<dyn RotationStage>,
    /// Overshoot with which it always comes to its goal from below, degrees; 0 where it has no backlash.
    pub approach_deg: f64,
}

/// All instruments of a rig.
pub struct Rig {
    /// Its name.
    pub name: String,
    /// Everybody's time.
    pub clock: Clock,
    /// Stages by the name of the element that they carry.
    pub stages: BTreeMap<String, Stage>,
    /// What shows patterns.
    pub projector: Option<Box<dyn PatternProjector>>,
    /// What sees them.
    pub camera: Option<Box<dyn AreaCamera>>,
    /// What points the beam.
    pub galvo: Option<Box<dyn GalvoScanner>>,
    /// The beam.
    pub laser: Option<Box<dyn PulsedLaser>>,
    /// What counts photons.
    pub counter: Option<Box<dyn PhotonCounter>>,
    /// Told the number of every frame before it is taken; a simulated bench keys its noise by it.
    pub on_frame: Option<Box<dyn FnMut(u32) + Send>>,
    /// Asked before every write to disk whether the disk is to be full: tests of full disks.
    pub disk_full: Option<Box<dyn FnMut() -> bool + Send>>,
}

impl Rig {
    /// A rig without instruments.
    #[must_use]
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

    /// Every instrument, by what all of them can do.
    pub fn instruments(&mut self) -> Vec<&mut dyn Instrument> {
        let mut all: Vec<&mut dyn Instrument> = vec![];
        for stage in self.stages.values_mut() {
            all.push(stage.device.as_mut());
        }
        if let Some(i) = &mut self.projector {
            all.push(i.as_mut());
        }
        if let Some(i) = &mut self.camera {
            all.push(i.as_mut());
        }
        if let Some(i) = &mut self.galvo {
            all.push(i.as_mut());
        }
        if let Some(i) = &mut self.laser {
            all.push(i.as_mut());
        }
        if let Some(i) = &mut self.counter {
            all.push(i.as_mut());
        }
        all
    }

    /// The instrument of a name.
    pub fn instrument(&mut self, name: &str) -> Option<&mut dyn Instrument> {
        self.instruments().into_iter().find(|i| i.name() == name)
    }
}

/// What a role's absence is told as.
#[must_use]
pub fn absent(role: &str) -> Failure {
    Failure::new(
        crate::instrument::Fault::Refused,
        role,
        format!("the plan needs a {role}, but the rig has none; add it to the rig file"),
    )
}
