//! Commands of pattern mode. A command has a code (CMD2 and CMD3 of the guide as one number) and data.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Patterns are bit planes of the video port.
    Video,
    /// Patterns are bit planes of the images in flash.
    Flash,
}

/// State to which the host sets the pattern sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Run {
    /// The sequence is stopped. A start command restarts the sequence at its first pattern.
    Stop,
    /// The sequence is paused. A start command resumes the sequence.
    Pause,
    Start,
}

/// Trigger that begins a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Begin {
    /// The controller's internal clock begins the pattern.
    Internal,
    /// A rising edge begins the pattern.
    Rising,
    /// A falling edge begins the pattern.
    Falling,
    /// The end of the previous pattern begins the pattern.
    Continue,
}

/// A pattern of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
// Each flag is one bit of the controller's word.
#[allow(clippy::struct_excessive_bools)]
pub struct Entry {
    /// Trigger that begins the pattern.
    pub begin: Begin,
    /// Index of the plane in the flash image, or [`Self::WHITE`]. Planes of one-bit patterns are numbered
    /// from 0 to 23, starting at the lowest bit of green.
    pub plane: u8,
    /// Number of bits per pixel, 1 to 8.
    pub bits: u8,
    /// LEDs as a bit mask, with 1 for red, 2 for green and 4 for blue.
    pub leds: u8,
    /// Whether the pattern is inverted.
    pub negative: bool,
    /// Whether 230 µs of black follow the pattern.
    pub dark_after: bool,
    /// Whether the next image is loaded from flash before the pattern.
    pub fetch: bool,
    /// Whether the trigger output stays active from the previous pattern.
    pub joined: bool,
}

impl Entry {
    /// Plane that lights all pixels. The guide specifies "25, with a bit depth of 1", although the guide
    /// numbers planes from 0. The driver uses 24, as TI's own program does.
    pub const WHITE: u8 = 24;

    /// Encodes the entry as three bytes.
    pub fn bytes(&self) -> [u8; 3] {
        let flag = |on: bool, bit: u32| u8::from(on) << bit;
        [
            self.begin as u8 | (self.plane & 0x3F) << 2,
            (self.bits & 0xF) | (self.leds & 0x7) << 4,
            flag(self.negative, 0) | flag(self.dark_after, 1) | flag(self.fetch, 2) | flag(self.joined, 3),
        ]
    }

    /// Decodes an entry from three bytes.
    pub fn read([a, b, c]: [u8; 3]) -> Self {
        Self {
            begin: [Begin::Internal, Begin::Rising, Begin::Falling, Begin::Continue][usize::from(a & 3)],
            plane: a >> 2,
            bits: b & 0xF,
            leds: b >> 4 & 0x7,
            negative: c & 1 != 0,
            dark_after: c & 2 != 0,
            fetch: c & 4 != 0,
            joined: c & 8 != 0,
        }
    }
}

/// A mailbox of the controller that receives data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mailbox {
    Closed,
    /// Receives image numbers.
    Images,
    /// Receives pattern entries.
    Patterns,
}

/// A command from the host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Command {
    /// Selects pattern mode if true, and video mode if false.
    PatternMode(bool),
    /// Selects the source of the patterns.
    Source(Source),
    /// Sets the trigger mode. In mode 0, video frames begin sequences. In mode 1, triggers begin patterns.
    TriggerMode(u8),
    /// Sets trigger output 1, which is active once per pattern. Edges are 0 to 213 steps of 107.2 ns after
    /// the earliest time, which is 20.05 µs before the pattern.
    TriggerOut1 {
        /// Whether the output is active low.
        inverted: bool,
        rise: u8,
        fall: u8,
    },
    /// Sets trigger output 2, which is active once per sequence. Output 2 has only a rising edge.
    TriggerOut2 {
        /// Whether the output is active low.
        inverted: bool,
        rise: u8,
    },
    /// Sets the delay of trigger input 1 in steps of 107.2 ns (19 bits).
    TriggerIn1(u32),
    /// Sets trigger input 2. If true, the sequence resumes at a falling edge. Input 2 is used only in trigger
    /// mode 2.
    TriggerIn2(bool),
    /// Stops, pauses or starts the sequence.
    Run(Run),
    /// Sets the times of every pattern, in µs. The period equals the exposure, or exceeds the exposure by at
    /// least 230 µs.
    Exposure { exposure_us: u32, period_us: u32 },
    /// Configures the sequence. All numbers are at least 1.
    Config {
        /// Number of patterns, 1 to 128.
        entries: u8,
        /// Whether the sequence restarts after its end.
        repeat: bool,
        /// Number of patterns per pulse of trigger output 2.
        per_pulse: u8,
        /// Number of images, 1 to 64.
        images: u8,
    },
    /// Opens a mailbox for the data that follow.
    Open(Mailbox),
    /// Sets the write offset in the open mailbox.
    Address(u8),
    /// Sets the numbers of the sequence's images in flash. TI's program writes two numbers in reverse order.
    /// This driver writes only one number.
    ImageTable(Vec<u8>),
    /// Sets the patterns of the sequence.
    PatternTable(Vec<Entry>),
    /// Validates the sequence. [`Question::Validation`] returns the result.
    Validate,
    /// Sets the LEDs. Under manual control, the bits are 1 for red, 2 for green and 4 for blue. If the value
    /// is 8, the sequence controls the LEDs.
    Leds(u8),
}

