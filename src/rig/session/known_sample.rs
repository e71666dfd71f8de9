//! Computes means over many pixels or scan points from runs of known samples, for calibration.
//!
//! Only the dependence on direction distinguishes the effect of the galvo mirrors from that of the
//! beamsplitter. A scan with mirrors therefore yields one sample at the centre of the scan, and four samples
//! in directions halfway to the edges.

use super::image::{ImageError, Intensities, Run};
use super::rig_file::sample_of;
use crate::calibrate::polarimetric::samples::Sample;
use polarimetry::capture::detector::polarizer_array::Method;
use polarimetry::capture::directions::Directions;
use polarimetry::capture::element::Ray;
use polarimetry::capture::simulate::Layout;
use serde_json::Value;
use std::ops::RangeInclusive;

/// Half-width of the region in the middle of a scan, in units of half the distance between points.
const MIDDLE: usize = 4;
/// Half-width of the four regions in the other directions, in points.
const AROUND: usize = 2;

/// Pixels whose readings are averaged, and the ray that represents these pixels.
struct Region {
    x: RangeInclusive<usize>,
    y: RangeInclusive<usize>,
    ray: Ray,
}

impl Run {
    /// Returns the mean of every measurement of a known sample, one [`Sample`] per direction.
    ///
    /// The first direction is the axis. The sample on the axis is the mean over all pixels of a camera, or
    /// over the points in the middle of a scan. A sufficiently wide scan whose scheme includes the mirrors
    /// has four more directions.
    ///
    /// # Errors
    /// Returns [`ImageError`] if the run has no known sample, has no lit mask, or cannot be read.
    pub fn samples(&self) -> Result<Vec<Sample>, ImageError> {
        let path = self.store.path().display();
        let name = self.store.attributes().get("sample").and_then(Value::as_str);
        let name = name.ok_or_else(|| {
            ImageError(format!(
                "{path}: the run has no known sample; capture a known sample with `sunstone rig run PLAN --sample air`"
            ))
        })?;
        let mueller = sample_of(name).ok_or_else(|| {
            ImageError(format!("{path}: unknown sample `{name}`; expected air, mirror or polarizer"))
        })?;
        let mask = self
            .masks
            .iter()
            .find(|m| *m == "full")
            .or(self.masks.iter().find(|m| *m != "dark"))
            .ok_or_else(|| {
                ImageError(format!(
                    "{path}: the run has no mask that illuminates the sample; use a plan with the mask \"full\""
                ))
            })?;
        let seen = self.intensities(mask, Method::Superpixel)?;
        let of = |(n, region): (usize, Region)| {
            let ([intensities, sigmas], [readings, left_out]) = mean(&seen, &region);
            let name = match n {
                0 => name.to_owned(),
                _ => format!("{name}, direction {n}"),
            };
            Sample {
                name,
                mueller: mueller.map(f64::from),
                scheme: self.scheme.clone(),
                ray: region.ray,
                intensities,
                sigmas,
                readings,
                left_out,
            }
        };
        Ok(self.regions(&seen).into_iter().enumerate().map(of).collect())
    }

    fn regions(&self, seen: &Intensities) -> Vec<Region> {
        let Layout { height, width, .. } = seen.layout;
        let axial = Ray::axial(self.nm);
        if seen.time.is_none() {
            return vec![Region { x: 0..=width, y: 0..=height, ray: axial }];
        }
        // All i for which |2 i + 1 − n| is at most MIDDLE.
        let middle = |n: usize| n.saturating_sub(MIDDLE + 1).div_ceil(2)..=(n + MIDDLE - 1) / 2;
        let mut all = vec![Region { x: middle(width), y: middle(height), ray: axial }];
        let mirrors = self.scheme.coaxial.as_ref().is_some_and(|c| c.galvo.is_some());
        let wide = width.min(height) > 2 * (2 * AROUND + 1);
        if let (true, true, Some(fov)) = (mirrors, wide, self.fov_x) {
            let view = Directions::pinhole(fov, width, height);
            let ends = |n: usize| [AROUND, n / 2, n - 1 - AROUND];
            let (xs, ys) = (ends(width), ends(height));
            for (x, y) in [(xs[0], ys[1]), (xs[2], ys[1]), (xs[1], ys[0]), (xs[1], ys[2])] {
                all.push(Region {
                    x: x - AROUND..=x + AROUND,
                    y: y - AROUND..=y + AROUND,
                    ray: view.ray(x, y, [width, height], self.nm),
                });
            }
        }
        all
    }
}

/// Returns the means of all measurements over a region, their standard deviations, the number of
/// readings, and the number of excluded readings.
fn mean(seen: &Intensities, region: &Region) -> ([Vec<f64>; 2], [usize; 2]) {
    let Layout { width, times, .. } = seen.layout;
    let pixels = seen.layout.pixels().max(1);
    let counted = |p: usize| {
        let place = p / times.max(1);
        region.y.contains(&(place / width.max(1))) && region.x.contains(&(place % width.max(1)))
    };
    let measured = seen.values.chunks_exact(pixels).zip(seen.variances.chunks_exact(pixels));
    let (mut readings, mut left_out) = (0, 0);
    let of = |(values, variances): (&[f32], &[f32])| {
        let (mut n, mut sum, mut square) = (0.0, 0.0, 0.0);
        for (p, (v, s)) in values.iter().zip(variances).enumerate() {
            if !counted(p) {
                continue;
            }
            readings += 1;
            if v.is_finite() && s.is_finite() {
                n += 1.0;
                sum += f64::from(*v);
                square += f64::from(*s);
            } else {
                left_out += 1;
            }
        }
        // The reading of a histogram is the sum over its bins. The variance of the reading is that of all
        // counts.
        let n = if seen.time.is_some() { n / times as f64 } else { n };
        (sum / n, f64::max(square, 1e-300).sqrt() / n)
    };
    let (means, sigmas) = measured.map(of).unzip();
    ([means, sigmas], [readings, left_out])
}
