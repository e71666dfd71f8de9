//! Normals from polarization, with a 180° ambiguity (Atkinson & Hancock 2006; Kadambi et al. 2015;
//! Baek et al. 2018).
//!
//! A surface under unpolarized light gives Stokes vectors (s0, s1, s2) = (T00, T10, T20). The degree √(s1² +
//! s2²)/s0 gives the zenith angle from the view direction ([`super::zenith`]). For diffuse light from below
//! the surface, the angle ½ atan2(s2, s1) is the azimuth of the normal. For specular reflection, the azimuth
//! differs from this angle by 90°. Each azimuth has a 180° ambiguity.
//!
//! Angles refer to the pixel's frame (`CONVENTIONS.md`). Let d be the propagation direction of the light. The
//! first axis x is the camera's x axis, projected onto the plane perpendicular to the ray. The second axis is
//! d × x, so angles increase counter-clockwise in the image.
//!
//! If the projector is near the camera, one specular reflection reverses the handedness of circular
//! polarization, so T33 = -T00. Diffuse light is not circularly polarized (Baek et al. 2018). T00 + T33
//! therefore contains only the diffuse light.

use super::zenith;
use crate::map::Map;
use crate::pinhole::Pinhole;
use nalgebra::Vector3;
use std::f64::consts::FRAC_PI_2;

/// The component of the reflected light whose polarization is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reflection {
    /// Diffuse light that leaves the object through the surface.
    Diffuse,
    /// Specular light at zenith angles below Brewster's angle.
    Specular,
}

/// The polarization cues of every pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Cues {
    /// Degree of polarization, zenith angle from the view direction, and azimuth (modulo 180°) of the normal.
    /// The angles are in radians. Dark pixels are NaN.
    pub angles: Map,
}

/// Returns the Stokes vectors (s0, s1, s2) under unpolarized light, from Mueller matrices (16 channels, row
/// by row).
///
/// `mirrored_off` excludes specular reflection from s0: s0 = T00 - max(0, -T33).
pub fn stokes(mueller: &Map, mirrored_off: bool) -> Map {
    Map::from_fn(mueller.width, mueller.height, 3, |x, y, out| {
        let m = mueller.at(x, y);
        let part = |i: usize| m.get(i).copied().unwrap_or(f64::NAN);
        let mirrored = if mirrored_off { (-part(15)).max(0.0) } else { 0.0 };
        out.copy_from_slice(&[part(0) - mirrored, part(4), part(8)]);
    })
}

/// Returns the angles from Stokes vectors for a surface of refractive index `n`.
pub fn cues(stokes: &Map, n: f64, reflection: Reflection) -> Cues {
    let angles = Map::from_fn(stokes.width, stokes.height, 3, |x, y, out| {
        let s = stokes.at(x, y);
        if s[0].is_nan() || s[0] <= 0.0 {
            out.fill(f64::NAN);
            return;
        }
        let degree = s[1].hypot(s[2]) / s[0];
        let angle = 0.5 * s[2].atan2(s[1]);
        out.copy_from_slice(&match reflection {
            Reflection::Diffuse => [degree, zenith::of_diffuse(degree, n), angle],
            Reflection::Specular => [degree, zenith::of_specular(degree, n)[0], angle + FRAC_PI_2],
        });
    });
    Cues { angles }
}

/// Returns the frame of the light that reaches a pixel. The frame consists of the axes x and d × x, and the
/// propagation direction d toward the camera.
pub fn frame(camera: &Pinhole, x: usize, y: usize) -> [Vector3<f64>; 3] {
    let d = -camera.centre(x, y).normalize();
    let horizontal = (Vector3::x() - d * d.x).normalize();
    [horizontal, d.cross(&horizontal), d]
}

/// Returns the normal of a pixel in the camera's frame, from the zenith angle to the view direction and the
/// azimuth.
pub fn normal(camera: &Pinhole, [x, y]: [usize; 2], zenith: f64, azimuth: f64) -> Vector3<f64> {
    let [right, up, d] = frame(camera, x, y);
    d * zenith.cos() + (right * azimuth.cos() + up * azimuth.sin()) * zenith.sin()
}

/// Returns the two candidate normals of a pixel, or NaN if the pixel has no cues.
pub fn candidates(camera: &Pinhole, cues: &Cues, at: [usize; 2]) -> [Vector3<f64>; 2] {
    let angles = cues.angles.at(at[0], at[1]);
    [0.0, std::f64::consts::PI].map(|turn| normal(camera, at, angles[1], angles[2] + turn))
}

