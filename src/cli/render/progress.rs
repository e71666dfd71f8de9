//! Prints the progress of a render, and handles interruption with Ctrl-C.

use crate::progress::{INTERRUPTED, bar};
use crate::view::ViewOfRender;
use indicatif::ProgressBar;
use std::io::IsTerminal;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use sunstone::render::{Summary, Watch};

/// Prints the progress of a render. A terminal shows a bar. Any other output receives a line every few
/// seconds.
pub(super) struct Progress {
    bar: Option<ProgressBar>,
    last: Mutex<Instant>,
    /// Warnings to print after the render has started. The warnings are not printed if an error prevents the
    /// render.
    warnings: Mutex<Vec<String>>,
    /// Prefix of the progress line, such as the number of the round.
    about: Mutex<String>,
    /// The explorer, which is opened when the first tile is finished.
    pub(super) view: Option<ViewOfRender>,
}

impl Progress {
    pub(super) fn new(warnings: Vec<String>, view: Option<ViewOfRender>) -> Self {
        let bar = || bar("{bar:32} {pos}/{len} tiles  {msg}  {eta} left", 0);
        Self {
            bar: std::io::stderr().is_terminal().then(bar),
            last: Mutex::new(Instant::now()),
            warnings: Mutex::new(warnings),
            about: Mutex::default(),
            view,
        }
    }

    /// Sets the prefix of the progress line.
    pub(super) fn about(&self, what: String) {
        *self.about.lock().unwrap_or_else(PoisonError::into_inner) = what;
    }

    pub(super) fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Watch for Progress {
    fn tile_done(&self, s: &Summary) {
        let mut warnings = self.warnings.lock().unwrap_or_else(PoisonError::into_inner);
        for warning in warnings.drain(..) {
            match &self.bar {
                Some(bar) => bar.println(format!("warning: {warning}")),
                None => eprintln!("warning: {warning}"),
            }
        }
        drop(warnings);
        if let Some(view) = &self.view {
            view.open();
        }
        let rate = s.samples as f64 / s.wall_s / 1e6;
        let about = self.about.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bar) = &self.bar {
            bar.set_length(u64::from(s.tiles));
            bar.set_position(u64::from(s.tiles_done));
            bar.set_message(format!("{about}{rate:.2} Msamples/s"));
            return;
        }
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.elapsed() > Duration::from_secs(5) {
            *last = Instant::now();
            let left = f64::from(s.tiles - s.tiles_done) * s.wall_s / f64::from(s.tiles_done.max(1));
            eprintln!(
                "{about}{}/{} tiles, {rate:.2} Msamples/s, about {left:.0} s left",
                s.tiles_done, s.tiles
            );
        }
    }

    fn interrupted(&self) -> bool {
        INTERRUPTED.load(Ordering::Relaxed)
    }
}
