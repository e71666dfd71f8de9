//! A single-photon avalanche diode with time-correlated single-photon counting (TCSPC).
//!
//! Light of radiance L_j in time bin j of a laser's period causes detections in bin i. While the diode is
//! armed, the number of detections per pulse is
//!
//! > λ_i = η Φ Σ_j h_{i-j} L_j + d Δ
//!
//! where η is the detection efficiency and Φ the photons per pulse and unit of radiance. The instrument's
//! response h is cyclic in the period (`response.rs`). The dark counts per second are d, and Δ is the length
//! of a bin. Dead time converts these rates to the histogram of N pulses (`tcspc.rs`), and [`super::pile_up`]
//! corrects for dead time. The estimates are not deconvolved with the response. The estimated quantity is h ∗
//! L, which is delayed relative to L by [`Spad::response_mean_ps`] on average.
//!
//! The jitter is applied to the rates, before the dead time. The resulting relative error is of the order
//! of the jitter divided by the dead time.

use super::super::spectral_value::SpectralValue;
use super::error::{DetectorError, count, demand, efficiency, finite, non_negative, positive, share};
use super::estimate::Estimate;
use super::pile_up;
use super::response::{FWHM_PER_SIGMA, Response};
use super::tcspc::{self, Recovery};
use optics::sampling::stream::Stream;
use serde::{Deserialize, Serialize};

/// Maximum number of bins of a period.
const MAX_BINS: f64 = 1_048_576.0;

/// Maximum number of pulses of a capture, which is a day at 10 MHz.
const MAX_PULSES: u64 = 1_000_000_000_000;

/// Maximum expected number of detections of a free-running diode in one capture. The simulation processes
/// detections one by one, about 10⁷ per second. A diode with a dead time of 50 ns in constant light reaches
/// the maximum in five seconds.
const MAX_DETECTIONS: f64 = 1e8;

/// The rule that determines when the diode is armed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The diode is armed at each laser pulse, with at most one detection per pulse. `dead_time_ps` and
    /// after-pulses have no effect, because dead times and after-pulses are assumed to end before the next
    /// pulse.
    #[default]
    Synchronous,
    /// The diode is armed again a fixed dead time after each detection. Photons during the dead time do not
    /// extend the dead time.
    FreeRunning,
}

/// The settings of a diode and its counter. The defaults are typical of silicon SPADs with a 10 MHz laser.
/// `photons_per_unit` depends on scene, laser and lens. The default of `photons_per_unit` is a placeholder.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Spad {
    pub mode: Mode,
    /// Length of a bin in picoseconds.
    pub bin_ps: f64,
    /// Number of bins whose radiance is estimated, counted from the start of the period. Counts are kept for
    /// all bins.
    pub bins: usize,
    /// Time between laser pulses in picoseconds. The period is a whole number of bins.
    pub period_ps: f64,
    /// Laser pulses per capture.
    pub pulses: u64,
    /// Photons at the diode, per pulse and unit of the scene's radiance.
    pub photons_per_unit: f64,
    /// Detections per photon while the diode is armed.
    pub detection_efficiency: SpectralValue,
    /// Detections per second without light.
    pub dark_counts_per_s: f64,
    /// Dead time after a detection in picoseconds (free-running mode).
    pub dead_time_ps: f64,
    /// Probability that a detection causes an after-pulse (free-running mode).
    pub after_pulsing: f64,
    /// Mean time from the end of the dead time to an after-pulse, in picoseconds.
    pub after_pulse_time_ps: f64,
    /// Full width at half maximum of the Gaussian part of the response, in picoseconds.
    pub irf_fwhm_ps: f64,
    /// Fraction of the response in the exponential tail.
    pub irf_tail: f64,
    /// Time constant of the tail in picoseconds.
    pub irf_tail_ps: f64,
}

impl Default for Spad {
    fn default() -> Self {
        Self {
            mode: Mode::Synchronous,
            bin_ps: 25.0,
            bins: 4000,
            period_ps: 100_000.0,
            pulses: 1_000_000,
            photons_per_unit: 1.0,
            detection_efficiency: SpectralValue::Same(0.3),
            dark_counts_per_s: 100.0,
            dead_time_ps: 50_000.0,
            after_pulsing: 0.01,
            after_pulse_time_ps: 50_000.0,
            irf_fwhm_ps: 70.0,
            irf_tail: 0.2,
            irf_tail_ps: 200.0,
        }
    }
}

