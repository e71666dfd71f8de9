//! Tests `.ptu` files with round trips, record layouts, damaged files, scans and time stamps.

use super::error::PtuError;
use super::header::{Header, MAGIC};
use super::histogram::{Histograms, Plan, histogram};
use super::reader::Reader;
use super::record::{Decoder, Event, Mode, RecordType};
use super::scan::{Clock, Scan, Sweep};
use super::survey::survey;
use super::synth;
use super::tag::{Tag, Value};
use super::writer::{self, Description, Writer};
use optics::sampling::mix::mix;
use optics::sampling::stream::Stream;
use polarimetry::capture::detector::spad::{Mode as SpadMode, Spad};
use proptest::prelude::*;
use std::io::Cursor;
use std::path::Path;

pub(super) fn description(record: RecordType) -> Description {
    Description {
        record,
        resolution_s: 25e-12,
        global_resolution_s: if record.mode() == Mode::T3 { 100e-9 } else { 1e-12 },
        sync_rate: 10_000_000,
        tags: vec![],
    }
}

pub(super) fn bytes_of(record: RecordType, events: &[Event]) -> Vec<u8> {
    let mut out = Cursor::new(vec![]);
    let mut writer = Writer::begin(&mut out, &description(record)).expect("begins");
    for event in events {
        match *event {
            Event::Photon { time, dtime, channel } => writer.photon(time, dtime, channel),
            Event::Sync { time } => writer.sync(time),
            Event::Marker { time, bits } => writer.marker(time, bits),
            _ => Ok(()),
        }
        .expect("writes");
    }
    writer.end().expect("ends");
    out.into_inner()
}

/// Returns a sweep with pixels of equal duration.
pub(super) fn even(pixel_time: u64) -> Option<Sweep> {
    Some(Sweep { pixel_time, sine: None })
}

/// Returns a scan with pixel markers, in which the first marker input begins each pixel.
fn by_pixels(width: usize, height: usize) -> Scan {
    let clock = Clock { begin: 1, end: 0, frame: 0, sweep: None };
    Scan { width, height, bidirectional: false, clock }
}

pub(super) fn open(bytes: &[u8]) -> Result<Reader<&[u8]>, PtuError> {
    Reader::new(bytes, bytes.len() as u64, Path::new("f.ptu"))
}

fn events_of(bytes: &[u8]) -> Vec<Event> {
    let mut events = vec![];
    let mut reader = open(bytes).expect("opens");
    assert_eq!(reader.mismatch(), None);
    reader.events(|e| events.push(e)).expect("reads");
    events.retain(|e| !matches!(e, Event::Overflow { .. }));
    events
}

/// Returns events that a record type can represent, from random numbers.
fn events_for(record: RecordType, draws: &[(u64, u16, u8, u8)]) -> Vec<Event> {
    let (t3, mut time) = (record.mode() == Mode::T3, 0);
    let pico_t2 = record == RecordType::PicoHarpT2;
    let event = |(gap, dtime, channel, kind): &(u64, u16, u8, u8)| {
        time += gap;
        match kind {
            0 => {
                let bits = channel % 15 + 1;
                if pico_t2 {
                    // PicoHarp T2 markers overwrite the last bits of the time.
                    let at = time.next_multiple_of(16);
                    time = at + 15;
                    return Event::Marker { time: at + u64::from(bits), bits };
                }
                Event::Marker { time, bits }
            }
            1 if !t3 => Event::Sync { time },
            _ => {
                let channel = channel % record.channels();
                Event::Photon {
                    time,
                    dtime: if t3 { dtime % record.dtimes() as u16 } else { 0 },
                    channel: if pico_t2 { channel.max(1) } else { channel },
                }
            }
        }
    };
    draws.iter().map(event).collect()
}

