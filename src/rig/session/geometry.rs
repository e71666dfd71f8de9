//! Relative geometry of camera and projector in OpenCV's conventions, read from a rig file. Epipolar masks
//! require this geometry.
//!
//! ```toml
//! [geometry]
//! # x' = R x + t, camera to projector; or rodrigues = [rx, ry, rz]
//! rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
//! translation = [0.2, 0, 0]
//! camera = { matrix = [[800, 0, 320], [0, 800, 240], [0, 0, 1]], distortion = [-0.2, 0.1, 0, 0] }
//! projector = { matrix = [[900, 0, 512], [0, 900, 384], [0, 0, 1]] }
//! ```
//!
//! Matrices and distortions follow OpenCV. Pixel centres are at integers, and the coefficients are k1, k2,
//! p1, p2[, k3[, k4, k5, k6[, s1…s4]]].

use super::masks::Epipolar;
use crate::calibrate::geometric::calibration::DeviceTable;
use crate::calibrate::geometric::pose::Pose;
use glam::DVec2;
use nalgebra::{Matrix3, Rotation3, Vector3};
use optics::distortion::Distortion;
use optics::distortion::fisheye::Fisheye;
use optics::distortion::opencv::Opencv;
use serde::Deserialize;

/// The `[geometry]` table of a rig file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GeometryFile {
    rotation: Option<[[f64; 3]; 3]>,
    rodrigues: Option<[f64; 3]>,
    translation: [f64; 3],
    camera: DeviceFile,
    projector: DeviceFile,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct DeviceFile {
    matrix: [[f64; 3]; 3],
    #[serde(default)]
    distortion: Vec<f64>,
}

/// Camera matrix and lens distortion of a device.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    matrix: Matrix3<f64>,
    inverse: Matrix3<f64>,
    distortion: Distortion,
}

impl Lens {
    fn new(file: &DeviceFile, name: &str) -> Result<Self, String> {
        let k = &file.distortion;
        if ![0, 4, 5, 8, 12].contains(&k.len()) {
            return Err(format!(
                "`{name}.distortion` has {} numbers; expected OpenCV's 4, 5, 8 or 12",
                k.len()
            ));
        }
        if let Some(v) = k.iter().find(|v| !v.is_finite()) {
            return Err(format!(
                "`{name}.distortion` contains {v}, which is not a finite number; correct the number"
            ));
        }
        Self::of(file.matrix, Opencv::from_list(k).into(), name)
    }

    fn of(rows: [[f64; 3]; 3], distortion: Distortion, name: &str) -> Result<Self, String> {
        let matrix = Matrix3::from_fn(|i, j| rows[i][j]);
        let finite = matrix.iter().all(|v| v.is_finite());
        let [[fx, ..], [below, fy, _], last] = rows;
        let shape = fx > 0.0 && fy > 0.0 && below == 0.0 && last == [0.0, 0.0, 1.0];
        let inverse = matrix.try_inverse();
        let (true, true, Some(inverse)) = (finite, shape, inverse) else {
            return Err(format!(
                "`{name}.matrix` is {rows:?}; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive fx and fy"
            ));
        };
        Ok(Self { matrix, inverse, distortion })
    }

    /// Creates a lens, and the pose from world to device, from a calibration table.
    fn calibrated(table: &DeviceTable, name: &str) -> Result<(Self, Pose), String> {
        let (device, pose) = table.checked(name)?;
        let distortion = match table.fisheye {
            Some(k) => Distortion::Fisheye(Fisheye { k }),
            None => Opencv::from_list(&device.coefficients).into(),
        };
        Ok((Self::of(table.opencv_matrix, distortion, name)?, pose))
    }

