//! A rotation stage with an APT controller (PRM1-Z8 on KDC101 or TDC001, and related models).

use super::super::line::{Line, LineError, left};
use super::message::{CONTROLLER, HOST, Message, Parser, Status, bits};
use crate::instrument::{Failure, Fault, Identity, Instrument, RotationStage, StageLimits, StageReading};
use std::time::{Duration, Instant};

/// Polling interval of a moving stage.
const ASK: Duration = Duration::from_millis(100);
/// A stage counts as stalled after this number of consecutive equal positions that differ from its goal.
const STANDS: u32 = 3;

/// Units of a stage model, and limits of its motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    pub counts_per_degree: f64,
    /// Velocity in controller units that equals one degree per second.
    pub velocity: f64,
    /// Acceleration in controller units that equals one degree per second squared.
    pub acceleration: f64,
    pub limits: StageLimits,
}

impl Model {
    /// Returns a model by its product name.
    ///
    /// The PRM1-Z8 has 1919.6418578623391 counts per degree and a sampling period of 2048/6e6 s (protocol,
    /// appendix on scaling).
    pub fn named(name: &str) -> Option<Self> {
        const COUNTS: f64 = 1919.641857862339;
        let family = ["PRM1-Z8", "PRM1Z8", "PRM1/MZ8", "PRMTZ8", "PRMTZ8/M", "KPRM1E", "KPRM1E/M"];
        family.iter().any(|n| n.eq_ignore_ascii_case(name)).then_some(Self {
            counts_per_degree: COUNTS,
            velocity: 42941.6615,
            acceleration: 14.6574,
            limits: StageLimits {
                range_deg: [-1e5, 1e5],
                velocity: 25.0,
                acceleration: 25.0,
                resolution_deg: 1.0 / COUNTS,
            },
        })
    }

    fn counts(&self, degrees: f64) -> i32 {
        (degrees * self.counts_per_degree).round() as i32
    }
}

pub struct AptStage {
    name: String,
    line: Box<dyn Line>,
    parser: Parser,
    model: Model,
    homed: bool,
    goal: Option<i32>,
}

impl AptStage {
    /// Creates a stage that communicates over a line. Stops automatic status updates and enables the channel,
    /// but does not move the stage.
    ///
    /// # Errors
    /// Returns [`Failure`] if the line is disconnected.
    pub fn new(name: &str, line: Box<dyn Line>, model: Model) -> Result<Self, Failure> {
        let mut stage =
            Self { name: name.to_owned(), line, parser: Parser::new(HOST), model, homed: false, goal: None };
        stage.begin()?;
        Ok(stage)
    }

    fn begin(&mut self) -> Result<(), Failure> {
        let limits = self.model.limits;
        self.send(&Message::StopUpdates)?;
        self.send(&Message::Enable(true))?;
        self.send(&Message::SetVelocity {
            acceleration: (limits.acceleration * self.model.acceleration).round() as i32,
            velocity: (limits.velocity * self.model.velocity).round() as i32,
        })
    }

    fn lost(&self, e: LineError) -> Failure {
        self.failure(e.fault(), e.to_string())
    }

    fn send(&mut self, message: &Message) -> Result<(), Failure> {
        let bytes = message.bytes(CONTROLLER, HOST);
        self.line.send(&bytes).map_err(|e| self.lost(e))
    }

    /// Waits until the deadline `until` for the next message, and returns it.
    fn next(&mut self, until: Instant) -> Result<Message, Failure> {
        loop {
            if let Some(message) = self.parser.next_message() {
                return Ok(message);
            }
            if left(until).is_zero() {
                return Err(self.lost(LineError::Timeout));
            }
            let bytes = self.line.receive(left(until)).map_err(|e| self.lost(e))?;
            self.parser.feed(&bytes);
        }
    }

    /// Queries the status. Calls `seen` with every message that arrives.
    fn status(&mut self, until: Instant, seen: &mut dyn FnMut(&Message)) -> Result<Status, Failure> {
        self.send(&Message::RequestDcStatus)?;
        loop {
            let message = self.next(until)?;
            seen(&message);
            if let Message::DcStatus(status) | Message::Status(status) = message {
                self.homed = status.bits & bits::HOMED != 0;
                return Ok(status);
            }
        }
    }

    fn reading(&self, status: Status) -> StageReading {
        StageReading {
            angle_deg: f64::from(status.position) / self.model.counts_per_degree,
            moving: status.bits & bits::MOVING != 0,
            homed: status.bits & bits::HOMED != 0,
        }
    }
}

impl Instrument for AptStage {
    fn name(&self) -> &str {
        &self.name
    }

