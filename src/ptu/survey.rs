//! Statistics of a file's records in constant memory.

use super::error::PtuError;
use super::reader::Reader;
use super::record::Event;
use std::io::Read;

/// Number of a file's records of each kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Survey {
    pub photons: [u64; 64],
    /// Number of markers at each input. A record with two markers counts for both inputs.
    pub markers: [u64; 4],
    /// Number of sync pulses (T2).
    pub syncs: u64,
    pub overflows: u64,
    pub unknown: u64,
    /// For each channel, the largest time since a sync pulse (T3).
    pub last_dtime: [u32; 64],
    /// Time of the last record, in counts of the time tag.
    pub duration: u64,
}

impl Survey {
    /// Returns the channels that have photons.
    pub fn channels(&self) -> Vec<u8> {
        (0..64).filter(|c| self.photons[usize::from(*c)] > 0).collect()
    }
}

/// Counts a file's records from the reader's position to the end.
///
/// # Errors
/// Returns [`PtuError`] if the system cannot read the file.
pub fn survey<R: Read>(reader: &mut Reader<R>) -> Result<Survey, PtuError> {
    let mut survey = Survey {
        photons: [0; 64],
        markers: [0; 4],
        syncs: 0,
        overflows: 0,
        unknown: 0,
        last_dtime: [0; 64],
        duration: 0,
    };
    reader.events(|event| {
        survey.duration = match event {
            Event::Photon { time, dtime, channel } => {
                let c = usize::from(channel & 63);
                survey.photons[c] += 1;
                survey.last_dtime[c] = survey.last_dtime[c].max(u32::from(dtime));
                time
            }
            Event::Overflow { time } => {
                survey.overflows += 1;
                time
            }
            Event::Marker { time, bits } => {
                for (i, count) in survey.markers.iter_mut().enumerate() {
                    *count += u64::from(bits >> i & 1);
                }
                time
            }
            Event::Sync { time } => {
                survey.syncs += 1;
                time
            }
            Event::Unknown { .. } => {
                survey.unknown += 1;
                survey.duration
            }
        };
    })?;
    Ok(survey)
}
