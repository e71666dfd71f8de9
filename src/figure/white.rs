//! The value shown as white.

/// The value shown as white, or at the ends of a signed scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum White {
    /// This value; positive and finite.
    Value(f32),
    /// No value: nothing in the image is positive, so it is all black, or at the middle of a signed scale.
    Nothing,
}

impl White {
    /// Returns the value; 1 if there is none.
    pub fn value(self) -> f32 {
        match self {
            Self::Value(v) => v,
            Self::Nothing => 1.0,
        }
    }
}

impl From<Option<f32>> for White {
    /// Returns `Nothing` unless there is a finite positive number.
    fn from(v: Option<f32>) -> Self {
        v.filter(|v| *v > 0.0 && v.is_finite()).map_or(Self::Nothing, Self::Value)
    }
}
