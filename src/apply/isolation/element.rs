//! One element of the tensor as an image: which light, from when on, which element of its matrices, with which sign.

use std::fmt;

/// Light by where it came from: over all projector pixels, near the epipolar line of each camera pixel, or elsewhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Space {
    /// From every projector pixel.
    All,
    /// From those on the epipolar line.
    Epipolar,
    /// From all others.
    NonEpipolar,
}

/// Light by when it came: in bins from the pixel's first light on, or from the projector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Time {
    /// Whenever.
    All,
    /// So many bins after the first light, or sooner.
    Early(usize),
    /// Later.
    Late(usize),
    /// In one bin of travel time, the same of all pixels.
    At(usize),
}

/// Light that is parted by space and time.
pub type Part = (Space, Time);

/// An element of a part's matrices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Element {
    /// The part.
    pub part: Part,
    /// Stokes elements out and in.
    pub index: [usize; 2],
    /// Whether its sign is turned.
    pub negative: bool,
    /// Whether it is √(Σ squares) of the elements that mix when devices turn about their axes: rows 1 and 2, columns 1 and 2.
    pub magnitude: bool,
}

impl Element {
    /// An element of all times.
    #[must_use]
    pub const fn of(space: Space, index: [usize; 2]) -> Self {
        Self {
            part: (space, Time::All),
            index,
            negative: false,
            magnitude: false,
        }
    }

    /// The same of whatever azimuth.
    #[must_use]
    pub const fn magnitude(self) -> Self {
        Self {
            magnitude: true,
            ..self
        }
    }

    /// The same with the other sign.
    #[must_use]
    pub const fn negative(self) -> Self {
        Self {
            negative: !self.negative,
            ..self
        }
    }
}

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.negative { "-" } else { "" };
        let space = match self.part.0 {
            Space::All => "all light",
            Space::Epipolar => "epipolar",
            Space::NonEpipolar => "non-epipolar",
        };
        let [i, j] = self.index;
        if self.magnitude {
            write!(f, "{sign}|({i},{j})| {space}")?;
        } else {
            write!(f, "{sign}({i},{j}) {space}")?;
        }
        match self.part.1 {
            Time::All => Ok(()),
            Time::Early(k) => write!(f, ", up to bin {k} after the first light"),
            Time::At(k) => write!(f, ", in bin {k}"),
            Time::Late(k) => write!(f, ", later than bin {k} after the first light"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_the_papers() {
        let e = Element::of(Space::Epipolar, [3, 3]).negative();
        assert_eq!(e.to_string(), "-(3,3) epipolar");
        let late = Element {
            part: (Space::All, Time::Late(1)),
            ..e.negative()
        };
        assert_eq!(
            late.to_string(),
            "(3,3) all light, later than bin 1 after the first light"
        );
    }
}
