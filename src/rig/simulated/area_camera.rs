//! A simulated area camera.
//!
//! The image is computed from the tensor, the displayed pattern, and the elements at their true angles.
//! The noise depends on the frame number of the run.

use super::faults::Mishap;
use super::world::Pending;
use super::{Device, Simulated};
use crate::instrument::{
    AreaCamera, CameraLimits, CameraSettings, Failure, Fault, Instrument, RawFrame, pixels,
};
use std::time::Duration;

#[derive(Default)]
pub struct Camera {
    settings: Option<CameraSettings>,
    pending: Option<Pending<RawFrame>>,
    last: Option<RawFrame>,
    taken: u64,
}

impl Device for Camera {
    const MODEL: &'static str = "area camera";
    const TEMPERATURE_C: Option<f64> = Some(31.5);
    type Limits = CameraLimits;

    fn reset(&mut self) {
        (self.pending, self.settings) = (None, None);
    }
}

impl Simulated<Camera> {
    /// Returns the digital numbers of an exposure that begins now.
    fn numbers(&self, settings: &CameraSettings) -> Result<Vec<u32>, Failure> {
        let r = settings.region;
        let region = [r.x, r.y, r.width, r.height].map(|n| n as usize);
        let size = self.limits.size.map(|n| n as usize);
        let found = self.world.with(|w| {
            let sets = w.sets();
            let pattern = w.pattern.clone();
            let bench = w.bench.clone();
            let image = match w.scenery.light(pattern.as_deref(), &bench, &sets[0])? {
                Some(light) => bench.image(light, &sets, size, region),
                None => vec![0.0; region[2] * region[3]],
            };
            let mut cmos = w.cmos.clone();
            cmos.exposure_s = settings.exposure.as_secs_f64();
            cmos.bit_depth = cmos.bit_depth.min(settings.format.bits());
            let gain = 10.0_f64.powf(settings.gain_db / 20.0);
            let full = ((1_u64 << cmos.bit_depth) - 1) as f64;
            cmos.gain_e_per_dn = Some(w.cmos.gain_e_per_dn.unwrap_or(cmos.full_well_e / full) / gain);
            let pixels = (0..region[3]).flat_map(|y| {
                (0..region[2]).map(move |x| ((y + region[1]) * size[0] + x + region[0]) as u32)
            });
            let frame = cmos.frame(&image, pixels, w.bench.nm, 1.0, w.seed, w.frame);
            frame.map_err(|e| e.to_string())
        });
        found.map_err(|e| self.failure(Fault::Refused, e))
    }
}

impl AreaCamera for Simulated<Camera> {
    fn limits(&self) -> CameraLimits {
        self.limits.clone()
    }

    fn configure(&mut self, settings: &CameraSettings, _within: Duration) -> Result<(), Failure> {
        self.alive()?;
        self.limits.check(settings).map_err(|what| self.failure(Fault::Limit, what))?;
        self.device.settings = Some(*settings);
        self.device.pending = None;
        Ok(())
    }

    fn expose(&mut self) -> Result<(), Failure> {
        let Some(settings) = self.device.settings else {
            return self.fail(Fault::Refused, "the camera is not configured; configure the camera first");
        };
        if self.device.pending.is_some() {
            return self.fail(
                Fault::Refused,
                "an exposure is already in progress; wait for the end of the exposure",
            );
        }
        let mishap = self.use_of(Duration::ZERO)?;
        let clock = self.world.clock();
        let begun = clock.now();
        let ready = begun + settings.exposure + self.limits.row_time * settings.region.height;
        let mut numbers = self.numbers(&settings)?;
        if mishap == Some(Mishap::Saturation) {
            numbers.fill((1 << settings.format.bits().min(self.world.with(|w| w.cmos.bit_depth))) - 1);
        }
        let mut frame = RawFrame {
            region: settings.region,
            format: settings.format,
            bytes: pixels::pack(&numbers, settings.format),
            number: self.device.taken,
            timestamp_ns: begun.as_nanos() as u64,
        };
        self.device.taken += 1;
        let kept = match (mishap, &self.device.last) {
            (Some(Mishap::DroppedFrame), _) => None,
            (Some(Mishap::StaleFrame), Some(last)) => Some(last.clone()),
            (Some(Mishap::ShortFrame), _) => {
                frame.bytes.pop();
                Some(frame)
            }
            _ => Some(frame),
        };
        self.device.pending = Some(Pending { ready, result: kept });
        Ok(())
    }

    fn frame(&mut self, within: Duration) -> Result<RawFrame, Failure> {
        let words =
            ["no exposure was started", "the exposure is longer than the deadline", "no frame arrived"];
        let frame = self.world.finish(&self.name, &mut self.device.pending, within, words)?;
        self.device.last = Some(frame.clone());
        Ok(frame)
    }
}
