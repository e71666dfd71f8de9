//! The `sunstone ptu` command, which reads and writes files of time-tagged photons from PicoQuant's counters.

mod events;

use crate::{Failure, bail, places, print, print_path};
use clap::Args;
use std::fmt::Write;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use sunstone::rig::ptu::histogram::{Histograms, Plan, histogram};
use sunstone::rig::ptu::meaning;
use sunstone::rig::ptu::reader::Reader;
use sunstone::rig::ptu::record::Mode;
use sunstone::rig::ptu::scan::{Clock, Scan, is_bidirectional};
use sunstone::rig::ptu::survey::{Survey, survey};
use sunstone::rig::ptu::tag::Value;
use sunstone::store::numpy;
use tracing::info;

/// Read and write files of time-tagged photons (.ptu) from PicoQuant's counters.
///
/// Supports PicoHarp 300 and 330, HydraHarp 400, TimeHarp 260 and MultiHarp, in T2 and T3 mode. The memory
/// use does not depend on the size of the file.
#[derive(Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

commands! {
    Info(Info) => info,
    Histogram(Histogram) => count,
    Records(events::Records) => events::print,
    Write(events::FromText) => events::write,
}

/// Print the contents of a file: its tags, photons by channel, markers, duration.
#[derive(Args)]
#[command(after_help = "\
Examples:
  sunstone ptu info night.ptu
  sunstone ptu info night.ptu | grep HW_")]
struct Info {
    /// File of photons.
    #[arg(value_name = "FILE.ptu")]
    file: PathBuf,
}

/// Count photons by time since the laser pulse, by channel, and by pixel of a galvo scan.
///
/// Writes an array of u32: (channels, bins), or with --pixels (rows, columns, channels, bins). Pixels are
/// located by markers in the file: one per pixel (--pixel-marker), or one per line, with the durations from
/// the header. Rows that are scanned backwards (ImgHdr_BiDirect) are reversed. Photons outside all bins or
/// pixels are counted and reported; if none is inside, nothing is written (exit code 2).
#[derive(Args)]
#[command(after_help = "\
Examples:
  sunstone ptu histogram night.ptu -o counts.npy                      all channels that have photons, one laser period
  sunstone ptu histogram night.ptu -o counts.npy --channel 0 --bin-ps 100
  sunstone ptu histogram night.ptu -o scan.npy --pixels 128,128 --pixel-marker 1,2 --frame-marker 3
  sunstone ptu histogram night.ptu -o scan.npy --pixels 128,128       a line scan, by the markers of its header")]
struct Histogram {
    /// File of photons.
    #[arg(value_name = "FILE.ptu")]
    file: PathBuf,
    /// File to write.
    #[arg(short, long, value_name = "OUT.npy")]
    output: PathBuf,
    /// Bin width in picoseconds, a multiple of the file's resolution [default: that resolution].
    #[arg(long, value_name = "PS")]
    bin_ps: Option<f64>,
    /// Number of bins [default: the bins of one laser period, or up to the last photon if it is later].
    #[arg(long, value_name = "N")]
    bins: Option<usize>,
    /// Channels, from 0 (comma-separated) [default: the channels with photons].
    #[arg(long, value_name = "C,…", value_delimiter = ',')]
    channel: Vec<u8>,
    /// Number of columns and rows of the scan.
    #[arg(long, value_name = "W,H", value_delimiter = ',')]
    pixels: Vec<usize>,
    /// Marker, 1 to 4, that begins each pixel, and optionally the marker that ends it.
    #[arg(long, value_name = "N[,N]", value_delimiter = ',', requires = "pixels", value_parser = clap::value_parser!(u8).range(1..=4))]
    pixel_marker: Vec<u8>,
    /// Marker that begins a frame.
    #[arg(long, value_name = "N", requires = "pixel_marker", value_parser = clap::value_parser!(u8).range(1..=4))]
    frame_marker: Option<u8>,
}

/// Opens a photon file, and prints a warning if the file is truncated.
fn open(path: &Path) -> Result<Reader<BufReader<File>>, Failure> {
    let reader = Reader::open(path).map_err(Failure::input)?;
    if let Some(mismatch) = reader.mismatch() {
        eprintln!("warning: {}: {mismatch}", path.display());
    }
    Ok(reader)
}

fn surveyed(path: &Path) -> Result<Survey, Failure> {
    let mut reader = Reader::open(path).map_err(Failure::input)?;
    survey(&mut reader).map_err(Failure::input)
}

