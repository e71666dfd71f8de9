//! Fresnel's equations as Mueller matrices. The s direction is the first basis axis of all Stokes vectors.
//!
//! In that basis, reflection and refraction at a smooth isotropic interface have block form (Collett 2005,
//! ch. 8; Wilkie & Weidlich 2012): `[[a, b, 0, 0], [b, a, 0, 0], [0, 0, c, d], [0, 0, -d, c]]`. The signs are
//! those of Mitsuba 3. The tests compare with numbers from Mitsuba 3.

use super::complex::Complex;
use super::mueller::Mueller;
use crate::spectrum::Spectral;

/// A Fresnel Mueller matrix in block form, in its s-frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FresnelBlock {
    /// Elements M00 = M11: mean of the s and p power coefficients.
    pub a: Spectral,
    /// Elements M01 = M10: half the difference of the power coefficients, s minus p.
    pub b: Spectral,
    /// Elements M22 = M33.
    pub c: Spectral,
    /// Elements M23 = -M32.
    pub d: Spectral,
}

impl FresnelBlock {
    /// Creates a block from the complex amplitude coefficients of s and p and a common power factor.
    #[inline]
    pub(super) fn from_amplitudes(s: Complex, p: Complex, factor: Spectral) -> Self {
        let half = Spectral::HALF;
        let (rs, rp) = (s.norm2(), p.norm2());
        let cross = s.conj() * p;
        Self {
            a: (rs + rp) * half * factor,
            b: (rs - rp) * half * factor,
            c: cross.re * factor,
            d: cross.im * factor,
        }
    }

    #[inline]
    pub fn scaled(self, f: Spectral) -> Self {
        Self { a: self.a * f, b: self.b * f, c: self.c * f, d: self.d * f }
    }

    #[inline]
    pub fn to_mueller(self) -> Mueller {
        let z = Spectral::ZERO;
        Mueller {
            m: [
                [self.a, self.b, z, z],
                [self.b, self.a, z, z],
                [z, z, self.c, self.d],
                [z, z, -self.d, self.c],
            ],
        }
    }
}

/// Returns the Mueller block for reflection by a conductor with the complex relative index `n + i·k` (k > 0
/// for absorption). `cos_i` is the cosine of the angle of incidence, in 0..1. The block maps the incoming
/// s-frame to the outgoing s-frame.
#[inline]
pub fn conductor(cos_i: f32, n: Spectral, k: Spectral) -> FresnelBlock {
    let ci = Spectral::splat(cos_i.clamp(0.0, 1.0));
    let eta = Complex { re: n, im: k };
    let eta2 = eta * eta;
    let sin2 = Spectral::ONE - ci * ci;
    // Compute η cosθ_t = √(η² - sin²θ_i), which takes one square root instead of a complex division.
    let root = (eta2 - Complex::real(sin2)).sqrt();
    let ci_c = Complex::real(ci);
    let r_s = (ci_c - root) / (ci_c + root);
    let (num, den) = (eta2.scale(ci) - root, eta2.scale(ci) + root);
    let r_p = num / den;
    FresnelBlock::from_amplitudes(r_s, r_p, Spectral::ONE)
}

/// Mueller blocks of reflection and transmission at a smooth dielectric interface.
#[derive(Clone, Copy, Debug)]
pub struct DielectricFresnel {
    /// Mueller block of reflection.
    pub reflection: FresnelBlock,
    /// Mueller block of *power* transmission (without radiance scaling). The block is zero under total
    /// internal reflection.
    pub transmission: FresnelBlock,
}

/// Returns the Mueller blocks of a smooth dielectric interface. `eta` is the refractive index on the far side
/// divided by the refractive index on the side of incidence. `cos_i` is the cosine of the angle of incidence,
/// in 0..1.
#[inline]
pub fn dielectric(cos_i: f32, eta: Spectral) -> DielectricFresnel {
    dielectric_per_lane(Spectral::splat(cos_i), eta)
}

