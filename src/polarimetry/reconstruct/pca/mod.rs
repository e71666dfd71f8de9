//! Principal components of measured reflectance, and the moments that learned ellipsometry starts from.
//!
//! Baek & Heide 2021, "Polarimetric Spatio-Temporal Light Transport Probing", §3.2 and figure 5: every Mueller matrix of
//! 25 pBRDFs is divided by its T00 and mapped by arctan(c T), c = 8; the matrices are the rows of X, and of
//! X - mean = U Σ Vᵀ the columns of V Σ are the scaled principal components. [`gather`] says which matrices count,
//! [`data_set`] where they come from, [`moments`] how they are summed, [`components`] what V and Σ are; [`folds`] leaves
//! materials out for cross-validation (§4).

pub mod components;
pub mod data_set;
pub mod folds;
pub mod gather;
pub mod moments;
#[cfg(test)]
pub(super) mod testing;
