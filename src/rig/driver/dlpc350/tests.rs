//! Tests packets, the driver with the emulator, and invalid report streams.

use super::super::line::LineError;
use super::command::{Begin, Command, Entry, Question, Run, complaints};
use super::emulator::{Emulator, Trouble};
use super::hid::{Assembler, HidLine, Message, REPORT};
use super::projector::{Dlpc350, Flash, SIZE};
use super::trigger::{Edge, Input, Output, Triggers};
use crate::conformance;
use crate::instrument::{Fault, Instrument, Pattern, PatternProjector};
use proptest::prelude::*;
use std::time::{Duration, Instant};

const LONG: Duration = Duration::from_secs(5);
const PERIOD: Duration = Duration::from_millis(1);

fn stripes(width: usize) -> Pattern {
    let [w, h] = SIZE.map(|n| n as usize);
    Pattern {
        width: SIZE[0],
        height: SIZE[1],
        pixels: (0..w * h).map(|i| if (i % w / width).is_multiple_of(2) { 255 } else { 0 }).collect(),
    }
}

fn negative(p: &Pattern) -> Pattern {
    let pixels = p.pixels.iter().map(|v| 255 - v).collect();
    Pattern { pixels, ..p.clone() }
}

fn emulated() -> (Dlpc350, Emulator) {
    let emulator = Emulator::new(2);
    let flash = Flash(vec![vec![stripes(1), stripes(2)], vec![stripes(8)]]);
    (Dlpc350::new("dmd", Box::new(emulator.clone()), flash, 2, PERIOD).expect("a projector"), emulator)
}

/// Compares bytes with the guide. The order is flags, number, length, CMD3, CMD2, data.
#[test]
fn packets_match_the_guide() {
    let (code, data) = Command::Run(Run::Start).encode();
    let reports = Message::host(false, 7, code, &data).reports();
    assert_eq!(reports.len(), 1);
    assert_eq!(reports[0][..8], [0x40, 7, 3, 0, 0x24, 0x1A, 2, 0]);
    let reports = Message::host(true, 0, Question::Main as u16, &[]).reports();
    assert_eq!(reports[0][..7], [0xC0, 0, 2, 0, 0x0C, 0x1A, 0]);
    // 128 patterns are 384 bytes. The first report holds 58 bytes, and each subsequent report holds 64 bytes.
    let reports = Message::host(false, 1, 0x1A34, &[0xAB; 384]).reports();
    assert_eq!(reports.len(), 1 + (384_usize - 58).div_ceil(64));
    assert_eq!(reports[0][2..6], [0x82, 0x01, 0x34, 0x1A]);
    let ends = reports.last().expect("reports").iter().filter(|b| **b == 0xAB).count();
    assert_eq!(ends, (384 - 58) % 64);
    let times = Command::Exposure { exposure_us: 1000, period_us: 0x0001_0203 };
    assert_eq!(times.encode().1, [0xE8, 3, 0, 0, 3, 2, 1, 0]);
}

#[test]
fn the_driver_conforms() {
    let (mut projector, emulator) = emulated();
    conformance::pattern_projector(&mut projector).assert_passed("DLPC350 (emulated)", 15);
    assert_eq!(emulator.light(), None, "it is dark at the end");
}

#[test]
fn patterns_are_found_in_flash() {
    let (mut projector, emulator) = emulated();
    let wanted = [stripes(8), negative(&stripes(2)), stripes(1)];
    projector.load(&wanted, LONG).expect("all are there");
    for (n, (image, plane, negative)) in [(1, 0, false), (0, 1, true), (0, 0, false)].into_iter().enumerate()
    {
        projector.show(n, LONG).expect("shows");
        let light = emulator.light().expect("light");
        let entry = light.entry;
        assert_eq!((light.image, entry.plane, entry.negative), (image, plane, negative));
        assert_eq!((entry.bits, entry.leds, entry.begin), (1, 2, Begin::Internal));
    }
    projector.dark(LONG).expect("dark");
    assert_eq!(emulator.light(), None);
    let failure = projector.load(&[stripes(3)], LONG).expect_err("not there");
    assert!(failure.fault == Fault::Limit && failure.what.contains("flash"), "{failure}");
    projector.show(0, LONG).expect("what was loaded before is still there");
    // The flash list belongs to another firmware.
    let small = Emulator::new(1);
    let flash = Flash(vec![vec![], vec![stripes(8)]]);
    let mut projector = Dlpc350::new("dmd", Box::new(small), flash, 2, PERIOD).expect("a projector");
    let failure = projector.load(&[stripes(8)], LONG).expect_err("one image");
    assert!(failure.fault == Fault::Limit && failure.what.contains("firmware"), "{failure}");
}

