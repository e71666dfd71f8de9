//! Tests the laser with the emulator over TCP, command tables, and invalid replies.

use super::super::line::{Line, LineError, MemoryLine};
use super::emulator::{Emulator, Trouble};
use super::laser::ScpiLaser;
use super::table::LaserTable;
use crate::conformance;
use crate::instrument::{Fault, Instrument, PulsedLaser};
use proptest::prelude::*;
use std::net::TcpListener;
use std::time::{Duration, Instant};

const LONG: Duration = Duration::from_secs(5);
const SHORT: Duration = Duration::from_millis(100);

/// Starts an emulator. Returns the emulator and its command table.
fn served() -> (String, Emulator) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a socket");
    let address = listener.local_addr().expect("bound").to_string();
    let emulator = Emulator::default();
    let same = emulator.clone();
    std::thread::spawn(move || same.serve(&listener));
    (Emulator::table(&address), emulator)
}

fn connected(table: &str) -> ScpiLaser {
    let table = LaserTable::parse(table).expect("a table");
    ScpiLaser::connect("laser", table).expect("connects")
}

fn emulated() -> (ScpiLaser, Emulator) {
    let (table, emulator) = served();
    (connected(&table), emulator)
}

#[test]
fn the_driver_conforms() {
    let (mut laser, _) = emulated();
    conformance::pulsed_laser(&mut laser).assert_passed("SCPI laser (emulated)", 10);
}

#[test]
fn faults_are_distinguished() {
    let (mut laser, emulator) = emulated();
    laser.emit(true, 2e6, LONG).expect("shines");
    let state = laser.state(LONG).expect("answers");
    assert!(
        state.emitting && (state.rate_hz - 2e6).abs() < 1e-3 && (state.power - 1.0).abs() < 1e-12,
        "{state:?}"
    );

    for (trouble, fault) in [
        (Trouble::Silent, Fault::Timeout),
        (Trouble::Noise, Fault::Disconnected),
        (Trouble::HangsUp, Fault::Disconnected),
    ] {
        emulator.trouble(trouble);
        let begun = Instant::now();
        let failure = laser.state(SHORT).expect_err("fails");
        assert_eq!(failure.fault, fault, "{trouble:?}: {failure}");
        assert!(begun.elapsed() < 10 * SHORT, "{trouble:?} took {:?}", begun.elapsed());
        emulator.trouble(Trouble::None);
        // No reconnection is needed, because the driver knows that a late reply might be pending.
        assert!(laser.state(LONG).expect("answers again").emitting);
    }
    laser.emit(false, 0.0, LONG).expect("goes dark");
    emulator.trouble(Trouble::Interlock);
    assert_eq!(laser.emit(true, 1e6, LONG).expect_err("open").fault, Fault::Refused);
    assert!(!emulator.shines());
}

/// A reply that arrives after its deadline is not read as the reply to the next query.
#[test]
fn late_replies_are_not_read_as_later_ones() {
    let (mut laser, emulator) = emulated();
    laser.emit(true, 3e6, LONG).expect("shines");
    emulator.trouble(Trouble::Late(Duration::from_millis(150)));
    for _ in 0..3 {
        assert_eq!(laser.state(SHORT).expect_err("late").fault, Fault::Timeout);
    }
    emulator.trouble(Trouble::None);
    for _ in 0..5 {
        assert!((laser.state(LONG).expect("answers").rate_hz - 3e6).abs() < 1e-3);
        std::thread::sleep(Duration::from_millis(40));
    }
}

#[test]
fn instrument_errors_map_to_faults() {
    let (table, _) = served();
    // The table states a wider range than that of the laser, so the laser itself refuses the rate.
    let text = table.replace("8e7", "9e9");
    let mut laser = connected(&text);
    let failure = laser.emit(true, 5e9, LONG).expect_err("out of range");
    assert!(failure.fault == Fault::Limit && failure.what.contains("-222"), "{failure}");
    assert!(!laser.state(LONG).expect("answers").emitting, "light of a wrong rate is never let out");
    let text = text.replace("SOUR:FREQ {hz}", "SOUR:FREK {hz}");
    let mut laser = connected(&text);
    let failure = laser.emit(true, 1e6, LONG).expect_err("unknown");
    assert!(failure.fault == Fault::Refused && failure.what.contains("-113"), "{failure}");
}

