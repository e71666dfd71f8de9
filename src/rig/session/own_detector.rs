//! Data for calibrating the detector of a run. The data are histograms of a plane for a counter, or dark and
//! lit frames for a camera.

use super::image::{ImageError, Run, failed};
use crate::calibrate::radiometric::stack::Stack;
use crate::calibrate::temporal::captures::{Capture, Counter};
use polarimetry::capture::detector::spad::Mode;
use polarimetry::capture::directions::Directions;

/// Speed of light in metres per picosecond.
const C: f64 = 299_792_458e-12;

pub struct Histograms {
    /// The counter's parameters as stored in the run.
    pub counter: Counter,
    pub points: usize,
    /// Counts for every capture and point.
    counts: Vec<Vec<u32>>,
    /// Number of laser pulses for every capture and point.
    pulses: Vec<u64>,
    /// For each point, the length of the ray to the plane, divided by the distance of the plane.
    slant: Vec<f64>,
    offset_ps: f64,
}

impl Histograms {
    /// Returns the histograms of a plane perpendicular to the scan's axis, `metres` from the mirrors' pivot.
    pub fn of_plane(&self, metres: f64) -> Vec<Capture<'_>> {
        let all = self.counts.iter().zip(&self.pulses).enumerate();
        all.map(|(i, (counts, pulses))| {
            let pixel = i % self.points;
            Capture {
                pixel,
                travel_ps: 2.0 * metres * self.slant[pixel] / C - self.offset_ps,
                counts,
                pulses: *pulses,
            }
        })
        .collect()
    }
}

impl Run {
    /// Returns the histograms of a scan.
    ///
    /// # Errors
    /// Returns [`ImageError`] if the run is not a scan or is damaged.
    pub fn histograms(&self) -> Result<Histograms, ImageError> {
        let path = self.store.path().display().to_string();
        let Some(spad) = self.diode()? else {
            return Err(ImageError(format!(
                "{path}: the run is a camera run, but a scan is required; use a run of a plan with [scan]"
            )));
        };
        let [captures, height, width, bins] = self.shape()?;
        let Some(fov) = self.fov_x.filter(|_| width > 0 && height > 0 && bins > 0) else {
            return Err(self.damaged("the frames' shape"));
        };
        let view = Directions::pinhole(fov, width, height);
        let slant = (0..width * height).map(|p| {
            let [ax, ay] = view.ray(p % width, p / width, [width, height], self.nm).direction();
            (1.0 + ax.tan().powi(2) + ay.tan().powi(2)).sqrt()
        });
        let mut counts = vec![];
        for row in 0..captures * height {
            let all = self.store.read_chunk(row).map_err(failed)?;
            counts.extend(all.chunks_exact(bins).map(<[u32]>::to_vec));
        }
        let pulses: Vec<u64> = self.pulses()?.into_iter().map(|n| n.max(0.0) as u64).collect();
        if pulses.len() != counts.len() {
            return Err(self.damaged("`pulses`"));
        }
        let free = spad.mode == Mode::FreeRunning;
        let counter = Counter {
            mode: spad.mode,
            bin_ps: spad.bin_ps,
            period_bins: spad.period_bins(),
            dead_ps: if free { spad.dead_time_ps } else { 0.0 },
            after_pulse_ps: (free && spad.after_pulsing > 0.0).then_some(spad.after_pulse_time_ps),
        };
        Ok(Histograms {
            counter,
            points: width * height,
            counts,
            pulses,
            slant: slant.collect(),
            offset_ps: self.work["offset_ps"].as_f64().ok_or_else(|| self.damaged("`offset_ps`"))?,
        })
    }

    /// Returns the dark and lit frames of a camera, one stack per exposure. The irradiance of lit frames
    /// is set to 1.
    ///
    /// # Errors
    /// Returns [`ImageError`] if the run is a scan, is damaged, has no masks `dark` and `full`, or has
    /// captures with different element angles.
    pub fn stacks(&self) -> Result<[Vec<Stack>; 2], ImageError> {
        let path = self.store.path().display().to_string();
        let (Ok([captures, shots, exposures, height, width]), None) = (self.shape(), self.fov_x) else {
            return Err(ImageError(format!(
                "{path}: the run is a scan, but a camera run is required; use a run of a plan with [camera]"
            )));
        };
        let elements = self.scheme.generator().iter().chain(self.scheme.analyzer());
        let still = elements.into_iter().all(|e| {
            let angles: Vec<f64> = (0..captures).map(|k| e.set_at(k).angle.to_degrees()).collect();
            angles.iter().all(|a| (a - angles[0]).abs() < 0.1)
        });
        if !still {
            return Err(ImageError(format!(
                "{path}: the angles differ between captures, so the light differs between frames; use a run whose scheme repeats one \
                 setting, such as angle_deg = [0, 0, 0, …]"
            )));
        }
        let list = self.work["masks"].as_array().ok_or_else(|| self.damaged("`masks`"))?;
        let first = |mask: &str| -> Result<usize, ImageError> {
            let entry = list.iter().find(|m| m["name"] == mask).ok_or_else(|| {
                ImageError(format!("{path}: the run has no mask `{mask}`; use masks = [\"dark\", \"full\"]"))
            })?;
            let first = entry["first"].as_u64().unwrap_or(u64::MAX) as usize;
            (first < shots).then_some(first).ok_or_else(|| self.damaged("`masks`"))
        };
        let bits = self.bits();
        let times = self.store.layout().axes[2].coords.clone();
        let stack = |shot: usize, e: usize, light: f64| -> Result<Stack, ImageError> {
            let message =
                |e: crate::calibrate::radiometric::RadiometricError| ImageError(format!("{path}: {e}"));
            let mut stack =
                Stack::new(height * width, times[e], light, ((1_u64 << bits) - 1) as u32).map_err(message)?;
            for k in 0..captures {
                let n = (k * shots + shot) * exposures + e;
                let frame = self.store.read_chunk(n).map_err(failed)?;
                stack.add(&frame).map_err(message)?;
            }
            Ok(stack)
        };
        let (dark, full) = (first("dark")?, first("full")?);
        Ok([
            (0..exposures).map(|e| stack(dark, e, 0.0)).collect::<Result<_, _>>()?,
            (0..exposures).map(|e| stack(full, e, 1.0)).collect::<Result<_, _>>()?,
        ])
    }
}