#[test]
fn faults_are_distinguished() {
    let (mut projector, emulator) = emulated();
    projector.load(&[stripes(1)], LONG).expect("loads");
    let short = Duration::from_millis(60);
    for (trouble, fault) in [
        (Trouble::Silent, Fault::Timeout),
        (Trouble::Refuses, Fault::Refused),
        (Trouble::Out, Fault::Disconnected),
        (Trouble::Aborts, Fault::Refused),
    ] {
        emulator.trouble(trouble);
        let begun = Instant::now();
        let failure = projector.show(0, short).expect_err("fails");
        assert_eq!(failure.fault, fault, "{trouble:?}: {failure}");
        assert!(begun.elapsed() < 5 * short, "{trouble:?} took {:?}", begun.elapsed());
        emulator.trouble(Trouble::None);
        projector.show(0, LONG).expect("continues");
    }
    emulator.trouble(Trouble::Noise);
    projector.show(0, LONG).expect("noise or not");
    emulator.trouble(Trouble::Out);
    assert_eq!(projector.reconnect(LONG).expect_err("out").fault, Fault::Disconnected);
    emulator.trouble(Trouble::None);
    projector.reconnect(LONG).expect("back");
    assert_eq!(projector.show(0, LONG).expect_err("settings have to be made again").fault, Fault::Limit);
}

#[test]
fn unsupported_settings_are_refused() {
    let new = |flash: Flash, leds: u8, period: Duration| {
        Dlpc350::new("dmd", Box::new(Emulator::new(1)), flash, leds, period).err().map(|f| f.fault)
    };
    assert_eq!(new(Flash::default(), 0, PERIOD), Some(Fault::Limit));
    assert_eq!(new(Flash::default(), 8, PERIOD), Some(Fault::Limit));
    assert_eq!(new(Flash::default(), 7, Duration::from_micros(200)), Some(Fault::Limit));
    assert_eq!(new(Flash(vec![vec![]; 65]), 7, PERIOD), Some(Fault::Limit));
    let mut grey = stripes(1);
    grey.pixels[0] = 7;
    assert_eq!(new(Flash(vec![vec![grey]]), 7, PERIOD), Some(Fault::Limit));
    assert_eq!(new(Flash::default(), 7, PERIOD), None);
    assert_eq!(complaints(0b11).len(), 2);
}

/// The driver sets triggers before it requests validation of the sequence. No other test checks the order.
/// Trigger times are in steps of 107.2 ns, and 0xBB is the start of the pattern (as in TI's own program).
#[test]
fn triggers_match_the_guide() {
    let triggers = Triggers {
        output_1: Some(Output { active_low: true, rise_us: 0.0, fall_us: 2.787 }),
        output_2: Some(Output { rise_us: -20.05, ..Output::default() }),
        input: Some(Input { edge: Edge::Falling, delay_us: 1000.0 }),
    };
    let (dmd, emulator) = emulated();
    let mut dmd = dmd.with_triggers(triggers).expect("triggers");
    dmd.load(&[stripes(1)], LONG).expect("in flash");
    dmd.show(0, LONG).expect("shows");
    assert_eq!(emulator.trigger(0x1A1D), Some(vec![1, 0xBB, 0xD5]));
    assert_eq!(emulator.trigger(0x1A1E), Some(vec![0, 0]));
    let steps = (1000.0_f64 / 0.1072).round() as u32;
    assert_eq!(emulator.trigger(0x1A35), Some(steps.to_le_bytes().to_vec()));
    let entry = emulator.light().expect("light").entry;
    assert!(entry.begin == Begin::Falling && entry.dark_after);
    // An instrument that waits for triggers also passes the conformance suite.
    conformance::pattern_projector(&mut dmd).assert_passed("DLPC350 with triggers", 15);
    let refused = |triggers: Triggers, words: &str| {
        let text = emulated().0.with_triggers(triggers).err().expect("a fault");
        assert!(text.fault == Fault::Limit && text.what.contains(words), "{text}");
    };
    let output = |rise_us, fall_us| Some(Output { active_low: false, rise_us, fall_us });
    for us in [-20.2, 2.9, f64::NAN, f64::INFINITY] {
        let output_1 = output(us, 0.0);
        refused(Triggers { output_1, ..Triggers::default() }, "output_1.rise_us");
    }
    let output_2 = output(0.0, 1.0);
    refused(Triggers { output_2, ..Triggers::default() }, "no adjustable falling edge");
    for delay_us in [-1.0, 56_300.0, f64::NAN] {
        let input = Some(Input { edge: Edge::Rising, delay_us });
        refused(Triggers { input, ..Triggers::default() }, "delay_us");
    }
    let emulator = Emulator::new(1);
    let fast = Dlpc350::new("dmd", Box::new(emulator), Flash::default(), 1, Duration::from_micros(300));
    let input = triggers.input;
    let text = fast.expect("a projector").with_triggers(Triggers { input, ..Triggers::default() });
    assert!(text.err().expect("a fault").what.contains("230 µs of black"));
}

