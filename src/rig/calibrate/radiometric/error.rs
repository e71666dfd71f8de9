//! Why frames do not calibrate a camera.

/// Why there is no calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RadiometricError {
    /// No dark frames.
    #[error("no dark frames; capture some with the lens cap on")]
    NoDark,
    /// Too few frames for a variance.
    #[error(
        "the stack of {exposure_s} s has {frames} frames; a noise estimate needs at least 2, and 16 or more are recommended"
    )]
    Frames {
        /// Exposure of the stack.
        exposure_s: f64,
        /// Its frames.
        frames: u32,
    },
    /// Frames are not of one sensor.
    #[error("a frame has {found} pixels, but the others have {want}; use frames of one region")]
    Size {
        /// Pixels of the frame.
        found: usize,
        /// Pixels of the others.
        want: usize,
    },
    /// A setting that no frame has.
    #[error("{what} is {value}; expected {need}")]
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
        "all frames at {exposure_s} s are identical: the noise is below one digital number (increase the gain), or one frame was stored \
         several times"
    )]
    Constant {
        /// Exposure of the stack.
        exposure_s: f64,
    },
    /// No pixel is left.
    #[error("no usable pixels: {hot} hot, {noisy} noisy, {stuck} stuck")]
    NoPixel {
        /// Pixels with much dark signal.
        hot: usize,
        /// Pixels with much noise.
        noisy: usize,
        /// Pixels that never change.
        stuck: usize,
    },
}
