//! Wraps the rig's instruments as Python objects with the methods that a session calls. A Python instrument
//! can forward calls to these objects. While a session uses an instrument, no other session can use this
//! instrument.

use super::fault::{Thrown, exception};
use super::values::{Answer, Value, within};
use super::{arrays, given};
use crate::error::input;
use crate::off_python::detached;
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use sunstone::rig::instrument::{
    AreaCamera, CameraSettings, CounterSettings, Failure, GalvoScanner, PatternProjector, PhotonCounter,
    PulsedLaser, RotationStage,
};

/// An instrument that can be lent to a session.
pub struct Slot<D: ?Sized> {
    name: String,
    device: Mutex<Option<Box<D>>>,
}

impl<D: ?Sized + Send> Slot<D> {
    fn new(name: &str, device: Box<D>) -> Self {
        Self { name: name.to_owned(), device: Mutex::new(Some(device)) }
    }

    /// Takes the instrument out of the slot. Returns `None` if a session uses the instrument.
    fn take(&self) -> Option<Box<D>> {
        self.device.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Puts the instrument back into the slot.
    fn put(&self, device: Box<D>) {
        *self.device.lock().unwrap_or_else(PoisonError::into_inner) = Some(device);
    }

    /// Calls `work` with the instrument, without holding Python's lock.
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut D) -> T + Send) -> PyResult<T> {
        let done = detached(py, || {
            let mut device = self.device.lock().unwrap_or_else(PoisonError::into_inner);
            device.as_mut().map(|device| work(device))
        })?;
        done.ok_or_else(|| {
            input(format!(
                "{}: the instrument is in use by a running session; wait until the session ends",
                self.name
            ))
        })
    }

    /// Sends a request to the instrument, which can refuse the request.
    fn ask<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut D) -> Result<T, Failure> + Send,
    ) -> PyResult<T> {
        self.with(py, work)?.map_err(|failure| exception(py, &failure, ""))
    }

    /// Sends a request with a deadline in seconds to the instrument.
    fn ask_within<T: Send>(
        &self,
        py: Python<'_>,
        within_s: f64,
        work: impl FnOnce(&mut D, Duration) -> Result<T, Failure> + Send,
    ) -> PyResult<T> {
        let within = within(within_s).map_err(input)?;
        self.ask(py, |d| work(d, within))
    }
}

/// Defines a Python class for one kind of instrument. The class has the common methods and the methods of
/// this kind.
macro_rules! own {
    ($(#[$doc:meta])* $class:ident, $device:ident, $given:ident, { $($methods:tt)* }) => {
        $(#[$doc])*
        #[pyclass(frozen, module = "pysunstone._native")]
        pub struct $class(Slot<dyn $device>);

        impl $class {
            /// Wraps an instrument as a Python object.
            pub fn new(device: Box<dyn $device>) -> Self {
                let name = device.name().to_owned();
                Self(Slot::new(&name, device))
            }

            /// Takes the instrument out of an object of this class. An object of another class is used as a
            /// Python instrument.
            pub fn lend(
                name: &str,
                object: &Bound<'_, PyAny>,
                thrown: &Thrown,
            ) -> PyResult<Box<dyn $device>> {
                let Ok(own) = object.cast::<Self>() else {
                    return Ok(Box::new(given::$given::new(name, object, thrown)?));
                };
                let Slot { name, .. } = &own.get().0;
                let in_use = || input(format!("{name}: the instrument is already in use; wait until the instrument is released"));
                own.get().0.take().ok_or_else(in_use)
            }

            /// Returns the instrument to an object. Has no effect if the object is of another class.
            pub fn give_back(object: &Bound<'_, PyAny>, device: Option<Box<dyn $device>>) {
                if let (Ok(own), Some(device)) = (object.cast::<Self>(), device) {
                    own.get().0.put(device);
                }
            }
        }

        #[pymethods]
        impl $class {
            #[getter]
            fn name(&self) -> &str {
                &self.0.name
            }

            fn identify<'py>(&self, py: Python<'py>, within_s: f64) -> PyResult<Bound<'py, PyAny>> {
                self.0.ask_within(py, within_s, |d, within| d.identify(within))?.object(py)
            }

            fn reconnect(&self, py: Python<'_>, within_s: f64) -> PyResult<()> {
                self.0.ask_within(py, within_s, |d, within| d.reconnect(within))
            }

            fn temperature_c(&self, py: Python<'_>) -> PyResult<Option<f64>> {
                self.0.with(py, |d| d.temperature_c())
            }

            fn limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
                self.0.with(py, |d| d.limits())?.object(py)
            }

            fn __repr__(&self) -> String {
                format!("<{} {:?} of the rig>", stringify!($class), self.0.name)
            }

            $($methods)*
        }
    };
}

