//! Reconstructs Mueller matrices with standard errors from a run, and stores them.

use super::image::{ImageError, Intensities, Run, failed};
use polarimetry::capture::detector::polarizer_array::Method;
use polarimetry::capture::directions::Directions;
use polarimetry::capture::simulate::Layout;
use polarimetry::reconstruct::along_rays::{Places, reconstruct};
use polarimetry::reconstruct::pixels::{Options, Tally};
use polarimetry::reconstruct::predicted::of_counts;
use serde_json::{Map, Value, json};
use std::path::Path;
use store::probe::ProbeError;
use store::zarr::TensorStore;
use tensor::axes::{Axis, AxisKind, SliceLayout};
use tensor::field::Field;

/// Mueller matrices of one mask.
pub struct MuellerImage {
    pub name: String,
    /// 16 elements per pixel, row-major. The elements are NaN if a pixel cannot be reconstructed.
    pub mean: Vec<f32>,
    /// Standard errors of the elements, in the same order and unit as `mean`.
    pub errors: Vec<f32>,
    pub layout: Layout,
    /// Start and width of the time bins, in ps.
    pub time: Option<(f64, f64)>,
    /// Numbers of reconstructed and rejected pixels.
    pub tally: Tally,
}

#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// Options of the reconstruction of images. `saturation` is not used, because the run already marks
    /// saturated readings.
    pub options: Options,
    /// Horizontal field of view of the camera in radians. The field of view is used to correct for oblique
    /// incidence at the retarders. For a scan, the run contains the field of view.
    pub fov_x: Option<f64>,
    /// Whether a polarizer array is demosaicked by superpixels. If false, the array is demosaicked by
    /// bilinear interpolation.
    pub superpixel: bool,
}

impl Run {
    /// Reconstructs the Mueller matrices of one mask.
    ///
    /// Weights are inverse variances. A camera's variances come from its readings. The variances of a diode
    /// come from a first, unweighted estimate, because a bin without counts has no variance estimate.
    ///
    /// # Errors
    /// Returns [`ImageError`] if the mask does not exist, if frames are damaged, or if there are too few
    /// captures.
    pub fn mueller(&self, mask: &str, how: &RunOptions) -> Result<MuellerImage, ImageError> {
        let method = if how.superpixel { Method::Superpixel } else { Method::Bilinear };
        let Intensities { values, mut variances, layout, time } = self.intensities(mask, method)?;
        let points = self.scheme.coaxial.as_ref().is_some_and(|c| c.galvo.is_some());
        let fov = how.fov_x.or(self.fov_x.filter(|_| points));
        let view = fov.map_or(Directions::Axial, |f| Directions::pinhole(f, layout.width, layout.height));
        let rays = view.rays(layout, &[self.nm]);
        let pixels = layout.pixels();
        let mut image = MuellerImage {
            name: mask.to_owned(),
            mean: vec![0.0; pixels * 16],
            errors: vec![0.0; pixels * 16],
            layout,
            time,
            tally: Tally::default(),
        };
        let places = Places { rays: &rays, times: layout.times, lanes: layout.lanes };
        if let Some(spad) = self.diode()? {
            let (plain, first) = (Options::default(), &mut image.mean);
            let of = |radiance: f64, nm: f64| spad.variance(radiance, nm);
            variances =
                of_counts(&self.scheme, &rays, layout, &plain, &values, first, &of).map_err(failed)?;
        }
        image.tally = reconstruct(
            &self.scheme,
            places,
            &how.options,
            &values,
            Some(&variances),
            &mut image.mean,
            Some(&mut image.errors),
        )
        .map_err(failed)?;
        Ok(image)
    }
}

/// Writes the Mueller matrices of masks to a store, one slice per mask.
///
/// # Errors
/// Returns [`ProbeError`] if the store cannot be created or written.
pub fn write_store(
    path: &Path,
    images: &[MuellerImage],
    nm: f64,
    attributes: &Map<String, Value>,
    replace: bool,
) -> Result<(), ProbeError> {
    let layout = |image: &MuellerImage| {
        let axis = |kind, coords: Vec<f64>, chunk: u64| Axis {
            kind,
            chunk: chunk.clamp(1, coords.len().max(1) as u64),
            coords,
        };
        let indices = |n: usize| (0..n).map(|i| i as f64).collect::<Vec<f64>>();
        let Layout { height, width, times, .. } = image.layout;
        let mut axes = vec![axis(AxisKind::Y, indices(height), 32), axis(AxisKind::X, indices(width), 32)];
        if let Some((start, bin)) = image.time {
            let centres = (0..times).map(|i| start + (i as f64 + 0.5) * bin).collect();
            axes.push(axis(AxisKind::T, centres, 128));
        }
        axes.push(axis(AxisKind::StokesOut, indices(4), 4));
        axes.push(axis(AxisKind::StokesIn, indices(4), 4));
        axes.push(axis(AxisKind::Wavelength, vec![nm], 1));
        let mut slice = Map::new();
        slice.insert("mask".into(), json!(image.name));
        let layout = SliceLayout { name: image.name.clone(), axes, time: image.time, totals: false };
        (layout, slice)
    };
    let slices: Vec<_> = images.iter().map(layout).collect();
    let fill = |store: &TensorStore| -> Result<(), ProbeError> {
        let failed =
            |e: store::zarr::OpenError| ProbeError::Write { path: path.to_owned(), cause: e.to_string() };
        for (image, (layout, _)) in images.iter().zip(&slices) {
            let slice = store.slice(&image.name).map_err(failed)?;
            let shape = layout.shape();
            let start = vec![0; shape.len()];
            slice.write(Field::Mean, &start, &shape, &image.mean)?;
            slice.write(Field::StdError, &start, &shape, &image.errors)?;
        }
        store.finish().map_err(failed)
    };
    TensorStore::create_filled(path, &slices, attributes, None, replace, fill).map(drop)
}
