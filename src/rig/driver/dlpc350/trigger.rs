//! Triggers: pulses that the controller gives with every pattern, and those that it waits for.
//!
//! Edges of outputs are set in steps of 107.2 ns, from 20.05 µs before the pattern to 2.787 µs after its begin (output 1: rising
//! and falling edge, output 2: rising alone), the delay of input 1 in the same steps up to 2¹⁹ - 1 of them (DLPC350
//! programmer's guide, DLPU010, "Trigger controls"; ranges as TI's own program has them).

use super::command::{Begin, Command};
use serde::Deserialize;

/// Step of all times, microseconds.
const STEP_US: f64 = 0.1072;
/// Earliest edge, microseconds from the pattern's begin.
const EARLIEST_US: f64 = -20.05;
/// Steps from there to the latest.
const LATEST: f64 = 213.0;
/// Steps of the longest delay.
const LONGEST: f64 = 524_287.0;

/// An output's edges, microseconds from the pattern's begin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Output {
    /// Low while it is active.
    pub active_low: bool,
    /// When it becomes active.
    pub rise_us: f64,
    /// When it ends; of output 1 alone.
    pub fall_us: f64,
}

/// An edge that begins a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Edge {
    /// From low to high.
    Rising,
    /// From high to low.
    Falling,
}

/// Input 1, which begins patterns.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Which edge.
    pub edge: Edge,
    /// From it to the pattern's begin, microseconds.
    #[serde(default)]
    pub delay_us: f64,
}

/// All triggers; what is left out stays as the controller has it, and without an input its own clock begins patterns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Triggers {
    /// Output 1: every pattern.
    pub output_1: Option<Output>,
    /// Output 2: the begin of the sequence.
    pub output_2: Option<Output>,
    /// What begins patterns from outside.
    pub input: Option<Input>,
}

fn edge(us: f64, what: &str) -> Result<u8, String> {
    let steps = ((us - EARLIEST_US) / STEP_US).round();
    if (0.0..=LATEST).contains(&steps) {
        return Ok(steps as u8);
    }
    Err(format!("{what} is {us} µs; give {EARLIEST_US} to 2.787 µs"))
}

impl Triggers {
    /// What begins a pattern.
    #[must_use]
    pub fn begin(&self) -> Begin {
        match self.input.map(|i| i.edge) {
            None => Begin::Internal,
            Some(Edge::Rising) => Begin::Rising,
            Some(Edge::Falling) => Begin::Falling,
        }
    }

    /// What tells the controller so, while its sequence stands.
    ///
    /// # Errors
    /// In words: times that it does not have.
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
                return Err("output_2 has no falling edge to set; leave fall_us out".into());
            }
            all.push(Command::TriggerOut2 {
                inverted: o.active_low,
                rise: edge(o.rise_us, "output_2.rise_us")?,
            });
        }
        if let Some(i) = &self.input {
            let steps = (i.delay_us / STEP_US).round();
            if !(0.0..=LONGEST).contains(&steps) {
                return Err(format!("input.delay_us is {}; give 0 to 56203 µs", i.delay_us));
            }
            all.push(Command::TriggerIn1(steps as u32));
        }
        Ok(all)
    }
}
