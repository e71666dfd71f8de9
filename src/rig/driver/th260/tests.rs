//! Tests the commands, error codes and failures of the driver with a simulated board. The test also compiles
//! a library and loads this library in place of PicoQuant's.

use super::code;
use super::counter::Th260Counter;
use super::fake::Fake;
use super::library::{Order, load, names};
use super::settings::{Edge, Measurement, Th260Settings};
use crate::conformance;
use crate::instrument::{CounterSettings, Fault, Instrument, PhotonCounter};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

const WITHIN: Duration = Duration::from_secs(5);

fn settings() -> CounterSettings {
    CounterSettings {
        bins: 400,
        bin_ps: 50.0,
        dwell: Duration::from_millis(2),
        offset_ps: 10_010.0,
        tags: false,
    }
}

fn counter(fake: &Fake) -> Th260Counter {
    Th260Counter::new("counter", Box::new(fake.clone()), Th260Settings::default()).expect("a counter")
}

#[test]
fn both_boards_conform() {
    for model in ["P", "N"] {
        let report = conformance::photon_counter::photon_counter(&mut counter(&Fake::new(model)));
        report.assert_passed(&format!("TimeHarp 260 {model}"), 14);
    }
}

/// The driver calls the library in the order of the manual: initialize, set inputs, apply settings, clear,
/// start, stop, read.
#[test]
fn calls_follow_the_order_of_the_manual() {
    let fake = Fake::new("P");
    let mut board = counter(&fake);
    assert_eq!(
        std::mem::take(&mut fake.state().reported),
        [
            Order::Initialize(0),
            Order::SyncDivider(1),
            Order::SyncCfd(-50, -10),
            Order::InputCfd(0, -50, -10),
            Order::StopAt(u32::MAX),
        ]
    );
    board.configure(&settings(), WITHIN).expect("sets");
    board.begin().expect("begins");
    let histogram = board.finish(WITHIN).expect("counts");
    assert_eq!(
        std::mem::take(&mut fake.state().reported),
        [
            Order::Binning(1),
            Order::Offset(10),
            Order::SyncOffset(10),
            Order::Clear,
            Order::Start(2),
            Order::Stop,
        ]
    );
    assert_eq!(histogram.counts, (1000..1400).collect::<Vec<u32>>());
    assert_eq!(histogram.pulses, 40_000);
    drop(board);
    assert_eq!(fake.state().reported, [Order::Close]);

    let fake = Fake::new("N");
    let inputs = Th260Settings {
        channel: 1,
        sync_divider: 4,
        sync_mv: 200,
        input_mv: -300,
        sync_edge: Edge::Rising,
        ..Th260Settings::default()
    };
    let board = Th260Counter::new("counter", Box::new(fake.clone()), inputs).expect("a counter");
    let message = std::mem::take(&mut fake.state().reported);
    assert_eq!(message[1..4], [Order::SyncDivider(4), Order::SyncEdge(200, 1), Order::InputEdge(1, -300, 0)]);
    assert_eq!(board.limits().finest_ps, 250.0);
}

/// Compares measurement settings with hand-computed values, and checks that the driver refuses unsupported
/// settings.
#[test]
fn measurement_settings_are_converted_for_the_board() {
    let on = |change: &dyn Fn(&mut CounterSettings)| {
        let mut asked = settings();
        change(&mut asked);
        Measurement::new(&asked, 25.0, 22)
    };
    let plain = on(&|_| {}).expect("one");
    assert_eq!((plain.binning, plain.length_code, plain.dwell_ms), (1, 0, 2));
    assert_eq!((plain.offset_ns, plain.sync_offset_ps), (10, 10));
    let early = on(&|s| s.offset_ps = -40_025.0).expect("one");
    assert_eq!((early.offset_ns, early.sync_offset_ps), (0, -40_025));
    for (bins, length) in [(1, 0), (1024, 0), (1025, 1), (32_768, 5)] {
        assert_eq!(on(&|s| s.bins = bins).expect("one").length_code, length);
    }
    assert_eq!(on(&|s| s.bin_ps = 25.0 * 2.0_f64.powi(21)).expect("one").binning, 21);
    let refused: [&dyn Fn(&mut CounterSettings); 12] = [
        &|s| s.bins = 0,
        &|s| s.bins = 32_769,
        &|s| s.bin_ps = 75.0,
        &|s| s.bin_ps = 12.5,
        &|s| s.bin_ps = f64::NAN,
        &|s| s.bin_ps = 25.0 * 2.0_f64.powi(22),
        &|s| s.dwell = Duration::from_micros(2500),
        &|s| s.dwell = Duration::ZERO,
        &|s| s.dwell = Duration::from_secs(360_001),
        &|s| s.offset_ps = -100_000.0,
        &|s| s.offset_ps = 1e11 + 1e5,
        &|s| s.offset_ps = 0.5,
    ];
    for (i, change) in refused.iter().enumerate() {
        assert!(on(*change).is_err(), "{i}");
    }
}

