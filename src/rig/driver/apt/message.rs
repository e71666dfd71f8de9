//! Messages: a header of six bytes, followed by data if the highest bit of the fifth byte is set.
//!
//! - without data: id u16 | parameter u8 | parameter u8 | destination u8 | source u8
//! - with data: id u16 | length u16 | destination u8 or 0x80 | source u8 | data
//!
//! All numbers are little-endian.

/// Address of the host.
pub const HOST: u8 = 0x01;
/// Address of a USB controller with one channel.
pub const CONTROLLER: u8 = 0x50;
const CHANNEL: u8 = 1;
/// Maximum length of a message's data, in bytes.
const LONGEST: usize = 255;

/// Bits of a status.
pub mod bits {
    /// A limit switch is active.
    pub const LIMITS: u32 = 0x3;
    /// The stage is moving, in either direction.
    pub const MOVING: u32 = 0x30 | 0xC0;
    /// The stage is homing.
    pub const HOMING: u32 = 0x200;
    /// The stage is homed: its zero is known.
    pub const HOMED: u32 = 0x400;
    /// The stage has settled at its goal.
    pub const SETTLED: u32 = 0x2000;
    /// Motion error: the motor cannot follow.
    pub const MOTION_ERROR: u32 = 0x4000;
    /// The channel is enabled.
    pub const ENABLED: u32 = 0x8000_0000;
}

