//! What is drawn of a slice.

use tensor::array::Tensor;

/// What is drawn: the mean of a slice and, where there are any, its standard error and what its time bins missed.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a> {
    /// Mean values.
    pub mean: &'a Tensor,
    /// Standard error of every mean, over the same axes: the band of a profile.
    pub std_error: Option<&'a Tensor>,
    /// Light outside the time bins, over the same axes without time: the note of a profile.
    pub overflow: Option<&'a Tensor>,
}
