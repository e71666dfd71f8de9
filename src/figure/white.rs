//! Defines the value that is shown as white.

/// The value shown as white, or the value at the ends of a signed scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum White {
    /// A positive, finite value.
    Value(f32),
    /// No value, because the image has no positive values. All pixels are black, or have the middle colour of
    /// a signed scale.
    Nothing,
}

impl White {
    pub fn value(self) -> f32 {
        match self {
            Self::Value(v) => v,
            Self::Nothing => 1.0,
        }
    }
}

impl From<Option<f32>> for White {
    /// Converts a finite positive number to [`Self::Value`]. Other values become [`Self::Nothing`].
    fn from(v: Option<f32>) -> Self {
        v.filter(|v| *v > 0.0 && v.is_finite()).map_or(Self::Nothing, Self::Value)
    }
}
