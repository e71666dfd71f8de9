//! Writes a `.ptu` file. Writes the header, the records in order of time, and finally the number of records.

use super::header::Header;
use super::record::{Family, Layout, Mode, RecordType, with_layout};
use super::tag::{Tag, Value};
use std::fs::File;
use std::io::{self, BufWriter, Error, ErrorKind, Seek, SeekFrom, Write};
use std::path::Path;

/// Maximum number of consecutive overflow records. A longer gap between events is an error.
const LONGEST_PAUSE: u64 = 1 << 24;

const RECORDS: &str = "TTResult_NumberOfRecords";

/// Metadata of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    pub record: RecordType,
    /// Duration of a count of `dtime` in seconds (T3).
    pub resolution_s: f64,
    /// Duration of a count of the time tag in seconds. This is the laser's period in T3, and the clock's
    /// period in T2.
    pub global_resolution_s: f64,
    pub sync_rate: i64,
    /// Additional tags. The additional tags follow the standard tags.
    pub tags: Vec<Tag>,
}

impl Description {
    /// Returns the header of a file without records.
    pub fn header(&self) -> Header {
        let (mode, resolution) = match self.record.mode() {
            Mode::T2 => (2, self.global_resolution_s),
            Mode::T3 => (3, self.resolution_s),
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
        // A tag of `tags` replaces the standard tag of the same name, except tags of the format itself.
        let own = own.into_iter().filter(|(name, _)| {
            let stated = self.tags.iter().any(|t| t.name == *name);
            !stated || name.starts_with("TTResult") || name.starts_with("MeasDesc")
        });
        let own: Vec<Tag> = own.map(|(name, value)| Tag::new(name, value)).collect();
        let more = self.tags.iter().filter(|t| own.iter().all(|o| o.name != t.name));
        let more: Vec<Tag> = more.cloned().collect();
        Header { version: "1.0.00".into(), tags: own.into_iter().chain(more).collect() }
    }
}

/// Returns the clock counts per overflow.
fn period<L: Layout>() -> u64 {
    L::PERIOD
}

fn refused(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidInput, what.into())
}

