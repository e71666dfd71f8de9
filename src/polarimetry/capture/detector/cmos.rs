//! A camera. The linear model of EMVA 1288 generates electrons, which are clipped, read out and digitized:
//!
//! > e = Poisson(η Φ t L) + Poisson(I_d t),  DN = round((min(e, e_full) + N(0, σ_r²))/K + b)
//!
//! The symbols are:
//! - quantum efficiency η, photons Φ per second and unit of radiance L, exposure t,
//! - dark current I_d, full well e_full, read noise σ_r,
//! - gain K in e⁻/DN, black level b.
//!
//! DN is clipped to the range 0 to 2^bits - 1. Without clipping,
//!
//! > E DN = (ηΦtL + I_d t)/K + b,  Var DN = (ηΦtL + I_d t + σ_r²)/K² + 1/12
//!
//! (EMVA Standard 1288, release 3.1, section 2, where K is in DN/e⁻). The quantization variance 1/12 is valid
//! if the remaining noise is at least half a DN. Noise that differs between pixels but not between frames
//! (PRNU, DSNU) is not modelled, because calibration removes such noise.

use super::super::spectral_value::SpectralValue;
use super::error::{DetectorError, area, count, demand, efficiency, finite, non_negative, positive};
use super::estimate::Estimate;
use super::random::{normal, poisson, stream};
use optics::sampling::stream::Stream;
use serde::{Deserialize, Serialize};

/// Number of read-out standard deviations. A pixel is saturated if its reading is less than this number of
/// standard deviations below the full well.
const CERTAIN: f64 = 4.0;

/// The settings of a camera. The defaults are close to the data sheets of cameras with Sony's IMX250 sensor.
/// These cameras have 12 bits, and a full well of 10.7 ke⁻ (from the maximum SNR of 40.3 dB).
/// `photons_per_unit` depends on scene and lens. The default of `photons_per_unit` is a placeholder.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Cmos {
    /// Exposure time in seconds.
    pub exposure_s: f64,
    /// Factors by which the exposure time is multiplied, one per exposure of a bracket.
    pub bracket: Vec<f64>,
    /// Electrons per photon.
    pub quantum_efficiency: SpectralValue,
    /// Photons per pixel, second and unit of the scene's radiance.
    pub photons_per_unit: f64,
    /// Standard deviation of the read noise in e⁻.
    pub read_noise_e: f64,
    /// Dark current in e⁻/s.
    pub dark_current_e_s: f64,
    /// Capacity of a pixel in electrons. Excess electrons are lost.
    pub full_well_e: f64,
    /// Number of bits of the digital output, 1 to 24.
    pub bit_depth: u32,
    /// Electrons per DN. By default, the gain is the full well divided by the output's range.
    pub gain_e_per_dn: Option<f64>,
    /// Output of a pixel without electrons, in DN. Choose a level of several times the read noise. With a
    /// lower level, dark readings are clipped at 0 and biased.
    pub black_level_dn: f64,
    /// Binning factor. The factor is 1 (no binning) or 2 (2×2 pixels are averaged after read-out).
    pub binning: u32,
    /// Whether the shot noise of photons and dark electrons is simulated.
    pub shot_noise: bool,
}

impl Default for Cmos {
    fn default() -> Self {
        Self {
            exposure_s: 0.01,
            bracket: vec![1.0],
            quantum_efficiency: SpectralValue::Same(0.65),
            photons_per_unit: 1e6,
            read_noise_e: 2.4,
            dark_current_e_s: 1.0,
            full_well_e: 10_700.0,
            bit_depth: 12,
            gain_e_per_dn: None,
            black_level_dn: 16.0,
            binning: 1,
            shot_noise: true,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    pub dn: u32,
    /// True if the digital number is at least [`Cmos::saturation_dn`].
    pub saturated: bool,
}

/// Estimates from one or more exposures of an image, with rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposed {
    /// Radiance in the scene's units, or NaN where saturated.
    pub radiance: Vec<f64>,
    /// Variance of the radiance, or infinity where saturated.
    pub variance: Vec<f64>,
    /// True where all exposures are saturated.
    pub saturated: Vec<bool>,
    pub width: usize,
    pub height: usize,
}

impl Cmos {
    /// Checks the settings of the camera.
    ///
    /// # Errors
    /// Returns [`DetectorError::Field`] if a setting is invalid. The error names the first invalid field.
    pub fn check(&self) -> Result<(), DetectorError> {
        let number = |field, value, need| demand(field, value, positive(value), need);
        number("exposure_s", self.exposure_s, "a positive time in seconds")?;
        demand("bracket", 0.0, !self.bracket.is_empty(), "at least one exposure factor")?;
        self.bracket.iter().try_for_each(|f| number("bracket", *f, "positive exposure factors"))?;
        efficiency("quantum_efficiency", &self.quantum_efficiency)?;
        number("photons_per_unit", self.photons_per_unit, "a positive number of photons")?;
        let (read, dark) = (self.read_noise_e, self.dark_current_e_s);
        demand("read_noise_e", read, non_negative(read), "zero or more electrons")?;
        demand("dark_current_e_s", dark, non_negative(dark), "zero or more electrons per second")?;
        let holds = positive(self.full_well_e) && self.full_well_e > 2.0 * CERTAIN * read;
        demand("full_well_e", self.full_well_e, holds, "a number greater than 8 times `read_noise_e`")?;
        let bits = (1..=24).contains(&self.bit_depth);
        demand("bit_depth", f64::from(self.bit_depth), bits, "1 to 24 bits")?;
        number("gain_e_per_dn", self.gain(), "a positive number of electrons")?;
        let black = self.black_level_dn;
        let holds = non_negative(black) && black < self.top();
        demand("black_level_dn", black, holds, "zero or more, and below the maximum of `bit_depth` bits")?;
        let holds = matches!(self.binning, 1 | 2);
        demand("binning", f64::from(self.binning), holds, "1 or 2")
    }

