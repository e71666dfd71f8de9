//! An emulated controller that follows the guide and can simulate faults.

use super::super::line::LineError;
use super::command::{Entry, Mailbox, Question};
use super::hid::{Assembler, HidLine, Message, REPORT};
use super::projector::SHORTEST_US;
use crate::clock::locked;
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

/// A fault that the emulator can simulate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Trouble {
    #[default]
    None,
    /// The controller does not reply.
    Silent,
    /// The controller refuses every command.
    Refuses,
    /// Noise precedes every reply.
    Noise,
    /// The cable is disconnected.
    Out,
    Aborts,
}

/// The pattern that the mirrors display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Light {
    pub image: u8,
    pub entry: Entry,
}

#[derive(Debug, Default)]
struct State {
    trouble: Trouble,
    images: u8,
    pattern_mode: bool,
    flash: bool,
    trigger: u8,
    /// Data of the last trigger commands, with the command codes as keys.
    triggers: BTreeMap<u16, Vec<u8>>,
    times: [u32; 2],
    config: [u8; 4],
    mailbox: u8,
    table: Vec<u8>,
    list: Vec<u8>,
    leds: u8,
    /// Number of status queries that the emulator answers with "in progress" before it reports `valid`.
    busy: u8,
    valid: Option<u8>,
    running: bool,
    parser: Assembler,
    answers: VecDeque<[u8; REPORT]>,
}

/// An emulated controller. All clones share one state.
#[derive(Clone, Debug, Default)]
pub struct Emulator(Arc<Mutex<State>>);

impl Emulator {
    /// Creates a controller with `images` images in flash.
    pub fn new(images: u8) -> Self {
        let emulator = Self::default();
        emulator.state().images = images;
        emulator
    }

    fn state(&self) -> MutexGuard<'_, State> {
        locked(&self.0)
    }

    /// Returns the state unless the cable is disconnected.
    fn connected(&self) -> Result<MutexGuard<'_, State>, LineError> {
        let state = self.state();
        if state.trouble == Trouble::Out {
            return Err(LineError::Gone("cable disconnected".into()));
        }
        Ok(state)
    }

    /// Sets the fault.
    pub fn trouble(&self, trouble: Trouble) {
        self.state().trouble = trouble;
    }

    /// Returns the data of the last trigger command with this code.
    pub fn trigger(&self, code: u16) -> Option<Vec<u8>> {
        self.state().triggers.get(&code).cloned()
    }

    /// Returns the light that the controller projects, or `None` if it projects no light.
    pub fn light(&self) -> Option<Light> {
        let state = self.state();
        let entry = state.table.first_chunk::<3>().map(|b| Entry::read(*b))?;
        let shines = state.running && state.leds == 8 && entry.leds != 0;
        let image = *state.list.first()?;
        shines.then_some(Light { image, entry })
    }
}

