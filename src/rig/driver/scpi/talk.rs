//! Exchange of SCPI messages. Commands and queries end with a newline. A reply is text that ends with a
//! newline.

use super::super::line::{Line, LineError, left};
use crate::instrument::{Failure, Fault, Identity};
use std::time::{Duration, Instant};

/// Longest accepted text reply, in bytes.
const LONGEST: usize = 1 << 16;
/// Maximum number of errors to read from an instrument's queue. A longer queue is assumed to be invalid.
const ERRORS: usize = 64;

/// The host's side of an exchange.
pub struct Talk {
    name: String,
    line: Box<dyn Line>,
    held: Vec<u8>,
    /// Whether a late reply might be pending. A late reply would be mistaken for the reply to the next query.
    out_of_step: bool,
}

impl Talk {
    /// Creates an exchange over a line. `name` is the instrument's name in messages.
    pub fn new(name: &str, line: Box<dyn Line>) -> Self {
        Self { name: name.to_owned(), line, held: vec![], out_of_step: false }
    }

    /// Returns the instrument's name in messages.
    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn failure(&self, fault: Fault, what: impl Into<String>) -> Failure {
        Failure::new(fault, &self.name, what)
    }

    /// Returns an error with a failure of this instrument.
    pub fn fail<T>(&self, fault: Fault, what: impl Into<String>) -> Result<T, Failure> {
        Err(self.failure(fault, what))
    }

    /// Reopens the line and discards pending replies.
    ///
    /// # Errors
    /// Returns a [`Failure`] of kind `disconnected` or `timeout`.
    pub fn reopen(&mut self) -> Result<(), Failure> {
        self.held.clear();
        let opened = self.line.reopen();
        self.out_of_step = opened.is_err();
        opened.map_err(|e| self.lost(e, "the connection"))
    }

    /// Sends a command that has no reply.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `refused`: the command is not a single line
    /// - `disconnected` or `timeout`
    pub fn tell(&mut self, command: &str) -> Result<(), Failure> {
        if command.trim().is_empty() || command.contains(['\n', '\r', '\0']) {
            let what = format!("{command:?} is not a valid command: a command must be a single line");
            return self.fail(Fault::Refused, what);
        }
        if self.out_of_step {
            self.reopen()?;
        }
        // Discard unsolicited bytes, so that they are not read as the next reply.
        self.held.clear();
        let sent = self.line.send(format!("{command}\n").as_bytes());
        sent.map_err(|e| {
            self.out_of_step = true;
            self.lost(e, command)
        })
    }

    /// Sends a query and returns the reply as text without the newline.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `timeout`: no reply arrived in time
    /// - `disconnected`: the connection is lost, or the reply is not text
    pub fn ask(&mut self, question: &str, within: Duration) -> Result<String, Failure> {
        let until = Instant::now() + within;
        self.tell(question)?;
        let mut looked = 0;
        let end = loop {
            if let Some(at) = self.held[looked..].iter().position(|b| *b == b'\n') {
                break looked + at;
            }
            looked = self.held.len();
            if looked > LONGEST {
                return Err(self.nonsense(question, &format!("a reply of more than {LONGEST} bytes")));
            }
            self.more(question, until)?;
        };
        let bytes: Vec<u8> = self.held.drain(..=end).collect();
        match std::str::from_utf8(&bytes) {
            Ok(text) if !text.trim().chars().any(char::is_control) => Ok(text.trim().to_owned()),
            _ => Err(self.nonsense(question, "a reply that is not text")),
        }
    }

    /// Sends a query and returns the reply as a number. Refuses SCPI's NaN (9.91E37) and infinity (9.9E37).
    pub fn ask_number(&mut self, question: &str, within: Duration) -> Result<f64, Failure> {
        let answer = self.ask(question, within)?;
        match answer.parse::<f64>() {
            Ok(n) if n.abs() < 9.9e37 => Ok(n),
            _ => {
                let what = format!("`{question}` returned `{answer}`, which is not a number");
                self.fail(Fault::Disconnected, what)
            }
        }
    }

    /// Waits until the instrument has completed all commands (`*OPC?`).
    pub fn done(&mut self, within: Duration) -> Result<(), Failure> {
        match self.ask("*OPC?", within)?.as_str() {
            "1" | "+1" => Ok(()),
            other => self.fail(Fault::Disconnected, format!("`*OPC?` returned `{other}`, expected `1`")),
        }
    }

    /// Empties the error queue by repeating `question` (SCPI: `SYST:ERR?`). Returns a failure with the first
    /// error, if there is an error.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `limit`: a value is out of range (-222, -224 and similar errors)
    /// - `refused`: the command is unknown or currently impossible
    /// - `disconnected`: a query error occurred (-400 and below)
    /// - `timeout`
    pub fn errors(&mut self, question: &str, after: &str, within: Duration) -> Result<(), Failure> {
        let until = Instant::now() + within;
        let mut first = None;
        for _ in 0..ERRORS {
            let answer = self.ask(question, left(until))?;
            let number = answer.split(',').next().unwrap_or_default().trim();
            let Ok(number) = number.parse::<i64>() else {
                return self.fail(Fault::Disconnected, format!("`{question}` returned `{answer}`"));
            };
            if number == 0 {
                return first.map_or(Ok(()), Err);
            }
            first.get_or_insert_with(|| {
                let fault = match number {
                    -229..=-222 => Fault::Limit,
                    -499..=-400 => Fault::Disconnected,
                    _ => Fault::Refused,
                };
                self.failure(fault, format!("`{after}` failed with `{answer}`"))
            });
        }
        self.fail(
            Fault::Disconnected,
            format!("`{question}` reports {ERRORS} errors or more; check the instrument"),
        )
    }

    /// Queries manufacturer, model, serial number and firmware version (`*IDN?`).
    pub fn identity(&mut self, within: Duration) -> Result<Identity, Failure> {
        let answer = self.ask("*IDN?", within)?;
        let fields: Vec<&str> = answer.splitn(4, ',').map(str::trim).collect();
        match fields[..] {
            [maker, model, serial, firmware] if ![maker, model, serial].contains(&"") => Ok(Identity {
                maker: maker.into(),
                model: model.into(),
                serial: serial.into(),
                firmware: firmware.into(),
            }),
            _ => {
                let what = format!("`*IDN?` returned `{answer}`; expected maker, model, serial, firmware");
                self.fail(Fault::Disconnected, what)
            }
        }
    }

    fn more(&mut self, question: &str, until: Instant) -> Result<(), Failure> {
        let left = left(until);
        let got = if left.is_zero() { Err(LineError::Timeout) } else { self.line.receive(left) };
        match got {
            Ok(bytes) => {
                self.held.extend(bytes);
                Ok(())
            }
            Err(e) => {
                self.out_of_step = true;
                Err(self.lost(e, question))
            }
        }
    }

    fn nonsense(&mut self, question: &str, what: &str) -> Failure {
        self.out_of_step = true;
        self.failure(Fault::Disconnected, format!("`{question}` returned {what}"))
    }

    fn lost(&self, e: LineError, about: &str) -> Failure {
        match e {
            LineError::Timeout => {
                self.failure(Fault::Timeout, format!("no reply to `{about}` before the deadline"))
            }
            LineError::Gone(why) => self.failure(Fault::Disconnected, why),
        }
    }
}
