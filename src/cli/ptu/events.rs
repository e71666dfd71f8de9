//! Prints the records of a file as text, and writes a photon file from such a text.

use super::open;
use crate::{Failure, bail, places, print_path};
use clap::Args;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use sunstone::base::document;
use sunstone::base::locate::InputError;
use sunstone::rig::ptu::record::{Decoder, Event, RecordType};
use sunstone::rig::ptu::writer::{self, Description};

const COLUMNS: &str = "kind,time,dtime,channel,markers";

/// Print a file's records as CSV, one per line.
///
/// Columns: kind (photon, sync, marker, overflow, unknown), time (counts of the time tag since the start:
/// laser pulses in T3), dtime (counts since the laser pulse), channel, markers (bits: 1 is the first input, 8
/// the fourth).
#[derive(Args)]
#[command(after_help = "\
Examples:
  sunstone ptu records night.ptu --first 100
  sunstone ptu records night.ptu > night.csv")]
pub struct Records {
    /// File of photons.
    #[arg(value_name = "FILE.ptu")]
    file: PathBuf,
    /// Number of records to print [default: all].
    #[arg(long, value_name = "N", default_value_t = u64::MAX, hide_default_value = true)]
    first: u64,
}

/// Write a file of photons from a text of events.
///
/// Lines have the format of `sunstone ptu records`, sorted by time. Overflows in the text are ignored and
/// generated again.
#[derive(Args)]
#[command(after_help = "\
Examples:
  sunstone ptu records night.ptu | grep -v marker > photons.csv
  sunstone ptu write photons.csv -o photons.ptu --record timeharp-260-p-t3 --resolution-ps 25 --period-ps 100000")]
pub struct FromText {
    /// Events, one kind,time,dtime,channel,markers per line.
    #[arg(value_name = "EVENTS.csv")]
    events: PathBuf,
    /// File to write.
    #[arg(short, long, value_name = "OUT.ptu")]
    output: PathBuf,
    /// Type of the records: picoharp-300-t3, hydraharp-2-t3, timeharp-260-n-t3, timeharp-260-p-t3,
    /// multiharp-t3, … and their t2 versions.
    #[arg(long, value_name = "TYPE", value_parser = record)]
    record: RecordType,
    /// Duration of one count of dtime, picoseconds (T3).
    #[arg(long, value_name = "PS", default_value_t = 25.0, value_parser = positive)]
    resolution_ps: f64,
    /// Duration of one count of the time tag, picoseconds: the laser's period in T3.
    #[arg(long, value_name = "PS", value_parser = positive)]
    period_ps: f64,
}

fn positive(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|v: &f64| (1e-3..=1e12).contains(v));
    value.ok_or_else(|| "expected a time from 0.001 to 1e12 ps".into())
}

fn slug(record: RecordType) -> String {
    record.name().to_lowercase().replace(' ', "-")
}

fn record(text: &str) -> Result<RecordType, String> {
    let found = RecordType::ALL.into_iter().find(|r| slug(*r) == text);
    found.ok_or_else(|| {
        let names: Vec<String> = RecordType::ALL.into_iter().map(slug).collect();
        format!("unknown record type; choose from {}", names.join(", "))
    })
}

pub fn print(a: &Records) -> Result<(), Failure> {
    let mut reader = open(&a.file)?;
    let mut out = BufWriter::new(std::io::stdout().lock());
    let (mut decoder, mut left) = (Decoder::new(reader.record_type()), a.first);
    let mut line = |event: Event| match event {
        Event::Photon { time, dtime, channel } => writeln!(out, "photon,{time},{dtime},{channel},"),
        Event::Sync { time } => writeln!(out, "sync,{time},,,"),
        Event::Marker { time, bits } => writeln!(out, "marker,{time},,,{bits}"),
        Event::Overflow { time } => writeln!(out, "overflow,{time},,,"),
        Event::Unknown { .. } => writeln!(out, "unknown,,,,"),
    };
    crate::print(COLUMNS)?;
    while left > 0 {
        let block = reader.block().map_err(Failure::input)?;
        if block.is_empty() {
            break;
        }
        for record in block.iter().take(usize::try_from(left).unwrap_or(usize::MAX)) {
            left -= 1;
            match line(decoder.decode(u32::from_le_bytes(*record))) {
                Err(e) if e.kind() == ErrorKind::BrokenPipe => return Ok(()),
                Err(e) => return Err(Failure::failed(format!("cannot write to standard output: {e}"))),
                Ok(()) => {}
            }
        }
    }
    match out.flush() {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Failure::failed(e)),
        _ => Ok(()),
    }
}

/// Parses the event of a line. Returns `None` for invalid lines, column names and overflows. The
/// writer generates overflows again.
fn event(line: &str) -> Option<Event> {
    let words: Vec<&str> = line.split(',').map(str::trim).collect();
    let &[kind, time, dtime, channel, markers] = &words[..] else {
        return None;
    };
    let time = || time.parse().ok();
    Some(match kind {
        "photon" => Event::Photon {
            time: time()?,
            dtime: if dtime.is_empty() { 0 } else { dtime.parse().ok()? },
            channel: channel.parse().ok()?,
        },
        "sync" => Event::Sync { time: time()? },
        "marker" => Event::Marker { time: time()?, bits: markers.parse().ok()? },
        "overflow" | "kind" => Event::Overflow { time: 0 },
        _ => return None,
    })
}

pub fn write(a: &FromText) -> Result<(), Failure> {
    places::files([Some(&a.events)], [Some(&a.output)])?;
    places::extension([&a.output], "photons are", &["ptu"])?;
    let fix = "write lines of kind,time,dtime,channel,markers, in the format of `sunstone ptu records`";
    let text = document::read(&a.events, "events", fix)?;
    let description = Description {
        record: a.record,
        resolution_s: a.resolution_ps * 1e-12,
        global_resolution_s: a.period_ps * 1e-12,
        sync_rate: if slug(a.record).ends_with("t3") { (1e12 / a.period_ps).round() as i64 } else { 0 },
        tags: vec![],
    };
    if text.trim().is_empty() {
        bail!("{}: the file contains no events; {fix}", a.events.display());
    }
    let mut wrong: Option<InputError> = None;
    let done = writer::write(&a.output, &description, |writer| {
        let mut start = 0;
        for line in text.split_inclusive('\n') {
            let span = start..start + line.trim_end().len();
            start += line.len();
            if line.trim().is_empty() || line.starts_with('#') {
                continue;
            }
            let refused =
                |message: String| InputError::new(&a.events, text.as_str(), Some(span.clone()), message, fix);
            let Some(event) = event(line) else {
                wrong = Some(refused(format!("`{}` is not an event", line.trim())));
                return Err(ErrorKind::InvalidInput.into());
            };
            let result = match event {
                Event::Photon { time, dtime, channel } => writer.photon(time, dtime, channel),
                Event::Sync { time } => writer.sync(time),
                Event::Marker { time, bits } => writer.marker(time, bits),
                _ => Ok(()),
            };
            if let Err(e) = &result
                && e.kind() == ErrorKind::InvalidInput
            {
                wrong = Some(refused(e.to_string()));
            }
            result?;
        }
        Ok(())
    });
    if let Some(e) = wrong {
        return Err(e.into());
    }
    done.map_err(|e| describe(&a.output, &e))?;
    print_path(&a.output)
}

fn describe(path: &Path, e: &std::io::Error) -> Failure {
    Failure::failed(format!("{}: {e}", path.display()))
}
