//! Measured materials as data: moments and samples of their Mueller matrices.

pub mod data_set;