/// Status of a stage: 14 bytes that several messages contain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status {
    /// Position, in encoder counts.
    pub position: i32,
    /// Encoder counts; for DC controllers, the velocity (i16) and a reserved word.
    pub extra: u32,
    /// Status bits, see [`bits`].
    pub bits: u32,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Message {
    /// MGMSG_HW_REQ_INFO.
    RequestInfo,
    /// MGMSG_HW_GET_INFO: serial number, model, type, firmware (minor, interim, major, unused), hardware
    /// version, modification, channels.
    Info {
        serial: u32,
        /// Model, up to 8 bytes.
        model: String,
        /// Firmware: minor, interim and major version.
        firmware: [u8; 3],
    },
    /// MGMSG_MOD_IDENTIFY: flash the front panel.
    Identify,
    /// MGMSG_MOD_SET_CHANENABLESTATE.
    Enable(bool),
    /// MGMSG_HW_STOP_UPDATEMSGS: send a status only on request.
    StopUpdates,
    /// MGMSG_MOT_SET_VELPARAMS: acceleration and maximum velocity in the controller's units.
    SetVelocity { acceleration: i32, velocity: i32 },
    /// MGMSG_MOT_MOVE_HOME.
    Home,
    /// MGMSG_MOT_MOVE_HOMED.
    Homed,
    /// MGMSG_MOT_MOVE_ABSOLUTE with the position in counts.
    MoveAbsolute(i32),
    /// MGMSG_MOT_MOVE_COMPLETED, with or without a status.
    MoveCompleted(Option<Status>),
    /// MGMSG_MOT_MOVE_STOP: immediate or with a ramp.
    Stop {
        /// Stop without a ramp.
        abrupt: bool,
    },
    /// MGMSG_MOT_MOVE_STOPPED, with or without a status.
    MoveStopped(Option<Status>),
    /// MGMSG_MOT_REQ_STATUSUPDATE.
    RequestStatus,
    /// MGMSG_MOT_GET_STATUSUPDATE.
    Status(Status),
    /// MGMSG_MOT_REQ_DCSTATUSUPDATE.
    RequestDcStatus,
    /// MGMSG_MOT_GET_DCSTATUSUPDATE.
    DcStatus(Status),
    /// MGMSG_MOT_ACK_DCSTATUSUPDATE: the host is alive; controllers on USB require it every second.
    AckDcStatus,
    /// Any other message: id, parameters, data.
    Other(u16, [u8; 2], Vec<u8>),
}

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
    #[must_use]
    pub fn bytes(&self, destination: u8, source: u8) -> Vec<u8> {
        let short = |id: u16, a: u8, b: u8| {
            let [low, high] = id.to_le_bytes();
            vec![low, high, a, b, destination, source]
        };
        let long = |id: u16, data: Vec<u8>| {
            let mut bytes = id.to_le_bytes().to_vec();
            bytes.extend((data.len() as u16).to_le_bytes());
            bytes.extend([destination | 0x80, source]);
            bytes.extend(data);
            bytes
        };
        let maybe = |id: u16, status: &Option<Status>| match status {
            Some(status) => long(id, status.data()),
            None => short(id, CHANNEL, 0),
        };
        match self {
            Self::RequestInfo => short(0x0005, 0, 0),
            Self::Info { serial, model, firmware } => {
                let mut data = serial.to_le_bytes().to_vec();
                let mut name = model.as_bytes().to_vec();
                name.resize(8, 0);
                data.extend(name);
                data.extend(16_u16.to_le_bytes());
                data.extend(firmware);
                data.push(0);
                data.extend([0; 60]);
                for word in [1_u16, 0, 1] {
                    data.extend(word.to_le_bytes());
                }
                long(0x0006, data)
            }
            Self::Identify => short(0x0223, 0, 0),
            Self::Enable(on) => short(0x0210, CHANNEL, if *on { 1 } else { 2 }),
            Self::StopUpdates => short(0x0012, 0, 0),
            Self::SetVelocity { acceleration, velocity } => {
                let mut data = vec![CHANNEL, 0];
                for value in [0, *acceleration, *velocity] {
                    data.extend(value.to_le_bytes());
                }
                long(0x0413, data)
            }
            Self::Home => short(0x0443, CHANNEL, 0),
            Self::Homed => short(0x0444, CHANNEL, 0),
            Self::MoveAbsolute(counts) => {
                let mut data = vec![CHANNEL, 0];
                data.extend(counts.to_le_bytes());
                long(0x0453, data)
            }
            Self::MoveCompleted(status) => maybe(0x0464, status),
            Self::Stop { abrupt } => short(0x0465, CHANNEL, if *abrupt { 1 } else { 2 }),
            Self::MoveStopped(status) => maybe(0x0466, status),
            Self::RequestStatus => short(0x0480, CHANNEL, 0),
            Self::Status(status) => long(0x0481, status.data()),
            Self::RequestDcStatus => short(0x0490, CHANNEL, 0),
            Self::DcStatus(status) => long(0x0491, status.data()),
            Self::AckDcStatus => short(0x0492, 0, 0),
            Self::Other(id, [a, b], data) if data.is_empty() => short(*id, *a, *b),
            Self::Other(id, _, data) => long(*id, data.clone()),
        }
    }

    /// Decodes a message from its header's id and parameters and its data.
    fn of(id: u16, parameters: [u8; 2], data: &[u8]) -> Self {
        let other = || Self::Other(id, parameters, data.to_vec());
        let status = || Status::of(data);
        let word = |at: usize| {
            let four = data.get(at..at + 4)?.try_into().ok()?;
            Some(i32::from_le_bytes(four))
        };
        let found = match (id, data.len()) {
            (0x0005, 0) => Some(Self::RequestInfo),
            (0x0006, 84) => {
                let name = data[4..12].split(|b| *b == 0).next().unwrap_or_default();
                word(0).map(|serial| Self::Info {
                    serial: serial as u32,
                    model: String::from_utf8_lossy(name).trim().to_owned(),
                    firmware: [data[14], data[15], data[16]],
                })
            }
            (0x0223, 0) => Some(Self::Identify),
            (0x0210, 0) => Some(Self::Enable(parameters[1] == 1)),
            (0x0012, 0) => Some(Self::StopUpdates),
            (0x0413, 14) => word(6)
                .zip(word(10))
                .map(|(acceleration, velocity)| Self::SetVelocity { acceleration, velocity }),
            (0x0443, 0) => Some(Self::Home),
            (0x0444, 0) => Some(Self::Homed),
            (0x0453, 6) => word(2).map(Self::MoveAbsolute),
            (0x0464, 0) => Some(Self::MoveCompleted(None)),
            (0x0464, 14) => status().map(|s| Self::MoveCompleted(Some(s))),
            (0x0465, 0) => Some(Self::Stop { abrupt: parameters[1] == 1 }),
            (0x0466, 0) => Some(Self::MoveStopped(None)),
            (0x0466, 14) => status().map(|s| Self::MoveStopped(Some(s))),
            (0x0480, 0) => Some(Self::RequestStatus),
            (0x0481, 14) => status().map(Self::Status),
            (0x0490, 0) => Some(Self::RequestDcStatus),
            (0x0491, 14) => status().map(Self::DcStatus),
            (0x0492, 0) => Some(Self::AckDcStatus),
            _ => None,
        };
        found.unwrap_or_else(other)
    }
}

/// Parser of messages in a byte stream. It skips bytes until a valid header begins.
#[derive(Debug)]
pub struct Parser {
    /// Address of the receiver; headers with other destinations are invalid.
    own: u8,
    held: Vec<u8>,
}

impl Parser {
    /// Creates a parser for messages to `own`.
    #[must_use]
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

    /// Returns the next complete message.
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
            if !follows {
                let message = Message::of(id, [header[2], header[3]], &[]);
                at += 6;
                break Some(message);
            }
            match self.held.get(at + 6..at + 6 + length) {
                Some(data) => {
                    let message = Message::of(id, [0, 0], data);
                    at += 6 + length;
                    break Some(message);
                }
                None => break None,
            }
        };
        self.held.drain(..at.min(self.held.len()));
        found
    }
}
