//! Computes the exposure automatically from a photograph.
//!
//! The photograph contains T00 by pixel and wavelength. It is taken from the brightest slice that has
//! complete matrices and no time bins. For a variant without such a slice, T00 of the brightest slice with
//! complete matrices and time bins is summed over the bins.
//!
//! The metered value is the mean or a percentile of the photograph. With the computed exposure, a pixel with
//! the metered value yields the requested number of electrons, averaged over captures. All slices of the
//! variant are captured with this exposure. A photon counter counts until a pixel with the metered value has
//! the requested number of counts, summed over all bins.

use super::error::ChainError;
use super::light::Light;
use super::optics::Optics;
use polarimetry::capture::design_matrix::DesignMatrix;
use polarimetry::capture::detector::cmos::Cmos;
use polarimetry::capture::detector::error::DetectorError;
use polarimetry::capture::detector::file::with_bins;
use polarimetry::capture::detector::spad::Spad;
use polarimetry::capture::scheme::Scheme;
use polarimetry::capture::simulate::Noise;
use serde::Deserialize;

/// The metered value of a photograph.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Meter {
    Mean,
    /// A percentile, 0 to 100.
    Percentile(f64),
}

/// The target values of the exposure.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Exposure {
    pub meter: Meter,
    /// Number of electrons of a camera reading at the metered value.
    pub electrons: f64,
    /// Number of counts of a photon counter at the metered value, summed over bins.
    pub counts: f64,
    /// Counts per laser pulse. A value far below 1 avoids pile-up.
    pub counts_per_pulse: f64,
}

impl Default for Exposure {
    fn default() -> Self {
        Self { meter: Meter::Percentile(95.0), electrons: 3000.0, counts: 3000.0, counts_per_pulse: 0.02 }
    }
}

/// A laboratory: true optical elements, detectors and an exposure. Without a detector, readings have no
/// noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Laboratory {
    pub optics: Optics,
    /// The camera. The exposure sets the camera's `photons_per_unit`.
    pub camera: Option<Cmos>,
    /// The photon counter for slices with time bins. The exposure sets the counter's `photons_per_unit` and
    /// `pulses`.
    pub counter: Option<Spad>,
    pub exposure: Exposure,
}

/// Detectors at an exposure.
#[derive(Clone, Debug, PartialEq)]
pub struct Detectors {
    camera: Option<Cmos>,
    counter: Option<Spad>,
    /// The metered T00, and the mean reading divided by this T00.
    level: [f64; 2],
    exposure: Exposure,
}

impl Exposure {
    /// Checks the values of the exposure.
    ///
    /// # Errors
    /// Returns an error that names the first invalid value.
    pub fn check(&self) -> Result<(), ChainError> {
        let demand = |field, value: f64, holds, need| {
            let bad = DetectorError::Field { field, value, need };
            if holds { Ok(()) } else { Err(bad) }
        };
        let number = |field, value: f64, need| demand(field, value, positive(value), need);
        number("electrons", self.electrons, "a positive number")?;
        number("counts", self.counts, "a positive number")?;
        let rate = self.counts_per_pulse;
        demand("counts_per_pulse", rate, positive(rate) && rate <= 0.5, "above 0, at most 0.5")?;
        if let Meter::Percentile(p) = self.meter {
            demand("percentile", p, (0.0..=100.0).contains(&p), "0 to 100")?;
        }
        Ok(())
    }

    /// Returns the metered T00.
    fn level(&self, light: &Light) -> f64 {
        let mut known = photograph(light);
        match self.meter {
            Meter::Mean => known.iter().sum::<f64>() / known.len() as f64,
            Meter::Percentile(p) => {
                known.sort_by(f64::total_cmp);
                let last = known.len().saturating_sub(1);
                let at = (p / 100.0 * last as f64).round() as usize;
                known.get(at).copied().unwrap_or(f64::NAN)
            }
        }
    }
}

/// Returns the finite values of T00 per pixel and wavelength, summed over time bins.
fn photograph(light: &Light) -> Vec<f64> {
    let image = &light.image;
    let bins = image.bin_ps.map_or(1, |_| image.layout.times.max(1));
    let lanes = image.layout.lanes.max(1);
    let t00: Vec<f64> = image.matrices.iter().step_by(16).copied().collect();
    let pixels = t00.chunks_exact(bins * lanes);
    let all = pixels
        .flat_map(|pixel| (0..lanes).map(move |lane| pixel.iter().skip(lane).step_by(lanes).sum::<f64>()));
    all.filter(|v| v.is_finite()).collect()
}

