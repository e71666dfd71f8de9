//! Computes a time histogram for each channel, and for each pixel of a scan, in one pass over a file's
//! records.
//!
//! Each photon requires two table look-ups (the channel's first bin and the bin of the photon's time), one
//! comparison and one addition. Photons outside the histogram are counted separately for each reason for
//! exclusion ([`LeftOut`]).

use super::error::PtuError;
use super::reader::Reader;
use super::record::{Layout, Mode, Parts, RecordType, with_layout};
use super::scan::{Beam, Scan};
use std::io::Read;

/// Maximum number of elements of a histogram, equal to 2 GiB.
pub const MOST: usize = 1 << 29;

/// A bin index that is greater than the last bin of any histogram.
const NOWHERE: u32 = 1 << 30;

/// Binning, channels and pixels of a histogram.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Width of a bin, in time counts of the file.
    pub bin: u32,
    pub bins: usize,
    /// Channels in the order of the result. A repeated channel is counted at its first position.
    pub channels: Vec<u8>,
    /// The scan, if the histogram has counts per pixel.
    pub scan: Option<Scan>,
}

impl Plan {
    /// Returns the number of bins in one laser period, including a partial last bin.
    ///
    /// If the header has no laser period, the bins cover all times that T3 records can represent. In T2,
    /// the bins then cover 32768 counts.
    pub fn period_bins<R: Read>(reader: &Reader<R>, bin: u32) -> usize {
        let (record, header) = (reader.record_type(), reader.header());
        let all = f64::from(record.dtimes());
        let period = match record.mode() {
            Mode::T3 => header.global_resolution_s(),
            Mode::T2 => header.number("TTResult_SyncRate").filter(|n| *n > 0.0).map(|n| 1.0 / n),
        };
        let counts = period.zip(header.resolution_s(record.mode())).map(|(p, r)| (p / r - 1e-6).ceil());
        let counts = counts.filter(|n| (1.0..=all).contains(n)).unwrap_or(all);
        (counts / f64::from(bin.max(1))).ceil() as usize
    }

    fn pixels(&self) -> Option<usize> {
        self.scan.map_or(Some(1), |s| s.width.checked_mul(s.height))
    }

    /// Returns the reason why the plan is invalid, and the fix. Returns `None` if the plan is valid.
    fn fault(&self, record: RecordType) -> Option<(String, String)> {
        let elements = self.bins.checked_mul(self.channels.len());
        let elements = elements.zip(self.pixels()).and_then(|(row, pixels)| row.checked_mul(pixels));
        let channels = record.channels();
        if self.bin == 0 || elements == Some(0) {
            return Some((
                format!(
                    "the histogram has no elements: {} channels, {} bins of width {} and {} pixels",
                    self.channels.len(),
                    self.bins,
                    self.bin,
                    self.pixels().unwrap_or(usize::MAX)
                ),
                "use at least one channel, one bin and one pixel, and a bin width above 0".into(),
            ));
        }
        if let Some(c) = self.channels.iter().find(|c| **c >= channels) {
            let what = format!("record type {} has no channel {c}", record.name());
            return Some((what, format!("use channels 0 to {}", channels - 1)));
        }
        elements.is_none_or(|n| n > MOST).then(|| {
            (
                format!("the histogram would have more than {MOST} elements"),
                "use wider bins, or fewer channels or pixels".into(),
            )
        })
    }
}

/// Numbers of photons outside the histogram. Each photon is counted once, for the first reason that applies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Number of photons of channels that the plan does not include.
    pub channels: u64,
    /// Number of photons before the first pixel, between pixels, and after the last pixel.
    pub pixels: u64,
    /// Number of photons before the first sync pulse (T2).
    pub before_sync: u64,
    /// Number of photons after the last bin.
    pub later: u64,
    /// The latest time of the photons counted in [`Self::later`], in time counts since the sync pulse.
    pub latest: u64,
    /// Number of photons of a first frame whose first lines or pixels are missing. The pixels of these
    /// photons are unknown.
    pub torn_frame: u64,
}

impl LeftOut {
    /// Returns the total number of excluded photons.
    pub fn photons(&self) -> u64 {
        self.channels + self.pixels + self.before_sync + self.later + self.torn_frame
    }

