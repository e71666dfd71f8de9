//! Tests the assignment of photons to the pixels of images, and the counts of photons outside all pixels.

use super::header::Header;
use super::histogram::{LeftOut, Plan, histogram};
use super::meaning;
use super::record::{Event, Mode, RecordType};
use super::scan::{Clock, Scan};
use super::tag::{Tag, Value};
use super::tests::{bytes_of, counted, even, open};

/// Tests that photons between the markers of a pixel belong to that pixel, and that photons between pixels
/// belong to no pixel.
#[test]
fn markers_assign_photons_to_pixels() {
    let plan = |clock| plan(8, Some(Scan { width: 2, height: 2, bidirectional: false, clock }));
    // The events are:
    // - a frame, a photon before the first pixel, pixels 0 and 1, and a photon between pixels
    // - a second frame, pixels 0 to 3 and an excess pixel
    let events = [
        marker(0, 4),
        photon(1, 0),
        marker(2, 1),
        photon(3, 1),
        marker(3, 2),
        photon(4, 2),
        marker(5000, 1),
        photon(5001, 3),
        marker(6000, 5),
        photon(6000, 4),
        marker(6001, 1),
        marker(6002, 1),
        marker(6003, 1),
        photon(6004, 5),
        marker(6005, 1),
        photon(6006, 6),
    ];
    let clock = Clock { begin: 1, end: 2, frame: 4, sweep: None };
    let got = counted(&bytes_of(RECORD, &events), &plan(clock));
    let mut want = vec![0; 32];
    [1, 8 + 3, 4, 24 + 5].iter().for_each(|i| want[*i] = 1);
    assert_eq!((got.counts.clone(), got.photons, got.counted()), (want, 7, 4));
    assert_eq!(got.shape, [2, 2, 1, 8]);
    // Each line has two pixels of 100 pulses each.
    let events = [
        photon(9, 0),
        marker(1000, 1),
        photon(1000, 1),
        photon(1099, 1),
        photon(1100, 2),
        photon(1199, 2),
        photon(1200, 3),
        marker(1300, 2),
        photon(1301, 3),
        marker(4000, 1),
        photon(4150, 4),
        marker(4160, 2),
        photon(4170, 4),
        marker(5000, 4),
        marker(5000, 1),
        photon(5000, 5),
        marker(6000, 1),
        marker(7000, 1),
        photon(7001, 6),
    ];
    let clock = Clock { sweep: even(100), ..clock };
    let got = counted(&bytes_of(RECORD, &events), &plan(clock));
    let mut want = vec![0; 32];
    [(1, 2), (8 + 2, 2), (24 + 4, 1), (5, 1)].iter().for_each(|(i, n)| want[*i] = *n);
    assert_eq!(got.counts, want);
}

const RECORD: RecordType = RecordType::TimeHarp260PT3;

fn photon(time: u64, dtime: u16) -> Event {
    Event::Photon { time, dtime, channel: 0 }
}

fn marker(time: u64, bits: u8) -> Event {
    Event::Marker { time, bits }
}

/// Returns the header of an image of 3 × 4 pixels of 100 pulses (100 ns each), modified by `other` tags.
fn image_header(other: &[(&str, Value)]) -> Header {
    let own = [
        ("MeasDesc_GlobalResolution", Value::Float(1e-7)),
        ("ImgHdr_Dimensions", Value::Int(3)),
        ("ImgHdr_LineStart", Value::Int(1)),
        ("ImgHdr_LineStop", Value::Int(2)),
        ("ImgHdr_Frame", Value::Int(3)),
        ("ImgHdr_TimePerPixel", Value::Float(0.01)),
        ("ImgHdr_PixX", Value::Int(3)),
        ("ImgHdr_PixY", Value::Int(4)),
    ];
    let own = own.into_iter().filter(|(n, _)| other.iter().all(|(o, _)| o != n));
    Header {
        version: "1.0.00".into(),
        tags: own.chain(other.iter().cloned()).map(|(n, v)| Tag::new(n, v)).collect(),
    }
}

fn plan(bins: usize, scan: Option<Scan>) -> Plan {
    Plan { bin: 1, bins, channels: vec![0], scan }
}

