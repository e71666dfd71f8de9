//! Defines the arrays (fields) of a stored slice.

use crate::axes::SliceLayout;

/// An array of a slice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Field {
    /// Estimated value of every element.
    Mean,
    /// Standard error of [`Field::Mean`].
    StdError,
    /// Light that arrived outside the time bins. The array has no time axis.
    Overflow,
    /// Standard error of [`Field::Overflow`].
    OverflowStdError,
    /// Standard error of a camera element's total (axes `y`, `x` only). The total is M00, summed over all
    /// other axes and averaged over wavelengths. The total includes light outside the time bins.
    TotalStdError,
}

impl Field {
    /// All fields of a slice, in storage order.
    pub const ALL: [Self; 5] =
        [Self::Mean, Self::StdError, Self::Overflow, Self::OverflowStdError, Self::TotalStdError];

    /// Returns the name of the array in the store.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::StdError => "std_error",
            Self::Overflow => "overflow",
            Self::OverflowStdError => "overflow_std_error",
            Self::TotalStdError => "total_std_error",
        }
    }

    /// Returns a one-line description of the field.
    pub fn long_name(self) -> &'static str {
        match self {
            Self::Mean => "light transport",
            Self::StdError => "standard error of the light transport",
            Self::Overflow => "light transport outside the time bins",
            Self::OverflowStdError => "standard error of the light transport outside the time bins",
            Self::TotalStdError => {
                "standard error of M00 summed over all axes but y and x, mean over wavelengths"
            }
        }
    }

    /// Returns the layout of the field in a slice, or `None` if the slice does not have the field.
    pub fn layout_in(self, slice: &SliceLayout) -> Option<SliceLayout> {
        match self {
            Self::Mean | Self::StdError => Some(slice.clone()),
            Self::Overflow | Self::OverflowStdError => slice.time.map(|_| slice.without_time()),
            Self::TotalStdError => slice.totals.then(|| slice.camera_alone()),
        }
    }
}
