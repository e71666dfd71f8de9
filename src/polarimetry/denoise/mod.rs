//! Denoises rendered images by means of their standard errors. Denoised images are suitable for figures, but
//! not for measurements.
//!
//! Every pixel becomes a weighted mean of the similar pixels in its neighbourhood,
//!
//! > F(p) = Σ_q w(p, q) y(q),  w ≥ 0,  Σ_q w(p, q) = 1,
//!
//! with one weight for all Mueller elements, wavelengths and time bins of a pair. The method is non-local
//! means (Buades et al. 2005) with the distances of Rousselle et al. 2012 ("Adaptive Rendering with Non-Local
//! Means Filtering"). The distances are differences relative to the stored standard errors ([`likeness`]).
//! Realizable Mueller matrices form a convex cone, so their mean is realizable.
//!
//! Stein's unbiased risk estimate selects the denoising strength of each pixel from [`STRENGTHS`] (Stein
//! 1981; Li et al. 2012, "SURE-based Optimization for Adaptive Sampling and Reconstruction"; [`weights`]).
//! The square of the stated error is the propagated variance plus the estimate of the squared bias
//! ([`average`]).
//!
//! With two renders of one scene, each render is averaged with weights from the other render. The weights are
//! therefore independent of the noise. A contribution is removed if it is far above its surroundings and is
//! missing in the second render. The stated error includes the removed amount ([`outliers`]).

pub mod around;
pub mod average;
pub mod guide;
pub mod likeness;
pub mod outliers;
mod variance;
pub mod weights;

#[cfg(test)]
mod tests;

/// Radius of the window of averaged pixels, in rows and columns.
pub const REACH: usize = 5;

/// Candidates for the denoising strength. Differences up to approximately this number of standard errors are
/// ignored.
pub const STRENGTHS: [f32; 3] = [0.35, 0.5, 0.7];

/// Radius of the compared patches.
const PATCH: usize = 1;

/// Radius of boxes of pixels. Error estimates are averaged over these boxes before the strength is chosen.
const CALM: usize = 3;

/// Number of rows above and below a pixel that affect the detection and the replacement of an outlier.
const SPOT: usize = 2;

/// Number of rows above and below a pixel that can affect the pixel's denoised value and error.
pub const HALO: usize = CALM + 1 + CALM + REACH + PATCH + SPOT;

/// Rows and columns of an image.
pub type Size = [usize; 2];

/// The values of an image and their standard errors, by pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Values {
    pub size: Size,
    /// Number of values per pixel.
    pub channels: usize,
    pub mean: Vec<f32>,
    /// Standard errors of the values.
    pub error: Vec<f32>,
}

impl Values {
    pub fn pixels(&self) -> usize {
        self.size[0] * self.size[1]
    }
}
