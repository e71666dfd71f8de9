//! Binding to PicoQuant's library, loaded at run time. All unsafe code of the driver is in this module.
//!
//! Signatures follow `th260lib.h` 3.1. Every buffer that the library writes to is longer than `th260defin.h`
//! requires and outlives the call.

use super::code::LONGEST_HISTOGRAM;
use libloading::Library;
use std::error::Error;
use std::ffi::{c_char, c_double, c_int, c_uint};
use std::path::{Path, PathBuf};

/// A command to a board. Each variant calls the library function with the given name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// Calls `CloseDevice`.
    Close,
    /// Calls `Initialize` with the mode.
    Initialize(i32),
    /// Calls `SetSyncDiv` with the divider.
    SyncDivider(i32),
    /// Calls `SetSyncCFD` with the trigger level and the zero-crossing level (TimeHarp 260 P).
    SyncCfd(i32, i32),
    /// Calls `SetSyncEdgeTrg` with the trigger level and the edge (TimeHarp 260 N).
    SyncEdge(i32, i32),
    /// Calls `SetSyncChannelOffset` with the offset in picoseconds.
    SyncOffset(i32),
    /// Calls `SetInputCFD` with the channel, the trigger level and the zero-crossing level (TimeHarp 260 P).
    InputCfd(i32, i32, i32),
    /// Calls `SetInputEdgeTrg` with the channel, the trigger level and the edge (TimeHarp 260 N).
    InputEdge(i32, i32, i32),
    /// Calls `SetStopOverflow` to stop the acquisition when a bin reaches this count.
    StopAt(u32),
    /// Calls `SetBinning` with the binning code.
    Binning(i32),
    /// Calls `SetOffset` with the offset in nanoseconds.
    Offset(i32),
    /// Calls `ClearHistMem`.
    Clear,
    /// Calls `StartMeas` with the acquisition time in milliseconds.
    Start(i32),
    /// Calls `StopMeas`.
    Stop,
}

/// A query to a board that returns an integer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Question {
    /// Calls `GetNumOfInputChannels`, which returns the number of input channels.
    Inputs,
    /// Calls `CTCStatus`, which returns 0 while the acquisition runs.
    Done,
    /// Calls `GetSyncRate`, which returns the pulses per second.
    SyncRate,
    /// Calls `GetFlags`, which returns the status flags.
    Flags,
    /// Calls `SetHistoLen` with the length code and returns the number of bins.
    Length(i32),
}

/// Hardware information of a board.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Hardware {
    /// `TimeHarp 260 P` or `TimeHarp 260 N`.
    pub model: String,
    pub part: String,
    pub version: String,
}

/// The functions of the library. Errors are the library's codes, which are all negative.
pub(super) trait Th260: Send {
    fn version(&mut self) -> Result<String, i32>;
    /// Returns the library's text for an error code.
    fn explain(&mut self, code: i32) -> String;
    /// Opens the board at an index and returns its serial number.
    fn open(&mut self, device: i32) -> Result<String, i32>;
    /// Sends a command to a board.
    fn tell(&mut self, device: i32, order: Order) -> Result<(), i32>;
    /// Sends a query to a board and returns the reply.
    fn ask(&mut self, device: i32, question: Question) -> Result<i32, i32>;
    /// Returns model, part number and version of a board.
    fn hardware(&mut self, device: i32) -> Result<Hardware, i32>;
    /// Returns the finest bin width, in picoseconds, and the number of binnings.
    fn base_resolution(&mut self, device: i32) -> Result<(f64, i32), i32>;
    /// Returns the duration of the last measurement, in milliseconds.
    fn elapsed_ms(&mut self, device: i32) -> Result<f64, i32>;
    /// Returns [`LONGEST_HISTOGRAM`] counts of an input, which are valid up to the configured length.
    fn histogram(&mut self, device: i32, channel: i32) -> Result<Vec<u32>, i32>;
}

/// Returns the file names of the library to try.
pub(super) fn names() -> Vec<PathBuf> {
    let names: &[&str] = if cfg!(windows) {
        &["th260lib64.dll", "th260lib.dll"]
    } else {
        &["libth260.so", "th260lib.so", "/usr/local/lib64/th260/th260lib.so"]
    };
    names.iter().map(PathBuf::from).collect()
}

