//! Principal components of measured reflectance, and the second moments for learned ellipsometry.
//!
//! Baek & Heide 2021, "Polarimetric Spatio-Temporal Light Transport Probing", §3.2 and figure 5, analyse the
//! Mueller matrices of 25 pBRDFs. Every matrix is divided by its T00 and mapped by arctan(c T), c = 8. The
//! mapped matrices are the rows of X. With X - mean = U Σ Vᵀ, the columns of V Σ are the scaled principal
//! components.
//!
//! - [`gather`] selects the valid matrices.
//! - [`data_set`] holds the moments and samples of each material.
//! - [`moments`] accumulates the mean and the second moments.
//! - [`components`] computes V and Σ.
//! - [`folds`] leaves materials out for cross-validation (§4).

pub mod components;
pub mod data_set;
pub mod folds;
pub mod gather;
pub mod moments;
#[cfg(test)]
pub(super) mod testing;
