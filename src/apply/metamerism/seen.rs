//! The slices and fruit pixels of one variant, and the trait that all scores implement.

use crate::error::ApplyError;
use crate::isolation::seen::within;
use crate::metrics::roc::Group;
use crate::observation::{Observation, Pixels};

pub(super) struct Seen {
    pub variant: u64,
    pub seed: u64,
    pub polarimetric: Pixels,
    pub epipolar: Pixels,
    /// Pixels that a real fruit covers completely.
    pub real: Vec<usize>,
    pub fake: Vec<usize>,
}

impl Seen {
    pub(super) fn new(o: &Observation) -> Result<Self, ApplyError> {
        let whole = |name: &str| -> Result<Vec<usize>, ApplyError> {
            let whole = within(o, name, |v| v[0] >= 1.0)?;
            Ok((0..whole.len()).filter(|p| whole[*p]).collect())
        };
        let seen = Self {
            variant: o.variant,
            seed: o.seed,
            polarimetric: o.pixels("polarimetric", true)?,
            epipolar: o.pixels("epipolar", true)?,
            real: whole("real")?,
            fake: whole("fake")?,
        };
        let n = seen.polarimetric.count();
        let inside = seen.real.iter().chain(&seen.fake).all(|p| *p < n);
        if !inside || seen.epipolar.count() != n || seen.epipolar.wavelengths != seen.polarimetric.wavelengths
        {
            return Err(o.sizes("slices and truth maps"));
        }
        if seen.real.is_empty() {
            return Err(o.no_pixel("only real fruit"));
        }
        if seen.fake.is_empty() {
            return Err(o.no_pixel("only fake fruit"));
        }
        Ok(seen)
    }
}

/// A method that computes a score per pixel. Pixels of real fruit should have higher scores than pixels of
/// fake fruit.
pub(super) trait Scoring {
    fn score(&self, seen: &Seen, pixel: usize) -> f64;
}

/// Returns the scores of all pixels of real and fake fruit of a variant.
pub(super) fn group(scoring: &dyn Scoring, seen: &Seen) -> Group {
    let of = |pixels: &[usize]| pixels.iter().map(|p| scoring.score(seen, *p)).collect();
    Group { positive: of(&seen.real), negative: of(&seen.fake) }
}
