//! Mirror under thin films: metal or glass with up to four coatings, in reflection only.
//!
//! The Mueller matrix is that of [`thin_film::reflection`]. A film mainly changes the phase between s and p,
//! which distinguishes a protected mirror from a bare one.

use super::conductor::mirror;
use super::lobe::Specular;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::thin_film;
use optics::polarization::thin_film::Film;
use optics::spectrum::Spectral;

/// Maximum number of films.
pub const MAX_FILMS: usize = 4;

/// Smooth opaque substrate under films, with the complex index n + i·k relative to the outside.
#[derive(Clone, Copy, Debug)]
pub struct CoatedConductor {
    pub n: Spectral,
    /// Imaginary part k ≥ 0 of the substrate's index.
    pub k: Spectral,
    /// Films from the outside in; only the first `count` are used.
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
