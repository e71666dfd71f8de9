//! The result of a probe.

use tensor::array::Tensor;

#[derive(Clone, Debug, PartialEq)]
pub struct ProbeResult {
    /// Values, W/(m² sr nm) per unit projector drive, over the remaining axes.
    pub mean: Tensor,
    /// Standard errors of `mean` (see the module), of the same shape.
    pub std_error: Tensor,
    /// The same probe of light outside the stored time bins, without a time axis. `None` if the slice does
    /// not resolve time.
    pub overflow: Option<Tensor>,
    /// Light that the pulse moved out of the stored time bins, without a time axis. `None` without a pulse.
    pub shifted_out: Option<Tensor>,
    /// First edge and bin width of the time axis in picoseconds, if there is one.
    pub time: Option<(f64, f64)>,
    /// Notes for the user, such as drive on projector pixels that the slice does not keep.
    pub notes: Vec<String>,
}
