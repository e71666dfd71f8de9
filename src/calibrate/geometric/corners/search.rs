//! Finds a board of known size in an image and orders its corners.

use super::grid::{Place, extent, grids};
use super::saddle::{SOFT, Saddle, candidates, refine};
use crate::geometric::board::Board;
use crate::geometric::homography;
use crate::geometric::image::Image;
use nalgebra::Vector2;
use std::collections::BTreeMap;

#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Corners in continuous pixels, in the order of [`Board::points`].
    ///
    /// If exactly one candidate corner has a black outer square, that corner is the first. In all other
    /// cases, the corner nearest to the upper left of the image is the first.
    pub corners: Vec<Vector2<f64>>,
    /// Approximate side length of the smallest square in pixels.
    pub smallest: f64,
}

/// The reason why a board is not found.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NotFound {
    #[error(
        "the image shows no chessboard: the complete board must be in the image, in focus, with squares of at least 10 pixels"
    )]
    Nothing,
    #[error(
        "found a chessboard of {0} × {1} inner corners, expected {2} × {3}: set --columns and --rows to the number of inner corners \
         (squares minus one), and keep the complete board visible"
    )]
    Size(usize, usize, usize, usize),
}

/// Standard deviations, in pixels, of the blurs that the corner search applies to the image.
const BLURS: [f32; 3] = [1.2, 2.4, 5.0];

/// Finds a board.
///
/// # Errors
/// Returns [`NotFound`] if the image does not show exactly this board.
pub fn find(image: &Image, board: &Board) -> Result<Found, NotFound> {
    let mut seen = NotFound::Nothing;
    let source = image;
    let image = &source.blurred(SOFT);
    for blur in BLURS {
        let near = candidates(source, blur);
        let radius = f64::from(3.0 * blur).max(4.0);
        let mut all: Vec<Saddle> = near
            .iter()
            .filter_map(|p| refine(image, Vector2::new(p[0] as f64 + 0.5, p[1] as f64 + 0.5), radius))
            .collect();
        apart(&mut all);
        for grid in grids(image, &all) {
            let (start, [w, h]) = extent(&grid);
            let fits = [w, h] == [board.columns, board.rows] || [w, h] == [board.rows, board.columns];
            if !fits {
                if seen == NotFound::Nothing && grid.len() >= 9 {
                    seen = NotFound::Size(w, h, board.columns, board.rows);
                }
                continue;
            }
            let full = filled(image, &grid, &all, start, [w, h]);
            if let Some(found) = full.and_then(|full| in_order(image, &full, [w, h], board)) {
                return Ok(found);
            }
        }
    }
    Err(seen)
}

/// Removes saddles that are duplicates of other saddles.
fn apart(all: &mut Vec<Saddle>) {
    let mut kept: Vec<Saddle> = vec![];
    for s in all.drain(..) {
        if kept.iter().all(|k| (k.at - s.at).norm() > 3.0) {
            kept.push(s);
        }
    }
    *all = kept;
}

/// Returns the corners of the grid row by row. If a few corners are missing, searches for them near their
/// predicted positions.
fn filled(
    image: &Image,
    grid: &BTreeMap<Place, usize>,
    all: &[Saddle],
    start: Place,
    [w, h]: [usize; 2],
) -> Option<Vec<Saddle>> {
    if grid.len() * 5 < w * h * 4 {
        return None;
    }
    let flat = |p: Place| Vector2::new(f64::from(p.0 - start.0), f64::from(p.1 - start.1));
    (0..w * h)
        .map(|i| {
            let place = (start.0 + (i % w) as i32, start.1 + (i / w) as i32);
            if let Some(s) = grid.get(&place) {
                return Some(all[*s]);
            }
            let around: Vec<_> = grid
                .iter()
                .filter(|(p, _)| (p.0 - place.0).abs() <= 2 && (p.1 - place.1).abs() <= 2)
                .collect();
            let from: Vec<_> = around.iter().map(|(p, _)| flat(**p)).collect();
            let to: Vec<_> = around.iter().map(|(_, s)| all[**s].at).collect();
            let there = homography::apply(&homography::fit(&from, &to)?, flat(place));
            refine(image, there, 5.0)
        })
        .collect()
}

/// Radius of the fit window of a corner, relative to the distance from this corner to its nearest neighbour.
const REACH: f64 = 0.4;
/// Minimum and maximum radius of the fit window in pixels.
const WINDOW: [f64; 2] = [3.0, 10.0];

