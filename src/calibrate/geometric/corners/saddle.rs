//! Detects single corners. Finds candidates from the curvature of the image, then fits a blurred corner model
//! to obtain subpixel positions.

use crate::geometric::image::Image;
use nalgebra::{SMatrix, SVector, Vector2};

/// A point where four squares meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Saddle {
    /// Position in continuous pixels.
    pub at: Vector2<f64>,
    /// Unit vectors along the two edges that cross at the corner.
    pub edges: [Vector2<f64>; 2],
    /// Half of the brightness difference between white and black. The value is negative if the square between
    /// +e1 and +e2 is black.
    pub contrast: f64,
}

/// Returns local maxima of saddle curvature, strongest first. `sigma` is the standard deviation of the blur
/// in pixels.
pub fn candidates(image: &Image, sigma: f32) -> Vec<[usize; 2]> {
    let smooth = image.blurred(sigma);
    let (w, h) = (image.width as isize, image.height as isize);
    let mut strength = vec![0.0_f32; image.values.len()];
    for y in 1..h - 1 {
        for x in 1..w - 1 {
            let at = |i: isize, j: isize| smooth.at(x + i, y + j);
            let xx = at(1, 0) - 2.0 * at(0, 0) + at(-1, 0);
            let yy = at(0, 1) - 2.0 * at(0, 0) + at(0, -1);
            let xy = 0.25 * (at(1, 1) + at(-1, -1) - at(1, -1) - at(-1, 1));
            strength[(y * w + x) as usize] = (xy * xy - xx * yy).max(0.0);
        }
    }
    let field = Image { values: strength, ..*image };
    // The threshold is relative to a typical candidate, because the strongest candidate can be a specular
    // highlight.
    let mut found = vec![];
    let reach = 3_isize;
    for y in reach..h - reach {
        for x in reach..w - reach {
            let here = field.at(x, y);
            if here <= 0.0 {
                continue;
            }
            let mut neighbours = (-reach..=reach).flat_map(|j| (-reach..=reach).map(move |i| (i, j)));
            let best = neighbours.all(|(i, j)| {
                let other = field.at(x + i, y + j);
                other < here || (other == here && (j, i) <= (0, 0))
            });
            if best {
                found.push((here, [x as usize, y as usize]));
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let Some((typical, _)) = found.get((found.len() / 8).clamp(4, 24).min(found.len().saturating_sub(1)))
    else {
        return vec![];
    };
    let least = 0.02 * typical;
    found.into_iter().filter(|(s, _)| *s > least).take(MOST).map(|(_, p)| p).collect()
}

/// Maximum number of candidate corners in an image.
const MOST: usize = 4000;

/// Parameters of a corner's image. The parameters are position, angles of both edges, blur width, half
/// contrast, and the offset and gradient of a plane.
type Parameters = SVector<f64, 9>;

/// Returns the error function of `x` and its derivative.
fn erf(x: f64) -> [f64; 2] {
    // Abramowitz & Stegun 7.1.26, accurate to 1.5e-7.
    let t = 1.0 / (1.0 + 0.3275911 * x.abs());
    let e = (-x * x).exp();
    let tail =
        t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429)))) * e;
    [(1.0 - tail).copysign(x), std::f64::consts::FRAC_2_SQRT_PI * e]
}

/// Returns I = a + b·erf(n1·d/s)·erf(n2·d/s) + g·d and its derivatives, where d is the offset from the
/// corner.
fn model(p: &Parameters, x: f64, y: f64) -> (f64, Parameters) {
    let (dx, dy) = (x - p[0], y - p[1]);
    let ((s1, c1), (s2, c2)) = (p[2].sin_cos(), p[3].sin_cos());
    let s = p[4];
    // Normal of an edge (cos, sin): (-sin, cos).
    let (u, v) = ((-s1 * dx + c1 * dy) / s, (-s2 * dx + c2 * dy) / s);
    let ([f, df], [g, dg]) = (erf(u), erf(v));
    let b = p[5];
    let (by_u, by_v) = (b * df * g, b * f * dg);
    let value = p[6] + b * f * g + p[7] * dx + p[8] * dy;
    let by = Parameters::from([
        (by_u * s1 + by_v * s2) / s - p[7],
        -(by_u * c1 + by_v * c2) / s - p[8],
        by_u * (-c1 * dx - s1 * dy) / s,
        by_v * (-c2 * dx - s2 * dy) / s,
        -(by_u * u + by_v * v) / s,
        f * g,
        1.0,
        dx,
        dy,
    ]);
    (value, by)
}

