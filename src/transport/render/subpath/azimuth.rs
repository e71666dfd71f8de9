//! Samples the azimuth of scattering events of polarized light in media.
//!
//! The scattered intensity depends on the azimuth if the light is polarized. Let (I, Q, U, V) be the first
//! row of the Mueller product before the event, and let φ be the rotation to the scattering plane. The
//! scattered intensity, divided by the scattered intensity of unpolarized light, is
//!
//! > 1 + (S₁₂/S₁₁) · (Q cos 2φ + U sin 2φ)/I.
//!
//! With a uniform azimuth, the weight of a subpath would contain a factor for each event. This factor is the
//! ratio above and is at most 2. The product of many factors has mean 1, but the variance of the product
//! increases exponentially with the number of factors. As a result, few paths dominate, and errors estimated
//! from the samples are too small. In a conservative Rayleigh slab of optical depth 4, the variance of the
//! transmitted intensity is 15 times that of isotropic scattering.
//!
//! The azimuth is therefore sampled in proportion to the factor. Bartel & Hielscher use rejection sampling
//! (2000, Appl. Opt. 39, 1580). This module rejects no sample, because the factors at two azimuths 90° apart
//! have the sum 2. An azimuth is accepted with probability factor/2 and is otherwise increased by 90°.

use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::polarization::frame::turn;
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// Returns, for each wavelength lane, the scattered intensity of light with the Mueller product `chain`,
/// divided by the scattered intensity of unpolarized light. The ratio is in [0, 2]. In lanes without light,
/// the ratio is 1. `d_out` and `frame` are as in [`Chain::push`]. Returns `None` if the light is unpolarized.
#[inline]
pub(super) fn factor(chain: &Chain, scatter: &Scatter, d_out: Vec3A, frame: Vec3A) -> Option<Spectral> {
    let row = match chain {
        Chain::Full(m) => &m.m[0],
        Chain::RankOne { row, row_flat: false, .. } => row,
        Chain::Rotation { .. } | Chain::RankOne { .. } => return None,
    };
    let (own, cross, s) = match scatter {
        Scatter::Depolarize(_) => return None,
        Scatter::Fresnel { block, s } => (block.a, block.b, s),
        // Particles are mirror-symmetric, so unpolarized light has no U or V after scattering.
        Scatter::Full { mueller, frame_out, .. } => (mueller.m[0][0], mueller.m[1][0], frame_out),
    };
    let (c2, s2) = turn(d_out, *s, frame);
    let across = row[1] * Spectral::splat(c2) - row[2] * Spectral::splat(s2);
    let unpolarized = row[0] * own;
    let lit = unpolarized.simd_ne(Spectral::ZERO);
    let more = across * cross / lit.select(unpolarized, Spectral::ONE);
    // Rounding errors must not make the factor negative.
    Some((Spectral::ONE + more).max(Spectral::ZERO).min(Spectral::splat(2.0)))
}

/// Returns the direction `d` rotated by 90° about the unit vector `axis`.
#[inline]
pub(super) fn quarter_turn(d: Vec3A, axis: Vec3A) -> Vec3A {
    (axis * axis.dot(d) + axis.cross(d)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::Media;
    use crate::medium::bulk::{Bulk, Optics, PhaseOptics};
    use crate::medium::henyey_greenstein::HenyeyGreenstein;
    use crate::medium::rayleigh::Rayleigh;
    use optics::polarization::elements::polarizer;
    use optics::sampling::stream::Stream;

    fn media(phase: PhaseOptics) -> Media {
        let bulk = Bulk { scattering: 1.0, index: 1.0, asymmetry: 0.0, ..Bulk::default() };
        let mut media = Media::default();
        media.push(&Optics { bulk: vec![bulk], phase });
        media
    }

    /// Verifies that the factor equals the ratio of scattered intensities that the Mueller products give.
    /// After a rotation by 90°, the factor must be 2 minus this ratio.
    #[test]
    fn factors_equal_gains() {
        let depolarizing = HenyeyGreenstein::new(Spectral::splat(0.3), 0.9, 0.8);
        for phase in [
            PhaseOptics::Rayleigh(Rayleigh::new(0.0)),
            PhaseOptics::Rayleigh(Rayleigh::new(0.1)),
            PhaseOptics::HenyeyGreenstein(depolarizing),
        ] {
            let media = media(phase);
            let (back, frame) = (Vec3A::Z, Vec3A::X);
            let mut chain = Chain::start(Spectral::new([0.3, 0.5, 0.7, 0.0]));
            assert!(factor(&chain, &media.eval(0, back, Vec3A::X), back, frame).is_none());
            let filter = Scatter::Full { mueller: polarizer(0.7), frame_out: frame, frame_in: frame };
            chain.push(&filter, back, frame);
            let mut stream = Stream::new(1, 0, 0);
            for _ in 0..1000 {
                let wi = optics::sampling::warp::sphere(stream.uniform2());
                let of = |wi: Vec3A| {
                    let scatter = media.eval(0, back, wi);
                    let factor = factor(&chain, &scatter, back, frame).expect("polarized light");
                    let mut after = chain;
                    after.push(&scatter, back, frame);
                    let gain = after.to_mueller().m[0][0].to_array();
                    let before = (chain.to_mueller().m[0][0] * scatter.m00()).to_array();
                    for lane in 0..3 {
                        let want = gain[lane] / before[lane];
                        assert!((factor.to_array()[lane] - want).abs() < 1e-5, "{wi}: {want}");
                    }
                    // Without light, the factor is 1.
                    assert_eq!(factor.to_array()[3], 1.0);
                    factor.to_array()[0]
                };
                let (one, other) = (of(wi), of(quarter_turn(wi, back)));
                assert!((one + other - 2.0).abs() < 1e-3, "{wi}: {one} and {other}");
            }
        }
    }
}
