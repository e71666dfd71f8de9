//! Reduces each lit stack to the mean signal and the mean variance over the usable pixels.

use super::dark::Dark;
use super::stack::Stack;

/// Statistics of one lit stack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Irradiance times exposure.
    pub light: f64,
    /// Mean signal above the dark frame in DN.
    pub signal: f64,
    /// Mean signal of the dark current in DN, not included in `signal`.
    pub dark: f64,
    /// Mean variance between frames in DN².
    pub variance: f64,
    /// Fraction of pixels that reached the maximum digital number.
    pub clipped: f64,
    pub frames: f64,
    pub pixels: f64,
}

/// Returns the levels in ascending order of light. Dark frames are levels without light.
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

/// Returns the saturation signal in DN, or `None` if no level reached saturation.
///
/// Saturation is at the level of maximum variance (EMVA 1288, 6.6), if a brighter level has a
/// smaller variance.
pub fn saturation(levels: &[Level]) -> Option<f64> {
    let top = levels.iter().enumerate().max_by(|a, b| a.1.variance.total_cmp(&b.1.variance))?;
    (top.0 + 1 < levels.len()).then_some(top.1.signal)
}