    /// Returns the largest digital output value in DN.
    fn top(&self) -> f64 {
        ((1_u64 << self.bit_depth.min(32)) - 1) as f64
    }

    /// Returns the gain in e⁻/DN.
    fn gain(&self) -> f64 {
        self.gain_e_per_dn.unwrap_or(self.full_well_e / self.top())
    }

    /// Returns two expected values for an exposure. The first is the number of electrons per unit of
    /// radiance, and the second is the number of dark electrons.
    fn electrons(&self, nm: f64, factor: f64) -> (f64, f64) {
        let t = self.exposure_s * factor;
        let per_unit = self.quantum_efficiency.at(nm) * self.photons_per_unit * t;
        (per_unit, self.dark_current_e_s * t)
    }

    /// Returns the variance of read noise and quantization, in electrons squared.
    fn read_out(&self) -> f64 {
        self.read_noise_e.powi(2) + self.gain().powi(2) / 12.0
    }

    /// Returns the shot-noise variance of `mean` electrons.
    fn shot(&self, mean: f64) -> f64 {
        if self.shot_noise { mean } else { 0.0 }
    }

    /// Returns the smallest DN of a saturated reading. This DN is the reading of a full well minus
    /// `CERTAIN` standard deviations of the read-out noise, or the maximum of the output if the maximum is
    /// smaller.
    ///
    /// A threshold at the full well itself would keep readings with negative noise and discard readings with
    /// positive noise. The mean estimate of the kept readings would be too low by a fraction of a standard
    /// deviation.
    pub fn saturation_dn(&self) -> u32 {
        let noise = self.read_out().sqrt();
        let full = (self.full_well_e - CERTAIN * noise) / self.gain() + self.black_level_dn;
        full.min(self.top()) as u32
    }

    /// Returns a random reading of one pixel.
    ///
    /// `radiance` is in the scene's units, and negative or NaN values are treated as dark. `nm` is the vacuum
    /// wavelength, and `factor` is an entry of `bracket`. Photoelectrons and dark electrons are drawn as one
    /// random number, because the sum of Poisson variables is a Poisson variable.
    pub fn sample(&self, radiance: f64, nm: f64, factor: f64, stream: &mut Stream) -> Reading {
        let (per_unit, dark) = self.electrons(nm, factor);
        let mean = (per_unit * radiance).max(0.0) + dark;
        let made = if self.shot_noise { poisson(mean, stream) } else { mean };
        let read = made.min(self.full_well_e) + self.read_noise_e * normal(stream);
        let dn = (read / self.gain() + self.black_level_dn).round();
        let dn = dn.clamp(0.0, self.top()) as u32;
        Reading { dn, saturated: dn >= self.saturation_dn() }
    }

    /// Returns the mean and variance of one pixel's DN without clipping. The arguments are those of
    /// [`Self::sample`].
    pub fn expected(&self, radiance: f64, nm: f64, factor: f64) -> (f64, f64) {
        let (per_unit, dark) = self.electrons(nm, factor);
        let mean = (per_unit * radiance).max(0.0) + dark;
        let variance = (self.shot(mean) + self.read_out()) / self.gain().powi(2);
        (mean / self.gain() + self.black_level_dn, variance)
    }

    /// Returns the radiance estimate of a reading, with black level and dark current subtracted.
    ///
    /// The shot noise in the variance is estimated from the reading. The lower bound of the shot-noise
    /// variance is the shot noise of the dark current. Because of this bound, the variance of dark pixels is
    /// slightly too high.
    pub fn estimate(&self, dn: u32, nm: f64, factor: f64) -> Estimate {
        let (per_unit, dark) = self.electrons(nm, factor);
        if dn >= self.saturation_dn() {
            return Estimate::SATURATED;
        }
        if !positive(per_unit) {
            return Estimate::UNKNOWN;
        }
        let made = (f64::from(dn) - self.black_level_dn) * self.gain();
        Estimate {
            radiance: (made - dark) / per_unit,
            variance: (self.shot(made.max(dark)) + self.read_out()) / per_unit.powi(2),
            saturated: false,
        }
    }

