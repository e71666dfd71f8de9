//! Triggers, which are output pulses of the controller and inputs that begin patterns.
//!
//! Edges of the outputs are set in steps of 107.2 ns, from 20.05 µs before to 2.787 µs after the start of the
//! pattern. Output 1 has a rising and a falling edge. Output 2 has only a rising edge. The delay of input 1
//! is at most 2¹⁹ - 1 steps. The source is "Trigger controls" in the DLPC350 programmer's guide (DLPU010).
//! The ranges are those of TI's own program.

use super::command::{Begin, Command};
use serde::Deserialize;

/// Time step, in microseconds.
const STEP_US: f64 = 0.1072;
/// Earliest edge relative to the start of the pattern, in microseconds.
const EARLIEST_US: f64 = -20.05;
/// Number of steps from the earliest to the latest edge.
const LATEST: f64 = 213.0;
/// Maximum delay, in steps of [`STEP_US`].
const LONGEST: f64 = 524_287.0;

/// Edges of an output, in microseconds from the start of the pattern.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Output {
    /// Whether the output is active low.
    pub active_low: bool,
    /// Time of the rising edge.
    pub rise_us: f64,
    /// Time of the falling edge, for output 1 only.
    pub fall_us: f64,
}

/// An edge that begins a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Edge {
    /// An edge from low to high.
    Rising,
    /// An edge from high to low.
    Falling,
}

/// Input 1, which begins patterns.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    pub edge: Edge,
    /// Delay from the edge to the start of the pattern, in microseconds.
    #[serde(default)]
    pub delay_us: f64,
}

/// All triggers. If an output is absent, the controller keeps the settings of this output. Without an input,
/// the controller's clock begins patterns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Triggers {
    /// Output 1: a pulse per pattern.
    pub output_1: Option<Output>,
    /// Output 2: a pulse at the start of the sequence.
    pub output_2: Option<Output>,
    /// External trigger that begins patterns.
    pub input: Option<Input>,
}

fn edge(us: f64, what: &str) -> Result<u8, String> {
    let steps = ((us - EARLIEST_US) / STEP_US).round();
    if (0.0..=LATEST).contains(&steps) {
        return Ok(steps as u8);
    }
    Err(format!("{what} is {us} µs; expected {EARLIEST_US} to 2.787 µs"))
}

impl Triggers {
    /// Returns the trigger that begins a pattern.
    pub fn begin(&self) -> Begin {
        match self.input.map(|i| i.edge) {
            None => Begin::Internal,
            Some(Edge::Rising) => Begin::Rising,
            Some(Edge::Falling) => Begin::Falling,
        }
    }

    /// Returns the commands that set the triggers while the sequence is stopped.
    ///
    /// # Errors
    /// Returns a message that names the time, if a time is out of range.
    pub fn commands(&self) -> Result<Vec<Command>, String> {
        let mut all = vec![];
        if let Some(o) = &self.output_1 {
            all.push(Command::TriggerOut1 {
                inverted: o.active_low,
                rise: edge(o.rise_us, "output_1.rise_us")?,
                fall: edge(o.fall_us, "output_1.fall_us")?,
            });
        }
        if let Some(o) = &self.output_2 {
            if o.fall_us != 0.0 {
                return Err("output_2 has no adjustable falling edge; remove fall_us".into());
            }
            all.push(Command::TriggerOut2 {
                inverted: o.active_low,
                rise: edge(o.rise_us, "output_2.rise_us")?,
            });
        }
        if let Some(i) = &self.input {
            let steps = (i.delay_us / STEP_US).round();
            if !(0.0..=LONGEST).contains(&steps) {
                return Err(format!("input.delay_us is {}; expected 0 to 56203 µs", i.delay_us));
            }
            all.push(Command::TriggerIn1(steps as u32));
        }
        Ok(all)
    }
}
