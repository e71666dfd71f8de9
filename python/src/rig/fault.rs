//! Converts between Python exceptions of instruments and failures of a session.

use pyo3::exceptions::{PyConnectionError, PyException, PyOSError, PyTimeoutError};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use sunstone::rig::instrument::{Failure, Fault};

/// Name of the Python module that defines the instrument classes.
pub const HOME: &str = "pysunstone.rig.instruments";

/// The exception that caused the last failure of any instrument in a session. This exception becomes the
/// cause of the exception that the session raises.
#[derive(Clone, Default)]
pub struct Thrown(Arc<Mutex<Option<(Failure, PyErr)>>>);

impl Thrown {
    /// Converts an exception to a failure:
    ///
    /// - An `InstrumentError` states its fault.
    /// - Timeouts become timeout failures.
    /// - `OSError`, including the errors of pyserial and PyUSB, becomes a disconnected failure.
    /// - All other exceptions are reported to the user without a retry.
    pub fn failure(&self, py: Python<'_>, instrument: &str, method: &str, error: PyErr) -> Failure {
        let failure = describe(py, instrument, &error).unwrap_or_else(|| {
            let fault = if error.is_instance_of::<PyTimeoutError>(py) || of_name(py, &error, "TimeoutError") {
                Fault::Timeout
            } else if error.is_instance_of::<PyConnectionError>(py) || error.is_instance_of::<PyOSError>(py) {
                Fault::Disconnected
            } else {
                Fault::Refused
            };
            Failure::new(fault, instrument, format!("`{method}` raised {error}"))
        });
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((failure.clone(), error));
        failure
    }

    /// Returns the exception, with its cause, for a failure that ended a session. If the cause is a
    /// request to exit and not an `Exception`, returns the cause itself.
    pub fn raise(&self, py: Python<'_>, failure: &Failure, rest: &str) -> PyErr {
        let last = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        let cause = last.filter(|(of, _)| of == failure).map(|(_, cause)| cause);
        match cause {
            Some(cause) if !cause.is_instance_of::<PyException>(py) => cause,
            cause => {
                let error = exception(py, failure, rest);
                if cause.is_some() {
                    error.set_cause(py, cause);
                }
                error
            }
        }
    }
}

/// Converts a failure to a Python `InstrumentError`, and appends `rest` to the text of the error.
pub fn exception(py: Python<'_>, failure: &Failure, rest: &str) -> PyErr {
    let made = py.import(HOME).and_then(|m| {
        let class = m.getattr("InstrumentError")?;
        class.call1((failure.fault.name(), &failure.what, &failure.instrument, rest))
    });
    match made {
        Ok(error) => PyErr::from_value(error),
        Err(error) => error,
    }
}

/// Reads the failure from an `InstrumentError`.
fn describe(py: Python<'_>, instrument: &str, error: &PyErr) -> Option<Failure> {
    let class = py.import(HOME).ok()?.getattr("InstrumentError").ok()?;
    let value = error.value(py);
    if !value.is_instance(&class).ok()? {
        return None;
    }
    let word: String = value.getattr("fault").ok()?.extract().ok()?;
    let fault = Fault::ALL.into_iter().find(|f| f.name() == word)?;
    let what: String = value.getattr("what").ok()?.extract().ok()?;
    Some(Failure::new(fault, instrument, what))
}

/// Returns whether an exception has a base class with this name. The function compares names, because
/// asyncio's timeout is a separate class before Python 3.11.
fn of_name(py: Python<'_>, error: &PyErr, name: &str) -> bool {
    let classes = error.get_type(py).mro();
    let mut names = classes.iter().filter_map(|c| c.getattr("__name__").ok()?.extract::<String>().ok());
    names.any(|n| n == name)
}