/// Writes photons, markers and sync pulses in order of time. Times are counts of the time tag since the
/// start of the file. In T3, the counts are sync pulses.
#[derive(Debug)]
pub struct Writer<W> {
    out: W,
    record: RecordType,
    /// Byte offset at which the file stores the number of records.
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
    /// Returns errors of the operating system, and errors of kind `InvalidInput` for tags that cannot be
    /// encoded.
    pub fn begin(mut out: W, description: &Description) -> io::Result<Self> {
        let header = description.header().write().map_err(refused)?;
        let name = header.windows(RECORDS.len()).position(|w| w == RECORDS.as_bytes());
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
            period: with_layout!(record, period[]()),
            overflow: 0,
            last: 0,
        }
    }

    fn put(&mut self, record: u32) -> io::Result<()> {
        self.records += 1;
        self.out.write_all(&record.to_le_bytes())
    }

    /// Writes the overflow records that precede a time. Returns the remaining time count for the event's
    /// record.
    fn at(&mut self, time: u64) -> io::Result<u32> {
        if time < self.last {
            return Err(refused(format!(
                "the event at time {time} follows an event at time {}; sort the events by time",
                self.last
            )));
        }
        self.last = time;
        let mut periods = (time - self.overflow) / self.period;
        // Maximum number of overflows per overflow record.
        let most = match self.record.family() {
            Family::HydraT3 => (1 << 10) - 1,
            // Records can represent more overflows, but the 32-bit product in `ptufile` overflows at 128.
            Family::HydraT2 => 127,
            _ => 1,
        };
        if periods / most > LONGEST_PAUSE {
            return Err(refused(format!(
                "the gap of {periods} clock overflows before time {time} is too long to write; expected fewer than {}",
                most * (LONGEST_PAUSE + 1)
            )));
        }
        while periods > 0 {
            let n = periods.min(most);
            self.put(match self.record.family() {
                Family::PicoT2 | Family::PicoT3 => 0xf000_0000,
                // Records of the first version of the HydraHarp contain no overflow count.
                _ if most == 1 => 0xfe00_0000,
                _ => 0xfe00_0000 | n as u32,
            })?;
            self.overflow += n * self.period;
            periods -= n;
        }
        Ok((time - self.overflow) as u32)
    }

    /// Writes a photon. `dtime` is for T3 only.
    ///
    /// # Errors
    /// Returns errors of the operating system. Returns `InvalidInput` for an invalid channel, an invalid
    /// `dtime` or a decreasing time.
    pub fn photon(&mut self, time: u64, dtime: u16, channel: u8) -> io::Result<()> {
        let family = self.record.family();
        let first = u8::from(family == Family::PicoT2);
        let (t3, last) = (self.record.mode() == Mode::T3, self.record.channels() - 1);
        if !(first..=last).contains(&channel) {
            return Err(refused(format!(
                "channel {channel} does not exist: record type {} has channels {first} to {last}",
                self.record.name()
            )));
        }
        if t3 && u32::from(dtime) >= self.record.dtimes() {
            return Err(refused(format!(
                "dtime {dtime} is too large: record type {} supports values below {}",
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

    /// Writes a sync pulse (T2).
    ///
    /// # Errors
    /// Returns the same errors as [`Self::photon`], and an error in T3, which has no sync records.
    pub fn sync(&mut self, time: u64) -> io::Result<()> {
        if self.record.mode() == Mode::T3 {
            return Err(refused("a T3 file has no sync records; remove the sync events"));
        }
        let time = self.at(time)?;
        self.put(match self.record.family() {
            Family::PicoT2 => time,
            _ => time | 1 << 31,
        })
    }

    /// Writes one or more simultaneous markers. Bit 0 is the first input. PicoHarp's T2 overwrites the last
    /// four bits of the time with the marker bits.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::photon`]. Also returns an error if no marker or a marker beyond the
    /// fourth is set.
    pub fn marker(&mut self, time: u64, bits: u8) -> io::Result<()> {
        if !(1..16).contains(&bits) {
            return Err(refused(format!(
                "the marker bits are {bits:#b}: expected 0b1 to 0b1111 (one bit per marker)"
            )));
        }
        let (time, bits) = (self.at(time)?, u32::from(bits));
        self.put(match self.record.family() {
            Family::PicoT2 => 0xf000_0000 | time & !15 | bits,
            Family::PicoT3 => 0xf000_0000 | time | bits << 16,
            _ => 1 << 31 | time | bits << 25,
        })
    }

    /// Writes the number of records into the header and returns that number.
    ///
    /// # Errors
    /// Returns errors of the operating system.
    pub fn end(mut self) -> io::Result<u64> {
        self.out.seek(SeekFrom::Start(self.number_at))?;
        self.out.write_all(&self.records.to_le_bytes())?;
        self.out.seek(SeekFrom::End(0))?;
        Ok(self.records)
    }
}

/// T2 or T3 records in memory without a file, in the form in which a photon counter sends them.
#[derive(Debug)]
pub struct Records(Writer<std::io::Cursor<Vec<u8>>>);

impl Records {
    pub fn new(record: RecordType) -> Self {
        Self(Writer::over(std::io::Cursor::new(vec![]), record, 0))
    }

    /// Appends a photon as [`Writer::photon`] does.
    ///
    /// # Errors
    /// Returns the same errors as [`Writer::photon`].
    pub fn photon(&mut self, time: u64, dtime: u16, channel: u8) -> io::Result<()> {
        self.0.photon(time, dtime, channel)
    }

    pub fn words(self) -> Vec<u32> {
        let bytes = self.0.out.into_inner();
        bytes.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect()
    }
}

/// Writes a file atomically and returns its number of records. `fill` writes the records.
///
/// # Errors
/// Returns the same errors as [`Writer::begin`] and [`Writer::photon`], and the errors of `fill`.
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