/// Codes of each group in `errorcodes.h` map to the correct fault for any call. Messages contain the
/// library's text and a fix.
#[test]
fn error_codes_map_to_faults() {
    for (number, fault) in [
        (-1, Fault::Disconnected),
        (-2, Fault::Refused),
        (-9, Fault::Refused),
        (-10, Fault::Disconnected),
        (-11, Fault::Refused),
        (-16, Fault::Refused),
        (-17, Fault::Limit),
        (-22, Fault::Disconnected),
        (-24, Fault::Disconnected),
        (-42, Fault::Timeout),
        (-48, Fault::Disconnected),
        (-52, Fault::Refused),
        (-66, Fault::Refused),
        (-80, Fault::Limit),
        (-99, Fault::Disconnected),
    ] {
        assert_eq!(code::fault(number), fault, "{number}");
    }
    for call in [
        "Length",
        "Binning",
        "Offset",
        "SyncOffset",
        "SyncRate",
        "Clear",
        "Start",
        "Done",
        "Stop",
        "Flags",
        "Elapsed",
        "Histogram",
    ] {
        let fake = Fake::new("P");
        let mut board = counter(&fake);
        let mut run = || {
            board.configure(&settings(), WITHIN)?;
            board.begin()?;
            board.finish(WITHIN)
        };
        fake.state().fails = Some((call, -17));
        let failure = run().expect_err(call);
        assert_eq!(failure.fault, Fault::Limit, "{call}: {failure}");
        assert!(failure.what.contains("error -17 (text of -17)"), "{failure}");
        fake.state().fails = None;
        board.reconnect(WITHIN).expect("connects");
        board.configure(&settings(), WITHIN).expect("sets");
        board.begin().expect("begins");
        assert_eq!(board.finish(WITHIN).expect("counts").counts.len(), 400);
    }
    for call in
        ["Open", "Initialize", "Hardware", "Base", "Inputs", "SyncDivider", "SyncCfd", "InputCfd", "StopAt"]
    {
        let fake = Fake::new("P");
        fake.state().fails = Some((call, -11));
        let made = Th260Counter::new("counter", Box::new(fake), Th260Settings::default());
        let failure = made.err().expect(call);
        assert!(failure.fault == Fault::Refused && failure.what.contains("close the program"), "{failure}");
    }
}

#[test]
fn errors_of_the_board_are_reported() {
    let fake = Fake::new("P");
    let mut board = counter(&fake);
    board.configure(&settings(), WITHIN).expect("sets");
    for (flags, fault) in
        [(0x0001, Fault::Saturated), (0x0010, Fault::Disconnected), (0x0021, Fault::Disconnected)]
    {
        fake.state().flags = flags;
        board.begin().expect("begins");
        assert_eq!(board.finish(WITHIN).expect_err("it fails").fault, fault);
    }
    fake.state().flags = 0;
    fake.state().sync_rate = 0;
    let failure = board.begin().expect_err("no light");
    assert!(failure.fault == Fault::Refused && failure.what.contains("sync"), "{failure}");
    fake.state().sync_rate = 1;
    board.begin().expect("begins");
    board.finish(WITHIN).expect("counts");
}

