//! A simulated board in memory that records the received commands and can simulate faults.

use super::library::{Hardware, Order, Question, Th260};
use crate::clock::locked;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// State of the simulated board.
#[derive(Debug)]
pub struct State {
    /// Serial numbers of the available boards, by index.
    pub serials: Vec<&'static str>,
    /// Model: `P` or `N`.
    pub model: &'static str,
    /// All commands received, in order.
    pub reported: Vec<Order>,
    /// Prefix of the `Debug` text of calls that fail, and the error code that these calls return.
    pub fails: Option<(&'static str, i32)>,
    pub flags: i32,
    /// Laser pulses per second.
    pub sync_rate: i32,
    bins: i32,
    until: Option<Instant>,
    dwell: i32,
}

/// A simulated library with its boards.
#[derive(Clone, Debug)]
pub struct Fake(Arc<Mutex<State>>);

impl Fake {
    /// Creates a library with one board of the given model.
    pub fn new(model: &'static str) -> Self {
        Self(Arc::new(Mutex::new(State {
            serials: vec!["1000001"],
            model,
            reported: vec![],
            fails: None,
            flags: 0,
            sync_rate: 20_000_000,
            bins: 0,
            until: None,
            dwell: 0,
        })))
    }

    /// Locks the state for reading or changing.
    pub fn state(&self) -> MutexGuard<'_, State> {
        locked(&self.0)
    }

    fn check(&self, what: &str) -> Result<MutexGuard<'_, State>, i32> {
        let state = self.state();
        match state.fails {
            Some((name, code)) if what.starts_with(name) => Err(code),
            _ => Ok(state),
        }
    }
}

impl Th260 for Fake {
    fn version(&mut self) -> Result<String, i32> {
        self.check("Version").map(|_| "3.1".into())
    }

    fn explain(&mut self, code: i32) -> String {
        format!("text of {code}")
    }

    fn open(&mut self, device: i32) -> Result<String, i32> {
        let state = self.check("Open")?;
        let serial = state.serials.get(device as usize);
        serial.map(ToString::to_string).ok_or(-1)
    }

    fn tell(&mut self, _device: i32, order: Order) -> Result<(), i32> {
        let mut state = self.check(&format!("{order:?}"))?;
        state.reported.push(order);
        match order {
            Order::Start(ms) => {
                state.until = Some(Instant::now() + Duration::from_millis(ms as u64));
                state.dwell = ms;
            }
            Order::Stop => state.until = None,
            _ => {}
        }
        Ok(())
    }

    fn ask(&mut self, _device: i32, question: Question) -> Result<i32, i32> {
        let mut state = self.check(&format!("{question:?}"))?;
        Ok(match question {
            Question::Inputs => 2,
            Question::Done => i32::from(state.until.is_none_or(|t| t <= Instant::now())),
            Question::SyncRate => state.sync_rate,
            Question::Flags => state.flags,
            Question::Length(code) => {
                state.bins = 1024 << code;
                state.bins
            }
        })
    }

    fn hardware(&mut self, _device: i32) -> Result<Hardware, i32> {
        let state = self.check("Hardware")?;
        Ok(Hardware {
            model: format!("TimeHarp 260 {}", state.model),
            part: "930031".into(),
            version: "1.0".into(),
        })
    }

    fn base_resolution(&mut self, _device: i32) -> Result<(f64, i32), i32> {
        let state = self.check("Base")?;
        Ok((if state.model == "P" { 25.0 } else { 250.0 }, 22))
    }

    fn elapsed_ms(&mut self, _device: i32) -> Result<f64, i32> {
        self.check("Elapsed").map(|s| f64::from(s.dwell))
    }

    fn histogram(&mut self, _device: i32, channel: i32) -> Result<Vec<u32>, i32> {
        drop(self.check("Histogram")?);
        Ok((0..32_768).map(|k| k + 1000 * (channel as u32 + 1)).collect())
    }
}
