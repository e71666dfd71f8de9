//! Spatial and directional bounds of a group of lights, for the light tree.
//!
//! The bounds of position, emission directions and intensity are those of Conty Estévez & Kulla,
//! "Importance sampling of many lights with adaptive tree splitting" (2018), sect. 4.

use glam::Vec3A;
use std::f32::consts::{FRAC_PI_2, PI};

/// Bounds of one or more lights.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Minimum corner of the bounding box in world space, metres.
    pub low: Vec3A,
    /// Maximum corner of the bounding box in world space, metres.
    pub high: Vec3A,
    /// Unit axis of a cone that contains all surface normals.
    pub axis: Vec3A,
    /// Half angle of the cone that contains all normals, radians. The angle is π for normals in all
    /// directions.
    pub spread: f32,
    /// Maximum angle between a normal and a direction of emission, radians.
    pub reach: f32,
    pub two_sided: bool,
    /// Radiant intensity in the brightest direction, W/(sr nm), summed over the lights.
    pub intensity: f32,
}

impl Bounds {
    /// Returns the bounds of lights inside a box that emit in all directions.
    pub fn all_around(low: Vec3A, high: Vec3A, intensity: f32) -> Self {
        Self { low, high, axis: Vec3A::Z, spread: PI, reach: FRAC_PI_2, two_sided: false, intensity }
    }

    /// Returns the bounds of flat surfaces that have the same unit normal.
    pub fn flat(low: Vec3A, high: Vec3A, normal: Vec3A, two_sided: bool, intensity: f32) -> Self {
        Self { axis: normal, spread: 0.0, two_sided, ..Self::all_around(low, high, intensity) }
    }

    pub(crate) fn union(&self, other: &Self) -> Self {
        let (axis, spread) = self.union_of_cones(other);
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            axis,
            spread,
            reach: self.reach.max(other.reach),
            two_sided: self.two_sided || other.two_sided,
            intensity: self.intensity + other.intensity,
        }
    }

    fn union_of_cones(&self, other: &Self) -> (Vec3A, f32) {
        let (wide, narrow) = if self.spread >= other.spread { (self, other) } else { (other, self) };
        if wide.spread >= PI {
            return (wide.axis, PI);
        }
        let between = wide.axis.dot(narrow.axis).clamp(-1.0, 1.0).acos();
        if between + narrow.spread <= wide.spread {
            return (wide.axis, wide.spread);
        }
        let spread = 0.5 * (wide.spread + between + narrow.spread);
        let across = narrow.axis - wide.axis * wide.axis.dot(narrow.axis);
        let (true, Some(across)) = (spread < PI, across.try_normalize()) else {
            return (wide.axis, if between < 1e-3 { spread } else { PI });
        };
        let (sin, cos) = (spread - wide.spread).sin_cos();
        (wide.axis * cos + across * sin, spread)
    }

    /// Returns the centre of the bounding box, metres.
    pub fn centre(&self) -> Vec3A {
        (self.low + self.high) * 0.5
    }

    /// Returns the radius of the sphere through the corners of the bounding box, metres.
    pub fn radius(&self) -> f32 {
        0.5 * (self.high - self.low).length()
    }

    /// Returns the cost of a group of these lights by the surface area orientation heuristic. The cost is
    /// intensity × area of the bounding sphere × solid angle of emission.
    pub(super) fn cost(&self) -> f32 {
        let spread = self.spread;
        let end = (spread + self.reach).min(PI);
        let solid_angle = 2.0 * PI * (1.0 - spread.cos())
            + FRAC_PI_2
                * (2.0 * end * spread.sin() - (spread - 2.0 * end).cos() - 2.0 * spread * spread.sin()
                    + spread.cos());
        self.intensity * solid_angle * self.radius().powi(2)
    }
}
