//! Why a slice cannot be captured.

use polarimetry::capture::design_matrix::RankError;
use polarimetry::capture::detector::error::DetectorError;
use polarimetry::capture::mueller_image::ImageError;

/// Why a slice cannot be captured.
#[derive(Debug, thiserror::Error)]
pub enum ChainError {
    /// Its axes are not those of something that a camera sees.
    #[error(
        "slice `{slice}` has {what}, which a camera cannot capture; use a slice with rows, columns and complete Mueller matrices or \
         intensities"
    )]
    Axes {
        /// The slice.
        slice: String,
        /// What is wrong.
        what: &'static str,
    },
    /// It is no image.
    #[error("slice `{slice}`: {cause}")]
    Image {
        /// The slice.
        slice: String,
        /// Why.
        cause: ImageError,
    },
    /// Nothing says how long to expose.
    #[error("no slice with complete Mueller matrices contains light, so no exposure can be set; {0}")]
    Dark(String),
    /// A detector refuses.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    /// The captures do not determine a matrix.
    #[error(transparent)]
    Rank(#[from] RankError),
}
