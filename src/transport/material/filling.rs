//! What fills the space that a ray runs through: its refractive index, and the crystal that turns polarization on the way.

/// The medium that a ray runs through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filling {
    /// Refractive index, which sets the optical path length.
    pub index: f32,
    /// Number of the [crystal](super::crystal) that fills it, or [`NO_CRYSTAL`].
    pub crystal: u32,
}

/// [`Filling::crystal`] of what does not act on polarization.
pub const NO_CRYSTAL: u32 = u32::MAX;

impl Filling {
    /// Outside of everything.
    pub const VACUUM: Self = Self::clear(1.0);

    /// A medium that only slows light down.
    #[inline]
    #[must_use]
    pub const fn clear(index: f32) -> Self {
        Self {
            index,
            crystal: NO_CRYSTAL,
        }
    }
}
