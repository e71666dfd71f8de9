//! A library with the names of PicoQuant's and one board in it, for tests: compiled by them, loaded at run time, never part of
//! the program. Bin k of channel c holds k + 1000 (c + 1) counts.

use std::ffi::{c_char, c_int, c_uint};
use std::sync::Mutex;
use std::time::{Duration, Instant};

struct Board {
    open: bool,
    initialized: bool,
    bins: usize,
    until: Option<Instant>,
    dwell: c_int,
}

static BOARD: Mutex<Board> = Mutex::new(Board {
    open: false,
    initialized: false,
    bins: 32768,
    until: None,
    dwell: 0,
});

unsafe fn put(out: *mut c_char, text: &str) {
    for (i, b) in text.bytes().chain([0]).enumerate() {
        unsafe { *out.add(i) = b as c_char };
    }
}

/// Does it with an initialized board of index 0, or says -10 or -22 as the library does.
fn with(device: c_int, f: impl FnOnce(&mut Board) -> c_int) -> c_int {
    let mut board = BOARD.lock().unwrap();
    match (device == 0 && board.open, board.initialized) {
        (false, _) => -10,
        (true, false) => -22,
        (true, true) => f(&mut board),
    }
}

fn within(value: c_int, least: c_int, most: c_int) -> c_int {
    if value >= least && value <= most { 0 } else { -17 }
}

#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_GetLibraryVersion(out: *mut c_char) -> c_int {
    unsafe { put(out, "3.1") };
    0
}
#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_GetErrorString(out: *mut c_char, code: c_int) -> c_int {
    unsafe { put(out, &format!("fake text of {code}")) };
    0
}
#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_OpenDevice(device: c_int, serial: *mut c_char) -> c_int {
    let mut board = BOARD.lock().unwrap();
    match (device, board.open) {
        (0, false) => {
            board.open = true;
            unsafe { put(serial, "1234567") };
            0
        }
        (0, true) => -11,
        _ => -1,
    }
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_CloseDevice(device: c_int) -> c_int {
    let mut board = BOARD.lock().unwrap();
    if device == 0 {
        (board.open, board.initialized) = (false, false);
    }
    0
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_Initialize(device: c_int, mode: c_int) -> c_int {
    let mut board = BOARD.lock().unwrap();
    if device != 0 || !board.open {
        return -10;
    }
    board.initialized = mode == 0;
    if mode == 0 { 0 } else { -18 }
}
#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_GetHardwareInfo(
    device: c_int,
    model: *mut c_char,
    part: *mut c_char,
    version: *mut c_char,
) -> c_int {
    with(device, |_| unsafe {
        put(model, "TimeHarp 260 P");
        put(part, "930031");
        put(version, "1.0");
        0
    })
}
#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_GetBaseResolution(device: c_int, out: *mut f64, steps: *mut c_int) -> c_int {
    with(device, |_| unsafe {
        (*out, *steps) = (25.0, 22);
        0
    })
}
#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_GetNumOfInputChannels(device: c_int, out: *mut c_int) -> c_int {
    with(device, |_| unsafe {
        *out = 2;
        0
    })
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_SetSyncDiv(device: c_int, n: c_int) -> c_int {
    with(device, |_| within(n, 1, 8))
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_SetSyncCFD(device: c_int, level: c_int, zero: c_int) -> c_int {
    with(device, |_| within(level, -1200, 0).min(within(zero, -40, 0)))
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_SetSyncEdgeTrg(_: c_int, _: c_int, _: c_int) -> c_int {
    -80
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_SetSyncChannelOffset(device: c_int, ps: c_int) -> c_int {
    with(device, |_| within(ps, -99_999, 99_999))
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_SetInputCFD(device: c_int, channel: c_int, level: c_int, zero: c_int) -> c_int {
    with(device, |_| within(channel, 0, 1).min(within(level, -1200, 0)).min(within(zero, -40, 0)))
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_SetInputEdgeTrg(_: c_int, _: c_int, _: c_int, _: c_int) -> c_int {
    -80
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_SetStopOverflow(device: c_int, _: c_int, counts: c_uint) -> c_int {
    with(device, |_| if counts >= 1 { 0 } else { -17 })
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_SetBinning(device: c_int, binning: c_int) -> c_int {
    with(device, |_| within(binning, 0, 21))
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_SetOffset(device: c_int, ns: c_int) -> c_int {
    with(device, |_| within(ns, 0, 100_000_000))
}
#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_SetHistoLen(device: c_int, code: c_int, out: *mut c_int) -> c_int {
    with(device, |board| {
        if within(code, 0, 5) < 0 {
            return -17;
        }
        board.bins = 1024 << code;
        unsafe { *out = board.bins as c_int };
        0
    })
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_ClearHistMem(device: c_int) -> c_int {
    with(device, |_| 0)
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_StartMeas(device: c_int, ms: c_int) -> c_int {
    with(device, |board| {
        if board.until.is_some() {
            return -16;
        }
        board.until = Some(Instant::now() + Duration::from_millis(ms as u64));
        board.dwell = ms;
        within(ms, 1, 360_000_000)
    })
}
#[unsafe(no_mangle)]
pub extern "system" fn TH260_StopMeas(device: c_int) -> c_int {
    with(device, |board| {
        board.until = None;
        0
    })
}
#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_CTCStatus(device: c_int, out: *mut c_int) -> c_int {
    with(device, |board| unsafe {
        *out = c_int::from(board.until.is_none_or(|t| t <= Instant::now()));
        0
    })
}
#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_GetHistogram(device: c_int, out: *mut c_uint, channel: c_int, _: c_int) -> c_int {
    with(device, |board| {
        for k in 0..board.bins {
            unsafe { *out.add(k) = k as c_uint + 1000 * (channel as c_uint + 1) };
        }
        0
    })
}
#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_GetSyncRate(device: c_int, out: *mut c_int) -> c_int {
    with(device, |_| unsafe {
        *out = 20_000_000;
        0
    })
}
#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_GetFlags(device: c_int, out: *mut c_int) -> c_int {
    with(device, |_| unsafe {
        *out = 0;
        0
    })
}
#[unsafe(no_mangle)]
pub unsafe extern "system" fn TH260_GetElapsedMeasTime(device: c_int, out: *mut f64) -> c_int {
    with(device, |board| unsafe {
        *out = f64::from(board.dwell);
        0
    })
}
