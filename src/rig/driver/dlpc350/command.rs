//! Commands of pattern mode, their codes (CMD2 and CMD3 of the guide as one number) and data.

/// Where patterns come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Bit planes of the video port.
    Video,
    /// Images in flash.
    Flash,
}

/// What the sequence does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Run {
    /// It stands, and begins anew when it is started.
    Stop,
    /// It stands, and goes on when it is started.
    Pause,
    /// It runs.
    Start,
}

/// What begins a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Begin {
    /// The controller's own clock.
    Internal,
    /// A rising edge.
    Rising,
    /// A falling edge.
    Falling,
    /// The end of the one before.
    Continue,
}

/// A pattern of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
// Four bits of the controller's word, each of its own.
#[allow(clippy::struct_excessive_bools)]
pub struct Entry {
    /// What begins it.
    pub begin: Begin,
    /// Which bits of the image: for one bit a pixel the plane, 0 to 23 from green's lowest on; [`Self::WHITE`] is all light.
    pub plane: u8,
    /// Bits a pixel, 1 to 8.
    pub bits: u8,
    /// Diodes: 1 red, 2 green, 4 blue.
    pub leds: u8,
    /// Light where the image is dark.
    pub negative: bool,
    /// Dark for 230 µs after it.
    pub dark_after: bool,
    /// The image is fetched before it.
    pub fetch: bool,
    /// The trigger's output stays up from the one before.
    pub joined: bool,
}

impl Entry {
    /// The plane in which everything is light. The guide says "25, with a bit depth of 1" of numbers that it counts from 0; TI's
    /// own program has 24, which is taken here.
    pub const WHITE: u8 = 24;

    /// Its three bytes.
    #[must_use]
    pub fn bytes(&self) -> [u8; 3] {
        let flag = |on: bool, bit: u32| u8::from(on) << bit;
        [
            self.begin as u8 | (self.plane & 0x3F) << 2,
            (self.bits & 0xF) | (self.leds & 0x7) << 4,
            flag(self.negative, 0) | flag(self.dark_after, 1) | flag(self.fetch, 2) | flag(self.joined, 3),
        ]
    }

    /// The entry of three bytes.
    #[must_use]
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

/// A mailbox that takes data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mailbox {
    /// None.
    Closed,
    /// Numbers of images.
    Images,
    /// Patterns.
    Patterns,
}

/// What the host tells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Command {
    /// Pattern mode, or video.
    PatternMode(bool),
    /// Where patterns come from.
    Source(Source),
    /// 0: the video's frames begin sequences; 1: triggers, the controller's own or from outside.
    TriggerMode(u8),
    /// Output 1, of every pattern: edges in steps of 107.2 ns from 20.05 µs before it, 0 to 213.
    TriggerOut1 {
        /// Low while it is active.
        inverted: bool,
        /// Rising edge.
        rise: u8,
        /// Falling edge.
        fall: u8,
    },
    /// Output 2, of the sequence: its rising edge alone.
    TriggerOut2 {
        /// Low while it is active.
        inverted: bool,
        /// Rising edge.
        rise: u8,
    },
    /// Delay of input 1, steps of 107.2 ns; 19 bits.
    TriggerIn1(u32),
    /// Input 2 goes on at a falling edge; of trigger mode 2 alone.
    TriggerIn2(bool),
    /// Stops, pauses or starts.
    Run(Run),
    /// Times of every pattern, microseconds: equal, or 230 µs apart.
    Exposure {
        /// How long it stands.
        exposure_us: u32,
        /// From one to the next.
        period_us: u32,
    },
    /// The sequence's shape; counts from 1.
    Config {
        /// Patterns, 1 to 128.
        entries: u8,
        /// Begins again after its end.
        repeat: bool,
        /// Patterns for one pulse of the second trigger output.
        per_pulse: u8,
        /// Images, 1 to 64.
        images: u8,
    },
    /// Opens a mailbox.
    Open(Mailbox),
    /// Where in it data go.
    Address(u8),
    /// Images of the sequence by their numbers in flash. Two are written in the reverse order by TI's own program; the driver
    /// writes one.
    ImageTable(Vec<u8>),
    /// Patterns of the sequence.
    PatternTable(Vec<Entry>),
    /// Checks what was set; the result is asked for by [`Question::Validation`].
    Validate,
    /// Diodes: 1 red, 2 green, 4 blue by hand; 8 leaves them to the sequence.
    Leds(u8),
}

