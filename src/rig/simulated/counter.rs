//! A simulated photon counter.
//!
//! The detector is the diode of [`polarimetry::capture::detector::spad`]. The counter receives
//! light from the point at which the galvo is directed, through the elements at their true angles.

use super::faults::Mishap;
use super::light::Scenery;
use super::world::{Pending, World};
use super::{Device, Simulated};
use crate::instrument::{
    CounterLimits, CounterSettings, Failure, Fault, Histogram, Instrument, PhotonCounter,
};
use crate::ptu::record::RecordType;
use crate::ptu::synth::deal;
use crate::ptu::writer::Records;
use optics::sampling::stream::Stream;
use polarimetry::capture::detector::random::stream;
use polarimetry::capture::detector::spad::Mode;
use polarimetry::capture::directions::Directions;
use polarimetry::capture::element::Ray;
use std::time::Duration;

/// Record type of the counter's time tags, equal to that of PicoQuant's TimeHarp 260 P.
pub const TAGS: RecordType = RecordType::TimeHarp260PT3;
/// Maximum number of tags in one acquisition.
const MOST_TAGS: u64 = 1 << 26;

#[derive(Default)]
pub struct Counter {
    settings: Option<CounterSettings>,
    pending: Option<Pending<Histogram>>,
    taken: u64,
}

impl Device for Counter {
    const MODEL: &'static str = "photon counter";
    type Limits = CounterLimits;

    fn reset(&mut self) {
        (self.pending, self.settings) = (None, None);
    }
}

/// Returns the radiance in each bin from the galvo's direction. Also returns the index of the scan point.
fn radiance(w: &mut World, settings: &CounterSettings) -> Result<(Vec<f64>, u32), String> {
    let sets = w.sets();
    let [ax, ay] = w.pointing_deg.map(|a| a.to_radians().tan());
    let ray = Ray { nm: w.bench.nm, incidence: ax.hypot(ay).atan(), azimuth: ay.atan2(ax) };
    let [width, height] = w.scenery.camera();
    let (mut x, mut y) = (0, 0);
    if let Directions::Pinhole { half } = w.bench.camera {
        let place = |t: f64, half: f64, n: usize| {
            ((t / half + 1.0) / 2.0 * n as f64).floor().clamp(0.0, n as f64 - 1.0)
        };
        x = place(ax, half[0], width) as usize;
        y = place(-ay, half[1], height) as usize;
    }
    let begin_ps = match &w.scenery {
        Scenery::Scan(scan) if (scan.bin_ps - settings.bin_ps).abs() > 1e-6 * scan.bin_ps => {
            return Err(format!(
                "the counter's bins are {} ps wide, but the tensor's bins are {} ps wide; use bins of equal width",
                settings.bin_ps, scan.bin_ps
            ));
        }
        Scenery::Scan(scan) => scan.start_ps,
        _ => settings.offset_ps,
    };
    let histogram = match &mut w.scenery {
        Scenery::Scan(scan) => scan.point(x, y)?,
        Scenery::Sample { mueller, .. } => &mueller[..],
        Scenery::Tensor(_) => {
            return Err("the tensor has no time bins; use a coaxial slice with time bins".into());
        }
    };
    let seen = w.bench.histogram(histogram, &sets, &ray);
    let scale = w.power();
    // Index of the tensor's first bin among the counter's bins. Bins of the tensor before the counter's first
    // bin are dropped.
    let first = ((begin_ps - settings.offset_ps) / settings.bin_ps).round() as i64;
    let mut bins = vec![0.0; usize::try_from(first).unwrap_or(0)];
    let early = usize::try_from(-first).unwrap_or(0);
    bins.extend(seen.into_iter().skip(early).map(|v| v * scale));
    Ok((bins, (y * width + x) as u32))
}

/// Converts counts per bin to T3 records. Photons beyond the range of `dtime` are lost, as in the real card.
fn tagged(counts: &[u64], pulses: u64, alone: bool, random: &mut Stream) -> std::io::Result<Vec<u32>> {
    let seen = &counts[..counts.len().min(TAGS.dtimes() as usize)];
    if seen.iter().sum::<u64>() > MOST_TAGS {
        return Err(std::io::Error::other(
            "the photons exceed the memory of the counter; reduce the dwell time",
        ));
    }
    let mut records = Records::new(TAGS);
    for stamp in deal(seen, pulses, alone, random) {
        records.photon(stamp.sync, stamp.bin as u16, 0)?;
    }
    Ok(records.words())
}

