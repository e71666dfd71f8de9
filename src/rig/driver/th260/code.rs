//! Maps the error codes of the library (`errorcodes.h`) to faults, and defines the library's constants
//! (`th260defin.h`).

use crate::instrument::Fault;

/// Maximum number of boards that the library supports.
pub const DEVICES: i32 = 4;
/// Number of bins of the longest histogram.
pub const LONGEST_HISTOGRAM: usize = 32_768;
/// Argument of `TH260_Initialize` for histogramming mode.
pub const MODE_HISTOGRAM: i32 = 0;
/// Flag of `TH260_GetFlags` for the overflow of a histogram bin.
pub const FLAG_OVERFLOW: i32 = 0x0001;
/// Flag of `TH260_GetFlags` for a hardware error.
pub const FLAG_SYSTEM_ERROR: i32 = 0x0010;
/// Flag of `TH260_GetFlags` for a software error.
pub const FLAG_SOFTWARE_ERROR: i32 = 0x0020;
/// Longest acquisition time, in milliseconds.
pub const LONGEST_MS: i32 = 360_000_000;
/// Maximum offset of `TH260_SetOffset`, in nanoseconds.
pub const GREATEST_OFFSET_NS: i32 = 100_000_000;
/// Maximum absolute offset of a channel, in picoseconds.
pub const GREATEST_CHANNEL_OFFSET_PS: i32 = 99_999;

/// Error of `TH260_OpenDevice` if there is no board at an index.
pub const OPEN_FAIL: i32 = -1;

/// Returns the fault for an error code. Codes that a reconnection can clear map to [`Fault::Disconnected`].
pub fn fault(code: i32) -> Fault {
    match code {
        // The device is in use by another program or another copy of the library.
        -2 | -11 | -16 => Fault::Refused,
        // The versions of driver, library and board do not match.
        -9 | -12 | -33 | -52..=-49 => Fault::Refused,
        // An argument, mode or option is invalid, or this board does not support the function.
        -19..=-17 | -80 => Fault::Limit,
        // Memory and pointer errors of the calling program.
        -21 | -20 => Fault::Refused,
        // Lane and acknowledgement errors.
        -43..=-40 => Fault::Timeout,
        // Defects of the board's modules or EEPROM.
        -56..=-53 | -74..=-64 => Fault::Refused,
        // The board is not found, not open or not initialized, or an error of DMA, FPGA, calibration or
        // status occurred. Unknown codes are handled in the same way.
        _ => Fault::Disconnected,
    }
}

/// Returns advice on an error code, to be appended to the message. The text is empty if there is no advice.
pub fn fix(code: i32) -> &'static str {
    match code {
        OPEN_FAIL => "; check that the board and its driver are installed",
        -2 | -11 | -16 => "; close the program that uses the board",
        -9 | -12 | -33 => "; install matching versions of driver and library",
        -80 => "; this board does not support the function",
        _ => "",
    }
}
