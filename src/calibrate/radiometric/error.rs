//! Errors of a radiometric calibration.

/// The reason why a calibration fails.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RadiometricError {
    #[error("there are no dark frames; capture dark frames with the lens cap on")]
    NoDark,
    #[error(
        "too few frames with an exposure time of {exposure_s} s: got {frames}, expected at least 2 (16 or more are recommended)"
    )]
    Frames { exposure_s: f64, frames: u32 },
    #[error("a frame has {found} pixels, but the other frames have {want}; use frames of the same region")]
    Size { found: usize, want: usize },
    #[error("{what} is {value}; expected {need}")]
    Setting { what: &'static str, value: f64, need: &'static str },
    #[error(
        "all frames at {exposure_s} s are identical: the noise is below one digital number (increase the gain), or one frame was stored \
         several times"
    )]
    Constant { exposure_s: f64 },
    #[error(
        "no pixel is usable: {hot} pixels are hot, {noisy} are noisy and {stuck} are stuck; capture the frames again"
    )]
    NoPixel { hot: usize, noisy: usize, stuck: usize },
}
