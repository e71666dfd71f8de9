//! The bench that all simulated instruments share.

use super::faults::{FaultAt, Faults, Mishap};
use super::light::Scenery;
use crate::clock::{Clock, locked};
use crate::instrument::{Failure, Fault, Identity};
use polarimetry::capture::bench::Bench;
use polarimetry::capture::detector::cmos::Cmos;
use polarimetry::capture::detector::spad::Spad;
use polarimetry::capture::element::Set;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A bench that instruments share.
#[derive(Clone)]
pub struct Shared(Arc<Mutex<World>>);

/// Where a simulated stage is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageState {
    /// Where the axle is, degrees from its zero.
    pub angle_deg: f64,
    /// Where the encoder says it is.
    pub encoder_deg: f64,
    /// Zero has been found.
    pub homed: bool,
}

/// Everything that is in the laboratory.
pub struct World {
    /// Its time.
    pub clock: Clock,
    /// Optics in truth.
    pub bench: Bench,
    /// What the light meets.
    pub scenery: Scenery,
    /// The camera in truth.
    pub cmos: Cmos,
    /// The diode in truth.
    pub spad: Spad,
    /// Stages by name.
    pub stages: BTreeMap<String, StageState>,
    /// Drive of every projector pixel, 0 to 1; none where it is dark.
    pub pattern: Option<Arc<Vec<f32>>>,
    /// Where the galvo points, optical degrees.
    pub pointing_deg: [f64; 2],
    /// Laser's light is on.
    pub emitting: bool,
    /// Laser is weak until then.
    pub low_until: Duration,
    /// Number of the run's frame that is taken next, which all noise is keyed by.
    pub frame: u32,
    /// Seed of the noise.
    pub seed: u64,
    faults: Faults,
    /// Instruments whose line is dead.
    dead: BTreeSet<String>,
    /// Instruments whose line stays dead.
    gone: BTreeSet<String>,
    power: bool,
}

impl Shared {
    /// A bench at rest.
    #[must_use]
    pub fn new(clock: Clock, bench: Bench, scenery: Scenery, cmos: Cmos, spad: Spad, seed: u64) -> Self {
        Self(Arc::new(Mutex::new(World {
            clock,
            bench,
            scenery,
            cmos,
            spad,
            stages: BTreeMap::new(),
            pattern: None,
            pointing_deg: [0.0; 2],
            emitting: false,
            low_until: Duration::ZERO,
            frame: 0,
            seed,
            faults: Faults::default(),
            dead: BTreeSet::new(),
            gone: BTreeSet::new(),
            power: true,
        })))
    }

    /// Mishaps to come.
    pub fn plan_faults(&self, faults: Vec<FaultAt>) {
        self.with(|w| w.faults = Faults::new(faults));
    }

    /// Looks at, or changes, the bench.
    pub fn with<T>(&self, f: impl FnOnce(&mut World) -> T) -> T {
        f(&mut locked(&self.0))
    }

    /// The bench's clock.
    #[must_use]
    pub fn clock(&self) -> Clock {
        self.with(|w| w.clock.clone())
    }

