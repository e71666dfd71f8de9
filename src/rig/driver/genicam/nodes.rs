//! Access to the features of a camera by their names. `cameleon` evaluates the camera's XML. The driver does
//! not cache values.

use crate::instrument::{Failure, Fault};
use cameleon::genapi::{FromXml, GenApiError, NoCacheGenApiCtxt, Node, ParamsCtxt};
use cameleon::{ControlError, ControlResult, DeviceControl};

/// A line that reads and writes registers.
pub type Control = Box<dyn DeviceControl + Send>;

type Params<'a> = ParamsCtxt<&'a mut (dyn DeviceControl + Send), &'a mut NoCacheGenApiCtxt>;

/// Features of a camera.
pub struct Nodes {
    name: String,
    control: Control,
    context: NoCacheGenApiCtxt,
}

/// Returns the fault for an error of the line.
fn of_control(error: &ControlError) -> Fault {
    match error {
        ControlError::Timeout => Fault::Timeout,
        ControlError::Busy | ControlError::InvalidDevice(_) => Fault::Refused,
        _ => Fault::Disconnected,
    }
}

/// Returns the fault for an error of a feature.
fn of_feature(error: &GenApiError) -> Fault {
    match error {
        GenApiError::Device(inner) => {
            let line = inner.downcast_ref::<ControlError>();
            line.map_or(Fault::Disconnected, of_control)
        }
        GenApiError::InvalidData(_) => Fault::Limit,
        _ => Fault::Refused,
    }
}

impl Nodes {
    /// Opens the line and reads the camera's feature description.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `disconnected` or `timeout`
    /// - `refused`: the camera is in use, or its XML is invalid
    pub fn open(name: &str, mut control: Control) -> Result<Self, Failure> {
        let message = |e: ControlError| Failure::new(of_control(&e), name, e.to_string());
        if !control.is_opened() {
            control.open().map_err(message)?;
        }
        let xml = control.genapi().map_err(message)?;
        let context = NoCacheGenApiCtxt::from_xml(&xml).map_err(|e| {
            let what = format!("cannot parse the description of the camera: {e}");
            Failure::new(Fault::Refused, name, what)
        })?;
        Ok(Self { name: name.to_owned(), control, context })
    }

    /// Returns the camera's name in the rig file.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns an error with a failure of this camera.
    pub fn fail<T>(&self, fault: Fault, what: impl Into<String>) -> Result<T, Failure> {
        Err(self.failure(fault, what))
    }

    pub fn failure(&self, fault: Fault, what: impl Into<String>) -> Failure {
        Failure::new(fault, &self.name, what)
    }

    /// Calls a function with direct access to the line.
    pub fn line<T>(
        &mut self,
        doing: &str,
        f: impl FnOnce(&mut dyn DeviceControl) -> ControlResult<T>,
    ) -> Result<T, Failure> {
        let found = f(self.control.as_mut());
        found.map_err(|e| self.failure(of_control(&e), format!("{doing}: {e}")))
    }

    pub fn control(&mut self) -> &mut dyn DeviceControl {
        self.control.as_mut()
    }

    pub fn has(&mut self, feature: &str) -> bool {
        self.params().node(feature).is_some()
    }

