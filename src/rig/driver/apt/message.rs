//! Messages of the APT protocol. A header of six bytes is followed by data if the highest bit of the fifth
//! byte is set.
//!
//! - without data: id u16, parameter u8, parameter u8, destination u8, source u8
//! - with data: id u16, length u16, destination u8 or 0x80, source u8, data
//!
//! All numbers are little-endian.

pub const HOST: u8 = 0x01;
/// Address of a USB controller with one channel.
pub const CONTROLLER: u8 = 0x50;
const CHANNEL: u8 = 1;
/// Maximum length of a message's data, in bytes.
const LONGEST: usize = 255;

/// Status bits of a stage.
pub mod bits {
    /// Set if a limit switch is active.
    pub const LIMITS: u32 = 0x3;
    /// Set if the stage is moving, in either direction.
    pub const MOVING: u32 = 0x30 | 0xC0;
    /// Set while the stage is homing.
    pub const HOMING: u32 = 0x200;
    /// Set if the stage is homed, that is, if its zero is known.
    pub const HOMED: u32 = 0x400;
    /// Set if the stage has settled at its goal.
    pub const SETTLED: u32 = 0x2000;
    /// Set on a motion error, which means that the motor cannot follow.
    pub const MOTION_ERROR: u32 = 0x4000;
    /// Set if the channel is enabled.
    pub const ENABLED: u32 = 0x8000_0000;
}

/// Status of a stage. Several messages contain these 14 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status {
    /// Position, in encoder counts.
    pub position: i32,
    /// Additional encoder counts. On DC controllers, the velocity (i16) and a reserved word.
    pub extra: u32,
    /// Status bits (see [`bits`]).
    pub bits: u32,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Message {
    /// MGMSG_HW_REQ_INFO: requests [`Self::Info`].
    RequestInfo,
    /// MGMSG_HW_GET_INFO: serial number, model, type, firmware (minor, interim, major, unused), hardware
    /// version, modification, channels.
    Info {
        serial: u32,
        /// Model, up to 8 bytes.
        model: String,
        /// Firmware version: minor, interim and major number.
        firmware: [u8; 3],
    },
    /// MGMSG_MOD_IDENTIFY: flashes the LED of the front panel.
    Identify,
    /// MGMSG_MOD_SET_CHANENABLESTATE: enables or disables the channel.
    Enable(bool),
    /// MGMSG_HW_STOP_UPDATEMSGS: stops automatic status messages.
    StopUpdates,
    /// MGMSG_MOT_SET_VELPARAMS: acceleration and maximum velocity in the controller's units.
    SetVelocity { acceleration: i32, velocity: i32 },
    /// MGMSG_MOT_MOVE_HOME: homes the stage.
    Home,
    /// MGMSG_MOT_MOVE_HOMED: the stage has been homed.
    Homed,
    /// MGMSG_MOT_MOVE_ABSOLUTE with the position in counts.
    MoveAbsolute(i32),
    /// MGMSG_MOT_MOVE_COMPLETED, with or without a status.
    MoveCompleted(Option<Status>),
    /// MGMSG_MOT_MOVE_STOP: stops the stage.
    Stop {
        /// Whether the stage stops without a deceleration ramp.
        abrupt: bool,
    },
    /// MGMSG_MOT_MOVE_STOPPED, with or without a status.
    MoveStopped(Option<Status>),
    /// MGMSG_MOT_REQ_STATUSUPDATE: requests [`Self::Status`].
    RequestStatus,
    /// MGMSG_MOT_GET_STATUSUPDATE: returns the status of the stage.
    Status(Status),
    /// MGMSG_MOT_REQ_DCSTATUSUPDATE: requests [`Self::DcStatus`].
    RequestDcStatus,
    /// MGMSG_MOT_GET_DCSTATUSUPDATE: returns the status of a stage with a DC motor.
    DcStatus(Status),
    /// MGMSG_MOT_ACK_DCSTATUSUPDATE: reports that the host is alive. USB controllers require this message
    /// every second.
    AckDcStatus,
    /// Any other message, given by id, parameters and data.
    Other(u16, [u8; 2], Vec<u8>),
}

/// The messages without data, with their ids and parameters.
static PLAIN: [(Message, u16, [u8; 2]); 14] = [
    (Message::RequestInfo, 0x0005, [0, 0]),
    (Message::Identify, 0x0223, [0, 0]),
    (Message::Enable(true), 0x0210, [CHANNEL, 1]),
    (Message::Enable(false), 0x0210, [CHANNEL, 2]),
    (Message::StopUpdates, 0x0012, [0, 0]),
    (Message::Home, 0x0443, [CHANNEL, 0]),
    (Message::Homed, 0x0444, [CHANNEL, 0]),
    (Message::MoveCompleted(None), 0x0464, [CHANNEL, 0]),
    (Message::Stop { abrupt: true }, 0x0465, [CHANNEL, 1]),
    (Message::Stop { abrupt: false }, 0x0465, [CHANNEL, 2]),
    (Message::MoveStopped(None), 0x0466, [CHANNEL, 0]),
    (Message::RequestStatus, 0x0480, [CHANNEL, 0]),
    (Message::RequestDcStatus, 0x0490, [CHANNEL, 0]),
    (Message::AckDcStatus, 0x0492, [0, 0]),
];

impl Status {
    fn data(&self) -> Vec<u8> {
        let mut data = vec![CHANNEL, 0];
        data.extend(self.position.to_le_bytes());
        data.extend(self.extra.to_le_bytes());
        data.extend(self.bits.to_le_bytes());
        data
    }