impl Command {
    /// Returns the code and the encoded data of the command.
    pub fn encode(&self) -> (u16, Vec<u8>) {
        match self {
            Self::PatternMode(on) => (0x1A1B, vec![u8::from(*on)]),
            Self::Source(Source::Video) => (0x1A22, vec![0]),
            Self::Source(Source::Flash) => (0x1A22, vec![3]),
            Self::TriggerMode(mode) => (0x1A23, vec![*mode]),
            Self::TriggerOut1 { inverted, rise, fall } => (0x1A1D, vec![u8::from(*inverted), *rise, *fall]),
            Self::TriggerOut2 { inverted, rise } => (0x1A1E, vec![u8::from(*inverted), *rise]),
            Self::TriggerIn1(steps) => (0x1A35, (steps & 0x7_FFFF).to_le_bytes().to_vec()),
            Self::TriggerIn2(on) => (0x1A36, vec![u8::from(*on)]),
            Self::Run(run) => (0x1A24, vec![*run as u8]),
            Self::Exposure { exposure_us, period_us } => {
                (0x1A29, [exposure_us.to_le_bytes(), period_us.to_le_bytes()].concat())
            }
            Self::Config { entries, repeat, per_pulse, images } => {
                let less = |n: &u8| n.saturating_sub(1);
                (0x1A31, vec![less(entries), u8::from(*repeat), less(per_pulse), less(images)])
            }
            Self::Open(mailbox) => (0x1A33, vec![*mailbox as u8]),
            Self::Address(offset) => (0x1A32, vec![*offset]),
            Self::ImageTable(images) => (0x1A34, images.clone()),
            Self::PatternTable(entries) => (0x1A34, entries.iter().flat_map(Entry::bytes).collect()),
            Self::Validate => (0x1A1A, vec![0]),
            Self::Leds(leds) => (0x1A07, vec![*leds]),
        }
    }
}

/// A query from the host. The value of each variant is the code of the query.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Question {
    /// Requests the state of initialization and the errors of the sequencer.
    Hardware = 0x1A0A,
    /// Requests a bit mask, with 1 if the mirrors are parked, 2 if the sequence runs, and 4 if frames are
    /// frozen.
    Main = 0x1A0C,
    /// Requests the result of [`Command::Validate`]. The reply is 0x80 while validation runs, then a bit mask
    /// of faults.
    Validation = 0x1A1A,
    /// Requests the number of images in flash.
    Images = 0x1A42,
    /// Requests four versions of four bytes each, the application's version first. Each version consists of
    /// patch (16 bits), minor and major number.
    Version = 0x0205,
    /// Requests the tag that the firmware's author assigned.
    Tag = 0x1AFF,
}

/// Returns messages for the bits of a validation result. The first two messages are errors, and all other
/// messages are warnings.
pub fn complaints(bits: u8) -> Vec<&'static str> {
    let all = [
        "the exposure or the period is out of range",
        "the pattern number exceeds the bit depth",
        "the trigger output overlaps the black period",
        "an externally triggered pattern needs a black period before it",
        "the period and the exposure differ by less than 230 µs",
    ];
    let set = |(i, text): (usize, &'static str)| (bits >> i & 1 == 1).then_some(text);
    all.into_iter().enumerate().filter_map(set).collect()
}