#[test]
fn invalid_sequences_do_not_start() {
    let mut line = Emulator::new(1);
    let mut number = 0;
    let mut send = |read: bool, code: u16, data: &[u8]| {
        number += 1;
        for report in Message::host(read, number, code, data).reports() {
            line.write(&report).expect("writes");
        }
        Assembler::default().feed(&line.read(PERIOD).expect("answers")).expect("a message")
    };
    assert!(send(false, 0x1A24, &[2]).refused, "nothing was validated");
    assert!(!send(false, 0x1A29, &[100, 0, 0, 0, 100, 0, 0, 0]).refused);
    assert!(!send(false, 0x1A1A, &[0]).refused);
    assert_eq!(send(true, 0x1A1A, &[]).payload, [0x80]);
    assert_eq!(send(true, 0x1A1A, &[]).payload, [0x80]);
    assert_eq!(send(true, 0x1A1A, &[]).payload, [3], "too short, and no table");
    assert!(send(false, 0x1A24, &[2]).refused);
    assert!(send(false, 0x1234, &[0]).refused && send(true, 0x1234, &[]).refused);
}

#[cfg(target_os = "linux")]
#[test]
fn device_files_are_found_by_their_ids() {
    use super::hidraw;
    let class = tempfile::tempdir().expect("a folder");
    for (name, id) in [("hidraw3", "0003:00000451:00006401"), ("hidraw0", "0003:0000046D:0000C077")] {
        let device = class.path().join(name).join("device");
        std::fs::create_dir_all(&device).expect("made");
        std::fs::write(device.join("uevent"), format!("DRIVER=hid-generic\nHID_ID={id}\n")).expect("written");
    }
    let found = hidraw::find(class.path(), hidraw::DLPC350);
    assert_eq!(found, [std::path::Path::new("/dev/hidraw3")]);
    assert!(hidraw::find(&class.path().join("none"), hidraw::DLPC350).is_empty());
    let missing = hidraw::HidRaw::open([0xFFFF, 0xFFFE]).err().expect("no such device");
    assert!(missing.to_string().contains("ffff:fffe"), "{missing}");
}

/// A line that returns fixed reports regardless of its input, and then times out.
struct Garbage(Vec<[u8; REPORT]>);

impl HidLine for Garbage {
    fn write(&mut self, _report: &[u8; REPORT]) -> Result<(), LineError> {
        Ok(())
    }
    fn read(&mut self, _within: Duration) -> Result<[u8; REPORT], LineError> {
        self.0.pop().ok_or(LineError::Timeout)
    }
    fn reopen(&mut self) -> Result<(), LineError> {
        Ok(())
    }
}

fn report() -> impl Strategy<Value = [u8; REPORT]> {
    let head = prop::sample::select(vec![0x40_u8, 0xC0, 0x60, 0xE0, 0x00, 0xFF]);
    let rest = prop::collection::vec(any::<u8>(), REPORT - 4);
    (head, 0..4_u8, 0..700_u16, rest).prop_map(|(flags, number, length, rest)| {
        let mut all = vec![flags, number];
        all.extend(length.to_le_bytes());
        all.extend(rest);
        all.try_into().expect("64 bytes")
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]

    /// Ten thousand random streams cause no panic and no hang, in the driver or in the emulator.
    #[test]
    #[ignore = "slow: tools/check --all"]
    fn random_reports_never_panic_or_hang(reports in prop::collection::vec(report(), 0..24), which in 0..4_u8) {
        let begun = Instant::now();
        let mut emulator = Emulator::new(1);
        for r in &reports {
            emulator.write(r).expect("takes it");
        }
        let mut dmd = Dlpc350::new("dmd", Box::new(Garbage(reports)), Flash::default(), 1, PERIOD).expect("a projector");
        match which {
            0 => drop(dmd.identify(LONG)),
            1 => drop(dmd.reconnect(LONG)),
            2 => drop(dmd.dark(LONG)),
            _ => drop(dmd.load(&[], LONG).and_then(|()| dmd.show(0, LONG))),
        }
        prop_assert!(begun.elapsed() < LONG);
    }

    #[test]
    fn messages_round_trip(data in prop::collection::vec(any::<u8>(), 0..400), number: u8, read: bool) {
        let message = Message::host(read, number, 0x1A34, &data);
        let mut parser = Assembler::default();
        let found: Vec<Message> = message.reports().iter().filter_map(|r| parser.feed(r)).collect();
        prop_assert_eq!(found, vec![message]);
    }

    #[test]
    fn entries_round_trip(a: u8, b in 0..0x80_u8, c in 0..0x10_u8) {
        prop_assert_eq!(Entry::read([a, b, c]).bytes(), [a, b, c]);
    }
}
