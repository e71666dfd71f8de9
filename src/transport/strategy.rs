//! The path-sampling strategies of all integrators.

use std::fmt;

/// A strategy that samples paths from the camera to an emitter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Strategy {
    /// Next-event estimation, which connects a camera path to the emitter.
    NextEvent,
    /// Next-event estimation from a medium vertex through a nearby rough interface.
    RoughInterface,
    /// Manifold connections through smooth refracting interfaces, to emitters and to the camera.
    SmoothInterfaces,
    FlatMirrors,
    /// Connections over curved mirrors, along all paths through curved glass, and through crystals.
    CurvedMirrors,
    /// Light tracing, which connects a light path to the camera.
    LightTracing,
    /// Vertex connection, which connects inner vertices of a camera path and a light path.
    VertexConnection,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strategies(u8);

impl Strategy {
    pub const LIST: [Self; 7] = [
        Self::NextEvent,
        Self::RoughInterface,
        Self::SmoothInterfaces,
        Self::FlatMirrors,
        Self::CurvedMirrors,
        Self::LightTracing,
        Self::VertexConnection,
    ];

    /// Returns the usual name of the strategy.
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
    pub const ALL: Self = Self(u8::MAX);
    pub const NONE: Self = Self(0);

    pub fn of(list: &[Strategy]) -> Self {
        list.iter().fold(Self::NONE, |all, s| all.with(*s, true))
    }

    pub fn with(self, strategy: Strategy, there: bool) -> Self {
        Self(self.0 | u8::from(there) << strategy as u8)
    }

    pub fn without(self, list: &[Strategy]) -> Self {
        Self(self.0 & !Self::of(list).0)
    }

    pub fn both(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    #[inline]
    pub fn has(self, strategy: Strategy) -> bool {
        self.0 >> strategy as u8 & 1 == 1
    }

    /// Returns true if at least one strategy traces paths from the emitters.
    #[inline]
    pub(crate) fn walk_from_light(self) -> bool {
        self.has(Strategy::LightTracing) || self.has(Strategy::VertexConnection)
    }
}

impl Strategies {
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

    /// Verifies that each strategy has a separate bit.
    #[test]
    fn strategies_have_distinct_bits() {
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