/// Returns the blocks as [`dielectric`] does, with an angle of incidence for each wavelength.
#[inline]
pub fn dielectric_per_lane(cos_i: Spectral, eta: Spectral) -> DielectricFresnel {
    let ci = cos_i.max(Spectral::ZERO).min(Spectral::ONE);
    let eta2 = eta * eta;
    let sin2 = Spectral::ONE - ci * ci;
    // Under total internal reflection, the root is imaginary and the wave is evanescent.
    let root = Complex::real(eta2 - sin2).sqrt();
    let ci_c = Complex::real(ci);
    let r_s = (ci_c - root) / (ci_c + root);
    let r_p = (Complex::real(eta2 * ci) - root) / (Complex::real(eta2 * ci) + root);
    let reflection = FresnelBlock::from_amplitudes(r_s, r_p, Spectral::ONE);
    let two = Spectral::splat(2.0);
    let t_s = Complex::real(two * ci / (ci + root.re));
    let t_p = Complex::real(two * eta * ci / (eta2 * ci + root.re));
    // The power factor is n_t cosθ_t / (n_i cosθ_i) = root / cosθ_i. Under total internal reflection, root.re
    // is zero.
    let factor = root.re / ci.max(Spectral::splat(1e-12));
    let transmission = FresnelBlock::from_amplitudes(t_s, t_p, factor);
    DielectricFresnel { reflection, transmission }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lane0(f: FresnelBlock) -> [f32; 4] {
        [f.a, f.b, f.c, f.d].map(|e| e.to_array()[0])
    }

    fn close(got: [f32; 4], want: [f32; 4]) {
        for (g, w) in got.iter().zip(want) {
            assert!((g - w).abs() < 2e-6, "{got:?} is not {want:?}");
        }
    }

    fn cos(deg: f32) -> f32 {
        deg.to_radians().cos()
    }

    #[test]
    fn gold_at_60_degrees_matches_mitsuba() {
        let f = conductor(cos(60.0), Spectral::splat(0.4242), Spectral::splat(2.4721));
        close(lane0(f), [0.792_257, 0.102_981, -0.406_951, -0.671_906]);
        let m = f.to_mueller().lane(0);
        assert!((m[3][2] - 0.671_906).abs() < 2e-6);
    }

    #[test]
    fn glass_matches_mitsuba() {
        let f = dielectric(cos(45.0), Spectral::splat(1.5));
        close(lane0(f.reflection), [0.050_239_9, 0.041_773_5, -0.027_911_1, 0.0]);
        let f = dielectric(1.0, Spectral::splat(1.5));
        close(lane0(f.reflection), [0.04, 0.0, -0.04, 0.0]);
        close(lane0(f.transmission), [0.96, 0.0, 0.96, 0.0]);
        let f = dielectric(cos(60.0), Spectral::splat(1.0 / 1.5));
        close(lane0(f.reflection), [1.0, 0.0, 0.760_87, -0.648_905]);
        close(lane0(f.transmission), [0.0; 4]);
    }

    #[test]
    fn brewster_reflects_no_p() {
        let f = dielectric(1.5_f32.atan().cos(), Spectral::splat(1.5)).reflection;
        let [a, b, ..] = lane0(f);
        assert!((a - b).abs() < 1e-7, "all reflected light is s-polarized: {a} {b}");
    }

    #[test]
    fn total_reflection_has_the_textbook_retardance() {
        // The phase δ between s and p is given by tan(δ/2) = cosθ √(sin²θ - n²) / sin²θ (Born & Wolf 1.5.4).
        for deg in [45.0_f32, 51.3, 60.0, 75.0] {
            let n = 1.0 / 1.5_f32;
            let (s, c) = deg.to_radians().sin_cos();
            let delta = 2.0 * (c * (s * s - n * n).sqrt() / (s * s)).atan();
            let [a, _, cc, d] = lane0(dielectric(c, Spectral::splat(n)).reflection);
            assert!((a - 1.0).abs() < 1e-5);
            assert!((cc.acos() - delta).abs() < 1e-3, "{deg}: {} {delta}", cc.acos());
            assert!((d.abs() - delta.sin()).abs() < 1e-3);
        }
    }

    #[test]
    fn energy_is_conserved_and_directions_agree() {
        for i in 1..90 {
            let c = cos(i as f32);
            let f = dielectric(c, Spectral::splat(1.5));
            let (r, t) = (lane0(f.reflection), lane0(f.transmission));
            assert!((r[0] + t[0] - 1.0).abs() < 1e-5);
            let ct = (1.0 - (1.0 - c * c) / 2.25).sqrt();
            let back = lane0(dielectric(ct, Spectral::splat(1.0 / 1.5)).transmission);
            for k in 0..4 {
                assert!((t[k] - back[k]).abs() < 1e-4, "Stokes reversibility at {i}°");
            }
        }
    }

    #[test]
    fn grazing_light_is_reflected() {
        let f = dielectric(0.0, Spectral::splat(1.5));
        assert!((lane0(f.reflection)[0] - 1.0).abs() < 1e-6);
        assert!(lane0(f.transmission).iter().all(|x| x.is_finite() && x.abs() < 1e-6));
        assert!(lane0(conductor(0.0, Spectral::splat(0.2), Spectral::splat(3.0)))[0] > 0.999_99);
    }
}
