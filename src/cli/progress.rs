//! Progress of a command's renders, and interruption with Ctrl-C.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use sunstone::render::{Summary, Watch};

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Prints the progress of a render every few seconds, and interrupts it on request.
pub struct Progress {
    last: Mutex<Instant>,
}

impl Progress {
    /// Installs the Ctrl-C handler: the first Ctrl-C stops after the current tiles, the second exits
    /// immediately.
    pub fn start() -> Self {
        let _ = ctrlc::set_handler(|| {
            if INTERRUPTED.swap(true, Ordering::Relaxed) {
                std::process::exit(130);
            }
            eprintln!("finishing running tiles (press Ctrl-C again to exit immediately)");
        });
        Self { last: Mutex::new(Instant::now()) }
    }
}

impl Watch for Progress {
    fn tile_done(&self, s: &Summary) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.elapsed() > Duration::from_secs(10) {
            *last = Instant::now();
            eprintln!("rendering: {} of {} tiles", s.tiles_done, s.tiles);
        }
    }

    fn interrupted(&self) -> bool {
        INTERRUPTED.load(Ordering::Relaxed)
    }
}