    fn of(data: &[u8]) -> Option<Self> {
        let word = |at: usize| Some(u32::from_le_bytes(data.get(at..at + 4)?.try_into().ok()?));
        Some(Self { position: word(2)? as i32, extra: word(6)?, bits: word(10)? })
    }
}

impl Message {
    /// Encodes the message, sent from `source` to `destination`.
    pub fn bytes(&self, destination: u8, source: u8) -> Vec<u8> {
        let numbers = |numbers: &[i32]| {
            let mut data = vec![CHANNEL, 0];
            data.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
            data
        };
        let (id, parameters, data) = match self {
            Self::Info { serial, model, firmware } => {
                let mut data = serial.to_le_bytes().to_vec();
                data.extend(model.as_bytes());
                data.resize(12, 0);
                data.extend(16_u16.to_le_bytes());
                data.extend(firmware);
                data.resize(78, 0);
                data.extend([1_u16, 0, 1].iter().flat_map(|n| n.to_le_bytes()));
                (0x0006, [0; 2], data)
            }
            Self::SetVelocity { acceleration, velocity } => {
                (0x0413, [0; 2], numbers(&[0, *acceleration, *velocity]))
            }
            Self::MoveAbsolute(counts) => (0x0453, [0; 2], numbers(&[*counts])),
            Self::MoveCompleted(Some(status)) => (0x0464, [0; 2], status.data()),
            Self::MoveStopped(Some(status)) => (0x0466, [0; 2], status.data()),
            Self::Status(status) => (0x0481, [0; 2], status.data()),
            Self::DcStatus(status) => (0x0491, [0; 2], status.data()),
            Self::Other(id, parameters, data) => (*id, *parameters, data.clone()),
            plain => match PLAIN.iter().find(|(message, ..)| message == plain) {
                Some((_, id, parameters)) => (*id, *parameters, vec![]),
                None => unreachable!("the table has every message without data"),
            },
        };
        let (field, destination) = match data.len() {
            0 => (parameters, destination),
            n => ((n as u16).to_le_bytes(), destination | 0x80),
        };
        [&id.to_le_bytes()[..], &field, &[destination, source], &data].concat()
    }

    /// Decodes a message from the id and the parameters of its header, and from its data.
    fn of(id: u16, parameters: [u8; 2], data: &[u8]) -> Self {
        let word = |at: usize| Some(i32::from_le_bytes(data.get(at..at + 4)?.try_into().ok()?));
        let status = || Status::of(data);
        let found = match (id, data.len()) {
            (_, 0) => {
                // A known message with unknown parameters is decoded as the last form in the table.
                let forms = || PLAIN.iter().filter(move |(_, known, _)| *known == id);
                let form = forms().find(|(.., p)| *p == parameters).or(forms().next_back());
                form.map(|(message, ..)| message.clone())
            }
            (0x0006, 84) => {
                let name = data[4..12].split(|b| *b == 0).next().unwrap_or_default();
                word(0).map(|serial| Self::Info {
                    serial: serial as u32,
                    model: String::from_utf8_lossy(name).trim().to_owned(),
                    firmware: [data[14], data[15], data[16]],
                })
            }
            (0x0413, 14) => word(6)
                .zip(word(10))
                .map(|(acceleration, velocity)| Self::SetVelocity { acceleration, velocity }),
            (0x0453, 6) => word(2).map(Self::MoveAbsolute),
            (0x0464, 14) => status().map(|s| Self::MoveCompleted(Some(s))),
            (0x0466, 14) => status().map(|s| Self::MoveStopped(Some(s))),
            (0x0481, 14) => status().map(Self::Status),
            (0x0491, 14) => status().map(Self::DcStatus),
            _ => None,
        };
        found.unwrap_or_else(|| Self::Other(id, parameters, data.to_vec()))
    }
}

/// Parser of messages in a byte stream. The parser skips bytes until a valid header begins.
#[derive(Debug)]
pub struct Parser {
    /// Address of the receiver. Headers with other destinations are invalid.
    own: u8,
    held: Vec<u8>,
}

impl Parser {
    /// Creates a parser for messages to `own`.
    pub fn new(own: u8) -> Self {
        Self { own, held: vec![] }
    }

    /// Appends received bytes.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.held.extend_from_slice(bytes);
    }

    /// Discards all bytes.
    pub fn clear(&mut self) {
        self.held.clear();
    }

    pub fn next_message(&mut self) -> Option<Message> {
        let mut at = 0;
        let found = loop {
            let Some(header) = self.held.get(at..at + 6) else {
                break None;
            };
            let (id, to, from) = (u16::from_le_bytes([header[0], header[1]]), header[4], header[5]);
            let follows = to & 0x80 != 0;
            let length = usize::from(u16::from_le_bytes([header[2], header[3]]));
            let plausible =
                to & 0x7F == self.own && from & 0x80 == 0 && from != self.own && id != 0 && id < 0x2000;
            if !plausible || (follows && (length == 0 || length > LONGEST)) {
                at += 1;
                continue;
            }
            let (parameters, end) =
                if follows { ([0, 0], at + 6 + length) } else { ([header[2], header[3]], at + 6) };
            let Some(data) = self.held.get(at + 6..end) else {
                break None;
            };
            let message = Message::of(id, parameters, data);
            at = end;
            break Some(message);
        };
        self.held.drain(..at.min(self.held.len()));
        found
    }
}
