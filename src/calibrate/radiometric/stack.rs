//! Accumulates the mean and variance of each pixel over frames with equal exposure and light.

use super::error::RadiometricError;

/// Means and variances of frames with equal exposure and light, per pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Stack {
    exposure_s: f64,
    light: f64,
    top_dn: u32,
    frames: u32,
    mean: Vec<f64>,
    squares: Vec<f64>,
    clipped: Vec<bool>,
}

impl Stack {
    /// Creates an empty stack of frames with `pixels` pixels.
    ///
    /// `light` is the irradiance in any unit shared by all stacks, or 0 for dark frames. `top_dn` is the
    /// maximum digital number of the format.
    ///
    /// # Errors
    /// Returns [`RadiometricError::Setting`] if an argument is out of range.
    pub fn new(pixels: usize, exposure_s: f64, light: f64, top_dn: u32) -> Result<Self, RadiometricError> {
        let setting = |what, value: f64, holds, need| {
            if holds { Ok(()) } else { Err(RadiometricError::Setting { what, value, need }) }
        };
        let time = exposure_s.is_finite() && exposure_s > 0.0;
        setting("an exposure", exposure_s, time, "a positive time in seconds")?;
        let some = light.is_finite() && light >= 0.0;
        setting("the light of a stack", light, some, "0 or more, in any unit")?;
        setting("the number of pixels", pixels as f64, pixels > 0, "1 or more")?;
        setting("the largest digital number", f64::from(top_dn), top_dn > 0, "2^bits - 1")?;
        Ok(Self {
            exposure_s,
            light,
            top_dn,
            frames: 0,
            mean: vec![0.0; pixels],
            squares: vec![0.0; pixels],
            clipped: vec![false; pixels],
        })
    }

    /// Adds a frame, given by its readings in DN, row by row from the top.
    ///
    /// # Errors
    /// Returns [`RadiometricError::Size`] if the number of pixels differs from that of the stack. Returns
    /// [`RadiometricError::Setting`] if a reading exceeds the maximum of the format.
    pub fn add(&mut self, frame: &[u32]) -> Result<(), RadiometricError> {
        if frame.len() != self.mean.len() {
            return Err(RadiometricError::Size { found: frame.len(), want: self.mean.len() });
        }
        if let Some(dn) = frame.iter().find(|dn| **dn > self.top_dn) {
            return Err(RadiometricError::Setting {
                what: "a digital number",
                value: f64::from(*dn),
                need: "a value that fits the bit depth of the camera's format",
            });
        }
        self.frames += 1;
        let n = f64::from(self.frames);
        for (i, dn) in frame.iter().enumerate() {
            // Running variance of Welford 1962.
            let step = f64::from(*dn) - self.mean[i];
            self.mean[i] += step / n;
            self.squares[i] += step * (f64::from(*dn) - self.mean[i]);
            self.clipped[i] |= *dn == self.top_dn;
        }
        Ok(())
    }

    pub fn exposure_s(&self) -> f64 {
        self.exposure_s
    }

    /// Returns the irradiance in the unit that all stacks share.
    pub fn light(&self) -> f64 {
        self.light
    }

    pub fn frames(&self) -> u32 {
        self.frames
    }

    pub fn pixels(&self) -> usize {
        self.mean.len()
    }

    /// Returns the maximum digital number of the format.
    pub fn top_dn(&self) -> u32 {
        self.top_dn
    }

    /// Returns the mean of a pixel in DN.
    pub fn mean(&self, pixel: usize) -> f64 {
        self.mean[pixel]
    }

    /// Returns the unbiased variance of a pixel between frames in DN², or NaN for fewer than two frames.
    pub fn variance(&self, pixel: usize) -> f64 {
        if self.frames < 2 {
            return f64::NAN;
        }
        self.squares[pixel] / f64::from(self.frames - 1)
    }

    /// Returns the fraction of pixels that reached the maximum digital number in any frame.
    pub fn clipped(&self) -> f64 {
        self.clipped.iter().filter(|c| **c).count() as f64 / self.clipped.len() as f64
    }
}

/// Checks that stacks are from one sensor, have enough frames, and contain noise.
pub(super) fn check(stacks: &[&Stack]) -> Result<(), RadiometricError> {
    let Some(first) = stacks.first() else {
        return Err(RadiometricError::NoDark);
    };
    for s in stacks {
        if s.pixels() != first.pixels() {
            return Err(RadiometricError::Size { found: s.pixels(), want: first.pixels() });
        }
        if s.top_dn != first.top_dn {
            return Err(RadiometricError::Setting {
                what: "the largest digital number of a stack",
                value: f64::from(s.top_dn),
                need: "the same value in all stacks (one pixel format)",
            });
        }
        if s.frames < 2 {
            return Err(RadiometricError::Frames { exposure_s: s.exposure_s, frames: s.frames });
        }
        // If all pixels are at the maximum, they are saturated, not constant.
        if s.squares.iter().all(|v| *v == 0.0) && s.clipped() < 1.0 {
            return Err(RadiometricError::Constant { exposure_s: s.exposure_s });
        }
    }
    Ok(())
}
