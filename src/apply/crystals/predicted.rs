//! Computes the theoretical retardance of every pixel, δ = 2π L (n_e(ψ) - n_o)/λ, along the ray inside the
//! slab.
//!
//! The path length L inside the slab is computed from layers of the scene. The layers are computed for a ray
//! that is refracted with the mean index n̄ at 550 nm. For this ray, the optical path length minus the
//! geometric length is (n̄ - 1) L. Snell's law at the visible face gives the direction. At other wavelengths,
//! L is inversely proportional to the cosine of the angle to the normals of the faces.

use super::mineral::Mineral;
use crate::error::ApplyError;
use crate::map::Map;
use crate::observation::Observation;
use crate::pinhole::Pinhole;
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Wavelength in nanometres. The rays of the layers are refracted with the mean index at this wavelength.
pub const MIDDLE: f64 = 550.0;

/// Maximum relative difference between the path length and the length expected from the slab's thickness.
/// Rays with a larger difference intersect an edge.
const THICKNESS: f64 = 0.01;

/// Ground truth of a slab.
pub struct Slab {
    pub mineral: Mineral,
    /// Optic axis in world coordinates.
    pub axis: Vector3<f64>,
    /// Thickness in metres.
    pub thickness: f64,
}

/// A pixel that shows the slab.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixel {
    /// Index of the pixel, row by row.
    pub pixel: usize,
    /// Signed retardance at every wavelength, in radians.
    pub retardance: Vec<f64>,
    /// Signed optical path difference of the two waves at [`MIDDLE`], in metres.
    pub path: f64,
}

/// Returns |δ| modulo 2π, folded to the range 0..π of the retardance of a decomposition.
pub fn folded(delta: f64) -> f64 {
    let turn = delta.abs() % TAU;
    turn.min(TAU - turn)
}

impl Slab {
    /// Returns the direction inside the slab for a ray that hits a face, and the cosine of the angle between
    /// this direction and the normal. The normal `n` points toward the viewer.
    fn inside(&self, d: Vector3<f64>, n: Vector3<f64>, nm: f64) -> Option<(Vector3<f64>, f64)> {
        let index = self.mineral.indices(nm).iter().sum::<f64>() / 2.0;
        let cos = -d.dot(&n);
        let inside = (1.0 - (1.0 - cos * cos) / (index * index)).sqrt();
        (cos > 0.0).then(|| (d / index + n * (cos / index - inside), inside))
    }

    /// Returns the pixel for the ray in the unit direction `d`, with a path of `length` metres at [`MIDDLE`].
    fn pixel(
        &self,
        pixel: usize,
        d: Vector3<f64>,
        n: Vector3<f64>,
        length: f64,
        nm: &[f64],
    ) -> Option<Pixel> {
        let (_, middle) = self.inside(d, n, MIDDLE)?;
        let thickness = length * middle;
        if (thickness / self.thickness - 1.0).abs() > THICKNESS {
            return None;
        }
        let path = |nm: f64| {
            let (t, cos) = self.inside(d, n, nm)?;
            let psi = t.normalize().dot(&self.axis);
            Some(thickness / cos * self.mineral.birefringence(nm, psi))
        };
        let retardance: Option<Vec<f64>> = nm.iter().map(|nm| Some(TAU * path(*nm)? / (nm * 1e-9))).collect();
        Some(Pixel { pixel, retardance: retardance?, path: path(MIDDLE)? })
    }

    /// Returns all pixels whose rays intersect only the front and back faces of the slab.
    ///
    /// # Errors
    /// [`ApplyError`] if layers are missing or do not have the camera's size.
    pub fn pixels(&self, camera: &Pinhole, o: &Observation, nm: &[f64]) -> Result<Vec<Pixel>, ApplyError> {
        let [w, h] = camera.resolution;
        let layer = |name: &str, channels: usize| -> Result<&Map, ApplyError> {
            let map = o.truth(name)?;
            if (map.width, map.height, map.channels) == (w, h, channels) {
                Ok(map)
            } else {
                Err(o.sizes(format!("the camera and {name}")))
            }
        };
        let (optical, length, normal) =
            (layer("optical length", 1)?, layer("length", 1)?, layer("normal", 3)?);
        let excess = self.mineral.indices(MIDDLE).iter().sum::<f64>() / 2.0 - 1.0;
        let all = (0..h).flat_map(|y| (0..w).map(move |x| (x, y)));
        let found = all.filter_map(|(x, y)| {
            let way = (optical.at(x, y)[0] - length.at(x, y)[0]) / excess;
            let d = (camera.axes * camera.centre(x, y)).normalize();
            let n = Vector3::from_column_slice(normal.at(x, y)).normalize();
            (way > 0.0).then(|| self.pixel(y * w + x, d, n, way, nm)).flatten()
        });
        Ok(found.collect())
    }
}

