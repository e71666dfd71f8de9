//! Linear estimates of a number from others, learnt from examples.

pub mod discriminant;
pub mod lbfgs;
pub mod least_squares;
pub mod moments;