own!(
    /// A rotation stage of the rig.
    RigStage, RotationStage, Stage, {
        fn home(&self, py: Python<'_>, within_s: f64) -> PyResult<()> {
            self.0.ask_within(py, within_s, RotationStage::home)
        }

        fn begin_move(&self, py: Python<'_>, angle_deg: f64) -> PyResult<()> {
            self.0.ask(py, |d| d.begin_move(angle_deg))
        }

        fn finish_move<'py>(&self, py: Python<'py>, within_s: f64) -> PyResult<Bound<'py, PyAny>> {
            self.0.ask_within(py, within_s, RotationStage::finish_move)?.object(py)
        }

        fn read<'py>(&self, py: Python<'py>, within_s: f64) -> PyResult<Bound<'py, PyAny>> {
            self.0.ask_within(py, within_s, RotationStage::read)?.object(py)
        }

        fn stop(&self, py: Python<'_>, within_s: f64) -> PyResult<()> {
            self.0.ask_within(py, within_s, RotationStage::stop)
        }
    }
);

own!(
    /// A pattern projector of the rig.
    RigProjector, PatternProjector, Projector, {
        fn load(&self, py: Python<'_>, patterns: &Bound<'_, PyAny>, within_s: f64) -> PyResult<()> {
            let within = within(within_s).map_err(input)?;
            let patterns = arrays::patterns(patterns).map_err(input)?;
            self.0.ask(py, |d| d.load(&patterns, within))
        }

        fn show(&self, py: Python<'_>, pattern: usize, within_s: f64) -> PyResult<()> {
            self.0.ask_within(py, within_s, |d, within| d.show(pattern, within))
        }

        fn dark(&self, py: Python<'_>, within_s: f64) -> PyResult<()> {
            self.0.ask_within(py, within_s, PatternProjector::dark)
        }
    }
);

own!(
    /// An area camera of the rig.
    RigCamera, AreaCamera, Camera, {
        fn configure(&self, py: Python<'_>, settings: &Bound<'_, PyAny>, within_s: f64) -> PyResult<()> {
            let within = within(within_s).map_err(input)?;
            let settings = CameraSettings::read(&Answer(settings)).map_err(input)?;
            self.0.ask(py, |d| d.configure(&settings, within))
        }

        fn expose(&self, py: Python<'_>) -> PyResult<()> {
            self.0.ask(py, AreaCamera::expose)
        }

        fn frame(&self, py: Python<'_>, within_s: f64) -> PyResult<Py<PyAny>> {
            let frame = self.0.ask_within(py, within_s, AreaCamera::frame)?;
            arrays::of_frame(py, &self.0.name, &frame)
        }
    }
);

own!(
    /// A galvo scanner of the rig.
    RigGalvo, GalvoScanner, Galvo, {
        fn point(&self, py: Python<'_>, angles_deg: [f64; 2], within_s: f64) -> PyResult<(f64, f64)> {
            let [x, y] = self.0.ask_within(py, within_s, |d, within| d.point(angles_deg, within))?;
            Ok((x, y))
        }
    }
);

own!(
    /// A pulsed laser of the rig.
    RigLaser, PulsedLaser, Laser, {
        fn emit(&self, py: Python<'_>, on: bool, rate_hz: f64, within_s: f64) -> PyResult<()> {
            self.0.ask_within(py, within_s, |d, within| d.emit(on, rate_hz, within))
        }

        fn state<'py>(&self, py: Python<'py>, within_s: f64) -> PyResult<Bound<'py, PyAny>> {
            self.0.ask_within(py, within_s, PulsedLaser::state)?.object(py)
        }
    }
);

own!(
    /// A photon counter of the rig.
    RigCounter, PhotonCounter, Counter, {
        fn configure(&self, py: Python<'_>, settings: &Bound<'_, PyAny>, within_s: f64) -> PyResult<()> {
            let within = within(within_s).map_err(input)?;
            let settings = CounterSettings::read(&Answer(settings)).map_err(input)?;
            self.0.ask(py, |d| d.configure(&settings, within))
        }

        fn begin(&self, py: Python<'_>) -> PyResult<()> {
            self.0.ask(py, PhotonCounter::begin)
        }

        fn finish<'py>(&self, py: Python<'py>, within_s: f64) -> PyResult<Bound<'py, PyAny>> {
            let found = self.0.ask_within(py, within_s, PhotonCounter::finish)?;
            arrays::of_histogram(py, &found)
        }
    }
);