impl Spad {
    /// Checks the settings of the diode and its counter.
    ///
    /// # Errors
    /// Returns [`DetectorError::Field`] if a setting is invalid. The error names the first invalid field.
    pub fn check(&self) -> Result<(), DetectorError> {
        let number = |field, value, need| demand(field, value, positive(value), need);
        let or_zero = |field, value, need| demand(field, value, non_negative(value), need);
        number("bin_ps", self.bin_ps, "a positive time in picoseconds")?;
        number("period_ps", self.period_ps, "a positive time in picoseconds")?;
        let bins = self.period_ps / self.bin_ps;
        let whole =
            (bins - bins.round()).abs() < 1e-6 * bins.max(1.0) && (1.0..=MAX_BINS).contains(&bins.round());
        demand("period_ps", self.period_ps, whole, "a multiple of `bin_ps`, at most 1048576 bins")?;
        let inside = (1..=self.period_bins()).contains(&self.bins);
        demand("bins", self.bins as f64, inside, "1 to the number of bins in `period_ps`")?;
        let holds = (1..=MAX_PULSES).contains(&self.pulses);
        demand("pulses", self.pulses as f64, holds, "1 to 1e12 pulses")?;
        number("photons_per_unit", self.photons_per_unit, "a positive number of photons")?;
        efficiency("detection_efficiency", &self.detection_efficiency)?;
        or_zero("dark_counts_per_s", self.dark_counts_per_s, "zero or more counts per second")?;
        let dead = self.dead_time_ps;
        or_zero("dead_time_ps", dead, "zero or more picoseconds")?;
        let p = self.after_pulsing;
        demand("after_pulsing", p, (0.0..=0.9).contains(&p), "a probability of at most 0.9")?;
        let time = self.after_pulse_time_ps;
        or_zero("after_pulse_time_ps", time, "zero or more picoseconds")?;
        let within = |field, value: f64| {
            let holds = (0.0..=self.period_ps).contains(&value);
            demand(field, value, holds, "zero or more picoseconds, at most `period_ps`")
        };
        within("irf_fwhm_ps", self.irf_fwhm_ps)?;
        demand("irf_tail", self.irf_tail, share(self.irf_tail), "0 to 1")?;
        within("irf_tail_ps", self.irf_tail_ps)
    }

    /// Returns the number of bins of the laser's period.
    pub fn period_bins(&self) -> usize {
        (self.period_ps / self.bin_ps).round() as usize
    }

    fn instrument(&self) -> Response {
        Response { sigma: self.irf_fwhm_ps / FWHM_PER_SIGMA, tail: self.irf_tail, tau: self.irf_tail_ps }
    }

    fn recovery(&self) -> Recovery {
        Recovery {
            dead: self.dead_time_ps / self.bin_ps,
            after_pulsing: self.after_pulsing,
            after_pulse: self.after_pulse_time_ps / self.bin_ps,
        }
    }

    /// Returns the dark counts per pulse and bin.
    fn dark(&self) -> f64 {
        self.dark_counts_per_s * self.bin_ps * 1e-12
    }

    /// Returns the detections per pulse and unit of radiance.
    fn per_unit(&self, nm: f64) -> f64 {
        self.detection_efficiency.at(nm) * self.photons_per_unit
    }

    /// Returns the mean delay of the response in picoseconds. The tail causes this delay.
    pub fn response_mean_ps(&self) -> f64 {
        self.instrument().mean()
    }

    /// Returns the fractions of light that are detected 0, 1, … bins after the arrival of the light. Bins are
    /// cyclic in the period. The sum of the fractions is 1.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::check`].
    pub fn response(&self) -> Result<Vec<f64>, DetectorError> {
        self.check()?;
        Ok(self.instrument().binned(self.bin_ps, self.period_bins()))
    }

