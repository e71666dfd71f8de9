//! Data sets of pBRDFs: moments and sampled matrices of every material. The caller supplies the matrices.

use super::gather::{Gathered, Tally};
use super::moments::Moments;
use rayon::prelude::*;

/// Number of slabs between two merges. The number is large enough for many threads, and small enough to limit
/// memory.
const BATCH: u32 = 64;

/// Settings for the data that is kept for each material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Factor c of the map arctan(c T). The factor is 8 in Baek & Heide (2021).
    pub c: f64,
    /// Number of bins that are sampled at random with a fixed seed. Experiments that need single matrices use
    /// these samples.
    pub samples: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { c: 8.0, samples: 2000 }
    }
}

#[derive(Clone, Debug)]
pub struct Material {
    /// File name without extension, or name of the analytic material.
    pub name: String,
    /// Moments of T / T00 over all valid bins and bands.
    pub plain: Moments,
    /// Moments of arctan(c T / T00).
    pub mapped: Moments,
    /// Number of valid bins, and number of bins excluded for each reason.
    pub tally: Tally,
    /// Matrices T / T00 of the sampled bins, row-major, in random order.
    pub samples: Vec<[f32; 16]>,
}

/// A set of materials, sorted by name.
#[derive(Clone, Debug)]
pub struct DataSet {
    pub materials: Vec<Material>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Weight {
    /// Weight in proportion to the number of a material's valid bins. The paper also uses this weight,
    /// because its X stacks all bins. If all tables have the same resolution, this weight is nearly the same
    /// as [`Self::Materials`].
    #[default]
    Bins,
    /// Equal weight for all materials.
    Materials,
}

impl Weight {
    /// Returns the pooled moments of some materials. `of` selects the moments of T / T00 or of arctan(c T /
    /// T00). The count of the result is the total number of bins.
    pub fn pool<'a>(
        self,
        materials: impl IntoIterator<Item = &'a Material>,
        of: impl Fn(&Material) -> &Moments,
    ) -> Moments {
        let parts: Vec<&Moments> = materials.into_iter().map(of).collect();
        match self {
            Self::Bins => Moments::sum(parts),
            Self::Materials => {
                let bins: f64 = parts.iter().map(|m| m.count()).sum();
                let each = bins / parts.len().max(1) as f64;
                let equal: Vec<Moments> = parts.iter().map(|m| m.weighted(each / m.count())).collect();
                Moments::sum(&equal)
            }
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// A material has no valid bin.
    #[error(
        "{name}: no bin is valid; a valid bin has finite elements, M00 > 0 and no element larger than M00; exclude this material"
    )]
    NoBins { name: String },
    /// The factor c of arctan(c T) is invalid.
    #[error("the factor c of arctan(c T) is {0}; expected a positive number, such as 8")]
    Factor(f64),
    /// The training set or the test set of a split would be empty.
    #[error(
        "cannot split {materials} materials into {folds} folds; expected at least 2 folds and 2 materials"
    )]
    Folds { folds: usize, materials: usize },
}

impl DataSet {
    /// Returns the moments of T / T00 over all materials.
    pub fn plain(&self, weight: Weight) -> Moments {
        weight.pool(&self.materials, |m| &m.plain)
    }

    /// Returns the moments of arctan(c T / T00) over all materials.
    pub fn mapped(&self, weight: Weight) -> Moments {
        weight.pool(&self.materials, |m| &m.mapped)
    }

    /// Returns the bin counts of all materials.
    pub fn tally(&self) -> Tally {
        let mut all = Tally::default();
        self.materials.iter().for_each(|m| all.merge(&m.tally));
        all
    }
}

/// Accumulates the data of a material from its slabs. `visit` passes the entries of a slab to the
/// accumulator.
///
/// # Errors
/// Returns [`DataError::Factor`] if the factor c is invalid, and [`DataError::NoBins`] if no bin is valid.
pub fn gather(
    name: &str,
    slabs: usize,
    settings: &Settings,
    visit: impl Fn(usize, &mut Gathered) + Sync,
) -> Result<Material, DataError> {
    if !(settings.c > 0.0 && settings.c.is_finite()) {
        return Err(DataError::Factor(settings.c));
    }
    // No file has 2^32 slabs.
    let slabs = slabs as u32;
    let mut all = Gathered::new(0, settings.c, settings.samples);
    for first in (0..slabs).step_by(BATCH as usize) {
        let batch = first..first.saturating_add(BATCH).min(slabs);
        let parts: Vec<Gathered> = batch
            .into_par_iter()
            .map(|slab| {
                let mut part = all.beside(slab);
                visit(slab as usize, &mut part);
                part
            })
            .collect();
        parts.into_iter().for_each(|part| all.merge(part));
    }
    let tally = all.tally;
    tracing::info!(
        "{name}: {} bins are valid; {} have no values, {} are dark, {} have elements larger than M00",
        tally.valid,
        tally.holes,
        tally.dark,
        tally.unreal
    );
    if tally.valid == 0 {
        return Err(DataError::NoBins { name: name.to_owned() });
    }
    Ok(Material {
        name: name.to_owned(),
        plain: all.plain.clone(),
        mapped: all.mapped.clone(),
        tally,
        samples: all.samples(),
    })
}
