//! The medium along a ray: refractive index, and material index of the crystal.

/// The medium along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filling {
    /// Refractive index, for the optical path length.
    pub index: f32,
    /// Material index of the [crystal](super::crystal), or [`NO_CRYSTAL`].
    pub crystal: u32,
}

/// Value of [`Filling::crystal`] for a medium that does not change polarization.
pub const NO_CRYSTAL: u32 = u32::MAX;

impl Filling {
    /// The medium outside all objects.
    pub const VACUUM: Self = Self::clear(1.0);

    /// Returns an isotropic medium with the given refractive index.
    #[inline]
    pub const fn clear(index: f32) -> Self {
        Self { index, crystal: NO_CRYSTAL }
    }
}