type Text = unsafe extern "system" fn(*mut c_char) -> c_int;
type TextOf = unsafe extern "system" fn(*mut c_char, c_int) -> c_int;
type OfDevice = unsafe extern "system" fn(c_int) -> c_int;
type OfOne = unsafe extern "system" fn(c_int, c_int) -> c_int;
type OfTwo = unsafe extern "system" fn(c_int, c_int, c_int) -> c_int;
type OfThree = unsafe extern "system" fn(c_int, c_int, c_int, c_int) -> c_int;
type OfOverflow = unsafe extern "system" fn(c_int, c_int, c_uint) -> c_int;
type Answer = unsafe extern "system" fn(c_int, *mut c_int) -> c_int;
type AnswerOf = unsafe extern "system" fn(c_int, c_int, *mut c_int) -> c_int;
type Number = unsafe extern "system" fn(c_int, *mut c_double) -> c_int;
type Base = unsafe extern "system" fn(c_int, *mut c_double, *mut c_int) -> c_int;
type TextOfDevice = unsafe extern "system" fn(c_int, *mut c_char) -> c_int;
type ThreeTexts = unsafe extern "system" fn(c_int, *mut c_char, *mut c_char, *mut c_char) -> c_int;
type Counts = unsafe extern "system" fn(c_int, *mut c_uint, c_int, c_int) -> c_int;

/// Declares the function table with one entry per name, and the code that fills the table.
macro_rules! functions {
    ($($field:ident: $kind:ty = $name:literal,)*) => {
        /// The loaded library. The function pointers are valid while `_library` is loaded.
        pub(super) struct Loaded {
            $($field: $kind,)*
            _library: Library,
        }

        impl Loaded {
            /// Looks up all functions.
            fn table(library: Library) -> Result<Self, String> {
                // SAFETY: each name has the type that `th260lib.h` 3.1 declares for it. The pointers are
                // copied out of their `Symbol`s. The pointers are used only while `_library`, which is stored
                // in the same struct, keeps the code loaded.
                unsafe {
                    $(let $field = *library.get::<$kind>($name).map_err(|_| format!("missing function {}", text($name)))?;)*
                    Ok(Self { $($field,)* _library: library })
                }
            }
        }
    };
}

functions! {
    get_version: Text = b"TH260_GetLibraryVersion\0",
    get_error: TextOf = b"TH260_GetErrorString\0",
    open_device: TextOfDevice = b"TH260_OpenDevice\0",
    close: OfDevice = b"TH260_CloseDevice\0",
    initialize: OfOne = b"TH260_Initialize\0",
    get_hardware: ThreeTexts = b"TH260_GetHardwareInfo\0",
    get_base: Base = b"TH260_GetBaseResolution\0",
    get_inputs: Answer = b"TH260_GetNumOfInputChannels\0",
    sync_divider: OfOne = b"TH260_SetSyncDiv\0",
    sync_cfd: OfTwo = b"TH260_SetSyncCFD\0",
    sync_edge: OfTwo = b"TH260_SetSyncEdgeTrg\0",
    sync_offset: OfOne = b"TH260_SetSyncChannelOffset\0",
    input_cfd: OfThree = b"TH260_SetInputCFD\0",
    input_edge: OfThree = b"TH260_SetInputEdgeTrg\0",
    stop_overflow: OfOverflow = b"TH260_SetStopOverflow\0",
    binning: OfOne = b"TH260_SetBinning\0",
    offset: OfOne = b"TH260_SetOffset\0",
    length: AnswerOf = b"TH260_SetHistoLen\0",
    clear: OfDevice = b"TH260_ClearHistMem\0",
    start: OfOne = b"TH260_StartMeas\0",
    stop: OfDevice = b"TH260_StopMeas\0",
    done: Answer = b"TH260_CTCStatus\0",
    get_histogram: Counts = b"TH260_GetHistogram\0",
    get_sync_rate: Answer = b"TH260_GetSyncRate\0",
    get_flags: Answer = b"TH260_GetFlags\0",
    get_elapsed: Number = b"TH260_GetElapsedMeasTime\0",
}

/// Loads the given library. If no library is given, loads the first of [`names`] that can be loaded.
///
/// # Errors
/// If no library can be loaded, returns a message that lists the files tried, the cause of each failure, and
/// the library's source.
pub(super) fn load(given: Option<&Path>) -> Result<Loaded, String> {
    let tried = given.map_or_else(names, |p| vec![p.to_owned()]);
    let mut message = vec![];
    for name in &tried {
        // SAFETY: loading runs the initializers of PicoQuant's library or of the user's replacement.
        let found = unsafe { Library::new(name) };
        match found.map_err(|e| words(&e)).and_then(Loaded::table) {
            Ok(library) => return Ok(library),
            Err(e) => message.push(format!("{}: {e}", name.display())),
        }
    }
    Err(format!(
        "cannot load PicoQuant's library for the TimeHarp 260 ({}); the library is part of PicoQuant's TH260Lib package (a free download from \
         PicoQuant's website, not shipped with Sunstone); install it, or set library = \"…\"",
        message.join("; ")
    ))
}

/// Formats an error with its chain of causes.
fn words(error: &dyn Error) -> String {
    std::iter::successors(Some(error), |e| (*e).source())
        .map(ToString::to_string)
        .collect::<Vec<_>>()
        .join(": ")
}

