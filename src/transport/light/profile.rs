//! Angular intensity profiles of point emitters, relative to the maximum or to a frustum's axis.

use glam::{Mat3A, Vec2, Vec3A};
use optics::sampling::warp;
use std::f32::consts::{PI, TAU};

/// The angular profile of a point emitter.
#[derive(Clone, Debug, Default)]
pub enum Profile {
    /// Equal intensity in all directions.
    #[default]
    Even,
    /// A cone with full intensity within `beam`. Between `beam` and `cutoff`, the intensity decreases
    /// linearly with the angle to zero (Mitsuba's `spot`).
    Spot {
        axis: Vec3A,
        /// Half angle of the region of full intensity, radians.
        beam: f32,
        /// Half angle beyond which the intensity is zero, radians.
        cutoff: f32,
    },
    /// A table of measured intensities.
    Table(Box<Table>),
    /// A light pyramid as from a projector, with uniform irradiance over a rectangle.
    Frustum(Frustum),
}

/// Directions from a point through a rectangle, such as a projected image.
#[derive(Clone, Copy, Debug)]
pub struct Frustum {
    /// Rotation from world axes to device axes (right, down, forward).
    pub to_local: Mat3A,
    /// Half width and half height of the rectangle at a distance of 1 m, metres.
    pub half: Vec2,
}

impl Frustum {
    /// Returns the intersection of a direction with the plane of the rectangle, in coordinates relative to
    /// the rectangle. (0, 0) is the lower left corner, and (1, 1) is the upper right corner. Returns `None`
    /// for a backward direction.
    #[inline]
    pub fn uv(&self, dir: Vec3A) -> Option<Vec2> {
        let d = self.to_local * dir;
        (d.z > 0.0).then(|| 0.5 + 0.5 * Vec2::new(d.x, -d.y) / (d.z * self.half))
    }

    /// Returns the cosine between the axis and a direction through the rectangle.
    #[inline]
    fn cosine(&self, dir: Vec3A) -> Option<f32> {
        let uv = self.uv(dir)?;
        let inside = uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all();
        inside.then(|| (self.to_local * dir).z)
    }

    /// Returns the cosine between the axis and the rectangle's corners.
    pub fn corner(&self) -> f32 {
        (1.0 + self.half.length_squared()).sqrt().recip()
    }
}

/// Intensities of a luminaire relative to the maximum (IES LM-63), with linear interpolation between entries.
#[derive(Clone, Debug)]
pub struct Table {
    /// Rotation from world axes to luminaire axes. The z axis has vertical angle 0, and the x axis has
    /// horizontal angle 0.
    pub to_local: Mat3A,
    /// Vertical angles, degrees, ascending within 0..180.
    pub vertical: Vec<f32>,
    /// Horizontal angles, degrees, ascending from 0 to 0, 90, 180 or 360. Symmetry defines the values at
    /// other angles.
    pub horizontal: Vec<f32>,
    /// Relative intensities, row-major: one row of vertical angles per horizontal angle.
    pub values: Vec<f32>,
}

/// Returns the position of `x` in an ascending list as two numbers. The first is the index of the entry below
/// `x`. The second is the position of `x` between this entry (0) and the next entry (1).
fn place(list: &[f32], x: f32) -> (usize, f32) {
    let next = list.partition_point(|v| *v <= x).clamp(1, list.len().max(2) - 1);
    if list.len() < 2 {
        return (0, 0.0);
    }
    let (a, b) = (list[next - 1], list[next]);
    (next - 1, ((x - a) / (b - a)).clamp(0.0, 1.0))
}

