//! Errors of a radiometric calibration.

/// The reason why a calibration fails.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RadiometricError {
    /// No dark frames.
    #[error("there are no dark frames; capture some with the lens capped")]
    NoDark,
    /// Too few frames for a variance.
    #[error(
        "the stack of {exposure_s} s has {frames} frames; noise is told from two on, and well from sixteen"
    )]
    Frames {
        /// Exposure of the stack in s.
        exposure_s: f64,
        /// Number of frames in the stack.
        frames: u32,
    },
    /// Frames differ in size.
    #[error("a frame has {found} pixels, the others {want}; give frames of the same region")]
    Size {
        /// Number of pixels in the frame.
        found: usize,
        /// Number of pixels in the other frames.
        want: usize,
    },
    #[error("{what} is {value}; give {need}")]
    Setting {
        what: &'static str,
        value: f64,
        /// Valid values.
        need: &'static str,
    },
    /// Frames without noise.
    #[error(
        "the frames at {exposure_s} s do not differ from one another: the noise is below a digital number (raise the gain), or one frame came several times"
    )]
    Constant {
        /// Exposure of the stack in s.
        exposure_s: f64,
    },
    /// All pixels are unusable.
    #[error("no pixel is left: {hot} are hot, {noisy} noisy, {stuck} stuck")]
    NoPixel {
        /// Number of pixels with an outlying dark signal.
        hot: usize,
        /// Number of pixels with outlying noise.
        noisy: usize,
        /// Number of pixels that never change.
        stuck: usize,
    },
}
