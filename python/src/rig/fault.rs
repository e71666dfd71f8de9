//! Exceptions of instruments that are written in Python as failures of a session, and failures as exceptions.

use pyo3::exceptions::{PyConnectionError, PyException, PyOSError, PyTimeoutError};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use sunstone::rig::instrument::{Failure, Fault};

/// Where Python keeps what is named here.
pub const HOME: &str = "pysunstone.rig.instruments";

/// The exception behind the last failure of any instrument of a session, so that it can be told as that failure's cause.
#[derive(Clone, Default)]
pub struct Thrown(Arc<Mutex<Option<(Failure, PyErr)>>>);

impl Thrown {
    /// What an exception means to a session: what `InstrumentError` says; a timeout; a line that is gone (`OSError`, and so
    /// pyserial's and PyUSB's errors); all others are told to the user, since trying again does not fix a program.
    pub fn failure(&self, py: Python<'_>, instrument: &str, method: &str, error: PyErr) -> Failure {
        let failure = told(py, instrument, &error).unwrap_or_else(|| {
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

    /// The exception of a session that a failure ended: with its cause, or the cause itself where that is no `Exception` but
    /// Python's wish to end.
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

/// A failure as Python's `InstrumentError`; `rest` is said after it.
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

/// What an `InstrumentError` says itself.
fn told(py: Python<'_>, instrument: &str, error: &PyErr) -> Option<Failure> {
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

/// Whether an exception has a class of a name among its own: asyncio's timeout is Python's from 3.11 on.
fn of_name(py: Python<'_>, error: &PyErr, name: &str) -> bool {
    let classes = error.get_type(py).mro();
    let mut names = classes
        .iter()
        .filter_map(|c| c.getattr("__name__").ok()?.extract::<String>().ok());
    names.any(|n| n == name)
}
