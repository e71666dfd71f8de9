//! The radiance estimate of a detector reading.

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Radiance in the scene's units, after subtraction of the dark signal. The radiance is NaN if saturated,
    /// and can be negative.
    pub radiance: f64,
    /// Variance of `radiance`, or infinity if unknown.
    pub variance: f64,
    /// Whether the reading is merely a lower bound of the radiance.
    pub saturated: bool,
}

impl Estimate {
    /// The estimate of a saturated reading.
    pub const SATURATED: Self = Self { radiance: f64::NAN, variance: f64::INFINITY, saturated: true };

    /// The estimate of an instrument that receives no light.
    pub const UNKNOWN: Self = Self { radiance: f64::NAN, variance: f64::INFINITY, saturated: false };
}