/// Generates time gaps with zero, one and many overflows of every clock.
fn gap() -> impl Strategy<Value = u64> {
    prop_oneof![0..3u64, 0..2000u64, 0..300_000u64, 0..500_000_000u64]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 200, ..ProptestConfig::default() })]
    #[test]
    #[ignore = "slow: tools/check --all"]
    fn written_events_are_read_back(
        kind in 0..12usize,
        draws in prop::collection::vec((gap(), any::<u16>(), 0..64u8, 0..6u8), 0..200),
    ) {
        let record = RecordType::ALL[kind];
        let events = events_for(record, &draws);
        prop_assert_eq!(events_of(&bytes_of(record, &events)), events);
    }

    #[test]
    fn headers_round_trip(
        int in any::<i64>(), bits in any::<u64>(), float in any::<f64>().prop_filter("a number", |f| !f.is_nan()),
        text in "[ -~äß€ž]{0,40}", wide in "[ -~λ中😀]{0,20}", blob in prop::collection::vec(any::<u8>(), 0..5),
        floats in prop::collection::vec(-1e9..1e9f64, 0..9), index in -1..5i32,
    ) {
        let mut blob: Vec<u8> = blob;
        blob.resize(blob.len().next_multiple_of(8), 0);
        let values = [
            Value::Empty, Value::Bool(true), Value::Bool(false), Value::Int(int), Value::Bits(bits), Value::Color(bits),
            Value::Float(float), Value::Time(float), Value::Floats(floats), Value::Text(text), Value::Wide(wide),
            Value::Blob(blob), Value::Int(0x0001_0305),
        ];
        let mut tags: Vec<Tag> = (0..).zip(values).map(|(i, value)| Tag { name: format!("T{i}"), index, value }).collect();
        tags[12].name = "TTResultFormat_TTTRRecType".into();
        let header = Header { version: "1.0.00".into(), tags };
        let bytes = header.write().expect("writes");
        prop_assert_eq!(bytes.len() % 8, 0);
        let reader = open(&bytes).expect("opens");
        prop_assert_eq!(reader.header(), &header);
    }
}

/// Tests that single records are decoded according to PicoQuant's format description.
#[test]
fn records_decode_as_published() {
    let decode = |record, words: &[u32]| {
        let mut decoder = Decoder::new(record);
        let events: Vec<Event> = words.iter().map(|w| decoder.decode(*w)).collect();
        events
    };
    let photon = |time, dtime, channel| Event::Photon { time, dtime, channel };
    let (marker, over) = (|time, bits| Event::Marker { time, bits }, |time| Event::Overflow { time });
    let words = [0x0400_1c05, 0xfe00_0003, 0x0400_1c05, 0x8600_0009, 0xfe00_0000, 0x0000_0000, 0x8000_0009];
    let want = |three: u64, one: u64| {
        let unknown = Event::Unknown { record: 0x8000_0009 };
        vec![
            photon(5, 7, 2),
            over(three),
            photon(three + 5, 7, 2),
            marker(three + 9, 3),
            over(three + one),
            photon(three + one, 0, 0),
            unknown,
        ]
    };
    for record in [RecordType::TimeHarp260NT3, RecordType::GenericT3, RecordType::HydraHarp2T3] {
        assert_eq!(decode(record, &words), want(3072, 1024));
    }
    assert_eq!(decode(RecordType::HydraHarpT3, &words), want(1024, 1024));
    let words = [0x0400_0005, 0xfe00_0002, 0x8000_0007, 0x9e00_0001];
    let want = |n| vec![photon(5, 0, 2), over(n), Event::Sync { time: n + 7 }, marker(n + 1, 15)];
    assert_eq!(decode(RecordType::TimeHarp260PT2, &words), want(67_108_864));
    assert_eq!(decode(RecordType::HydraHarpT2, &words), want(33_552_000));
    let words = [0x2007_0005, 0xf000_0000, 0x1000_ffff, 0xf003_0005];
    let want = vec![photon(5, 7, 1), over(65_536), photon(131_071, 0, 0), marker(65_541, 3)];
    assert_eq!(decode(RecordType::PicoHarpT3, &words), want);
    let words = [0x2000_0005, 0xf000_0000, 0x0000_0009, 0xf000_0123];
    let (over_t2, sync) = (over(210_698_240), Event::Sync { time: 210_698_249 });
    assert_eq!(
        decode(RecordType::PicoHarpT2, &words),
        vec![photon(5, 0, 2), over_t2, sync, marker(210_698_531, 3)]
    );
}

pub(super) fn counted(bytes: &[u8], plan: &Plan) -> Histograms {
    histogram(&mut open(bytes).expect("opens"), plan).expect("counts")
}

