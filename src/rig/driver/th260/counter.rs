//! A TimeHarp 260 as a photon counter. Each acquisition yields one histogram.

use super::super::line::left;
use super::code::{self, DEVICES, FLAG_OVERFLOW, FLAG_SOFTWARE_ERROR, FLAG_SYSTEM_ERROR, LONGEST_HISTOGRAM};
use super::library::{Hardware, Order, Question, Th260, load};
use super::settings::{Measurement, Th260Settings};
use crate::instrument::{
    CounterLimits, CounterSettings, Failure, Fault, Histogram, Identity, Instrument, PhotonCounter,
};
use std::path::Path;
use std::time::{Duration, Instant};

/// Polling interval for the end of an acquisition.
const POLL: Duration = Duration::from_millis(1);
/// Time from initialization until the library reports valid rates.
const FIRST_RATES: Duration = Duration::from_millis(150);

/// A TimeHarp 260 board.
pub struct Th260Counter {
    name: String,
    library: Box<dyn Th260>,
    settings: Th260Settings,
    /// Index of the board. The index is negative while no board is open.
    device: i32,
    serial: String,
    hardware: Hardware,
    limits: CounterLimits,
    binnings: i32,
    measurement: Option<Measurement>,
    /// Start time of the acquisition in progress.
    running: Option<Instant>,
    /// Earliest time at which rates are valid.
    rates_from: Instant,
    /// Creation time of the counter, from which the timestamps of histograms are measured.
    made: Instant,
    taken: u64,
}

impl Th260Counter {
    /// Loads PicoQuant's library, from the given file or from its usual locations, and opens a board.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `refused`: the library is not found
    /// - `disconnected`: no board is found
    /// - `limit`: settings are invalid
    pub fn load(name: &str, library: Option<&Path>, settings: Th260Settings) -> Result<Self, Failure> {
        let library = load(library).map_err(|e| Failure::new(Fault::Refused, name, e))?;
        Self::new(name, Box::new(library), settings)
    }

    /// Opens a board through a loaded library.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `disconnected`: no board is found
    /// - `refused`: the board is in use
    /// - `limit`: settings are invalid
    pub(super) fn new(name: &str, library: Box<dyn Th260>, settings: Th260Settings) -> Result<Self, Failure> {
        settings
            .check()
            .map_err(|e| Failure::new(Fault::Limit, name, format!("{e}; correct the rig file")))?;
        let now = Instant::now();
        let mut counter = Self {
            name: name.to_owned(),
            library,
            settings,
            device: -1,
            serial: String::new(),
            hardware: Hardware::default(),
            limits: CounterLimits {
                bins: LONGEST_HISTOGRAM,
                finest_ps: f64::NAN,
                longest: Duration::from_millis(code::LONGEST_MS as u64),
                full: u64::from(u32::MAX),
                tags: None,
            },
            binnings: 0,
            measurement: None,
            running: None,
            rates_from: now,
            made: now,
            taken: 0,
        };
        counter.open()?;
        Ok(counter)
    }

    /// Converts an error code of the library to a failure.
    fn describe(&mut self, doing: &str, number: i32) -> Failure {
        let words = self.library.explain(number);
        let what = format!("{doing}: error {number} ({words}){}", code::fix(number));
        self.failure(code::fault(number), what)
    }

    /// Calls the library with the index of the open board.
    fn call<T>(
        &mut self,
        doing: &str,
        f: impl FnOnce(&mut dyn Th260, i32) -> Result<T, i32>,
    ) -> Result<T, Failure> {
        if self.device < 0 {
            return self.fail(Fault::Disconnected, "no board is open; connect the board");
        }
        f(self.library.as_mut(), self.device).map_err(|e| self.describe(doing, e))
    }

    fn tell(&mut self, order: Order) -> Result<(), Failure> {
        self.call(&format!("{order:?}"), |l, device| l.tell(device, order))
    }

    fn ask(&mut self, question: Question) -> Result<i32, Failure> {
        self.call(&format!("{question:?}"), |l, device| l.ask(device, question))
    }

