//! Triangulates polygons.
//!
//! A polygon that contains all diagonals from its first corner is triangulated as a fan, and any other
//! polygon by ear clipping (Meisters 1975). Collinear corners remain corners of triangles, because an
//! adjacent polygon can share the corners and the surface must stay closed.

use super::error::ImportError;
use glam::{DVec2, DVec3, Vec3};

/// Maximum number of corners of a polygon that is not a fan, because ear clipping takes quadratic time.
const MOST_CORNERS: usize = 1 << 14;

/// Smallest area, relative to the square of the polygon's extent, that is distinguished from rounding errors.
const FLAT: f64 = 1e-12;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cut {
    /// The triangles cover the polygon exactly.
    Whole,
    /// The triangles cover the polygon approximately, because the outline crosses itself or the corners are
    /// far from a plane.
    Crossing,
    /// The polygon is not a fan and has more than [`MOST_CORNERS`] corners.
    TooLarge,
}

pub(super) const CROSSING: &str =
    "a polygon is self-intersecting or not planar: the triangulation is approximate";

pub(super) fn too_large(corners: usize) -> ImportError {
    ImportError::new(
        format!("a concave polygon has {corners} corners, but at most {MOST_CORNERS} are supported"),
        "triangulate the mesh before export",
    )
}

/// Triangulates a polygon with at least three `corners` and appends triangles of the same winding.
pub(super) fn cut(corners: &[u32], position: impl Fn(u32) -> Vec3, out: &mut Vec<[u32; 3]>) -> Cut {
    if let &[a, b, c] = corners {
        out.push([a, b, c]);
        return Cut::Whole;
    }
    let first = position(corners[0]).as_dvec3();
    let point = |i: u32| position(i).as_dvec3() - first;
    let fan = || corners[1..].windows(2).map(|w| point(w[0]).cross(point(w[1])));
    // Vector along the normal whose length is twice the area (Newell's method).
    let normal: DVec3 = fan().sum();
    let extent = corners.iter().map(|&i| point(i).length_squared());
    let least = FLAT * extent.fold(0.0, f64::max);
    let is_fan = fan().all(|n| n.dot(normal) > least * normal.length());
    let has_inside = normal.length() > least && normal.is_finite();
    if is_fan || !has_inside {
        out.extend(corners[1..].windows(2).map(|w| [corners[0], w[0], w[1]]));
        let is_flat = fan().all(|n| n.length() <= least);
        return if is_fan || is_flat { Cut::Whole } else { Cut::Crossing };
    }
    if corners.len() > MOST_CORNERS {
        return Cut::TooLarge;
    }
    let (u, v) = normal.normalize().any_orthonormal_pair();
    let flat: Vec<DVec2> = corners.iter().map(|&i| DVec2::new(point(i).dot(u), point(i).dot(v))).collect();
    let mut whole = true;
    for ear in clip(&flat, least, &mut whole) {
        out.push(ear.map(|i| corners[i]));
    }
    if whole { Cut::Whole } else { Cut::Crossing }
}