    /// Returns a text that lists the nonzero counts of excluded photons, each with its reason. `resolution_s`
    /// is the duration of a time count in seconds.
    pub fn describe(&self, resolution_s: Option<f64>) -> String {
        let latest = match resolution_s {
            Some(s) => format!("{:.3} ns", self.latest as f64 * s * 1e9),
            None => format!("{} counts", self.latest),
        };
        let kinds = [
            (self.channels, "in other channels".to_owned()),
            (self.pixels, "outside the pixels of the scan".to_owned()),
            (self.before_sync, "before the first sync pulse".to_owned()),
            (self.later, format!("after the last bin (up to {latest} after the pulse)")),
            (self.torn_frame, "in an incomplete first frame".to_owned()),
        ];
        let kinds = kinds.iter().filter(|(n, _)| *n > 0);
        let kinds: Vec<String> = kinds.map(|(n, kind)| format!("{n} {kind}")).collect();
        kinds.join(", ")
    }
}

/// The result of [`histogram`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Histograms {
    /// Rows, columns, channels and bins. Without a scan there is one row and one column.
    pub shape: [usize; 4],
    /// Counts. The last axis varies fastest.
    pub counts: Vec<u32>,
    pub photons: u64,
    pub left_out: LeftOut,
    /// Number of pixels (scan by pixels) or lines (scan by lines) that begin after the last pixel or line of
    /// their frame.
    pub beyond: u64,
    /// Number of pixels or lines that are missing in the last frame.
    pub missing: usize,
    pub unknown: u64,
}

impl Histograms {
    /// Returns the number of photons in the histogram.
    pub fn counted(&self) -> u64 {
        self.counts.iter().map(|n| u64::from(*n)).sum()
    }
}

/// Look-up tables and the state of the pass over the records.
struct State {
    /// Index of each channel's first bin within a pixel.
    first: [u32; 64],
    /// For each value of a T3 record's `dtime`, the index of its bin.
    bin_of: Vec<u32>,
    bin: u64,
    bins: u64,
    row: u32,
    counts: Vec<u32>,
    beam: Beam,
    overflow: u64,
    sync: Option<u64>,
    photons: u64,
    unknown: u64,
    syncs: u64,
    left_out: LeftOut,
}

fn count<L: Layout, const TIMED: bool>(state: &mut State, block: &[[u8; 4]]) {
    let State { first, bin_of, counts, left_out, .. } = state;
    // With a fixed length that matches the index mask, the compiler removes the bounds check.
    let Some(bin_of) = bin_of.first_chunk::<{ 1 << 15 }>() else {
        unreachable!("the table has an entry for every dtime");
    };
    let (mut beam, mut overflow, mut sync) = (state.beam, state.overflow, state.sync);
    let (bin, bins, row) = (state.bin, state.bins, state.row);
    // Index of the first element and number of elements of the current pixel. The number is zero while the
    // beam is outside all pixels.
    let place = |beam: &Beam| beam.pixel.map_or((0, 0), |p| (p * row as usize, row));
    let (mut base, mut room) = place(&beam);
    let (mut others, mut unknown, mut syncs) = (0, 0, 0);
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
                // In T2, the time is `None` before the first sync pulse.
                let since = if L::T2 {
                    let now = overflow.saturating_add(u64::from(time));
                    sync.and_then(|s| now.checked_sub(s))
                } else {
                    Some(u64::from(dtime))
                };
                let later = if L::T2 {
                    let bin = since.map(|d| d / bin).filter(|b| *b < bins);
                    bin.map_or(NOWHERE, |b| b as u32)
                } else {
                    bin_of[dtime as usize & 0x7fff]
                };
                let begin = first[channel as usize & 63];
                let slot = begin + later;
                if slot < room {
                    let count = &mut counts[base + slot as usize];
                    *count = count.saturating_add(1);
                } else if begin == NOWHERE {
                    left_out.channels += 1;
                } else if room == 0 {
                    left_out.pixels += 1;
                } else if let Some(since) = since {
                    left_out.later += 1;
                    left_out.latest = since.max(left_out.latest);
                } else {
                    left_out.before_sync += 1;
                }
            }
            Parts::Overflow(more) => {
                overflow = overflow.saturating_add(more);
                others += 1;
            }
            Parts::Marker { time, bits } => {
                beam.marker(overflow.saturating_add(u64::from(time)), bits);
                if beam.torn {
                    beam.torn = false;
                    left_out.torn_frame += counts.iter().map(|n| u64::from(*n)).sum::<u64>();
                    counts.fill(0);
                }
                (base, room) = place(&beam);
                others += 1;
            }
            Parts::Sync { time } => {
                sync = Some(overflow.saturating_add(u64::from(time)));
                syncs += 1;
            }
            Parts::Unknown => unknown += 1,
        }
    }
    (state.beam, state.overflow, state.sync) = (beam, overflow, sync);
    state.photons += block.len() as u64 - others - syncs - unknown;
    state.unknown += unknown;
    state.syncs += syncs;
}

