//! Simulates the captures of a variant's light by a scheme with detector noise, and estimates the Mueller
//! matrices.
//!
//! The light is a slice with many samples per pixel. The light is treated as exact, so all errors are due to
//! the instrument. The noise is normally distributed with a standard deviation of 5e-4 of the mean T00.

use super::family::{NOISE, Ready, determines};
use crate::error::ApplyError;
use crate::observation::Observation;
use polarimetry::capture::design_matrix::DesignMatrix;
use polarimetry::capture::mueller_image::MuellerImage;
use polarimetry::capture::simulate::Noise;
use polarimetry::reconstruct::pixels::{Options, Reconstruction};
use polarimetry::reconstruct::second_moment::Moment;
use polarimetry::trial::least_norm;
use tensor::axes::AxisKind;

/// Name of the truth slice that is captured.
pub(super) const LIGHT: &str = "light";

/// Name of the truth map of objects.
pub(super) const OBJECT: &str = "object";

pub(super) struct Bench {
    pub variant: u64,
    pub width: usize,
    pub height: usize,
    pub lanes: usize,
    image: MuellerImage,
    seed: u64,
    /// Object index of each pixel, or -1 without an object.
    pub object: Vec<i64>,
}

impl Bench {
    pub(super) fn new(o: &Observation) -> Result<Self, ApplyError> {
        let pixels = o.pixels(LIGHT, true)?;
        let (width, height, lanes) = (pixels.width, pixels.height, pixels.wavelengths);
        let object = o.truth(OBJECT)?;
        if (object.width, object.height) != (width, height) {
            return Err(o.sizes(format!("map `{OBJECT}` and slice `{LIGHT}`")));
        }
        let mean = &o.slice(LIGHT)?.mean;
        let nm: Vec<f64> =
            mean.find(AxisKind::Wavelength).map_or_else(|| vec![550.0], |a| mean.axes[a].coords.clone());
        let mut matrices = Vec::with_capacity(pixels.count() * lanes * 16);
        for p in 0..pixels.count() {
            for lane in 0..lanes {
                matrices.extend((0..16).map(|e| pixels.at(p, 0, e, lane)));
            }
        }
        let image = MuellerImage::of_array(matrices, vec![height, width, lanes], &nm)
            .map_err(|e| o.sizes(e.to_string()))?;
        let bench = Self {
            variant: o.variant,
            width,
            height,
            lanes,
            image,
            seed: o.seed,
            object: object.data.iter().map(|v| if v.is_finite() { *v as i64 } else { -1 }).collect(),
        };
        if bench.brightness() > 0.0 && bench.brightness().is_finite() {
            Ok(bench)
        } else {
            Err(ApplyError::Empty(format!(
                "variant {} contains no light, but errors are relative to the mean intensity; check the lights of the scene",
                o.variant
            )))
        }
    }

    /// Returns the mean T00 of the true matrices.
    pub(super) fn brightness(&self) -> f64 {
        self.image.mean()
    }

    /// Returns the standard deviation of the noise of an intensity, in the units of T00.
    pub(super) fn sigma(&self) -> f64 {
        NOISE * self.brightness()
    }

    /// Returns the true matrices: 16 elements per pixel and wavelength.
    pub(super) fn truth(&self) -> &[f64] {
        &self.image.matrices
    }

    /// Returns the matrices that a scheme estimates. Instruments with different values of `stream` have
    /// independent noise.
    pub(super) fn estimate(&self, ready: &Ready, stream: u64) -> Result<Vec<f64>, ApplyError> {
        let unsolved = |cause: String| ApplyError::Unsolved { method: "ellipsometry", cause };
        let sigma = self.sigma();
        let seed = (self.seed << 32) ^ (self.variant << 16) ^ stream;
        let captured = self
            .image
            .capture(&ready.scheme, &Noise::Gaussian { sigma }, seed)
            .map_err(|e| unsolved(e.to_string()))?;
        if ready.prior.is_none() && !determines(&ready.scheme) {
            let of = |ray| DesignMatrix::new(&ready.scheme, ray);
            let designs: Vec<DesignMatrix> = self.image.rays.iter().map(of).collect();
            return Ok(least_norm(&designs, &captured));
        }
        let options = Options { noise: Some(sigma), prior: ready.prior, ..Options::default() };
        let rays = &self.image.rays;
        let all =
            Reconstruction::<f32>::new(&ready.scheme, rays, options).map_err(|e| unsolved(e.to_string()))?;
        let mut out = vec![0.0_f32; self.image.matrices.len()];
        all.apply(&captured.intensities, None, &mut out, None);
        Ok(out.into_iter().map(f64::from).collect())
    }
}

/// Returns the second moment E[t tᵀ] of the bright matrices of the training variants. The mean is not
/// subtracted, and the matrices are normalized to T00 = 1. Matrices whose T00 is below a hundredth of the
/// mean T00 are ignored, because the noise exceeds a twentieth of their T00.
pub(super) fn second_moment(train: &[Bench]) -> Result<Moment, ApplyError> {
    let (mut sum, mut n) = (Moment::zeros(), 0.0);
    for bench in train {
        let least = 0.01 * bench.brightness();
        for t in bench.truth().chunks_exact(16) {
            if t[0] > least && t.iter().all(|v| v.is_finite()) {
                sum += Moment::from_fn(|i, j| t[i] * t[j] / (t[0] * t[0]));
                n += 1.0;
            }
        }
    }
    if n > 0.0 { Ok(sum / n) } else { Err(ApplyError::Empty("no training variant contains light".into())) }
}
