//! Errors of a radiometric calibration.

/// The reason why a calibration fails.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RadiometricError {
    #[error("there are no dark frames; capture some with the lens capped")]
    NoDark,
    #[error(
        "the stack of {exposure_s} s has {frames} frames; noise is told from two on, and well from sixteen"
    )]
    Frames { exposure_s: f64, frames: u32 },
    #[error("a frame has {found} pixels, the others {want}; give frames of the same region")]
    Size { found: usize, want: usize },
    #[error("{what} is {value}; give {need}")]
    Setting {
        what: &'static str,
        value: f64,
        need: &'static str,
    },
    #[error(
        "the frames at {exposure_s} s do not differ from one another: the noise is below a digital number (raise the gain), or one frame came several times"
    )]
    Constant { exposure_s: f64 },
    #[error("no pixel is left: {hot} are hot, {noisy} noisy, {stuck} stuck")]
    NoPixel { hot: usize, noisy: usize, stuck: usize },
}
