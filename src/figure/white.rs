//! What is shown as white.

/// The value that is shown as white, or at the ends of a signed scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum White {
    /// This one; positive and finite.
    Value(f32),
    /// None: nothing of the picture is positive, so that all of it is black, or at the middle of a signed scale.
    Nothing,
}

impl White {
    /// The value; 1 where there is none.
    #[must_use]
    pub fn value(self) -> f32 {
        match self {
            Self::Value(v) => v,
            Self::Nothing => 1.0,
        }
    }
}

impl From<Option<f32>> for White {
    /// None where there is no positive number.
    fn from(v: Option<f32>) -> Self {
        v.filter(|v| *v > 0.0 && v.is_finite())
            .map_or(Self::Nothing, Self::Value)
    }
}
