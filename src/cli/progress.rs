//! Prints the progress of a command's renders, and handles interruption with Ctrl-C.

use indicatif::{ProgressBar, ProgressStyle};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use sunstone::render::{Summary, Watch};

/// Whether the user pressed Ctrl-C.
pub static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Installs the Ctrl-C handler. The first Ctrl-C sets [`INTERRUPTED`]. The second Ctrl-C exits immediately.
/// `what` is the name, in the message, of the work that is finished before the exit.
pub fn stop_on_interrupt(what: &'static str) {
    // Python runs several commands in one process. The flag of an earlier command must not stop a later
    // command.
    INTERRUPTED.store(false, Ordering::Relaxed);
    let _ = ctrlc::set_handler(move || {
        if INTERRUPTED.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        eprintln!("finishing {what} (press Ctrl-C again to exit immediately)");
    });
}

/// Creates a progress bar.
pub fn bar(template: &str, length: u64) -> ProgressBar {
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(length).with_style(style)
}

/// Prints the progress of a render every few seconds, and stops the render if the user pressed Ctrl-C.
pub struct Progress {
    last: Mutex<Instant>,
}

impl Progress {
    /// Creates the progress of renders. Ctrl-C then stops a render after the current tiles.
    pub fn start() -> Self {
        stop_on_interrupt("running tiles");
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
