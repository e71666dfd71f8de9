//! Time histograms of a file: by channel, and by pixel of a scan, in one pass over its records.
//!
//! A photon costs two looks into tables (where its channel's bins begin, which bin its time is in), one comparison (whether it
//! is asked for) and one addition; only markers and overflows branch. What is not asked for goes to one element beyond
//! the last, so that the loop need not know.

use super::error::PtuError;
use super::reader::Reader;
use super::record::{Layout, Mode, Parts, RecordType, with_layout};
use super::scan::{Beam, Scan};
use std::io::Read;

/// Most elements of a histogram: 2 GiB.
pub const MOST: usize = 1 << 29;

/// Beyond every histogram.
const NOWHERE: u32 = 1 << 30;

/// What to count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Width of a bin: so many of the file's own counts.
    pub bin: u32,
    /// Bins.
    pub bins: usize,
    /// Channels, in the order of the result; one named twice is counted at its first place.
    pub channels: Vec<u8>,
    /// By pixel, if there is a scan.
    pub scan: Option<Scan>,
}

impl Plan {
    /// Bins of one laser period, as far as the header tells, else of all times that records hold (T2: 32768).
    #[must_use]
    pub fn period_bins<R: Read>(reader: &Reader<R>, bin: u32) -> usize {
        let (record, header) = (reader.record_type(), reader.header());
        let all = f64::from(record.dtimes());
        let period = match record.mode() {
            Mode::T3 => header.global_resolution_s(),
            Mode::T2 => header
                .int("TTResult_SyncRate")
                .filter(|n| *n > 0)
                .map(|n| 1.0 / n as f64),
        };
        let counts = period
            .zip(header.resolution_s(record.mode()))
            .map(|(p, r)| (p / r + 1e-6).floor());
        let counts = counts.filter(|n| (1.0..=all).contains(n)).unwrap_or(all);
        (counts / f64::from(bin.max(1))).ceil() as usize
    }

    fn pixels(&self) -> Option<usize> {
        self.scan.map_or(Some(1), |s| s.width.checked_mul(s.height))
    }

    /// Why it cannot be, and what to do.
    fn fault(&self, record: RecordType) -> Option<(String, String)> {
        let elements = self.bins.checked_mul(self.channels.len());
        let elements = elements
            .zip(self.pixels())
            .and_then(|(row, pixels)| row.checked_mul(pixels));
        let channels = record.channels();
        if self.bin == 0 || elements == Some(0) {
            return Some((
                "there is nothing to count".into(),
                "ask for at least one channel, bin and pixel, of a width above 0".into(),
            ));
        }
        if let Some(c) = self.channels.iter().find(|c| **c >= channels) {
            let what = format!("{} has no channel {c}", record.name());
            return Some((what, format!("its channels are 0 to {}", channels - 1)));
        }
        elements.is_none_or(|n| n > MOST).then(|| {
            (
                format!("its histogram would have more than {MOST} elements"),
                "take wider bins, or fewer channels or pixels".into(),
            )
        })
    }
}

/// What was counted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Histograms {
    /// Rows, columns, channels, bins; one row and column without a scan.
    pub shape: [usize; 4],
    /// Counts, the last axis fastest.
    pub counts: Vec<u32>,
    /// Photons of the file, those of other channels, later bins and between pixels too.
    pub photons: u64,
    /// Records that mean nothing.
    pub unknown: u64,
}

impl Histograms {
    /// Photons that are in the histogram.
    #[must_use]
    pub fn counted(&self) -> u64 {
        self.counts.iter().map(|n| u64::from(*n)).sum()
    }
}

/// Tables, and what changes while records go by.
struct State {
    /// Where the bins of a channel begin in those of a pixel.
    first: [u32; 64],
    /// Bin of a T3 record's time.
    bin_of: Vec<u32>,
    bin: u64,
    bins: u64,
    /// Elements of a pixel.
    row: u32,
    counts: Vec<u32>,
    beam: Beam,
    overflow: u64,
    sync: Option<u64>,
    photons: u64,
    unknown: u64,
}

