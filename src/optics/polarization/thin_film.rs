//! Reflection by thin films on a substrate, as a Mueller block.
//!
//! Film j has index η_j = n + i·k and thickness d_j. With q_j = η_j cosθ_j = √(η_j² - sin²θ_0) (Snell), an
//! interface reflects the amplitudes
//!
//! > ρ_s = (q_i - q_j)/(q_i + q_j),  ρ_p = (η_j² q_i - η_i² q_j)/(η_j² q_i + η_i² q_j)
//!
//! From the substrate outward, Airy's recursion gives the reflected amplitude of all layers below interface
//! i–j (Born & Wolf 1999, 1.6.4 and 14.4). The recursion is equivalent to the matrix form of Byrnes (2016,
//! arXiv:1603.02720):
//!
//! > r_i = (ρ + r_j e^{2iβ_j}) / (1 + ρ r_j e^{2iβ_j}),  β_j = 2π q_j d_j/λ.
//!
//! The signs are those of [`super::fresnel::conductor`], which computes the reflection without films. Films
//! are flat, homogeneous and much thinner than the coherence length of the light.

use super::complex::Complex;
use super::fresnel::FresnelBlock;
use crate::spectrum::Spectral;
use std::f32::consts::TAU;

/// A thin film. In unused lanes, the index is 1 and the thickness is 0.
#[derive(Clone, Copy, Debug)]
pub struct Film {
    /// Real part of the refractive index.
    pub n: Spectral,
    /// Extinction coefficient k, which is positive for absorption.
    pub k: Spectral,
    /// Thickness divided by the vacuum wavelength.
    pub waves: Spectral,
}

impl Film {
    /// A film of zero thickness and index 1, which has no effect.
    pub const NONE: Self = Self { n: Spectral::ONE, k: Spectral::ZERO, waves: Spectral::ZERO };
}

/// A homogeneous layer at a given angle of incidence.
#[derive(Clone, Copy)]
struct Layer {
    /// Squared index η².
    eta2: Complex,
    /// The product η cosθ.
    q: Complex,
}

impl Layer {
    #[inline]
    fn new(n: Spectral, k: Spectral, sin2: Spectral) -> Self {
        let eta = Complex { re: n, im: k };
        let eta2 = eta * eta;
        Self { eta2, q: (eta2 - Complex::real(sin2)).sqrt() }
    }

    /// Returns the amplitudes (s, p) that the interface with the layer `below` reflects.
    #[inline]
    fn interface(&self, below: &Self) -> [Complex; 2] {
        let ratio = |a: Complex, b: Complex| (a - b) / (a + b);
        [ratio(self.q, below.q), ratio(below.eta2 * self.q, self.eta2 * below.q)]
    }

    /// Returns the phase factor e^{2iβ} of a round trip through the layer.
    #[inline]
    fn round_trip(&self, waves: Spectral) -> Complex {
        let twice = Spectral::splat(2.0) * waves;
        let turns = self.q.re * twice;
        // Remove whole periods first, because sine and cosine are most accurate near zero.
        let (sin, cos) = ((turns - turns.round()) * Spectral::splat(TAU)).sin_cos();
        let decay = (self.q.im * twice * Spectral::splat(-TAU)).exp();
        Complex { re: cos, im: sin }.scale(decay)
    }
}

