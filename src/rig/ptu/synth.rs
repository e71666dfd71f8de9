//! Time stamps as a counter would have sent them, of what a simulated diode counts.
//!
//! A diode that is armed anew with each pulse detects one photon a pulse at most, and pulses are alike: given the counts of
//! all bins, every way to deal them to as many different pulses is as likely as any other. So counts of [`Spad::count`] dealt
//! at random are time stamps of exactly the distribution that a loop over pulses would give, at the cost of the detections. A
//! free-running diode's dead time ties neighbours together: its counts are dealt to pulses independently, which
//! keeps histograms and loses that tie.

use optics::sampling::mix::mix;
use optics::sampling::stream::Stream;
use polarimetry::capture::detector::error::DetectorError;
use polarimetry::capture::detector::spad::{Mode, Spad};

/// A detection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp {
    /// Number of the pulse, from 0.
    pub sync: u64,
    /// Bin of the laser's period.
    pub bin: u32,
}

/// Uniform in 0 to `below`, which is above 0.
fn draw(stream: &mut Stream, below: u64) -> u64 {
    // Of 64 bits, so that no bias is left that a test could see.
    let word = [0; 3].map(|_: u8| u128::from((stream.uniform() * 16_777_216.0) as u32));
    let word = word[0] << 48 | word[1] << 24 | word[2];
    (((word >> 8) * u128::from(below)) >> 64) as u64
}

/// Deals counts of bins to pulses, in the order of time. `alone`: at most one detection a pulse; detections beyond the
/// pulses are then left out.
#[must_use]
pub fn deal(counts: &[u64], pulses: u64, alone: bool, stream: &mut Stream) -> Vec<Stamp> {
    if pulses == 0 {
        return vec![];
    }
    let bins = (0..).zip(counts).flat_map(|(bin, n)| (0..*n).map(move |_| bin));
    let mut bins: Vec<u32> = bins.collect();
    // Fisher and Yates.
    for i in (1..bins.len()).rev() {
        bins.swap(i, draw(stream, i as u64 + 1) as usize);
    }
    if alone {
        bins.truncate(usize::try_from(pulses).unwrap_or(usize::MAX));
    }
    let syncs = if alone {
        different(bins.len() as u64, pulses, stream)
    } else {
        let mut syncs: Vec<u64> = bins.iter().map(|_| draw(stream, pulses)).collect();
        syncs.sort_unstable();
        syncs
    };
    let mut stamps: Vec<Stamp> = syncs
        .into_iter()
        .zip(bins)
        .map(|(sync, bin)| Stamp { sync, bin })
        .collect();
    stamps.sort_unstable();
    stamps
}

/// `n` different numbers below `below`, which is at least `n`, in their order; all sets are as likely.
fn different(n: u64, below: u64, stream: &mut Stream) -> Vec<u64> {
    if n.saturating_mul(2) > below {
        // Selection sampling (Knuth, algorithm S).
        let mut left = n;
        let chosen = (0..below).filter(|i| {
            let take = draw(stream, below - i) < left;
            left -= u64::from(take);
            take
        });
        return chosen.collect();
    }
    // What is drawn twice is drawn again: of a set that is too small, which numbers are in is uniform at every step.
    let mut numbers = vec![];
    while (numbers.len() as u64) < n {
        let missing = n - numbers.len() as u64;
        numbers.extend((0..missing).map(|_| draw(stream, below)));
        numbers.sort_unstable();
        numbers.dedup();
    }
    numbers
}

/// Time stamps of one dwell of a diode, for rates of [`Spad::rates`]; bins are those of its period.
///
/// # Errors
/// Those of [`Spad::count`].
pub fn dwell(spad: &Spad, rates: &[f64], seed: u64, pixel: u32) -> Result<Vec<Stamp>, DetectorError> {
    let mut stream = Stream::new(mix(seed), pixel, 0);
    let counts = spad.count(rates, &mut stream)?;
    Ok(deal(
        &counts,
        spad.pulses,
        spad.mode == Mode::Synchronous,
        &mut stream,
    ))
}