#[test]
fn tables_are_checked() {
    let good = Emulator::table("127.0.0.1:5025");
    LaserTable::parse(&good).expect("a table");
    for (from, to, word) in [
        ("{hz}", "1", "{hz}"),
        ("[1.0, 8e7]", "[8e7, 1.0]", "rate_hz"),
        ("nm = 635", "nm = nan", "nm"),
        ("nominal_power = 5e-3\n", "", "nominal_power"),
        ("ask_rate = \"SOUR:FREQ?\"\n", "", "ask_rate"),
        ("nm = 635", "nm = 635\ncolour = 3", "colour"),
        ("MEAS:POW?", "MEAS\\n:POW?", "single line"),
    ] {
        let changed = good.replace(from, to);
        assert_ne!(changed, good, "{from} is in the table");
        let message = LaserTable::parse(&changed).expect_err("is wrong");
        assert!(message.contains(word), "{message}");
    }
    let missing = LaserTable::parse(&Emulator::table("127.0.0.1:1")).expect("a table");
    let failure = ScpiLaser::connect("laser", missing).err().expect("nobody listens");
    assert!(failure.fault == Fault::Disconnected && failure.what.contains("127.0.0.1:1"), "{failure}");
}

/// Tests another vendor's commands, which are those of the delay generator in the documentation of
/// [`LaserTable`].
#[test]
fn commands_of_another_vendor_work() {
    let table = "address = \"192.0.2.7:5025\"\nnm = 635\nrate_hz = [1e-3, 1e7]\non = \"TSRC 0\"\noff = \"TSRC 5\"\n\
                 set_rate = \"TRAT {hz}\"\nask_on = \"TSRC?\"\non_answers = [\"0\"]\nask_rate = \"TRAT?\"\nerrors = \"LERR?\"\n";
    let (ours, mut theirs) = MemoryLine::pair();
    let message = std::thread::spawn(move || {
        let (mut all, mut source) = (vec![], 5);
        while let Ok(bytes) = theirs.receive(LONG) {
            let line = String::from_utf8(bytes).expect("text");
            let answer = match line.trim() {
                "TSRC 0" => {
                    source = 0;
                    None
                }
                "TSRC?" => Some(source.to_string()),
                "*OPC?" => Some("1".to_owned()),
                "LERR?" => Some("0".to_owned()),
                _ => None,
            };
            all.push(line);
            if let Some(answer) = answer {
                theirs.send(format!("{answer}\r\n").as_bytes()).expect("sends");
            }
        }
        all
    });
    let mut laser = ScpiLaser::new("delays", Box::new(ours), LaserTable::parse(table).expect("a table"));
    laser.emit(true, 25_000.0, LONG).expect("shines");
    drop(laser);
    let message = message.join().expect("ends");
    assert_eq!(message.concat(), "TRAT 2.5E4\n*OPC?\nLERR?\nTSRC 0\n*OPC?\nLERR?\nTSRC?\n");
}

/// A line that replies with the same bytes to a number of queries, and then stops replying.
struct Garbage(Vec<u8>);

impl Line for Garbage {
    fn send(&mut self, _bytes: &[u8]) -> Result<(), LineError> {
        Ok(())
    }
    fn receive(&mut self, _within: Duration) -> Result<Vec<u8>, LineError> {
        let n = self.0.len().min(7);
        let bytes: Vec<u8> = self.0.drain(..n).collect();
        if bytes.is_empty() { Err(LineError::Timeout) } else { Ok(bytes) }
    }
    fn reopen(&mut self) -> Result<(), LineError> {
        Ok(())
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]

    /// Ten thousand random streams cause no panic and no hang. The laser never emits without reporting the
    /// emission.
    #[test]
    #[ignore = "slow: tools/check --all"]
    fn random_replies_never_panic_or_hang(
        bytes in prop::collection::vec(prop_oneof![any::<u8>(), prop::sample::select(b"#0123456789,\n+-.E\"".to_vec())], 0..120),
        which in 0..4_u8,
    ) {
        let table = LaserTable::parse(&Emulator::table("x:1")).expect("a table");
        let mut laser = ScpiLaser::new("laser", Box::new(Garbage(bytes)), table);
        let begun = Instant::now();
        match which {
            0 => drop(laser.identify(LONG)),
            1 => drop(laser.emit(true, 1e6, LONG)),
            2 => if let Ok(state) = laser.state(LONG) {
                prop_assert!(state.rate_hz.is_finite() && state.power.is_finite());
            },
            _ => drop(laser.reconnect(LONG)),
        }
        prop_assert!(begun.elapsed() < LONG);
    }
}