/// Refines each corner in a window adapted to the size of the squares, and orders the corners as on the
/// board.
fn in_order(image: &Image, full: &[Saddle], [w, h]: [usize; 2], board: &Board) -> Option<Found> {
    let mut smallest = f64::INFINITY;
    let mut refined = vec![];
    for (i, s) in full.iter().enumerate() {
        let (x, y) = (i % w, i / w);
        let mut next = vec![];
        if x > 0 {
            next.push(i - 1);
        }
        if x + 1 < w {
            next.push(i + 1);
        }
        if y > 0 {
            next.push(i - w);
        }
        if y + 1 < h {
            next.push(i + w);
        }
        // The width of an obliquely viewed square is smaller than the length of its sides.
        let side = next.iter().map(|n| (full[*n].at - s.at).norm()).fold(f64::INFINITY, f64::min);
        let lean = s.edges[0].perp(&s.edges[1]).abs();
        smallest = smallest.min(side);
        let radius = (REACH * side * (0.4 + 0.6 * lean)).clamp(WINDOW[0], WINDOW[1]);
        refined.push(refine(image, s.at, radius)?);
    }
    // Returns the order of corners after a rotation of the grid by a multiple of 90°.
    let turned = |quarter: usize| -> Vec<usize> {
        let (c, r) = (board.columns, board.rows);
        (0..c * r)
            .map(|i| {
                let (x, y) = (i % c, i / c);
                let (x, y) = match quarter {
                    0 => (x, y),
                    1 => (w - 1 - y.min(w - 1), x),
                    2 => (w - 1 - x.min(w - 1), h - 1 - y.min(h - 1)),
                    _ => (y, h - 1 - x.min(h - 1)),
                };
                y * w + x
            })
            .collect()
    };
    let quarters = (0..4).filter(|q| [board.columns, board.rows] == if q % 2 == 0 { [w, h] } else { [h, w] });
    let orders: Vec<Vec<usize>> = quarters.map(turned).collect();
    let dark = |order: &Vec<usize>| {
        // The square outside the first corner.
        let (a, b, c) = (&refined[order[0]], &refined[order[1]], &refined[order[board.columns]]);
        let outward = a.at - (b.at - a.at) * 0.3 - (c.at - a.at) * 0.3;
        let inward = a.at + (b.at - a.at) * 0.3 - (c.at - a.at) * 0.3;
        image.between(outward.x, outward.y) < image.between(inward.x, inward.y)
    };
    let black: Vec<&Vec<usize>> = orders.iter().filter(|o| dark(o)).collect();
    let choice = match black[..] {
        [one] => one,
        _ => orders.iter().min_by(|a, b| {
            let corner = |o: &Vec<usize>| refined[o[0]].at.sum();
            corner(a).total_cmp(&corner(b))
        })?,
    };
    Some(Found { corners: choice.iter().map(|i| refined[*i].at).collect(), smallest })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometric::device::{Device, Model};
    use crate::geometric::pose::Pose;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    /// Renders a device's image of a board, with 64 sample points per pixel and a white border.
    pub(crate) fn photograph(device: &Device, pose: &Pose, board: &Board) -> Image {
        let [w, h] = device.size.map(|n| n as usize);
        let back = pose.inverse();
        let sample = |x: f64, y: f64| -> f32 {
            let Some(n) = device.normalized(Vector2::new(x, y)) else {
                return 0.0;
            };
            let ray = back.rotation * Vector3::new(n.x, n.y, 1.0);
            let p = back.translation - ray * (back.translation.z / ray.z);
            let (i, j) = ((p.x / board.square + 1.0).floor(), (p.y / board.square + 1.0).floor());
            let inside = (0.0..=board.columns as f64).contains(&i) && (0.0..=board.rows as f64).contains(&j);
            if inside && (i + j) as i64 % 2 == 0 { 20.0 } else { 200.0 }
        };
        let mut values = vec![];
        for y in 0..h {
            for x in 0..w {
                // Low-discrepancy points (Roberts' sequence).
                let part = |k: i32, a: f64| (f64::from(k) * a).fract();
                let points = (0..64)
                    .map(|k| sample(x as f64 + part(k, 0.7548776662), y as f64 + part(k, 0.5698402910)));
                values.push(points.sum::<f32>() / 64.0);
            }
        }
        Image::new(w, h, values).unwrap()
    }

    fn device() -> Device {
        let mut d = Device::pinhole([320, 240], [300.0, 300.0], [160.0, 120.0], Model::Five);
        d.coefficients = vec![-0.2, 0.05, 0.001, -0.001, 0.0];
        d
    }

    #[test]
    #[ignore = "slow: tools/check --all"]
    fn board_corners_are_found_in_order() {
        let board = Board::new(7, 6, 0.03).unwrap();
        let d = device();
        for (i, turn) in [0.0, 1.6, 4.0].into_iter().enumerate() {
            let middle = Pose::new([0.0; 3], [-0.09, -0.075, 0.0]);
            let tilt = Pose::new([0.0, 0.0, turn], [0.0; 3]);
            let pose =
                Pose::new([0.3 - 0.1 * i as f64, 0.2, 0.0], [0.0, 0.01, 0.38]).after(&tilt.after(&middle));
            let image = photograph(&d, &pose, &board);
            let found = find(&image, &board).expect("a board");
            let mut worst = 0.0_f64;
            for (got, x) in found.corners.iter().zip(board.points()) {
                worst = worst.max((got - d.project(&pose.apply(x)).unwrap()).norm());
            }
            assert!(worst < 0.06, "{turn}: {worst}");
        }
        let pose = Pose::new([0.3, 0.2, 0.0], [-0.09, -0.07, 0.4]);
        let other = Board::new(5, 4, 0.03).unwrap();
        let image = photograph(&d, &pose, &board);
        assert_eq!(find(&image, &other), Err(NotFound::Size(7, 6, 5, 4)));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn arbitrary_images_never_panic(w in 1_usize..40, h in 1_usize..40, kind in 0..4, seed in any::<u32>()) {
            let value = |i: usize| match kind {
                0 => (i as u32).wrapping_mul(seed | 1) as f32,
                1 => if (i / 3 + i / w / 3).is_multiple_of(2) { 1e30 } else { -1e30 },
                2 => if (i % w / 5 + i / w / 5).is_multiple_of(2) { 1.0 } else { 0.0 },
                _ => seed as f32,
            };
            let image = Image::new(w, h, (0..w * h).map(value).collect()).unwrap();
            let _ = find(&image, &Board::new(3, 3, 1.0).unwrap());
        }
    }

    #[test]
    fn noise_contains_no_board() {
        let mut x = 1_u32;
        let values = (0..120 * 90)
            .map(|_| {
                x = x.wrapping_mul(1664525).wrapping_add(1013904223);
                (x >> 24) as f32
            })
            .collect();
        let image = Image::new(120, 90, values).unwrap();
        assert!(find(&image, &Board::new(7, 6, 0.03).unwrap()).is_err());
    }
}