impl State {
    /// Executes a command. Returns `None` if the command is unknown or not allowed in the present state.
    fn describe(&mut self, code: u16, data: &[u8]) -> Option<()> {
        let first = *data.first()?;
        // While a sequence runs, only stopping the sequence and switching LEDs are allowed.
        if self.running && code != 0x1A24 && code != 0x1A07 {
            return None;
        }
        // A changed setting invalidates the last validation.
        let valid = self.valid.filter(|_| matches!(code, 0x1A24 | 0x1A07));
        match (code, data) {
            (0x1A1B, _) => self.pattern_mode = first == 1,
            (0x1A22, _) => self.flash = first == 3,
            (0x1A23, _) => self.trigger = first,
            (0x1A1D, [_, ..=0xD5, ..=0xD5])
            | (0x1A1E, [_, ..=0xD5])
            | (0x1A35, [_, _, ..8, 0])
            | (0x1A36, [_]) => {
                self.triggers.insert(code, data.to_vec());
            }
            (0x1A24, _) if first == 2 => {
                // Only a validated sequence can start.
                if self.valid.is_none_or(|v| v & 3 != 0) || self.busy > 0 {
                    return None;
                }
                self.running = self.trouble != Trouble::Aborts;
            }
            (0x1A24, _) => self.running = false,
            (0x1A29, _) => {
                let time = |at: usize| data.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes);
                self.times = [time(0)?, time(4)?];
            }
            (0x1A31, _) => self.config = *data.first_chunk::<4>()?,
            (0x1A32, _) if first == 0 => {}
            (0x1A33, _) => self.mailbox = first,
            (0x1A34, _) if self.mailbox == Mailbox::Images as u8 => self.list = data.to_vec(),
            (0x1A34, _) if self.mailbox == Mailbox::Patterns as u8 => self.table = data.to_vec(),
            (0x1A07, _) => self.leds = first,
            (0x1A1A, _) => {
                self.valid = Some(self.check());
                self.busy = 2;
                return Some(());
            }
            _ => return None,
        }
        self.valid = valid;
        Some(())
    }

    /// Returns the validation bits.
    fn check(&self) -> u8 {
        let [exposure, period] = self.times;
        let times = exposure >= SHORTEST_US && (period == exposure || period >= exposure.saturating_add(230));
        let entries = usize::from(self.config[0]) + 1;
        let good = |b: &[u8]| {
            let entry = Entry::read([b[0], b[1], b[2]]);
            (1..=8).contains(&entry.bits) && u32::from(entry.plane) <= 24 / u32::from(entry.bits)
        };
        let table = self.table.len() == 3 * entries && self.table.chunks_exact(3).all(good);
        let list = self.list.len() == usize::from(self.config[3]) + 1
            && self.list.iter().all(|i| *i < self.images.max(1));
        let mode = self.pattern_mode && self.flash && self.trigger == 1 && self.mailbox == 0;
        u8::from(!times) | u8::from(!(table && list && mode)) << 1
    }

    fn asked(&mut self, code: u16) -> Option<Vec<u8>> {
        let all = [
            Question::Hardware,
            Question::Main,
            Question::Validation,
            Question::Images,
            Question::Version,
            Question::Tag,
        ];
        Some(match all.into_iter().find(|q| *q as u16 == code)? {
            Question::Hardware => vec![if self.trouble == Trouble::Aborts { 0x41 } else { 1 }],
            Question::Main => vec![u8::from(self.running) << 1],
            Question::Validation if self.busy > 0 => {
                self.busy -= 1;
                vec![0x80]
            }
            Question::Validation => vec![self.valid?],
            Question::Images => vec![self.images],
            Question::Version => vec![0, 0, 1, 3, 0, 0, 0, 3, 0, 0, 0, 3, 0, 0, 0, 3],
            Question::Tag => {
                let mut tag = b"SUNSTONE-EMULATED".to_vec();
                tag.resize(33, 0);
                tag
            }
        })
    }
}

impl HidLine for Emulator {
    fn write(&mut self, report: &[u8; REPORT]) -> Result<(), LineError> {
        let state = &mut *self.connected()?;
        let Some(message) = state.parser.feed(report) else {
            return Ok(());
        };
        if state.trouble == Trouble::Silent {
            return Ok(());
        }
        let done = match message.payload.split_first_chunk::<2>() {
            Some((code, data)) if state.trouble != Trouble::Refuses => {
                let code = u16::from_le_bytes(*code);
                if message.read { state.asked(code) } else { state.describe(code, data).map(|()| vec![]) }
            }
            _ => None,
        };
        if state.trouble == Trouble::Noise {
            let noise = message.number.wrapping_mul(37);
            state.answers.push_back([noise | 0x1; REPORT]);
        }
        let answer = Message { refused: done.is_none(), payload: done.unwrap_or_default(), ..message };
        state.answers.extend(answer.reports());
        Ok(())
    }

    fn read(&mut self, within: Duration) -> Result<[u8; REPORT], LineError> {
        let answer = self.connected()?.answers.pop_front();
        answer.ok_or_else(|| {
            std::thread::sleep(within);
            LineError::Timeout
        })
    }

    fn reopen(&mut self) -> Result<(), LineError> {
        let mut state = self.connected()?;
        state.answers.clear();
        state.parser.clear();
        Ok(())
    }
}