/// Tests that backward rows are reversed in scans with line markers and in scans with pixel markers. The
/// value of the tag can be a boolean or a number.
#[test]
fn backward_rows_are_reversed() {
    for (tag, back) in [
        (Value::Bool(true), true),
        (Value::Int(1), true),
        (Value::Bits(1), true),
        (Value::Bool(false), false),
        (Value::Int(0), false),
    ] {
        let scan = Scan::of_header(&image_header(&[("ImgHdr_BiDirect", tag)])).expect("a scan");
        assert_eq!((scan.width, scan.height, scan.bidirectional), (3, 4, back));
        // Row y has y + 1 photons in the last pixel of its sweep. This pixel is in column 2 of rows 0 and 2,
        // and in column 0 of rows 1 and 3.
        let (mut lines, mut pixels) = (vec![], vec![]);
        for y in 0..4 {
            let begin = 1000 * (y + 1);
            lines.push(marker(begin, 1));
            lines.extend((0..=y).map(|_| photon(begin + 250, 0)));
            lines.push(marker(begin + 300, 2));
            for x in 0..3 {
                pixels.push(marker(begin + 100 * x, 1));
                if x == 2 {
                    pixels.extend((0..=y).map(|_| photon(begin + 250, 0)));
                }
            }
        }
        let want =
            if back { [0, 0, 1, 2, 0, 0, 0, 0, 3, 4, 0, 0] } else { [0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0, 4] };
        assert_eq!(counted(&bytes_of(RECORD, &lines), &plan(1, Some(scan))).counts, want);
        let clock = Clock { begin: 1, end: 0, frame: 0, sweep: None };
        let scan = Scan { clock, ..scan };
        assert_eq!(counted(&bytes_of(RECORD, &pixels), &plan(1, Some(scan))).counts, want);
    }
}

/// Tests that an error about a missing or inconsistent image header names the tag.
#[test]
fn inconsistent_headers_are_refused() {
    for (tag, value) in [
        ("ImgHdr_LineStart", Value::Int(0)),
        ("ImgHdr_LineStart", Value::Int(5)),
        ("ImgHdr_LineStart", Value::Int(-1)),
        ("ImgHdr_LineStart", Value::Empty),
        ("ImgHdr_LineStop", Value::Int(1)),
        ("ImgHdr_Frame", Value::Int(2)),
        ("ImgHdr_Frame", Value::Int(64)),
        ("ImgHdr_TimePerPixel", Value::Float(0.0)),
        ("ImgHdr_TimePerPixel", Value::Float(f64::NAN)),
        ("ImgHdr_TimePerPixel", Value::Float(1e-9)),
        ("ImgHdr_SinCorrection", Value::Int(-1)),
        ("ImgHdr_SinCorrection", Value::Float(100.5)),
        ("ImgHdr_Dimensions", Value::Int(1)),
        ("ImgHdr_PixX", Value::Int(0)),
        ("ImgHdr_PixY", Value::Int(-4)),
        ("MeasDesc_GlobalResolution", Value::Float(-1.0)),
    ] {
        let why = Scan::of_header(&image_header(&[(tag, value.clone())])).expect_err(tag);
        assert!(why.contains(tag), "{tag} {value:?}: {why}");
    }
}

/// Tests that every photon is either in the histogram or counted under the reason for its exclusion.
#[test]
fn photons_in_no_bin_are_counted_by_reason() {
    let other = Event::Photon { time: 5000, dtime: 0, channel: 3 };
    let events = [
        photon(10, 0),
        marker(1000, 1),
        photon(1000, 1),
        photon(1010, 9),
        photon(1020, 7),
        photon(1400, 0),
        marker(1500, 2),
        photon(1600, 0),
        other,
    ];
    let scan = Scan::of_header(&image_header(&[])).expect("a scan");
    let got = counted(&bytes_of(RECORD, &events), &plan(2, Some(scan)));
    let want = LeftOut { channels: 1, pixels: 3, later: 2, latest: 9, ..LeftOut::default() };
    assert_eq!((got.left_out, got.photons, got.counted()), (want, 7, 1));
    assert_eq!((got.beyond, got.missing), (0, 3));
    assert_eq!(
        got.left_out.describe(Some(1e-9)),
        "1 in other channels, 3 outside the pixels of the scan, 2 after the last bin (up to 9.000 ns after the pulse)"
    );
    let t2 = [photon(5, 0), Event::Sync { time: 10 }, photon(11, 0), photon(99, 0)];
    let got = counted(&bytes_of(RecordType::GenericT2, &t2), &plan(8, None));
    let want = LeftOut { before_sync: 1, later: 1, latest: 89, ..LeftOut::default() };
    assert_eq!((got.left_out, got.photons, got.counted()), (want, 3, 1));
}

