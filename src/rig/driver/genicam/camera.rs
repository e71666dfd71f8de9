//! A GenICam camera as an area camera, with one frame per trigger.
//!
//! After [`AreaCamera::configure`], the acquisition runs and the camera waits for triggers. An exposure
//! therefore starts immediately at its trigger.

use super::nodes::{Control, Nodes};
use super::stream::{Block, Frames, fault};
use crate::instrument::{
    AreaCamera, CameraLimits, CameraSettings, Failure, Fault, Identity, Instrument, PixelFormat, RawFrame,
    Trigger,
};
use cameleon::StreamError;
use std::time::Duration;

/// Relative tolerance of the exposure time, which cameras round to the period of their clock.
const EXPOSURE_OFF: f64 = 0.01;

pub struct GenICamCamera {
    nodes: Nodes,
    frames: Box<dyn Frames>,
    limits: CameraLimits,
    settings: Option<CameraSettings>,
    /// Whether the acquisition runs or might run. The acquisition might still run if an earlier program or
    /// connection did not stop it.
    acquiring: bool,
    /// Whether the frame of a started exposure has not arrived yet.
    pending: bool,
}

fn common_multiple(a: u32, b: u32) -> u32 {
    let (mut x, mut y) = (a, b);
    while y > 0 {
        (x, y) = (y, x % y);
    }
    a / x * b
}

impl GenICamCamera {
    /// Opens a camera and reads its limits. `row_time` is the readout time of one row, which the camera does
    /// not report.
    ///
    /// # Errors
    /// Returns a [`Failure`] of one of these kinds:
    /// - `disconnected` or `timeout`
    /// - `refused`: the camera is in use, or a feature is missing
    pub fn new(
        name: &str,
        control: Control,
        frames: Box<dyn Frames>,
        row_time: Duration,
    ) -> Result<Self, Failure> {
        let nodes = Nodes::open(name, control)?;
        let mut camera = Self {
            nodes,
            frames,
            limits: CameraLimits {
                size: [0; 2],
                step: [1; 2],
                exposure: [Duration::ZERO; 2],
                gain_db: [0.0; 2],
                formats: vec![],
                row_time,
            },
            settings: None,
            acquiring: true,
            pending: false,
        };
        let opened = camera.frames.open();
        opened.map_err(|e| camera.of_stream(&e))?;
        camera.read_limits()?;
        Ok(camera)
    }

    fn of_stream(&self, error: &StreamError) -> Failure {
        self.nodes.failure(fault(error), error.to_string())
    }

    fn read_limits(&mut self) -> Result<(), Failure> {
        let n = &mut self.nodes;
        n.choose_if("GainSelector", "All")?;
        for automatic in ["ExposureAuto", "GainAuto"] {
            n.choose_if(automatic, "Off")?;
        }
        let size = [n.integer("WidthMax")?, n.integer("HeightMax")?];
        self.limits.size = size.map(|v| u32::try_from(v).unwrap_or(0));
        let steps = [[n.step("Width")?, n.step("OffsetX")?], [n.step("Height")?, n.step("OffsetY")?]];
        self.limits.step = steps.map(|[a, b]| common_multiple(a, b));
        let micros = n.range("ExposureTime")?;
        self.limits.exposure =
            micros.map(|us| Duration::try_from_secs_f64(us / 1e6).unwrap_or(Duration::ZERO));
        self.limits.gain_db = n.range("Gain")?;
        let entries = n.entries("PixelFormat")?;
        let known = PixelFormat::ALL.into_iter().filter(|f| entries.iter().any(|e| e == f.name()));
        self.limits.formats = known.collect();
        if self.limits.formats.is_empty() || self.limits.size.contains(&0) {
            let what = format!(
                "unsupported sensor with size {:?} and pixel formats {}; expected at least one pixel, and one of the formats Mono8, \
                 Mono10p, Mono12p and Mono16",
                self.limits.size,
                entries.join(", ")
            );
            return self.fail(Fault::Refused, what);
        }
        Ok(())
    }

    /// Locks or unlocks the features that define the stream's layout.
    fn lock(&mut self, locked: bool) -> Result<(), Failure> {
        if self.nodes.has("TLParamsLocked") {
            self.nodes.set_integer("TLParamsLocked", i64::from(locked))?;
        }
        Ok(())
    }

    /// Stops the acquisition and unlocks the features.
    fn halt(&mut self) -> Result<(), Failure> {
        self.pending = false;
        if !self.acquiring {
            return Ok(());
        }
        let stopped = self.frames.stop();
        stopped.map_err(|e| self.of_stream(&e))?;
        match self.nodes.command("AcquisitionStop") {
            // A camera whose acquisition does not run may refuse the stop command.
            Err(e) if !matches!(e.fault, Fault::Refused | Fault::Limit) => return Err(e),
            _ => {}
        }
        self.lock(false)?;
        self.nodes.line("stream", |c| c.disable_streaming())?;
        self.acquiring = false;
        Ok(())
    }

    /// Starts the acquisition in the order of USB3 Vision. Sets the stream registers, locks features, sends
    /// the start command, and starts reception.
    fn acquire(&mut self) -> Result<(), Failure> {
        self.nodes.line("stream", |c| c.enable_streaming())?;
        self.acquiring = true;
        self.lock(true)?;
        self.nodes.command("AcquisitionStart")?;
        let started = self.frames.start(self.nodes.control());
        started.map_err(|e| self.of_stream(&e))
    }

