//! Splitting, by which a subpath of large weight continues as two branches of half the weight (Kahn & Harris
//! 1951, Booth 1985).
//!
//! With guiding in media ([`super::guide`]), few long subpaths have no guided scattering event, and each of
//! these subpaths has a large weight. In a dense medium, much light has been scattered forty times. After
//! forty events, one unguided subpath in twelve remains. An unguided subpath has weight twelve, and its
//! contributions are rare and large. A subpath of large weight is split at a scattering event, and both
//! branches continue with independent random numbers.
//!
//! On average, a branch contributes half as much as the original subpath. Densities and MIS weights are
//! unchanged.

use super::scattering::Progress;
use super::{Guide, Site, Vertex};
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Minimum weight, relative to the start of the subpath, at which a subpath is split. In milk, all values
/// from 1.5 to 2.5 are equally efficient.
const LEAST: f32 = 2.0;

/// Maximum number of splits of a branch.
const MOST: u32 = u8::BITS;

/// Selects the branches of a subpath that are traced.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Splitting {
    Never,
    /// All branches, in sequence.
    All,
    /// Only the branch with this lineage ([`Branch::lineage`]).
    Follow(u8),
}

/// A branch that has not been traced yet. The branch starts at the vertex where the subpath was split.
pub(crate) struct Branch {
    /// Number of vertices that the branch shares with the subpath, including the vertex of the split.
    pub points: usize,
    pub progress: Progress,
    pub lineage: u8,
    pub stream: Stream,
}

impl Splitting {
    /// Splits a subpath at its last vertex, if this vertex is in a medium with guiding and the weight is
    /// large enough. If all branches are traced, returns the branch that is traced later. `lineage` is the
    /// lineage of the subpath before the split.
    #[inline]
    pub fn split(
        self,
        guide: &Guide,
        points: &[Vertex],
        lineage: u8,
        progress: &mut Progress,
        stream: &mut Stream,
    ) -> Option<Branch> {
        let chain = &mut progress.flight.state.chain;
        let counts = chain.max_m00() / progress.full;
        // The range excludes NaN and infinity.
        let much = (LEAST..f32::INFINITY).contains(&counts);
        if !much || self == Self::Never || progress.splits == MOST {
            return None;
        }
        let Some(Site::Volume(id)) = points.last().map(|p| p.site) else {
            return None;
        };
        if !guide.turns(id, progress.flight.end) {
            return None;
        }
        chain.scale(Spectral::splat(0.5));
        // The stream is forked in all modes, so that a lineage always has the same random numbers.
        let other = stream.fork();
        let bit = 1 << progress.splits;
        progress.splits += 1;
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
