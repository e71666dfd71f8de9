//! Writes files: header, records in the order of time, and their number at the end.

use super::header::Header;
use super::record::{Family, HydraT2, HydraT3, Layout, Mode, PicoT2, PicoT3, RecordType};
use super::tag::{Tag, Value};
use std::fs::File;
use std::io::{self, BufWriter, Error, ErrorKind, Seek, SeekFrom, Write};
use std::path::Path;

/// Most overflows that are written one after the other: a longer pause is a mistake.
const LONGEST_PAUSE: u64 = 1 << 24;

const RECORDS: &str = "TTResult_NumberOfRecords";

/// What a file says of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// Type of its records.
    pub record: RecordType,
    /// Time of a count of `dtime`, seconds (T3).
    pub resolution_s: f64,
    /// Time of a count of the time tag, seconds: the laser's period in T3, the clock's in T2.
    pub global_resolution_s: f64,
    /// Sync pulses a second.
    pub sync_rate: i64,
    /// More tags; they follow those that every file has.
    pub tags: Vec<Tag>,
}

impl Description {
    /// The header of an empty file.
    #[must_use]
    pub fn header(&self) -> Header {
        let mode = match self.record.mode() {
            Mode::T2 => 2,
            Mode::T3 => 3,
        };
        let resolution = match self.record.mode() {
            Mode::T2 => self.global_resolution_s,
            Mode::T3 => self.resolution_s,
        };
        let (int, float) = (Value::Int, Value::Float);
        let own = [
            ("CreatorSW_Name", Value::text("sunstone")),
            ("CreatorSW_Version", Value::text(env!("CARGO_PKG_VERSION"))),
            ("Measurement_Mode", int(mode)),
            ("Measurement_SubMode", int(0)),
            ("MeasDesc_GlobalResolution", float(self.global_resolution_s)),
            ("MeasDesc_Resolution", float(resolution)),
            ("MeasDesc_BinningFactor", int(1)),
            ("TTResult_SyncRate", int(self.sync_rate)),
            (RECORDS, int(0)),
            ("TTResultFormat_TTTRRecType", int(i64::from(self.record.code()))),
            ("TTResultFormat_BitsPerRecord", int(32)),
        ];
        // What a file says of its kind is not said twice.
        let own = own.into_iter().filter(|(name, _)| {
            let stated = self.tags.iter().any(|t| t.name == *name);
            !stated || name.starts_with("TTResult") || name.starts_with("MeasDesc")
        });
        let own: Vec<Tag> = own.map(|(name, value)| Tag::new(name, value)).collect();
        let more = self.tags.iter().filter(|t| own.iter().all(|o| o.name != t.name));
        let more: Vec<Tag> = more.cloned().collect();
        Header {
            version: "1.0.00".into(),
            tags: own.into_iter().chain(more).collect(),
        }
    }
}

fn refused(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidInput, what.into())
}

/// Takes photons, markers and sync pulses in the order of time. Times are counts of the time tag since the begin: sync
/// pulses in T3.
#[derive(Debug)]
pub struct Writer<W> {
    out: W,
    record: RecordType,
    /// Where the number of records stands.
    number_at: u64,
    records: u64,
    period: u64,
    overflow: u64,
    last: u64,
}

impl<W: Write + Seek> Writer<W> {
    /// Writes the header.
    ///
    /// # Errors
    /// Of the system; of kind `InvalidInput` for tags that cannot be written.
    pub fn begin(mut out: W, description: &Description) -> io::Result<Self> {
        let header = description.header().write().map_err(refused)?;
        let name = header
            .windows(RECORDS.len())
            .position(|w| w == RECORDS.as_bytes());
        let begin = out.stream_position()?;
        out.write_all(&header)?;
        let number_at = begin + name.unwrap_or(0) as u64 + 40;
        Ok(Self::over(out, description.record, number_at))
    }

    fn over(out: W, record: RecordType, number_at: u64) -> Self {
        Self {
            out,
            record,
            number_at,
            records: 0,
            period: match record.family() {
                Family::PicoT2 => PicoT2::PERIOD,
                Family::PicoT3 => PicoT3::PERIOD,
                Family::OldHydraT2 => HydraT2::<true>::PERIOD,
                Family::HydraT2 => HydraT2::<false>::PERIOD,
                Family::OldHydraT3 | Family::HydraT3 => HydraT3::<false>::PERIOD,
            },
            overflow: 0,
            last: 0,
        }
    }

    fn put(&mut self, record: u32) -> io::Result<()> {
        self.records += 1;
        self.out.write_all(&record.to_le_bytes())
    }

