//! Cameras and projectors: intrinsics with distortion, poses, epipolar geometry, from boards and structured light.
//!
//! Pixels are continuous ones, of which the first covers 0..1; only what is written for OpenCV counts from its centre. A pose
//! takes board or world to device: x_device = R x + t, device axes as in `CONVENTIONS.md`.

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
