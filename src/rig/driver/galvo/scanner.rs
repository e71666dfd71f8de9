//! A galvo scanner on any analog output.
//!
//! The card reports its output voltage but not the mirrors' position. [`GalvoScanner::point`] therefore
//! converts the present voltage to an angle. After a failure the beam's position is unknown. The next move is
//! then a single step, followed by enough settling time for a move from any position.

use super::wiring::Wiring;
use crate::clock::Clock;
use crate::instrument::{
    AnalogLimits, AnalogOutput, Failure, Fault, GalvoLimits, GalvoScanner, Identity, Instrument,
};
use std::time::Duration;

/// Galvo mirrors driven by an analog output card.
pub struct AnalogGalvo {
    card: Box<dyn AnalogOutput>,
    clock: Clock,
    wiring: Wiring,
    limits: AnalogLimits,
    configured: bool,
    /// Whether a buffer might still be playing.
    running: bool,
    /// Present output in volts, if known.
    at: Option<[f64; 2]>,
}

impl AnalogGalvo {
    /// Creates a scanner on `card` with `wiring`. The scanner's name is that of the card.
    ///
    /// # Errors
    /// Returns a [`Failure`] of kind `limit` if the card cannot drive the mirrors.
    pub fn new(card: Box<dyn AnalogOutput>, clock: Clock, wiring: Wiring) -> Result<Self, Failure> {
        let limits = card.limits();
        wiring.check(&limits).map_err(|what| Failure::new(Fault::Limit, card.name(), what))?;
        Ok(Self { card, clock, wiring, limits, configured: false, running: false, at: None })
    }

    fn left(&self, until: Duration) -> Duration {
        until.saturating_sub(self.clock.now())
    }

    /// Moves to voltages within the card's range. Returns the time from now until the mirrors have settled.
    fn travel(&mut self, goal: [f64; 2], until: Duration) -> Result<Duration, Failure> {
        if self.running {
            let left = self.left(until);
            self.card.stop(left)?;
            self.running = false;
        }
        if !self.configured {
            let left = self.left(until);
            self.card.configure(&self.wiring.settings(), left)?;
            self.configured = true;
        }
        let (way, settle) = match self.at.take() {
            Some(from) => (self.wiring.way(from, goal), self.wiring.settle),
            None => (goal.iter().map(|v| vec![*v]).collect(), self.wiring.settle + self.wiring.longest()),
        };
        self.card.write(&way)?;
        self.running = true;
        self.card.start()?;
        let left = self.left(until);
        self.card.wait(left)?;
        self.running = false;
        Ok(settle)
    }
}

impl Instrument for AnalogGalvo {
    fn name(&self) -> &str {
        self.card.name()
    }

    fn identify(&mut self, within: Duration) -> Result<Identity, Failure> {
        self.card.identify(within)
    }

    fn reconnect(&mut self, within: Duration) -> Result<(), Failure> {
        (self.configured, self.running, self.at) = (false, false, None);
        self.card.reconnect(within)
    }

    fn temperature_c(&mut self) -> Option<f64> {
        self.card.temperature_c()
    }
}

impl GalvoScanner for AnalogGalvo {
    fn limits(&self) -> GalvoLimits {
        self.wiring.limits(&self.limits)
    }

    fn point(&mut self, angles_deg: [f64; 2], within: Duration) -> Result<[f64; 2], Failure> {
        if let Err(what) = self.limits().check(angles_deg) {
            return self.fail(Fault::Limit, what + "; correct the plan");
        }
        let until = self.clock.now().saturating_add(within);
        let goal = self.wiring.volts(angles_deg).map(|v| self.limits.nearest(v));
        let settle = self.travel(goal, until)?;
        let left = self.left(until);
        if settle > left {
            self.clock.sleep(left);
            return self
                .fail(Fault::Timeout, "the mirrors are still moving at the deadline; allow more time");
        }
        self.clock.sleep(settle);
        self.at = Some(goal);
        Ok(self.wiring.angles(goal))
    }
}
