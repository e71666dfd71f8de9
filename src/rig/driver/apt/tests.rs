//! Tests the encoded bytes, the driver, and invalid streams. The driver runs with the emulator, in memory and
//! over a pseudo-terminal.

use super::super::line::{MemoryLine, StreamLine};
use super::emulator::{self, Trouble};
use super::message::{CONTROLLER, HOST, Message, Parser, Status};
use super::stage::{AptStage, Model};
use crate::conformance;
use crate::instrument::{Fault, Instrument, RotationStage};
use proptest::prelude::*;
use std::time::{Duration, Instant};

/// Returns a fast stage, to keep the tests fast.
fn quick() -> Model {
    let mut model = Model::named("PRM1-Z8").expect("a model");
    model.limits.velocity = 1200.0;
    model.limits.acceleration = 12_000.0;
    model
}

fn emulated() -> (AptStage, Trouble) {
    let (ours, theirs) = MemoryLine::pair();
    let trouble = Trouble::default();
    let same = trouble.clone();
    std::thread::spawn(move || emulator::run(theirs, quick(), same));
    (AptStage::new("retarder_2", Box::new(ours), quick()).expect("a stage"), trouble)
}

/// Messages are encoded to the bytes listed in Thorlabs' document.
#[test]
fn bytes_match_the_documentation() {
    let to = |m: Message| m.bytes(CONTROLLER, HOST);
    assert_eq!(to(Message::RequestInfo), [0x05, 0, 0, 0, 0x50, 1]);
    assert_eq!(to(Message::Home), [0x43, 4, 1, 0, 0x50, 1]);
    assert_eq!(to(Message::RequestStatus), [0x80, 4, 1, 0, 0x50, 1]);
    let counts = (45.0_f64 * 1919.641857862339).round() as i32;
    assert_eq!(to(Message::MoveAbsolute(counts)), [0x53, 4, 6, 0, 0xD0, 1, 1, 0, 0x70, 0x51, 1, 0]);
}

#[test]
fn the_driver_conforms() {
    let (mut stage, _) = emulated();
    conformance::rotation_stage(&mut stage).assert_passed("APT stage (emulated)", 1);
}

#[test]
fn faults_are_distinguished() {
    let (mut stage, trouble) = emulated();
    let long = Duration::from_secs(5);
    assert_eq!(stage.begin_move(1.0).expect_err("not homed").fault, Fault::Refused);
    stage.home(long).expect("homes");
    trouble.set(Trouble::NOISE);
    stage.begin_move(90.0).expect("begins");
    let at = stage.finish_move(long).expect("arrives, noise or not").angle_deg;
    assert!((at - 90.0).abs() < 2e-3);
    trouble.set(Trouble::STALLS);
    stage.begin_move(300.0).expect("begins");
    assert_eq!(stage.finish_move(long).expect_err("stalls").fault, Fault::Stalled);
    trouble.set(Trouble::NONE);
    stage.home(long).expect("homes again");
    trouble.set(Trouble::SILENT);
    let begun = Instant::now();
    assert_eq!(stage.read(Duration::from_millis(150)).expect_err("silent").fault, Fault::Timeout);
    assert!(begun.elapsed() < Duration::from_secs(1));
    drop(stage);
}

#[test]
fn an_unplugged_cable_is_reported_as_disconnected() {
    let (ours, theirs) = MemoryLine::pair();
    let mut stage = AptStage::new("p", Box::new(ours), quick()).expect("a stage");
    drop(theirs);
    assert_eq!(stage.identify(Duration::from_secs(1)).expect_err("gone").fault, Fault::Disconnected);
    let missing = StreamLine::serial("/dev/no-such-port", 115_200, true).err().expect("no port");
    assert!(missing.to_string().contains("/dev/no-such-port"));
}

