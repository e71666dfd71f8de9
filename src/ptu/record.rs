//! Records of 32 bits. A record represents a photon, a marker, a sync pulse, or a clock overflow.
//!
//! | | from the least significant bit | special | overflow | markers |
//! |---|---|---|---|---|
//! | PicoHarp 300 T3 | sync 16, dtime 12, channel 4 (1 to 4) | channel 15 | dtime 0: 65536 | bits of dtime |
//! | PicoHarp 300 T2 | time 28, channel 4 (1 to 4; 0 is a sync) | channel 15 | time's last 4 bits 0: 210698240 | these bits |
//! | all others T3 | sync 10, dtime 15, channel 6, special 1 | special | channel 63: 1024 · sync | channel 1 to 15 |
//! | all others T2 | time 25, channel 6, special 1 | special | channel 63: 33554432 · time | channel 1 to 15; 0 is a sync |
//!
//! In the first version of the HydraHarp, each overflow record represents one overflow (of 33552000 counts
//! in T2). In later versions, a count of 0 also represents one overflow.

/// Timing mode of photons, T2 or T3.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Photons are timed by one clock. Sync pulses are separate events.
    T2,
    /// Photons are timed by the number of the sync pulse and the time since that pulse.
    T3,
}

/// Record type of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RecordType {
    PicoHarpT2,
    PicoHarpT3,
    /// HydraHarp 400, first version, T2.
    HydraHarpT2,
    /// HydraHarp 400, first version, T3.
    HydraHarpT3,
    /// HydraHarp 400, second version, T2.
    HydraHarp2T2,
    /// HydraHarp 400, second version, T3.
    HydraHarp2T3,
    /// TimeHarp 260 Nano, T2.
    TimeHarp260NT2,
    /// TimeHarp 260 Nano, T3.
    TimeHarp260NT3,
    /// TimeHarp 260 Pico, T2.
    TimeHarp260PT2,
    /// TimeHarp 260 Pico, T3.
    TimeHarp260PT3,
    /// MultiHarp 150 and 160, PicoHarp 330, T2.
    GenericT2,
    /// MultiHarp 150 and 160, PicoHarp 330, T3.
    GenericT3,
}

/// Header code, name and bit layout of every record type, in the order of the variants.
const TYPES: [(RecordType, u32, &str, Family); 12] = [
    (RecordType::PicoHarpT2, 0x0001_0203, "PicoHarp 300 T2", Family::PicoT2),
    (RecordType::PicoHarpT3, 0x0001_0303, "PicoHarp 300 T3", Family::PicoT3),
    (RecordType::HydraHarpT2, 0x0001_0204, "HydraHarp 1 T2", Family::OldHydraT2),
    (RecordType::HydraHarpT3, 0x0001_0304, "HydraHarp 1 T3", Family::OldHydraT3),
    (RecordType::HydraHarp2T2, 0x0101_0204, "HydraHarp 2 T2", Family::HydraT2),
    (RecordType::HydraHarp2T3, 0x0101_0304, "HydraHarp 2 T3", Family::HydraT3),
    (RecordType::TimeHarp260NT2, 0x0001_0205, "TimeHarp 260 N T2", Family::HydraT2),
    (RecordType::TimeHarp260NT3, 0x0001_0305, "TimeHarp 260 N T3", Family::HydraT3),
    (RecordType::TimeHarp260PT2, 0x0001_0206, "TimeHarp 260 P T2", Family::HydraT2),
    (RecordType::TimeHarp260PT3, 0x0001_0306, "TimeHarp 260 P T3", Family::HydraT3),
    (RecordType::GenericT2, 0x0001_0207, "MultiHarp T2", Family::HydraT2),
    (RecordType::GenericT3, 0x0001_0307, "MultiHarp T3", Family::HydraT3),
];

impl RecordType {
    pub const ALL: [Self; 12] = {
        let mut all = [Self::PicoHarpT2; 12];
        let mut i = 0;
        while i < all.len() {
            all[i] = TYPES[i].0;
            assert!(all[i] as usize == i, "the table has the order of the variants");
            i += 1;
        }
        all
    };