/// Tests that histograms equal those of a simple loop over decoded events, for all record types, bin widths
/// and channels.
#[test]
fn histograms_equal_a_simple_loop() {
    let mut stream = Stream::new(5, 0, 0);
    for record in RecordType::ALL {
        let mut draw = |n: f32| (stream.uniform() * n) as u64;
        let draws: Vec<_> = (0..200_000)
            .map(|_| {
                (
                    draw(300.0),
                    draw(65536.0) as u16,
                    draw(64.0) as u8,
                    2 - draw(1.1).min(1) as u8 * draw(3.0) as u8,
                )
            })
            .collect();
        let events = events_for(record, &draws);
        let bytes = bytes_of(record, &events);
        for (bin, bins, channels) in [(1, 5000, vec![1, 3]), (7, 300, vec![2]), (16, 2048, vec![3, 2, 1])] {
            let mut want = vec![0; channels.len() * bins];
            let (mut sync, mut photons) = (None, 0);
            for event in &events {
                let (since, channel) = match *event {
                    Event::Sync { time } => {
                        sync = Some(time);
                        continue;
                    }
                    Event::Photon { time, dtime, channel } => match record.mode() {
                        Mode::T3 => (Some(u64::from(dtime)), channel),
                        Mode::T2 => (sync.map(|s: u64| time - s), channel),
                    },
                    _ => continue,
                };
                photons += 1;
                let at = channels.iter().position(|c| *c == channel);
                if let (Some(i), Some(b)) =
                    (at, since.map(|s| s as usize / bin as usize).filter(|b| *b < bins))
                {
                    want[i * bins + b] += 1;
                }
            }
            let got = counted(&bytes, &Plan { bin, bins, channels: channels.clone(), scan: None });
            assert!(want.iter().sum::<u32>() > 100, "{}", record.name());
            assert_eq!((got.counts, got.photons), (want, photons), "{}", record.name());
        }
        let found = survey(&mut open(&bytes).expect("opens")).expect("surveys");
        assert_eq!(
            found.photons.iter().sum::<u64>(),
            events.iter().filter(|e| matches!(e, Event::Photon { .. })).count() as u64
        );
        assert_eq!(found.unknown, 0);
    }
}

#[test]
fn damaged_files_are_refused_with_a_message() {
    let record = RecordType::GenericT3;
    let events: Vec<Event> = (0..10).map(|i| Event::Photon { time: i, dtime: 3, channel: 1 }).collect();
    let whole = bytes_of(record, &events);
    let refusal = |bytes: &[u8]| open(bytes).expect_err("refused").to_string();
    assert!(refusal(b"").contains("too short"));
    assert!(refusal(&[b'x'; 64]).starts_with("f.ptu: byte 0: the file does not begin with PQTTTR; pass"));
    assert!(refusal(&whole[..100]).contains("byte 80: the file ends inside the header"));
    // Change the type of the second tag.
    let mut wrong = whole.clone();
    wrong[16 + 36] = 9;
    assert!(
        refusal(&wrong).contains("byte 16: tag \"CreatorSW_Name\" has a value of unknown type 0x40"),
        "{}",
        refusal(&wrong)
    );
    // Declare a text of 2^60 bytes.
    let mut wrong = whole.clone();
    wrong[16 + 47] = 16;
    assert!(
        refusal(&wrong).contains("has a value of 1152921504606846992 bytes; expected at most 592 bytes"),
        "{}",
        refusal(&wrong)
    );
    let header = Header { version: "1.0.00".into(), tags: vec![] };
    assert!(refusal(&header.write().expect("writes")).contains("TTResultFormat_TTTRRecType"));
    let int = |v| vec![Tag::new("TTResultFormat_TTTRRecType", Value::Int(v))];
    let header = Header { version: String::new(), tags: int(0x0001_0399) };
    assert!(refusal(&header.write().expect("writes")).contains("0x10399; supported types: PicoHarp 300 T2"));
    // Truncate the file within the last record.
    let cut = open(&whole[..whole.len() - 6]).expect("opens");
    assert_eq!(cut.records(), 8);
    let message = cut.mismatch().expect("a mismatch").to_string();
    assert_eq!(
        message,
        "the header states 10 records, but the file contains 8 and 2 bytes of an incomplete record"
    );
    let plan = Plan { bin: 1, bins: 1 << 15, channels: vec![0], scan: None };
    let large = by_pixels(1 << 40, 1 << 40);
    let refused =
        |plan: Plan| histogram(&mut open(&whole).expect("opens"), &plan).expect_err("refused").to_string();
    assert!(refused(Plan { scan: Some(large), ..plan.clone() }).contains("more than 536870912"));
    assert!(refused(Plan { channels: vec![64], ..plan.clone() }).contains("no channel 64"));
    assert!(refused(Plan { bin: 0, ..plan }).contains("has no elements"));
}

