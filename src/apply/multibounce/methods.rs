//! Methods that both scenes of camera and projector use.

use crate::isolation::{Family, Isolation};

pub(super) const fn any(space: bool, time: bool, polarization: bool) -> Family {
    Family::Any { space, time, polarization }
}

/// All methods; the paper's is the first.
pub(super) const METHODS: [Isolation; 8] = [
    Isolation::new("the named element", "Baek & Heide 2021", Family::Named),
    Isolation::new("the named element, either sign", "its sign learnt", Family::NamedEitherSign),
    Isolation::new(
        "the named element, any azimuth",
        "its magnitude: rows and columns 1 and 2 together",
        Family::NamedAnyAzimuth,
    ),
    Isolation::new(
        "any element of space and polarization",
        "learnt: the bound of single elements",
        any(true, false, true),
    ),
    Isolation::new("polarization only", "learnt element of all light", any(false, false, true)),
    Isolation::new(
        "space only",
        "learnt: (0,0) of epipolar or other light (O'Toole et al. 2012)",
        any(true, false, false),
    ),
    Isolation::new("time only", "learnt: (0,0) of early or late light", any(false, true, false)),
    Isolation::new("intensity only", "a photograph", any(false, false, false)),
];