    /// Returns the type's code in headers.
    pub fn code(self) -> u32 {
        TYPES[self as usize].1
    }

    /// Returns the type of a code.
    pub fn of_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|r| r.code() == code)
    }

    pub fn name(self) -> &'static str {
        TYPES[self as usize].2
    }

    pub fn mode(self) -> Mode {
        match self.family() {
            Family::PicoT2 | Family::HydraT2 | Family::OldHydraT2 => Mode::T2,
            Family::PicoT3 | Family::HydraT3 | Family::OldHydraT3 => Mode::T3,
        }
    }

    /// Returns the highest channel number plus 1. Channels are numbered from 0, except those of the PicoHarp
    /// in T2, which are numbered from 1.
    pub fn channels(self) -> u8 {
        match self.family() {
            Family::PicoT2 => 5,
            Family::PicoT3 => 4,
            _ => 64,
        }
    }

    /// Returns the number of `dtime` values in T3.
    pub fn dtimes(self) -> u32 {
        if self.family() == Family::PicoT3 { 1 << 12 } else { 1 << 15 }
    }

    pub(super) fn family(self) -> Family {
        TYPES[self as usize].3
    }
}

/// Types with the same bit layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Family {
    PicoT2,
    PicoT3,
    OldHydraT2,
    OldHydraT3,
    HydraT2,
    HydraT3,
}

/// The fields of a record. Times do not include overflows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Parts {
    Photon { time: u32, dtime: u32, channel: u32 },
    Sync { time: u32 },
    Marker { time: u32, bits: u8 },
    Overflow(u64),
    Unknown,
}

/// The bit layout of a family. Each layout is a separate type so that loops over records are monomorphized.
pub(super) trait Layout {
    /// Whether the records are T2 records.
    const T2: bool;
    /// Number of clock counts per overflow.
    const PERIOD: u64;
    fn split(record: u32) -> Parts;
}

pub(super) struct PicoT2;
pub(super) struct PicoT3;
/// The layout of HydraHarp T2 records. `OLD` selects the HydraHarp's first version.
pub(super) struct HydraT2<const OLD: bool>;
/// The layout of HydraHarp T3 records. `OLD` selects the HydraHarp's first version.
pub(super) struct HydraT3<const OLD: bool>;

impl Layout for PicoT2 {
    const T2: bool = true;
    const PERIOD: u64 = 210_698_240;
    #[inline(always)]
    fn split(record: u32) -> Parts {
        let (time, channel) = (record & 0x0fff_ffff, record >> 28);
        match channel {
            0 => Parts::Sync { time },
            1..=4 => Parts::Photon { time, dtime: 0, channel },
            15 if time.is_multiple_of(16) => Parts::Overflow(Self::PERIOD),
            15 => Parts::Marker { time, bits: (time & 15) as u8 },
            _ => Parts::Unknown,
        }
    }
}

impl Layout for PicoT3 {
    const T2: bool = false;
    const PERIOD: u64 = 1 << 16;
    #[inline(always)]
    fn split(record: u32) -> Parts {
        let (time, dtime, channel) = (record & 0xffff, record >> 16 & 0xfff, record >> 28);
        match channel {
            1..=4 => Parts::Photon { time, dtime, channel: channel - 1 },
            15 if dtime == 0 => Parts::Overflow(Self::PERIOD),
            15 if dtime < 16 => Parts::Marker { time, bits: dtime as u8 },
            _ => Parts::Unknown,
        }
    }
}

/// Decodes a special record of any device except the PicoHarp 300.
#[inline(always)]
fn special(time: u32, channel: u32, period: u64, old: bool) -> Parts {
    match channel {
        63 if old => Parts::Overflow(period),
        63 => Parts::Overflow(period * u64::from(time.max(1))),
        1..=15 => Parts::Marker { time, bits: channel as u8 },
        _ => Parts::Unknown,
    }
}