/// Returns the candidates closest to approximate normals, such as the normals of a coarse scan. Pixels
/// without an approximate normal are NaN.
pub fn nearest(camera: &Pinhole, cues: &Cues, guess: &Map) -> Map {
    Map::from_fn(guess.width, guess.height, 3, |x, y, out| {
        let guess = Vector3::from_column_slice(guess.at(x, y));
        let [a, b] = candidates(camera, cues, [x, y]);
        let (by_a, by_b) = (a.dot(&guess), b.dot(&guess));
        let chosen = if by_b > by_a { b } else { a };
        if by_a.is_finite() && by_b.is_finite() {
            out.copy_from_slice(chosen.as_slice());
        } else {
            out.fill(f64::NAN);
        }
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::shape::synthetic::{Shape, rig};

    /// Returns the Mueller matrices of a smooth dielectric for this reflection component, in each pixel's
    /// frame. The degree of polarization follows from the Fresnel equations.
    pub fn mueller(camera: &Pinhole, shape: &Shape, n: f64, reflection: Reflection) -> Map {
        Map::from_fn(shape.normals.width, shape.normals.height, 16, |x, y, out| {
            let normal = Vector3::from_column_slice(shape.normals.at(x, y));
            let [right, up, d] = frame(camera, x, y);
            let cos = normal.dot(&d);
            let degree = match reflection {
                Reflection::Diffuse => zenith::diffuse(cos.acos(), n),
                // The plane of polarization is perpendicular to the plane of the normal.
                Reflection::Specular => -zenith::specular(cos.acos(), n),
            };
            // (cos 2α, sin 2α) is computed from the components of the normal, without computing α.
            let (a, b) = (normal.dot(&right), normal.dot(&up));
            let length = (a * a + b * b).max(1e-300);
            out[0] = cos;
            out[4] = cos * degree * (a * a - b * b) / length;
            out[8] = cos * degree * 2.0 * a * b / length;
        })
    }

    #[test]
    fn a_spheres_normals_are_one_of_two_candidates() {
        let camera = rig(64, 256).camera;
        let shape = Shape::sphere(&camera, 0.04);
        for reflection in [Reflection::Diffuse, Reflection::Specular] {
            let matrices = mueller(&camera, &shape, 1.5, reflection);
            let cues = cues(&stokes(&matrices, false), 1.5, reflection);
            let mut seen = 0;
            for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
                let want = Vector3::from_column_slice(shape.normals.at(x, y));
                let zenith = want.dot(&frame(&camera, x, y)[2]).acos();
                // Above Brewster's angle, the result for specular reflection is the smaller of the two zenith
                // angles.
                if zenith.is_nan() || (reflection == Reflection::Specular && zenith > 0.97) {
                    continue;
                }
                seen += 1;
                assert!((cues.angles.at(x, y)[1] - zenith).abs() < 1e-6);
                let nearest = candidates(&camera, &cues, [x, y]).map(|c| (c - want).norm());
                assert!(nearest[0].min(nearest[1]) < 2e-6, "{x} {y}: {nearest:?}");
            }
            assert!(seen > 800, "{seen}");
        }
    }

    /// Tests the handedness of the azimuth. The second axis of the frame points up, so s2 > 0 for a normal to
    /// the upper right.
    #[test]
    fn a_normal_to_the_upper_right_has_positive_s2() {
        let camera = rig(64, 256).camera;
        let up_right = normal(&camera, [32, 32], 0.5, std::f64::consts::FRAC_PI_4);
        assert!(up_right.x > 0.1 && up_right.y < -0.1 && up_right.z < -0.8, "{up_right}");
    }

    #[test]
    fn a_coarse_scan_resolves_the_half_turn_everywhere() {
        let camera = rig(64, 256).camera;
        let shape = Shape::sphere(&camera, 0.04);
        let matrices = mueller(&camera, &shape, 1.5, Reflection::Diffuse);
        let cues = cues(&stokes(&matrices, false), 1.5, Reflection::Diffuse);
        // Approximate normals that are rotated by 20 degrees about the view direction are sufficient,
        // except for normals that point toward the camera.
        let (sin, cos) = 20.0_f64.to_radians().sin_cos();
        let mut guess = shape.normals.clone();
        for n in guess.data.chunks_mut(3) {
            (n[0], n[1]) = (cos * n[0] - sin * n[1], sin * n[0] + cos * n[1]);
        }
        let got = nearest(&camera, &cues, &guess);
        let mut seen = 0;
        for (got, want) in got.data.chunks(3).zip(shape.normals.data.chunks(3)) {
            assert_eq!(got[0].is_nan(), want[0].is_nan());
            if want[0].is_finite() && want[0].hypot(want[1]) > 0.3 {
                seen += 1;
                let off: f64 = got.iter().zip(want).map(|(g, w)| (g - w).powi(2)).sum();
                assert!(off < 1e-10, "{got:?} {want:?}");
            }
        }
        assert!(seen > 500, "{seen}");
    }

    #[test]
    fn mirrored_light_is_left_out_of_the_intensity() {
        let mut m = [0.0; 16];
        (m[0], m[4], m[8], m[15]) = (3.0, 0.2, 0.1, -1.0);
        let matrix = Map::from_fn(1, 1, 16, |_, _, o| o.copy_from_slice(&m));
        assert_eq!(stokes(&matrix, true).data, [2.0, 0.2, 0.1]);
        assert_eq!(stokes(&matrix, false).data, [3.0, 0.2, 0.1]);
        let dark = Map::from_fn(1, 1, 3, |_, _, _| {});
        assert!(cues(&dark, 1.5, Reflection::Diffuse).angles.data[0].is_nan());
    }
}
