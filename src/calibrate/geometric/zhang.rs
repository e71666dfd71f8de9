//! Computes initial estimates. Focal lengths are estimated from homographies of the board (Zhang 2000), then
//! poses are estimated.

use super::device::{Device, Model};
use super::homography::{self, null_vector};
use super::pose::Pose;
use nalgebra::{DMatrix, Matrix2, Matrix3, Vector2, Vector3};

/// Returns initial devices, the most likely first:
/// - a device with estimated focal lengths and the principal point in the centre
/// - a device with all intrinsics estimated
/// - three devices with guessed focal lengths
pub fn beginnings(size: [u32; 2], model: Model, homographies: &[Matrix3<f64>]) -> Vec<Device> {
    let [w, h] = size.map(f64::from);
    let middle = Vector2::new(w, h) / 2.0;
    let found = focal_lengths(homographies, middle).map(|f| (f, middle));
    let guesses = [1.2, 0.7, 2.5].map(|s| (Vector2::repeat(s * w.max(h)), middle));
    let all = found.into_iter().chain(intrinsics(homographies, w.max(h))).chain(guesses);
    all.filter(|(f, c)| {
        let sane = |x: f64| (0.05..50.0).contains(&(x / w.max(h)));
        sane(f.x) && sane(f.y) && (c - middle).norm() < 3.0 * w.max(h)
    })
    .map(|(f, c)| Device::pinhole(size, f.into(), c.into(), model))
    .collect()
}

/// Returns the focal lengths for a known principal point, by a least-squares fit of 1/f².
fn focal_lengths(homographies: &[Matrix3<f64>], centre: Vector2<f64>) -> Option<Vector2<f64>> {
    let scale = centre.norm();
    let mut normal = Matrix2::zeros();
    let mut right = Vector2::zeros();
    for h in homographies {
        let shift = Matrix3::new(
            1.0 / scale,
            0.0,
            -centre.x / scale,
            0.0,
            1.0 / scale,
            -centre.y / scale,
            0.0,
            0.0,
            1.0,
        );
        let h = shift * h;
        let (a, b) = (h.column(0), h.column(1));
        let (n, m) = ((a + b).normalize(), (a - b).normalize());
        let (a, b) = (a.normalize(), b.normalize());
        // The two columns are orthogonal. The sum and the difference of the normalized columns are also
        // orthogonal.
        for (p, q) in [(a, b), (n, m)] {
            let row = Vector2::new(p.x * q.x, p.y * q.y);
            normal += row * row.transpose();
            right -= row * (p.z * q.z);
        }
    }
    let inverse = normal.try_inverse()? * right;
    let f = inverse.map(|x| scale / x.sqrt());
    f.iter().all(|x| x.is_finite()).then_some(f)
}

/// Returns the focal lengths and the principal point. The estimated skew is ignored.
fn intrinsics(homographies: &[Matrix3<f64>], scale: f64) -> Option<(Vector2<f64>, Vector2<f64>)> {
    if homographies.len() < 3 {
        return None;
    }
    let mut rows = vec![];
    for h in homographies {
        let s = Matrix3::from_diagonal(&Vector3::new(1.0 / scale, 1.0 / scale, 1.0));
        let h = s * h;
        let h = h / h.column(0).norm();
        let v = |i: usize, j: usize| {
            let (a, b) = (h.column(i), h.column(j));
            [
                a.x * b.x,
                a.x * b.y + a.y * b.x,
                a.y * b.y,
                a.z * b.x + a.x * b.z,
                a.z * b.y + a.y * b.z,
                a.z * b.z,
            ]
        };
        rows.extend(v(0, 1));
        let (p, q) = (v(0, 0), v(1, 1));
        rows.extend((0..6).map(|i| p[i] - q[i]));
    }
    let b = null_vector(&DMatrix::from_row_slice(rows.len() / 6, 6, &rows))?;
    let [b11, b12, b22, b13, b23, b33] = [b[0], b[1], b[2], b[3], b[4], b[5]];
    let det = b11 * b22 - b12 * b12;
    let cy = (b12 * b13 - b11 * b23) / det;
    let l = b33 - (b13 * b13 + cy * (b12 * b13 - b11 * b23)) / b11;
    let fx = (l / b11).sqrt();
    let fy = (l * b11 / det).sqrt();
    let skew = -b12 * fx * fx * fy / l;
    let cx = skew * cy / fy - b13 * fx * fx / l;
    let all = [fx, fy, cx, cy].map(|x| x * scale);
    all.iter().all(|x| x.is_finite()).then(|| (Vector2::new(all[0], all[1]), Vector2::new(all[2], all[3])))
}