#[test]
fn writers_refuse_values_out_of_range() {
    let mut out = Cursor::new(vec![]);
    let mut writer = Writer::begin(&mut out, &description(RecordType::PicoHarpT3)).expect("begins");
    writer.photon(9, 4095, 3).expect("writes");
    let refusal = |r: std::io::Result<()>| r.expect_err("refused").to_string();
    assert!(refusal(writer.photon(8, 0, 0)).contains("the event at time 8 follows an event at time 9"));
    assert!(refusal(writer.photon(9, 4096, 0)).contains("dtime 4096"));
    assert!(refusal(writer.photon(9, 0, 4)).contains("channel 4"));
    assert!(refusal(writer.marker(9, 16)).contains("marker bits"));
    assert!(refusal(writer.sync(9)).contains("T3"));
    assert!(refusal(writer.photon(u64::MAX, 0, 0)).contains("gap of"));
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("f.ptu");
    let failed = writer::write(&path, &description(RecordType::PicoHarpT3), |w| w.photon(0, 5000, 0));
    assert!(failed.is_err() && !path.exists());
    let n = writer::write(&path, &description(RecordType::PicoHarpT3), |w| w.photon(70_000, 50, 0))
        .expect("writes");
    assert_eq!((n, Reader::open(&path).expect("opens").records()), (2, 2));
}

/// Tests that the reader reads 10,000 damaged, truncated or random files quickly, either to the end or until
/// an error message.
#[test]
fn damaged_files_are_read_or_refused() {
    let mut state = 7;
    let mut draw = move |below: usize| {
        state = mix(state + 1);
        (state % below.max(1) as u64) as usize
    };
    let seeds: Vec<Vec<u8>> = RecordType::ALL
        .map(|record| {
            let draws: Vec<_> = (0..300)
                .map(|_| (draw(5000) as u64, draw(65536) as u16, draw(64) as u8, draw(6) as u8))
                .collect();
            bytes_of(record, &events_for(record, &draws))
        })
        .into();
    let (mut read, mut refused) = (0, 0);
    for i in 0..10_000 {
        let mut bytes = seeds[i % seeds.len()].clone();
        match draw(4) {
            0 => bytes.truncate(draw(bytes.len())),
            1 => {
                bytes = (0..draw(4000)).map(|_| draw(256) as u8).collect();
                let magic = MAGIC.len().min(bytes.len());
                bytes[..magic].copy_from_slice(&MAGIC[..magic]);
            }
            2 => bytes.extend((0..draw(9)).map(|_| draw(256) as u8)),
            _ => {}
        }
        for _ in 0..draw(12) {
            let at = draw(bytes.len());
            if let Some(b) = bytes.get_mut(at) {
                *b = [draw(256) as u8, 0xff, 0, *b ^ 1 << draw(8)][draw(4)];
            }
        }
        let result = open(&bytes).and_then(|mut reader| {
            let pixels = Clock { begin: 1, end: draw(3) as u8, frame: 4, sweep: None };
            let lines = Clock { begin: 1, end: 2, frame: 4, sweep: even(draw(3000) as u64) };
            let clock = if i % 2 == 0 { pixels } else { lines };
            let scan = Scan { width: 1 + draw(5), height: 1 + draw(5), bidirectional: false, clock };
            let scan = Scan::of_header(reader.header()).unwrap_or(scan);
            let plan = Plan {
                bin: 1 + draw(900) as u32,
                bins: 1 + draw(200),
                channels: vec![1, 2],
                scan: Some(scan),
            };
            assert!(Plan::period_bins(&reader, plan.bin) <= 1 << 15);
            let surveyed = survey(&mut open(&bytes)?)?;
            // An empty histogram is also an error.
            let result = histogram(&mut reader, &plan)?;
            assert_eq!(result.counted() + result.left_out.photons(), result.photons);
            assert_eq!(result.photons, surveyed.photons.iter().sum::<u64>());
            Ok(())
        });
        match result {
            Ok(()) => read += 1,
            Err(e) => {
                assert!(e.to_string().starts_with("f.ptu: "), "{e}");
                refused += 1;
            }
        }
    }
    assert!(read > 2000 && refused > 2000, "{read} read, {refused} refused");
}

