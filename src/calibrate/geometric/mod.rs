//! Geometric calibration of cameras and projectors from boards and structured light. The results are
//! intrinsics with distortion, poses and epipolar geometry.
//!
//! Pixel coordinates are continuous, and the first pixel covers 0 to 1. Only OpenCV exports place the origin
//! at the centre of the first pixel. A pose maps board or world coordinates to device coordinates, x_device =
//! R x + t. `CONVENTIONS.md` defines the axes of devices.

pub mod board;
pub mod bundle;
pub mod calibration;
pub mod corners;
pub mod covariance;
pub mod device;
pub mod epipolar;
pub mod fault;
pub mod fit;
pub mod fundamental;
pub mod homography;
pub mod image;
pub mod light;
mod open;
pub mod pose;
#[cfg(test)]
mod statistics;
pub mod zhang;
