//! Prints output that `validation/dlpc350.py` and `validation/scpi.py` compare with independent packages.
//!
//! - `cargo run --release --example instrument_bytes dlpc350` prints the name and the bytes of every message
//!   to the controller.
//! - `… instrument_bytes scpi-emulator` listens, prints its address, and exits at the end of standard input.
//! - `… instrument_bytes scpi-laser TABLE` controls a laser as a session does, and prints the steps.

use std::io::Read;
use std::net::TcpListener;
use std::time::Duration;
use sunstone::rig::driver::dlpc350::command::{Begin, Command, Entry, Mailbox, Question, Run, Source};
use sunstone::rig::driver::dlpc350::hid::Message;
use sunstone::rig::driver::scpi::emulator::Emulator;
use sunstone::rig::driver::scpi::laser::ScpiLaser;
use sunstone::rig::driver::scpi::table::LaserTable;
use sunstone::rig::instrument::{Instrument, PulsedLaser};

fn main() {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let given: Vec<&str> = given.iter().map(String::as_str).collect();
    match given[..] {
        ["dlpc350"] => dlpc350(),
        ["scpi-emulator"] => scpi_emulator(),
        ["scpi-laser", path] => scpi_laser(path),
        _ => eprintln!(
            "usage: instrument_bytes dlpc350, instrument_bytes scpi-emulator, or instrument_bytes scpi-laser TABLE"
        ),
    }
}

fn dlpc350() {
    let entry = Entry {
        begin: Begin::Internal,
        plane: 0,
        bits: 1,
        leds: 2,
        negative: false,
        dark_after: false,
        fetch: false,
        joined: false,
    };
    let second = Entry {
        begin: Begin::Continue,
        plane: 23,
        leds: 7,
        negative: true,
        dark_after: true,
        fetch: true,
        joined: true,
        ..entry
    };
    let edges = Entry { begin: Begin::Falling, plane: 2, bits: 8, ..entry };
    let commands = [
        ("display video", Command::PatternMode(false)),
        ("display pattern", Command::PatternMode(true)),
        ("source video", Command::Source(Source::Video)),
        ("source flash", Command::Source(Source::Flash)),
        ("trigger vsync", Command::TriggerMode(0)),
        ("trigger internal", Command::TriggerMode(1)),
        ("trigger from outside", Command::TriggerMode(2)),
        ("trigger output 1", Command::TriggerOut1 { inverted: true, rise: 0xBB, fall: 0xD5 }),
        ("trigger output 2", Command::TriggerOut2 { inverted: false, rise: 0x7F }),
        ("trigger input 1", Command::TriggerIn1(0x7_0203)),
        ("trigger input 2", Command::TriggerIn2(true)),
        ("stop", Command::Run(Run::Stop)),
        ("pause", Command::Run(Run::Pause)),
        ("start", Command::Run(Run::Start)),
        ("exposure", Command::Exposure { exposure_us: 66_051, period_us: 1_000_000 }),
        ("config", Command::Config { entries: 128, repeat: true, per_pulse: 3, images: 1 }),
        ("mailbox images", Command::Open(Mailbox::Images)),
        ("mailbox patterns", Command::Open(Mailbox::Patterns)),
        ("mailbox closed", Command::Open(Mailbox::Closed)),
        ("address", Command::Address(5)),
        ("validate", Command::Validate),
        ("pattern plain", Command::PatternTable(vec![entry])),
        ("pattern all flags", Command::PatternTable(vec![second])),
        ("pattern grey", Command::PatternTable(vec![edges])),
        ("pattern long", Command::PatternTable(vec![second; 128])),
    ];
    for (name, command) in commands {
        let (code, data) = command.encode();
        print(name, &Message::host(false, 0, code, &data));
    }
    print("main status", &Message::host(true, 0, Question::Main as u16, &[]));
}

fn print(name: &str, message: &Message) {
    let hex: String = message.reports().iter().flatten().map(|b| format!("{b:02x}")).collect();
    println!("{name}\t{hex}");
}

fn scpi_emulator() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a socket");
    println!("{}", listener.local_addr().expect("bound"));
    std::thread::spawn(move || Emulator::default().serve(&listener));
    let mut rest = vec![];
    drop(std::io::stdin().read_to_end(&mut rest));
}

/// Prints the steps of a session, and the result of each step.
fn scpi_laser(path: &str) {
    let text = std::fs::read_to_string(path).expect("a file");
    let table = LaserTable::parse(&text).expect("a table");
    let within = Duration::from_secs(2);
    let mut laser = match ScpiLaser::connect("laser", table) {
        Ok(laser) => laser,
        Err(e) => return println!("connect\t{e}"),
    };
    let answer = |step: &str, what: Result<String, sunstone::rig::instrument::Failure>| match what {
        Ok(text) => println!("{step}\t{text}"),
        Err(e) => println!("{step}\t{e}"),
    };
    let done = |()| "done".to_owned();
    answer(
        "identify",
        laser.identify(within).map(|i| format!("{} {} {} {}", i.maker, i.model, i.serial, i.firmware)),
    );
    answer("on", laser.emit(true, 2.5e6, within).map(done));
    answer("state on", laser.state(within).map(|s| format!("{} {} {}", s.emitting, s.rate_hz, s.power)));
    answer("too fast", laser.emit(true, 7e7, within).map(done));
    answer("off", laser.emit(false, 0.0, within).map(done));
    answer("state off", laser.state(within).map(|s| format!("{} {} {}", s.emitting, s.rate_hz, s.power)));
}
