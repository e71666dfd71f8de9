//! Measures the wall-clock time and the processor time of work.

use std::ops::AddAssign;
use std::time::{Duration, Instant};

/// Frequency of the clock of processor times in `/proc`. Linux uses the same frequency on all machines.
const TICKS_PER_SECOND: u64 = 100;

/// The time that work took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    pub wall: Duration,
    /// Processor time of all threads of this process, with a resolution of 10 ms. Always zero on systems
    /// without `/proc`.
    pub processor: Duration,
}

impl AddAssign for Cost {
    fn add_assign(&mut self, other: Self) {
        self.wall += other.wall;
        self.processor += other.processor;
    }
}

/// The start of work to measure.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    begun: Instant,
    processor: Duration,
}

impl Clock {
    pub fn start() -> Self {
        Self { begun: Instant::now(), processor: processor_time().unwrap_or_default() }
    }

    /// Returns the time since the start.
    pub fn cost(self) -> Cost {
        let now = processor_time().unwrap_or_default();
        Cost { wall: self.begun.elapsed(), processor: now.saturating_sub(self.processor) }
    }
}

/// Returns the processor time that this process has used, in user mode and in the kernel.
fn processor_time() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field is the name in parentheses, which may contain spaces. Fields 14 and 15 are the times.
    let (_, fields) = text.rsplit_once(')')?;
    let mut times = fields.split_whitespace().skip(11).map(str::parse::<u64>);
    let ticks = times.next()?.ok()? + times.next()?.ok()?;
    Some(Duration::from_millis(ticks * 1000 / TICKS_PER_SECOND))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn work_takes_processor_time() {
        let clock = Clock::start();
        let mut sum = 0_u64;
        while clock.cost().processor < Duration::from_millis(50) {
            sum = (0..100_000).fold(sum, |a, b| std::hint::black_box(a ^ b));
            assert!(clock.begun.elapsed() < Duration::from_secs(60), "no processor time {sum}");
        }
    }
}
