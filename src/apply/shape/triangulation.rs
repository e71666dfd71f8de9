//! Computes depth from a projector column. The point is the intersection of the camera's ray with the plane
//! of the column (Hartley & Zisserman 2004, ch. 12).
//!
//! The plane of column u contains the projector's centre p and is perpendicular to m = R_p (1, 0, -x),
//! x = (u - c)/f. The ray o + z·d, with d of depth 1, intersects the plane at z = m·(p - o) / m·d.

use crate::map::Map;
use crate::pinhole::Rig;
use nalgebra::Vector3;

/// Returns the depth along the camera's axis of a point in camera pixel (x, y). The point is illuminated by
/// the projector column coordinate `column`. Returns `None` if the ray does not intersect the plane in front
/// of the camera.
pub fn depth_at(rig: &Rig, x: usize, y: usize, column: f64) -> Option<f64> {
    let projector = &rig.projector;
    let across = (column - projector.principal[0]) / projector.focal[0];
    let plane = projector.axes * Vector3::new(1.0, 0.0, -across);
    let ray = rig.camera.axes * rig.camera.centre(x, y);
    let z = plane.dot(&(projector.origin - rig.camera.origin)) / plane.dot(&ray);
    (z > 0.0 && z.is_finite()).then_some(z)
}

/// Returns [`depth_at`] for every pixel, or NaN if there is no intersection.
pub fn depth(rig: &Rig, columns: &Map) -> Map {
    Map::from_fn(columns.width, columns.height, 1, |x, y, out| {
        out[0] = depth_at(rig, x, y, columns.at(x, y)[0]).unwrap_or(f64::NAN);
    })
}

/// Returns the ratio of depth error to column error of a code, |dz/du|, in metres per column. The ratio is
/// computed from differences of half a column.
pub fn depth_per_column(rig: &Rig, x: usize, y: usize, column: f64) -> Option<f64> {
    let near = depth_at(rig, x, y, column - 0.5)?;
    Some((depth_at(rig, x, y, column + 0.5)? - near).abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::synthetic::{Shape, rig};

    #[test]
    fn columns_of_a_sphere_and_a_plane_give_their_depths() {
        let rig = rig(64, 512);
        let plane = Shape::plane(&rig.camera, Vector3::new(0.2, -0.4, -1.0));
        for shape in [Shape::sphere(&rig.camera, 0.04), plane] {
            let depth = depth(&rig, &shape.columns(&rig));
            let mut seen = 0;
            for (got, want) in depth.data.iter().zip(&shape.depth.data) {
                assert_eq!(got.is_nan(), want.is_nan());
                if want.is_finite() {
                    seen += 1;
                    assert!((got - want).abs() < 1e-12, "{got} {want}");
                }
            }
            assert!(seen > 1000, "{seen}");
        }
    }

    /// An error of half a column causes a depth error of half of `depth_per_column`. For two parallel
    /// devices, `depth_per_column` is about z²/(b f).
    #[test]
    fn depth_errors_follow_column_errors() {
        let rig = rig(64, 512);
        let plane = Shape::plane(&rig.camera, -Vector3::z());
        let column = plane.columns(&rig).at(32, 32)[0];
        let per = depth_per_column(&rig, 32, 32, column).expect("in front");
        let off = depth_at(&rig, 32, 32, column + 0.1).expect("in front");
        assert!(((off - plane.depth.at(32, 32)[0]).abs() / (0.1 * per) - 1.0).abs() < 0.01);
        assert!(depth_at(&rig, 32, 32, 1e9).is_none());
        assert!(depth_at(&rig, 32, 32, f64::NAN).is_none());
    }
}
