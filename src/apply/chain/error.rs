//! Errors that occur when a slice is captured.

use polarimetry::capture::design_matrix::RankError;
use polarimetry::capture::detector::error::DetectorError;
use polarimetry::capture::mueller_image::ImageError;

/// The reason why a slice cannot be captured.
#[derive(Debug, thiserror::Error)]
pub enum ChainError {
    /// The slice has axes that an image does not have.
    #[error(
        "a camera cannot capture slice `{slice}`, because {what}; use a slice with rows, columns and complete Mueller matrices or \
         intensities"
    )]
    Axes { slice: String, what: &'static str },
    /// The slice is not a valid image.
    #[error("slice `{slice}`: {cause}")]
    Image { slice: String, cause: ImageError },
    /// The exposure cannot be determined.
    #[error("no slice with complete Mueller matrices contains light, so no exposure can be set; {0}")]
    Dark(String),
    /// The detector refuses its settings or its light.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    #[error(transparent)]
    Rank(#[from] RankError),
}
