//! Walks that part: one that counts for much goes on as two that count for half each (splitting; Kahn & Harris 1951, Booth 1985).
//!
//! Walks in media that turn toward the other end ([`super::guide`]) leave those that do not turn the fewer the longer they are, and let
//! each count for more: after forty particles, which much of a dense medium's light has met, one in twelve is left that counts for
//! twelve, and what it brings is rare and strong. Such a walk parts at a particle, and both branches go on from there with numbers of their
//! own.
//!
//! What a branch brings on average is half of what the walk would, so that nothing else needs to know of it: densities and weights
//! of paths stay those of a walk that does not part.

use super::guide::Guide;
use super::onward::Progress;
use super::point::{Point, Site};
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// What a walk must count for, over what it began with, to part. (Measured in milk: with 1.5 to 2.5 the same error takes the same
/// time.)
const LEAST: f32 = 2.0;

/// Most times that a branch parts.
const MOST: u32 = u8::BITS;

/// Which branches of a walk are made.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Parting {
    /// It does not part.
    Never,
    /// All, one after another.
    All,
    /// That of a lineage alone.
    Follow(u8),
}

/// A branch that is still to be walked, from the particle on at which the walk parted.
pub(super) struct Branch {
    /// Points that it shares with the walk, that particle included.
    pub points: usize,
    pub progress: Progress,
    pub lineage: u8,
    pub stream: Stream,
}

impl Parting {
    /// Parts a walk at its last point, if that is a particle and the walk counts for enough; returns the branch that is left for later, if
    /// all are made. `lineage` is that of the walk so far.
    #[inline]
    pub fn part(
        self,
        guide: &Guide,
        points: &[Point],
        lineage: u8,
        progress: &mut Progress,
        stream: &mut Stream,
    ) -> Option<Branch> {
        let chain = &mut progress.flight.state.chain;
        let counts = chain.max_m00() / progress.full;
        // Neither numbers that are none nor those without end.
        let much = (LEAST..f32::INFINITY).contains(&counts);
        if !much || self == Self::Never || progress.parted == MOST {
            return None;
        }
        let Some(Site::Volume(id)) = points.last().map(|p| p.site) else {
            return None;
        };
        if !guide.turns(id, progress.flight.end) {
            return None;
        }
        chain.scale(Spectral::splat(0.5));
        // Drawn by all, so that a lineage that is followed meets the same numbers.
        let other = stream.fork();
        let bit = 1 << progress.parted;
        progress.parted += 1;
        match self {
            Self::All => {
                return Some(Branch {
                    points: points.len(),
                    progress: progress.clone(),
                    lineage: lineage | bit,
                    stream: other,
                });
            }
            Self::Follow(wanted) if wanted & bit != 0 => *stream = other,
            _ => {}
        }
        None
    }
}
