//! Denoising of rendered images by their own error bars: an option for figures, never a measurement.
//!
//! Every pixel becomes a mean of the pixels around it that look like it,
//!
//! > F(p) = Σ_q w(p, q) y(q),  w ≥ 0,  Σ_q w(p, q) = 1,
//!
//! with one weight for all Mueller elements, wavelengths and time bins of a pair: non-local means (Buades et al. 2005) with the
//! distances of Rousselle et al. 2012 ("Adaptive Rendering with Non-Local Means Filtering"), which are differences over the stored
//! standard errors ([`likeness`]). Realizable Mueller matrices form a convex cone, so a mean of them is realizable.
//!
//! How alike is alike enough is chosen for every pixel among [`STRENGTHS`] by Stein's unbiased estimate of the error (Stein 1981;
//! Li et al. 2012, "SURE-based Optimization for Adaptive Sampling and Reconstruction"; [`weights`]). The stated error is the
//! propagated one and, added in squares, what the same estimate says of the bias ([`average`]).
//!
//! Of two renders of one scene each is averaged with weights from the other, so that they do not follow the noise that they weigh. What
//! one of them met once, far above all around it, is left out, and counts in the stated error ([`outliers`]).

pub mod around;
pub mod average;
pub mod guide;
pub mod likeness;
pub mod outliers;
mod variance;
pub mod weights;

#[cfg(test)]
mod tests;

/// Farthest that averaged pixels lie from the middle one, in rows and in columns.
pub const REACH: usize = 5;

/// Differences of pixels count as none up to so many standard errors, about: what the weights are chosen from.
pub const STRENGTHS: [f32; 3] = [0.35, 0.5, 0.7];

/// Half the width of the patches that are compared.
const PATCH: usize = 1;

/// Half the width of the boxes over which estimates of errors are averaged before they choose.
const CALM: usize = 3;

/// Rows beyond a pixel's that tell whether it is an outlier, and those beyond its neighbours' that stand in its place.
const SPOT: usize = 2;

/// Rows beyond a pixel's that its value and its error may depend on.
pub const HALO: usize = CALM + 1 + CALM + REACH + PATCH + SPOT;

/// Rows and columns of an image.
pub type Size = [usize; 2];

/// Numbers of each pixel with their standard errors, pixel by pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Values {
    /// Rows and columns.
    pub size: Size,
    /// Numbers of a pixel.
    pub channels: usize,
    /// The numbers.
    pub mean: Vec<f32>,
    /// Their standard errors.
    pub error: Vec<f32>,
}

impl Values {
    /// Number of pixels.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.size[0] * self.size[1]
    }
}
