//! One store, or renders of one scene with different seeds, opened to be read together.

use crate::denoised;
use crate::merge::{self, Input, MergeError};
use crate::zarr::{AccessError, SampleGrid, TensorStore};
use serde_json::{Map, Value};
use std::path::PathBuf;

/// Stores that keep the same slices of the same scene.
pub struct Alike {
    inputs: Vec<Input>,
}

impl Alike {
    /// Opens them. Nothing but slices is asked of a single one.
    ///
    /// # Errors
    /// Those of [`merge::merge`]'s inputs; [`MergeError::Denoised`].
    pub fn open(paths: &[PathBuf]) -> Result<Self, MergeError> {
        if let [only] = paths {
            let store = TensorStore::open(only)?;
            denoised::refuse(&store)?;
            return Ok(Self {
                inputs: vec![Input::of(store)],
            });
        }
        let inputs = merge::open_inputs(paths, false)?;
        for name in inputs[0].store.slice_names() {
            merge::parts(&inputs, name)?;
        }
        Ok(Self { inputs })
    }

    /// The stores.
    pub fn stores(&self) -> impl Iterator<Item = &TensorStore> {
        self.inputs.iter().map(|input| &input.store)
    }

    /// Weights of the stores in the mean of all their samples; they add up to 1.
    #[must_use]
    pub fn shares(&self) -> Vec<f32> {
        let samples = |input: &Input| input.samples_per_pixel.filter(|n| *n > 0.0);
        let all: Option<Vec<f64>> = self.inputs.iter().map(samples).collect();
        let all = all.unwrap_or_else(|| vec![1.0; self.inputs.len()]);
        let sum: f64 = all.iter().sum();
        all.iter().map(|n| (n / sum) as f32).collect()
    }

    /// Attributes of a store with the samples of all.
    #[must_use]
    pub fn attributes(&self) -> Map<String, Value> {
        match &self.inputs[..] {
            [only] => only.store.attributes(),
            all => merge::merged_attributes(all),
        }
    }

    /// The sample counts that all keep.
    #[must_use]
    pub fn grid(&self) -> Option<SampleGrid> {
        merge::common_grid(&self.inputs)
    }

    /// Writes the numbers of samples of all, where `out` keeps them.
    ///
    /// # Errors
    /// [`AccessError`].
    pub fn write_samples(&self, out: &TensorStore) -> Result<(), AccessError> {
        merge::merge_samples(&self.inputs, out)
    }
}