    /// Maps a pixel coordinate to the coordinate for a lens without distortion. The centre of the first pixel
    /// is at (0.5, 0.5). Returns an infinite coordinate if the distortion cannot be inverted at this pixel.
    pub fn ideal(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let q = self.inverse * Vector3::new(x - 0.5, y - 0.5, 1.0);
        let Some(p) = self.distortion.undistort(DVec2::new(q[0], q[1])) else {
            return [f64::INFINITY; 2];
        };
        let p = self.matrix * Vector3::new(p.x, p.y, 1.0);
        [p[0] + 0.5, p[1] + 0.5]
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Geometry {
    /// Fundamental matrix F for undistorted pixels. The centre of the first pixel is at (0.5, 0.5).
    pub fundamental: Matrix3<f64>,
    pub camera: Lens,
    pub projector: Lens,
}

impl Geometry {
    /// Creates a geometry from a rig file's table.
    ///
    /// # Errors
    /// Returns a message that states the fault and the fix, if a value is invalid.
    pub fn new(file: &GeometryFile) -> Result<Self, String> {
        let camera = Lens::new(&file.camera, "camera")?;
        let projector = Lens::new(&file.projector, "projector")?;
        let r = match (file.rotation, file.rodrigues) {
            (Some(rows), None) => Matrix3::from_fn(|i, j| rows[i][j]),
            (None, Some(r)) => *Rotation3::new(Vector3::from(r)).matrix(),
            _ => return Err("set either `rotation` or `rodrigues`".into()),
        };
        Self::between(camera, projector, r, Vector3::from(file.translation))
    }

    /// Creates a geometry from calibration tables. The tables' common frame is arbitrary.
    pub fn calibrated(camera: &DeviceTable, projector: &DeviceTable) -> Result<Self, String> {
        let (camera, from) = Lens::calibrated(camera, "camera")?;
        let (projector, to) = Lens::calibrated(projector, "projector")?;
        let between = to.after(&from.inverse());
        // A distance below one nanometer is due to rounding errors.
        if between.translation.norm() < 1e-9 {
            return Err(
                "camera and projector have the same position; calibrate them at their real positions".into(),
            );
        }
        Self::between(camera, projector, between.rotation, between.translation)
    }

    fn between(camera: Lens, projector: Lens, r: Matrix3<f64>, t: Vector3<f64>) -> Result<Self, String> {
        let orthogonal = (r.transpose() * r - Matrix3::identity()).amax() < 1e-3 && r.determinant() > 0.0;
        let apart = t.norm() > 0.0 && t.norm().is_finite();
        if !orthogonal {
            return Err("`rotation` is not a rotation matrix; copy OpenCV's R".into());
        }
        if !apart {
            return Err(format!(
                "`translation` is {:?}; expected finite numbers that are not all zero: copy OpenCV's t",
                t.as_slice()
            ));
        }
        // Compute F for pixel centres at integers, then shift by half a pixel.
        let f = projector.inverse.transpose() * t.cross_matrix() * r * camera.inverse;
        let mut shift = Matrix3::identity();
        (shift[(0, 2)], shift[(1, 2)]) = (-0.5, -0.5);
        let f = shift.transpose() * f * shift;
        Ok(Self { fundamental: f / f.amax(), camera, projector })
    }

    /// Calls a function with the epipolar geometry from which masks are computed.
    pub fn with<T>(&self, f: impl FnOnce(&Epipolar<'_>) -> T) -> T {
        f(&Epipolar {
            fundamental: self.fundamental,
            camera: &|p| self.camera.ideal(p),
            projector: &|p| self.projector.ideal(p),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::geometric::device::{Device, Model};
    use crate::calibrate::geometric::pose::Pose;

    fn file(distortion: &str) -> GeometryFile {
        let text = format!(
            "rodrigues = [0.01, -0.1, 0.02]\ntranslation = [0.3, 0.02, 0.05]\n\
             camera = {{ matrix = [[60, 0, 31.5], [0, 60, 23.5], [0, 0, 1]], distortion = {distortion} }}\n\
             projector = {{ matrix = [[70, 0, 31.5], [0, 70, 23.5], [0, 0, 1]] }}"
        );
        toml::from_str(&text).expect("a geometry")
    }

    /// Points in space project to ideal pixels with p'ᵀ F p = 0, with and without distortion of the camera's
    /// lens.
    #[test]
    fn points_lie_on_their_epipolar_lines() {
        let g = Geometry::new(&file("[-0.2, 0.05, 0.001, -0.002]")).expect("a geometry");
        let r = *Rotation3::new(Vector3::new(0.01, -0.1, 0.02)).matrix();
        for i in 0..50 {
            let p = Vector3::new(
                f64::from(i % 7) / 10.0 - 0.3,
                f64::from(i % 5) / 10.0 - 0.2,
                1.0 + f64::from(i) / 20.0,
            );
            let q = r * p + Vector3::new(0.3, 0.02, 0.05);
            let seen = g.camera.distortion.distort(DVec2::new(p[0] / p[2], p[1] / p[2]));
            let pixel = g.camera.matrix * Vector3::new(seen.x, seen.y, 1.0);
            let [x, y] = g.camera.ideal([pixel[0] + 0.5, pixel[1] + 0.5]);
            let partner = g.projector.matrix * (q / q[2]);
            let line = g.fundamental * Vector3::new(x, y, 1.0);
            let distance =
                Vector3::new(partner[0] + 0.5, partner[1] + 0.5, 1.0).dot(&line) / line[0].hypot(line[1]);
            assert!(distance.abs() < 1e-9, "{distance}");
        }
    }

    /// Tables from `sunstone calibrate` give the same geometry for any common frame.
    #[test]
    fn calibrations_give_the_same_geometry() {
        let given = Geometry::new(&file("[-0.2, 0.05, 0.001, -0.002, 0.0]")).expect("a geometry");
        let between = Pose::new([0.01, -0.1, 0.02], [0.3, 0.02, 0.05]);
        for camera in [Pose::default(), Pose::new([0.3, 0.1, -0.4], [1.0, 2.0, 3.0])] {
            let device = |f: f64, k: &[f64], pose: &Pose| {
                let model = if k.is_empty() { Model::Pinhole } else { Model::Five };
                let mut d = Device::pinhole([64, 48], [f, f], [32.0, 24.0], model);
                d.coefficients = k.to_vec();
                DeviceTable::new(&d, pose)
            };
            let tables = (
                device(60.0, &[-0.2, 0.05, 0.001, -0.002, 0.0], &camera),
                device(70.0, &[], &between.after(&camera)),
            );
            let found = Geometry::calibrated(&tables.0, &tables.1).expect("a geometry");
            assert!((found.fundamental - given.fundamental).amax() < 1e-9);
            assert_eq!(found.camera.distortion, given.camera.distortion);
            let mut torn = tables.0.clone();
            torn.pose.extrinsics.rotation[0][0] = 3.0;
            assert!(Geometry::calibrated(&torn, &tables.1).is_err());
            // Coincident devices have no epipolar lines.
            assert!(Geometry::calibrated(&tables.0, &tables.0).is_err());
        }
    }

    #[test]
    fn invalid_calibrations_are_refused() {
        assert!(Geometry::new(&file("[1.0]")).expect_err("a fault").contains("OpenCV's 4, 5, 8 or 12"));
        let mut none = file("[]");
        none.translation = [0.0; 3];
        assert!(Geometry::new(&none).is_err());
    }
}