    /// Combines the estimates of all exposures, in the order of `bracket`. Each estimate may be the mean of
    /// `binning`² pixels.
    ///
    /// Weights are inverse variances. The variances of the single estimates would bias the mean, because a
    /// low reading has a low variance and therefore a high weight. Instead, all variances are predicted from
    /// the pooled radiance. The pooled radiance is the sum of the electrons of all exposures, divided by the
    /// sum of the electrons per unit of radiance. The weights depend little on the pooled radiance. Where
    /// shot noise dominates, the weights do not depend on the pooled radiance.
    pub fn combine(&self, estimates: &[Estimate], nm: f64) -> Estimate {
        let exposures = || {
            let pairs = estimates.iter().zip(&self.bracket);
            let known = pairs.filter(|(e, _)| !e.saturated && e.radiance.is_finite());
            known.map(|(e, factor)| (e.radiance, self.electrons(nm, *factor)))
        };
        let (made, per_unit) =
            exposures().fold((0.0, 0.0), |(a, b), (x, (per_unit, _))| (a + x * per_unit, b + per_unit));
        if !positive(per_unit) {
            let saturated = estimates.iter().any(|e| e.saturated);
            return if saturated { Estimate::SATURATED } else { Estimate::UNKNOWN };
        }
        let pooled = (made / per_unit).max(0.0);
        let (mut sum, mut weights) = (0.0, 0.0);
        for (radiance, (per_unit, dark)) in exposures() {
            let variance = self.shot(per_unit * pooled + dark) + self.read_out();
            let weight = per_unit.powi(2) / variance;
            sum += weight * radiance;
            weights += weight;
        }
        Estimate {
            radiance: sum / weights,
            variance: 1.0 / (weights * f64::from(self.binning).powi(2)),
            saturated: false,
        }
    }

    /// Returns one frame, which contains the digital numbers of one exposure of an image. `key` is the index
    /// of the frame under `seed`. `pixels` maps each value to a pixel of the sensor. The values of a region
    /// therefore equal the values of the same pixels in a frame of the full sensor.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::check`], and [`DetectorError::Radiance`] if `image` contains
    /// non-finite values.
    pub fn frame(
        &self,
        image: &[f64],
        pixels: impl Iterator<Item = u32>,
        nm: f64,
        factor: f64,
        seed: u64,
        key: u32,
    ) -> Result<Vec<u32>, DetectorError> {
        self.check()?;
        finite(image)?;
        let one = |(radiance, pixel): (&f64, u32)| {
            let mut stream = stream(seed, pixel, key);
            self.sample(*radiance, nm, factor, &mut stream).dn
        };
        Ok(image.iter().zip(pixels).map(one).collect())
    }

    /// Simulates all exposures of an image, and combines the exposures into one estimate.
    ///
    /// `image` holds `height` rows of `width` radiance values, from the top. `key` is the index of the
    /// capture under `seed`. The first exposure of the capture is the frame with index `key` × (number of
    /// exposures). With `binning` 2, the result has half the width and height. An odd last row or column is
    /// dropped.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::check`]. Returns [`DetectorError::Count`] if `image` has another
    /// size (or more than 2³² values). Returns [`DetectorError::Radiance`] if `image` contains non-finite
    /// values.
    pub fn capture(
        &self,
        image: &[f64],
        width: usize,
        height: usize,
        nm: f64,
        seed: u64,
        key: u32,
    ) -> Result<Exposed, DetectorError> {
        self.check()?;
        area("an image", width, height, image.len())?;
        count("the pixels of one capture", image.len().min(u32::MAX as usize), image.len())?;
        finite(image)?;
        let exposures = u32::try_from(self.bracket.len()).unwrap_or(u32::MAX);
        let mut frames = vec![];
        for (i, factor) in self.bracket.iter().enumerate() {
            let key = key.wrapping_mul(exposures).wrapping_add(i as u32);
            frames.push(self.frame(image, 0..image.len() as u32, nm, *factor, seed, key)?);
        }
        let side = self.binning as usize;
        let mut out = Exposed {
            radiance: Vec::new(),
            variance: Vec::new(),
            saturated: Vec::new(),
            width: width / side,
            height: height / side,
        };
        for y in 0..out.height {
            for x in 0..out.width {
                let block = (0..side * side).map(|k| (y * side + k / side) * width + x * side + k % side);
                let exposures =
                    self.bracket.iter().zip(&frames).map(|(factor, frame)| {
                        mean(block.clone().map(|i| self.estimate(frame[i], nm, *factor)))
                    });
                let estimate = self.combine(&exposures.collect::<Vec<_>>(), nm);
                out.radiance.push(estimate.radiance);
                out.variance.push(estimate.variance);
                out.saturated.push(estimate.saturated);
            }
        }
        Ok(out)
    }
}

/// Returns the mean of independent estimates. The mean is saturated if any estimate is saturated.
fn mean(estimates: impl Iterator<Item = Estimate>) -> Estimate {
    let (mut n, mut sum, mut variance, mut saturated) = (0.0, 0.0, 0.0, false);
    for e in estimates {
        n += 1.0;
        sum += e.radiance;
        variance += e.variance;
        saturated |= e.saturated;
    }
    Estimate { radiance: sum / n, variance: variance / (n * n), saturated }
}

#[cfg(test)]
mod tests;
