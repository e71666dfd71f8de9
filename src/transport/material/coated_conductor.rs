//! Mirror under thin films: metal or glass with up to four coatings, seen in reflection alone.
//!
//! The Mueller matrix is that of [`thin_film::reflection`]. A film changes above all the phase between s and p, which is
//! what tells a protected mirror from a bare one.

use super::conductor::mirror;
use super::lobe::Specular;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::thin_film;
use optics::polarization::thin_film::Film;
use optics::spectrum::Spectral;

/// The most films a mirror can have.
pub const MAX_FILMS: usize = 4;

/// Smooth opaque substrate of complex index n + i·k, relative to the outside, under films.
#[derive(Clone, Copy, Debug)]
pub struct CoatedConductor {
    /// Real part of the index.
    pub n: Spectral,
    /// Imaginary part, ≥ 0.
    pub k: Spectral,
    /// Films from the outside in; the first `count` are there.
    pub films: [Film; MAX_FILMS],
    /// Number of films.
    pub count: usize,
}

impl CoatedConductor {
    /// The one direction there is.
    #[inline]
    #[must_use]
    pub fn specular(&self, at: &Surface, wo: Vec3A) -> Option<Specular> {
        let films = &self.films[..self.count.min(MAX_FILMS)];
        mirror(at, wo, |cos| thin_film::reflection(cos, films, self.n, self.k))
    }
}