fn info(a: &Info) -> Result<(), Failure> {
    let mut reader = open(&a.file)?;
    let found = survey(&mut reader).map_err(Failure::input)?;
    let (header, record) = (reader.header(), reader.record_type());
    let mut out = format!("records      {} of {}", reader.records(), record.name());
    let mut line = |name: &str, value: String| {
        let _ = write!(out, "\n{name:12} {value}");
    };
    if let Some(s) = header.resolution_s(record.mode()) {
        line("resolution", format!("{:.6} ps", s * 1e12));
    }
    if let Some(s) = header.global_resolution_s() {
        if record.mode() == Mode::T3 {
            line("period", format!("{:.6} ns", s * 1e9));
        }
        line("duration", format!("{:.6} s", found.duration as f64 * s));
    }
    for channel in found.channels() {
        line(&format!("channel {channel}"), format!("{} photons", found.photons[usize::from(channel)]));
    }
    for (i, n) in found.markers.iter().enumerate().filter(|(_, n)| **n > 0) {
        line(&format!("marker {}", i + 1), format!("{n} times"));
    }
    line("syncs", found.syncs.to_string());
    line("overflows", found.overflows.to_string());
    line("unknown", format!("{} records", found.unknown));
    for tag in &header.tags {
        let index = if tag.index < 0 { String::new() } else { format!("[{}]", tag.index) };
        let _ = write!(out, "\n{}{index} = {}", tag.name.escape_default(), shown(&tag.value));
    }
    print(&out)
}

/// Maximum length of a text or list that is printed completely.
const LONGEST: usize = 200;

fn shown(value: &Value) -> String {
    let text = match value {
        Value::Empty => "(empty)".into(),
        Value::Bool(b) => b.to_string(),
        Value::Int(i) => i.to_string(),
        Value::Bits(b) | Value::Color(b) => format!("{b:#x}"),
        Value::Float(f) => format!("{f:?}"),
        Value::Time(days) => format!("{days:?} days since 1899-12-30"),
        Value::Floats(f) => format!("{:?}", &f[..f.len().min(LONGEST / 4)]),
        Value::Text(t) | Value::Wide(t) => format!("{t:?}"),
        Value::Blob(b) => format!("{} bytes", b.len()),
    };
    match text.char_indices().nth(LONGEST) {
        Some((at, _)) => format!("{} …", &text[..at]),
        None => text,
    }
}

fn count(a: &Histogram) -> Result<(), Failure> {
    places::files([Some(&a.file)], [Some(&a.output)])?;
    places::extension([&a.output], "arrays are", &["npy"])?;
    let mut reader = open(&a.file)?;
    let scan = scan(a, &reader)?;
    let bin = bin(a, &reader)?;
    let survey = surveyed(&a.file)?;
    let channels = match &a.channel[..] {
        [] => survey.channels(),
        given => given.to_vec(),
    };
    if channels.is_empty() {
        bail!(
            "{}: the file contains no photons; check that the measurement ran and that the file is complete",
            a.file.display()
        );
    }
    if let Some(i) = (1..channels.len()).find(|i| channels[..*i].contains(&channels[*i])) {
        bail!("--channel: the list contains channel {} twice; list each channel once", channels[i]);
    }
    let bins = a.bins.unwrap_or_else(|| bins(&reader, bin, &survey, &channels));
    let plan = Plan { bin, bins, channels, scan };
    let start = std::time::Instant::now();
    let found = histogram(&mut reader, &plan).map_err(Failure::input)?;
    let (records, seconds) = (reader.records(), start.elapsed().as_secs_f64());
    info!("{records} records in {seconds:.4} s, {:.1} million per second", 1e-6 * records as f64 / seconds);
    report(a, &reader, &plan, &found);
    let shape = &found.shape[if scan.is_some() { 0 } else { 2 }..];
    numpy::save(&a.output, shape, &found.counts).map_err(Failure::at(&a.output))?;
    print_path(&a.output)
}

/// Returns the number of bins that cover one laser period. In T3 mode, the bins also cover the last photon if
/// it is later.
fn bins(reader: &Reader<BufReader<File>>, bin: u32, survey: &Survey, channels: &[u8]) -> usize {
    let period = Plan::period_bins(reader, bin);
    let last = channels.iter().filter_map(|c| {
        let c = usize::from(*c);
        (*survey.photons.get(c)? > 0).then(|| survey.last_dtime[c] / bin)
    });
    let all = last.max().map_or(0, |last| last as usize + 1);
    if reader.record_type().mode() == Mode::T3 && all > period {
        eprintln!(
            "note: {}: some photons arrive later than one laser period ({period} bins); the histogram has {all} bins",
            reader.file().display()
        );
        return all;
    }
    period
}

