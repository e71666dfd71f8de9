//! Epipolar planes, which pass through the centres of both devices. An angle about the baseline identifies a
//! plane.
//!
//! Each plane intersects the camera's image in one line and the projector's image in another line. With lens
//! distortion, the lines of intersection are curved.

use super::device::Device;
use super::pose::Pose;
use nalgebra::{Vector2, Vector3};

/// Converts pixels of a camera and a projector to angles of epipolar planes.
#[derive(Clone, Debug)]
pub struct Planes {
    camera: Device,
    projector: Device,
    relative: Pose,
    /// Two unit vectors perpendicular to the baseline, in the camera's frame. The first vector is directed
    /// toward the optical axis, and the second vector is perpendicular to the first.
    across: [Vector3<f64>; 2],
}

/// For each pixel, the index of its band of epipolar planes, or `None` if the lens cannot be inverted at
/// this pixel.
pub type Bands = Vec<Option<u32>>;

impl Planes {
    /// Creates the epipolar planes of a calibration. Returns `None` if the baseline is zero or along the
    /// camera's axis.
    pub fn new(camera: &Device, projector: &Device, relative: &Pose) -> Option<Self> {
        let to = -(relative.rotation.transpose() * relative.translation);
        let base = to.try_normalize(1e-9)?;
        let ahead = (Vector3::z() - base * base.z).try_normalize(1e-6)?;
        Some(Self {
            camera: camera.clone(),
            projector: projector.clone(),
            relative: *relative,
            across: [ahead, base.cross(&ahead)],
        })
    }

    fn angle(&self, ray: Vector3<f64>) -> f64 {
        ray.dot(&self.across[1]).atan2(ray.dot(&self.across[0]))
    }

    /// Returns the angle of the epipolar plane of a camera pixel in radians, after undistortion.
    pub fn of_camera(&self, pixel: Vector2<f64>) -> Option<f64> {
        let n = self.camera.normalized(pixel)?;
        Some(self.angle(Vector3::new(n.x, n.y, 1.0)))
    }

    /// Returns the angle of the epipolar plane of a projector pixel in radians, after undistortion.
    pub fn of_projector(&self, pixel: Vector2<f64>) -> Option<f64> {
        let n = self.projector.normalized(pixel)?;
        Some(self.angle(self.relative.rotation.transpose() * Vector3::new(n.x, n.y, 1.0)))
    }