/// Tests that an empty histogram is an error that states the reason.
#[test]
fn empty_histograms_are_refused() {
    let scan = Scan::of_header(&image_header(&[])).expect("a scan");
    let pixels = Clock { begin: 8, end: 0, frame: 0, sweep: None };
    let by_pixels = Scan { clock: pixels, ..scan };
    let (t3, t2) = (RECORD, RecordType::GenericT2);
    for (record, events, plan, why) in [
        (t3, vec![], plan(4, None), "contains no photons"),
        (t3, vec![marker(5, 1)], plan(4, Some(scan)), "contains no photons"),
        (
            t3,
            vec![marker(5, 2), photon(9, 0)],
            plan(4, Some(scan)),
            "marker 1, which begins each line, does not occur",
        ),
        (
            t3,
            vec![marker(5, 1), photon(9, 0)],
            plan(4, Some(by_pixels)),
            "marker 4, which begins each pixel,",
        ),
        (t2, vec![photon(9, 0), photon(12, 0)], plan(4, None), "there are no sync pulses"),
        (t2, vec![photon(9, 0), Event::Sync { time: 12 }], plan(4, None), "1 before the first sync"),
        (
            t3,
            vec![photon(9, 4)],
            plan(4, None),
            "none of the 1 photons is in a bin of the histogram: 1 after the last",
        ),
        (t3, vec![photon(9, 0)], Plan { channels: vec![1], ..plan(4, None) }, "1 in other channels"),
    ] {
        let bytes = bytes_of(record, &events);
        let message = histogram(&mut open(&bytes).expect("opens"), &plan).expect_err(why);
        assert!(message.to_string().contains(why), "{why}: {message}");
    }
}

/// Tests that lines before the first frame marker are excluded if they are too few for a frame. An incomplete
/// last frame is kept.
#[test]
fn incomplete_frames_are_skipped_only_at_the_beginning() {
    let scan = Scan::of_header(&image_header(&[])).expect("a scan");
    let line = |begin: u64| [marker(begin, 1), photon(begin + 10, 0), marker(begin + 300, 2)];
    for (before, torn) in [(0, 0), (1, 1), (2, 2), (3, 0), (4, 0)] {
        let mut events: Vec<Event> = (0..before).flat_map(|y| line(1000 * (y + 1))).collect();
        events.push(marker(9000, 4));
        events.extend((10..12).flat_map(|y| line(1000 * y)));
        let got = counted(&bytes_of(RECORD, &events), &plan(1, Some(scan)));
        assert_eq!((got.left_out.torn_frame, got.missing), (torn, 2), "{before} lines before");
        assert_eq!(got.counted(), 2 + before - torn, "{before} lines before the first frame marker");
    }
}

/// Tests that the last partial bin is included if the period is not a multiple of the resolution.
#[test]
fn the_last_partial_bin_of_a_period_is_counted() {
    let tags = |period: f64, resolution: f64| Header {
        version: "1.0.00".into(),
        tags: vec![
            Tag::new("TTResultFormat_TTTRRecType", Value::Int(i64::from(RECORD.code()))),
            Tag::new("MeasDesc_GlobalResolution", Value::Float(period)),
            Tag::new("MeasDesc_Resolution", Value::Float(resolution)),
        ],
    };
    for (period, resolution, bin, bins) in
        [(1e-7, 97e-12, 1, 1031), (1e-7, 25e-12, 1, 4000), (1e-7, 25e-12, 3, 1334), (50e-9, 0.1, 1, 32768)]
    {
        let bytes = tags(period, resolution).write().expect("writes");
        assert_eq!(Plan::period_bins(&open(&bytes).expect("opens"), bin), bins);
    }
}

/// Tests that every tag is descriptive, used, or reported in a note.
#[test]
fn unused_tags_are_noted() {
    let scan = Scan::of_header(&image_header(&[])).expect("a scan");
    let noted =
        |other: &[(&str, Value)]| meaning::notes(&image_header(other), Mode::T3, Some(&scan)).join("\n");
    assert_eq!(noted(&[("HW_Type", Value::text("x")), ("File_GUID", Value::text("y"))]), "");
    for i in 0..100 {
        let name = format!("Img{i}_Shift");
        let message = noted(&[(&name, Value::Int(i))]);
        assert!(message.contains(&name), "{message}");
    }
    assert!(noted(&[("ImgHdr_TStartTo", Value::Float(1.0))]).contains("ImgHdr_TStartTo"));
    assert!(noted(&[("ReqHdr_ScanningPattern", Value::Int(1))]).contains("ReqHdr_ScanningPattern"));
    let divided = image_header(&[("HWSync_Divider", Value::Int(4))]);
    assert!(meaning::notes(&divided, Mode::T2, None)[0].starts_with("HWSync_Divider is 4"));
    let notes = meaning::notes(&divided, Mode::T3, None);
    assert!(!notes.iter().any(|n| n.contains("HWSync_Divider")), "{notes:?}");
    // The mode of these records contradicts the mode in the header.
    let mixed = image_header(&[
        ("TTResultFormat_TTTRRecType", Value::Int(0x0001_0305)),
        ("Measurement_Mode", Value::Int(2)),
    ]);
    let message = open(&mixed.write().expect("writes")).expect_err("refused").to_string();
    assert!(message.contains("Measurement_Mode is T2"), "{message}");
}
