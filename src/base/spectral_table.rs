//! Tables of values over wavelength, interpolated linearly between entries and constant beyond the ends.

/// A table of values at vacuum wavelengths in nanometres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpectralTable<'a> {
    /// Wavelengths in nanometres, strictly increasing.
    pub nm: &'a [f64],
    /// Values, one per wavelength.
    pub values: &'a [f64],
}

impl SpectralTable<'_> {
    /// Returns whether the table is valid. A valid table has at least one entry and as many values as
    /// wavelengths. All numbers must be finite, and wavelengths positive and strictly increasing.
    pub fn is_sound(&self) -> bool {
        let finite = self.nm.iter().chain(self.values).all(|v| v.is_finite());
        finite
            && self.nm.iter().all(|nm| *nm > 0.0)
            && !self.nm.is_empty()
            && self.nm.len() == self.values.len()
            && self.nm.is_sorted_by(|a, b| a < b)
    }

    /// Returns the value at a vacuum wavelength in nanometres. The value is linear between entries, constant
    /// beyond the ends, and 0 for an empty table.
    pub fn at(&self, nm: f64) -> f64 {
        let right = self.nm.partition_point(|w| *w <= nm);
        let entry = |i: usize| Some((*self.nm.get(i)?, *self.values.get(i)?));
        match (right.checked_sub(1).and_then(entry), entry(right)) {
            (Some((w0, v0)), Some((w1, v1))) => v0 + (v1 - v0) * (nm - w0) / (w1 - w0),
            (Some((_, v)), None) | (None, Some((_, v))) => v,
            (None, None) => 0.0,
        }
    }
}

/// Returns the index of the entry nearest to the wavelength `wanted` (nanometres), or the first of two
/// equally near entries. Returns `None` for an empty list.
pub fn nearest(nm: &[f64], wanted: f64) -> Option<usize> {
    let distance = |i: &usize| (nm[*i] - wanted).abs();
    (0..nm.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Maximum distance of an accepted wavelength beyond the range of a table, in nanometres.
pub const BEYOND_NM: f64 = 5.0;

/// Returns the same index as [`nearest`], but `None` if the wavelength is more than [`BEYOND_NM`] beyond the
/// entries.
pub fn nearest_within(nm: &[f64], wanted: f64) -> Option<usize> {
    let low = nm.iter().copied().fold(f64::INFINITY, f64::min);
    let high = nm.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let within = (low - BEYOND_NM..=high + BEYOND_NM).contains(&wanted);
    within.then(|| nearest(nm, wanted)).flatten()
}

/// Maximum difference between a requested wavelength and the entry of a list that is used for the wavelength,
/// in nanometres.
pub const SAME_NM: f64 = 0.5;

/// Returns the same index as [`nearest`], but `None` if the nearest entry differs from `wanted` by more than
/// [`SAME_NM`].
pub fn entry(nm: &[f64], wanted: f64) -> Option<usize> {
    nearest(nm, wanted).filter(|&i| (nm[i] - wanted).abs() <= SAME_NM)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn table<'a>(nm: &'a [f64], values: &'a [f64]) -> SpectralTable<'a> {
        SpectralTable { nm, values }
    }

    #[test]
    fn tables_are_linear_between_entries_and_constant_beyond() {
        let t = table(&[400.0, 500.0, 700.0], &[1.0, 3.0, 2.0]);
        assert!(t.is_sound());
        let found = [0.0, 400.0, 450.0, 500.0, 600.0, 700.0, 1e9].map(|nm| t.at(nm));
        assert_eq!(found, [1.0, 1.0, 2.0, 3.0, 2.5, 2.0, 2.0]);
        assert_eq!(table(&[], &[]).at(500.0), 0.0);
    }

    #[test]
    fn an_entry_is_at_most_half_a_nanometre_away() {
        let nm = [450.0, 550.0, 660.0];
        assert_eq!([450.5, 549.5, 660.0].map(|v| entry(&nm, v)), [Some(0), Some(1), Some(2)]);
        for nm in [600.0, 550.6, 449.4, 0.0, f64::NAN, f64::INFINITY] {
            assert_eq!(entry(&[450.0, 550.0, 660.0], nm), None);
        }
        assert_eq!(entry(&[], 550.0), None);
    }

    #[test]
    fn invalid_tables_are_detected() {
        let values = [1.0, 2.0];
        let nan = [1.0, f64::NAN];
        for (nm, values) in [
            (&[][..], &[][..]),
            (&[500.0], &values),
            (&[500.0, 500.0], &values),
            (&[600.0, 500.0], &values),
            (&[500.0, 600.0], &nan),
            (&nan, &values),
        ] {
            assert!(!table(nm, values).is_sound(), "{nm:?} {values:?}");
        }
    }

    #[test]
    fn the_nearest_entry() {
        let nm = [450.0, 550.0, 650.0];
        let found = [0.0, 499.0, 500.0, 501.0, 1e9].map(|w| nearest(&nm, w));
        assert_eq!(found, [Some(0), Some(0), Some(0), Some(1), Some(2)]);
        assert_eq!(nearest(&[], 500.0), None);
    }

    proptest! {
        #[test]
        fn values_lie_between_their_neighbours(
            steps in prop::collection::vec((0.1..100.0_f64, -10.0..10.0_f64), 1..20),
            at in -100.0..2500.0_f64,
        ) {
            let mut nm = 0.0;
            let (nm, values): (Vec<f64>, Vec<f64>) = steps
                .iter()
                .map(|(step, v)| {
                    nm += step;
                    (nm, *v)
                })
                .unzip();
            let t = table(&nm, &values);
            prop_assert!(t.is_sound());
            let found = t.at(at);
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            // The tolerance covers rounding errors of one product, quotient and sum of numbers up to 20.
            prop_assert!((low - 1e-13..=high + 1e-13).contains(&found));
            for (nm, v) in nm.iter().zip(&values) {
                prop_assert_eq!(t.at(*nm), *v);
            }
        }
    }
}
