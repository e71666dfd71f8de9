//! Selects the valid entries of a pBRDF, and accumulates the moments and samples of these entries.
//!
//! An entry (one angular bin at one wavelength) is valid if all its elements are finite and T00 is positive.
//! A valid entry is divided by T00. An entry with an element above [`GREATEST`] in magnitude is impossible
//! for passive materials. The T00 of such an entry is noise around 0, so the quotient is arbitrarily large. A
//! few such entries would dominate the second moments. Entries above [`GREATEST`] are therefore excluded and
//! counted. Entries that are slightly unphysical because of noise are not changed. There is no lower limit of
//! T00, because a dark bin is a valid measurement and the paper uses all bins.
//!
//! Slabs of entries are processed in parallel. The data of each slab is bounded in size. The data is merged
//! in the order of slabs. The result therefore does not depend on threads or on the split of a file into
//! slabs.

use super::moments::{MatrixRow, Moments};
use optics::sampling::mix::mix;

/// Largest valid magnitude of a normalized element. The value is 1, plus 10 % for noise and calibration.
pub const GREATEST: f64 = 1.1;
/// Smallest T00 of a valid entry. Below this value, the other elements lose digits in single precision.
const LEAST: f32 = 1e-30;

/// Number of entries of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    pub valid: u64,
    /// Entries that are non-finite or below the horizon.
    pub holes: u64,
    /// Entries whose T00 is not positive.
    pub dark: u64,
    /// Entries with a normalized element above [`GREATEST`] in magnitude.
    pub unreal: u64,
}

impl Tally {
    /// Adds the counts of another tally.
    pub fn merge(&mut self, other: &Self) {
        self.valid += other.valid;
        self.holes += other.holes;
        self.dark += other.dark;
        self.unreal += other.unreal;
    }
}

/// Maps each element by arctan(c v) (Baek & Heide 2021, §3.2). The map expands small elements, in which most
/// materials differ.
pub fn arctan(v: &MatrixRow, c: f64) -> MatrixRow {
    v.map(|e| (c * e).atan())
}

/// A random sample of at most `most` entries without replacement. The sample contains the entries with the
/// smallest random keys.
#[derive(Clone, Debug)]
struct Choice {
    most: usize,
    /// Upper bound of keys. Keys that are greater than or equal to the bound are not among the smallest keys.
    bound: u64,
    kept: Vec<(u64, [f32; 16])>,
}

impl Choice {
    fn new(most: usize) -> Self {
        Self { most, bound: if most == 0 { 0 } else { u64::MAX }, kept: vec![] }
    }

    #[inline]
    fn offer(&mut self, key: u64, v: impl FnOnce() -> [f32; 16]) {
        if key < self.bound {
            self.kept.push((key, v()));
            if self.kept.len() > self.most.saturating_mul(2).max(64) {
                self.prune();
            }
        }
    }

    /// Keeps the `most` smallest keys in ascending order and removes all other keys.
    fn prune(&mut self) {
        self.kept.sort_unstable_by_key(|k| k.0);
        self.kept.truncate(self.most);
        if self.kept.len() == self.most {
            self.bound = self.kept.last().map_or(0, |k| k.0);
        }
    }
}

/// The accumulated data of one or more slabs.
#[derive(Clone, Debug)]
pub struct Gathered {
    /// Moments of T / T00.
    pub plain: Moments,
    /// Moments of arctan(c T / T00).
    pub mapped: Moments,
    /// Number of entries of each kind.
    pub tally: Tally,
    c: f64,
    choice: Choice,
    /// Index of the next entry. The upper half of the index is the slab.
    next: u64,
}

impl Gathered {
    /// Creates an empty accumulator for a slab. The accumulator maps by arctan(c T) and chooses up to `most`
    /// samples.
    pub fn new(slab: u32, c: f64, most: usize) -> Self {
        Self {
            plain: Moments::default(),
            mapped: Moments::default(),
            tally: Tally::default(),
            c,
            choice: Choice::new(most),
            next: u64::from(slab) << 32,
        }
    }

    /// Creates an empty accumulator for another slab. The new accumulator skips samples that would not
    /// replace samples of `self`.
    pub fn beside(&self, slab: u32) -> Self {
        let mut new = Self::new(slab, self.c, self.choice.most);
        new.choice.bound = self.choice.bound;
        new
    }