/// Returns twice the area of a triangle, positive if it is counter-clockwise.
fn area(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Returns the ears of a counter-clockwise polygon. Sets `whole` to false if the outline crosses itself.
fn clip(points: &[DVec2], least: f64, whole: &mut bool) -> Vec<[usize; 3]> {
    let mut ring: Vec<usize> = (0..points.len()).collect();
    let mut ears = vec![];
    let mut at = 0;
    while ring.len() >= 3 {
        let n = ring.len();
        let ear = |i: usize| [ring[(i + n - 1) % n], ring[i % n], ring[(i + 1) % n]];
        let bulges = |i: &usize| {
            let [a, b, c] = ear(*i).map(|k| points[k]);
            area(a, b, c) > least
        };
        let is_empty = |i: &usize| {
            let corners = ear(*i).map(|k| points[k]);
            let [a, b, c] = corners;
            !ring.iter().map(|&k| points[k]).any(|p| {
                !corners.contains(&p)
                    && area(a, b, p) >= -least
                    && area(b, c, p) >= -least
                    && area(c, a, p) >= -least
            })
        };
        let found = (at..at + n).find(|i| bulges(i) && is_empty(i));
        let Some(i) = found.or_else(|| (at..at + n).find(bulges)) else {
            // The remaining polygon has no area, unless its outline is clockwise at a corner.
            *whole &= !(0..n).any(|i| {
                let [a, b, c] = ear(i).map(|k| points[k]);
                area(a, b, c) < -least
            });
            // If the corners are not in a plane, the remaining polygon can have an area although its
            // projection has no area.
            ears.extend(ring[1..].windows(2).map(|w| [ring[0], w[0], w[1]]));
            break;
        };
        *whole &= found.is_some();
        ears.push(ear(i));
        ring.remove(i % n);
        // Search for the next ear beyond the neighbour, because adjacent ears would be slivers.
        at = (i % n + 1) % ring.len();
    }
    ears
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, vec3};

    fn area_of(points: &[Vec3], triangles: &[[u32; 3]]) -> DVec3 {
        let corner = |i: u32| points[i as usize].as_dvec3();
        triangles.iter().map(|&[a, b, c]| (corner(b) - corner(a)).cross(corner(c) - corner(a)) / 2.0).sum()
    }

    fn covered(points: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
        triangles.iter().map(|t| area_of(points, &[*t]).length()).sum()
    }

    /// Tests simple polygons with any first corner, winding and plane. The sums of signed and of unsigned
    /// triangle areas equal the shoelace formula. The triangles therefore neither overlap nor extend outside
    /// the polygon.
    #[test]
    fn triangles_cover_a_concave_polygon_exactly() {
        // Outlines as x and y of each corner, with their areas.
        let outlines = [
            // Shapes of a U, an L and a chevron.
            ("0 0  1 0  1 1  0.75 1  0.75 0.25  0.25 0.25  0.25 1  0 1", 0.625),
            ("0 0  1 0  1 0.5  0.5 0.5  0.5 1  0 1", 0.75),
            ("0 0  0.5 0.25  1 0  0.5 1", 0.375),
            // Square with collinear corners on three edges.
            ("0 0  0.5 0  1 0  1 0.25  1 0.5  1 1  0.3 1  0 1", 1.0),
            // Square with a square hole, connected to the outline by an edge in both directions.
            ("0 0  4 0  4 4  0 4  0 0  1 1  1 3  3 3  3 1  1 1", 12.0),
            // Shape of a comb.
            ("0 0  5 0  5 2  4 2  4 1  3 1  3 2  2 2  2 1  1 1  1 2  0 2", 8.0),
        ];
        for (outline, expected) in outlines {
            let numbers: Vec<f32> = outline.split_whitespace().map(|n| n.parse().unwrap()).collect();
            let outline = numbers.as_chunks::<2>().0;
            for first in 0..outline.len() {
                for reversed in [false, true] {
                    let turn = DQuat::from_axis_angle(DVec3::new(1., 2., 3.).normalize(), first as f64);
                    let mut corners: Vec<u32> = (0..outline.len() as u32).collect();
                    corners.rotate_left(first);
                    if reversed {
                        corners.reverse();
                    }
                    let points: Vec<Vec3> = outline
                        .iter()
                        .map(|p| {
                            (turn * DVec3::new(p[0].into(), p[1].into(), 0.0)).as_vec3() + vec3(9., -7., 5.)
                        })
                        .collect();
                    let mut triangles = vec![];
                    let cut = cut(&corners, |i| points[i as usize], &mut triangles);
                    let sign = if reversed { -1.0 } else { 1.0 };
                    let signed = area_of(&points, &triangles).dot(turn * DVec3::Z) * sign;
                    let unsigned = covered(&points, &triangles);
                    assert_eq!(cut, Cut::Whole, "{outline:?} from {first}");
                    assert!(
                        (signed - expected).abs() < 1e-5 && (unsigned - expected).abs() < 1e-5,
                        "{outline:?} from {first}: {signed}, {unsigned}"
                    );
                }
            }
        }
    }

    /// Tests that every edge of the outline is an edge of exactly one triangle, so that adjacent
    /// polygons share all corners.
    #[test]
    fn collinear_corners_stay_corners() {
        let points = [[0., 0.], [0.5, 0.], [1., 0.], [1., 1.], [0.6, 1.], [0.3, 1.], [0., 1.]]
            .map(|[x, y]| vec3(x, y, 0.0));
        let corners: Vec<u32> = (0..7).collect();
        let mut triangles = vec![];
        assert_eq!(cut(&corners, |i| points[i as usize], &mut triangles), Cut::Whole);
        for i in 0..7 {
            let edge = (i, (i + 1) % 7);
            let uses = triangles
                .iter()
                .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
                .filter(|e| *e == edge)
                .count();
            assert_eq!(uses, 1, "edge {edge:?} of {triangles:?}");
        }
    }

    #[test]
    fn convex_polygons_and_bent_quads_are_fans() {
        let points = [vec3(0., 0., 0.), vec3(1., 0., 0.2), vec3(1., 1., 0.), vec3(0., 1., 0.3)];
        let mut triangles = vec![];
        cut(&[0, 1, 2, 3], |i| points[i as usize], &mut triangles);
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    /// Tests a square whose outline includes a corner above one edge, outside the square's plane. A polygon
    /// of n corners gives n - 2 triangles.
    #[test]
    fn corners_off_the_plane_leave_no_hole() {
        let points =
            [[-1., 0., 1.], [1., 0., 1.], [1., 0., -1.], [-1., 0., -1.], [0., 1., -1.]].map(Vec3::from_array);
        let mut triangles = vec![];
        cut(&[0, 1, 2, 3, 4], |i| points[i as usize], &mut triangles);
        assert_eq!(triangles.len(), 3, "{triangles:?}");
        for i in 0..5 {
            let edge = (i, (i + 1) % 5);
            let edges = triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
            assert_eq!(edges.filter(|e| *e == edge).count(), 1, "{edge:?} of {triangles:?}");
        }
    }

    #[test]
    fn crossing_and_flat_polygons_are_distinguished() {
        let mut triangles = vec![];
        // The outlines are bow ties, of which the second has a signed area of zero.
        for y in [4., 3.] {
            let bow = [[0., 0.], [2., 0.], [0., 1.], [2., y]].map(|[x, y]| vec3(x, y, 0.0));
            triangles.clear();
            assert_eq!(cut(&[0, 1, 2, 3], |i| bow[i as usize], &mut triangles), Cut::Crossing);
            assert!(!triangles.is_empty());
        }
        triangles.clear();
        let line = [0., 1., 2., 3.].map(|x| vec3(x, 0.0, 0.0));
        assert_eq!(cut(&[0, 1, 2, 3], |i| line[i as usize], &mut triangles), Cut::Whole);
        assert!(covered(&line, &triangles) == 0.0);
    }
}
