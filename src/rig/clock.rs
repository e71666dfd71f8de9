//! Clocks of a rig. A clock is the machine's clock, or a simulated clock that advances only while an
//! instrument waits.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A clock, which all instruments of a rig share.
#[derive(Clone, Debug)]
pub enum Clock {
    /// The machine's clock, with the instant at which the rig's clock was created.
    Real(Instant),
    /// A clock that advances only by [`Clock::sleep`].
    Simulated(Arc<Mutex<Simulated>>),
}

/// The state of a simulated clock.
#[derive(Clone, Copy, Debug)]
pub struct Simulated {
    now: Duration,
    /// Wall time minus run time, in seconds. [`Clock::jump`] changes the offset.
    wall_offset_s: f64,
}

/// Wall time at which a simulated clock starts, in seconds since 1970. The time is 2026-01-01 00:00 UTC.
const SIMULATED_EPOCH_S: f64 = 1_767_225_600.0;

impl Clock {
    /// Creates a clock that starts now and follows the machine's clock.
    pub fn real() -> Self {
        Self::Real(Instant::now())
    }

    /// Creates a simulated clock at zero.
    pub fn simulated() -> Self {
        Self::Simulated(Arc::new(Mutex::new(Simulated {
            now: Duration::ZERO,
            wall_offset_s: SIMULATED_EPOCH_S,
        })))
    }

    /// Returns the time since the creation of the clock. This time never decreases.
    pub fn now(&self) -> Duration {
        match self {
            Self::Real(begun) => begun.elapsed(),
            Self::Simulated(state) => locked(state).now,
        }
    }

    /// Returns the wall time in seconds since 1970. The wall time can jump.
    pub fn wall_s(&self) -> f64 {
        match self {
            Self::Real(_) => SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64()),
            Self::Simulated(state) => {
                let state = locked(state);
                state.wall_offset_s + state.now.as_secs_f64()
            }
        }
    }

    /// Waits in real time, or advances the simulated time.
    pub fn sleep(&self, time: Duration) {
        match self {
            Self::Real(_) => std::thread::sleep(time),
            Self::Simulated(state) => {
                let mut state = locked(state);
                state.now = state.now.saturating_add(time);
            }
        }
    }

    /// Waits until [`Self::now`] reaches `then`.
    pub fn sleep_until(&self, then: Duration) {
        self.sleep(then.saturating_sub(self.now()));
    }

    /// Moves the wall time of a simulated clock, as if a user had set the clock. Has no effect on a
    /// real clock.
    pub fn jump(&self, seconds: f64) {
        if let Self::Simulated(state) = self {
            locked(state).wall_offset_s += seconds;
        }
    }
}

/// Locks a mutex and ignores poisoning, because no code that holds the lock leaves the data inconsistent.
pub(crate) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_time_is_instant_and_the_wall_clock_can_jump() {
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
