//! Images that were requested last, so that a repeated request continues or repeats an answer.

use crate::error::ViewError;
use crate::image::Job;
use std::sync::{Arc, Mutex, PoisonError};

/// Maximum size of all kept images, in bytes. The newest image is kept in any case.
const BUDGET: usize = 96 << 20;

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
            // An image that is being computed at the moment counts as large.
            let bytes = all[at].1.try_lock().map_or(BUDGET, |job| size(&job));
            if kept >= MOST || bytes > left {
                all.remove(at);
            } else {
                left -= bytes;
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