/// Returns the pose of the board from the homography that maps the board's plane z = 0 to pixels.
pub fn pose(device: &Device, h: &Matrix3<f64>) -> Option<Pose> {
    let (f, c) = (device.focal, device.centre);
    let back = Matrix3::new(1.0 / f.x, 0.0, -c.x / f.x, 0.0, 1.0 / f.y, -c.y / f.y, 0.0, 0.0, 1.0);
    let m = back * h;
    let mut scale = 2.0 / (m.column(0).norm() + m.column(1).norm());
    if m[(2, 2)] < 0.0 {
        scale = -scale;
    }
    let m = m * scale;
    let (x, y, t) = (m.column(0).into_owned(), m.column(1).into_owned(), m.column(2).into_owned());
    let near = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    if !near.iter().chain(t.iter()).all(|v| v.is_finite()) {
        return None;
    }
    let svd = near.svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    (rotation.determinant() > 0.0 && t.z > 0.0).then_some(Pose { rotation, translation: t })
}

/// Points of a view, given by coordinates on the board in metres and coordinates in the image in pixels.
pub type Matched = (Vec<Vector2<f64>>, Vec<Vector2<f64>>);

/// Returns the homography of each view, from the board's plane to the image.
///
/// # Errors
/// Returns the index, from 0, of a view whose points are collinear.
pub fn homographies(views: &[Matched]) -> Result<Vec<Matrix3<f64>>, usize> {
    let all = views.iter().enumerate();
    all.map(|(i, (board, pixels))| homography::fit(board, pixels).ok_or(i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometric::device::project_all;

    #[test]
    fn initial_estimates_of_exact_pinholes_are_exact() {
        let truth = Device::pinhole([640, 480], [810.0, 790.0], [350.0, 250.0], Model::Pinhole);
        let centred = Device::pinhole([640, 480], [810.0, 790.0], [320.0, 240.0], Model::Pinhole);
        let board: Vec<Vector3<f64>> =
            (0..54).map(|i| Vector3::new(f64::from(i % 9) * 0.025, f64::from(i / 9) * 0.025, 0.0)).collect();
        let flat: Vec<_> = board.iter().map(Vector3::xy).collect();
        let poses: Vec<Pose> = (0..5)
            .map(|i| {
                let a = f64::from(i);
                Pose::new([0.3 * a.sin(), 0.4 * a.cos(), 0.1 * a], [-0.1, -0.07, 0.5 + 0.02 * a])
            })
            .collect();
        let of = |device: &Device| -> Vec<Matrix3<f64>> {
            let views: Vec<_> =
                poses.iter().map(|p| (flat.clone(), project_all(device, p, &board).unwrap())).collect();
            homographies(&views).unwrap()
        };
        let f = focal_lengths(&of(&centred), Vector2::new(320.0, 240.0)).unwrap();
        assert!((f - centred.focal).norm() < 1e-6, "{f}");
        let hs = of(&truth);
        let (f, c) = intrinsics(&hs, 640.0).unwrap();
        assert!((f - truth.focal).norm() < 1e-5 && (c - truth.centre).norm() < 1e-5, "{f} {c}");
        for (h, want) in hs.iter().zip(&poses) {
            let got = pose(&truth, h).unwrap();
            let off = got.change_from(want);
            assert!(off.iter().all(|x| x.abs() < 1e-6), "{off:?}");
        }
    }
}
