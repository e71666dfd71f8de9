//! Masks. A mask consists of patterns of the projector, and of the camera pixels that are read for each
//! pattern.
//!
//! In epipolar imaging (Baek & Heide 2021, sec. 5.1), the projector shows a stripe along epipolar lines, and
//! only the camera pixels on those lines are read. In non-epipolar imaging, the projector shows everything
//! except the stripe. Stripes are families of epipolar lines of the fundamental matrix. The fundamental
//! matrix applies to ideal pixels, so pixels are undistorted first.

use crate::instrument::{Pattern, Region};
use nalgebra::{Matrix3, Vector3};

/// Maps a pixel (x, y) of a distorted lens to the corresponding pixel of an ideal lens. The centre of the
/// first pixel is at (0.5, 0.5).
pub type Ideal<'a> = &'a (dyn Fn([f64; 2]) -> [f64; 2] + Sync);

/// Epipolar geometry of camera and projector.
#[derive(Clone, Copy)]
pub struct Epipolar<'a> {
    /// Matrix F, with p'ᵀ F p = 0 for ideal camera pixels p and projector pixels p' of the same point.
    pub fundamental: Matrix3<f64>,
    /// Undistorts camera pixels.
    pub camera: Ideal<'a>,
    /// Undistorts projector pixels.
    pub projector: Ideal<'a>,
}

/// One frame of a mask, given by the displayed pattern and the camera region.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// The pattern that the projector shows.
    pub pattern: Pattern,
    /// The part of the sensor that is read.
    pub region: Region,
}

/// The frames of a mask, and the frame in which each camera pixel is read.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    pub name: String,
    pub shots: Vec<Shot>,
    /// For each camera pixel, row by row from the top, the index of its frame in `shots`, or `None` if the
    /// pixel is on no stripe.
    pub shot_of: Vec<Option<u32>>,
}

fn whole(size: [u32; 2]) -> Region {
    Region { x: 0, y: 0, width: size[0], height: size[1] }
}

/// Returns a mask of one frame in which all projector pixels have the value `value` (255 or 0).
pub fn flat(name: &str, value: u8, projector: [u32; 2], camera: [u32; 2]) -> Mask {
    let pattern = Pattern {
        width: projector[0],
        height: projector[1],
        pixels: vec![value; projector[0] as usize * projector[1] as usize],
    };
    Mask {
        name: name.to_owned(),
        shots: vec![Shot { pattern, region: whole(camera) }],
        shot_of: vec![Some(0); camera[0] as usize * camera[1] as usize],
    }
}

/// Returns the coordinate at which a projector line crosses the middle column or, if `upright` is true,
/// the middle row.
fn crossing(line: &Vector3<f64>, upright: bool, size: [u32; 2]) -> f64 {
    let [w, h] = size.map(f64::from);
    if upright { -(line[1] * h / 2.0 + line[2]) / line[0] } else { -(line[0] * w / 2.0 + line[2]) / line[1] }
}

/// Returns the homogeneous epipole e' in the projector, where all epipolar lines meet. The epipole satisfies
/// Fᵀ e' = 0.
fn epipole(f: &Matrix3<f64>) -> Vector3<f64> {
    // The epipole is orthogonal to the columns of F. Two of these columns span the column space.
    let column = |i: usize| f.column(i).into_owned();
    let pairs = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| column(i).cross(&column(j)));
    let longest = pairs.into_iter().max_by(|a, b| a.norm().total_cmp(&b.norm()));
    longest.unwrap_or_default()
}

/// Returns a mask that divides the epipolar lines of the projector into `count` stripes.
///
/// If `inside` is true, each frame shows the lines of its stripe. If `inside` is false, each frame shows all
/// other lines. A camera pixel belongs to the stripe of its epipolar line. Regions are multiples of `steps`.
///
/// # Errors
/// Returns a message if no epipolar line crosses the projector.
pub fn stripes(
    name: &str,
    count: u32,
    inside: bool,
    epipolar: &Epipolar<'_>,
    projector: [u32; 2],
    camera: [u32; 2],
    steps: [u32; 2],
) -> Result<Mask, String> {
    let f = &epipolar.fundamental;
    let e = epipole(f);
    let [w, h] = projector.map(f64::from);
    // Lines from an epipole above or below the projector's image cross the rows of the image.
    let (dx, dy) = (e[0] - e[2] * w / 2.0, e[1] - e[2] * h / 2.0);
    let upright = dy.abs() > dx.abs();
    let across = if upright { w } else { h };
    let stripe = |line: Vector3<f64>| -> Option<u32> {
        let at = crossing(&line, upright, projector) / across * f64::from(count);
        (at.is_finite() && (0.0..f64::from(count)).contains(&at)).then_some(at as u32)
    };
    let of_projector: Vec<Option<u32>> = pixels(projector)
        .map(|p| {
            let [x, y] = (epipolar.projector)(p);
            stripe(e.cross(&Vector3::new(x, y, 1.0)))
        })
        .collect();
    let shot_of: Vec<Option<u32>> = pixels(camera)
        .map(|p| {
            let [x, y] = (epipolar.camera)(p);
            stripe(f * Vector3::new(x, y, 1.0))
        })
        .collect();
    if of_projector.iter().all(Option::is_none) || shot_of.iter().all(Option::is_none) {
        return Err(
            "no epipolar line of the camera crosses the projector; correct the geometry of the rig".into()
        );
    }
    let shot = |i: u32| Shot {
        pattern: Pattern {
            width: projector[0],
            height: projector[1],
            pixels: of_projector.iter().map(|s| if (*s == Some(i)) == inside { 255 } else { 0 }).collect(),
        },
        region: bounds(&shot_of, i, camera, steps),
    };
    Ok(Mask { name: name.to_owned(), shots: (0..count).map(shot).collect(), shot_of })
}

