//! Work that tells Python how far it is, and that Ctrl-C ends.

use crate::off_python::fork_safe;
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;
use sunstone::polarimetry::reconstruct::learn::Onlooker;
use sunstone::{Summary, Watch};

/// How often signals are looked for and progress is told.
const EVERY: Duration = Duration::from_millis(50);

/// What the thread that works and the one of Python tell each other.
#[derive(Default)]
pub struct Shared {
    stop: AtomicBool,
    /// Tiles done, and tiles in all.
    tiles: Mutex<Option<(u32, u32)>>,
    /// Descents in all, of what is learned.
    descents: AtomicU32,
    done: AtomicU32,
    ended: Mutex<bool>,
    bell: Condvar,
    /// The thread that works, as Python numbers it, where it calls Python.
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
    /// True once the work has ended; waits a little for it.
    fn wait(&self) -> bool {
        let ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.bell.wait_timeout_while(ended, EVERY, |ended| !*ended);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

/// Says that the work has ended, also where it panics.
struct Ring<'a>(&'a Shared);

impl Drop for Ring<'_> {
    fn drop(&mut self) {
        *self.0.ended.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.bell.notify_all();
    }
}

/// Does work on a thread of its own, while this one looks for signals and calls `progress(done, tiles)` where there are news. A
/// signal's exception (`KeyboardInterrupt`), or one that `progress` raises, ends the work at the next tile and is the result.
pub fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&dyn Watch) -> T + Send,
) -> PyResult<T> {
    looked_on(py, progress, |shared| work(shared))
}

/// As [`watched`], of work that tells of other things than tiles.
pub fn looked_on<T: Send>(
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
            let told = py
                .check_signals()
                .and_then(|()| if first { tell(&shared, progress) } else { Ok(()) });
            match told {
                Err(e) if first => {
                    shared.stop.store(true, Ordering::Relaxed);
                    fault = Some(e);
                }
                // A second Ctrl-C. The work goes on until it sees it, and is waited for in any case.
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
            (None, Err(_)) => Err(PyRuntimeError::new_err(
                "the work failed; this is a bug of Sunstone",
            )),
        }
    })
}

/// Calls `progress`, if a tile has been finished since the last time.
fn tell(shared: &Shared, progress: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    let news = shared.tiles.lock().unwrap_or_else(PoisonError::into_inner).take();
    if let (Some(news), Some(progress)) = (news, progress) {
        progress.call1(news)?;
    }
    Ok(())
}

/// Of work that calls Python itself.
impl Shared {
    /// True once the work is to end.
    pub fn stop(&self) -> &AtomicBool {
        &self.stop
    }

    /// Notes that this thread works and calls Python: a second Ctrl-C then ends that call.
    pub fn calls_python(&self) -> PyResult<()> {
        let ident = Python::attach(|py| py.import("threading")?.call_method0("get_ident")?.extract())?;
        *self.worker.lock().unwrap_or_else(PoisonError::into_inner) = Some(ident);
        Ok(())
    }

    /// Raises `KeyboardInterrupt` in the thread that works, if that runs code of Python.
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

    /// Notes how far the work is.
    pub fn tell(&self, done: u32, all: u32) {
        *self.tiles.lock().unwrap_or_else(PoisonError::into_inner) = Some((done, all));
    }
}
