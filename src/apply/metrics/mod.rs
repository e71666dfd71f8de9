//! Metrics that evaluate methods.

pub mod angle;
pub mod contrast;
pub mod isolation;
pub mod paired;
pub mod precision_recall;
pub mod psnr;
pub mod roc;
pub mod ssim;