    fn identify(&mut self, within: Duration) -> Result<Identity, Failure> {
        let until = Instant::now() + within;
        self.send(&Message::RequestInfo)?;
        loop {
            if let Message::Info { serial, model, firmware: [minor, interim, major] } = self.next(until)? {
                return Ok(Identity {
                    maker: "Thorlabs".into(),
                    model,
                    serial: serial.to_string(),
                    firmware: format!("{major}.{interim}.{minor}"),
                });
            }
        }
    }

    fn reconnect(&mut self, _within: Duration) -> Result<(), Failure> {
        self.parser.clear();
        self.goal = None;
        self.homed = false;
        self.line.reopen().map_err(|e| self.lost(e))?;
        self.begin()
    }
}

impl RotationStage for AptStage {
    fn limits(&self) -> StageLimits {
        self.model.limits
    }

    fn home(&mut self, within: Duration) -> Result<(), Failure> {
        let until = Instant::now() + within;
        self.goal = None;
        self.send(&Message::Home)?;
        let mut homed = false;
        loop {
            let step = until.min(Instant::now() + ASK);
            let mut begun = false;
            match self.status(step, &mut |m| homed |= *m == Message::Homed) {
                Ok(status) => {
                    begun = status.bits & bits::HOMING != 0;
                    if homed && !begun {
                        return Ok(());
                    }
                    if status.bits & bits::MOTION_ERROR != 0 {
                        let what = "the stage cannot find the zero position; check for an obstruction";
                        return self.fail(Fault::Stalled, what);
                    }
                }
                Err(e) if e.fault == Fault::Timeout && Instant::now() < until => {}
                Err(e) => return Err(e),
            }
            if Instant::now() >= until {
                let what = if begun {
                    "homing is still in progress at the deadline; allow more time"
                } else {
                    "homing did not start; check the cable and the power of the stage"
                };
                return self.fail(Fault::Timeout, what);
            }
            if !homed {
                std::thread::sleep(ASK / 10);
            }
        }
    }

    fn begin_move(&mut self, angle_deg: f64) -> Result<(), Failure> {
        if let Err(what) = self.model.limits.check(angle_deg) {
            return self.fail(Fault::Limit, what + "; correct the plan");
        }
        if !self.homed {
            return self.fail(Fault::Refused, "the zero position is unknown; home the stage first");
        }
        let counts = self.model.counts(angle_deg);
        self.send(&Message::MoveAbsolute(counts))?;
        self.goal = Some(counts);
        Ok(())
    }

    fn finish_move(&mut self, within: Duration) -> Result<StageReading, Failure> {
        let until = Instant::now() + within;
        let Some(goal) = self.goal else {
            return self.read(within);
        };
        let (mut stands, mut last) = (0, None);
        loop {
            // Allow at least one polling interval, so that a completed move never times out.
            let status = self.status(until.max(Instant::now() + ASK), &mut |_| {})?;
            let reading = self.reading(status);
            // Tolerate two counts, which is the noise of the encoder.
            if !reading.moving && (status.position - goal).abs() <= 2 {
                self.goal = None;
                return Ok(reading);
            }
            stands = if !reading.moving && last == Some(status.position) { stands + 1 } else { 0 };
            last = Some(status.position);
            let cause = if status.bits & (bits::MOTION_ERROR | bits::LIMITS) != 0 {
                Some(", because the motor stalled or a limit switch was reached")
            } else {
                (stands >= STANDS).then_some(", before the stage reached the target angle")
            };
            if let Some(cause) = cause {
                self.goal = None;
                let at = reading.angle_deg;
                let what = format!("the stage stopped at {at:.3}°{cause}; check for an obstruction");
                return self.fail(Fault::Stalled, what);
            }
            if left(until).is_zero() {
                return self
                    .fail(Fault::Timeout, "the move is still in progress at the deadline; allow more time");
            }
            std::thread::sleep(left(until).min(ASK / 5));
        }
    }

    fn read(&mut self, within: Duration) -> Result<StageReading, Failure> {
        let status = self.status(Instant::now() + within, &mut |_| {})?;
        Ok(self.reading(status))
    }

    fn stop(&mut self, within: Duration) -> Result<(), Failure> {
        let until = Instant::now() + within;
        self.goal = None;
        self.send(&Message::Stop { abrupt: true })?;
        loop {
            let status = self.status(until, &mut |_| {})?;
            if status.bits & bits::MOVING == 0 {
                return Ok(());
            }
            if Instant::now() >= until {
                return self.fail(
                    Fault::Timeout,
                    "the stage did not stop before the deadline; check the cable, and stop the stage by hand",
                );
            }
            std::thread::sleep(ASK / 10);
        }
    }
}