    /// Adds the next entry, which is a row-major matrix. `None` represents an invalid entry.
    #[inline]
    pub fn take(&mut self, m: Option<&[f32; 16]>) {
        self.next += 1;
        let Some(m) = m.filter(|m| m.iter().all(|e| e.is_finite())) else {
            self.tally.holes += 1;
            return;
        };
        if m[0] < LEAST {
            self.tally.dark += 1;
            return;
        }
        let v: MatrixRow = m.map(|e| f64::from(e) / f64::from(m[0]));
        if v.iter().any(|e| e.abs() > GREATEST) {
            self.tally.unreal += 1;
            return;
        }
        self.tally.valid += 1;
        self.plain.add(&v);
        self.mapped.add(&arctan(&v, self.c));
        self.choice.offer(mix(self.next), || v.map(|e| e as f32));
    }

    /// Adds the data of another accumulator. Accumulators must be merged in the order of their slabs.
    pub fn merge(&mut self, other: Self) {
        self.plain.merge(&other.plain);
        self.mapped.merge(&other.mapped);
        self.tally.merge(&other.tally);
        self.choice.kept.extend(other.choice.kept);
        self.choice.prune();
    }

    /// Returns the sampled entries in random order, divided by T00. The first n of these entries are also a
    /// random sample.
    pub fn samples(mut self) -> Vec<[f32; 16]> {
        self.choice.prune();
        self.choice.kept.into_iter().map(|k| k.1).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns an entry whose second element encodes its index.
    fn entry(k: u32) -> [f32; 16] {
        std::array::from_fn(|e| match e {
            0 => 2.0,
            1 => k as f32 * 1e-4,
            _ => 0.0,
        })
    }

    fn slab(mut g: Gathered, n: u32) -> Gathered {
        (0..n).for_each(|k| g.take(Some(&entry(k))));
        g
    }

    #[test]
    fn entries_are_classified() {
        let mut g = Gathered::new(0, 8.0, 10);
        let with = |e: usize, v: f32| {
            let mut m = entry(3);
            m[e] = v;
            m
        };
        g.take(None);
        g.take(Some(&with(5, f32::NAN)));
        g.take(Some(&with(0, f32::INFINITY)));
        g.take(Some(&with(0, 0.0)));
        g.take(Some(&with(0, -1.0)));
        g.take(Some(&with(7, -2.3)));
        g.take(Some(&with(7, -2.15)));
        g.take(Some(&entry(1)));
        let want = Tally { valid: 2, holes: 3, dark: 2, unreal: 1 };
        assert_eq!(g.tally, want);
        assert!((g.plain.mean()[7] + 2.15 / 4.0).abs() < 1e-7, "kept as measured");
        assert!((g.mapped.mean()[0] - 8.0_f64.atan()).abs() < 1e-15);
        assert_eq!(g.samples().len(), 2);
    }

    /// Verifies that the samples do not depend on the grouping of slabs. All entries are equally likely,
    /// within 5 standard errors.
    #[test]
    fn samples_are_uniform_and_independent_of_grouping() {
        let (slabs, n, most) = (40, 500, 1000);
        let alone = |s: u32| slab(Gathered::new(s, 8.0, most), n);
        let mut all = Gathered::new(0, 8.0, most);
        let mut later = Gathered::new(0, 8.0, most);
        for s in 0..slabs {
            all.merge(alone(s));
            let beside = slab(later.beside(s), n);
            later.merge(beside);
        }
        let mut backwards = Gathered::new(0, 8.0, most);
        (0..slabs).rev().for_each(|s| backwards.merge(alone(s)));
        let chosen = all.samples();
        assert_eq!(chosen.len(), most);
        assert_eq!(chosen, later.samples());
        assert_eq!(chosen, backwards.samples());
        let mean = |v: &[[f32; 16]]| v.iter().map(|m| f64::from(m[1]) / 0.5e-4).sum::<f64>() / v.len() as f64;
        for (part, k) in [(&chosen[..], 1000.0), (&chosen[..100], 100.0)] {
            let sigma = f64::from(n) / (12.0_f64 * k).sqrt();
            assert!((mean(part) - f64::from(n) / 2.0).abs() < 5.0 * sigma, "{}", mean(part));
        }
        assert!(slab(Gathered::new(0, 8.0, 0), 300).samples().is_empty());
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..Default::default() })]

        #[test]
        fn arbitrary_matrices_give_finite_moments(all in prop::collection::vec(prop::array::uniform16(any::<f32>()), 0..20), c in any::<f64>()) {
            let mut g = Gathered::new(7, c, 5);
            all.iter().for_each(|m| g.take(Some(m)));
            let t = g.tally;
            prop_assert_eq!((t.valid + t.holes + t.dark + t.unreal) as usize, all.len());
            prop_assert!(g.plain.second().iter().flatten().all(|e| e.is_finite()));
            prop_assert!(g.mapped.second().iter().flatten().all(|e| e.is_finite()));
            prop_assert!(g.samples().iter().flatten().all(|e| f64::from(e.abs()) <= GREATEST + 1e-6));
        }
    }
}