impl Command {
    /// Its code.
    #[must_use]
    pub fn code(&self) -> u16 {
        match self {
            Self::PatternMode(_) => 0x1A1B,
            Self::Source(_) => 0x1A22,
            Self::TriggerMode(_) => 0x1A23,
            Self::TriggerOut1 { .. } => 0x1A1D,
            Self::TriggerOut2 { .. } => 0x1A1E,
            Self::TriggerIn1(_) => 0x1A35,
            Self::TriggerIn2(_) => 0x1A36,
            Self::Run(_) => 0x1A24,
            Self::Exposure { .. } => 0x1A29,
            Self::Config { .. } => 0x1A31,
            Self::Open(_) => 0x1A33,
            Self::Address(_) => 0x1A32,
            Self::ImageTable(_) | Self::PatternTable(_) => 0x1A34,
            Self::Validate => 0x1A1A,
            Self::Leds(_) => 0x1A07,
        }
    }

    /// Its data.
    #[must_use]
    pub fn data(&self) -> Vec<u8> {
        match self {
            Self::PatternMode(on) | Self::TriggerIn2(on) => vec![u8::from(*on)],
            Self::TriggerOut1 { inverted, rise, fall } => vec![u8::from(*inverted), *rise, *fall],
            Self::TriggerOut2 { inverted, rise } => vec![u8::from(*inverted), *rise],
            Self::TriggerIn1(steps) => (steps & 0x7_FFFF).to_le_bytes().to_vec(),
            Self::Source(Source::Video) | Self::Validate => vec![0],
            Self::Source(Source::Flash) => vec![3],
            Self::Run(run) => vec![*run as u8],
            Self::Exposure {
                exposure_us,
                period_us,
            } => [exposure_us.to_le_bytes(), period_us.to_le_bytes()].concat(),
            Self::Config {
                entries,
                repeat,
                per_pulse,
                images,
            } => vec![
                entries.saturating_sub(1),
                u8::from(*repeat),
                per_pulse.saturating_sub(1),
                images.saturating_sub(1),
            ],
            Self::Open(mailbox) => vec![*mailbox as u8],
            Self::TriggerMode(n) | Self::Address(n) | Self::Leds(n) => vec![*n],
            Self::ImageTable(images) => images.clone(),
            Self::PatternTable(entries) => entries.iter().flat_map(Entry::bytes).collect(),
        }
    }
}

/// What the host asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Question {
    /// Initialization and errors of the sequencer.
    Hardware,
    /// 1: mirrors parked; 2: sequence runs; 4: frames frozen.
    Main,
    /// [`Command::Validate`]'s result: 0x80 while it is under way, then what is wrong.
    Validation,
    /// Images in flash.
    Images,
    /// Versions, four times four bytes: patch (16 bits), minor, major; the application's first.
    Version,
    /// What the firmware's maker called it.
    Tag,
}

impl Question {
    /// Its code.
    #[must_use]
    pub fn code(self) -> u16 {
        match self {
            Self::Hardware => 0x1A0A,
            Self::Main => 0x1A0C,
            Self::Validation => 0x1A1A,
            Self::Images => 0x1A42,
            Self::Version => 0x0205,
            Self::Tag => 0x1AFF,
        }
    }
}

/// What a validation's bits say, in words; the first two are errors, the others warnings.
#[must_use]
pub fn complaints(bits: u8) -> Vec<&'static str> {
    let all = [
        "exposure or period is out of range",
        "the pattern's number does not fit its bits",
        "the trigger's output overlaps black",
        "no black before a pattern that is triggered from outside",
        "period and exposure are less than 230 µs apart",
    ];
    let said = |(i, text): (usize, &'static str)| (bits >> i & 1 == 1).then_some(text);
    all.into_iter().enumerate().filter_map(said).collect()
}