impl PhotonCounter for Simulated<Counter> {
    fn limits(&self) -> CounterLimits {
        self.limits
    }

    fn configure(&mut self, settings: &CounterSettings, _within: Duration) -> Result<(), Failure> {
        self.alive()?;
        let fits = settings.bins >= 1
            && settings.bins <= self.limits.bins
            && settings.bin_ps.is_finite()
            && settings.bin_ps >= self.limits.finest_ps
            && settings.dwell > Duration::ZERO
            && settings.dwell <= self.limits.longest
            && settings.offset_ps.is_finite();
        if settings.tags && self.limits.tags.is_none() {
            return self.fail(Fault::Limit, "time tags are not supported; remove `time_tags` from the plan");
        }
        if !fits {
            let what = format!(
                "the counter settings {settings:?} exceed the limits {:?}; correct the plan",
                self.limits
            );
            return self.fail(Fault::Limit, what);
        }
        self.device.settings = Some(*settings);
        self.device.pending = None;
        Ok(())
    }

    fn begin(&mut self) -> Result<(), Failure> {
        let Some(settings) = self.device.settings else {
            return self.fail(Fault::Refused, "the counter is not configured; configure the counter first");
        };
        if self.device.pending.is_some() {
            return self.fail(
                Fault::Refused,
                "an acquisition is already in progress; wait for the end of the acquisition",
            );
        }
        let mishap = self.use_of(Duration::ZERO)?;
        let clock = self.world.clock();
        let begun = clock.now();
        let full = mishap == Some(Mishap::Saturation);
        let counted = self.world.with(|w| -> Result<(Vec<u64>, Vec<u32>, u64), String> {
            let (radiance, pixel) = radiance(w, &settings)?;
            let mut diode = w.spad.clone();
            diode.bin_ps = settings.bin_ps;
            diode.bins = settings.bins;
            diode.period_ps =
                (diode.period_ps / settings.bin_ps).round().max(settings.bins as f64) * settings.bin_ps;
            diode.pulses = (settings.dwell.as_secs_f64() * 1e12 / diode.period_ps).round().max(1.0) as u64;
            let rates = diode.rates(&radiance, w.bench.nm).map_err(|e| e.to_string())?;
            let mut random = stream(w.seed, pixel, w.frame);
            let counts = diode.count(&rates, &mut random).map_err(|e| e.to_string())?;
            if !settings.tags || full {
                return Ok((counts, vec![], diode.pulses));
            }
            // The counts do not depend on the card's mode. In time-tag mode, the counts are then assigned
            // to pulses.
            let alone = diode.mode == Mode::Synchronous;
            let records = tagged(&counts, diode.pulses, alone, &mut random).map_err(|e| e.to_string())?;
            Ok((vec![], records, diode.pulses))
        });
        let (counts, records, pulses) = counted.map_err(|e| self.failure(Fault::Refused, e))?;
        let count = |n: u64| {
            if full { u32::MAX } else { n.min(u64::from(u32::MAX)) as u32 }
        };
        let histogram = Histogram {
            counts: counts.into_iter().take(settings.bins).map(count).collect(),
            records,
            pulses,
            number: self.device.taken,
            timestamp_ns: begun.as_nanos() as u64,
        };
        self.device.taken += 1;
        let result = (mishap != Some(Mishap::DroppedFrame)).then_some(histogram);
        self.device.pending = Some(Pending { ready: begun + settings.dwell, result });
        Ok(())
    }

    fn finish(&mut self, within: Duration) -> Result<Histogram, Failure> {
        let words =
            ["no acquisition was started", "the acquisition is still in progress", "no histogram arrived"];
        let histogram = self.world.finish(&self.name, &mut self.device.pending, within, words)?;
        if histogram.counts.iter().any(|n| u64::from(*n) >= self.limits.full) {
            return self.fail(Fault::Saturated, "a histogram bin is full; reduce the dwell time");
        }
        Ok(histogram)
    }
}
