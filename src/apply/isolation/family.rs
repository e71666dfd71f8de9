//! What a method of isolation may look at.

use super::element::{Element, Space, Time};
use super::seen::Seen;
use super::task::Task;
use crate::application::Method;

/// What a method may look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// The element that the paper names for the task, as it is written.
    Named,
    /// The same with either sign.
    NamedEitherSign,
    /// Its magnitude, whatever the azimuth of the planes of incidence ([`Element::magnitude`]).
    NamedAnyAzimuth,
    /// The same index in any one bin of travel time.
    NamedAtATime {
        /// Whether its sign is learnt.
        either: bool,
    },
    /// Every element of the parts that it may tell apart.
    Any {
        /// Whether it may tell epipolar light from other light.
        space: bool,
        /// Whether it may tell early light from late.
        time: bool,
        /// Whether it may look at other elements than (0,0).
        polarization: bool,
    },
}

/// A method of isolation.
#[derive(Clone, Copy, Debug)]
pub struct Isolation {
    /// What it is called.
    pub method: Method,
    /// What it may look at.
    pub family: Family,
}

impl Isolation {
    /// A method.
    #[must_use]
    pub const fn new(name: &'static str, source: &'static str, family: Family) -> Self {
        Self {
            method: Method { name, source },
            family,
        }
    }
}

impl Family {
    /// Elements with positive sign (but the named one), and whether signs are to be learnt.
    pub(super) fn candidates(self, task: &Task, seen: &Seen) -> (Vec<Element>, bool) {
        match self {
            Self::Named => (task.named.into_iter().collect(), false),
            Self::NamedEitherSign => (task.named.into_iter().collect(), true),
            Self::NamedAnyAzimuth => {
                let named = task.named.into_iter();
                (
                    named
                        .map(|e| Element::of(e.part.0, e.index).magnitude())
                        .collect(),
                    true,
                )
            }
            Self::NamedAtATime { either } => {
                let bins = seen.parts().filter(|(part, _)| matches!(part.1, Time::At(_)));
                let all = bins.filter_map(|(part, _)| task.named.map(|e| Element { part, ..e }));
                (all.collect(), either)
            }
            Self::Any {
                space,
                time,
                polarization,
            } => {
                let mut all = vec![];
                for (part, elements) in seen.parts() {
                    if !space && part.0 != Space::All || !time && part.1 != Time::All {
                        continue;
                    }
                    let kept = if polarization { elements } else { elements.min(1) };
                    all.extend((0..kept).map(|e| Element {
                        part,
                        index: [e / 4, e % 4],
                        negative: false,
                        magnitude: false,
                    }));
                }
                (all, true)
            }
        }
    }
}
