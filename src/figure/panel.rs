//! Defines the data of a slice to draw.

use tensor::array::Tensor;

/// The mean of a slice and, if available, the standard error of this mean and the light outside the
/// slice's time bins.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a> {
    pub mean: &'a Tensor,
    /// Standard error of every mean, with the same axes. Profiles draw it as a band.
    pub std_error: Option<&'a Tensor>,
    /// Light outside the time bins, with the same axes except time. Profiles print it in a note.
    pub overflow: Option<&'a Tensor>,
}