/// Returns the mean of the photograph.
fn brightness(light: &Light) -> f64 {
    let all = photograph(light);
    all.iter().sum::<f64>() / all.len() as f64
}

/// Returns whether a number is positive and so small that products of such numbers are finite.
fn positive(v: f64) -> bool {
    v > 0.0 && v <= 1e20
}

/// Returns the mean reading of a scheme's captures in unpolarized light, relative to T00.
pub fn mean_reading(scheme: &Scheme) -> f64 {
    let design = DesignMatrix::new(scheme, &polarimetry::capture::element::Ray::axial(550.0));
    design.a.column(0).mean()
}

impl Laboratory {
    /// Returns the detectors at the exposure for the photograph of `lights`. The photograph is
    /// captured through `scheme`.
    ///
    /// # Errors
    /// [`ChainError::Dark`] if there is no photograph, and [`ChainError::Detector`] for invalid settings.
    pub fn exposed(&self, lights: &[&Light], scheme: &Scheme) -> Result<Detectors, ChainError> {
        self.exposure.check()?;
        let brightest = |timed: bool| {
            let fit = lights.iter().filter(|l| l.polarized && l.image.bin_ps.is_some() == timed);
            fit.max_by(|a, b| brightness(a).total_cmp(&brightness(b)))
        };
        let photograph = brightest(false).or_else(|| brightest(true));
        let level = photograph.map_or(f64::NAN, |l| self.exposure.level(l));
        let noisy = self.camera.is_some() || self.counter.is_some();
        if noisy && !positive(level) {
            return Err(ChainError::Dark("set the exposure by the mean, or by a higher percentile".into()));
        }
        let level = [level, mean_reading(scheme)];
        let camera = self.camera.clone().map(|mut c| {
            let per = c.quantum_efficiency.at(550.0) * c.exposure_s;
            c.photons_per_unit = self.exposure.electrons / (per * level[0] * level[1]).max(1e-300);
            c
        });
        Ok(Detectors { camera, counter: self.counter.clone(), level, exposure: self.exposure })
    }
}

impl Detectors {
    /// Returns the noise model for `light`. The model is the counter's model if there are time bins,
    /// otherwise the camera's model. For a slice of intensities, the model includes the same loss of light as
    /// in the optical elements.
    ///
    /// # Errors
    /// [`ChainError::Detector`] if the counter's settings do not match the bins.
    pub fn noise(&self, light: &Light) -> Result<Noise, ChainError> {
        let [t00, reading] = self.level;
        let through = if light.polarized { 1.0 } else { reading };
        match (light.image.bin_ps, &self.camera, &self.counter) {
            (Some(bin_ps), _, Some(counter)) => {
                let mut diode = with_bins(counter, light.image.layout.times, bin_ps)?;
                let per = diode.detection_efficiency.at(550.0).max(1e-300);
                diode.photons_per_unit = self.exposure.counts_per_pulse / (per * t00 * reading) * through;
                if counter.period_ps == Spad::default().period_ps {
                    // The period covers the bins and the response to light in the last bin. A longer period
                    // would add nothing but zeros.
                    let late = 3.0 * diode.irf_fwhm_ps + 10.0 * diode.irf_tail_ps * diode.irf_tail;
                    let bins = light.image.layout.times as f64 + (late / bin_ps).ceil();
                    diode.period_ps = bins * bin_ps;
                }
                diode.pulses = (self.exposure.counts / self.exposure.counts_per_pulse).ceil().max(1.0) as u64;
                diode.check()?;
                Ok(Noise::Spad(diode))
            }
            (None, Some(camera), _) => {
                let mut camera = camera.clone();
                camera.photons_per_unit *= through;
                camera.check()?;
                Ok(Noise::Cmos { camera, demosaic: None })
            }
            _ => Ok(Noise::None),
        }
    }

    /// Returns the standard deviation of the noise of a reading, for light with T00 = `t00`. The result is
    /// relative to `t00`, and is 0 without a camera.
    pub fn relative_noise(&self, t00: f64) -> f64 {
        let Some(camera) = &self.camera else {
            return 0.0;
        };
        let electrons = self.exposure.electrons * t00 / self.level[0];
        let variance = if camera.shot_noise { electrons } else { 0.0 } + camera.read_noise_e.powi(2);
        self.level[1] * variance.sqrt() / electrons
    }
}
