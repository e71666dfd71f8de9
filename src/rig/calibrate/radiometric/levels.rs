//! Stacks under light as points of a curve: mean signal and mean variance over the pixels that are used.

use super::dark::Dark;
use super::stack::Stack;

/// A stack under light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Irradiance times exposure.
    pub light: f64,
    /// Mean signal over the dark frame, DN.
    pub signal: f64,
    /// Mean signal of the dark current, DN, which is not in `signal`.
    pub dark: f64,
    /// Mean variance from frame to frame, DN².
    pub variance: f64,
    /// Share of pixels that reached the largest number.
    pub clipped: f64,
    /// Frames.
    pub frames: f64,
    /// Pixels.
    pub pixels: f64,
}

/// Levels in the order of their light; dark frames are such of none.
#[must_use]
pub fn levels(dark: &Dark, stacks: &[Stack]) -> Vec<Level> {
    let (usable, rate) = (dark.usable(), dark.mean_rate());
    let level = |s: &Stack| {
        let (mut signal, mut variance, mut pixels) = (0.0, 0.0, 0.0);
        for p in (0..s.pixels()).filter(|p| usable[*p]) {
            signal += s.mean(p) - dark.at(p, s.exposure_s());
            variance += s.variance(p);
            pixels += 1.0;
        }
        Level {
            light: s.light() * s.exposure_s(),
            signal: signal / pixels,
            dark: rate * s.exposure_s(),
            variance: variance / pixels,
            clipped: s.clipped(),
            frames: f64::from(s.frames()),
            pixels,
        }
    };
    let mut all: Vec<Level> = stacks.iter().map(level).collect();
    all.sort_by(|a, b| a.light.total_cmp(&b.light));
    all
}

/// The signal at which the camera saturates, DN: that of the greatest variance (EMVA 1288, 6.6), if a brighter level has a smaller
/// one.
#[must_use]
pub fn saturation(levels: &[Level]) -> Option<f64> {
    let top = levels
        .iter()
        .enumerate()
        .max_by(|a, b| a.1.variance.total_cmp(&b.1.variance))?;
    (top.0 + 1 < levels.len()).then_some(top.1.signal)
}
