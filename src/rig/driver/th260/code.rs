//! The library's error codes (`errorcodes.h`) as the six faults, and its constants (`th260defin.h`).

use crate::instrument::Fault;

/// Boards that the library knows of.
pub const DEVICES: i32 = 4;
/// Bins of the longest histogram.
pub const LONGEST_HISTOGRAM: usize = 32_768;
/// `TH260_Initialize`: histogramming.
pub const MODE_HISTOGRAM: i32 = 0;
/// `TH260_GetFlags`: a bin is full.
pub const FLAG_OVERFLOW: i32 = 0x0001;
/// Hardware error.
pub const FLAG_SYSTEM_ERROR: i32 = 0x0010;
/// Software error.
pub const FLAG_SOFTWARE_ERROR: i32 = 0x0020;
/// Longest acquisition, milliseconds.
pub const LONGEST_MS: i32 = 360_000_000;
/// Greatest offset of `TH260_SetOffset`, nanoseconds.
pub const GREATEST_OFFSET_NS: i32 = 100_000_000;
/// Greatest offset of a channel, picoseconds, either way.
pub const GREATEST_CHANNEL_OFFSET_PS: i32 = 99_999;

/// No board at this index.
pub const OPEN_FAIL: i32 = -1;

/// What a code is to a session. Where connecting anew fixes it, it is [`Fault::Disconnected`].
#[must_use]
pub fn fault(code: i32) -> Fault {
    match code {
        // Open by another program, or by another one's library.
        -2 | -11 | -16 => Fault::Refused,
        // Driver, library and board are not of one version.
        -9 | -12 | -33 | -52..=-49 => Fault::Refused,
        // Argument, mode, option; a function that this board has not.
        -19..=-17 | -80 => Fault::Limit,
        // Memory and pointers that the program gave.
        -21 | -20 => Fault::Refused,
        // Lanes, acknowledgements.
        -43..=-40 => Fault::Timeout,
        // What the board is made of: modules, EEPROM.
        -56..=-53 | -74..=-64 => Fault::Refused,
        // No such board, not open, not initialized, DMA, FPGA, calibration, status, and what is no code at all.
        _ => Fault::Disconnected,
    }
}

/// What to do about a code, where there is something to do.
#[must_use]
pub fn fix(code: i32) -> &'static str {
    match code {
        OPEN_FAIL => "; is the board in the machine, and its driver installed?",
        -2 | -11 | -16 => "; close the program that uses the board",
        -9 | -12 | -33 => "; install driver and library of one version",
        -80 => "; this board cannot do that",
        _ => "",
    }
}
