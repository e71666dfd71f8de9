//! Time tags of a scan, which are the raw T3 records of a counter. The module also computes histograms from
//! the records.
//!
//! All points of a row are stored in one `.ptu` file, `time_tags/N.ptu`. Marker 1 begins a point and marker 2
//! ends the point. Sync numbers continue from point to point. `sunstone ptu histogram … --pixels WIDTH,1
//! --pixel-marker 1,2` computes the row's histograms.
//!
//! While a row is incomplete, the tags of its points are in a log. The tags of a point are therefore always
//! in the log or in a file.

use super::sealed_log::{self, SealedLog, word};
use crate::ptu::histogram::{Plan, possibly_empty_histogram};
use crate::ptu::reader::Reader;
use crate::ptu::record::{Decoder, Event, RecordType};
use crate::ptu::writer::{self, Description};
use std::fs::File;
use std::io::{self, Cursor, Seek, Write};
use std::path::{Path, PathBuf};

/// File name of the log of an incomplete row.
const LOG: &str = ".session.tags";
/// Folder of the rows' files in the store.
const FOLDER: &str = "time_tags";
/// Number of the marker that begins a point in a row's file.
const BEGIN: u8 = 1;
const END: u8 = 2;

/// Record type of the files. This type has the largest range of `dtime` of all types that PicoQuant's
/// programs read.
pub const RECORD: RecordType = RecordType::TimeHarp260PT3;

/// Time tags of one point. The tags consist of the number of pulses in the dwell time, and of every photon.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tags {
    pub pulses: u64,
    /// The photons. Each number contains three fields: pulses since the start of the dwell time (43 bits),
    /// bins since the pulse (15 bits), and channel (6 bits).
    photons: Vec<u64>,
}

impl Tags {
    /// Decodes the records of one acquisition. Sync numbers count from the start of the acquisition.
    ///
    /// # Errors
    /// Returns a message if tags are later than the last pulse or out of order, or if records are invalid.
    pub fn new(records: &[u32], record: RecordType, pulses: u64) -> Result<Self, String> {
        let mut decoder = Decoder::new(record);
        let mut photons = vec![];
        for word in records {
            match decoder.decode(*word) {
                Event::Photon { time, dtime, channel } if time < pulses.min(1 << 43) => {
                    photons.push(time << 21 | u64::from(dtime) << 6 | u64::from(channel & 63));
                }
                Event::Photon { time, .. } => {
                    return Err(format!(
                        "a photon has pulse number {time}, but the acquisition has only {pulses} pulses"
                    ));
                }
                Event::Unknown { record } => {
                    return Err(format!("record {record:#010x} has an unknown type"));
                }
                Event::Overflow { .. } | Event::Marker { .. } | Event::Sync { .. } => {}
            }
        }
        if photons.iter().zip(photons.iter().skip(1)).any(|(a, b)| a >> 21 > b >> 21) {
            return Err("time tags are out of order".into());
        }
        Ok(Self { pulses, photons })
    }

    fn each(&self) -> impl Iterator<Item = (u64, u16, u8)> {
        let split = |w: &u64| (w >> 21, (w >> 6 & 0x7fff) as u16, (w & 63) as u8);
        self.photons.iter().map(split)
    }

    /// Returns the counts per bin. The counts equal those that [`possibly_empty_histogram`] computes from a
    /// file with these tags.
    ///
    /// # Errors
    /// Returns a message if a bin has 2³² − 1 counts.
    pub fn histogram(&self, bins: usize, scale: &Scale) -> Result<Vec<u32>, String> {
        let name = Path::new("time tags");
        let mut bytes = Cursor::new(vec![]);
        row(&mut bytes, scale, std::slice::from_ref(self)).map_err(|e| e.to_string())?;
        let length = bytes.get_ref().len() as u64;
        bytes.set_position(0);
        let plan = Plan { bin: 1, bins, channels: vec![0], scan: None };
        let mut reader = Reader::new(bytes, length, name).map_err(|e| e.to_string())?;
        let (found, _) = possibly_empty_histogram(&mut reader, &plan).map_err(|e| e.to_string())?;
        Ok(found.counts)
    }

    /// Returns the CRC-32C of pulses and photons.
    pub fn checksum(&self) -> u32 {
        crc32c::crc32c(&self.bytes())
    }

    fn bytes(&self) -> Vec<u8> {
        let words = std::iter::once(&self.pulses).chain(&self.photons);
        words.flat_map(|w| w.to_le_bytes()).collect()
    }
}

