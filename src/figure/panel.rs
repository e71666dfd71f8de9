//! The data of a slice to draw.

use tensor::array::Tensor;

/// The mean of a slice and, if available, its standard error and the light outside its time bins.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a> {
    pub mean: &'a Tensor,
    /// Standard error of every mean, with the same axes: the band of a profile.
    pub std_error: Option<&'a Tensor>,
    /// Light outside the time bins, with the same axes except time: the note of a profile.
    pub overflow: Option<&'a Tensor>,
}