/// Prints notes about photons that are not in the array, and about unused header entries.
fn report(a: &Histogram, reader: &Reader<BufReader<File>>, plan: &Plan, found: &Histograms) {
    let note = |text: String| eprintln!("note: {}: {text}", a.file.display());
    let (header, mode) = (reader.header(), reader.record_type().mode());
    for text in meaning::notes(header, mode, plan.scan.as_ref()) {
        note(text);
    }
    let left_out = &found.left_out;
    if left_out.photons() > 0 {
        let reasons = left_out.describe(header.resolution_s(mode));
        let counted = found.photons - left_out.photons();
        note(format!("{counted} of {} photons are counted; not counted: {reasons}", found.photons));
    }
    for (i, channel) in plan.channels.iter().enumerate() {
        let row = found.counts.chunks_exact(plan.bins).skip(i);
        if row.step_by(plan.channels.len()).all(|bins| bins.iter().all(|n| *n == 0)) {
            note(format!("channel {channel} has no counted photons"));
        }
    }
    let by_pixels = plan.scan.is_some_and(|s| s.clock.sweep.is_none());
    let (step, one) = if by_pixels { ("pixels", "pixel") } else { ("lines", "line") };
    if found.beyond > 0 {
        note(format!("{} {step} begin after the last {one} of their frame", found.beyond));
    }
    if found.missing > 0 {
        note(format!("the last frame lacks {} {step}", found.missing));
    }
    if found.unknown > 0 {
        note(format!("{} records have an unknown type", found.unknown));
    }
}

/// Returns the bin width in units of the file's time resolution.
fn bin(a: &Histogram, reader: &Reader<BufReader<File>>) -> Result<u32, Failure> {
    let Some(wanted) = a.bin_ps else { return Ok(1) };
    let Some(resolution) = reader.header().resolution_s(reader.record_type().mode()) else {
        let fix = "remove --bin-ps";
        bail!("{}: the header does not contain the time resolution; {fix}", a.file.display());
    };
    let counts = wanted / (resolution * 1e12);
    if !(0.5..1e9).contains(&counts) || (counts - counts.round()).abs() > 1e-6 * counts {
        let resolution = resolution * 1e12;
        bail!(
            "--bin-ps {wanted}: the width is not a multiple of the file's resolution, {resolution:.6} ps; pass a multiple of the \
             resolution"
        );
    }
    Ok(counts.round() as u32)
}

fn scan(a: &Histogram, reader: &Reader<BufReader<File>>) -> Result<Option<Scan>, Failure> {
    let (width, height) = match a.pixels[..] {
        [] => return Ok(None),
        [width, height] if width > 0 && height > 0 => (width, height),
        _ => bail!(
            "--pixels: expected two positive numbers, columns and rows, such as --pixels 128,128; got {:?}",
            a.pixels
        ),
    };
    let bit = |n: &u8| 1 << (n - 1);
    let markers = |begin: &u8, end: u8| {
        let (begin, frame) = (bit(begin), a.frame_marker.as_ref().map_or(0, bit));
        let shared: u8 = (begin & end) | ((begin | end) & frame);
        if shared != 0 {
            bail!(
                "--pixel-marker, --frame-marker: the marker {} is used twice; pass different markers for the start of a pixel, the \
                 end of a pixel and the start of a frame",
                shared.trailing_zeros() + 1
            );
        }
        Ok(Clock { begin, end, frame, sweep: None })
    };
    let clock = match &a.pixel_marker[..] {
        [] => return of_header(a, reader, width, height).map(Some),
        [begin] => markers(begin, 0)?,
        [begin, end] => markers(begin, bit(end))?,
        more => bail!(
            "--pixel-marker: expected one or two markers, such as --pixel-marker 1,2; got {} markers",
            more.len()
        ),
    };
    Ok(Some(Scan { width, height, bidirectional: is_bidirectional(reader.header()), clock }))
}

/// Returns the scan that the header describes, if the scan has the requested size.
fn of_header(
    a: &Histogram,
    reader: &Reader<BufReader<File>>,
    width: usize,
    height: usize,
) -> Result<Scan, Failure> {
    let file = a.file.display();
    let scan = Scan::of_header(reader.header()).map_err(|why| {
        Failure::input(format!(
            "{file}: {why}; if each pixel has a marker, pass the number of the marker with --pixel-marker"
        ))
    })?;
    if (scan.width, scan.height) != (width, height) {
        bail!(
            "--pixels {width},{height}: the header of {file} describes {} columns and {} rows; use --pixels {},{}",
            scan.width,
            scan.height,
            scan.width,
            scan.height
        );
    }
    Ok(scan)
}
