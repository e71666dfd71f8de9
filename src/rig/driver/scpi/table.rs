//! Table of commands for a laser or a delay generator.

use crate::instrument::LaserLimits;
use serde::Deserialize;

/// Description of a laser by its limits and commands. `{hz}` in [`Self::set_rate`] stands for the rate in
/// hertz.
///
/// ```toml
/// # Stanford Research DG645, whose output triggers a diode laser.
/// address = "192.0.2.7:5025"
/// nm = 635
/// rate_hz = [1e-3, 1e7]
/// on = "TSRC 0"
/// off = "TSRC 5"
/// set_rate = "TRAT {hz}"
/// ask_on = "TSRC?"
/// on_answers = ["0"]
/// ask_rate = "TRAT?"
/// errors = "LERR?"
/// ```
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaserTable {
    /// Network address in the form `host:port`. The standard port of SCPI is 5025.
    pub address: String,
    /// Wavelength, in nanometres.
    pub nm: f64,
    /// Minimum and maximum pulse rate, in hertz.
    pub rate_hz: [f64; 2],
    /// Command that switches the light on.
    #[serde(default = "on")]
    pub on: String,
    /// Command that switches the light off.
    #[serde(default = "off")]
    pub off: String,
    /// Command that sets the pulse rate. Absent if the rate is fixed.
    pub set_rate: Option<String>,
    /// Query that returns whether the light is on.
    #[serde(default = "ask_on")]
    pub ask_on: String,
    /// Replies that mean that the light is on.
    #[serde(default = "on_answers")]
    pub on_answers: Vec<String>,
    /// Query that returns the pulse rate in hertz. Absent if the rate is fixed.
    pub ask_rate: Option<String>,
    /// Query that returns the mean power, in any unit. If absent, the power is assumed to be nominal.
    pub ask_power: Option<String>,
    /// Nominal power, in the unit of `ask_power`.
    pub nominal_power: Option<f64>,
    /// Query that returns whether the interlock is closed. The reply 1 or ON means closed.
    pub ask_interlock: Option<String>,
    /// Query that returns the oldest error. The reply is 0 if there is no error.
    #[serde(default = "errors")]
    pub errors: String,
    /// Whether the instrument supports `*OPC?`.
    #[serde(default = "yes")]
    pub waits: bool,
}

fn on() -> String {
    "OUTP ON".into()
}
fn off() -> String {
    "OUTP OFF".into()
}
fn ask_on() -> String {
    "OUTP?".into()
}
fn on_answers() -> Vec<String> {
    vec!["1".into(), "ON".into()]
}
fn errors() -> String {
    "SYST:ERR?".into()
}
fn yes() -> bool {
    true
}

impl LaserTable {
    /// Parses and checks a table.
    ///
    /// # Errors
    /// Returns a message with the position in the text, if a key or a value is invalid.
    pub fn parse(text: &str) -> Result<Self, String> {
        let table: Self = toml::from_str(text).map_err(|e| e.to_string())?;
        table.check()?;
        Ok(table)
    }

    pub fn limits(&self) -> LaserLimits {
        LaserLimits { nm: self.nm, rate_hz: self.rate_hz }
    }

    /// Returns the command that sets the pulse rate to `hz`, or `None` if the rate is fixed.
    pub fn rate(&self, hz: f64) -> Option<String> {
        // Every SCPI number may have an exponent.
        self.set_rate.as_ref().map(|c| c.replace("{hz}", &format!("{hz:E}")))
    }

    fn check(&self) -> Result<(), String> {
        let [least, most] = self.rate_hz;
        if !(least > 0.0 && most >= least && most.is_finite()) {
            return Err(format!(
                "`rate_hz` is [{least}, {most}]; expected the lowest and the highest rate, both above 0"
            ));
        }
        if !(self.nm > 0.0 && self.nm.is_finite()) {
            return Err(format!("`nm` is {}; expected a wavelength above 0", self.nm));
        }
        match &self.set_rate {
            None if most > least => {
                return Err("`rate_hz` is a range, but `set_rate` is missing; add `set_rate`".into());
            }
            Some(c) if c.matches("{hz}").count() != 1 => {
                return Err(format!(
                    "`set_rate` is `{c}`, but must contain {{hz}} exactly once; correct the command"
                ));
            }
            _ => {}
        }
        if self.set_rate.is_some() && self.ask_rate.is_none() {
            return Err("`set_rate` is set, but `ask_rate` is missing; set both keys".into());
        }
        if self.on_answers.is_empty() {
            return Err(
                "`on_answers` is empty; list the replies to `ask_on` that mean that the laser emits light"
                    .into(),
            );
        }
        match (&self.ask_power, self.nominal_power) {
            (None, None) => {}
            (Some(_), Some(p)) if p > 0.0 && p.is_finite() => {}
            (Some(_), Some(p)) => {
                return Err(format!("`nominal_power` is {p}; expected a finite number above 0"));
            }
            (Some(_), None) => {
                return Err(
                    "`ask_power` is set, but `nominal_power` is missing; set both, or remove both".into()
                );
            }
            (None, Some(_)) => {
                return Err(
                    "`nominal_power` is set, but `ask_power` is missing; set both, or remove both".into()
                );
            }
        }
        let optional = [&self.set_rate, &self.ask_rate, &self.ask_power, &self.ask_interlock];
        let commands = [&self.on, &self.off, &self.ask_on, &self.errors].into_iter();
        for command in commands.chain(optional.into_iter().flatten()) {
            if command.trim().is_empty() || command.contains(['\n', '\r', '\0']) {
                return Err(format!("{command:?} is not a valid command; write a command on a single line"));
            }
        }
        Ok(())
    }
}
