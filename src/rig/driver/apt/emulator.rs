//! An emulated controller with a stage. The emulator follows the protocol document and can simulate faults.

use super::super::line::{Line, LineError};
use super::message::{CONTROLLER, HOST, Message, Parser, Status, bits};
use super::stage::Model;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

/// A fault of the emulator, which a test can set while the emulator runs.
#[derive(Clone, Debug, Default)]
pub struct Trouble(Arc<AtomicU8>);

impl Trouble {
    pub const NONE: u8 = 0;
    /// The controller sends no replies.
    pub const SILENT: u8 = 1;
    /// The stage stops halfway.
    pub const STALLS: u8 = 2;
    /// Noise precedes every reply.
    pub const NOISE: u8 = 3;

    pub fn set(&self, trouble: u8) {
        self.0.store(trouble, Ordering::SeqCst);
    }

    fn is(&self, trouble: u8) -> bool {
        self.0.load(Ordering::SeqCst) == trouble
    }
}

/// A motion of the stage, given by start position, goal, start time and duration.
#[derive(Clone, Copy, Debug)]
struct Motion {
    from: f64,
    to: f64,
    begun: Instant,
    time: Duration,
    homing: bool,
}

struct Controller {
    model: Model,
    position: f64,
    homed: bool,
    enabled: bool,
    motion: Option<Motion>,
    error: bool,
    trouble: Trouble,
}

impl Controller {
    /// Advances the simulated stage to the current time. Returns the message that reports the end of a
    /// motion.
    fn pass(&mut self) -> Option<Message> {
        let motion = self.motion?;
        let share = motion.begun.elapsed().as_secs_f64() / motion.time.as_secs_f64().max(1e-6);
        if self.trouble.is(Trouble::STALLS) && share > 0.5 {
            self.motion = None;
            self.error = true;
            return None;
        }
        if share < 1.0 {
            self.position = motion.from + share * (motion.to - motion.from);
            return None;
        }
        self.motion = None;
        self.position = motion.to;
        if motion.homing {
            self.homed = true;
            return Some(Message::Homed);
        }
        Some(Message::MoveCompleted(Some(self.status())))
    }

    fn status(&self) -> Status {
        let mut found = bits::ENABLED * u32::from(self.enabled);
        if let Some(motion) = self.motion {
            found |= if motion.to >= motion.from { 0x10 } else { 0x20 };
            found |= if motion.homing { bits::HOMING } else { 0 };
        } else {
            found |= bits::SETTLED;
        }
        found |= if self.homed { bits::HOMED } else { 0 };
        found |= if self.error { bits::MOTION_ERROR } else { 0 };
        Status {
            position: (self.position * self.model.counts_per_degree).round() as i32,
            extra: 0,
            bits: found,
        }
    }

    fn go(&mut self, to: f64, homing: bool) {
        self.error = false;
        self.motion = Some(Motion {
            from: self.position,
            to,
            begun: Instant::now(),
            time: self.model.limits.move_time(to - self.position),
            homing,
        });
    }

    fn answer(&mut self, message: &Message) -> Option<Message> {
        match message {
            Message::RequestInfo => {
                Some(Message::Info { serial: 27_000_001, model: "KDC101".into(), firmware: [3, 0, 2] })
            }
            Message::Enable(on) => {
                self.enabled = *on;
                None
            }
            Message::Home => {
                self.go(0.0, true);
                None
            }
            Message::MoveAbsolute(counts) => {
                self.go(f64::from(*counts) / self.model.counts_per_degree, false);
                None
            }
            Message::Stop { .. } => {
                self.motion = None;
                Some(Message::MoveStopped(Some(self.status())))
            }
            Message::RequestStatus => Some(Message::Status(self.status())),
            Message::RequestDcStatus => Some(Message::DcStatus(self.status())),
            _ => None,
        }
    }
}

/// Runs a controller until the line's other end closes. Initially the stage is at 40° and is not homed.
pub fn run(mut line: impl Line, model: Model, trouble: Trouble) {
    let mut parser = Parser::new(CONTROLLER);
    let mut controller = Controller {
        model,
        position: 40.0,
        homed: false,
        enabled: false,
        motion: None,
        error: false,
        trouble: trouble.clone(),
    };
    let mut noise = 0_u8;
    let mut send = |line: &mut dyn Line, message: &Message| {
        if trouble.is(Trouble::SILENT) {
            return Ok(());
        }
        let mut bytes = vec![];
        if trouble.is(Trouble::NOISE) {
            noise = noise.wrapping_mul(37).wrapping_add(11);
            bytes.extend([noise, 0xFF, noise >> 1, 0x00, 0x51]);
        }
        bytes.extend(message.bytes(HOST, CONTROLLER));
        line.send(&bytes)
    };
    loop {
        match line.receive(Duration::from_millis(2)) {
            Ok(bytes) => parser.feed(&bytes),
            Err(LineError::Timeout) => {}
            Err(LineError::Gone(_)) => return,
        }
        let mut out: Vec<Message> = controller.pass().into_iter().collect();
        while let Some(message) = parser.next_message() {
            out.extend(controller.answer(&message));
        }
        for message in out {
            if send(&mut line, &message).is_err() {
                return;
            }
        }
    }
}