/// Converts a return code to a result.
fn good(code: c_int) -> Result<(), i32> {
    if code < 0 { Err(code) } else { Ok(()) }
}

/// Returns the text up to the first zero byte. The buffer must be zeroed before the library writes to it.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).trim().to_owned()
}

/// Calls a function that writes `N` texts, and returns the texts. Each buffer has 256 characters. No function
/// writes more than 40 characters (`th260defin.h`).
fn texts<const N: usize>(call: impl FnOnce([*mut c_char; N]) -> c_int) -> Result<[String; N], i32> {
    let mut buffers = [[0_u8; 256]; N];
    good(call(buffers.each_mut().map(|b| b.as_mut_ptr().cast())))?;
    Ok(buffers.map(|b| text(&b)))
}

impl Th260 for Loaded {
    fn version(&mut self) -> Result<String, i32> {
        // SAFETY: the function writes at most 8 characters.
        texts(|[version]| unsafe { (self.get_version)(version) }).map(|[version]| version)
    }

    fn explain(&mut self, code: i32) -> String {
        // SAFETY: the function writes at most 40 characters.
        let found = texts(|[words]| unsafe { (self.get_error)(words, code) });
        found.map_or_else(|_| "no description".into(), |[words]| words)
    }

    fn open(&mut self, device: i32) -> Result<String, i32> {
        // SAFETY: the function writes at most 8 characters.
        texts(|[serial]| unsafe { (self.open_device)(device, serial) }).map(|[serial]| serial)
    }

    fn tell(&mut self, device: i32, order: Order) -> Result<(), i32> {
        // SAFETY: all arguments are integers, and none is a pointer. The library checks the ranges of the
        // arguments.
        good(unsafe {
            match order {
                Order::Close => (self.close)(device),
                Order::Initialize(mode) => (self.initialize)(device, mode),
                Order::SyncDivider(n) => (self.sync_divider)(device, n),
                Order::SyncCfd(level, zero) => (self.sync_cfd)(device, level, zero),
                Order::SyncEdge(level, edge) => (self.sync_edge)(device, level, edge),
                Order::SyncOffset(ps) => (self.sync_offset)(device, ps),
                Order::InputCfd(channel, level, zero) => (self.input_cfd)(device, channel, level, zero),
                Order::InputEdge(channel, level, edge) => (self.input_edge)(device, channel, level, edge),
                Order::StopAt(counts) => (self.stop_overflow)(device, 1, counts),
                Order::Binning(code) => (self.binning)(device, code),
                Order::Offset(ns) => (self.offset)(device, ns),
                Order::Clear => (self.clear)(device),
                Order::Start(ms) => (self.start)(device, ms),
                Order::Stop => (self.stop)(device),
            }
        })
    }

    fn ask(&mut self, device: i32, question: Question) -> Result<i32, i32> {
        let mut answer: c_int = 0;
        // SAFETY: each function writes one `int` through the pointer, to a local that outlives the call.
        good(unsafe {
            match question {
                Question::Inputs => (self.get_inputs)(device, &raw mut answer),
                Question::Done => (self.done)(device, &raw mut answer),
                Question::SyncRate => (self.get_sync_rate)(device, &raw mut answer),
                Question::Flags => (self.get_flags)(device, &raw mut answer),
                Question::Length(code) => (self.length)(device, code, &raw mut answer),
            }
        })?;
        Ok(answer)
    }

    fn hardware(&mut self, device: i32) -> Result<Hardware, i32> {
        // SAFETY: the function writes at most 16 characters into each buffer.
        let found =
            texts(|[model, part, version]| unsafe { (self.get_hardware)(device, model, part, version) })?;
        let [model, part, version] = found;
        Ok(Hardware { model, part, version })
    }

    fn base_resolution(&mut self, device: i32) -> Result<(f64, i32), i32> {
        let (mut resolution, mut steps): (c_double, c_int) = (0.0, 0);
        // SAFETY: the function writes one `double` and one `int`, to locals that outlive the call.
        good(unsafe { (self.get_base)(device, &raw mut resolution, &raw mut steps) })?;
        Ok((resolution, steps))
    }

    fn elapsed_ms(&mut self, device: i32) -> Result<f64, i32> {
        let mut elapsed: c_double = 0.0;
        // SAFETY: the function writes one `double`, to a local that outlives the call.
        good(unsafe { (self.get_elapsed)(device, &raw mut elapsed) })?;
        Ok(elapsed)
    }

    fn histogram(&mut self, device: i32, channel: i32) -> Result<Vec<u32>, i32> {
        let mut counts: Vec<c_uint> = vec![0; LONGEST_HISTOGRAM];
        // SAFETY: the function writes at most MAXHISTLEN counts, the vector's length. The argument 0
        // leaves the board's memory unchanged.
        good(unsafe { (self.get_histogram)(device, counts.as_mut_ptr(), channel, 0) })?;
        Ok(counts)
    }
}
