//! A camera: electrons by EMVA 1288's linear model, clipped, read and digitized.
//!
//! > e = Poisson(η Φ t L) + Poisson(I_d t),  DN = round((min(e, e_full) + N(0, σ_r²))/K + b)
//!
//! with quantum efficiency η, photons Φ per second and unit of radiance L, exposure t, dark current I_d, full well
//! e_full, read noise σ_r, gain K in e⁻/DN and black level b; DN is clipped to 0 to 2^bits - 1. Unclipped,
//!
//! > E DN = (ηΦtL + I_d t)/K + b,  Var DN = (ηΦtL + I_d t + σ_r²)/K² + 1/12
//!
//! (EMVA Standard 1288, release 3.1, section 2; there K is in DN/e⁻). The 1/12 of quantization needs noise of half a
//! DN or more besides. Sources of noise that differ from pixel to pixel but not from frame to frame (PRNU, DSNU) are
//! left out: calibration removes them.

use super::super::spectral_value::SpectralValue;
use super::error::{DetectorError, area, count, demand, efficiency, finite, non_negative, positive};
use super::estimate::Estimate;
use super::random::{normal, poisson, stream};
use optics::sampling::stream::Stream;
use serde::{Deserialize, Serialize};

/// A full well shows as a reading that is at most so many standard deviations of the read-out below it.
const CERTAIN: f64 = 4.0;

/// A camera's settings. The defaults are near data sheets of cameras with Sony's IMX250 (12 bits, maximal SNR 40.3 dB:
/// 10.7 ke⁻); `photons_per_unit` depends on the scene and the lens and is only a placeholder.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Cmos {
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Factors of the exposure time, one for each exposure that is taken.
    pub bracket: Vec<f64>,
    /// Electrons per photon.
    pub quantum_efficiency: SpectralValue,
    /// Photons that reach one pixel per second and unit of the scene's radiance.
    pub photons_per_unit: f64,
    /// Standard deviation of the read noise, e⁻.
    pub read_noise_e: f64,
    /// Dark current, e⁻/s.
    pub dark_current_e_s: f64,
    /// Electrons that a pixel holds; more are lost.
    pub full_well_e: f64,
    /// Bits of the digital output, 1 to 24.
    pub bit_depth: u32,
    /// Electrons per DN; without it, the full well over the output's range.
    pub gain_e_per_dn: Option<f64>,
    /// Output without electrons, DN; some times the read noise, or dark readings are clipped at 0 and biased.
    pub black_level_dn: f64,
    /// 1, or 2 to average 2×2 pixels after read-out.
    pub binning: u32,
    /// False to leave the photons' and the dark electrons' noise out.
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

/// The output of one pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// Digital number.
    pub dn: u32,
    /// True from [`Cmos::saturation_dn`] on.
    pub saturated: bool,
}