impl Table {
    fn value(&self, dir: Vec3A) -> f32 {
        let d = self.to_local * dir;
        let theta = d.z.clamp(-1.0, 1.0).acos().to_degrees();
        let (Some(first), Some(last)) = (self.vertical.first(), self.vertical.last()) else {
            return 0.0;
        };
        if theta < *first || theta > *last {
            return 0.0;
        }
        let mut phi = d.y.atan2(d.x).to_degrees().rem_euclid(360.0);
        let end = self.horizontal.last().copied().unwrap_or(0.0);
        if end <= 0.0 {
            phi = 0.0;
        } else if end < 360.0 {
            // Mirror the angle in the plane of 0° and 180°, and if necessary in the plane of 90° and 270°.
            phi = phi.min(360.0 - phi);
            if end <= 90.0 {
                phi = phi.min(180.0 - phi);
            }
        }
        let ((i, s), (j, t)) = (place(&self.horizontal, phi), place(&self.vertical, theta));
        let n = self.vertical.len();
        let at = |i: usize, j: usize| {
            let (i, j) = (i.min(self.horizontal.len() - 1), j.min(n - 1));
            self.values[i * n + j]
        };
        let row = |i: usize| at(i, j) * (1.0 - t) + at(i, j + 1) * t;
        row(i) * (1.0 - s) + row(i + 1) * s
    }
}

impl Profile {
    /// Returns the relative intensity along the unit direction `dir`.
    #[inline]
    pub fn value(&self, dir: Vec3A) -> f32 {
        match self {
            Self::Even => 1.0,
            Self::Spot { axis, beam, cutoff } => {
                let angle = axis.cross(dir).length().atan2(axis.dot(dir));
                if angle >= *cutoff {
                    0.0
                } else if angle <= *beam {
                    1.0
                } else {
                    (cutoff - angle) / (cutoff - beam)
                }
            }
            Self::Table(table) => table.value(dir),
            Self::Frustum(frustum) => frustum.cosine(dir).map_or(0.0, |cos| cos.powi(-3)),
        }
    }

    /// Samples a direction in which the profile may emit light.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> Vec3A {
        match self {
            Self::Even | Self::Table(_) => warp::sphere(u),
            Self::Spot { axis, cutoff, .. } => cone(*axis, cutoff.cos(), u),
            Self::Frustum(frustum) => {
                let at = (2.0 * Vec2::from_array(u) - 1.0) * frustum.half;
                frustum.to_local.transpose() * at.extend(1.0).to_vec3a().normalize()
            }
        }
    }

    /// Returns the probability density of [`Self::sample`] per steradian.
    #[inline]
    pub fn density(&self, dir: Vec3A) -> f32 {
        match self {
            Self::Even | Self::Table(_) => 0.25 / PI,
            Self::Spot { axis, cutoff, .. } => {
                let least = cutoff.cos();
                if axis.dot(dir) >= least { 1.0 / (TAU * (1.0 - least)) } else { 0.0 }
            }
            Self::Frustum(Frustum { half, .. }) => self.value(dir) / (4.0 * half.x * half.y),
        }
    }

    /// Returns the integral of [`Self::value`] over all directions, steradians.
    pub fn solid_angle(&self) -> f32 {
        const N: usize = 128;
        if let Self::Even = self {
            return 4.0 * PI;
        }
        let at = |i: usize| (i as f32 + 0.5) / N as f32;
        let value = |k: usize| {
            let dir = self.sample([at(k % N), at(k / N)]);
            self.value(dir) / self.density(dir).max(f32::MIN_POSITIVE)
        };
        (0..N * N).map(|k| f64::from(value(k))).sum::<f64>() as f32 / (N * N) as f32
    }
}

/// Samples a direction uniformly in a cone with minimum cosine `least` about a unit axis.
#[inline]
pub fn cone(axis: Vec3A, least: f32, [u, v]: [f32; 2]) -> Vec3A {
    let cos = 1.0 - u * (1.0 - least);
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let (s, c) = warp::sin_cos_turns(v);
    let frame = optics::polarization::frame::basis(axis);
    (frame * Vec3A::new(sin * c, sin * s, cos)).normalize()
}