/// The time units of the numbers in a time-tag file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    pub bin_ps: f64,
    pub rate_hz: f64,
}

impl Scale {
    fn description(&self) -> Description {
        Description {
            record: RECORD,
            resolution_s: self.bin_ps * 1e-12,
            global_resolution_s: 1.0 / self.rate_hz,
            sync_rate: self.rate_hz.round() as i64,
            tags: vec![],
        }
    }
}

fn row<W: Write + Seek>(out: W, scale: &Scale, points: &[Tags]) -> io::Result<()> {
    let mut writer = writer::Writer::begin(out, &scale.description())?;
    fill(&mut writer, points)?;
    writer.end().map(drop)
}

fn fill<W: Write + Seek>(writer: &mut writer::Writer<W>, points: &[Tags]) -> io::Result<()> {
    let mut begin = 0;
    for point in points {
        writer.marker(begin, BEGIN)?;
        for (sync, dtime, channel) in point.each() {
            writer.photon(begin + sync, dtime, channel)?;
        }
        begin += point.pulses;
        writer.marker(begin, END)?;
    }
    Ok(())
}

fn file_of(store: &Path, row: usize) -> PathBuf {
    store.join(FOLDER).join(format!("{row:06}.ptu"))
}

/// Returns the points of a row's file. Returns `None` if the file is missing or if [`TagLog::finish_row`] did
/// not write the file.
pub fn read_row(store: &Path, row: usize, points: usize) -> Option<Vec<Tags>> {
    let mut reader = Reader::open(&file_of(store, row)).ok()?;
    if reader.mismatch().is_some() || reader.record_type() != RECORD {
        return None;
    }
    let mut out: Vec<Tags> = vec![];
    let (mut begin, mut sound) = (None, true);
    let read = reader.events(|event| match (event, begin) {
        (Event::Marker { time, bits: BEGIN }, None) => {
            begin = Some(time);
            out.push(Tags { pulses: 0, photons: vec![] });
        }
        (Event::Marker { time, bits: END }, Some(from)) => {
            begin = None;
            if let Some(last) = out.last_mut() {
                last.pulses = time - from;
            }
        }
        (Event::Photon { time, dtime, channel }, Some(from)) => {
            if let Some(last) = out.last_mut() {
                let word = (time - from) << 21 | u64::from(dtime) << 6 | u64::from(channel & 63);
                last.photons.push(word);
            }
        }
        (Event::Overflow { .. }, _) => {}
        _ => sound = false,
    });
    (read.is_ok() && sound && begin.is_none() && out.len() == points).then_some(out)
}

/// The points of an incomplete row, stored in memory and in a log.
pub(super) struct TagLog {
    store: PathBuf,
    scale: Scale,
    pub(super) log: SealedLog,
    part: Vec<Tags>,
}

impl TagLog {
    /// Creates an empty log in a store. An existing log is overwritten.
    pub(super) fn new(store: &Path, scale: Scale) -> io::Result<Self> {
        let folder = store.join(FOLDER);
        std::fs::create_dir_all(&folder)?;
        // Mark the folder as a group for Zarr readers.
        let group = "{\n  \"zarr_format\": 3,\n  \"node_type\": \"group\",\n  \"attributes\": {}\n}\n";
        base::whole_file::write(&folder.join("zarr.json"), group.as_bytes())?;
        Ok(Self { store: store.to_owned(), scale, log: SealedLog::new(&store.join(LOG))?, part: vec![] })
    }

    pub(super) fn append(&mut self, frame: u32, tags: Tags) -> io::Result<()> {
        let photons = tags.photons.len() as u32;
        self.log.append([&frame.to_le_bytes()[..], &photons.to_le_bytes(), &tags.bytes()].concat())?;
        self.part.push(tags);
        Ok(())
    }

    /// Removes all points from the log, for a new row.
    pub(super) fn empty(&mut self) -> io::Result<()> {
        self.part.clear();
        self.log.empty()
    }

    /// Writes the row's file and waits until it is on disk.
    pub(super) fn finish_row(&self, number: usize) -> io::Result<()> {
        let path = file_of(&self.store, number);
        let description = self.scale.description();
        writer::write(&path, &description, |w| fill(w, &self.part))?;
        File::open(&path)?.sync_data()?;
        // Sync the folder as well, so that the new name is on disk.
        File::open(self.store.join(FOLDER))?.sync_data()
    }
}