/// Counts a file's photons from the reader's position to the end.
///
/// In T2, a photon's time is the time since the last sync pulse. An incomplete first frame is excluded if
/// more than one line (or pixel) is missing.
///
/// # Errors
/// Returns [`PtuError`] in these cases:
/// - the plan does not fit the file or exceeds [`MOST`];
/// - a bin has 2³² − 1 counts or more;
/// - no photon is in any bin (the error states the reason);
/// - the system cannot read the file.
pub fn histogram<R: Read>(reader: &mut Reader<R>, plan: &Plan) -> Result<Histograms, PtuError> {
    let (found, nothing) = possibly_empty_histogram(reader, plan)?;
    nothing.map_or(Ok(found), Err)
}

/// Computes a histogram as [`histogram`] does, but accepts a histogram without photons, such as that of a
/// dark pixel. If there are no photons, the second value is the reason.
///
/// # Errors
/// Returns the same errors as [`histogram`], except for an empty histogram.
pub fn possibly_empty_histogram<R: Read>(
    reader: &mut Reader<R>,
    plan: &Plan,
) -> Result<(Histograms, Option<PtuError>), PtuError> {
    let record = reader.record_type();
    let file = reader.file().to_owned();
    if let Some((what, fix)) = plan.fault(record) {
        return Err(PtuError::of_request(&file, what, fix));
    }
    let row = plan.bins * plan.channels.len();
    let elements = row * plan.pixels().unwrap_or(1);
    let mut counts = Vec::new();
    counts
        .try_reserve_exact(elements)
        .map_err(|_| PtuError::of_request(&file, "not enough memory for the histogram", "use wider bins"))?;
    counts.resize(elements, 0);
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
        syncs: 0,
        left_out: LeftOut::default(),
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
    if state.counts.contains(&u32::MAX) {
        let what = format!("a bin has {} or more counts", u32::MAX);
        return Err(PtuError::of_request(&file, what, "use narrower bins"));
    }
    let empty = (state.photons == state.left_out.photons()).then(|| {
        let resolution = reader.header().resolution_s(record.mode());
        let (what, fix) = nothing(plan, &state, record, resolution);
        PtuError::of_request(&file, what, fix)
    });
    let (height, width) = plan.scan.map_or((1, 1), |s| (s.height, s.width));
    let found = Histograms {
        shape: [height, width, plan.channels.len(), plan.bins],
        counts: state.counts,
        photons: state.photons,
        left_out: state.left_out,
        beyond: state.beam.beyond,
        missing: if state.beam.begins > 0 { state.beam.missing } else { 0 },
        unknown: state.unknown,
    };
    Ok((found, empty))
}

/// Returns the reason why no photon is in any bin, and the fix.
fn nothing(plan: &Plan, state: &State, record: RecordType, resolution_s: Option<f64>) -> (String, String) {
    if state.photons == 0 {
        let what = format!("the file contains no photons ({} records of unknown type)", state.unknown);
        return (what, "check that the measurement ran and the file is complete".into());
    }
    if let Some(scan) = plan.scan.filter(|_| state.beam.begins == 0) {
        let what = format!(
            "marker {}, which begins each {}, does not occur in the file",
            scan.clock.begin.trailing_zeros() + 1,
            if state.beam.is_timed() { "line" } else { "pixel" },
        );
        return (
            what,
            "list the markers in the file with `sunstone ptu info`, and pass their numbers".into(),
        );
    }
    if record.mode() == Mode::T2 && state.syncs == 0 {
        let fix = "connect the laser to the sync input; `sunstone ptu records` prints absolute times";
        return (
            "there are no sync pulses, so the time between a photon and the preceding pulse is unknown"
                .into(),
            fix.into(),
        );
    }
    (
        format!(
            "none of the {} photons is in a bin of the histogram: {}",
            state.photons,
            state.left_out.describe(resolution_s)
        ),
        "use other channels, bins or pixels".into(),
    )
}
