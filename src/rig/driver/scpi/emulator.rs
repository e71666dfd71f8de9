//! An emulated laser that accepts SCPI commands over a socket and can simulate faults.

use crate::clock::locked;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A fault that the emulator can simulate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Trouble {
    #[default]
    None,
    /// The laser does not reply.
    Silent,
    /// Replies are delayed by this time.
    Late(Duration),
    Noise,
    /// The laser closes the connection instead of replying.
    HangsUp,
    Interlock,
}

#[derive(Debug)]
struct State {
    on: bool,
    rate_hz: f64,
    errors: Vec<(i32, &'static str)>,
    trouble: Trouble,
}

/// A laser with pulse rates of 1 Hz to 80 MHz that emits 5 mW when it is on. The commands are `OUTP`,
/// `SOUR:FREQ`, `MEAS:POW?`, `SYST:INTL?`, `CURV?` (a block of 300 bytes), `SYST:ERR?`, `*IDN?`, `*OPC?` and
/// `*CLS`.
#[derive(Clone, Debug)]
pub struct Emulator(Arc<Mutex<State>>);

impl Default for Emulator {
    fn default() -> Self {
        Self(Arc::new(Mutex::new(State { on: false, rate_hz: 1e6, errors: vec![], trouble: Trouble::None })))
    }
}

impl Emulator {
    /// Returns the table of the emulator's commands. The network address in the table is `address`.
    pub fn table(address: &str) -> String {
        format!(
            "address = \"{address}\"\nnm = 635\nrate_hz = [1.0, 8e7]\nset_rate = \"SOUR:FREQ {{hz}}\"\n\
             ask_rate = \"SOUR:FREQ?\"\nask_power = \"MEAS:POW?\"\nnominal_power = 5e-3\nask_interlock = \"SYST:INTL?\"\n"
        )
    }

    /// Sets the fault.
    pub fn trouble(&self, trouble: Trouble) {
        locked(&self.0).trouble = trouble;
    }

    /// Returns whether the emulated laser emits light.
    pub fn shines(&self) -> bool {
        locked(&self.0).on
    }

    /// Serves every connection on a separate thread, until the socket fails.
    pub fn serve(&self, listener: &TcpListener) {
        for stream in listener.incoming() {
            let Ok(stream) = stream else { return };
            let same = self.clone();
            std::thread::spawn(move || same.converse(&stream));
        }
    }

    fn converse(&self, stream: &TcpStream) {
        let mut lines = BufReader::new(stream);
        let mut out = stream;
        let mut line = vec![];
        loop {
            line.clear();
            match lines.read_until(b'\n', &mut line) {
                Ok(n) if n > 0 => {}
                _ => return,
            }
            let text = String::from_utf8_lossy(&line).into_owned();
            let mut answers = vec![];
            for command in text.split(';') {
                if let Some(answer) = self.answer(command.trim()) {
                    if !answers.is_empty() {
                        answers.push(b';');
                    }
                    answers.extend(answer);
                }
            }
            if answers.is_empty() {
                continue;
            }
            answers.push(b'\n');
            let trouble = locked(&self.0).trouble;
            match trouble {
                Trouble::Silent => continue,
                Trouble::Late(time) => std::thread::sleep(time),
                Trouble::Noise => answers = vec![0xFF, 0x07, b'#', b'9', 0x80, b'\n'],
                Trouble::HangsUp => return,
                Trouble::None | Trouble::Interlock => {}
            }
            if out.write_all(&answers).is_err() {
                return;
            }
        }
    }

    /// Returns the reply to a command, or `None` if the command has no reply.
    pub fn answer(&self, command: &str) -> Option<Vec<u8>> {
        let mut state = locked(&self.0);
        let (head, value) = command.split_once(' ').unwrap_or((command, ""));
        let text = match (head.to_ascii_uppercase().as_str(), value.trim()) {
            ("", _) => return None,
            ("*IDN?", _) => "Sunstone,Emulated laser,1,1.0".into(),
            ("*OPC?", _) => "1".into(),
            ("*CLS", _) => {
                state.errors.clear();
                return None;
            }
            ("SYST:ERR?", _) => {
                let (number, text) =
                    if state.errors.is_empty() { (0, "No error") } else { state.errors.remove(0) };
                format!("{number},\"{text}\"")
            }
            ("OUTP?", _) => u8::from(state.on).to_string(),
            ("SOUR:FREQ?", _) => format!("{:E}", state.rate_hz),
            ("MEAS:POW?", _) => if state.on { "5.000E-03" } else { "0" }.into(),
            ("SYST:INTL?", _) => u8::from(state.trouble != Trouble::Interlock).to_string(),
            ("CURV?", _) => {
                let mut block = b"#3300".to_vec();
                block.extend((0..300).map(|n| n as u8));
                return Some(block);
            }
            ("OUTP", value) => {
                match (value.to_ascii_uppercase().as_str(), state.trouble) {
                    ("ON" | "1", Trouble::Interlock) => {
                        state.errors.push((-221, "Settings conflict; interlock open"));
                    }
                    ("ON" | "1", _) => state.on = true,
                    ("OFF" | "0", _) => state.on = false,
                    _ => state.errors.push((-224, "Illegal parameter value")),
                }
                return None;
            }
            ("SOUR:FREQ", value) => {
                match value.parse::<f64>() {
                    Ok(hz) if (1.0..=8e7).contains(&hz) => state.rate_hz = hz,
                    Ok(_) => state.errors.push((-222, "Data out of range")),
                    Err(_) => state.errors.push((-104, "Data type error")),
                }
                return None;
            }
            _ => {
                // As in a real instrument, the length of the error queue is limited. One entry then reports
                // the overflow.
                if state.errors.len() < 20 {
                    state.errors.push((-113, "Undefined header"));
                }
                return None;
            }
        };
        Some(text.into_bytes())
    }
}
