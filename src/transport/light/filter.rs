//! The polarization of what an emitter sends.
//!
//! Every Mueller matrix of a path ends at its emitter: T takes the Stokes vector that the emitter is fed with, in its own
//! frame. A stated Stokes vector s (s₀ = 1) makes the first column T s and the others 0: the light is what it is. A filter F
//! makes it T F, every column of it.

use glam::Vec3A;
use optics::polarization::chain::Chain;
use optics::polarization::frame::{project, turn};
use optics::polarization::mueller::Mueller;
use optics::polarization::scatter::Scatter;

/// Frame and filter of emitted light.
#[derive(Clone, Copy, Debug)]
pub struct Polarized {
    /// The horizontal of its Stokes vectors is this axis projected perpendicular to the ray.
    pub axis: Vec3A,
    /// What stands before the emitter, in that frame.
    pub filter: Option<Mueller>,
}

impl Polarized {
    /// The frame of light that travels along the unit vector `d`.
    #[inline]
    #[must_use]
    pub fn frame(&self, d: Vec3A) -> Vec3A {
        project(self.axis, d)
    }

    /// Ends a product that takes in light travelling along `d` in `frame`: afterwards it takes what the emitter is fed with.
    #[inline]
    pub fn end(&self, chain: &mut Chain, d: Vec3A, frame: Vec3A) {
        let own = self.frame(d);
        match self.filter {
            None => {
                let (c2, s2) = turn(d, own, frame);
                chain.rotate_in(c2, s2);
            }
            Some(mueller) => {
                let filter = Scatter::Full {
                    mueller,
                    frame_out: own,
                    frame_in: own,
                };
                chain.push(&filter, d, frame);
            }
        }
    }

    /// Begins a product at the emitter, for light that travels along `d`: the transpose, as walks from the light have it.
    #[inline]
    pub fn begin(&self, chain: &mut Chain, d: Vec3A) -> Vec3A {
        let own = self.frame(d);
        if let Some(mueller) = self.filter {
            let filter = Scatter::Full {
                mueller,
                frame_out: own,
                frame_in: own,
            };
            chain.push(&filter.transposed(), d, own);
        }
        own
    }
}