/// Counts one block.
fn count<L: Layout, const TIMED: bool>(state: &mut State, block: &[[u8; 4]]) {
    let State {
        first,
        bin_of,
        counts,
        ..
    } = state;
    // Of a length that masks keep to, so that no bound is checked.
    let Some(bin_of) = bin_of.first_chunk::<{ 1 << 15 }>() else {
        return;
    };
    let (mut beam, mut overflow, mut sync) = (state.beam, state.overflow, state.sync);
    let (bin, bins, row) = (state.bin, state.bins, state.row);
    let nowhere = counts.len() - 1;
    // Elements of the pixel where the beam is: none, if it is nowhere.
    let place = |beam: &Beam| beam.pixel.map_or((0, 0), |p| (p * row as usize, row));
    let (mut base, mut room) = place(&beam);
    let (mut others, mut unknown) = (0, 0);
    for record in block {
        match L::split(u32::from_le_bytes(*record)) {
            Parts::Photon { time, dtime, channel } => {
                if TIMED {
                    let now = overflow.saturating_add(u64::from(time));
                    if now < beam.during[0] || now >= beam.during[1] {
                        beam.advance(now);
                        (base, room) = place(&beam);
                    }
                }
                let later = if L::T2 {
                    let now = overflow.saturating_add(u64::from(time));
                    let since = sync.and_then(|s| now.checked_sub(s)).map(|d| d / bin);
                    since.filter(|b| *b < bins).map_or(NOWHERE, |b| b as u32)
                } else {
                    bin_of[dtime as usize & 0x7fff]
                };
                let slot = first[channel as usize & 63] + later;
                let element = if slot < room {
                    base + slot as usize
                } else {
                    nowhere
                };
                counts[element] = counts[element].saturating_add(1);
            }
            Parts::Overflow(more) => {
                overflow = overflow.saturating_add(more);
                others += 1;
            }
            Parts::Marker { time, bits } => {
                beam.marker(overflow.saturating_add(u64::from(time)), bits);
                (base, room) = place(&beam);
                others += 1;
            }
            Parts::Sync { time } => {
                sync = Some(overflow.saturating_add(u64::from(time)));
                others += 1;
            }
            Parts::Unknown => unknown += 1,
        }
    }
    (state.beam, state.overflow, state.sync) = (beam, overflow, sync);
    state.photons += block.len() as u64 - others - unknown;
    state.unknown += unknown;
}

/// Counts a file's photons, from where the reader is to its end.
///
/// In T2 a photon's time is that since the last sync pulse.
///
/// # Errors
/// [`PtuError`]: a plan that the file cannot serve or that is larger than [`MOST`], a bin of 2³² − 1 counts or more, the system.
pub fn histogram<R: Read>(reader: &mut Reader<R>, plan: &Plan) -> Result<Histograms, PtuError> {
    let record = reader.record_type();
    let file = reader.file().to_owned();
    if let Some((what, mend)) = plan.fault(record) {
        return Err(PtuError::of_request(&file, what, mend));
    }
    let row = plan.bins * plan.channels.len();
    let elements = row * plan.pixels().unwrap_or(1);
    let mut counts = Vec::new();
    counts.try_reserve_exact(elements + 1).map_err(|_| {
        PtuError::of_request(
            &file,
            "there is not the memory for its histogram",
            "take wider bins",
        )
    })?;
    counts.resize(elements + 1, 0);
    let mut first = [NOWHERE; 64];
    for (i, channel) in plan.channels.iter().enumerate().rev() {
        first[usize::from(*channel & 63)] = (i * plan.bins) as u32;
    }
    let mut bin_of = vec![NOWHERE; 1 << 15];
    for (dtime, bin) in (0..).zip(bin_of.iter_mut()) {
        let at = dtime / plan.bin;
        if (at as usize) < plan.bins {
            *bin = at;
        }
    }
    let mut state = State {
        first,
        bin_of,
        bin: u64::from(plan.bin),
        bins: plan.bins as u64,
        row: row as u32,
        counts,
        beam: Beam::new(plan.scan),
        overflow: 0,
        sync: None,
        photons: 0,
        unknown: 0,
    };
    let timed = state.beam.is_timed();
    loop {
        let block = reader.block()?;
        if block.is_empty() {
            break;
        }
        let state = &mut state;
        if timed {
            with_layout!(record, count[true](state, block));
        } else {
            with_layout!(record, count[false](state, block));
        }
    }
    let mut counts = state.counts;
    counts.pop();
    if counts.contains(&u32::MAX) {
        let what = format!("a bin has {} counts or more", u32::MAX);
        return Err(PtuError::of_request(&file, what, "take narrower bins"));
    }
    let (height, width) = plan.scan.map_or((1, 1), |s| (s.height, s.width));
    Ok(Histograms {
        shape: [height, width, plan.channels.len(), plan.bins],
        counts,
        photons: state.photons,
        unknown: state.unknown,
    })
}
