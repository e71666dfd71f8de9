//! One element of the tensor as an image. An element is defined by a light component (selected by space and
//! time), an element of the Mueller matrices, and a sign.

use std::fmt;

/// The light component, selected by the origin of the light. The origin is one of three sets of projector
/// pixels: all pixels, the pixels near a camera pixel's epipolar line, or all other pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Space {
    /// Light from all projector pixels.
    All,
    /// Light from projector pixels near the epipolar line.
    Epipolar,
    /// Light from projector pixels that are not near the epipolar line.
    NonEpipolar,
}

/// The light component, selected by travel time in bins. Bins are counted from the pixel's first light, or
/// from the emission.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Time {
    /// Light at all times.
    All,
    /// Light at most this many bins after the pixel's first light.
    Early(usize),
    /// Light more than this many bins after the pixel's first light.
    Late(usize),
    /// Light in one bin of travel time, the same for all pixels.
    At(usize),
}

/// The light component that is selected by space and time.
pub type Part = (Space, Time);

/// A Mueller element of a light component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Element {
    pub part: Part,
    /// Indices of the outgoing and incoming Stokes elements.
    pub index: [usize; 2],
    /// Whether the sign is inverted.
    pub negative: bool,
    /// Whether the value is the root of the sum of squares over rows 1 and 2, or over columns 1 and 2. These
    /// elements mix when the camera or the projector rotates about its axis.
    pub magnitude: bool,
}

impl Element {
    /// Returns the element `index` of the light in `space`, summed over all times.
    pub const fn of(space: Space, index: [usize; 2]) -> Self {
        Self { part: (space, Time::All), index, negative: false, magnitude: false }
    }

    /// Returns the magnitude of the element, which does not depend on the azimuth.
    pub const fn magnitude(self) -> Self {
        Self { magnitude: true, ..self }
    }

    /// Returns the element with the opposite sign.
    pub const fn negative(self) -> Self {
        Self { negative: !self.negative, ..self }
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
    fn names_match_the_paper() {
        let e = Element::of(Space::Epipolar, [3, 3]).negative();
        assert_eq!(e.to_string(), "-(3,3) epipolar");
        let late = Element { part: (Space::All, Time::Late(1)), ..e.negative() };
        assert_eq!(late.to_string(), "(3,3) all light, later than bin 1 after the first light");
    }
}
