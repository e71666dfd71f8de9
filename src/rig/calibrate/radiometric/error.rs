//! Why frames do not calibrate a camera.

/// Why there is no calibration.
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
        /// Exposure of the stack.
        exposure_s: f64,
        /// Its frames.
        frames: u32,
    },
    /// Frames are not of one sensor.
    #[error("a frame has {found} pixels, the others {want}; give frames of the same region")]
    Size {
        /// Pixels of the frame.
        found: usize,
        /// Pixels of the others.
        want: usize,
    },
    /// A setting that no frame has.
    #[error("{what} is {value}; give {need}")]
    Setting {
        /// What.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it should be.
        need: &'static str,
    },
    /// Frames without noise.
    #[error(
        "the frames at {exposure_s} s do not differ from one another: the noise is below a digital number (raise the gain), or one frame came several times"
    )]
    Constant {
        /// Exposure of the stack.
        exposure_s: f64,
    },
    /// No pixel is left.
    #[error("no pixel is left: {hot} are hot, {noisy} noisy, {stuck} stuck")]
    NoPixel {
        /// Pixels with much dark signal.
        hot: usize,
        /// Pixels with much noise.
        noisy: usize,
        /// Pixels that never change.
        stuck: usize,
    },
}