    /// Returns the angles of all pixel centres of a device, row by row.
    fn all(&self, device: &Device, of: impl Fn(Vector2<f64>) -> Option<f64>) -> Vec<Option<f64>> {
        let [w, h] = device.size;
        let pixels =
            (0..h).flat_map(|y| (0..w).map(move |x| Vector2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)));
        pixels.map(of).collect()
    }

    /// Assigns the pixels of both devices to `count` bands of epipolar planes of equal angular width, over
    /// the range that the projector illuminates.
    ///
    /// A camera pixel receives direct light only from projector pixels of its own band.
    pub fn bands(&self, count: u32) -> [Bands; 2] {
        let camera = self.all(&self.camera, |p| self.of_camera(p));
        let projector = self.all(&self.projector, |p| self.of_projector(p));
        let known = projector.iter().flatten();
        let (least, most) =
            known.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
        let count = f64::from(count.max(1));
        let band = |angle: &Option<f64>| {
            let at = (angle.as_ref()? - least) / (most - least) * count;
            (at >= 0.0 && at <= count).then_some(at.min(count - 1.0) as u32)
        };
        [camera.iter().map(band).collect(), projector.iter().map(band).collect()]
    }

    /// Returns, row by row, which camera pixels have an epipolar line within `reach` projector pixels of a
    /// lit projector pixel. Camera pixels for which the result is false receive only indirect light.
    pub fn lit(&self, lit: &[bool], reach: f64) -> Vec<bool> {
        let projector = self.all(&self.projector, |p| self.of_projector(p));
        let width = self.projector.size[0] as usize;
        // Angular intervals around the planes of the lit pixels, with a half width of `reach` pixels.
        let mut covered = vec![];
        for (i, angle) in projector.iter().enumerate() {
            let (Some(a), Some(true)) = (angle, lit.get(i)) else {
                continue;
            };
            let step = |other: Option<usize>| {
                let there = other.and_then(|j| projector.get(j)).copied().flatten();
                there.map_or(0.0, |b| b - a)
            };
            let beside = if (i + 1) % width == 0 { i.checked_sub(1) } else { Some(i + 1) };
            let below = if i + width < projector.len() { Some(i + width) } else { i.checked_sub(width) };
            let turn = step(beside).hypot(step(below));
            covered.push((a - reach * turn, a + reach * turn));
        }
        covered.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut merged: Vec<(f64, f64)> = vec![];
        for (a, b) in covered {
            match merged.last_mut() {
                Some(last) if a <= last.1 => last.1 = last.1.max(b),
                _ => merged.push((a, b)),
            }
        }
        let camera = self.all(&self.camera, |p| self.of_camera(p));
        camera
            .iter()
            .map(|angle| {
                angle.is_some_and(|a| {
                    let next = merged.partition_point(|(from, _)| *from <= a);
                    next > 0 && a <= merged[next - 1].1
                })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometric::device::Model;
    use proptest::prelude::*;

    fn planes() -> Planes {
        let mut camera = Device::pinhole([64, 48], [60.0, 61.0], [32.0, 24.5], Model::Five);
        camera.coefficients = vec![-0.2, 0.05, 0.002, -0.001, 0.0];
        let mut projector = Device::pinhole([80, 50], [90.0, 90.0], [40.0, 40.0], Model::Five);
        projector.coefficients = vec![0.1, 0.0, 0.0, 0.0, 0.0];
        Planes::new(&camera, &projector, &Pose::new([0.03, -0.2, 0.05], [0.2, 0.04, 0.02])).unwrap()
    }

    proptest! {
        /// Both devices assign a point to the same epipolar plane, and its projector pixel illuminates the
        /// epipolar line of its camera pixel.
        #[test]
        fn both_devices_assign_a_point_to_the_same_plane(x in -0.3..0.3_f64, y in -0.25..0.25_f64, z in 0.7..3.0_f64) {
            let planes = planes();
            let at = Vector3::new(x, y, z);
            let p = planes.camera.project(&at).unwrap();
            let q = planes.projector.project(&planes.relative.apply(at)).unwrap();
            let (Some(a), Some(b)) = (planes.of_camera(p), planes.of_projector(q)) else { return Ok(()) };
            prop_assert!((a - b).abs() < 1e-9, "{a} {b}");
            let inside = |p: Vector2<f64>, [w, h]: [u32; 2]| (0.0..f64::from(w)).contains(&p.x) && (0.0..f64::from(h)).contains(&p.y);
            if inside(p, planes.camera.size) && inside(q, planes.projector.size) {
                let mut lit = vec![false; 80 * 50];
                lit[q.y as usize * 80 + q.x as usize] = true;
                // The reach covers half a projector pixel and half a camera pixel. A camera pixel is 1.5
                // projector pixels wide.
                let seen = planes.lit(&lit, 2.0);
                prop_assert!(seen[p.y as usize * 64 + p.x as usize]);
                prop_assert!(seen.iter().filter(|s| **s).count() < 64 * 48 / 5);
            }
        }
    }

    #[test]
    fn camera_and_projector_bands_share_planes() {
        let planes = planes();
        let [camera, projector] = planes.bands(10);
        assert_eq!((camera.len(), projector.len()), (64 * 48, 80 * 50));
        for k in 0..10 {
            assert!(projector.contains(&Some(k)), "{k}");
        }
        let lit: Vec<bool> = projector.iter().map(|b| *b == Some(4)).collect();
        let seen = planes.lit(&lit, 0.6);
        let of_band = camera.iter().filter(|b| **b == Some(4)).count();
        let both = camera.iter().zip(&seen).filter(|(b, s)| **b == Some(4) && **s).count();
        let outside = camera.iter().zip(&seen).filter(|(b, s)| **b != Some(4) && **s).count();
        assert!(both * 100 > of_band * 98 && outside * 5 < of_band, "{both} of {of_band}, {outside}");
        assert!(Planes::new(&planes.camera, &planes.projector, &Pose::default()).is_none());
    }
}