    fn params(&mut self) -> Params<'_> {
        ParamsCtxt { ctrl: self.control.as_mut(), ctxt: &mut self.context }
    }

    /// Calls `f` with a feature of the camera. `f` returns `None` if the feature has an unexpected type.
    fn with<T>(
        &mut self,
        feature: &str,
        f: impl FnOnce(Node, &mut Params<'_>) -> Option<Result<T, GenApiError>>,
    ) -> Result<T, Failure> {
        let mut params = self.params();
        let Some(node) = params.node(feature) else {
            return self.fail(Fault::Refused, format!("the camera has no feature {feature}"));
        };
        match f(node, &mut params) {
            None => {
                self.fail(Fault::Refused, format!("the camera's feature {feature} has an unexpected type"))
            }
            Some(Err(e)) => self.fail(of_feature(&e), format!("{feature}: {e}")),
            Some(Ok(value)) => Ok(value),
        }
    }

    pub fn integer(&mut self, feature: &str) -> Result<i64, Failure> {
        self.with(feature, |n, p| n.as_integer(p).map(|n| n.value(p)))
    }

    /// Sets an integer feature.
    ///
    /// # Errors
    /// Returns a [`Failure`] of kind `limit` if the value is outside the feature's range, or an error of the
    /// line.
    pub fn set_integer(&mut self, feature: &str, value: i64) -> Result<(), Failure> {
        self.with(feature, |n, p| n.as_integer(p).map(|n| n.set_value(p, value)))
    }

    /// Returns the increment of an integer feature, or 1 if the feature has no increment.
    pub fn step(&mut self, feature: &str) -> Result<u32, Failure> {
        let step = self.with(feature, |n, p| n.as_integer(p).map(|n| n.inc(p)))?;
        Ok(u32::try_from(step.unwrap_or(1)).unwrap_or(1).max(1))
    }

    /// Returns the minimum and maximum of a numeric feature.
    pub fn range(&mut self, feature: &str) -> Result<[f64; 2], Failure> {
        self.with(feature, |n, p| {
            if let Some(n) = n.as_float(p) {
                return Some(n.min(p).and_then(|least| Ok([least, n.max(p)?])));
            }
            let n = n.as_integer(p)?;
            Some(n.min(p).and_then(|least| Ok([least as f64, n.max(p)? as f64])))
        })
    }

    /// Returns the value of a numeric feature.
    pub fn number(&mut self, feature: &str) -> Result<f64, Failure> {
        self.with(feature, |n, p| {
            if let Some(n) = n.as_float(p) {
                return Some(n.value(p));
            }
            Some(n.as_integer(p)?.value(p).map(|v| v as f64))
        })
    }

    /// Sets a numeric feature.
    ///
    /// # Errors
    /// Returns a [`Failure`] of kind `limit` if the value is outside the feature's range, or an error of the
    /// line.
    pub fn set_number(&mut self, feature: &str, value: f64) -> Result<(), Failure> {
        self.with(feature, |n, p| {
            if let Some(n) = n.as_float(p) {
                return Some(n.set_value(p, value));
            }
            Some(n.as_integer(p)?.set_value(p, value.round() as i64))
        })
    }

    pub fn text(&mut self, feature: &str) -> Result<String, Failure> {
        let text = self.with(feature, |n, p| n.as_string(p).map(|n| n.value(p)))?;
        Ok(text.trim_end_matches('\0').trim().to_owned())
    }

    /// Returns the names of the entries of an enumeration.
    pub fn entries(&mut self, feature: &str) -> Result<Vec<String>, Failure> {
        self.with(feature, |n, p| {
            let entries = n.as_enumeration(p)?.entries(p);
            Some(Ok(entries.iter().map(|e| e.symbolic(p).to_owned()).collect()))
        })
    }

    /// Selects an entry of an enumeration feature.
    ///
    /// # Errors
    ///
    /// Returns a [`Failure`] of kind `limit` if the feature does not have the entry, or an error of the line.
    pub fn choose(&mut self, feature: &str, entry: &str) -> Result<(), Failure> {
        let entries = self.entries(feature)?;
        if !entries.iter().any(|e| e == entry) {
            let what = format!(
                "the camera's feature {feature} does not support {entry}; available: {}",
                entries.join(", ")
            );
            return self.fail(Fault::Limit, what);
        }
        self.with(feature, |n, p| n.as_enumeration(p).map(|n| n.set_entry_by_symbolic(p, entry)))
    }

    /// Selects an entry of an enumeration feature if the camera has the feature and the entry.
    pub fn choose_if(&mut self, feature: &str, entry: &str) -> Result<(), Failure> {
        if self.has(feature) && self.entries(feature)?.iter().any(|e| e == entry) {
            self.choose(feature, entry)?;
        }
        Ok(())
    }

    pub fn command(&mut self, feature: &str) -> Result<(), Failure> {
        self.with(feature, |n, p| n.as_command(p).map(|n| n.execute(p)))
    }
}