/// Returns the Mueller block for reflection by `films` (outermost first) on a substrate of index n + i·k.
///
/// All indices are relative to the index of the medium outside (1 for vacuum). `cos_i` is the cosine of the
/// angle of incidence, in 0..1. The block maps the incoming s-frame to the outgoing s-frame. Phases are
/// accurate to 10⁻⁶ of a period per 10 wavelengths of optical thickness.
pub fn reflection(cos_i: f32, films: &[Film], n: Spectral, k: Spectral) -> FresnelBlock {
    let ci = Spectral::splat(cos_i.clamp(0.0, 1.0));
    let sin2 = Spectral::ONE - ci * ci;
    let mut below = Layer::new(n, k, sin2);
    let mut r = [Complex::real(Spectral::ZERO); 2];
    let one = Complex::real(Spectral::ONE);
    let airy = |above: &Layer, below: &Layer, r: [Complex; 2]| {
        let [s, p] = above.interface(below);
        [(s + r[0]) / (one + s * r[0]), (p + r[1]) / (one + p * r[1])]
    };
    for film in films.iter().rev() {
        let layer = Layer::new(film.n, film.k, sin2);
        let phase = layer.round_trip(film.waves);
        r = airy(&layer, &below, r).map(|x| x * phase);
        below = layer;
    }
    let outside = Layer { eta2: one, q: Complex::real(ci) };
    let [s, p] = airy(&outside, &below, r);
    FresnelBlock::from_amplitudes(s, p, Spectral::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polarization::fresnel;

    fn film(n: f32, k: f32, nm: f32, lambda: f32) -> Film {
        Film { n: Spectral::splat(n), k: Spectral::splat(k), waves: Spectral::splat(nm / lambda) }
    }

    fn lane0(f: FresnelBlock) -> [f32; 4] {
        [f.a, f.b, f.c, f.d].map(|e| e.to_array()[0])
    }

    fn close(got: [f32; 4], want: [f32; 4], what: &str) {
        for (g, w) in got.iter().zip(want) {
            assert!((g - w).abs() < 3e-6, "{what}: {got:?} is not {want:?}");
        }
    }

    #[test]
    fn without_films_it_is_the_bare_substrate() {
        for (n, k) in [(0.4242, 2.4721), (1.5, 0.0), (3.1, 0.2)] {
            let (ns, ks) = (Spectral::splat(n), Spectral::splat(k));
            for i in 0..=90 {
                let c = (i as f32).to_radians().cos().max(0.0);
                let bare = fresnel::conductor(c, ns, ks);
                assert_eq!(reflection(c, &[], ns, ks), bare);
                let what = format!("{n} + {k}i at {i}°");
                let thin = [film(1.38, 0.0, 0.0, 550.0), film(2.2, 0.1, 0.0, 550.0)];
                close(lane0(reflection(c, &thin, ns, ks)), lane0(bare), &what);
                // An optical thickness of half a wavelength gives a round-trip phase of 2π.
                let cos_t = (1.0 - (1.0 - c * c) / (1.38 * 1.38)).sqrt();
                let half = [film(1.38, 0.0, 550.0 / 2.0 / (1.38 * cos_t), 550.0)];
                close(lane0(reflection(c, &half, ns, ks)), lane0(bare), &what);
            }
        }
    }

    /// Compares the reflectance with ((n₀ n_s - n₁²)/(n₀ n_s + n₁²))² (Born & Wolf 1.6.4, eq. 58), which is
    /// zero for n₁² = n₀ n_s.
    #[test]
    fn a_quarter_wave_film_matches_the_textbook() {
        for (ns, n1) in [(1.52_f32, 1.38_f32), (1.52, 2.3), (1.9044, 1.38)] {
            let films = [film(n1, 0.0, 550.0 / (4.0 * n1), 550.0)];
            let [r, b, ..] = lane0(reflection(1.0, &films, Spectral::splat(ns), Spectral::ZERO));
            let want = ((ns - n1 * n1) / (ns + n1 * n1)).powi(2);
            assert!((r - want).abs() < 1e-6 && b.abs() < 1e-6, "{ns} {n1}: {r} {want}");
        }
    }

    /// Verifies that each wavelength lane has its own thickness in wavelengths (a quarter wavelength in one
    /// lane, zero in another).
    #[test]
    fn lanes_are_independent() {
        let at = |lambda: f32| {
            lane0(reflection(
                0.7,
                &[film(1.9, 0.05, 180.0, lambda)],
                Spectral::splat(1.2),
                Spectral::splat(6.6),
            ))
        };
        let waves = Spectral::new([180.0 / 450.0, 180.0 / 550.0, 180.0 / 660.0, 0.0]);
        let films = [Film { waves, ..film(1.9, 0.05, 0.0, 1.0) }];
        let f = reflection(0.7, &films, Spectral::splat(1.2), Spectral::splat(6.6));
        for (lane, lambda) in [450.0, 550.0, 660.0].into_iter().enumerate() {
            let got = [f.a, f.b, f.c, f.d].map(|e| e.to_array()[lane]);
            close(got, at(lambda), "lane");
        }
    }

    /// Compares R_s, R_p and the ellipsometric Δ in degrees (r_p/r_s = -tanψ e^{iΔ}) with the PyPI package
    /// `tmm` 0.2.0. The angles are 0°, 30°, 60° and 85°, and the wavelength is 550 nm.
    #[test]
    fn agrees_with_an_independent_program() {
        type Stack<'a> = (&'a str, &'a [Film], [f32; 2], [[f64; 3]; 4]);
        let stacks: [Stack; 5] = [
            (
                "SiO on Al",
                &[film(1.978, 0.0047, 120.0, 550.0)],
                [1.0152, 6.6273],
                [
                    [0.905000475, 0.905000475, 0.000000],
                    [0.913577329, 0.888860525, -1.850584],
                    [0.939683536, 0.816625726, -25.267802],
                    [0.987455360, 0.828050069, -133.966687],
                ],
            ),
            (
                "SiO on Ag",
                &[film(1.978, 0.0047, 85.0, 550.0)],
                [0.0596, 3.5974],
                [
                    [0.959832414, 0.959832414, 0.000000],
                    [0.958880470, 0.954026601, -6.867944],
                    [0.959834655, 0.942553705, -48.022857],
                    [0.988767284, 0.981201526, -151.736694],
                ],
            ),
            (
                "MgF2 and TiO2 on glass",
                &[film(1.38, 0.0, 99.6, 550.0), film(2.43, 0.0001, 56.5, 550.0)],
                [1.5185, 0.0],
                [
                    [0.117301772, 0.117301772, 0.000000],
                    [0.126673862, 0.117019514, 3.701056],
                    [0.229055320, 0.148041455, 54.226178],
                    [0.758931908, 0.615511153, 157.801819],
                ],
            ),
            (
                "four films on gold",
                &[
                    film(1.46, 0.0, 94.0, 550.0),
                    film(2.3, 0.002, 60.0, 550.0),
                    film(1.46, 0.0, 310.0, 550.0),
                    film(2.0, 0.3, 25.0, 550.0),
                ],
                [0.4242, 2.4721],
                [
                    [0.180881980, 0.180881980, 0.000000],
                    [0.263471518, 0.220748237, 14.426000],
                    [0.620459708, 0.552395324, 62.453322],
                    [0.937205814, 0.886609206, 156.925264],
                ],
            ),
            (
                "thick",
                &[film(1.5, 0.0, 3000.0, 550.0), film(1.33, 0.001, 2000.0, 550.0)],
                [3.1812, 3.3291],
                [
                    [0.556548910, 0.556548910, 0.000000],
                    [0.217508147, 0.235851856, 10.100719],
                    [0.687190035, 0.330042166, -41.108553],
                    [0.894453263, 0.681980657, -151.952277],
                ],
            ),
        ];
        for (name, films, [n, k], rows) in stacks {
            for (deg, [rs, rp, delta]) in [0.0_f64, 30.0, 60.0, 85.0].into_iter().zip(rows) {
                let cos = deg.to_radians().cos() as f32;
                let got = lane0(reflection(cos, films, Spectral::splat(n), Spectral::splat(k)));
                let (sin, cos) = delta.to_radians().sin_cos();
                let cross = (rs * rp).sqrt();
                let want = [(rs + rp) / 2.0, (rs - rp) / 2.0, -cross * cos, -cross * sin];
                for (g, w) in got.into_iter().zip(want) {
                    assert!((f64::from(g) - w).abs() < 1e-5, "{name} at {deg}°: {got:?} is not {want:?}");
                }
            }
        }
    }
}
