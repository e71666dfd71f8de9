//! What a probe answers.

use tensor::array::Tensor;

/// The result of a probe.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeResult {
    /// Values, W/(m² sr nm) per unit projector drive, over the axes that are left.
    pub mean: Tensor,
    /// Standard errors of `mean` (see the module), same shape.
    pub std_error: Tensor,
    /// The same probe of the light that arrived outside the stored time bins; without a time axis. `None` if the
    /// slice does not resolve time.
    pub overflow: Option<Tensor>,
    /// Light that the pulse moved out of the stored time bins; without a time axis. `None` without a pulse.
    pub shifted_out: Option<Tensor>,
    /// First edge and bin width of the time axis in picoseconds, if there is one.
    pub time: Option<(f64, f64)>,
    /// What the person should know: drive on projector pixels that the slice does not keep, and the like.
    pub notes: Vec<String>,
}
