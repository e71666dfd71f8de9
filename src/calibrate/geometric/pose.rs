//! Rigid motions and their small changes.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// The rigid motion x ↦ R x + t in metres, from world (or board) to device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    pub rotation: Matrix3<f64>,
    /// The translation t in metres.
    pub translation: Vector3<f64>,
}

impl Default for Pose {
    fn default() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }
}

impl Pose {
    /// Creates a pose from OpenCV's rvec (axis times angle, in radians) and tvec.
    pub fn new(rotation_vector: [f64; 3], translation: [f64; 3]) -> Self {
        Self {
            rotation: *Rotation3::new(Vector3::from(rotation_vector)).matrix(),
            translation: translation.into(),
        }
    }

    /// Returns the device coordinates of a point in world coordinates.
    #[inline]
    pub fn apply(&self, x: Vector3<f64>) -> Vector3<f64> {
        self.rotation * x + self.translation
    }

    /// Returns the composition of two poses, which applies first `inner` and then this pose.
    pub fn after(&self, inner: &Self) -> Self {
        Self {
            rotation: self.rotation * inner.rotation,
            translation: self.rotation * inner.translation + self.translation,
        }
    }

    /// Returns the inverse pose, from device to world.
    pub fn inverse(&self) -> Self {
        let back = self.rotation.transpose();
        Self { rotation: back, translation: -(back * self.translation) }
    }

    /// Returns the pose rotated by exp(ω) in the device's frame and translated by δt. Covariances refer to
    /// these six parameters, with ω in radians and δt in metres.
    pub fn changed(&self, change: [f64; 6]) -> Self {
        let [a, b, c, x, y, z] = change;
        let turn = Rotation3::new(Vector3::new(a, b, c));
        Self {
            rotation: nearest_rotation(turn.matrix() * self.rotation),
            translation: self.translation + Vector3::new(x, y, z),
        }
    }

    /// Returns the change (ω, δt) for which [`Self::changed`] maps `from` to this pose.
    pub fn change_from(&self, from: &Self) -> [f64; 6] {
        let w = logarithm(&(self.rotation * from.rotation.transpose()));
        let d = self.translation - from.translation;
        [w.x, w.y, w.z, d.x, d.y, d.z]
    }

    /// Returns OpenCV's rvec, which is the rotation axis times the angle in radians.
    pub fn rotation_vector(&self) -> Vector3<f64> {
        logarithm(&self.rotation)
    }
}

/// Returns the rotation vector of a rotation matrix, which is the rotation axis times the angle in radians.
fn logarithm(r: &Matrix3<f64>) -> Vector3<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*r)).scaled_axis()
}

/// Removes rounding errors from a rotation by one Newton–Schulz step, which squares the deviation
/// from orthogonality.
fn nearest_rotation(r: Matrix3<f64>) -> Matrix3<f64> {
    r * (Matrix3::identity() * 3.0 - r.transpose() * r) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn pose_changes_round_trip(a in prop::array::uniform3(-1.5..1.5_f64), b in prop::array::uniform3(-2.0..2.0_f64),
            c in prop::array::uniform6(-0.8..0.8_f64)) {
            let p = Pose::new(a, b);
            let q = p.changed(c);
            let back = q.change_from(&p);
            prop_assert!(c.iter().zip(back).all(|(x, y)| (x - y).abs() < 1e-9), "{c:?} {back:?}");
            let x = Vector3::new(0.3, -0.2, 1.0);
            prop_assert!((p.inverse().apply(p.apply(x)) - x).norm() < 1e-12);
            prop_assert!((q.after(&p).apply(x) - q.apply(p.apply(x))).norm() < 1e-12);
            prop_assert!((Pose::new(p.rotation_vector().into(), b).rotation - p.rotation).norm() < 1e-9);
        }
    }
}
