//! Synthesizes time stamps from the bin counts of a simulated single-photon avalanche diode.
//!
//! A diode that is rearmed at each pulse detects at most one photon per pulse, and all pulses are
//! equivalent. Given the counts of all bins, every assignment to distinct pulses is equally likely. A
//! random assignment of the counts of a simulated diode therefore has exactly the same distribution as a
//! simulation of each pulse. The cost is proportional to the number of detections.
//!
//! The dead time of a free-running diode correlates neighbouring detections. The counts of a free-running
//! diode are assigned to pulses independently. The independent assignment preserves histograms but not the
//! correlation.

use optics::sampling::stream::Stream;

/// A detection, given by its pulse and its bin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp {
    /// Number of the pulse, from 0.
    pub sync: u64,
    /// Bin within the laser's period.
    pub bin: u32,
}

/// Returns a uniform random integer in [0, `below`). `below` must be positive.
fn draw(stream: &mut Stream, below: u64) -> u64 {
    // With 64 random bits, the bias is too small to be detected.
    let word = [0; 3].map(|_: u8| u128::from((stream.uniform() * 16_777_216.0) as u32));
    let word = word[0] << 48 | word[1] << 24 | word[2];
    (((word >> 8) * u128::from(below)) >> 64) as u64
}

/// Assigns the counts of bins to pulses at random and returns the time stamps in order of time. If `alone` is
/// true, each pulse has at most one detection, and excess detections are dropped.
pub fn deal(counts: &[u64], pulses: u64, alone: bool, stream: &mut Stream) -> Vec<Stamp> {
    if pulses == 0 {
        return vec![];
    }
    let bins = (0..).zip(counts).flat_map(|(bin, n)| (0..*n).map(move |_| bin));
    let mut bins: Vec<u32> = bins.collect();
    // Fisher–Yates shuffle.
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
    let mut stamps: Vec<Stamp> = syncs.into_iter().zip(bins).map(|(sync, bin)| Stamp { sync, bin }).collect();
    stamps.sort_unstable();
    stamps
}

/// Returns `n` ≤ `below` distinct integers in [0, `below`) in ascending order. All sets are equally likely.
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
    // Redraw duplicates. By symmetry the set is uniform at every step.
    let mut numbers = vec![];
    while (numbers.len() as u64) < n {
        let missing = n - numbers.len() as u64;
        numbers.extend((0..missing).map(|_| draw(stream, below)));
        numbers.sort_unstable();
        numbers.dedup();
    }
    numbers
}
