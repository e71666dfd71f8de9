//! Mirrors in groups with too many instances to list. To sample a point, the code first samples the instance
//! and then samples a point of the instance.

use crate::geometry::bvh::Outline;
use glam::{Affine3A, Vec3A};
use optics::sampling::warp;

/// The mirrors of groups, and the transforms of the instances of the groups.
#[derive(Debug, Default)]
pub(crate) struct Copied {
    /// Group, transform to the world, and cumulative area (m²) of each instance.
    copies: Vec<(u32, Affine3A, f32)>,
    /// The mirrors of each group in group coordinates, with their cumulative areas (m²).
    groups: Vec<Vec<(Outline, f32)>>,
}

impl Copied {
    pub fn new(groups: Vec<Vec<Outline>>, copies: impl Iterator<Item = (u32, Affine3A)>) -> Self {
        let summed = |outlines: Vec<Outline>| {
            let mut all = 0.0;
            let sum = |o: Outline| {
                all += area(&o);
                (o, all)
            };
            outlines.into_iter().map(sum).collect::<Vec<_>>()
        };
        let groups: Vec<Vec<(Outline, f32)>> = groups.into_iter().map(summed).collect();
        let mut all = 0.0;
        let copies = copies.filter_map(|(group, place)| {
            // The area factor `grown` is exact for a uniform scale. An approximation suffices for all other
            // maps.
            let grown = place.matrix3.determinant().abs().powf(2.0 / 3.0);
            all += groups[group as usize].last()?.1 * grown;
            Some((group, place, all))
        });
        Self { copies: copies.collect(), groups }
    }

    /// Returns the approximate total area of all instances, m².
    pub fn area(&self) -> f32 {
        self.copies.last().map_or(0.0, |c| c.2)
    }

    /// Returns the point at cumulative area `at` (m²). `part` and `uniforms` are uniform random numbers in
    /// [0, 1). There must be at least one instance.
    pub fn point(&self, at: f32, part: f32, uniforms: [f32; 2]) -> Vec3A {
        let i = self.copies.partition_point(|c| c.2 <= at);
        let (group, place, _) = self.copies[i.min(self.copies.len() - 1)];
        let parts = &self.groups[group as usize];
        let at = part * parts.last().map_or(0.0, |p| p.1);
        let i = parts.partition_point(|p| p.1 <= at);
        place.transform_point3a(point_on(&parts[i.min(parts.len() - 1)].0, uniforms))
    }
}

/// Returns the approximate area of an outline, m².
pub(super) fn area(outline: &Outline) -> f32 {
    match outline {
        Outline::Flat { corners: [a, b, c, d] } => {
            0.5 * ((*b - *a).cross(*c - *a).length() + (*c - *a).cross(*d - *a).length())
        }
        Outline::Ball { radius, .. } | Outline::Inside { radius, .. } => {
            4.0 * std::f32::consts::PI * radius * radius
        }
    }
}

pub(super) fn ends(outline: &Outline) -> (Vec3A, Vec3A) {
    match outline {
        Outline::Flat { corners } => {
            corners[1..].iter().fold((corners[0], corners[0]), |(lo, hi), c| (lo.min(*c), hi.max(*c)))
        }
        Outline::Ball { centre, radius } | Outline::Inside { centre, radius } => {
            (*centre - *radius, *centre + *radius)
        }
    }
}

/// Returns a point on an outline. `uniforms` are uniform random numbers in [0, 1).
pub(super) fn point_on(outline: &Outline, uniforms: [f32; 2]) -> Vec3A {
    match *outline {
        Outline::Flat { corners: [a, b, c, d] } => {
            let [mut u, mut v] = uniforms;
            if c == d && u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            a + (b - a) * u + (d - a) * v
        }
        Outline::Ball { centre, radius } | Outline::Inside { centre, radius } => {
            centre + warp::sphere(uniforms) * radius
        }
    }
}