/// Returns the absolute optical path difference at [`MIDDLE`], below `most` metres, whose folded retardances
/// are closest to the measured retardances. Differences between retardances are in units of `sigma`. The
/// retardances at one wavelength do not determine the number of whole waves, but the retardances at three
/// wavelengths do. The retardance at a wavelength is assumed to be proportional to the birefringence
/// perpendicular to the optic axis, divided by the wavelength.
pub fn order(mineral: Mineral, nm: &[f64], measured: &[f64], sigma: &[f64], most: f64) -> f64 {
    const STEPS_A_WAVE: f64 = 100.0;
    let ratio = |nm: f64| mineral.birefringence(nm, 0.0) / mineral.birefringence(MIDDLE, 0.0);
    let turns: Vec<f64> = nm.iter().map(|nm| TAU * ratio(*nm) / (nm * 1e-9)).collect();
    let step = MIDDLE * 1e-9 / STEPS_A_WAVE;
    let cost = |path: f64| -> f64 {
        let of = |((m, s), t): ((&f64, &f64), &f64)| ((folded(path * t) - m) / s).powi(2);
        measured.iter().zip(sigma).zip(&turns).map(of).sum()
    };
    let all = (0..(most / step) as usize).map(|i| i as f64 * step);
    all.min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn retardance_is_folded_to_the_range_of_a_decomposition() {
        for (delta, seen) in [(0.5, 0.5), (-0.5, 0.5), (PI + 0.2, PI - 0.2), (2.0 * TAU + 0.1, 0.1)] {
            approx::assert_abs_diff_eq!(folded(delta), seen, epsilon = 1e-12);
        }
    }

    /// A slab that is cut perpendicular to the optic axis has no retardance along the axis. At 30° to the
    /// axis, the retardance follows from Snell's law.
    #[test]
    fn slab_retardance_matches_the_closed_form() {
        let slab = Slab { mineral: Mineral::Quartz, axis: Vector3::z(), thickness: 0.01 };
        let along = slab.pixel(0, -Vector3::z(), Vector3::z(), 0.01, &[450.0, 660.0]).expect("it");
        assert!(along.path.abs() < 1e-12);
        let angle = 0.1_f64;
        let d = Vector3::new(angle.sin(), 0.0, -angle.cos());
        let [o, e] = Mineral::Quartz.indices(MIDDLE);
        let inside = (angle.sin() / ((o + e) / 2.0)).asin();
        let length = 0.01 / inside.cos();
        let got = slab.pixel(0, d, Vector3::z(), length, &[MIDDLE]).expect("it");
        let near_axis = length * inside.sin().powi(2) * (e - o);
        assert!((got.path / near_axis - 1.0).abs() < 0.02, "{} {near_axis}", got.path);
        approx::assert_relative_eq!(got.retardance[0], TAU * got.path / 550e-9, epsilon = 1e-9);
        // A ray that intersects an edge is rejected.
        assert_eq!(slab.pixel(0, d, Vector3::z(), 0.5 * length, &[MIDDLE]), None);
    }

    #[test]
    fn three_wavelengths_determine_the_order() {
        let nm = [450.0, 550.0, 660.0];
        for mineral in [Mineral::Quartz, Mineral::Calcite] {
            for path in [0.2e-6, 0.9e-6, 1.7e-6, 2.6e-6] {
                let ratio = |nm| mineral.birefringence(nm, 0.0) / mineral.birefringence(MIDDLE, 0.0);
                let seen = nm.map(|nm| folded(TAU * path * ratio(nm) / (nm * 1e-9)));
                let got = order(mineral, &nm, &seen, &[0.02; 3], 3.3e-6);
                assert!((got - path).abs() < 6e-9, "{mineral:?} {path}: {got}");
            }
        }
    }
}
