//! The state of the bench that all simulated instruments share.

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

/// An operation in progress, given by the time of its end and by its result. The result is `None` if it was
/// dropped.
pub(super) struct Pending<T> {
    pub(super) ready: Duration,
    pub(super) result: Option<T>,
}

/// Returns the failure for an instrument whose line is disconnected.
fn lost(instrument: &str) -> Failure {
    Failure::new(Fault::Disconnected, instrument, "no reply arrived, because the connection is lost")
}

/// A handle to the shared bench.
#[derive(Clone)]
pub struct Shared(Arc<Mutex<World>>);

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageState {
    /// True angle of the axle, in degrees from the zero of the stage.
    pub angle_deg: f64,
    /// Angle that the encoder reports.
    pub encoder_deg: f64,
    pub homed: bool,
}

/// The complete state of the simulated laboratory.
pub struct World {
    pub clock: Clock,
    /// The true optics of the bench.
    pub bench: Bench,
    pub scenery: Scenery,
    /// The true camera settings.
    pub cmos: Cmos,
    /// The true diode settings.
    pub spad: Spad,
    pub stages: BTreeMap<String, StageState>,
    /// Drive of every projector pixel, 0 to 1, or `None` if the projector is dark.
    pub pattern: Option<Arc<Vec<f32>>>,
    /// Direction of the galvo, in optical degrees.
    pub pointing_deg: [f64; 2],
    pub emitting: bool,
    /// Time until which the laser has reduced power.
    pub low_until: Duration,
    /// Number of the run's next frame. The noise of all instruments uses this number as its key.
    pub frame: u32,
    pub seed: u64,
    faults: Faults,
    /// Instruments that are disconnected until the next reconnect.
    dead: BTreeSet<String>,
    /// Instruments that are disconnected permanently.
    gone: BTreeSet<String>,
    power: bool,
}

impl Shared {
    /// Creates a bench with the laser off, no pattern and no stages.
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

    /// Sets the faults to inject.
    pub fn plan_faults(&self, faults: Vec<FaultAt>) {
        self.with(|w| w.faults = Faults::new(faults));
    }

    /// Reads or changes the bench under its lock.
    pub fn with<T>(&self, f: impl FnOnce(&mut World) -> T) -> T {
        f(&mut locked(&self.0))
    }

    pub fn clock(&self) -> Clock {
        self.with(|w| w.clock.clone())
    }

    /// Counts a use of an instrument, and handles the faults that can occur in every instrument. Returns any
    /// other fault to the caller.
    ///
    /// # Errors
    /// Returns [`Failure`] if the line is disconnected, or if a fault disconnects, delays or blocks the
    /// instrument.
    pub fn use_of(&self, instrument: &str, within: Duration) -> Result<Option<Mishap>, Failure> {
        self.alive(instrument)?;
        let mishap = self.with(|w| w.faults.strike(instrument));
        match mishap {
            Some(Mishap::CableOut) => {
                self.with(|w| w.dead.insert(instrument.into()));
                Err(lost(instrument))
            }
            Some(Mishap::CableGone) => {
                self.with(|w| w.gone.insert(instrument.into()));
                Err(lost(instrument))
            }
            Some(Mishap::PowerCut) => {
                self.with(|w| {
                    w.power = false;
                    w.emitting = false;
                    w.pattern = None;
                    for stage in w.stages.values_mut() {
                        // During the power cut, the axle rotates by 1.7°. Afterwards the encoder starts
                        // at zero.
                        stage.angle_deg += 1.7;
                        stage.encoder_deg = 0.0;
                        stage.homed = false;
                    }
                    let all: Vec<String> = w.stages.keys().cloned().collect();
                    w.dead.extend(all);
                    w.dead.extend(["camera", "projector", "galvo", "laser", "counter"].map(String::from));
                });
                Err(lost(instrument))
            }
            Some(Mishap::Timeout) => {
                self.clock().sleep(within);
                Err(Failure::new(Fault::Timeout, instrument, "no reply arrived before the deadline"))
            }
            Some(Mishap::Interlock) => Err(Failure::new(
                Fault::Refused,
                instrument,
                "the interlock is open; close the interlock and resume",
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

    /// Checks that an instrument is connected.
    pub fn alive(&self, instrument: &str) -> Result<(), Failure> {
        let dead = self.with(|w| w.dead.contains(instrument) || w.gone.contains(instrument));
        if dead { Err(lost(instrument)) } else { Ok(()) }
    }

    /// Waits for the end of an operation and returns its result. `words` are the messages for three cases:
    /// - No operation was started.
    /// - The operation takes longer than `within`.
    /// - The result of the operation was dropped.
    pub(super) fn finish<T>(
        &self,
        instrument: &str,
        pending: &mut Option<Pending<T>>,
        within: Duration,
        words: [&str; 3],
    ) -> Result<T, Failure> {
        self.alive(instrument)?;
        let Some(Pending { ready, result }) = pending.take() else {
            return Err(Failure::new(Fault::Refused, instrument, words[0]));
        };
        let clock = self.clock();
        if ready > clock.now() + within {
            *pending = Some(Pending { ready, result });
            clock.sleep(within);
            return Err(Failure::new(Fault::Timeout, instrument, words[1]));
        }
        let Some(result) = result else {
            clock.sleep(within);
            return Err(Failure::new(Fault::Timeout, instrument, words[2]));
        };
        clock.sleep_until(ready);
        Ok(result)
    }

    /// Reconnects an instrument.
    ///
    /// # Errors
    /// Returns [`Failure`] if the instrument is disconnected permanently.
    pub fn reconnect(&self, instrument: &str, within: Duration) -> Result<(), Failure> {
        if self.with(|w| w.gone.contains(instrument)) {
            self.clock().sleep(within);
            return Err(Failure::new(
                Fault::Disconnected,
                instrument,
                "the instrument is not connected; connect the instrument and resume",
            ));
        }
        self.clock().sleep(Duration::from_millis(500).min(within));
        self.with(|w| {
            w.dead.remove(instrument);
            w.power = true;
        });
        Ok(())
    }

    pub fn identity(&self, instrument: &str, model: &str) -> Result<Identity, Failure> {
        self.alive(instrument)?;
        Ok(Identity {
            maker: "Sunstone".into(),
            model: model.into(),
            serial: format!("simulated {instrument}"),
            firmware: env!("CARGO_PKG_VERSION").into(),
        })
    }

    /// Counts a write to the disk and returns whether the disk is full.
    pub fn disk_is_full(&self) -> bool {
        self.with(|w| w.faults.strike("disk")) == Some(Mishap::DiskFull)
    }
}

impl World {
    /// Returns the true setting of every element. The setting is the axle angle of the element's stage, or
    /// the setting in the optics if no stage carries the element.
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

    /// Returns the laser's power relative to its nominal power.
    pub fn power(&self) -> f64 {
        match (self.emitting, self.clock.now() < self.low_until) {
            (false, _) => 0.0,
            (true, true) => 0.4,
            (true, false) => 1.0,
        }
    }
}