/// Blur of images before corners are fitted, in pixels. After this blur, a sharp edge on a pixel border
/// has a Gaussian profile over three pixels.
pub const SOFT: f32 = 0.8;

/// Returns the saddle near a position in an image that is blurred by [`SOFT`]. The model is fitted to the
/// pixels within `radius`. Returns `None` if no corner fits.
pub fn refine(image: &Image, near: Vector2<f64>, radius: f64) -> Option<Saddle> {
    let first = beginning(image, near, radius)?;
    // Start from several blur widths, because a wrong width leads to a local minimum.
    let tries = [1.2, 2.5].map(|width| {
        let mut p = first;
        p[4] = width;
        settle(image, p, radius)
    });
    let (p, off) = tries.into_iter().flatten().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let moved = (Vector2::new(p[0], p[1]) - near).norm();
    let (e1, e2) = (Vector2::new(p[2].cos(), p[2].sin()), Vector2::new(p[3].cos(), p[3].sin()));
    let apart = e1.perp(&e2).abs();
    let sound = off < 0.35 * p[5].abs() && moved < 2.5 && apart > 0.25 && p[4] < radius;
    if !sound {
        return None;
    }
    // Between +e1 and +e2 the model has the sign of (n1·e2)(n2·e1).
    let side = e1.perp(&e2) * e2.perp(&e1);
    Some(Saddle { at: Vector2::new(p[0], p[1]), edges: [e1, e2], contrast: p[5] * side.signum() })
}

/// Estimates the edge directions from sign changes on a ring around the corner. Estimates mean and contrast
/// from the values on the ring.
fn beginning(image: &Image, near: Vector2<f64>, radius: f64) -> Option<Parameters> {
    const RING: usize = 64;
    let ring: Vec<f64> = (0..RING)
        .map(|i| {
            let a = std::f64::consts::TAU * i as f64 / RING as f64;
            let mut sum = 0.0;
            for r in [0.55, 0.75, 0.95] {
                let r = r * radius;
                sum += f64::from(image.between(near.x + r * a.cos(), near.y + r * a.sin())) / 3.0;
            }
            sum
        })
        .collect();
    let mean = ring.iter().sum::<f64>() / RING as f64;
    // A saddle is point-symmetric, so the even part of the values on the ring is used.
    let half: Vec<f64> = (0..RING / 2).map(|i| 0.5 * (ring[i] + ring[i + RING / 2]) - mean).collect();
    let swing = half.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    let odd = (0..RING / 2).map(|i| (0.5 * (ring[i] - ring[i + RING / 2])).powi(2)).sum::<f64>();
    let even = half.iter().map(|v| v * v).sum::<f64>();
    if swing <= 0.0 || odd > even {
        return None;
    }
    let n = RING / 2;
    let mut crossings = vec![];
    for i in 0..n {
        let (a, b) = (half[i], half[(i + 1) % n]);
        if (a > 0.0) != (b > 0.0) {
            let at = i as f64 + a / (a - b);
            crossings.push((std::f64::consts::TAU * at / RING as f64, b > a));
        }
    }
    let [(a, rises), (b, _)] = crossings[..] else {
        return None;
    };
    // The sign of the model midway between both edges determines the sign of the contrast.
    let (_, by) = model(
        &Parameters::from([0.0, 0.0, a, b, 1.0, 1.0, 0.0, 0.0, 0.0]),
        (0.5 * (a + b)).cos() * radius,
        (0.5 * (a + b)).sin() * radius,
    );
    let between = if rises { 1.0 } else { -1.0 };
    let contrast = swing * between * by[5].signum();
    Some(Parameters::from([near.x, near.y, a, b, 1.0, contrast, mean, 0.0, 0.0]))
}