    fn set(&mut self, settings: &CameraSettings) -> Result<(), Failure> {
        let n = &mut self.nodes;
        let r = settings.region;
        // Reset the offsets first, because the maximum width depends on the offset.
        n.set_integer("OffsetX", 0)?;
        n.set_integer("OffsetY", 0)?;
        n.set_integer("Width", i64::from(r.width))?;
        n.set_integer("Height", i64::from(r.height))?;
        n.set_integer("OffsetX", i64::from(r.x))?;
        n.set_integer("OffsetY", i64::from(r.y))?;
        n.choose("PixelFormat", settings.format.name())?;
        for (feature, entry) in [
            ("AcquisitionMode", "Continuous"),
            ("ExposureMode", "Timed"),
            ("ExposureAuto", "Off"),
            ("GainSelector", "All"),
            ("GainAuto", "Off"),
        ] {
            n.choose_if(feature, entry)?;
        }
        let micros = settings.exposure.as_secs_f64() * 1e6;
        n.set_number("ExposureTime", micros)?;
        let found = n.number("ExposureTime")?;
        let off = (found / micros - 1.0).abs();
        if off.is_nan() || off > EXPOSURE_OFF {
            let what = format!(
                "the camera set an exposure time of {found} µs instead of {micros} µs; correct the exposure time in the plan"
            );
            return n.fail(Fault::Limit, what);
        }
        n.set_number("Gain", settings.gain_db)?;
        n.choose_if("TriggerSelector", "FrameStart")?;
        n.choose("TriggerMode", "On")?;
        n.choose(
            "TriggerSource",
            match settings.trigger {
                Trigger::Software => "Software",
                Trigger::Line => "Line0",
            },
        )
    }

    fn raw(&self, block: Block, settings: &CameraSettings) -> Result<RawFrame, Failure> {
        if block.region != settings.region || block.format != Some(settings.format) {
            let what = format!(
                "got a frame with region {:?} and format {}, but the camera is configured for region {:?} and format {}",
                block.region,
                block.format.map_or("unknown", PixelFormat::name),
                settings.region,
                settings.format.name()
            );
            return self.fail(Fault::Disconnected, what);
        }
        let pixels = block.region.width as usize * block.region.height as usize;
        let mut bytes = block.bytes;
        bytes.truncate(settings.format.bytes(pixels));
        Ok(RawFrame {
            region: block.region,
            format: settings.format,
            bytes,
            number: block.number,
            timestamp_ns: block.timestamp.as_nanos() as u64,
        })
    }
}

impl Drop for GenICamCamera {
    fn drop(&mut self) {
        let _ = self.halt();
        let _ = self.frames.close();
        let _ = self.nodes.control().close();
    }
}

impl Instrument for GenICamCamera {
    fn name(&self) -> &str {
        self.nodes.name()
    }

    fn identify(&mut self, _within: Duration) -> Result<Identity, Failure> {
        let n = &mut self.nodes;
        let firmware = ["DeviceFirmwareVersion", "DeviceVersion"].into_iter().find(|f| n.has(f));
        Ok(Identity {
            maker: n.text("DeviceVendorName")?,
            model: n.text("DeviceModelName")?,
            serial: n.text("DeviceSerialNumber")?,
            firmware: firmware.map_or(Ok(String::new()), |f| n.text(f))?,
        })
    }

    fn reconnect(&mut self, _within: Duration) -> Result<(), Failure> {
        // Ignore errors, because a disconnected camera cannot be stopped.
        let _ = self.halt();
        (self.settings, self.acquiring, self.pending) = (None, true, false);
        let _ = self.frames.close();
        let _ = self.nodes.control().close();
        self.nodes.line("open", |c| c.open())?;
        let opened = self.frames.open();
        opened.map_err(|e| self.of_stream(&e))
    }

    fn temperature_c(&mut self) -> Option<f64> {
        if !self.nodes.has("DeviceTemperature") {
            return None;
        }
        self.nodes.number("DeviceTemperature").ok()
    }
}

impl AreaCamera for GenICamCamera {
    fn limits(&self) -> CameraLimits {
        self.limits.clone()
    }

    fn configure(&mut self, settings: &CameraSettings, _within: Duration) -> Result<(), Failure> {
        self.limits.check(settings).map_err(|what| self.nodes.failure(Fault::Limit, what))?;
        self.settings = None;
        self.halt()?;
        self.set(settings)?;
        self.acquire()?;
        self.settings = Some(*settings);
        Ok(())
    }

    fn expose(&mut self) -> Result<(), Failure> {
        let Some(settings) = self.settings else {
            return self.fail(Fault::Refused, "the camera is not configured; configure the camera first");
        };
        if self.pending {
            return self.fail(
                Fault::Refused,
                "an exposure is already in progress; wait for the end of the exposure",
            );
        }
        if settings.trigger == Trigger::Software {
            self.nodes.command("TriggerSoftware")?;
        }
        self.pending = true;
        Ok(())
    }

    fn frame(&mut self, within: Duration) -> Result<RawFrame, Failure> {
        let (Some(settings), true) = (self.settings, self.pending) else {
            return self.fail(Fault::Refused, "no exposure was started; start an exposure first");
        };
        match self.frames.next(within) {
            Ok(Some(block)) => {
                self.pending = false;
                self.raw(block, &settings)
            }
            Ok(None) => self.fail(
                Fault::Timeout,
                "no frame arrived before the deadline; check the trigger and the cable",
            ),
            Err(e) => {
                self.pending = false;
                Err(self.of_stream(&e))
            }
        }
    }
}
