//! Shading data of a triangle: corner, edges, normal and tangent. One SIMD load reads each vector.
//!
//! The tangent ∂p/∂u solves e = u·∂p/∂u + v·∂p/∂v for each edge e, where (u, v) is the difference of
//! texture coordinates along the edge.

use super::quadric::normalized_slope;
use super::rounding;
use bytemuck::{Pod, Zeroable};
use glam::{Mat3A, Vec3A, Vec4};

/// A triangle. The fourth component of each vector is an index ([`INDEX`]).
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Triangle {
    /// First corner, metres. The fourth component is the material.
    pub(super) v0: [f32; 4],
    /// Edges to the other corners, metres. The fourth components are the indices of the first two corners
    /// into `normals`. The first index is `u32::MAX` for a flat triangle.
    pub(super) e1: [f32; 4],
    pub(super) e2: [f32; 4],
    /// Unit normal. The fourth component is the index of the third corner into `normals`.
    pub(super) normal: [f32; 4],
    /// ∂p/∂u up to a positive factor. The fourth component is the index of the first corner into `uvs`, or
    /// `u32::MAX` without texture coordinates.
    pub(super) tangent: [f32; 4],
    /// Indices of the second and third corner into `uvs`.
    uvs: [u32; 2],
    /// Rounding constant (see [`Surface::rounding`](super::ray::Surface::rounding)).
    pub(super) rounding: f32,
}

/// Mask that is XORed with an index stored in the fourth component of a vector. Vector arithmetic includes
/// the fourth component, and small integers would be slow denormal numbers.
const INDEX: u32 = 0x4000_0000;

#[inline(always)]
fn index(row: &[f32; 4]) -> u32 {
    row[3].to_bits() ^ INDEX
}

/// Returns the first three components of a row as a vector.
#[inline(always)]
pub(super) fn vector(row: [f32; 4]) -> Vec3A {
    Vec3A::from_vec4(Vec4::from_array(row))
}

impl Triangle {
    /// Creates a triangle. `uvs` are the texture coordinates of the corners. `normals` and `uv_indices` are
    /// in the format of the results of [`Self::normals`] and [`Self::uvs()`].
    pub(super) fn new(
        corners: [Vec3A; 3],
        uvs: Option<[[f32; 2]; 3]>,
        normals: [u32; 3],
        uv_indices: [u32; 3],
        material: u32,
    ) -> Self {
        let [v0, e1, e2] = [corners[0], corners[1] - corners[0], corners[2] - corners[0]];
        let tangent = uvs.map_or(e1, |[a, b, c]| {
            let ([u1, v1], [u2, v2]) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
            // Solve e = u·∂p/∂u + v·∂p/∂v for both edges. The caller needs only the direction, so the sign of
            // the determinant is sufficient.
            (e1 * v2 - e2 * v1) * (u1 * v2 - u2 * v1).signum()
        });
        let row = |v: Vec3A, index: u32| v.extend(f32::from_bits(index ^ INDEX)).to_array();
        Self {
            v0: row(v0, material),
            e1: row(e1, normals[0]),
            e2: row(e2, normals[1]),
            normal: row(e1.cross(e2).normalize(), normals[2]),
            tangent: row(tangent, uv_indices[0]),
            uvs: [uv_indices[1], uv_indices[2]],
            rounding: rounding::of_triangle(e1, e2),
        }
    }

    /// Translates the triangle by `by`, metres.
    pub(super) fn shift(&mut self, by: Vec3A) {
        for (v, by) in self.v0.iter_mut().zip(by.to_array()) {
            *v += by;
        }
    }

    #[inline(always)]
    pub(super) fn material(&self) -> u32 {
        index(&self.v0)
    }

    /// Returns ∂p/∂u and ∂p/∂v of the texture coordinates, or of the barycentric coordinates if there are
    /// no texture coordinates. The derivatives are 0 for degenerate texture coordinates.
    pub(super) fn derivatives(&self, uvs: &[[f32; 2]]) -> [Vec3A; 2] {
        let [e1, e2] = [self.e1, self.e2].map(vector);
        let Some(corners) = self.uvs() else {
            return [e1, e2];
        };
        let [a, b, c] = corners.map(|i| uvs[i as usize]);
        let ([u1, v1], [u2, v2]) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        let det = u1 * v2 - u2 * v1;
        if det == 0.0 {
            return [Vec3A::ZERO; 2];
        }
        [(e1 * v2 - e2 * v1) / det, (e2 * u1 - e1 * u2) / det]
    }

    /// Returns the indices of the corners into `normals`, or `None` for a flat triangle.
    #[inline(always)]
    pub(super) fn normals(&self) -> Option<[u32; 3]> {
        let [a, b, c] = [index(&self.e1), index(&self.e2), index(&self.normal)];
        (a != u32::MAX).then_some([a, b, c])
    }

    /// Returns the indices of the corners into `uvs`, or `None` if there are no texture coordinates.
    #[inline(always)]
    pub(super) fn uvs(&self) -> Option<[u32; 3]> {
        let a = index(&self.tangent);
        (a != u32::MAX).then_some([a, self.uvs[0], self.uvs[1]])
    }
}

/// Returns the derivative of the unit shading normal with respect to the position on a triangle. The
/// arguments are corner normals, edges and barycentric coordinates. `ns` sets the sign of the normal.
#[inline]
pub(super) fn bend([a, b, c]: [Vec3A; 3], [e1, e2]: [Vec3A; 2], [u, v]: [f32; 2], ns: Vec3A) -> Mat3A {
    let n = e1.cross(e2);
    let area2 = n.length_squared();
    // Compute the gradients of the barycentric coordinates.
    let (du, dv) = (e2.cross(n) / area2, n.cross(e1) / area2);
    let raw = a * (1.0 - u - v) + b * u + c * v;
    let column = |k: usize| (b - a) * du[k] + (c - a) * dv[k];
    let slope = normalized_slope(raw, Mat3A::from_cols(column(0), column(1), column(2)));
    if raw.dot(ns) < 0.0 { slope * -1.0 } else { slope }
}
