//! The ways in which paths are made: one list for all integrators.

use std::fmt;

/// A way to make a path from the camera to an emitter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Strategy {
    /// A walk from the camera is connected to the emitter (next-event estimation).
    NextEvent,
    /// The same through a rough interface near a particle that light comes from.
    RoughInterface,
    /// The same through smooth interfaces that bend light, and from a walk of the light to the camera.
    SmoothInterfaces,
    /// The same over flat mirrors.
    FlatMirrors,
    /// The same over curved mirrors, by further ways through curved glass, and through crystals with double images.
    CurvedMirrors,
    /// A walk from the light is connected to the camera.
    LightTracing,
    /// A walk from the camera is connected to one from the light.
    VertexConnection,
}

/// Some strategies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strategies(u8);

impl Strategy {
    /// All of them.
    pub const LIST: [Self; 7] = [
        Self::NextEvent,
        Self::RoughInterface,
        Self::SmoothInterfaces,
        Self::FlatMirrors,
        Self::CurvedMirrors,
        Self::LightTracing,
        Self::VertexConnection,
    ];

    /// By the field's usual term.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NextEvent => "next event",
            Self::RoughInterface => "next event through rough interfaces",
            Self::SmoothInterfaces => "manifolds through interfaces",
            Self::FlatMirrors => "manifolds over flat mirrors",
            Self::CurvedMirrors => "manifolds over curved mirrors and through curved glass",
            Self::LightTracing => "light tracing",
            Self::VertexConnection => "vertex connection",
        }
    }
}

impl Strategies {
    /// Every one.
    pub const ALL: Self = Self(u8::MAX);
    /// None of them.
    pub const NONE: Self = Self(0);

    /// Some.
    #[must_use]
    pub fn of(list: &[Strategy]) -> Self {
        list.iter().fold(Self::NONE, |all, s| all.with(*s, true))
    }

    /// With one more, if `there`.
    #[must_use]
    pub fn with(self, strategy: Strategy, there: bool) -> Self {
        Self(self.0 | u8::from(there) << strategy as u8)
    }

    /// Without some.
    #[must_use]
    pub fn without(self, list: &[Strategy]) -> Self {
        Self(self.0 & !Self::of(list).0)
    }

    /// Those that both have.
    #[must_use]
    pub fn both(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// True if it is one of them.
    #[inline]
    #[must_use]
    pub fn has(self, strategy: Strategy) -> bool {
        self.0 >> strategy as u8 & 1 == 1
    }

    /// True if light is followed from the emitters.
    #[inline]
    #[must_use]
    pub fn walk_from_light(self) -> bool {
        self.has(Strategy::LightTracing) || self.has(Strategy::VertexConnection)
    }
}

impl Strategies {
    /// Their names.
    #[must_use]
    pub fn names(self) -> Vec<&'static str> {
        let list = Strategy::LIST.iter().filter(|s| self.has(**s));
        list.map(|s| s.name()).collect()
    }
}

impl fmt::Display for Strategies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.names().join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every strategy has a place of its own.
    #[test]
    fn strategies_are_told_apart() {
        for s in Strategy::LIST {
            let alone = Strategies::of(&[s]);
            for other in Strategy::LIST {
                assert_eq!(alone.has(other), s == other);
                assert_eq!(Strategies::ALL.without(&[s]).has(other), s != other);
            }
        }
        assert_eq!(
            Strategies::of(&[Strategy::LightTracing, Strategy::NextEvent]).to_string(),
            "next event, light tracing"
        );
    }
}