/// Compares counts with expected counts. Returns the number of standard deviations by which chi-squared
/// exceeds its mean.
fn chi_squared(counts: &[f64], expected: &[f64]) -> f64 {
    let used: Vec<_> = counts.iter().zip(expected).filter(|(_, e)| **e >= 10.0).collect();
    let sum: f64 = used.iter().map(|(c, e)| (*c - *e).powi(2) / *e).sum();
    assert!(used.len() > 20);
    (sum - used.len() as f64) / (2.0 * used.len() as f64).sqrt()
}

/// Tests that histograms of a simulated diode match the theory of first detections, and that no pulse has two
/// detections.
#[test]
fn time_stamps_match_a_simulated_diode() {
    let spad = Spad { bins: 100, bin_ps: 25.0, period_ps: 2500.0, pulses: 200_000, ..Spad::default() };
    let light: Vec<f64> = (0..100).map(|i| 0.03 * (-0.05 * f64::from((i - 30i32).abs())).exp()).collect();
    let rates = spad.rates(&light, 550.0).expect("rates");
    let mut survives = 1.0;
    let share = |rate: &f64| {
        let p = survives * -(-rate).exp_m1();
        survives -= p;
        p
    };
    let shares: Vec<f64> = rates.iter().map(share).collect();
    let mut out = Cursor::new(vec![]);
    let record = RecordType::TimeHarp260NT3;
    let mut writer = Writer::begin(&mut out, &description(record)).expect("begins");
    let (mut early, mut stamps) = (vec![0.0; 100], 0);
    for pixel in 0..20 {
        let begin = u64::from(pixel) * spad.pulses;
        writer.marker(begin, 1).expect("writes");
        let mut stream = Stream::new(mix(3), pixel, 0);
        let counts = spad.count(&rates, &mut stream).expect("counts");
        let dwell = synth::deal(&counts, spad.pulses, spad.mode == SpadMode::Synchronous, &mut stream);
        assert!(
            dwell.windows(2).all(|w| w[0].sync < w[1].sync) && dwell.iter().all(|s| s.sync < spad.pulses)
        );
        stamps += dwell.len();
        for s in dwell {
            // The first tenth of the pulses has a tenth of the detections of every bin.
            early[s.bin as usize] += f64::from(u8::from(s.sync < spad.pulses / 10));
            writer.photon(begin + s.sync, s.bin as u16, 0).expect("writes");
        }
    }
    writer.end().expect("ends");
    let scan = Some(by_pixels(5, 4));
    let got = counted(&out.into_inner(), &Plan { bin: 1, bins: 100, channels: vec![0], scan });
    assert_eq!(got.counted(), stamps as u64);
    let total: Vec<f64> =
        (0..100).map(|b| got.counts.iter().skip(b).step_by(100).map(|n| f64::from(*n)).sum()).collect();
    let expected = |pulses: f64| shares.iter().map(|p| p * pulses).collect::<Vec<f64>>();
    let z = chi_squared(&total, &expected(4e6));
    assert!(z.abs() < 5.0, "{z}");
    let z = chi_squared(&early, &expected(4e5));
    assert!(z.abs() < 5.0, "{z}");
    // As a control, the statistic detects counts that are shifted by one bin.
    let mut wrong = total.clone();
    wrong.rotate_left(1);
    assert!(chi_squared(&wrong, &expected(4e6)) > 5.0);
    // If most pulses have a detection, all sets of pulses are still equally likely.
    let mut first = 0;
    for seed in 0..2000 {
        let dealt = synth::deal(&[3, 4], 10, true, &mut Stream::new(seed, 0, 0));
        assert!(dealt.len() == 7 && dealt.windows(2).all(|w| w[0].sync < w[1].sync));
        first += u32::from(dealt[0].sync == 0 && dealt[0].bin == 0);
    }
    // The expected count is 2000 · 0.7 · 3/7 = 600. Five standard deviations are 5 √(2000 · 0.3 · 0.7) = 5 ·
    // 20.5.
    assert!(first.abs_diff(600) < 103, "{first}");
}
