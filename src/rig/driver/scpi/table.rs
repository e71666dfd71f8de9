//! The table of a laser's, or a delay generator's, commands.

use crate::instrument::LaserLimits;
use serde::Deserialize;

/// A laser in words: what it can do, and how it is told. `{hz}` in [`Self::set_rate`] is the rate.
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
    /// Where it listens, `host:port`; SCPI's own port is 5025.
    pub address: String,
    /// Wavelength, nanometres.
    pub nm: f64,
    /// Least and greatest rate of pulses, hertz.
    pub rate_hz: [f64; 2],
    /// Light on.
    #[serde(default = "on")]
    pub on: String,
    /// Light off.
    #[serde(default = "off")]
    pub off: String,
    /// Sets the rate; none where there is but one.
    pub set_rate: Option<String>,
    /// Asks whether light is on.
    #[serde(default = "ask_on")]
    pub ask_on: String,
    /// Answers that say so.
    #[serde(default = "on_answers")]
    pub on_answers: Vec<String>,
    /// Asks for the rate in hertz; none where there is but one.
    pub ask_rate: Option<String>,
    /// Asks for the mean power, in any unit; without it the power is taken for nominal.
    pub ask_power: Option<String>,
    /// The power that is nominal, in that unit.
    pub nominal_power: Option<f64>,
    /// Asks whether the interlock is closed, answered like [`Self::ask_on`] by 1 or ON.
    pub ask_interlock: Option<String>,
    /// Asks for the oldest error, 0 if there is none.
    #[serde(default = "errors")]
    pub errors: String,
    /// Whether it knows `*OPC?`.
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
    /// Reads and checks a table.
    ///
    /// # Errors
    /// In words, with the place in the text.
    pub fn parse(text: &str) -> Result<Self, String> {
        let table: Self = toml::from_str(text).map_err(|e| e.to_string())?;
        table.check()?;
        Ok(table)
    }

    /// What it can do.
    #[must_use]
    pub fn limits(&self) -> LaserLimits {
        LaserLimits {
            nm: self.nm,
            rate_hz: self.rate_hz,
        }
    }

    /// The command that sets a rate.
    #[must_use]
    pub fn rate(&self, hz: f64) -> Option<String> {
        // Exponents are part of every number of SCPI's.
        self.set_rate
            .as_ref()
            .map(|c| c.replace("{hz}", &format!("{hz:E}")))
    }

    fn check(&self) -> Result<(), String> {
        let [least, most] = self.rate_hz;
        if !(least > 0.0 && most >= least && most.is_finite()) {
            return Err(format!(
                "`rate_hz` is [{least}, {most}]; give the least and the greatest rate, both above 0"
            ));
        }
        if !(self.nm > 0.0 && self.nm.is_finite()) {
            return Err(format!("`nm` is {}; give a wavelength above 0", self.nm));
        }
        match &self.set_rate {
            None if most > least => {
                return Err("`rate_hz` is a range, and there is no `set_rate`; give one".into());
            }
            Some(c) if c.matches("{hz}").count() != 1 => {
                return Err(format!(
                    "`set_rate` is `{c}`; write {{hz}} once, where the rate stands"
                ));
            }
            _ => {}
        }
        if self.set_rate.is_some() && self.ask_rate.is_none() {
            return Err("there is `set_rate` and no `ask_rate`; give both".into());
        }
        if self.on_answers.is_empty() {
            return Err("`on_answers` is empty; give what `ask_on` answers if light is on".into());
        }
        match (&self.ask_power, self.nominal_power) {
            (None, None) => {}
            (Some(_), Some(p)) if p > 0.0 && p.is_finite() => {}
            _ => {
                return Err(
                    "`ask_power` and `nominal_power` (above 0) go together; give both or none".into(),
                );
            }
        }
        let optional = [
            &self.set_rate,
            &self.ask_rate,
            &self.ask_power,
            &self.ask_interlock,
        ];
        let commands = [&self.on, &self.off, &self.ask_on, &self.errors].into_iter();
        for command in commands.chain(optional.into_iter().flatten()) {
            if command.trim().is_empty() || command.contains(['\n', '\r', '\0']) {
                return Err(format!("{command:?} is no command; write one line"));
            }
        }
        Ok(())
    }
}
