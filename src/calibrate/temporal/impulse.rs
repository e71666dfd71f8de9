//! The parametric response to a short pulse.

use polarimetry::capture::detector::response::{FWHM_PER_SIGMA, Response};
use serde::{Deserialize, Serialize};

/// Response to a short pulse. The Gaussian part is centred on time 0.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct Impulse {
    /// Standard deviation of the Gaussian part in ps.
    pub sigma_ps: f64,
    /// Fraction of detections with an exponential delay.
    pub tail_share: f64,
    /// Mean of the exponential delay in ps.
    pub tail_ps: f64,
    /// Probability that a detection causes an afterpulse.
    pub after_pulsing: f64,
}

impl Default for Impulse {
    /// Returns the defaults of [`polarimetry::capture::detector::spad::Spad`], without afterpulses.
    fn default() -> Self {
        Self { sigma_ps: 70.0 / FWHM_PER_SIGMA, tail_share: 0.2, tail_ps: 200.0, after_pulsing: 0.0 }
    }
}

/// A parameter of the response.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    Width,
    TailShare,
    TailTime,
    AfterPulsing,
}

impl Shape {
    /// All parameters. Every array with one number per parameter has this order.
    pub const ALL: [Self; 4] = [Self::Width, Self::TailShare, Self::TailTime, Self::AfterPulsing];

    pub fn name(self) -> &'static str {
        match self {
            Self::Width => "width of the response",
            Self::TailShare => "tail fraction",
            Self::TailTime => "tail time constant",
            Self::AfterPulsing => "after-pulse probability",
        }
    }
}

impl Impulse {
    /// Returns the parameters in the order of [`Shape::ALL`].
    pub fn vector(&self) -> [f64; 4] {
        [self.sigma_ps, self.tail_share, self.tail_ps, self.after_pulsing]
    }

    /// Creates a response from parameters in the order of [`Shape::ALL`].
    pub fn of([sigma_ps, tail_share, tail_ps, after_pulsing]: [f64; 4]) -> Self {
        Self { sigma_ps, tail_share, tail_ps, after_pulsing }
    }

    /// Clamps the parameters to the range that a fit can determine with this bin width and period.
    pub(super) fn possible(self, bin_ps: f64, period_ps: f64) -> Self {
        Self {
            sigma_ps: self.sigma_ps.clamp(0.1 * bin_ps, 0.1 * period_ps),
            tail_share: self.tail_share.clamp(0.0, 0.98),
            tail_ps: self.tail_ps.clamp(0.2 * bin_ps, 0.2 * period_ps),
            after_pulsing: self.after_pulsing.clamp(0.0, 0.9),
        }
    }

    /// Returns the full width at half maximum of the Gaussian part in ps.
    pub fn fwhm_ps(&self) -> f64 {
        self.sigma_ps * FWHM_PER_SIGMA
    }

    pub(super) fn response(&self) -> Response {
        Response { sigma: self.sigma_ps, tail: self.tail_share, tau: self.tail_ps }
    }
}
