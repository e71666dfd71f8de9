//! Scalars that summarize a Mueller matrix (Baek & Heide 2021, eqs. 14 to 16; Lu & Chipman 1996, eqs. 16 to
//! 19, 48).

use super::cloude::Matrix;
use super::lu_chipman::Parts;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Properties {
    /// Degree of polarization of the output for unpolarized input, P = |(m10, m20, m30)|/m00, 0..1.
    pub polarizance: f64,
    /// Dependence of transmittance on polarization, D = |(m01, m02, m03)|/m00, 0..1.
    pub diattenuation: f64,
    /// Retardance of the Lu–Chipman retarder in radians, R = acos(tr M_R/2 - 1), 0..π.
    pub retardance: f64,
    /// Depolarization power, Δ = 1 - |tr m_Δ|/3, 0..1.
    pub depolarization: f64,
    /// Stokes components (s1, s2, s3) of the retarder's fast axis as a unit vector. The vector is zero if R =
    /// 0. If R = π, two axes are valid, and the axis whose first nonzero component is positive is chosen.
    pub axis: [f64; 3],
}

fn length(v: [f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

impl Properties {
    /// Returns the properties of a Mueller matrix from the matrix and its Lu–Chipman factors.
    pub fn of(m: &Matrix, parts: &Parts) -> Self {
        let (r, delta) = (&parts.retarder, &parts.depolarizer);
        let trace = |m: &Matrix| m[1][1] + m[2][2] + m[3][3];
        // The vector is the axis times 2 sin R. For small R, the sine is precise and the cosine is not.
        let turn = [r[2][3] - r[3][2], r[3][1] - r[1][3], r[1][2] - r[2][1]];
        let (sin2, cos2) = (length(turn), trace(r) - 1.0);
        Self {
            polarizance: length([m[1][0], m[2][0], m[3][0]]) / m[0][0],
            diattenuation: length([m[0][1], m[0][2], m[0][3]]) / m[0][0],
            retardance: sin2.atan2(cos2),
            depolarization: 1.0 - trace(delta).abs() / 3.0,
            axis: axis(r, turn, sin2),
        }
    }
}

/// Returns the direction of the rotation axis.
fn axis(r: &Matrix, turn: [f64; 3], sin2: f64) -> [f64; 3] {
    if sin2 > 1e-6 {
        return turn.map(|t| t / sin2);
    }
    if r[1][1] + r[2][2] + r[3][3] > 1.0 {
        // There is no rotation, or the angle of the rotation is too small to determine the axis.
        return if sin2 > 1e-12 { turn.map(|t| t / sin2) } else { [0.0; 3] };
    }
    // For a rotation by 180°, m_R = 2 a aᵀ - 1. The largest column is the most precise.
    let column = |k: usize| std::array::from_fn(|i| r[i + 1][k + 1] + f64::from(u8::from(i == k)));
    let best: [f64; 3] =
        (0..3).map(column).max_by(|a, b| length(*a).total_cmp(&length(*b))).unwrap_or_default();
    let n = length(best);
    let sign = best.iter().find(|a| a.abs() > 1e-9 * n).map_or(1.0, |a| a.signum());
    best.map(|a| sign * a / n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decompose::lu_chipman::{SINGLE, decompose};
    use approx::assert_abs_diff_eq;
    use optics::polarization::elements::{polarizer, retarder};
    use std::f64::consts::{FRAC_PI_2, PI};

    fn of(m: Matrix) -> Properties {
        Properties::of(&m, &decompose(&m, SINGLE).expect("a decomposition"))
    }

    fn element(m: &optics::polarization::mueller::Mueller) -> Matrix {
        m.lane(0).map(|row| row.map(f64::from))
    }

    /// Verifies that the fast axis of a retarder at θ has the Stokes components cos 2θ, sin 2θ. The computed
    /// retardance equals the retardance of the retarder.
    #[test]
    fn retarders_have_their_fast_axis() {
        for (theta, delta) in [(0.0_f32, 0.5_f32), (0.4, 1.5), (1.2, 3.0), (0.7, 1e-3)] {
            let p = of(element(&retarder(theta, delta)));
            assert_abs_diff_eq!(p.retardance, f64::from(delta), epsilon = 2e-6);
            let want = [(2.0 * theta).cos(), (2.0 * theta).sin(), 0.0];
            for (got, want) in p.axis.iter().zip(want) {
                assert_abs_diff_eq!(*got, f64::from(want), epsilon = 1e-3);
            }
            assert_abs_diff_eq!(p.depolarization, 0.0, epsilon = 1e-6);
        }
        let half = of(element(&retarder(0.3, std::f32::consts::PI)));
        assert_abs_diff_eq!(half.retardance, PI, epsilon = 1e-6);
        assert_abs_diff_eq!(half.axis[0], 0.6_f64.cos(), epsilon = 1e-6);
    }

    #[test]
    fn polarizers_and_depolarizers() {
        let p = of(element(&polarizer(0.3)));
        assert_abs_diff_eq!(p.diattenuation, 1.0, epsilon = 1e-6);
        assert_abs_diff_eq!(p.polarizance, 1.0, epsilon = 1e-6);
        let mut m = [[0.0; 4]; 4];
        m[0][0] = 2.0;
        assert_eq!(of(m).depolarization, 1.0);
        assert_eq!((of(m).retardance, of(m).axis), (0.0, [0.0; 3]));
        m[1][1] = 1.0;
        m[2][2] = 1.0;
        m[3][3] = 1.0;
        assert_abs_diff_eq!(of(m).depolarization, 0.5, epsilon = 1e-12);
    }

    /// Verifies that a rotator by 45° is a circular retarder with a retardance of π/2.
    #[test]
    fn rotators_are_circular_retarders() {
        let r = optics::polarization::elements::rotator(std::f32::consts::FRAC_PI_4);
        let p = of(element(&r));
        assert_abs_diff_eq!(p.retardance, FRAC_PI_2, epsilon = 1e-6);
        assert_abs_diff_eq!(p.axis[2].abs(), 1.0, epsilon = 1e-6);
    }
}
