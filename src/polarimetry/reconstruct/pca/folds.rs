//! Cross-validation over materials. A scheme is learned from some materials and tested on all other materials
//! (Baek & Heide 2021, §4).
//!
//! Materials are sorted by name. Fold f of k tests materials f, f + k, f + 2k, … and learns from all others.
//! Related materials have adjacent names and are therefore in different folds. No random numbers are used.
//! The training set may contain materials that are related to a test material, such as a silicone of another
//! colour. The fold then tests generalization to new specimens, but not to new kinds of material.

use super::data_set::{DataError, DataSet, Weight};
use super::moments::Moments;

/// One split of a data set.
#[derive(Clone, Debug)]
pub struct Fold {
    /// Moments of T / T00 over the training materials.
    pub train: Moments,
    /// Moments of T / T00 over the test materials.
    pub test: Moments,
    /// Indices of the test materials in [`DataSet::materials`], in ascending order.
    pub test_materials: Vec<usize>,
    pub test_names: Vec<String>,
}

/// Splits the indices 0 to n - 1 into k lists. List f is f, f + k, f + 2k, …. Returns at most n lists.
pub fn split(n: usize, k: usize) -> Vec<Vec<usize>> {
    let k = k.min(n);
    (0..k).map(|f| (f..n).step_by(k).collect()).collect()
}

/// Returns the `k` folds of a data set. There is at most one fold per material, and every material is tested
/// once.
///
/// # Errors
/// Returns [`DataError::Folds`] if there are fewer than two folds or fewer than two materials. The training
/// set or the test set would then be empty.
pub fn folds(data: &DataSet, k: usize, weight: Weight) -> Result<Vec<Fold>, DataError> {
    let all = &data.materials;
    if k < 2 || all.len() < 2 {
        return Err(DataError::Folds { folds: k, materials: all.len() });
    }
    let fold = |test: Vec<usize>| {
        let (tested, others): (Vec<_>, Vec<_>) = (0..all.len()).partition(|i| test.contains(i));
        let pool = |list: Vec<usize>| weight.pool(list.into_iter().map(|i| &all[i]), |m| &m.plain);
        Fold {
            train: pool(others),
            test: pool(tested),
            test_names: test.iter().map(|i| all[*i].name.clone()).collect(),
            test_materials: test,
        }
    };
    Ok(split(all.len(), k).into_iter().map(fold).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::pca::data_set::Material;
    use crate::reconstruct::pca::gather::Tally;
    use crate::reconstruct::pca::testing::rows;

    fn data(n: u32) -> DataSet {
        let material = |k: u32| {
            let moments = Moments::of(&rows(20 + k, u64::from(k)));
            Material {
                name: format!("m{k:02}"),
                plain: moments.clone(),
                mapped: moments,
                tally: Tally::default(),
                samples: vec![],
            }
        };
        DataSet { materials: (0..n).map(material).collect() }
    }

    /// Verifies that every material is tested once. The training set and the test set of each fold together
    /// contain all bins once.
    #[test]
    fn folds_split_the_materials() {
        let data = data(25);
        let all = Weight::Bins.pool(&data.materials, |m| &m.plain);
        let folds = folds(&data, 5, Weight::Bins).unwrap();
        let mut tested: Vec<usize> = folds.iter().flat_map(|f| f.test_materials.clone()).collect();
        tested.sort_unstable();
        assert_eq!(tested, (0..25).collect::<Vec<_>>());
        assert_eq!(folds[1].test_names, ["m01", "m06", "m11", "m16", "m21"]);
        for f in &folds {
            let both = Moments::sum([&f.train, &f.test]);
            assert_eq!(both.count(), all.count());
            assert!((both.covariance()[2][9] - all.covariance()[2][9]).abs() < 1e-13);
        }
        assert_eq!(split(7, 3), [vec![0, 3, 6], vec![1, 4], vec![2, 5]]);
        assert_eq!(split(2, 5).len(), 2);
        assert!(split(0, 5).is_empty());
    }

    /// Verifies that, for materials with equal weights, the pooled moments are the mean of the materials'
    /// moments.
    #[test]
    fn materials_can_have_equal_weights() {
        let data = data(4);
        let pooled = Weight::Materials.pool(&data.materials, |m| &m.plain);
        let mean: f64 = data.materials.iter().map(|m| m.plain.mean()[5]).sum::<f64>() / 4.0;
        assert!((pooled.mean()[5] - mean).abs() < 1e-14);
        assert!((pooled.count() - 86.0).abs() < 1e-9);
        assert_eq!(Weight::Materials.pool(&[], |m| &m.plain), Moments::default());
    }

    #[test]
    fn training_and_test_sets_are_never_empty() {
        assert!(matches!(
            folds(&data(25), 1, Weight::Bins),
            Err(DataError::Folds { folds: 1, materials: 25 })
        ));
        assert!(folds(&data(1), 5, Weight::Bins).is_err());
        assert_eq!(folds(&data(2), 5, Weight::Bins).unwrap().len(), 2);
    }
}
