//! Resolves the 180° ambiguity of normals from polarization without depth. Azimuths are propagated from the
//! outline (Miyazaki et al. 2003; Atkinson & Hancock 2006).
//!
//! At the outline of a smooth object, the normal is perpendicular to the view direction and points outward.
//! From the outline inward, the ambiguity is resolved pixel by pixel in descending order of zenith angle.
//! Each pixel is assigned the candidate normal that is closest to the normals of its resolved neighbours. The
//! result is correct for convex objects. Normals of concave parts have the wrong sign.

use super::polarization::{Cues, candidates};
use crate::map::Map;
use crate::pinhole::Pinhole;
use nalgebra::Vector3;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Maximum distance in pixels, along rows and columns, between a pixel at the outline and the outside pixels
/// that determine the outward direction.
const REACH: isize = 3;

/// A pixel with resolved neighbours, and the zenith angle of the pixel.
struct Next {
    zenith: f64,
    at: [usize; 2],
}

impl Ord for Next {
    fn cmp(&self, other: &Self) -> Ordering {
        self.zenith.total_cmp(&other.zenith).then(other.at.cmp(&self.at))
    }
}

impl PartialOrd for Next {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Next {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Next {}

/// Returns the pixels within `reach` of a pixel, including pixels outside the image.
fn around([x, y]: [usize; 2], reach: isize) -> impl Iterator<Item = [isize; 2]> {
    (-reach..=reach)
        .flat_map(move |j| (-reach..=reach).map(move |i| [x as isize + i, y as isize + j]))
        .filter(move |at| *at != [x as isize, y as isize])
}

/// Returns the normals of the object's pixels. For these pixels, the single channel of `inside` is nonzero.
/// Other pixels and pixels without cues are NaN.
pub fn outward(camera: &Pinhole, cues: &Cues, inside: &Map) -> Map {
    let (w, h) = (inside.width, inside.height);
    let within = |[x, y]: [isize; 2]| x >= 0 && y >= 0 && x < w as isize && y < h as isize;
    let pixel = |at: [isize; 2]| within(at).then(|| at.map(|v| v as usize));
    let is_inside = |at| pixel(at).is_some_and(|[x, y]| inside.at(x, y)[0] != 0.0);
    let known =
        |at: [usize; 2]| is_inside(at.map(|v| v as isize)) && cues.angles.at(at[0], at[1])[1].is_finite();
    let mut normals = Map::from_fn(w, h, 3, |_, _, out| out.fill(f64::NAN));
    let mut queue = BinaryHeap::new();
    let mut queued = vec![false; w * h];
    // Selects the candidate of a pixel that is closest to the direction `toward`.
    let decide = |at: [usize; 2], toward: Vector3<f64>, normals: &mut Map| {
        let [a, b] = candidates(camera, cues, at);
        let chosen = if b.dot(&toward) > a.dot(&toward) { b } else { a };
        let first = (at[1] * w + at[0]) * 3;
        normals.data[first..first + 3].copy_from_slice(chosen.as_slice());
    };
    for at in (0..h).flat_map(|y| (0..w).map(move |x| [x, y])).filter(|at| known(*at)) {
        // The edge of the image is not an outline.
        let beside = around(at, 1).any(|n| within(n) && !is_inside(n));
        if beside {
            let outside = around(at, REACH).filter(|n| within(*n) && !is_inside(*n));
            let toward = outside.fold(Vector3::zeros(), |sum, n| {
                let step = Vector3::new((n[0] - at[0] as isize) as f64, (n[1] - at[1] as isize) as f64, 0.0);
                sum + step / step.norm_squared()
            });
            decide(at, toward, &mut normals);
            queued[at[1] * w + at[0]] = true;
        }
    }
    let ask = |at: [usize; 2], queued: &mut Vec<bool>, queue: &mut BinaryHeap<Next>| {
        for n in around(at, 1).filter_map(pixel) {
            let number = n[1] * w + n[0];
            if !queued[number] && known(n) {
                queued[number] = true;
                let zenith = cues.angles.at(n[0], n[1])[1];
                queue.push(Next { zenith, at: n });
            }
        }
    };
    for at in (0..h).flat_map(|y| (0..w).map(move |x| [x, y])) {
        if normals.at(at[0], at[1])[0].is_finite() {
            ask(at, &mut queued, &mut queue);
        }
    }
    while let Some(Next { at, .. }) = queue.pop() {
        let decided =
            around(at, 1).filter_map(pixel).map(|[x, y]| Vector3::from_column_slice(normals.at(x, y)));
        let toward = decided.filter(|n| n.x.is_finite()).fold(Vector3::zeros(), |sum, n| sum + n);
        decide(at, toward, &mut normals);
        ask(at, &mut queued, &mut queue);
    }
    normals
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::polarization::{Reflection, cues, stokes, tests::mueller};
    use crate::shape::synthetic::{Shape, rig};

    #[test]
    fn half_turns_of_a_sphere_are_resolved_everywhere() {
        let camera = rig(64, 256).camera;
        let shape = Shape::sphere(&camera, 0.035);
        let matrices = mueller(&camera, &shape, 1.5, Reflection::Diffuse);
        let cues = cues(&stokes(&matrices, false), 1.5, Reflection::Diffuse);
        let inside = Map::from_fn(64, 64, 1, |x, y, o| {
            o[0] = f64::from(u8::from(shape.depth.at(x, y)[0].is_finite()));
        });
        let got = outward(&camera, &cues, &inside);
        let mut seen = 0;
        for (got, want) in got.data.chunks(3).zip(shape.normals.data.chunks(3)) {
            assert_eq!(got[0].is_nan(), want[0].is_nan());
            if want[0].is_finite() {
                seen += 1;
                let off: f64 = got.iter().zip(want).map(|(g, w)| (g - w).powi(2)).sum();
                assert!(off < 1e-9, "{got:?} {want:?}");
            }
        }
        assert!(seen > 1000, "{seen}");
    }

    /// If the image contains no outline, no normal is determined.
    #[test]
    fn without_an_outline_no_normals_are_decided() {
        let camera = rig(8, 16).camera;
        let angles = Map::from_fn(8, 8, 3, |_, _, o| o.fill(0.4));
        let all = Map::from_fn(8, 8, 1, |_, _, o| o[0] = 1.0);
        let got = outward(&camera, &Cues { angles }, &all);
        assert!(got.data.iter().all(|v| v.is_nan()));
    }
}
