//! Converts poses of a scene file to a position and axes in world coordinates.

use super::context::{Context, HUGE};
use base::locate::{InputError, Located};
use glam::{DAffine3, DMat3, DQuat, DVec3, Mat3A, Vec3A};
use std::ops::Range;
use syntax::device::{ExtrinsicsFile, PoseFile};
use syntax::transform::TransformFile;

/// Checks that three numbers are finite and at most [`HUGE`] in magnitude.
pub(crate) fn vector(
    ctx: &Context,
    v: [f64; 3],
    span: Range<usize>,
    what: &str,
) -> Result<Vec3A, InputError> {
    let Some(bad) = v.iter().find(|x| x.is_nan() || x.abs() > HUGE) else {
        return Ok(DVec3::from_array(v).as_vec3a());
    };
    let message = format!("{what} has the component {bad}, outside the supported range");
    Err(ctx.error(span, message, "give three numbers in -1e12..1e12; positions are in metres"))
}

/// Returns an affine map as rows of a 4×4 matrix, with -0 replaced by 0 for readability.
pub(crate) fn rows(map: &DAffine3) -> [[f64; 4]; 4] {
    let m = map.matrix3;
    let row = |i: usize| [m.x_axis[i], m.y_axis[i], m.z_axis[i], map.translation[i]].map(|v| v + 0.0);
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

/// Returns an affine map as the transform of an object.
pub(crate) fn matrix(map: &DAffine3) -> TransformFile {
    TransformFile { matrix: Some(rows(map)), ..TransformFile::default() }
}

/// Returns the position (metres) and the axes (columns: right, down, forward) of a device in world
/// coordinates.
pub(crate) fn pose(ctx: &Context, pose: &Located<PoseFile>) -> Result<(Vec3A, Mat3A), InputError> {
    let span = pose.span();
    match &**pose {
        PoseFile::LookAt(l) => {
            let origin = DVec3::from_array(l.origin);
            let forward = (DVec3::from_array(l.target) - origin).try_normalize();
            let right = forward.and_then(|f| f.cross(DVec3::from_array(l.up)).try_normalize());
            let (Some(forward), Some(right)) = (forward, right) else {
                let message = match forward {
                    None => format!("look_at.target is {:?}, equal to look_at.origin", l.target),
                    Some(_) => format!("look_at.up is {:?}, parallel to the viewing direction", l.up),
                };
                return Err(ctx.error(
                    span,
                    message,
                    "target must differ from origin, and up must not be parallel to the viewing direction",
                ));
            };
            vector(ctx, l.origin, span, "look_at.origin")?;
            let axes = [right, forward.cross(right), forward].map(DVec3::as_vec3a);
            Ok((origin.as_vec3a(), Mat3A::from_cols(axes[0], axes[1], axes[2])))
        }
        PoseFile::Matrix(m) => {
            let column = |j: usize| DVec3::new(m[0][j], m[1][j], m[2][j]);
            let (x, y, z) = (column(0), column(1), column(2));
            let rigid = (x.length() - 1.0).abs() < 1e-4
                && (y.length() - 1.0).abs() < 1e-4
                && (x.cross(y) - z).length() < 1e-3
                && m[3] == [0.0, 0.0, 0.0, 1.0];
            if !rigid {
                return Err(ctx.error(
                    span,
                    format!("the pose matrix {m:?} does not consist of a rotation and a translation"),
                    "give the columns right, down, forward (right-handed unit vectors) and position, with the last row 0 0 0 1",
                ));
            }
            let origin = vector(ctx, column(3).to_array(), span, "the position of the pose matrix")?;
            // Orthonormalize, so that rounding in a calibration file does not scale directions.
            let x = x.normalize();
            let y = (y - x * x.dot(y)).normalize();
            Ok((origin, Mat3A::from_cols(x.as_vec3a(), y.as_vec3a(), x.cross(y).as_vec3a())))
        }
        PoseFile::Extrinsics(e) => extrinsics(ctx, e, span),
    }
}

/// Returns the pose of a device with the extrinsics x_device = R x_world + t. The axes are the rows of R, and
/// the position is -Rᵀ t.
fn extrinsics(ctx: &Context, e: &ExtrinsicsFile, span: Range<usize>) -> Result<(Vec3A, Mat3A), InputError> {
    let error = |message: String, help: &str| ctx.error(span.clone(), message, help);
    let rotation = match (e.rotation, e.rvec) {
        (Some(rows), None) => rotation(rows).map_err(|why| {
            error(why, "copy the rows of the rotation matrix (world to device) from the calibration file")
        })?,
        (None, Some(v)) if v.iter().all(|x| x.abs() < 1e3) => {
            let v = DVec3::from_array(v);
            DMat3::from_quat(DQuat::from_scaled_axis(v))
        }
        (None, Some(v)) => {
            return Err(error(
                format!("rvec is {v:?}, which is not a valid rotation vector"),
                "give the axis times the angle in radians, with components in -1e3..1e3",
            ));
        }
        (r, _) => {
            let got = if r.is_some() { "both" } else { "neither" };
            return Err(error(
                format!("expected exactly one of R and rvec in extrinsics, got {got}"),
                "give R (three rows) or rvec (axis times angle in radians)",
            ));
        }
    };
    let ((Some(t), None) | (None, Some(t))) = (e.t, e.tvec) else {
        let got = if e.t.is_some() { "both" } else { "neither" };
        return Err(error(
            format!("expected exactly one of t and tvec in extrinsics, got {got}"),
            "give t or tvec, in metres",
        ));
    };
    let axes = rotation.transpose();
    let origin = -(axes * DVec3::from_array(t));
    let origin = vector(ctx, origin.to_array(), span.clone(), "the position computed from R and t")?;
    let axes = [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::as_vec3a);
    Ok((origin, Mat3A::from_cols(axes[0], axes[1], axes[2])))
}

/// Largest deviation from an orthonormal matrix that is accepted as rounding of printed digits.
const PRINTED: f64 = 1e-3;

/// Returns the rotation closest to a matrix (given by rows) that was printed with limited precision.
///
/// # Errors
/// Returns a message that states why the matrix is not a rotation.
pub(crate) fn rotation(rows: [[f64; 3]; 3]) -> Result<DMat3, String> {
    let mut r = DMat3::from_cols_array_2d(&rows).transpose();
    let off = r.transpose() * r - DMat3::IDENTITY;
    let worst = off.to_cols_array().iter().fold(0.0_f64, |a, x| a.max(x.abs()));
    if !(r.is_finite() && worst < PRINTED) {
        return Err(format!(
            "R is not a rotation: the columns deviate by {worst:.2} from orthonormal vectors"
        ));
    }
    if r.determinant() < 0.0 {
        return Err("R is a reflection (determinant -1): the sign of one axis is wrong".into());
    }
    // Converge to the closest rotation (Newton–Schulz iteration, quadratic).
    for _ in 0..4 {
        r *= (DMat3::IDENTITY * 3.0 - r.transpose() * r) * 0.5;
    }
    Ok(r)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Tests that rotations rounded to four digits are accepted.
        #[test]
        fn rounded_rotations_are_accepted(v in prop::array::uniform3(-3.0..3.0_f64)) {
            let r = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_array(v)));
            let rows = r.transpose().to_cols_array_2d();
            let printed = rows.map(|row| row.map(|x| (x * 1e4).round() / 1e4));
            let back = rotation(printed).unwrap();
            let off = (back.transpose() * back - DMat3::IDENTITY).to_cols_array();
            prop_assert!(off.iter().all(|x| x.abs() < 1e-14));
            prop_assert!((back - r).to_cols_array().iter().all(|x| x.abs() < 2e-4));
            let mirrored = rotation(printed.map(|[x, y, z]| [-x, y, z]));
            prop_assert!(mirrored.is_err_and(|e| e.contains("reflection")));
            let scaled = rotation(printed.map(|row| row.map(|x| 1.01 * x)));
            prop_assert!(scaled.is_err_and(|e| e.contains("not a rotation")));
        }
    }
}