/// Estimates from one or more exposures of an image, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposed {
    /// Radiance in the scene's unit; NaN where saturated.
    pub radiance: Vec<f64>,
    /// Its variance; infinite where saturated.
    pub variance: Vec<f64>,
    /// True where all exposures are saturated.
    pub saturated: Vec<bool>,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Cmos {
    /// Checks the settings.
    ///
    /// # Errors
    /// [`DetectorError::Field`] with the name of the first bad field.
    pub fn check(&self) -> Result<(), DetectorError> {
        let number = |field, value, need| demand(field, value, positive(value), need);
        number("exposure_s", self.exposure_s, "a positive time in seconds")?;
        demand(
            "bracket",
            0.0,
            !self.bracket.is_empty(),
            "at least one exposure factor",
        )?;
        self.bracket
            .iter()
            .try_for_each(|f| number("bracket", *f, "positive exposure factors"))?;
        efficiency("quantum_efficiency", &self.quantum_efficiency)?;
        number(
            "photons_per_unit",
            self.photons_per_unit,
            "a positive number of photons",
        )?;
        let (read, dark) = (self.read_noise_e, self.dark_current_e_s);
        demand("read_noise_e", read, non_negative(read), "zero or more electrons")?;
        demand(
            "dark_current_e_s",
            dark,
            non_negative(dark),
            "zero or more electrons per second",
        )?;
        let holds = positive(self.full_well_e) && self.full_well_e > 2.0 * CERTAIN * read;
        demand(
            "full_well_e",
            self.full_well_e,
            holds,
            "more than 8 times `read_noise_e`",
        )?;
        let bits = (1..=24).contains(&self.bit_depth);
        demand("bit_depth", f64::from(self.bit_depth), bits, "1 to 24 bits")?;
        number("gain_e_per_dn", self.gain(), "a positive number of electrons")?;
        let black = self.black_level_dn;
        let holds = non_negative(black) && black < self.top();
        demand(
            "black_level_dn",
            black,
            holds,
            "zero or more, below the output's maximum",
        )?;
        let holds = matches!(self.binning, 1 | 2);
        demand("binning", f64::from(self.binning), holds, "1 or 2")
    }

    /// The greatest output, DN.
    fn top(&self) -> f64 {
        ((1_u64 << self.bit_depth.min(32)) - 1) as f64
    }

    /// e⁻/DN.
    fn gain(&self) -> f64 {
        self.gain_e_per_dn.unwrap_or(self.full_well_e / self.top())
    }

    /// Electrons per unit of radiance, and dark electrons, of an exposure.
    fn electrons(&self, nm: f64, factor: f64) -> (f64, f64) {
        let t = self.exposure_s * factor;
        let per_unit = self.quantum_efficiency.at(nm) * self.photons_per_unit * t;
        (per_unit, self.dark_current_e_s * t)
    }

    /// Variance of the electrons that the read-out adds: read noise and quantization.
    fn read_out(&self) -> f64 {
        self.read_noise_e.powi(2) + self.gain().powi(2) / 12.0
    }

    /// Variance of `mean` electrons.
    fn shot(&self, mean: f64) -> f64 {
        if self.shot_noise { mean } else { 0.0 }
    }

    /// The least DN that counts as saturated: the output's maximum, or where a full well may be read.
    ///
    /// Within some standard deviations below it, unsaturated readings are those with little noise, and the mean of
    /// their estimates is low by a part of one.
    #[must_use]
    pub fn saturation_dn(&self) -> u32 {
        let noise = self.read_out().sqrt();
        let full = (self.full_well_e - CERTAIN * noise) / self.gain() + self.black_level_dn;
        full.min(self.top()) as u32
    }

    /// The reading of one pixel.
    ///
    /// `radiance` in the scene's unit (dark if negative or not a number), `nm` the vacuum wavelength, `factor` that of
    /// `bracket`. Draws the two kinds of electrons together: the sum of Poisson numbers is one.
    #[must_use]
    pub fn sample(&self, radiance: f64, nm: f64, factor: f64, stream: &mut Stream) -> Reading {
        let (per_unit, dark) = self.electrons(nm, factor);
        let mean = (per_unit * radiance).max(0.0) + dark;
        let made = if self.shot_noise {
            poisson(mean, stream)
        } else {
            mean
        };
        let read = made.min(self.full_well_e) + self.read_noise_e * normal(stream);
        let dn = (read / self.gain() + self.black_level_dn).round();
        let dn = dn.clamp(0.0, self.top()) as u32;
        Reading {
            dn,
            saturated: dn >= self.saturation_dn(),
        }
    }

    /// Mean and variance of the DN of one pixel, were it not clipped; arguments as for [`Self::sample`].
    #[must_use]
    pub fn expected(&self, radiance: f64, nm: f64, factor: f64) -> (f64, f64) {
        let (per_unit, dark) = self.electrons(nm, factor);
        let mean = (per_unit * radiance).max(0.0) + dark;
        let variance = (self.shot(mean) + self.read_out()) / self.gain().powi(2);
        (mean / self.gain() + self.black_level_dn, variance)
    }

    /// The radiance that a reading tells of, its black level and dark current subtracted.
    ///
    /// The variance takes the shot noise from the reading itself, at least that of the dark current; this floor makes it a
    /// little high in the dark.
    #[must_use]
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

    /// One estimate from those of all exposures, in the order of `bracket`; each may be the mean of `binning`² pixels.
    ///
    /// Weights are inverse variances. Those of the single estimates would not do: a low reading has a low variance and
    /// so a high weight, which biases the mean. Instead all variances are predicted from the pooled radiance (electrons
    /// over electrons per unit), on which the weights depend little, and where shot noise reigns not at all.
    #[must_use]
    pub fn combine(&self, estimates: &[Estimate], nm: f64) -> Estimate {
        let exposures = || {
            let pairs = estimates.iter().zip(&self.bracket);
            let known = pairs.filter(|(e, _)| !e.saturated && e.radiance.is_finite());
            known.map(|(e, factor)| (e.radiance, self.electrons(nm, *factor)))
        };
        let (made, per_unit) = exposures().fold((0.0, 0.0), |(a, b), (x, (per_unit, _))| {
            (a + x * per_unit, b + per_unit)
        });
        if !positive(per_unit) {
            let saturated = estimates.iter().any(|e| e.saturated);
            return if saturated {
                Estimate::SATURATED
            } else {
                Estimate::UNKNOWN
            };
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

    /// One frame: the digital numbers of one exposure of an image. `key` is the number of the frame under `seed`, and
    /// `pixels` says which of the sensor's pixels each value falls on, so that a part of the sensor reads what the whole
    /// would.
    ///
    /// # Errors
    /// Those of [`Self::check`]; [`DetectorError::Radiance`] if `image` holds values that are not finite.
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

    /// Takes all exposures of an image and estimates it from them.
    ///
    /// `image` holds `height` rows of `width` values of radiance, from the top; `key` is the number of the capture under
    /// `seed`, whose exposures are frames `key` × exposures and those that follow. With `binning` 2 the result has half the width and height, an odd last row or column being dropped.
    ///
    /// # Errors
    /// Those of [`Self::check`]; [`DetectorError::Count`] if `image` has another size (or more than 2³² values),
    /// [`DetectorError::Radiance`] if it holds values that are not finite.
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
        count(
            "the pixels of one capture",
            image.len().min(u32::MAX as usize),
            image.len(),
        )?;
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

/// The mean of independent estimates; saturated if one of them is.
fn mean(estimates: impl Iterator<Item = Estimate>) -> Estimate {
    let (mut n, mut sum, mut variance, mut saturated) = (0.0, 0.0, 0.0, false);
    for e in estimates {
        n += 1.0;
        sum += e.radiance;
        variance += e.variance;
        saturated |= e.saturated;
    }
    Estimate {
        radiance: sum / n,
        variance: variance / (n * n),
        saturated,
    }
}

#[cfg(test)]
mod tests;
