//! The arrays that a slice is made of.

use crate::axes::SliceLayout;

/// Which array of a slice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Field {
    /// Estimated value of every element.
    Mean,
    /// Standard error of [`Field::Mean`].
    StdError,
    /// Light that arrived outside the time bins (no time axis).
    Overflow,
    /// Standard error of [`Field::Overflow`].
    OverflowStdError,
}

impl Field {
    /// All fields.
    pub const ALL: [Self; 4] = [Self::Mean, Self::StdError, Self::Overflow, Self::OverflowStdError];

    /// Name of the array in the store.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::StdError => "std_error",
            Self::Overflow => "overflow",
            Self::OverflowStdError => "overflow_std_error",
        }
    }

    /// One line for people.
    #[must_use]
    pub fn long_name(self) -> &'static str {
        match self {
            Self::Mean => "light transport",
            Self::StdError => "standard error of the light transport",
            Self::Overflow => "light transport outside the time bins",
            Self::OverflowStdError => "standard error of the light transport outside the time bins",
        }
    }

    /// The layout of this field in a slice, `None` where the slice does not have it.
    #[must_use]
    pub fn layout_in(self, slice: &SliceLayout) -> Option<SliceLayout> {
        match self {
            Self::Mean | Self::StdError => Some(slice.clone()),
            Self::Overflow | Self::OverflowStdError => slice.time.map(|_| slice.without_time()),
        }
    }
}
