//! Images that were requested last, so that a repeated request continues or repeats an answer.

use crate::error::ViewError;
use crate::image::Job;
use std::sync::{Arc, Mutex, PoisonError};

/// Maximum size of all kept images, in bytes. The newest images are kept in any case: the page continues up
/// to three at the same time, an image, its comparison and the time bins.
const BUDGET: usize = 96 << 20;
const NEWEST: usize = 3;

/// Maximum number of kept images. Each request that the user abandons leaves one.
const MOST: usize = 16;

/// Images by the text of their requests, oldest first.
#[derive(Default)]
pub(crate) struct Jobs(Mutex<Vec<(String, Arc<Mutex<Job>>)>>);

impl Jobs {
    /// Returns the image of a request, or starts it.
    pub(crate) fn get(
        &self,
        key: &str,
        start: impl FnOnce() -> Result<Job, ViewError>,
    ) -> Result<Arc<Mutex<Job>>, ViewError> {
        let take = |all: &mut Vec<(String, Arc<Mutex<Job>>)>| {
            let at = all.iter().position(|(k, _)| k == key)?;
            let found = all.remove(at);
            all.push(found.clone());
            Some(found.1)
        };
        if let Some(job) = take(&mut self.lock()) {
            return Ok(job);
        }
        let size = |job: &Job| job.bytes();
        let new = start()?;
        let mut all = self.lock();
        let mut left = BUDGET.saturating_sub(size(&new));
        let mut kept = 1;
        let mut at = all.len();
        while at > 0 {
            at -= 1;
            let bytes = all[at].1.lock().map_or(BUDGET, |job| size(&job));
            if kept >= NEWEST && (kept >= MOST || bytes > left) {
                all.remove(at);
            } else {
                left = left.saturating_sub(bytes);
                kept += 1;
            }
        }
        let job = Arc::new(Mutex::new(new));
        all.push((key.to_owned(), job.clone()));
        Ok(job)
    }

    /// Forgets an image, because its store has changed.
    pub(crate) fn forget(&self, key: &str) {
        self.lock().retain(|(k, _)| k != key);
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<(String, Arc<Mutex<Job>>)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
