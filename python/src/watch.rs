//! Runs long work that reports progress to Python and stops on Ctrl-C.

use crate::off_python::fork_safe;
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;
use sunstone::polarimetry::reconstruct::learn::Onlooker;
use sunstone::{Summary, Watch};

/// Interval for checking signals and reporting progress.
const EVERY: Duration = Duration::from_millis(50);

/// State shared by the worker thread and the Python thread.
#[derive(Default)]
pub struct Shared {
    stop: AtomicBool,
    /// Number of finished tiles and total number of tiles.
    tiles: Mutex<Option<(u32, u32)>>,
    /// Total number of descents (runs of the optimizer) when a scheme is learned.
    descents: AtomicU32,
    done: AtomicU32,
    ended: Mutex<bool>,
    bell: Condvar,
    /// Python's identifier of the worker thread, if the worker calls Python.
    worker: Mutex<Option<u64>>,
}

impl Watch for Shared {
    fn tile_done(&self, s: &Summary) {
        *self.tiles.lock().unwrap_or_else(PoisonError::into_inner) = Some((s.tiles_done, s.tiles));
    }

    fn interrupted(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl Onlooker for Shared {
    fn begins(&self, descents: usize) {
        self.descents.fetch_add(descents as u32, Ordering::Relaxed);
    }

    fn descended(&self) {
        let mut news = self.tiles.lock().unwrap_or_else(PoisonError::into_inner);
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        *news = Some((done, self.descents.load(Ordering::Relaxed)));
    }

    fn interrupted(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl Shared {
    /// Waits a short time for the end of the work. Returns whether the work has ended.
    fn wait(&self) -> bool {
        let ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.bell.wait_timeout_while(ended, EVERY, |ended| !*ended);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

/// Signals the end of the work, including an end by panic.
struct Ring<'a>(&'a Shared);

impl Drop for Ring<'_> {
    fn drop(&mut self) {
        *self.0.ended.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.bell.notify_all();
    }
}

/// Runs work on another thread. The calling thread checks signals, and calls `progress(done, tiles)` after
/// each change. An exception from a signal (`KeyboardInterrupt`) or from `progress` stops the work at the
/// next tile. The function returns this exception.
pub fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Shared) -> T + Send,
) -> PyResult<T> {
    let shared = Shared::default();
    std::thread::scope(|scope| {
        let worker = scope.spawn(|| {
            let _ring = Ring(&shared);
            fork_safe(|| work(&shared))
        });
        let mut fault: Option<PyErr> = None;
        loop {
            let ended = py.detach(|| shared.wait());
            let first = fault.is_none();
            let message =
                py.check_signals().and_then(|()| if first { tell(&shared, progress) } else { Ok(()) });
            match message {
                Err(e) if first => {
                    shared.stop.store(true, Ordering::Relaxed);
                    fault = Some(e);
                }
                // This is a second Ctrl-C. The work continues until it checks the stop flag, so wait for
                // its end in any case.
                Err(_) => {
                    if let Err(e) = shared.insist(py) {
                        e.write_unraisable(py, None);
                    }
                }
                Ok(()) => {}
            }
            if ended {
                break;
            }
        }
        let done = py.detach(|| worker.join());
        match (fault, done) {
            (Some(fault), _) => Err(fault),
            (None, Ok(done)) => done,
            (None, Err(_)) => {
                Err(PyRuntimeError::new_err("internal error in Sunstone: a worker thread failed"))
            }
        }
    })
}

/// Calls `progress` if a tile was finished since the last call.
fn tell(shared: &Shared, progress: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    let news = shared.tiles.lock().unwrap_or_else(PoisonError::into_inner).take();
    if let (Some(news), Some(progress)) = (news, progress) {
        progress.call1(news)?;
    }
    Ok(())
}

/// Methods for work that calls Python itself.
impl Shared {
    /// Returns the flag that requests the work to stop.
    pub fn stop(&self) -> &AtomicBool {
        &self.stop
    }

    /// Records that the current thread does the work and calls Python. A second Ctrl-C then interrupts the
    /// running Python code.
    pub fn calls_python(&self) -> PyResult<()> {
        let ident = Python::attach(|py| py.import("threading")?.call_method0("get_ident")?.extract())?;
        *self.worker.lock().unwrap_or_else(PoisonError::into_inner) = Some(ident);
        Ok(())
    }

    /// Raises `KeyboardInterrupt` in the worker thread if the thread runs Python code.
    fn insist(&self, py: Python<'_>) -> PyResult<()> {
        let worker = *self.worker.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(ident) = worker else {
            return Ok(());
        };
        let ctypes = py.import("ctypes")?;
        let class = ctypes.call_method1("py_object", (py.get_type::<PyKeyboardInterrupt>(),))?;
        let thread = ctypes.call_method1("c_ulong", (ident,))?;
        let python = ctypes.getattr("pythonapi")?;
        python.call_method1("PyThreadState_SetAsyncExc", (thread, class))?;
        Ok(())
    }

    /// Records the number of finished tiles and of all tiles.
    pub fn tell(&self, done: u32, all: u32) {
        *self.tiles.lock().unwrap_or_else(PoisonError::into_inner) = Some((done, all));
    }
}