impl<const OLD: bool> Layout for HydraT2<OLD> {
    const T2: bool = true;
    const PERIOD: u64 = if OLD { 33_552_000 } else { 1 << 25 };
    #[inline(always)]
    fn split(record: u32) -> Parts {
        let (time, channel) = (record & 0x01ff_ffff, record >> 25 & 63);
        if record >> 31 == 0 {
            Parts::Photon { time, dtime: 0, channel }
        } else if channel == 0 {
            Parts::Sync { time }
        } else {
            special(time, channel, Self::PERIOD, OLD)
        }
    }
}

impl<const OLD: bool> Layout for HydraT3<OLD> {
    const T2: bool = false;
    const PERIOD: u64 = 1 << 10;
    #[inline(always)]
    fn split(record: u32) -> Parts {
        let (time, channel) = (record & 0x3ff, record >> 25 & 63);
        if record >> 31 == 0 {
            Parts::Photon { time, dtime: record >> 10 & 0x7fff, channel }
        } else {
            special(time, channel, Self::PERIOD, OLD)
        }
    }
}

/// Calls a function that is generic over a [`Layout`] with the layout of a record type.
macro_rules! with_layout {
    ($record:expr, $call:ident [$($more:tt)*]($($arguments:expr),*)) => {{
        use $crate::record::{Family, HydraT2, HydraT3, PicoT2, PicoT3};
        match $record.family() {
            Family::PicoT2 => $call::<PicoT2, $($more)*>($($arguments),*),
            Family::PicoT3 => $call::<PicoT3, $($more)*>($($arguments),*),
            Family::OldHydraT2 => $call::<HydraT2<true>, $($more)*>($($arguments),*),
            Family::OldHydraT3 => $call::<HydraT3<true>, $($more)*>($($arguments),*),
            Family::HydraT2 => $call::<HydraT2<false>, $($more)*>($($arguments),*),
            Family::HydraT3 => $call::<HydraT3<false>, $($more)*>($($arguments),*),
        }
    }};
}
pub(super) use with_layout;

/// A decoded record. Times are measured from the start and include overflows. The unit is the sync pulse in
/// T3 and the clock count in T2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    Photon {
        time: u64,
        /// Time since the sync pulse in counts of `dtime` (T3), or 0 in T2.
        dtime: u16,
        /// Detector channel, from 0.
        channel: u8,
    },
    /// A sync pulse (T2).
    Sync { time: u64 },
    /// A signal at one or more of the four marker inputs.
    Marker {
        time: u64,
        /// Marker inputs. Bit 0 is the first input.
        bits: u8,
    },
    /// The clock overflowed.
    Overflow {
        /// Accumulated offset that is added to all later times.
        time: u64,
    },
    /// An invalid record.
    Unknown { record: u32 },
}

/// Decodes consecutive records into events.
#[derive(Clone, Copy, Debug)]
pub struct Decoder {
    record: RecordType,
    overflow: u64,
}

fn split<L: Layout>(record: u32) -> Parts {
    L::split(record)
}

impl Decoder {
    /// Creates a decoder for the start of a measurement.
    pub fn new(record: RecordType) -> Self {
        Self { record, overflow: 0 }
    }

    /// Decodes the next record. Times saturate at 64 bits, which only damaged files reach.
    pub fn decode(&mut self, record: u32) -> Event {
        let at = |time: u32| self.overflow.saturating_add(u64::from(time));
        match with_layout!(self.record, split[](record)) {
            Parts::Photon { time, dtime, channel } => {
                Event::Photon { time: at(time), dtime: dtime as u16, channel: channel as u8 }
            }
            Parts::Sync { time } => Event::Sync { time: at(time) },
            Parts::Marker { time, bits } => Event::Marker { time: at(time), bits },
            Parts::Overflow(more) => {
                self.overflow = self.overflow.saturating_add(more);
                Event::Overflow { time: self.overflow }
            }
            Parts::Unknown => Event::Unknown { record },
        }
    }
}
