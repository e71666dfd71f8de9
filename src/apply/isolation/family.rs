//! The elements among which an isolation method may choose.

use super::element::{Element, Part, Space, Time};
use super::linear::Features;
use super::seen::Seen;
use super::task::Task;
use crate::application::Method;

/// The dimensions that a method resolves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dimensions {
    /// Whether the method distinguishes epipolar from non-epipolar light.
    pub space: bool,
    /// Whether the method distinguishes early from late light, or bins of travel time.
    pub time: bool,
    /// Whether the method may use elements other than (0,0).
    pub polarization: bool,
}

impl Dimensions {
    /// Returns whether a method can measure a light component.
    pub(super) fn resolve(self, part: Part) -> bool {
        (self.space || part.0 == Space::All) && (self.time || part.1 == Time::All)
    }
}

/// The set of elements among which a method may choose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// The paper's element for the task, with its sign.
    Named,
    /// The paper's element with a learned sign.
    NamedEitherSign,
    /// The magnitude of the paper's element ([`Element::magnitude`]). The magnitude does not depend on the
    /// azimuth of the planes of incidence.
    NamedAnyAzimuth,
    /// The paper's element in one bin of travel time. The bin is learned.
    NamedAtATime {
        /// Whether the sign is learned.
        either: bool,
    },
    /// All elements of all light components that the method distinguishes.
    Any(Dimensions),
    /// A linear combination of several features, instead of a single element.
    Linear(Features),
}

#[derive(Clone, Copy, Debug)]
pub struct Isolation {
    pub method: Method,
    pub family: Family,
}

impl Isolation {
    pub const fn new(name: &'static str, source: &'static str, family: Family) -> Self {
        Self { method: Method { name, source }, family }
    }
}

impl Family {
    /// Returns the elements of the family with positive sign, and whether signs are learned. The named
    /// element keeps its own sign. A linear combination has no candidates.
    pub(super) fn candidates(self, task: &Task, seen: &Seen) -> (Vec<Element>, bool) {
        match self {
            Self::Linear(_) => (vec![], false),
            Self::Named => (task.named.into_iter().collect(), false),
            Self::NamedEitherSign => (task.named.into_iter().collect(), true),
            Self::NamedAnyAzimuth => {
                let named = task.named.into_iter();
                (named.map(|e| Element::of(e.part.0, e.index).magnitude()).collect(), true)
            }
            Self::NamedAtATime { either } => {
                let bins = seen.parts().filter(|(part, _)| matches!(part.1, Time::At(_)));
                let all = bins.filter_map(|(part, _)| task.named.map(|e| Element { part, ..e }));
                (all.collect(), either)
            }
            Self::Any(dimensions) => {
                let mut all = vec![];
                for (part, elements) in seen.parts().filter(|(part, _)| dimensions.resolve(*part)) {
                    let kept = if dimensions.polarization { elements } else { elements.min(1) };
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
