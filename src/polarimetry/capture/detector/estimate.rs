//! What a detector's reading tells of the light.

/// What a reading tells of the radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Radiance in the scene's unit, the dark signal subtracted, so it may be negative; NaN if saturated.
    pub radiance: f64,
    /// Variance of `radiance`; infinite where nothing is known.
    pub variance: f64,
    /// True if the reading only bounds the radiance from below.
    pub saturated: bool,
}

impl Estimate {
    /// Says nothing but that there was too much light.
    pub const SATURATED: Self = Self {
        radiance: f64::NAN,
        variance: f64::INFINITY,
        saturated: true,
    };

    /// Says nothing: an instrument that light does not reach.
    pub const UNKNOWN: Self = Self {
        radiance: f64::NAN,
        variance: f64::INFINITY,
        saturated: false,
    };
}
