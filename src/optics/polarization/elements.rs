//! Ideal optical elements as Mueller matrices (equal in every lane). Angles are in radians from the frame's x
//! axis, counter-clockwise looking toward the source.

use super::mueller::Mueller;

/// Returns R(θ), which expresses Stokes vectors in a basis rotated by θ.
pub fn rotator(theta: f32) -> Mueller {
    let (s, c) = (2.0 * theta).sin_cos();
    Mueller::splat([[1., 0., 0., 0.], [0., c, s, 0.], [0., -s, c, 0.], [0., 0., 0., 1.]])
}

/// Returns R(-θ) M R(θ), which is the element M rotated by θ.
pub fn turned(element: Mueller, theta: f32) -> Mueller {
    rotator(-theta) * element * rotator(theta)
}

/// Returns the ideal linear polarizer L(θ) with the transmission axis at θ.
pub fn polarizer(theta: f32) -> Mueller {
    let p = Mueller::splat([[0.5, 0.5, 0., 0.], [0.5, 0.5, 0., 0.], [0., 0., 0., 0.], [0., 0., 0., 0.]]);
    turned(p, theta)
}

/// Returns the linear retarder with the fast axis at θ. Light along the slow axis lags by the retardance δ.
/// With δ = π/2, the retarder is the quarter-wave plate Q(θ).
pub fn retarder(theta: f32, delta: f32) -> Mueller {
    let (s, c) = delta.sin_cos();
    let r = Mueller::splat([[1., 0., 0., 0.], [0., 1., 0., 0.], [0., 0., c, s], [0., 0., -s, c]]);
    turned(r, theta)
}

/// Returns the Mueller matrix of an ideal mirror at normal incidence, with s-frames for incident and
/// reflected light. The mirror exchanges right and left circular polarization, and linear polarization at
/// +45° and −45°.
pub fn ideal_mirror() -> Mueller {
    Mueller::splat([[1., 0., 0., 0.], [0., 1., 0., 0.], [0., 0., -1., 0.], [0., 0., 0., -1.]])
}

/// Returns the ideal depolarizer, which keeps only the intensity.
pub fn depolarizer() -> Mueller {
    let mut m = Mueller::ZERO;
    m.m[0][0] = crate::spectrum::Spectral::ONE;
    m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::Spectral;
    use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

    fn stokes(s: [f32; 4]) -> [Spectral; 4] {
        s.map(Spectral::splat)
    }

    #[test]
    fn malus() {
        for i in 0..36 {
            let t = (i as f32 * 10.0).to_radians();
            let out = (polarizer(t) * polarizer(0.0)).apply(stokes([1., 0., 0., 0.]));
            assert!((out[0].to_array()[0] - 0.5 * t.cos().powi(2)).abs() < 1e-6);
        }
    }

    #[test]
    fn quarter_wave_signs() {
        let q = retarder(0.0, FRAC_PI_2).lane(0);
        assert!((q[2][3] - 1.0).abs() < 1e-6 && (q[3][2] + 1.0).abs() < 1e-6);
        let out = retarder(0.0, FRAC_PI_2).apply(stokes([1., 0., 1., 0.]));
        assert!((out[3].to_array()[0] + 1.0).abs() < 1e-6, "+45° linear becomes s3 = -1");
    }

    #[test]
    fn a_polarizer_at_45_makes_s2() {
        let out = polarizer(FRAC_PI_4).apply(stokes([1., 0., 0., 0.]));
        assert!((out[2].to_array()[0] - 0.5).abs() < 1e-6);
    }
}
