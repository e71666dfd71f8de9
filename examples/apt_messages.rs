//! Prints the bytes of Thorlabs APT messages, or decodes bytes. `validation/instruments.py` compares the
//! output with an independent package.
//!
//! - `cargo run --release --example apt_messages` prints the name and the bytes of every message that the
//!   driver sends.
//! - `cargo run --release --example apt_messages HEX…` prints the content of each message to the host.

use sunstone::rig::driver::apt::message::{CONTROLLER, HOST, Message, Parser};

fn main() {
    let given: Vec<String> = std::env::args().skip(1).collect();
    if given.is_empty() {
        let sent = [
            ("hw_req_info", Message::RequestInfo),
            ("mod_identify", Message::Identify),
            ("mod_set_chanenablestate on", Message::Enable(true)),
            ("mod_set_chanenablestate off", Message::Enable(false)),
            ("hw_stop_updatemsgs", Message::StopUpdates),
            ("mot_set_velparams", Message::SetVelocity { acceleration: 366, velocity: 1_073_542 }),
            ("mot_move_home", Message::Home),
            ("mot_move_absolute", Message::MoveAbsolute(86_384)),
            ("mot_move_absolute back", Message::MoveAbsolute(-1)),
            ("mot_move_stop", Message::Stop { abrupt: true }),
            ("mot_move_stop ramp", Message::Stop { abrupt: false }),
            ("mot_req_statusupdate", Message::RequestStatus),
            ("mot_req_dcstatusupdate", Message::RequestDcStatus),
            ("mot_ack_dcstatusupdate", Message::AckDcStatus),
        ];
        for (name, message) in sent {
            println!("{name}\t{}", hex(&message.bytes(CONTROLLER, HOST)));
        }
        return;
    }
    for text in given {
        let bytes: Vec<u8> = (0..text.len() / 2)
            .filter_map(|i| u8::from_str_radix(&text[2 * i..2 * i + 2], 16).ok())
            .collect();
        let mut parser = Parser::new(HOST);
        parser.feed(&bytes);
        match parser.next_message() {
            Some(message) => println!("{message:?}\t{}", hex(&message.bytes(HOST, CONTROLLER))),
            None => println!("none"),
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}
