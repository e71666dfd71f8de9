//! Time: that of the wall, and one that passes as fast as it is asked to, in which a night takes a minute.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A clock. All parts of a rig share one.
#[derive(Clone, Debug)]
pub enum Clock {
    /// The machine's.
    Real(Instant),
    /// A clock that stands still but for who waits.
    Simulated(Arc<Mutex<Simulated>>),
}

/// A simulated clock's state.
#[derive(Clone, Copy, Debug)]
pub struct Simulated {
    now: Duration,
    /// What the wall's clock is ahead of the run's, seconds; jumps where somebody sets it.
    wall_offset_s: f64,
}

/// When simulated nights begin: 2026-01-01 00:00 UTC, seconds since 1970.
const SIMULATED_EPOCH_S: f64 = 1_767_225_600.0;

impl Clock {
    /// The machine's clock, from now on.
    #[must_use]
    pub fn real() -> Self {
        Self::Real(Instant::now())
    }

    /// A clock at zero that only waiting moves.
    #[must_use]
    pub fn simulated() -> Self {
        Self::Simulated(Arc::new(Mutex::new(Simulated {
            now: Duration::ZERO,
            wall_offset_s: SIMULATED_EPOCH_S,
        })))
    }

    /// Time since the clock was made; it never goes backward.
    #[must_use]
    pub fn now(&self) -> Duration {
        match self {
            Self::Real(begun) => begun.elapsed(),
            Self::Simulated(state) => locked(state).now,
        }
    }

    /// Seconds since 1970 by the wall's clock, which can jump.
    #[must_use]
    pub fn wall_s(&self) -> f64 {
        match self {
            Self::Real(_) => SystemTime::now()
                .duration_since(UNIX_EPOCH)
                .map_or(0.0, |d| d.as_secs_f64()),
            Self::Simulated(state) => {
                let state = locked(state);
                state.wall_offset_s + state.now.as_secs_f64()
            }
        }
    }

    /// Waits.
    pub fn sleep(&self, time: Duration) {
        match self {
            Self::Real(_) => std::thread::sleep(time),
            Self::Simulated(state) => {
                let mut state = locked(state);
                state.now = state.now.saturating_add(time);
            }
        }
    }

    /// Waits until [`Self::now`] says so.
    pub fn sleep_until(&self, then: Duration) {
        self.sleep(then.saturating_sub(self.now()));
    }

    /// Somebody sets the wall's clock; only of a simulated one.
    pub fn jump(&self, seconds: f64) {
        if let Self::Simulated(state) = self {
            locked(state).wall_offset_s += seconds;
        }
    }

    /// Whether a night takes a minute.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        matches!(self, Self::Simulated(_))
    }
}

/// A lock whose holder cannot leave it half done.
pub(crate) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_simulated_night_takes_no_time_and_the_wall_may_jump() {
        let clock = Clock::simulated();
        let same = clock.clone();
        clock.sleep(Duration::from_secs(25_200));
        assert_eq!(same.now(), Duration::from_secs(25_200));
        let wall = clock.wall_s();
        same.jump(-3600.0);
        assert!((clock.wall_s() - wall + 3600.0).abs() < 1e-3);
        same.sleep_until(Duration::from_secs(1));
        assert_eq!(clock.now(), Duration::from_secs(25_200));
    }
}