    /// Finds the board, initializes it and configures its inputs.
    fn open(&mut self) -> Result<(), Failure> {
        let (mut found, mut worst) = (vec![], code::OPEN_FAIL);
        let mut opened = None;
        for device in 0..DEVICES {
            match self.library.open(device) {
                Ok(serial) if self.settings.serial.as_ref().is_none_or(|s| *s == serial) => {
                    opened = Some((device, serial));
                    break;
                }
                Ok(serial) => {
                    found.push(serial);
                    // Release the board, because its serial number differs from that in the settings.
                    let _ = self.library.tell(device, Order::Close);
                }
                Err(code::OPEN_FAIL) => {}
                Err(code) => worst = code,
            }
        }
        let Some((device, serial)) = opened else {
            if !found.is_empty() {
                let wanted = self.settings.serial.as_deref().unwrap_or_default();
                let what = format!(
                    "no board has the serial number {wanted}; connected boards: {}",
                    found.join(", ")
                );
                return self.fail(Fault::Disconnected, what);
            }
            return Err(self.describe("cannot open a board", worst));
        };
        (self.device, self.serial) = (device, serial);
        self.tell(Order::Initialize(code::MODE_HISTOGRAM))?;
        self.rates_from = Instant::now() + FIRST_RATES;
        self.hardware = self.call("hardware", |l, device| l.hardware(device))?;
        let (finest_ps, binnings) = self.call("base resolution", |l, device| l.base_resolution(device))?;
        if !(finest_ps > 0.0 && finest_ps < 1e6 && (1..64).contains(&binnings)) {
            let what = format!(
                "the board reports a base resolution of {finest_ps} ps and {binnings} binnings; expected a resolution above 0 and below \
                 1e6 ps, and 1 to 63 binnings"
            );
            return self.fail(Fault::Disconnected, what);
        }
        (self.limits.finest_ps, self.binnings) = (finest_ps, binnings);
        self.inputs()
    }

    /// Closes the board if this driver opened it. Errors are ignored, because the board might be
    /// disconnected.
    fn close(&mut self) {
        if self.device >= 0 {
            if self.running.take().is_some() {
                let _ = self.library.tell(self.device, Order::Stop);
            }
            let _ = self.library.tell(self.device, Order::Close);
            self.device = -1;
        }
    }

    fn inputs(&mut self) -> Result<(), Failure> {
        let s = self.settings.clone();
        let inputs = self.ask(Question::Inputs)?;
        if s.channel >= inputs {
            let input = s.channel;
            let what = format!(
                "input {input} does not exist, because the board has {inputs} inputs; correct `channel`"
            );
            return self.fail(Fault::Limit, what);
        }
        self.tell(Order::SyncDivider(s.sync_divider))?;
        match self.hardware.model.as_str() {
            "TimeHarp 260 P" => {
                self.tell(Order::SyncCfd(s.sync_mv, s.zero_cross_mv))?;
                self.tell(Order::InputCfd(s.channel, s.input_mv, s.zero_cross_mv))?;
            }
            "TimeHarp 260 N" => {
                self.tell(Order::SyncEdge(s.sync_mv, s.sync_edge as i32))?;
                self.tell(Order::InputEdge(s.channel, s.input_mv, s.input_edge as i32))?;
            }
            other => {
                let what =
                    format!("the model `{other}` of the board is unknown; supported: TimeHarp 260 P and N");
                return self.fail(Fault::Refused, what);
            }
        }
        self.tell(Order::StopAt(u32::MAX))
    }

    /// Returns the sync rate, which is the number of laser pulses per second.
    fn sync_rate(&mut self) -> Result<i32, Failure> {
        std::thread::sleep(self.rates_from.saturating_duration_since(Instant::now()));
        self.ask(Question::SyncRate)
    }