    /// Returns the detections per pulse in each bin of the period while the diode is armed.
    ///
    /// `histogram` is the radiance in each bin after the laser pulse, in the scene's units, at wavelength
    /// `nm`. Light that arrives later than one period is counted with the following pulses. Negative rates of
    /// detected light are treated as 0.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::check`], and [`DetectorError::Radiance`] if a value is not finite.
    pub fn rates(&self, histogram: &[f64], nm: f64) -> Result<Vec<f64>, DetectorError> {
        finite(histogram)?;
        let response = self.response()?;
        let bins = response.len();
        let (per_unit, dark) = (self.per_unit(nm), self.dark());
        // The response is zero in most bins. The light is also zero in many bins.
        let taps: Vec<_> = response.iter().enumerate().filter(|(_, share)| **share > 0.0).collect();
        let mut rates = vec![0.0; bins];
        for (j, radiance) in histogram.iter().enumerate().filter(|(_, radiance)| **radiance != 0.0) {
            let start = j % bins;
            for (k, share) in &taps {
                let i = start + k;
                rates[if i < bins { i } else { i - bins }] += per_unit * radiance * *share;
            }
        }
        rates.iter_mut().for_each(|rate| *rate = rate.max(0.0) + dark);
        Ok(rates)
    }

    /// Returns the variance of one bin's estimate after all pulses, for a given radiance, without dead time.
    /// Photons and dark counts follow Poisson statistics.
    pub fn variance(&self, radiance: f64, nm: f64) -> f64 {
        let unit = self.per_unit(nm);
        let rate = (unit * radiance).max(0.0) + self.dark();
        // A lower bound of one count in total limits the precision of a bin.
        let pulses = self.pulses as f64;
        rate.max(1.0 / pulses) / (pulses * unit * unit)
    }

    /// Returns random counts in each bin of the period after all pulses of one capture, for `rates` from
    /// [`Self::rates`].
    ///
    /// # Errors
    /// Returns the same errors as [`Self::check`]. Returns [`DetectorError::Count`] unless there is one rate
    /// per bin of the period. Returns [`DetectorError::Detections`] if a free-running diode is expected to
    /// have more than 10⁸ detections.
    pub fn count(&self, rates: &[f64], stream: &mut Stream) -> Result<Vec<u64>, DetectorError> {
        self.check()?;
        count("the rates of a period", self.period_bins(), rates.len())?;
        if self.mode == Mode::Synchronous {
            return Ok(tcspc::synchronous(rates, self.pulses, stream));
        }
        let recovery = self.recovery();
        let expected = tcspc::most_detections(rates, &recovery, self.pulses);
        if expected > MAX_DETECTIONS {
            let most = MAX_DETECTIONS;
            return Err(DetectorError::Detections { expected, most });
        }
        Ok(tcspc::free_running(rates, &recovery, self.pulses, stream))
    }

    /// Returns radiance estimates in the first `bins` bins from the counts in all bins of the period. The
    /// dead time is corrected, and dark counts are subtracted (see [`pile_up`] for the neglected effects).
    ///
    /// The variances are unbiased and therefore 0 in bins without counts. Such variances are unsuitable as
    /// weights of single bins.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::check`], and [`DetectorError::Count`] unless there is one count per
    /// bin of the period.
    pub fn estimate(&self, counts: &[u64], nm: f64) -> Result<Vec<Estimate>, DetectorError> {
        self.check()?;
        count("the counts of a period", self.period_bins(), counts.len())?;
        let rates = match self.mode {
            Mode::Synchronous => pile_up::coates(counts, self.pulses),
            Mode::FreeRunning => pile_up::live_time(counts, self.pulses, self.recovery().dead),
        };
        let (per_unit, dark) = (self.per_unit(nm), self.dark());
        let radiance = |rate: pile_up::Rate| match rate.saturated {
            true => Estimate::SATURATED,
            false if !positive(per_unit) => Estimate::UNKNOWN,
            false => Estimate {
                radiance: (rate.value - dark) / per_unit,
                variance: rate.variance / per_unit.powi(2),
                saturated: false,
            },
        };
        Ok(rates.into_iter().take(self.bins).map(radiance).collect())
    }
}

#[cfg(test)]
mod tests;