/// Returns the points of the log, up to the first incomplete point.
pub(super) fn read_log(store: &Path) -> Vec<(u32, Tags)> {
    let length = |rest: &[u8]| Some(8 + 8 * (word(rest.get(4..)?)? as usize + 1));
    let tags = |record: Vec<u8>| {
        let words: Vec<u64> = record[8..].as_chunks().0.iter().map(|b| u64::from_le_bytes(*b)).collect();
        Some((word(&record)?, Tags { pulses: words[0], photons: words[1..].to_vec() }))
    };
    sealed_log::read(&store.join(LOG), length).into_iter().filter_map(tags).collect()
}

/// Removes the log of a finished run.
pub(super) fn remove_log(store: &Path) -> io::Result<()> {
    sealed_log::remove(&store.join(LOG))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SCALE: Scale = Scale { bin_ps: 25.0, rate_hz: 1e7 };

    fn point(pulses: u64, photons: &[(u64, u16)]) -> Tags {
        let mut words: Vec<u64> = photons
            .iter()
            .map(|(sync, dtime)| (sync % pulses) << 21 | u64::from(dtime & 0x7fff) << 6)
            .collect();
        words.sort_unstable();
        Tags { pulses, photons: words }
    }

    fn points() -> impl Strategy<Value = Vec<Tags>> {
        let one = (1_u64..200_000, prop::collection::vec((any::<u64>(), any::<u16>()), 0..40));
        prop::collection::vec(one.prop_map(|(p, photons)| point(p, &photons)), 1..5)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        /// Reading returns the rows and logs that were written. The histogram equals the counted tags.
        #[test]
        fn tags_round_trip(points in points(), cut in 0_usize..2000) {
            let folder = tempfile::tempdir().expect("a folder");
            let mut log = TagLog::new(folder.path(), SCALE).expect("a log");
            for (n, p) in (7..).zip(&points) {
                log.append(n, p.clone()).expect("writes");
            }
            log.finish_row(3).expect("writes");
            prop_assert_eq!(read_row(folder.path(), 3, points.len()), Some(points.clone()));
            prop_assert_eq!(read_row(folder.path(), 3, points.len() + 1), None);
            let logged: Vec<(u32, Tags)> = (7..).zip(points.iter().cloned()).collect();
            prop_assert_eq!(&read_log(folder.path()), &logged);
            for p in &points {
                let mut want = vec![0; 1000];
                p.each().filter(|(_, d, _)| *d < 1000).for_each(|(_, d, _)| want[usize::from(d)] += 1);
                prop_assert_eq!(p.histogram(1000, &SCALE).expect("a histogram"), want);
            }
            // The reader of a truncated log returns only complete points.
            let path = folder.path().join(LOG);
            let bytes = std::fs::read(&path).expect("reads");
            std::fs::write(&path, &bytes[..bytes.len().saturating_sub(cut)]).expect("writes");
            let torn = read_log(folder.path());
            prop_assert!(logged.starts_with(&torn) && (cut == 0) == (torn.len() == logged.len()));
            let path = file_of(folder.path(), 3);
            let bytes = std::fs::read(&path).expect("reads");
            std::fs::write(&path, &bytes[..bytes.len() - (1 + cut).min(bytes.len())]).expect("writes");
            prop_assert_eq!(read_row(folder.path(), 3, points.len()), None);
        }

        /// Arbitrary records yield tags or a message.
        #[test]
        fn arbitrary_records_never_panic(words in prop::collection::vec(any::<u32>(), 0..30), pulses in any::<u64>()) {
            for record in RecordType::ALL {
                let _ = Tags::new(&words, record, pulses);
            }
        }
    }

    #[test]
    fn invalid_records_are_refused() {
        let photon = |sync: u32, dtime: u32| sync | dtime << 10;
        let message = |words: &[u32], pulses| Tags::new(words, RECORD, pulses).expect_err("a fault");
        assert!(message(&[photon(5, 1)], 5).contains("pulse number 5"));
        assert!(message(&[photon(5, 1), photon(4, 1)], 9).contains("order"));
        assert!(message(&[0xC000_0000], 9).contains("unknown type"));
        let good = Tags::new(&[photon(5, 1), photon(5, 2)], RECORD, 6).expect("tags");
        assert_ne!(good.checksum(), Tags { pulses: 7, ..good.clone() }.checksum());
    }
}
