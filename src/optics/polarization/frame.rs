//! Frames of Stokes vectors. A frame is a unit vector x perpendicular to the direction of propagation d.

use glam::{Mat3A, Vec3A};

/// Returns cos 2θ and sin 2θ of the rotation from the basis vector `from` to the basis vector `to`. The light
/// travels along `d`, and angles are counter-clockwise looking toward the source. `from` and `to` are unit
/// vectors perpendicular to `d`.
#[inline]
pub fn turn(d: Vec3A, from: Vec3A, to: Vec3A) -> (f32, f32) {
    let c = to.dot(from);
    let s = to.dot(d.cross(from));
    // Renormalize to remove rounding errors of both vectors. Otherwise, long specular chains would gain or
    // lose polarization.
    let n = (c * c + s * s).max(f32::MIN_POSITIVE).recip();
    ((c * c - s * s) * n, 2.0 * c * s * n)
}

/// Returns the unit vector perpendicular to `d` in the plane of `d` and `axis`.
///
/// If `axis` and `d` are parallel (sine of the angle up to 1e-6), the world's z axis replaces `axis`. In this
/// case, if `d` is within 25.8° of z, the x axis replaces `axis` instead. An arbitrary perpendicular vector
/// would depend on the rounding errors of `d`.
#[inline]
pub fn project(axis: Vec3A, d: Vec3A) -> Vec3A {
    let x = axis - d * axis.dot(d);
    let n2 = x.length_squared();
    if n2 > 1e-12 {
        x * n2.sqrt().recip()
    } else {
        let other = if d.z.abs() < 0.9 { Vec3A::Z } else { Vec3A::X };
        (other - d * other.dot(d)).normalize_or(perpendicular(d))
    }
}

/// Returns a unit vector perpendicular to the unit vector `d` (Duff et al. 2017, "Building an orthonormal
/// basis, revisited").
#[inline]
pub fn perpendicular(d: Vec3A) -> Vec3A {
    Vec3A::from_array(perpendiculars(&d.to_array().map(|v| [v])).map(|[v]| v))
}

/// Returns the result of [`perpendicular`] for several vectors.
#[inline(always)]
pub fn perpendiculars<const N: usize>(d: &[[f32; N]; 3]) -> [[f32; N]; 3] {
    let mut out = [[0.0; N]; 3];
    for i in 0..N {
        let sign = 1.0_f32.copysign(d[2][i]);
        let a = -1.0 / (sign + d[2][i]);
        out[0][i] = 1.0 + sign * d[0][i] * d[0][i] * a;
        out[1][i] = sign * d[0][i] * d[1][i] * a;
        out[2][i] = -sign * d[0][i];
    }
    out
}

/// Returns a right-handed orthonormal basis whose third column is the unit vector `z`. The basis maps local
/// directions to the world.
#[inline]
pub fn basis(z: Vec3A) -> Mat3A {
    let x = perpendicular(z);
    Mat3A::from_cols(x, z.cross(x), z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turn_is_counter_clockwise_toward_the_source() {
        // Light travels along +z, toward a viewer on +z who sees +x right and +y up.
        let (x, d) = (Vec3A::X, Vec3A::Z);
        let to = Vec3A::new(0.5_f32.cos(), 0.5_f32.sin(), 0.0);
        let (c, s) = turn(d, x, to);
        assert!((c - 1.0_f32.cos()).abs() < 1e-6 && (s - 1.0_f32.sin()).abs() < 1e-6);
    }

    /// Verifies that an axis parallel to the ray gives the frame that CONVENTIONS.md defines, independent
    /// of rounding.
    #[test]
    fn a_parallel_axis_has_the_stated_frame() {
        for (axis, want) in [
            (Vec3A::X, Vec3A::Z),
            (Vec3A::Y, Vec3A::Z),
            (Vec3A::Z, Vec3A::X),
            (Vec3A::new(0.6, 0.8, 0.0), Vec3A::Z),
            (Vec3A::new(0.48, 0.64, 0.6), Vec3A::new(-0.36, -0.48, 0.8)),
        ] {
            for noise in [0.0, 1e-7, -1e-7] {
                for d in [axis, -axis] {
                    let d = (d + Vec3A::new(noise, -noise, noise)).normalize();
                    let got = project(axis, d);
                    assert!((got - want).length() < 1e-6, "{axis} {noise}: {got}");
                }
            }
        }
    }

    #[test]
    fn perpendicular_is_unit_and_orthogonal() {
        for d in [Vec3A::Z, -Vec3A::Z, Vec3A::X, Vec3A::new(0.6, -0.48, 0.64)] {
            let x = perpendicular(d);
            let several = perpendiculars(&d.to_array().map(|v| [v]));
            assert_eq!(several.map(|v| v[0]), x.to_array());
            assert!((x.length() - 1.0).abs() < 1e-6 && x.dot(d).abs() < 1e-6);
            let y = project(d, d);
            assert!((y.length() - 1.0).abs() < 1e-6 && y.dot(d).abs() < 1e-6);
        }
    }
}
