//! Geometric calibration of cameras and projectors from boards and structured light: intrinsics
//! with distortion, poses and epipolar geometry.
//!
//! Pixels are continuous, and the first one covers 0..1. Only OpenCV exports place the origin at
//! the center of the first pixel. A pose maps board or world to device: x_device = R x + t, with
//! device axes as in `CONVENTIONS.md`.

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
