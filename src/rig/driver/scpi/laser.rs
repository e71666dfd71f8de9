//! A pulsed laser, or a delay generator that triggers a laser, controlled through a table of commands.

use super::super::line::{Line, StreamLine, left};
use super::table::LaserTable;
use super::talk::Talk;
use crate::instrument::{Failure, Fault, Identity, Instrument, LaserLimits, LaserState, PulsedLaser};
use std::time::{Duration, Instant};

pub struct ScpiLaser {
    talk: Talk,
    table: LaserTable,
}

impl ScpiLaser {
    pub fn new(name: &str, line: Box<dyn Line>, table: LaserTable) -> Self {
        let talk = Talk::new(name, line);
        Self { talk, table }
    }

    /// Connects to the table's address.
    ///
    /// # Errors
    /// Returns a [`Failure`] of kind `disconnected` if the connection fails.
    pub fn connect(name: &str, table: LaserTable) -> Result<Self, Failure> {
        let line = StreamLine::tcp(&table.address)
            .map_err(|e| Failure::new(Fault::Disconnected, name, e.to_string()))?;
        Ok(Self::new(name, Box::new(line), table))
    }

    /// Sends a command, waits for its completion, and queries the instrument's errors.
    fn tell(&mut self, command: &str, until: Instant) -> Result<(), Failure> {
        self.talk.tell(command)?;
        if self.table.waits {
            self.talk.done(left(until))?;
        }
        self.talk.errors(&self.table.errors, command, left(until))
    }

    fn emitting(&mut self, until: Instant) -> Result<bool, Failure> {
        let answer = self.talk.ask(&self.table.ask_on, left(until))?;
        Ok(self.table.on_answers.iter().any(|a| a.eq_ignore_ascii_case(&answer)))
    }
}

impl Instrument for ScpiLaser {
    fn name(&self) -> &str {
        self.talk.name()
    }

    fn identify(&mut self, within: Duration) -> Result<Identity, Failure> {
        self.talk.identity(within)
    }

    fn reconnect(&mut self, within: Duration) -> Result<(), Failure> {
        let until = Instant::now() + within;
        self.talk.reopen()?;
        // Discard errors that occurred before the reconnection.
        self.talk.tell("*CLS")?;
        self.talk.identity(left(until)).map(drop)
    }
}

impl PulsedLaser for ScpiLaser {
    fn limits(&self) -> LaserLimits {
        self.table.limits()
    }

    fn emit(&mut self, on: bool, rate_hz: f64, within: Duration) -> Result<(), Failure> {
        let until = Instant::now() + within;
        if on {
            if let Err(what) = self.limits().check(rate_hz) {
                return self.fail(Fault::Limit, what + "; correct the plan");
            }
            if let Some(question) = self.table.ask_interlock.clone() {
                let answer = self.talk.ask(&question, left(until))?;
                if !["1", "+1", "ON"].contains(&answer.to_ascii_uppercase().as_str()) {
                    let what = format!(
                        "the interlock is open (`{question}` returned `{answer}`); close the interlock"
                    );
                    return self.fail(Fault::Refused, what);
                }
            }
            // Set the rate first, so that the laser never emits at a previous rate.
            if let Some(command) = self.table.rate(rate_hz) {
                self.tell(&command, until)?;
            }
        }
        let command = if on { &self.table.on } else { &self.table.off }.clone();
        self.tell(&command, until)?;
        if self.emitting(until)? == on {
            return Ok(());
        }
        let what = if on {
            "the laser does not emit after the command to turn on; check the key switch and the interlock"
        } else {
            "the laser still emits after the command to turn off; turn the laser off with the key switch"
        };
        self.fail(Fault::Refused, what)
    }

    fn state(&mut self, within: Duration) -> Result<LaserState, Failure> {
        let until = Instant::now() + within;
        let emitting = self.emitting(until)?;
        let rate_hz = match self.table.ask_rate.clone() {
            Some(question) => self.talk.ask_number(&question, left(until))?,
            None => self.table.rate_hz[0],
        };
        let power = match (self.table.ask_power.clone(), self.table.nominal_power) {
            (Some(question), Some(nominal)) => self.talk.ask_number(&question, left(until))? / nominal,
            _ => 1.0,
        };
        Ok(LaserState { emitting, rate_hz, power })
    }
}
