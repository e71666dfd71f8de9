//! Errors of applications.

/// The reason why an application failed.
#[derive(Debug, thiserror::Error)]
pub enum ApplyError {
    /// An observation lacks a planned slice or map.
    #[error("variant {variant} has no {what} `{name}`; render the variant again")]
    Missing {
        variant: u64,
        /// Kind of the missing item: a slice or a map.
        what: &'static str,
        name: String,
    },
    /// A slice does not resolve a required axis.
    #[error("slice `{slice}` of variant {variant} must resolve {axis}; correct the slice in the scene file")]
    Axis {
        variant: u64,
        slice: String,
        /// The missing axis.
        axis: &'static str,
    },
    /// Maps have different sizes, or variants have different wavelengths.
    #[error("variant {variant}: {what} differ in size; render all variants with the same settings")]
    Sizes { variant: u64, what: String },
    /// There is no data for training or testing.
    #[error("{0}")]
    Empty(String),
    /// A method found no solution.
    #[error("the method {method} found no solution: {cause}")]
    Unsolved { method: &'static str, cause: String },
}
