//! A mirror under thin films: metal or glass with up to four coatings. The model includes reflection only.
//!
//! [`thin_film::reflection`] computes the Mueller matrix. A film mainly changes the phase difference between
//! s and p reflection. This change distinguishes a protected mirror from a bare mirror.

use super::conductor::mirror;
use super::lobe::Specular;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::thin_film;
use optics::polarization::thin_film::Film;
use optics::spectrum::Spectral;

/// Maximum number of films.
pub const MAX_FILMS: usize = 4;

/// A smooth opaque substrate under films, with complex index n + i·k relative to the medium outside.
#[derive(Clone, Copy, Debug)]
pub struct CoatedConductor {
    pub n: Spectral,
    /// Imaginary part k ≥ 0 of the relative index of the substrate.
    pub k: Spectral,
    /// Films, ordered from the outside in. Only the first `count` are used.
    pub films: [Film; MAX_FILMS],
    pub count: usize,
}

impl CoatedConductor {
    #[inline]
    pub fn specular(&self, at: &Surface, wo: Vec3A) -> Option<Specular> {
        let films = &self.films[..self.count.min(MAX_FILMS)];
        mirror(at, wo, |cos| thin_film::reflection(cos, films, self.n, self.k))
    }
}