/// Iterates over the centres of pixels, row by row from the top.
fn pixels([w, h]: [u32; 2]) -> impl Iterator<Item = [f64; 2]> {
    (0..h).flat_map(move |y| (0..w).map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]))
}

/// Returns the smallest region, in the camera's steps, that contains all pixels of a shot.
fn bounds(shot_of: &[Option<u32>], shot: u32, camera: [u32; 2], steps: [u32; 2]) -> Region {
    let mut found: Option<[u32; 4]> = None;
    for (i, s) in shot_of.iter().enumerate() {
        if *s == Some(shot) {
            let (x, y) = (i as u32 % camera[0], i as u32 / camera[0]);
            let [x0, y0, x1, y1] = found.unwrap_or([x, y, x, y]);
            found = Some([x0.min(x), y0.min(y), x1.max(x), y1.max(y)]);
        }
    }
    let Some([x0, y0, x1, y1]) = found else {
        // No pixel needs this shot. A minimal region keeps the number of frames constant.
        return Region {
            x: 0,
            y: 0,
            width: steps[0].clamp(1, camera[0]),
            height: steps[1].clamp(1, camera[1]),
        };
    };
    let span = |from: u32, to: u32, step: u32, size: u32| {
        let step = step.max(1);
        let from = from / step * step;
        let to = (to + 1).div_ceil(step) * step;
        (from, to.min(size) - from)
    };
    let (x, width) = span(x0, x1, steps[0], camera[0]);
    let (y, height) = span(y0, y1, steps[1], camera[1]);
    Region { x, y, width, height }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAME: Ideal<'static> = &|p| p;

    /// Returns the geometry of parallel devices side by side, whose epipolar lines are rows.
    fn side_by_side() -> Epipolar<'static> {
        Epipolar {
            fundamental: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0),
            camera: SAME,
            projector: SAME,
        }
    }

    #[test]
    fn rows_are_stripes_of_rectified_pairs() {
        let mask = stripes("epipolar", 4, true, &side_by_side(), [8, 8], [6, 8], [1, 1]).expect("lines");
        assert_eq!(mask.shots.len(), 4);
        for (i, shot) in mask.shots.iter().enumerate() {
            let lit: Vec<usize> = (0..64).filter(|p| shot.pattern.pixels[*p] == 255).map(|p| p / 8).collect();
            assert!(lit.iter().all(|row| row / 2 == i) && lit.len() == 16, "{lit:?}");
            let want = Region { x: 0, y: 2 * i as u32, width: 6, height: 2 };
            assert_eq!(shot.region, want);
        }
        let rest = stripes("rest", 4, false, &side_by_side(), [8, 8], [6, 8], [2, 4]).expect("lines");
        for (a, b) in mask.shots.iter().zip(&rest.shots) {
            let both = a.pattern.pixels.iter().zip(&b.pattern.pixels);
            assert!(both.clone().all(|(a, b)| a != b));
            assert_eq!(b.region.height, 4);
        }
        assert_eq!(mask.shot_of, rest.shot_of);
    }

    /// For any depth, the stripe of a camera pixel contains the projector pixel that illuminates the same
    /// point.
    #[test]
    fn partners_are_in_the_same_stripe() {
        // The projector is rotated, and is translated sideways and forward. Therefore F = K'⁻ᵀ [t]ₓ R K⁻¹.
        let k = Matrix3::new(60.0, 0.0, 32.0, 0.0, 60.0, 24.0, 0.0, 0.0, 1.0);
        let r = *nalgebra::Rotation3::from_euler_angles(0.03, -0.1, 0.05).matrix();
        let t = Vector3::new(0.4, 0.05, 0.1);
        let inverse = k.try_inverse().expect("regular");
        let f = inverse.transpose() * t.cross_matrix() * r * inverse;
        let geometry = Epipolar { fundamental: f, camera: SAME, projector: SAME };
        let mask = stripes("e", 12, true, &geometry, [64, 48], [64, 48], [1, 1]).expect("lines");
        let mut met = 0;
        for y in 0..48 {
            for x in 0..64 {
                for depth in [1.5, 3.0, 8.0] {
                    let p = inverse * Vector3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 1.0) * depth;
                    let q = k * (r * p + t);
                    let (u, v) = ((q[0] / q[2]).floor(), (q[1] / q[2]).floor());
                    // Rows at the edge have only one neighbour.
                    if !(0.0..64.0).contains(&u) || !(1.0..47.0).contains(&v) {
                        continue;
                    }
                    let Some(shot) = mask.shot_of[y as usize * 64 + x as usize] else {
                        continue;
                    };
                    // The corresponding pixel, or a neighbour if the border of a stripe crosses the pixel.
                    let at = |dv: i32| ((v as i32 + dv).clamp(0, 47) * 64 + u as i32) as usize;
                    let lit = |dv| mask.shots[shot as usize].pattern.pixels[at(dv)] == 255;
                    assert!(lit(0) || lit(1) || lit(-1), "{x}, {y} at {depth}: {u}, {v}");
                    met += 1;
                }
            }
        }
        assert!(met > 4000, "{met}");
    }
}