/// Fits the model by Levenberg–Marquardt. Returns the parameters and the root mean square of the residuals.
fn settle(image: &Image, mut p: Parameters, radius: f64) -> Option<(Parameters, f64)> {
    let (cx, cy) = (p[0], p[1]);
    let reach = radius.ceil() as isize + 1;
    let mut pixels = vec![];
    for j in -reach..=reach {
        for i in -reach..=reach {
            let (x, y) = (cx.floor() + i as f64 + 0.5, cy.floor() + j as f64 + 0.5);
            let inside = x > 0.0 && y > 0.0 && x < image.width as f64 && y < image.height as f64;
            if inside && (x - cx).hypot(y - cy) <= radius {
                pixels.push((x, y, f64::from(image.at(x as isize, y as isize))));
            }
        }
    }
    if pixels.len() < 20 {
        return None;
    }
    let cost = |p: &Parameters| pixels.iter().map(|(x, y, v)| (model(p, *x, *y).0 - v).powi(2)).sum::<f64>();
    let mut best = cost(&p);
    let mut damping = 1e-3;
    for _ in 0..40 {
        let mut normal = SMatrix::<f64, 9, 9>::zeros();
        let mut right = Parameters::zeros();
        for (x, y, v) in &pixels {
            let (value, by) = model(&p, *x, *y);
            normal += by * by.transpose();
            right += by * (v - value);
        }
        let before = best;
        loop {
            let mut damped = normal;
            for i in 0..9 {
                damped[(i, i)] += damping * damped[(i, i)] + 1e-12;
            }
            if let Some(step) = damped.cholesky().map(|c| c.solve(&right)) {
                let mut next = p + step;
                next[4] = next[4].abs().clamp(0.8, 20.0);
                let now = cost(&next);
                if now <= best {
                    (p, best, damping) = (next, now, (damping * 0.2).max(1e-9));
                    break;
                }
            }
            damping *= 6.0;
            if damping > 1e6 {
                break;
            }
        }
        if before - best <= 1e-9 * before {
            break;
        }
    }
    let off = (best / pixels.len() as f64).sqrt();
    (off.is_finite() && p.iter().all(|x| x.is_finite())).then_some((p, off))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the image of a corner, averaged over 256 points per pixel.
    fn corner(at: Vector2<f64>, angles: [f64; 2], sign: f64) -> Image {
        let mut values = vec![];
        for y in 0..31 {
            for x in 0..31 {
                let mut sum = 0.0;
                for k in 0..256 {
                    let k = f64::from(k);
                    let dx = f64::from(x) + (k * 0.7548776662).fract() - at.x;
                    let dy = f64::from(y) + (k * 0.5698402910).fract() - at.y;
                    let side = |a: f64| (a.cos() * dy - a.sin() * dx).signum();
                    sum += 100.0 + sign * 60.0 * side(angles[0]) * side(angles[1]);
                }
                values.push((sum / 256.0) as f32);
            }
        }
        Image::new(31, 31, values).unwrap()
    }

    #[test]
    fn derivatives_match_finite_differences() {
        let p = Parameters::from([0.3, -0.2, 0.4, 1.7, 0.9, 30.0, 80.0, 0.4, -0.3]);
        for (x, y) in [(0.5, 0.1), (-0.7, 0.8), (1.3, -0.4)] {
            let (_, by) = model(&p, x, y);
            for i in 0..9 {
                let mut e = Parameters::zeros();
                e[i] = 1e-5;
                let want = (model(&(p + e), x, y).0 - model(&(p - e), x, y).0) / 2e-5;
                assert!((by[i] - want).abs() < 1e-2, "{i}: {} {want}", by[i]);
            }
        }
    }

    /// Without noise, the remaining error is due to the difference between square pixels and the model's
    /// Gaussian blur.
    #[test]
    fn positions_are_accurate_to_three_hundredths_of_a_pixel() {
        let mut worst = 0.0_f64;
        for i in 0..40 {
            let t = f64::from(i);
            let at = Vector2::new(15.5 + 0.9 * (t * 0.7).sin(), 15.5 + 0.9 * (t * 1.3).cos());
            let angles = [0.13 * t, 0.13 * t + 1.0 + 0.05 * f64::from(i % 20)];
            let image = corner(at, angles, if i % 2 == 0 { 1.0 } else { -1.0 }).blurred(SOFT);
            let found = refine(&image, Vector2::new(15.5, 15.5), 6.0).expect("a corner");
            worst = worst.max((found.at - at).norm());
            // A point in the square between the two edges.
            let middle = at + (found.edges[0] + found.edges[1]).normalize() * 5.0;
            let bright = image.between(middle.x, middle.y) > 100.0;
            assert_eq!(bright, found.contrast > 0.0, "{i}");
            assert!((found.contrast.abs() - 60.0).abs() < 6.0, "{}", found.contrast);
        }
        assert!(worst < 0.035, "{worst}");
    }

    #[test]
    fn edges_and_blank_images_have_no_corners() {
        let flat = Image::new(31, 31, vec![7.0; 961]).unwrap();
        assert!(candidates(&flat, 1.5).is_empty());
        assert_eq!(refine(&flat, Vector2::new(15.5, 15.5), 6.0), None);
        let edge =
            Image::new(31, 31, (0..961).map(|i| if i % 31 < 14 { 1.0 } else { 9.0 }).collect()).unwrap();
        assert_eq!(refine(&edge, Vector2::new(14.0, 15.5), 6.0), None);
    }
}