    /// Lets the clock run over as often as it must, and gives the rest.
    fn at(&mut self, time: u64) -> io::Result<u32> {
        if time < self.last {
            return Err(refused(format!(
                "time {time} follows {}; sort the events by time",
                self.last
            )));
        }
        self.last = time;
        let mut periods = (time - self.overflow) / self.period;
        // Overflows of one record.
        let most = match self.record.family() {
            Family::HydraT3 => (1 << 10) - 1,
            // Records hold more, but `ptufile` multiplies in 32 bits, which are full at 128.
            Family::HydraT2 => 127,
            _ => 1,
        };
        if periods / most > LONGEST_PAUSE {
            return Err(refused(format!(
                "gap of {periods} clock overflows before time {time}; the gap is too long"
            )));
        }
        while periods > 0 {
            let n = periods.min(most);
            self.put(match self.record.family() {
                Family::PicoT2 | Family::PicoT3 => 0xf000_0000,
                // The first version of the HydraHarp counts none, the others these.
                _ if most == 1 => 0xfe00_0000,
                _ => 0xfe00_0000 | n as u32,
            })?;
            self.overflow += n * self.period;
            periods -= n;
        }
        Ok((time - self.overflow) as u32)
    }

    /// A photon; `dtime` is for T3 alone.
    ///
    /// # Errors
    /// Of the system; of kind `InvalidInput` for a channel or `dtime` that the type of records has not, and times
    /// that go back.
    pub fn photon(&mut self, time: u64, dtime: u16, channel: u8) -> io::Result<()> {
        let family = self.record.family();
        let first = u8::from(family == Family::PicoT2);
        let (t3, last) = (self.record.mode() == Mode::T3, self.record.channels() - 1);
        if !(first..=last).contains(&channel) {
            return Err(refused(format!(
                "channel {channel}: expected a channel of {} from {first} to {last}",
                self.record.name()
            )));
        }
        if t3 && u32::from(dtime) >= self.record.dtimes() {
            return Err(refused(format!(
                "dtime {dtime}: {} supports values below {}",
                self.record.name(),
                self.record.dtimes()
            )));
        }
        let (time, dtime, channel) = (self.at(time)?, u32::from(dtime), u32::from(channel));
        self.put(match family {
            Family::PicoT2 => time | channel << 28,
            Family::PicoT3 => time | dtime << 16 | (channel + 1) << 28,
            Family::OldHydraT2 | Family::HydraT2 => time | channel << 25,
            Family::OldHydraT3 | Family::HydraT3 => time | dtime << 10 | channel << 25,
        })
    }

    /// A sync pulse (T2).
    ///
    /// # Errors
    /// As [`Self::photon`]; in T3, where no record is of a sync pulse.
    pub fn sync(&mut self, time: u64) -> io::Result<()> {
        if self.record.mode() == Mode::T3 {
            return Err(refused("T3 has no sync records"));
        }
        let time = self.at(time)?;
        self.put(match self.record.family() {
            Family::PicoT2 => time,
            _ => time | 1 << 31,
        })
    }

    /// One or more markers at once: bit 0 is the first input. PicoHarp's T2 writes them over the last four bits of the time.
    ///
    /// # Errors
    /// As [`Self::photon`]; for none of the four.
    pub fn marker(&mut self, time: u64, bits: u8) -> io::Result<()> {
        if !(1..16).contains(&bits) {
            return Err(refused(format!(
                "markers {bits:#b}: expected at least one of the four markers"
            )));
        }
        let (time, bits) = (self.at(time)?, u32::from(bits));
        self.put(match self.record.family() {
            Family::PicoT2 => 0xf000_0000 | time & !15 | bits,
            Family::PicoT3 => 0xf000_0000 | time | bits << 16,
            _ => 1 << 31 | time | bits << 25,
        })
    }

    /// Writes the number of records into the header, and returns it.
    ///
    /// # Errors
    /// Of the system.
    pub fn end(mut self) -> io::Result<u64> {
        self.out.seek(SeekFrom::Start(self.number_at))?;
        self.out.write_all(&self.records.to_le_bytes())?;
        self.out.seek(SeekFrom::End(0))?;
        Ok(self.records)
    }
}

/// Records of T2 or T3 in memory, without a file around them: what a card sends.
#[derive(Debug)]
pub struct Records(Writer<std::io::Cursor<Vec<u8>>>);

impl Records {
    /// None yet.
    #[must_use]
    pub fn new(record: RecordType) -> Self {
        Self(Writer::over(std::io::Cursor::new(vec![]), record, 0))
    }

    /// As [`Writer::photon`].
    ///
    /// # Errors
    /// As [`Writer::photon`].
    pub fn photon(&mut self, time: u64, dtime: u16, channel: u8) -> io::Result<()> {
        self.0.photon(time, dtime, channel)
    }

    /// All of them.
    #[must_use]
    pub fn words(self) -> Vec<u32> {
        let bytes = self.0.out.into_inner();
        bytes
            .as_chunks()
            .0
            .iter()
            .map(|b| u32::from_le_bytes(*b))
            .collect()
    }
}

/// Writes a file that appears whole or not at all; `fill` gives its records. Returns their number.
///
/// # Errors
/// As [`Writer::begin`] and [`Writer::photon`], and what `fill` returns.
pub fn write(
    path: &Path,
    description: &Description,
    fill: impl FnOnce(&mut Writer<&mut BufWriter<File>>) -> io::Result<()>,
) -> io::Result<u64> {
    let mut records = 0;
    base::whole_file::write_with(path, |file| {
        let mut writer = Writer::begin(file, description)?;
        fill(&mut writer)?;
        records = writer.end()?;
        Ok(())
    })?;
    Ok(records)
}
