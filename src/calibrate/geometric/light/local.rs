//! Computes the projector coordinates of corners with subpixel resolution, by local homographies of
//! the planar board (Moreno & Taubin 2012).

use super::decode::Decoded;
use crate::geometric::homography;
use nalgebra::{Matrix2, Vector2};

/// Projector coordinates of a corner, and their derivative with respect to the camera coordinates.
pub type Thrown = (Vector2<f64>, Matrix2<f64>);

/// Minimum number of decoded pixels around a corner.
const FEWEST: usize = 40;

/// Returns the projector coordinates of corners, or `None` for a corner with too few decoded pixels within
/// `reach`.
pub fn at_corners(decoded: &Decoded, corners: &[Vector2<f64>], reach: f64) -> Vec<Option<Thrown>> {
    corners.iter().map(|c| at_corner(decoded, *c, reach)).collect()
}

fn at_corner(decoded: &Decoded, corner: Vector2<f64>, reach: f64) -> Option<Thrown> {
    let (w, h) = (decoded.width as f64, decoded.height as f64);
    let range = |c: f64, n: f64| {
        ((c - reach).floor().clamp(0.0, n) as usize, (c + reach).ceil().clamp(0.0, n) as usize)
    };
    let ((x0, x1), (y0, y1)) = (range(corner.x, w), range(corner.y, h));
    let (mut from, mut to) = (vec![], vec![]);
    for y in y0..y1 {
        for x in x0..x1 {
            let i = y * decoded.width + x;
            let p = Vector2::new(x as f64 + 0.5, y as f64 + 0.5) - corner;
            let q = Vector2::new(f64::from(decoded.u[i]), f64::from(decoded.v[i]));
            if q.x.is_finite() && q.y.is_finite() && p.norm() <= reach {
                from.push(p);
                to.push(q);
            }
        }
    }
    // Wrongly decoded pixels have large errors. Remove outliers repeatedly.
    for _ in 0..3 {
        if from.len() < FEWEST {
            return None;
        }
        let m = homography::fit(&from, &to)?;
        let off: Vec<f64> =
            from.iter().zip(&to).map(|(p, q)| (homography::apply(&m, *p) - q).norm()).collect();
        let mut sorted = off.clone();
        sorted.sort_by(f64::total_cmp);
        let bound = (4.0 * sorted[sorted.len() / 2]).max(0.5);
        let kept: Vec<usize> = (0..off.len()).filter(|i| off[*i] <= bound).collect();
        if kept.len() == off.len() {
            let at = homography::apply(&m, Vector2::zeros());
            let slope = homography::slope(&m, Vector2::zeros());
            // Pixels on only one side of the corner do not determine its coordinates.
            let middle = from.iter().sum::<Vector2<f64>>() / from.len() as f64;
            return (middle.norm() < 0.5 * reach && at.iter().chain(slope.iter()).all(|x| x.is_finite()))
                .then_some((at, slope));
        }
        from = kept.iter().map(|i| from[*i]).collect();
        to = kept.iter().map(|i| to[*i]).collect();
    }
    let m = homography::fit(&from, &to)?;
    Some((homography::apply(&m, Vector2::zeros()), homography::slope(&m, Vector2::zeros())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantized_pixels_give_subpixel_positions() {
        let m = nalgebra::Matrix3::new(1.1, 0.08, 100.0, -0.1, 0.93, 80.0, 1e-4, -2e-4, 1.0);
        let (w, h) = (80, 60);
        let (mut u, mut v) = (vec![], vec![]);
        for y in 0..h {
            for x in 0..w {
                let q = homography::apply(&m, Vector2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
                u.push((q.x.floor() + 0.5) as f32);
                v.push(if (x + y) % 13 == 0 { 900.0 } else { (q.y.floor() + 0.5) as f32 });
            }
        }
        let decoded = Decoded { width: 80, height: 60, u, v };
        let corners: Vec<_> =
            (0..10).map(|i| Vector2::new(20.3 + 3.7 * f64::from(i), 30.0 - 0.9 * f64::from(i))).collect();
        for (c, found) in corners.iter().zip(at_corners(&decoded, &corners, 14.0)) {
            let (at, slope) = found.expect("enough pixels");
            assert!(
                (at - homography::apply(&m, *c)).norm() < 0.08,
                "{}",
                (at - homography::apply(&m, *c)).norm()
            );
            assert!((slope - homography::slope(&m, *c)).norm() < 0.05);
        }
        assert_eq!(at_corners(&decoded, &[Vector2::new(-50.0, f64::NAN)], 14.0), [None]);
    }
}
