//! Wiring of galvo mirrors to a card. Converts degrees to volts, and computes paths of the beam between
//! positions.
//!
//! A mirror that rotates by θ deflects the beam by 2θ. Manufacturers specify volts per mechanical degree
//! of the mirror (0.5, 0.8 or 1 for Thorlabs' GVS0xx). All other angles are optical degrees of the beam,
//! as in [`crate::instrument::GalvoScanner`].

use crate::instrument::{AnalogLimits, AnalogSettings, GalvoLimits};
use std::time::Duration;

/// Motion of the beam between two positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Travel {
    /// The beam moves in a single step of one sample.
    Stepped,
    /// The beam moves along an S-curve with zero speed and acceleration at its ends. The number is the
    /// maximum speed of the beam, in degrees per second.
    Smooth(f64),
}

/// A pair of mirrors (x and y) and their channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wiring {
    /// Channels of the card.
    pub channels: [usize; 2],
    /// Volts per mechanical degree of the mirror. The value is negative if the mirror is mounted in reverse.
    pub volts_per_degree: [f64; 2],
    /// Maximum absolute optical angle, in degrees.
    pub range_deg: [f64; 2],
    /// Samples per second.
    pub rate_hz: f64,
    /// Motion of the beam between two positions.
    pub travel: Travel,
    /// Settling time of the mirrors after the last sample.
    pub settle: Duration,
}

/// Maximum slope of [`curve`].
const STEEPEST: f64 = 1.875;

/// Returns the S-curve 10 u³ - 15 u⁴ + 6 u⁵ from 0 to 1, which has zero speed and acceleration at both ends.
fn curve(u: f64) -> f64 {
    u * u * u * (10.0 + u * (6.0 * u - 15.0))
}

impl Wiring {
    /// Converts optical degrees to volts.
    pub fn volts(&self, angles_deg: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|i| angles_deg[i] / 2.0 * self.volts_per_degree[i])
    }

    /// Converts volts to optical degrees.
    pub fn angles(&self, volts: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|i| volts[i] / self.volts_per_degree[i] * 2.0)
    }

    pub fn settings(&self) -> AnalogSettings {
        AnalogSettings { channels: self.channels.to_vec(), rate_hz: self.rate_hz }
    }

    pub fn limits(&self, card: &AnalogLimits) -> GalvoLimits {
        let steps = self.volts_per_degree.map(|v| 2.0 * card.step() / v.abs());
        GalvoLimits { range_deg: self.range_deg, resolution_deg: steps[0].max(steps[1]), settle: self.settle }
    }

    /// Returns the number of samples of a move between two voltages. The number is at least 1.
    fn samples(&self, from: [f64; 2], to: [f64; 2]) -> usize {
        let Travel::Smooth(speed) = self.travel else {
            return 1;
        };
        let (from, to) = (self.angles(from), self.angles(to));
        let far = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
        ((STEEPEST * far / speed * self.rate_hz).ceil() as usize).max(1)
    }

    pub fn longest(&self) -> Duration {
        let corner = self.volts(self.range_deg);
        Duration::from_secs_f64(self.samples(corner.map(|v| -v), corner) as f64 / self.rate_hz)
    }

    /// Returns the samples of a path, one list per channel. Both axes start and arrive together. The last
    /// sample is `to`.
    pub fn way(&self, from: [f64; 2], to: [f64; 2]) -> Vec<Vec<f64>> {
        let n = self.samples(from, to);
        let axis = |i: usize| {
            let at = |k: usize| {
                if k == n { to[i] } else { from[i] + (to[i] - from[i]) * curve(k as f64 / n as f64) }
            };
            (1..=n).map(at).collect()
        };
        vec![axis(0), axis(1)]
    }

    /// Checks that a card can drive the mirrors over their full range.
    ///
    /// # Errors
    /// Returns a message that states the cause and the fix, if the card cannot drive the mirrors.
    pub fn check(&self, card: &AnalogLimits) -> Result<(), String> {
        if !self.volts_per_degree.iter().all(|v| (1e-3..=1e3).contains(&v.abs())) {
            return Err(format!(
                "invalid volts_per_degree {:?}; expected magnitudes of 0.001 to 1000 V per degree, such as 0.8",
                self.volts_per_degree
            ));
        }
        if let Travel::Smooth(speed) = self.travel
            && !(speed > 0.0 && speed.is_finite())
        {
            return Err(format!(
                "invalid speed {speed}; expected a positive number of degrees per second; for stepped moves, remove the speed"
            ));
        }
        card.check(&self.settings())?;
        let corner = self.volts(self.range_deg);
        let [least, most] = card.volts;
        for volts in corner.iter().flat_map(|v| [*v, -v]) {
            if !(volts >= least && volts <= most) {
                return Err(format!(
                    "an angle of ±{:?}° needs {volts} V, but the card outputs only {least} to {most} V; reduce the range of angles",
                    self.range_deg
                ));
            }
        }
        let samples = self.samples(corner.map(|v| -v), corner);
        if samples > card.samples {
            return Err(format!(
                "the longest move has {samples} samples, but the card holds only {} samples; reduce the sample rate, or increase the \
                 speed",
                card.samples
            ));
        }
        Ok(())
    }
}
