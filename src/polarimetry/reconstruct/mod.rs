//! Reconstructs Mueller matrices from intensities, and computes the expected error of the reconstruction.
//!
//! ```text
//! intensities -> estimator (least squares, prior) -> pixels (images) -> Mueller matrices, standard errors
//! pBRDFs -> pca (second moments) -> loss (closed form) -> learn (settings of a scheme)
//! ```

pub mod along_rays;
pub mod cross_validation;
pub mod estimator;
pub mod learn;
pub mod loss;
pub mod optimize;
pub mod pca;
pub mod pixels;
pub mod predicted;
pub mod product;
pub mod second_moment;
pub mod weighted;
