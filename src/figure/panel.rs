//! Defines the data of a slice to draw.

use tensor::array::Tensor;

/// The mean of a slice. The standard error of the mean and the light outside the slice's time bins are
/// optional.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a> {
    pub mean: &'a Tensor,
    /// Standard error of every mean, with the same axes. Profiles draw the standard error as a band.
    pub std_error: Option<&'a Tensor>,
    /// Light outside the time bins, with the same axes except time. Profiles print this light in a note.
    pub overflow: Option<&'a Tensor>,
}
