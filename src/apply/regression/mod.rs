//! Linear regression and classification, learned from examples.

pub mod discriminant;
pub mod lbfgs;
pub mod least_squares;
pub mod moments;