    /// Reads the histogram of a completed acquisition.
    fn read(&mut self, measurement: &Measurement, begun: Instant) -> Result<Histogram, Failure> {
        self.tell(Order::Stop)?;
        let flags = self.ask(Question::Flags)?;
        if flags & (FLAG_SYSTEM_ERROR | FLAG_SOFTWARE_ERROR) != 0 {
            let what = format!("the board reports an error (flags {flags:#06x}); contact PicoQuant");
            return self.fail(Fault::Disconnected, what);
        }
        if flags & FLAG_OVERFLOW != 0 {
            return self.fail(Fault::Saturated, "a histogram bin is full; reduce the dwell time");
        }
        let elapsed = self.call("elapsed time", |l, device| l.elapsed_ms(device))?;
        let pulses = f64::from(self.sync_rate()?) * elapsed / 1e3;
        let channel = self.settings.channel;
        let mut counts = self.call("histogram", |l, device| l.histogram(device, channel))?;
        counts.truncate(measurement.bins);
        self.taken += 1;
        Ok(Histogram {
            counts,
            records: vec![],
            pulses: pulses.round() as u64,
            number: self.taken - 1,
            timestamp_ns: begun.duration_since(self.made).as_nanos() as u64,
        })
    }
}

impl Drop for Th260Counter {
    fn drop(&mut self) {
        self.close();
    }
}

impl Instrument for Th260Counter {
    fn name(&self) -> &str {
        &self.name
    }

    fn identify(&mut self, _within: Duration) -> Result<Identity, Failure> {
        let hardware = self.call("hardware", |l, device| l.hardware(device))?;
        let version = self.call("version", |l, _| l.version())?;
        Ok(Identity {
            maker: "PicoQuant".into(),
            model: format!("{} ({})", hardware.model, hardware.part),
            serial: self.serial.clone(),
            firmware: format!("{}, TH260Lib {version}", hardware.version),
        })
    }

    fn reconnect(&mut self, _within: Duration) -> Result<(), Failure> {
        self.close();
        self.measurement = None;
        self.open()
    }
}

impl PhotonCounter for Th260Counter {
    fn limits(&self) -> CounterLimits {
        self.limits
    }

    fn configure(&mut self, settings: &CounterSettings, _within: Duration) -> Result<(), Failure> {
        if settings.tags {
            let what = "the time-tagged mode is not supported; remove `time_tags` from the plan";
            return self.fail(Fault::Limit, what);
        }
        let measurement = Measurement::new(settings, self.limits.finest_ps, self.binnings)
            .map_err(|e| self.failure(Fault::Limit, format!("{e}; correct the plan")))?;
        if self.running.take().is_some() {
            self.tell(Order::Stop)?;
        }
        self.measurement = None;
        let bins = self.ask(Question::Length(measurement.length_code))?;
        if usize::try_from(bins).is_ok_and(|b| b < measurement.bins) {
            let what = format!(
                "the board allows {bins} bins, but the histogram has {} bins; reduce the number of bins",
                measurement.bins
            );
            return self.fail(Fault::Limit, what);
        }
        self.tell(Order::Binning(measurement.binning))?;
        self.tell(Order::Offset(measurement.offset_ns))?;
        self.tell(Order::SyncOffset(measurement.sync_offset_ps))?;
        self.measurement = Some(measurement);
        Ok(())
    }

    fn begin(&mut self) -> Result<(), Failure> {
        let Some(measurement) = self.measurement else {
            return self.fail(Fault::Refused, "the counter is not configured; configure the counter first");
        };
        if self.running.is_some() {
            return self.fail(
                Fault::Refused,
                "an acquisition is already in progress; wait for the end of the acquisition",
            );
        }
        if self.sync_rate()? == 0 {
            let what = "no pulses at the sync input; check the laser, the cable and `sync_mv`";
            return self.fail(Fault::Refused, what);
        }
        self.tell(Order::Clear)?;
        self.tell(Order::Start(measurement.dwell_ms))?;
        self.running = Some(Instant::now());
        Ok(())
    }

    fn finish(&mut self, within: Duration) -> Result<Histogram, Failure> {
        let (Some(measurement), Some(begun)) = (self.measurement, self.running) else {
            return self.fail(Fault::Refused, "no acquisition was started; start an acquisition first");
        };
        let until = Instant::now() + within;
        while self.ask(Question::Done)? == 0 {
            if left(until).is_zero() {
                return self.fail(
                    Fault::Timeout,
                    "the acquisition is still in progress at the deadline; allow more time",
                );
            }
            std::thread::sleep(POLL.min(left(until)));
        }
        self.running = None;
        self.read(&measurement, begun)
    }
}
