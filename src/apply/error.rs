//! Why an application gave nothing.

/// Why an application gave nothing.
#[derive(Debug, thiserror::Error)]
pub enum ApplyError {
    /// An observation lacks what the plan asked for.
    #[error("variant {variant} has no {what} `{name}`: render it again")]
    Missing {
        /// The variant.
        variant: u64,
        /// A slice or a map.
        what: &'static str,
        /// Its name.
        name: String,
    },
    /// A slice does not resolve what is needed of it.
    #[error(
        "slice `{slice}` of variant {variant} does not resolve {axis}: correct the slice in the scene file"
    )]
    Axis {
        /// The variant.
        variant: u64,
        /// The slice.
        slice: String,
        /// What is missing.
        axis: &'static str,
    },
    /// Maps of different sizes, or variants of different wavelengths.
    #[error("variant {variant}: {what} differ in size; render all variants with the same settings")]
    Sizes {
        /// The variant.
        variant: u64,
        /// Which ones.
        what: String,
    },
    /// There is nothing to learn from, or to be judged on.
    #[error("{0}")]
    Empty(String),
    /// A method found no solution.
    #[error("{method} found no solution: {cause}")]
    Unsolved {
        /// The method.
        method: &'static str,
        /// Why.
        cause: String,
    },
}
