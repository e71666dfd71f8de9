//! A simulated area camera.
//!
//! Its image is the tensor under the shown pattern, seen through the elements at their true angles. The frame
//! number of the run keys its noise.

use super::faults::Mishap;
use super::world::Shared;
use crate::instrument::{
    AreaCamera, CameraLimits, CameraSettings, Failure, Fault, Identity, Instrument, RawFrame, pixels,
};
use std::time::Duration;

pub struct SimulatedCamera {
    name: String,
    world: Shared,
    limits: CameraLimits,
    settings: Option<CameraSettings>,
    /// The exposure under way: its readout time and its frame. The frame is `None` if it was dropped.
    pending: Option<(Duration, Option<RawFrame>)>,
    last: Option<RawFrame>,
    taken: u64,
}

impl SimulatedCamera {
    #[must_use]
    pub fn new(name: &str, world: Shared, limits: CameraLimits) -> Self {
        Self { name: name.to_owned(), world, limits, settings: None, pending: None, last: None, taken: 0 }
    }

    fn failure(&self, fault: Fault, what: String) -> Failure {
        Failure::new(fault, &self.name, what)
    }

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

impl Instrument for SimulatedCamera {
    fn name(&self) -> &str {
        &self.name
    }

    fn identify(&mut self, _within: Duration) -> Result<Identity, Failure> {
        self.world.identity(&self.name, "area camera")
    }

    fn reconnect(&mut self, within: Duration) -> Result<(), Failure> {
        (self.pending, self.settings) = (None, None);
        self.world.reconnect(&self.name, within)
    }

    fn temperature_c(&mut self) -> Option<f64> {
        Some(31.5)
    }
}

impl AreaCamera for SimulatedCamera {
    fn limits(&self) -> CameraLimits {
        self.limits.clone()
    }

    fn configure(&mut self, settings: &CameraSettings, _within: Duration) -> Result<(), Failure> {
        self.world.alive(&self.name)?;
        self.limits.check(settings).map_err(|what| self.failure(Fault::Limit, what))?;
        self.settings = Some(*settings);
        self.pending = None;
        Ok(())
    }

    fn expose(&mut self) -> Result<(), Failure> {
        let Some(settings) = self.settings else {
            return Err(self.failure(Fault::Refused, "the camera is not configured".into()));
        };
        if self.pending.is_some() {
            return Err(self.failure(Fault::Refused, "an exposure is already in progress".into()));
        }
        let mishap = self.world.use_of(&self.name, Duration::ZERO)?;
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
            number: self.taken,
            timestamp_ns: begun.as_nanos() as u64,
        };
        self.taken += 1;
        let kept = match (mishap, &self.last) {
            (Some(Mishap::DroppedFrame), _) => None,
            (Some(Mishap::StaleFrame), Some(last)) => Some(last.clone()),
            (Some(Mishap::ShortFrame), _) => {
                frame.bytes.pop();
                Some(frame)
            }
            _ => Some(frame),
        };
        self.pending = Some((ready, kept));
        Ok(())
    }

    fn frame(&mut self, within: Duration) -> Result<RawFrame, Failure> {
        self.world.alive(&self.name)?;
        let Some((ready, frame)) = self.pending.take() else {
            return Err(self.failure(Fault::Refused, "no exposure was started".into()));
        };
        let clock = self.world.clock();
        if ready > clock.now() + within {
            self.pending = Some((ready, frame));
            clock.sleep(within);
            return Err(self.failure(Fault::Timeout, "the exposure is longer than the deadline".into()));
        }
        let Some(frame) = frame else {
            clock.sleep(within);
            return Err(self.failure(Fault::Timeout, "no frame arrived".into()));
        };
        clock.sleep_until(ready);
        self.last = Some(frame.clone());
        Ok(frame)
    }
}