    /// Counts a use of an instrument; what strikes and is of no special kind is dealt with here.
    ///
    /// # Errors
    /// [`Failure`] if its line is dead, or dies.
    pub fn use_of(&self, instrument: &str, within: Duration) -> Result<Option<Mishap>, Failure> {
        self.alive(instrument)?;
        let mishap = self.with(|w| w.faults.strike(instrument));
        let lost = || {
            Err(Failure::new(
                Fault::Disconnected,
                instrument,
                "no reply: connection lost",
            ))
        };
        match mishap {
            Some(Mishap::CableOut) => {
                self.with(|w| w.dead.insert(instrument.into()));
                lost()
            }
            Some(Mishap::CableGone) => {
                self.with(|w| w.gone.insert(instrument.into()));
                lost()
            }
            Some(Mishap::PowerCut) => {
                self.with(|w| {
                    w.power = false;
                    w.emitting = false;
                    w.pattern = None;
                    for stage in w.stages.values_mut() {
                        // Whoever switched it off also turned the axle a little; the encoder counts from there.
                        stage.angle_deg += 1.7;
                        stage.encoder_deg = 0.0;
                        stage.homed = false;
                    }
                    let all: Vec<String> = w.stages.keys().cloned().collect();
                    w.dead.extend(all);
                    w.dead
                        .extend(["camera", "projector", "galvo", "laser", "counter"].map(String::from));
                });
                lost()
            }
            Some(Mishap::Timeout) => {
                self.clock().sleep(within);
                Err(Failure::new(
                    Fault::Timeout,
                    instrument,
                    "no reply before the deadline",
                ))
            }
            Some(Mishap::Interlock) => Err(Failure::new(
                Fault::Refused,
                instrument,
                "interlock open; close it and resume",
            )),
            Some(Mishap::ClockBack) => {
                self.clock().jump(-3600.0);
                Ok(None)
            }
            Some(Mishap::ClockForward) => {
                self.clock().jump(86_400.0);
                Ok(None)
            }
            Some(Mishap::LaserLow) => {
                let clock = self.clock();
                self.with(|w| w.low_until = clock.now() + Duration::from_secs(60));
                Ok(None)
            }
            other => Ok(other),
        }
    }

    /// # Errors
    /// If the line is dead.
    pub fn alive(&self, instrument: &str) -> Result<(), Failure> {
        let dead = self.with(|w| w.dead.contains(instrument) || w.gone.contains(instrument));
        if dead {
            return Err(Failure::new(
                Fault::Disconnected,
                instrument,
                "no reply: connection lost",
            ));
        }
        Ok(())
    }

    /// Connects an instrument anew.
    ///
    /// # Errors
    /// [`Failure`] if its cable stays off.
    pub fn reconnect(&self, instrument: &str, within: Duration) -> Result<(), Failure> {
        if self.with(|w| w.gone.contains(instrument)) {
            self.clock().sleep(within);
            return Err(Failure::new(
                Fault::Disconnected,
                instrument,
                "the instrument cannot be found; plug it in and resume",
            ));
        }
        self.clock().sleep(Duration::from_millis(500).min(within));
        self.with(|w| {
            w.dead.remove(instrument);
            w.power = true;
        });
        Ok(())
    }

    /// What a simulated instrument says of itself.
    ///
    /// # Errors
    /// If its line is dead.
    pub fn identity(&self, instrument: &str, model: &str) -> Result<Identity, Failure> {
        self.alive(instrument)?;
        Ok(Identity {
            maker: "Sunstone".into(),
            model: model.into(),
            serial: format!("simulated {instrument}"),
            firmware: env!("CARGO_PKG_VERSION").into(),
        })
    }

    /// Whether a write to disk strikes a full disk.
    #[must_use]
    pub fn disk_is_full(&self) -> bool {
        self.with(|w| w.faults.strike("disk")) == Some(Mishap::DiskFull)
    }
}

impl World {
    /// What every element is truly set to: where its stage's axle is, or what the optics fix.
    #[must_use]
    pub fn sets(&self) -> [Vec<Set>; 2] {
        let mut sets = self.bench.optics.sets(0);
        let sides = [self.bench.optics.generator(), self.bench.optics.analyzer()];
        for (sets, elements) in sets.iter_mut().zip(sides) {
            for (set, element) in sets.iter_mut().zip(elements) {
                if let Some(stage) = self.stages.get(&element.name) {
                    set.angle = stage.angle_deg.to_radians();
                }
            }
        }
        sets
    }

    /// The laser's power over nominal.
    #[must_use]
    pub fn power(&self) -> f64 {
        match (self.emitting, self.clock.now() < self.low_until) {
            (false, _) => 0.0,
            (true, true) => 0.4,
            (true, false) => 1.0,
        }
    }
}
