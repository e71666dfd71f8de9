//! How a pair of galvo mirrors hangs at a card: volts for degrees, and the way from one place to another.
//!
//! A mirror that turns by θ turns the beam by 2θ. Makers state volts per degree of the mirror (0.5, 0.8 or 1 for Thorlabs'
//! GVS0xx); everything else here counts the beam's optical degrees, as [`crate::instrument::GalvoScanner`] does.

use crate::instrument::{AnalogLimits, AnalogSettings, GalvoLimits};
use std::time::Duration;

/// How the beam gets from one place to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Travel {
    /// At once: one sample.
    Stepped,
    /// Along an S that begins and ends without speed and acceleration; the greatest speed of the beam, degrees a second.
    Smooth(f64),
}

/// A pair of mirrors and the channels that they hang at, x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wiring {
    /// Channels of the card.
    pub channels: [usize; 2],
    /// Volts per degree of a mirror's own turn; negative where it is mounted the other way round.
    pub volts_per_degree: [f64; 2],
    /// Greatest optical angle, degrees.
    pub range_deg: [f64; 2],
    /// Samples a second.
    pub rate_hz: f64,
    /// How the beam gets from place to place.
    pub travel: Travel,
    /// Time until the mirrors stand after the last sample.
    pub settle: Duration,
}

/// Greatest slope of [`curve`].
const STEEPEST: f64 = 1.875;

/// An S from 0 to 1 whose speed and acceleration are zero at both ends: 10 u³ - 15 u⁴ + 6 u⁵.
fn curve(u: f64) -> f64 {
    u * u * u * (10.0 + u * (6.0 * u - 15.0))
}

impl Wiring {
    /// Volts for optical degrees.
    #[must_use]
    pub fn volts(&self, angles_deg: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|i| angles_deg[i] / 2.0 * self.volts_per_degree[i])
    }

    /// Optical degrees for volts.
    #[must_use]
    pub fn angles(&self, volts: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|i| volts[i] / self.volts_per_degree[i] * 2.0)
    }

    /// What the card is set to.
    #[must_use]
    pub fn settings(&self) -> AnalogSettings {
        AnalogSettings {
            channels: self.channels.to_vec(),
            rate_hz: self.rate_hz,
        }
    }

    /// What mirrors and card together can do.
    #[must_use]
    pub fn limits(&self, card: &AnalogLimits) -> GalvoLimits {
        let steps = self.volts_per_degree.map(|v| 2.0 * card.step() / v.abs());
        GalvoLimits {
            range_deg: self.range_deg,
            resolution_deg: steps[0].max(steps[1]),
            settle: self.settle,
        }
    }

    /// Samples of a move between two places given in volts; at least one.
    fn samples(&self, from: [f64; 2], to: [f64; 2]) -> usize {
        let Travel::Smooth(speed) = self.travel else {
            return 1;
        };
        let (from, to) = (self.angles(from), self.angles(to));
        let far = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
        ((STEEPEST * far / speed * self.rate_hz).ceil() as usize).max(1)
    }

    /// The longest move takes as long.
    #[must_use]
    pub fn longest(&self) -> Duration {
        let corner = self.volts(self.range_deg);
        Duration::from_secs_f64(self.samples(corner.map(|v| -v), corner) as f64 / self.rate_hz)
    }

    /// The way between two places given in volts, as the card takes it: both axes set out and arrive together. The last
    /// sample is the goal.
    #[must_use]
    pub fn way(&self, from: [f64; 2], to: [f64; 2]) -> Vec<Vec<f64>> {
        let n = self.samples(from, to);
        let axis = |i: usize| {
            let at = |k: usize| {
                if k == n {
                    to[i]
                } else {
                    from[i] + (to[i] - from[i]) * curve(k as f64 / n as f64)
                }
            };
            (1..=n).map(at).collect()
        };
        vec![axis(0), axis(1)]
    }

    /// Whether a card can drive these mirrors over all of their range.
    ///
    /// # Errors
    /// What it cannot and how to fix it, in words.
    pub fn check(&self, card: &AnalogLimits) -> Result<(), String> {
        if !self
            .volts_per_degree
            .iter()
            .all(|v| (1e-3..=1e3).contains(&v.abs()))
        {
            return Err(format!(
                "{:?} V per degree drive no mirrors; give what their maker states, as 0.8",
                self.volts_per_degree
            ));
        }
        if let Travel::Smooth(speed) = self.travel
            && !(speed > 0.0 && speed.is_finite())
        {
            return Err(format!(
                "{speed} degrees a second is no speed of a beam; give a positive number, or none for steps"
            ));
        }
        card.check(&self.settings())?;
        let corner = self.volts(self.range_deg);
        let [least, most] = card.volts;
        for volts in corner.iter().flat_map(|v| [*v, -v]) {
            if !(volts >= least && volts <= most) {
                return Err(format!(
                    "±{:?}° of the beam are {volts} V, and the card gives {least} to {most} V; lessen the range",
                    self.range_deg
                ));
            }
        }
        let samples = self.samples(corner.map(|v| -v), corner);
        if samples > card.samples {
            return Err(format!(
                "the longest move has {samples} samples, and the card holds {}; lower the rate of samples, or raise the speed",
                card.samples
            ));
        }
        Ok(())
    }
}
