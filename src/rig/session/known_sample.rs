//! Runs of known samples, as calibration takes them: means over many pixels or scan points.
//!
//! Mirrors act differently on every direction, and only that tells them from the beamsplitter behind them: a scan gives a sample
//! along its middle, and one along each of four directions between there and its edges.

use super::image::{ImageError, Intensities, Run};
use super::rig_file::sample_of;
use crate::calibrate::polarimetric::samples::Sample;
use polarimetry::capture::detector::polarizer_array::Method;
use polarimetry::capture::directions::Directions;
use polarimetry::capture::element::Ray;
use polarimetry::capture::simulate::Layout;
use serde_json::Value;
use std::ops::RangeInclusive;

/// Points on each side of a scan's middle that count, twice.
const MIDDLE: usize = 4;
/// Points on each side of another direction that count.
const AROUND: usize = 2;

/// Pixels that are taken together, and the ray that stands for them.
struct Region {
    x: RangeInclusive<usize>,
    y: RangeInclusive<usize>,
    ray: Ray,
}

impl Run {
    /// A run of a known sample: for each of its directions the mean of every measurement. One along the axis of all pixels, or of the
    /// points in the middle of a scan; of a scan by mirrors that are part of the scheme four more, where it is wide enough.
    ///
    /// # Errors
    /// [`ImageError`]: the run is of no known sample, nothing was read.
    pub fn samples(&self) -> Result<Vec<Sample>, ImageError> {
        let path = self.store.path().display();
        let name = self.store.attributes().get("sample").and_then(Value::as_str);
        let name = name.ok_or_else(|| {
            ImageError(format!(
                "{path}: this run has no known sample; capture one with `sunstone rig run PLAN --sample air`"
            ))
        })?;
        let mueller =
            sample_of(name).ok_or_else(|| ImageError(format!("{path}: unknown sample `{name}`")))?;
        let mask = self
            .masks
            .iter()
            .find(|m| *m == "full")
            .or(self.masks.iter().find(|m| *m != "dark"))
            .ok_or_else(|| ImageError(format!("{path}: the run has no lit mask")))?;
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
            return vec![Region {
                x: 0..=width,
                y: 0..=height,
                ray: axial,
            }];
        }
        // Those i for which (2 i + 1) is at most MIDDLE from n.
        let middle = |n: usize| n.saturating_sub(MIDDLE + 1).div_ceil(2)..=(n + MIDDLE - 1) / 2;
        let mut all = vec![Region {
            x: middle(width),
            y: middle(height),
            ray: axial,
        }];
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

/// Means of all measurements over a region, and their standard deviations; the number of readings, and of those left out.
fn mean(seen: &Intensities, region: &Region) -> ([Vec<f64>; 2], [usize; 2]) {
    let Layout { width, times, .. } = seen.layout;
    let pixels = seen.layout.pixels().max(1);
    let counted = |p: usize| {
        let place = p / times.max(1);
        region.y.contains(&(place / width.max(1))) && region.x.contains(&(place % width.max(1)))
    };
    let measured = seen
        .values
        .chunks_exact(pixels)
        .zip(seen.variances.chunks_exact(pixels));
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
        // Of histograms the sum over all bins counts, whose variance is that of all counts.
        let n = if seen.time.is_some() { n / times as f64 } else { n };
        (sum / n, f64::max(square, 1e-300).sqrt() / n)
    };
    let (means, sigmas) = measured.map(of).unzip();
    ([means, sigmas], [readings, left_out])
}
