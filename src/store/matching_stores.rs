//! Opens a single store, or several renders of one scene with different seeds that are read together.

use crate::denoised;
use crate::merge::{self, Input, MergeError};
use crate::zarr::{AccessError, SampleGrid, TensorStore};
use serde_json::{Map, Value};
use std::path::PathBuf;

/// Stores with the same slices of the same scene.
pub struct MatchingStores {
    inputs: Vec<Input>,
}

impl MatchingStores {
    /// Opens the stores. A single store does not need the attributes that merging requires.
    ///
    /// # Errors
    /// Returns the errors of [`merge::merge`] for invalid inputs, and [`MergeError::Denoised`] if a store is
    /// denoised.
    pub fn open(paths: &[PathBuf]) -> Result<Self, MergeError> {
        if let [only] = paths {
            let store = TensorStore::open(only)?;
            denoised::refuse(&store)?;
            return Ok(Self { inputs: vec![Input::of(store)] });
        }
        let inputs = merge::open_inputs(paths, false)?;
        for name in inputs[0].store.slice_names() {
            merge::parts(&inputs, name)?;
        }
        Ok(Self { inputs })
    }

    pub fn stores(&self) -> impl Iterator<Item = &TensorStore> {
        self.inputs.iter().map(|input| &input.store)
    }

    /// Returns the weight of each store in the mean of all samples. The sum of the weights is 1.
    pub fn shares(&self) -> Vec<f32> {
        let samples = |input: &Input| input.samples_per_pixel.filter(|n| *n > 0.0);
        let all: Option<Vec<f64>> = self.inputs.iter().map(samples).collect();
        let all = all.unwrap_or_else(|| vec![1.0; self.inputs.len()]);
        let sum: f64 = all.iter().sum();
        all.iter().map(|n| (n / sum) as f32).collect()
    }

    /// Returns the root attributes of a store that contains the samples of all stores.
    pub fn attributes(&self) -> Map<String, Value> {
        match &self.inputs[..] {
            [only] => only.store.attributes(),
            all => merge::merged_attributes(all),
        }
    }

    /// Returns the grid of the sample counts, if the sample counts of all stores have the same shape.
    pub fn grid(&self) -> Option<SampleGrid> {
        merge::common_grid(&self.inputs)
    }

    /// Writes the sample counts, summed over all stores, if `out` has sample counts.
    ///
    /// # Errors
    /// Returns [`AccessError`] if sample counts cannot be read or written.
    pub fn write_samples(&self, out: &TensorStore) -> Result<(), AccessError> {
        merge::merge_samples(&self.inputs, out)
    }
}