/// The driver opens the board that the rig file names. If the board is not found, the error lists the
/// available boards.
#[test]
fn boards_are_selected_by_serial_number() {
    let named = |serial: &str| Th260Settings { serial: Some(serial.into()), ..Th260Settings::default() };
    let fake = Fake::new("P");
    fake.state().serials = vec!["1000001", "1000002"];
    let mut board = Th260Counter::new("counter", Box::new(fake.clone()), named("1000002")).expect("it");
    assert_eq!(board.identify(WITHIN).expect("answers").serial, "1000002");
    assert_eq!(fake.state().reported[..2], [Order::Close, Order::Initialize(0)]);
    let failure = Th260Counter::new("counter", Box::new(fake.clone()), named("7")).err().expect("none");
    assert!(failure.what.contains("connected boards: 1000001, 1000002"), "{failure}");
    fake.state().serials.clear();
    for failure in [
        board.reconnect(WITHIN).err(),
        board.identify(WITHIN).err(),
        board.configure(&settings(), WITHIN).err(),
    ] {
        assert_eq!(failure.expect("it is gone").fault, Fault::Disconnected);
    }
    let failure = Th260Counter::new("counter", Box::new(fake), Th260Settings::default()).err().expect("none");
    assert!(
        failure.fault == Fault::Disconnected && failure.what.contains("check that the board"),
        "{failure}"
    );
    for (bad, words) in [
        (Th260Settings { sync_mv: 1500, ..Th260Settings::default() }, "-1200 to 1200"),
        (Th260Settings { zero_cross_mv: 5, ..Th260Settings::default() }, "zero_cross_mv"),
        (Th260Settings { sync_divider: 3, ..Th260Settings::default() }, "sync_divider"),
        (Th260Settings { channel: 2, ..Th260Settings::default() }, "channel"),
    ] {
        assert!(bad.check().expect_err(words).contains(words));
    }
}

/// If the library cannot be loaded, the error lists the files that were tried, the library's purpose, and
/// its source.
#[test]
fn a_missing_library_is_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = folder.path().join("text.so");
    std::fs::write(&text, "no library").expect("writes");
    let other = compile(folder.path(), "other", "#[unsafe(no_mangle)] pub extern \"C\" fn f() {}");
    for (file, words) in [
        (folder.path().join("absent.so"), "absent.so"),
        (text, "text.so"),
        (other, "TH260_GetLibraryVersion"),
    ] {
        let failure = Th260Counter::load("counter", Some(&file), Th260Settings::default());
        let failure = failure.err().expect("no library").to_string();
        for words in [words, "TimeHarp 260", "TH260Lib", "library = "] {
            assert!(failure.contains(words), "{failure}");
        }
    }
    // If the real library is installed, there is no error to check.
    if let Err(message) = load(None) {
        assert!(names().iter().all(|n| message.contains(&*n.to_string_lossy())), "{message}");
    }
}

fn compile(folder: &Path, name: &str, source: &str) -> PathBuf {
    let (from, to) = (folder.join(format!("{name}.rs")), folder.join(format!("{name}.so")));
    std::fs::write(&from, source).expect("writes");
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let mut command = Command::new(rustc);
    command.args(["--edition", "2024", "--crate-type", "cdylib", "-A", "non_snake_case", "-o"]);
    let output = command.arg(&to).arg(&from).output().expect("rustc, with which this was compiled");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    to
}

/// Checks names, types and buffers of a library that is loaded in the same way as PicoQuant's.
#[test]
fn a_loaded_library_conforms() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = compile(folder.path(), "fake", include_str!("fake_library.txt"));
    let mut board = Th260Counter::load("counter", Some(&file), Th260Settings::default()).expect("a counter");
    let identity = board.identify(WITHIN).expect("answers");
    assert_eq!(identity.model, "TimeHarp 260 P (930031)");
    assert_eq!(identity.serial, "1234567");
    assert_eq!(identity.firmware, "1.0, TH260Lib 3.1");
    conformance::photon_counter::photon_counter(&mut board).assert_passed("loaded library", 14);
    board.configure(&settings(), WITHIN).expect("sets");
    board.begin().expect("begins");
    let histogram = board.finish(WITHIN).expect("counts");
    assert_eq!(histogram.counts, (1000..1400).collect::<Vec<u32>>());
    assert_eq!(histogram.pulses, 40_000);
    // The board is open, so a second program receives an error with the library's text.
    let second = Th260Counter::load("counter", Some(&file), Th260Settings::default());
    let failure = second.err().expect("it is locked");
    assert!(failure.fault == Fault::Refused && failure.what.contains("fake text of -11"), "{failure}");
    // The first program can still use the board.
    board.begin().expect("begins");
    board.finish(WITHIN).expect("counts");
    drop(board);
    Th260Counter::load("counter", Some(&file), Th260Settings::default()).expect("it is free again");
}