/// The driver works over a serial device of the system. The device is a pseudo-terminal whose other end the
/// emulator uses.
#[cfg(target_os = "linux")]
#[test]
fn the_driver_works_through_a_serial_device() {
    use super::super::line::{Line, LineError};
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

    struct Master(std::fs::File);
    impl Line for Master {
        fn send(&mut self, bytes: &[u8]) -> Result<(), LineError> {
            use std::io::Write;
            self.0.write_all(bytes).map_err(|e| LineError::Gone(e.to_string()))
        }
        fn receive(&mut self, within: Duration) -> Result<Vec<u8>, LineError> {
            use std::io::Read;
            let until = Instant::now() + within;
            let mut buffer = [0; 256];
            loop {
                match self.0.read(&mut buffer) {
                    Ok(0) => return Err(LineError::Gone("closed".into())),
                    Ok(n) => return Ok(buffer[..n].to_vec()),
                    Err(e) if e.kind() == std::io::ErrorKind::WouldBlock && Instant::now() < until => {
                        std::thread::sleep(Duration::from_millis(1));
                    }
                    Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => return Err(LineError::Timeout),
                    Err(e) => return Err(LineError::Gone(e.to_string())),
                }
            }
        }
        fn reopen(&mut self) -> Result<(), LineError> {
            Ok(())
        }
    }
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pseudo-terminal");
    grantpt(&master).expect("granted");
    unlockpt(&master).expect("unlocked");
    let name = ptsname(&master, Vec::new()).expect("a name");
    rustix::io::ioctl_fionbio(&master, true).expect("does not block");
    let mut port = StreamLine::serial(&name.to_string_lossy(), 115_200, false).expect("a port");
    let trouble = Trouble::default();
    std::thread::spawn(move || emulator::run(Master(std::fs::File::from(master)), quick(), trouble));
    port.reopen().expect("again");
    let mut stage = AptStage::new("polarizer_1", Box::new(port), quick()).expect("a stage");
    let long = Duration::from_secs(5);
    let id = stage.identify(long).expect("answers");
    assert_eq!((id.maker.as_str(), id.model.as_str(), id.firmware.as_str()), ("Thorlabs", "KDC101", "2.0.3"));
    stage.home(long).expect("homes");
    stage.begin_move(123.4).expect("begins");
    assert!((stage.finish_move(long).expect("arrives").angle_deg - 123.4).abs() < 2e-3);
}

fn all() -> Vec<Message> {
    let status = Status { position: -86_384, extra: 77, bits: 0x8000_2410 };
    vec![
        Message::RequestInfo,
        Message::Info { serial: 27_123_456, model: "KDC101".into(), firmware: [1, 2, 3] },
        Message::Identify,
        Message::Enable(true),
        Message::Enable(false),
        Message::StopUpdates,
        Message::SetVelocity { acceleration: 366, velocity: 1_073_542 },
        Message::Home,
        Message::Homed,
        Message::MoveAbsolute(86_384),
        Message::MoveCompleted(None),
        Message::MoveCompleted(Some(status)),
        Message::Stop { abrupt: true },
        Message::Stop { abrupt: false },
        Message::MoveStopped(None),
        Message::MoveStopped(Some(status)),
        Message::RequestStatus,
        Message::Status(status),
        Message::RequestDcStatus,
        Message::DcStatus(status),
        Message::AckDcStatus,
        Message::Other(0x0999, [3, 4], vec![]),
        Message::Other(0x0999, [0, 0], vec![1, 2, 3]),
    ]
}

#[test]
fn messages_round_trip_in_any_pieces() {
    for piece in [1, 2, 5, 1000] {
        let mut parser = Parser::new(HOST);
        let mut found = vec![];
        let bytes: Vec<u8> = all().iter().flat_map(|m| m.bytes(HOST, CONTROLLER)).collect();
        for part in bytes.chunks(piece) {
            parser.feed(part);
            while let Some(message) = parser.next_message() {
                found.push(message);
            }
        }
        assert_eq!(found, all());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]
    /// Invalid streams cause no panic and no hang, and the parser finds a complete message after them.
    #[test]
    fn arbitrary_streams_never_panic(noise in prop::collection::vec(any::<u8>(), 0..200), damaged in any::<(prop::sample::Index, u8)>()) {
        let mut parser = Parser::new(HOST);
        let mut bytes = noise.clone();
        for message in all() {
            bytes.extend(message.bytes(HOST, CONTROLLER));
        }
        let at = damaged.0.index(bytes.len());
        bytes[at] = damaged.1;
        parser.feed(&bytes);
        let mut count = 0;
        while parser.next_message().is_some() {
            count += 1;
        }
        prop_assert!(count <= bytes.len() / 6);
        // Bytes up to the maximum message length complete any partial message.
        parser.feed(&[0; 300]);
        while parser.next_message().is_some() {}
        parser.feed(&Message::Homed.bytes(HOST, CONTROLLER));
        let mut last = None;
        while let Some(message) = parser.next_message() {
            last = Some(message);
        }
        prop_assert_eq!(last, Some(Message::Homed));
    }
}
