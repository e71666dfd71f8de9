//! Polarization of emitted light.
//!
//! The product of Mueller matrices along each path ends at the emitter. T acts on the Stokes vector that
//! drives the emitter, in the emitter's frame. For an emitter with a given Stokes vector s (s₀ = 1), the
//! first column of the result is T s, and all other columns are 0. For an emitter with a filter F, the result
//! is T F, with all columns.

use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::polarization::frame::{project, turn};
use optics::polarization::mueller::Mueller;
use optics::polarization::scatter::Scatter;

/// Frame and filter of emitted light.
#[derive(Clone, Copy, Debug)]
pub struct Polarized {
    /// Reference axis. The projection of the axis perpendicular to the ray is the horizontal direction of the
    /// Stokes vectors.
    pub axis: Vec3A,
    /// Mueller matrix of the filter in front of the emitter, in the frame of [`Polarized::axis`].
    pub filter: Option<Mueller>,
}

impl Polarized {
    /// Returns the frame of light that travels along the unit vector `d`.
    #[inline]
    pub fn frame(&self, d: Vec3A) -> Vec3A {
        project(self.axis, d)
    }

    /// Ends a product at the emitter. Before the call, the product acts on light that travels along `d` in
    /// `frame`. After the call, the product acts on the emitter's input.
    #[inline]
    pub fn end(&self, chain: &mut Chain, d: Vec3A, frame: Vec3A) {
        let own = self.frame(d);
        match self.filter {
            None => {
                let (c2, s2) = turn(d, own, frame);
                chain.rotate_in(c2, s2);
            }
            Some(mueller) => {
                let filter = Scatter::Full { mueller, frame_out: own, frame_in: own };
                chain.push(&filter, d, frame);
            }
        }
    }

    /// Begins a product at the emitter for light that travels along `d`, and returns the frame of this light.
    /// The product is transposed, as light subpaths require.
    #[inline]
    pub fn begin(&self, chain: &mut Chain, d: Vec3A) -> Vec3A {
        let own = self.frame(d);
        if let Some(mueller) = self.filter {
            let filter = Scatter::Full { mueller, frame_out: own, frame_in: own };
            chain.push(&filter.transposed(), d, own);
        }
        own
    }
}
