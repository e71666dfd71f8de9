//! Computes conservative depth bounds for each small pyramid of directions from a point. The bounds are for
//! the nearest primitive, for all other primitives, and for a primitive that occludes everything behind
//! itself.

use super::bvh::{Geometry, Outline, primitives};
use super::instance::Instance;
use super::tree::Child;
use arrayvec::ArrayVec;
use glam::{Mat3A, Vec2, Vec3A};
use obvhs::aabb::Aabb;

/// Enlargement of pyramids as a fraction of their width, to allow for rounding errors.
const MARGIN: f32 = 0.02;
/// Relative margin by which depth bounds are widened.
pub(super) const DEPTH_MARGIN: f32 = 1e-4;
/// Index that denotes no primitive.
pub(super) const NOTHING: u32 = u32::MAX;
/// Minimum distance of primitives from the viewpoint, as a fraction of the scene's extent.
const NEAR: f32 = 1e-3;
/// Minimum ratio of an outline's area to its length, on the plane at distance 1. Below this ratio, the
/// outline is a sliver, and rounding errors may change the orientation of the outline.
const SLIVER: f32 = 1e-5;
/// Minimum sine of the angle between a plane and the line to a corner. Below this sine, the plane is seen
/// nearly edge-on, and depths on the plane are unreliable.
const EDGE_ON: f32 = 1e-3;
/// Relative enlargement of spheres, to allow for rounding errors of their hits.
const ROUND_MARGIN: f32 = 1e-3;
/// Bound on the rounding error of angles between directions, radians. The bound is a hundred times the error
/// of f32 arc tangents.
const ANGLE_MARGIN: f32 = 1e-4;
/// Enlargement of boxes in an instance, as a fraction of the group's size.
const BOX_MARGIN: f32 = 1e-5;
/// Minimum number of triangles for which small boxes of the tree replace the triangles that they contain.
const MANY: usize = 1 << 16;
/// Maximum width of a small box, in pyramid widths.
const SMALL: f32 = 0.5;
/// Fraction of a sphere's angular radius within which all directions certainly hit the sphere.
const WELL_INSIDE: f32 = 0.99;
/// Angle beyond which the tangent is treated as infinite, radians. The angle is just below π/2, where the f32
/// tangent changes sign.
const RIGHT_ANGLE: f32 = 1.57;

/// The bounds of one pyramid. Depths are measured along the axis of the pinhole, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    /// The primitive that may be the nearest in the pyramid.
    pub leaf: u32,
    pub nearest: f32,
    /// Minimum depth of all other primitives.
    pub others: f32,
    /// Depth beyond which everything is occluded.
    pub cover: f32,
}

impl Bounds {
    /// The bounds of a pyramid that contains no primitive.
    const NOTHING: Self =
        Self { leaf: NOTHING, nearest: f32::INFINITY, others: f32::INFINITY, cover: f32::INFINITY };
}

/// The division of directions into pyramids.
#[derive(Clone, Copy)]
pub(super) struct Grid {
    /// First corner of the grid, and number of pyramids per unit length, on the plane at distance 1.
    pub first: Vec2,
    pub density: Vec2,
    pub size: [u32; 2],
}

/// The bounds of all pyramids, to which primitives are added one by one.
pub(super) struct Survey {
    grid: Grid,
    pub bounds: Vec<Bounds>,
}

/// A rectangle of directions on the plane at distance 1.
#[derive(Clone, Copy)]
struct Window {
    lo: Vec2,
    hi: Vec2,
}

impl Window {
    fn about(points: &[Vec2]) -> Self {
        let nothing = Self { lo: Vec2::INFINITY, hi: Vec2::NEG_INFINITY };
        points.iter().fold(nothing, |w, p| Self { lo: w.lo.min(*p), hi: w.hi.max(*p) })
    }

    fn corners(&self) -> [Vec2; 4] {
        let (a, b) = (self.lo, self.hi);
        [a, Vec2::new(b.x, a.y), b, Vec2::new(a.x, b.y)]
    }
}

impl Survey {
    /// Computes the bounds of all primitives of a geometry, as seen from `origin`. `to_local` rotates world
    /// directions to device axes. Returns `None` if a primitive is too close to `origin` for a useful view.
    pub fn of(geometry: &Geometry, grid: Grid, origin: Vec3A, to_local: Mat3A) -> Option<Self> {
        let mut survey = Self { grid, bounds: vec![Bounds::NOTHING; (grid.size[0] * grid.size[1]) as usize] };
        let near = NEAR * geometry.extent;
        let place = |p| to_local * (p - origin);
        if geometry.counts().0 < MANY {
            for (leaf, outline) in geometry.outlines() {
                survey.outline(geometry, leaf, outline, place, near)?;
            }
        } else {
            survey.world(geometry, place, near)?;
        }
        for instance in &geometry.instances {
            let place = |p| to_local * (instance.place(p) - origin);
            survey.boxes(geometry, instance, place, near)?;
        }
        Some(survey)
    }

    /// Adds a primitive of the world to the bounds.
    fn outline(
        &mut self,
        geometry: &Geometry,
        leaf: u32,
        outline: Outline,
        place: impl Fn(Vec3A) -> Vec3A,
        near: f32,
    ) -> Option<()> {
        match outline {
            Outline::Flat { corners } => self.flat(Some(leaf), corners.map(place), near, geometry.skin()),
            Outline::Ball { centre, radius } => self.round(leaf, place(centre), radius, true),
            Outline::Inside { centre, radius } => self.round(leaf, place(centre), radius, false),
        }
    }

    /// Adds the world by traversal of its tree. A box smaller than a pyramid is added as an unknown shape
    /// that occludes nothing.
    fn world(&mut self, geometry: &Geometry, place: impl Fn(Vec3A) -> Vec3A, near: f32) -> Option<()> {
        let pad = Vec3A::splat(BOX_MARGIN * geometry.extent);
        let mut todo = vec![0];
        while let Some(node) = todo.pop() {
            for (aabb, child) in geometry.tree.children(node) {
                if self.cuboid(corners(&aabb, pad).map(&place), near, SMALL) {
                    continue;
                }
                match child {
                    Child::Branch(node) => todo.push(node),
                    // Instances are added separately, with the boxes of their own trees.
                    Child::Leaf(leaf) if leaf & 1 == 1 && (leaf >> 1) as usize >= geometry.quadrics.len() => {
                    }
                    Child::Leaf(leaf) => {
                        for number in primitives(leaf) {
                            if let Some(outline) = geometry.outline(number) {
                                self.outline(geometry, number, outline, &place, near)?;
                            }
                        }
                    }
                }
            }
        }
        Some(())
    }

    /// Adds the boxes of an instance's tree. Replaces each box that is too close to the pinhole by the boxes
    /// of its children. `place` maps points of the group to the pinhole's coordinates (right, down, forward).
    fn boxes(
        &mut self,
        geometry: &Geometry,
        instance: &Instance,
        place: impl Fn(Vec3A) -> Vec3A,
        near: f32,
    ) -> Option<()> {
        let group = &geometry.groups[instance.group as usize];
        let mut todo = vec![0];
        while let Some(node) = todo.pop() {
            for (aabb, child) in group.tree.children(node) {
                let pad = Vec3A::splat(BOX_MARGIN * group.reach);
                if self.cuboid(corners(&aabb, pad).map(&place), near, f32::INFINITY) {
                    continue;
                }
                match child {
                    Child::Branch(node) => todo.push(node),
                    Child::Leaf(leaf) if leaf & 1 == 1 => return None,
                    Child::Leaf(leaf) => {
                        for number in primitives(leaf) {
                            if let Some(Outline::Flat { corners }) = geometry.outline(number) {
                                let skin = group.skin * instance.stretch() + geometry.skin();
                                self.flat(None, corners.map(&place), near, skin)?;
                            }
                        }
                    }
                }
            }
        }
        Some(())
    }

    /// Adds an unknown shape inside the convex hull of `corners`. Returns false without adding the shape if
    /// the hull is too close to the pinhole, or wider than `most` pyramids.
    fn cuboid(&mut self, corners: [Vec3A; 8], near: f32, most: f32) -> bool {
        if corners.iter().all(|c| c.z < 0.0) || self.is_beside(&corners) {
            return true;
        }
        let least = corners.iter().fold(f32::INFINITY, |m, c| m.min(c.z));
        if least <= near {
            return false;
        }
        let points = corners.map(|c| Vec2::new(c.x, c.y) / c.z);
        let window = Window::about(&points);
        if ((window.hi - window.lo) * self.grid.density).max_element() > most {
            return false;
        }
        let [columns, rows] = self.touched(window, 0.0);
        for row in rows {
            for column in columns.clone() {
                self.enter(column, row, NOTHING, least * (1.0 - DEPTH_MARGIN), f32::INFINITY);
            }
        }
        true
    }

    /// Adds a primitive to a pyramid, with its minimum depth and the depth behind which the primitive
    /// occludes everything.
    fn enter(&mut self, column: u32, row: u32, leaf: u32, depth: f32, cover: f32) {
        let p = &mut self.bounds[(row * self.grid.size[0] + column) as usize];
        if depth < p.nearest {
            p.others = p.nearest;
            p.nearest = depth;
            p.leaf = leaf;
        } else {
            p.others = p.others.min(depth);
        }
        p.cover = p.cover.min(cover);
    }

    /// Returns the columns and rows of the pyramids that a window overlaps, after widening the window by
    /// `more`.
    fn touched(&self, window: Window, more: f32) -> [std::ops::Range<u32>; 2] {
        let pad = Vec2::splat(2.0 * MARGIN) + self.grid.density * more;
        let lo = (window.lo - self.grid.first) * self.grid.density - pad;
        let hi = (window.hi - self.grid.first) * self.grid.density + pad + Vec2::ONE;
        [0, 1].map(|k| {
            let end = |v: f32| v.clamp(0.0, self.grid.size[k] as f32) as u32;
            end(lo[k])..end(hi[k])
        })
    }

    /// Returns the window of a pyramid, widened by `MARGIN` of its width and by `more`.
    fn window(&self, column: u32, row: u32, more: f32) -> Window {
        let (a, n) = (Vec2::new(column as f32, row as f32), self.grid.density);
        let wider = Vec2::splat(MARGIN) + n * more;
        Window { lo: self.grid.first + (a - wider) / n, hi: self.grid.first + (a + Vec2::ONE + wider) / n }
    }

    /// Adds a flat primitive. A primitive of an instance has no index and does not occlude.
    fn flat(&mut self, leaf: Option<u32>, corners: [Vec3A; 4], near: f32, skin: f32) -> Option<()> {
        let behind = corners.iter().all(|c| c.z <= near);
        // The part of the primitive in front of the near plane must be outside the image.
        if corners.iter().any(|c| c.z <= near) {
            let close = clip(&clip(&corners, |c| near - c.z), |c| c.z);
            if !self.is_beside(&close) {
                return None;
            }
        }
        if behind {
            return Some(());
        }
        let polygon = clip(&corners, |c| c.z - near);
        let points: ArrayVec<Vec2, 8> = polygon.iter().map(|c| Vec2::new(c.x, c.y) / c.z).collect();
        let fold = |f: fn(f32, f32) -> f32, start: f32| polygon.iter().fold(start, |m, c| f(m, c.z));
        let (least, greatest) = (fold(f32::min, f32::INFINITY), fold(f32::max, 0.0));
        let bounds = Window::about(&points);
        let area: f32 =
            (1..points.len()).map(|i| (points[i - 1] - points[0]).perp_dot(points[i] - points[0])).sum();
        // The orientation of a sliver is unknown, so the bounding box of the sliver is used.
        let turn = if area.abs() > SLIVER * (bounds.hi - bounds.lo).length() { area.signum() } else { 0.0 };
        let normal = (corners[1] - corners[0]).cross(corners[3] - corners[0]);
        let height = normal.dot(corners[0]);
        // Depths on a plane that is nearly edge-on are unknown too.
        let sloped = height.abs() > EDGE_ON * normal.length() * corners[0].length();
        let more = skin / least;
        let [columns, rows] = self.touched(bounds, more);
        for row in rows {
            for column in columns.clone() {
                let window = self.window(column, row, more);
                // The primitive and the pyramid do not overlap if all corners are outside one edge. The
                // primitive covers the pyramid if all corners are inside all edges.
                let (mut apart, mut inside) = (false, turn != 0.0);
                for i in 0..points.len() {
                    let (a, b) = (points[i], points[(i + 1) % points.len()]);
                    let side = |p: Vec2| (b - a).perp_dot(p - a) * turn;
                    let sides = window.corners().map(side);
                    apart |= turn != 0.0 && a != b && sides.iter().all(|s| *s < 0.0);
                    inside &= a == b || sides.iter().all(|s| *s > 0.0);
                }
                if apart {
                    continue;
                }
                // 1/z is linear over the image, so the extreme values are at the corners.
                let inverse = window.corners().map(|p| normal.dot(p.extend(1.0).into()) / height);
                let (lo, hi) = inverse
                    .iter()
                    .fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
                let depth = if sloped && hi > 0.0 { least.max(1.0 / hi) } else { least };
                let cover = if !inside || leaf.is_none() {
                    f32::INFINITY
                } else if sloped && lo > 0.0 {
                    greatest.min(1.0 / lo)
                } else {
                    greatest
                };
                self.enter(
                    column,
                    row,
                    leaf.unwrap_or(NOTHING),
                    depth * (1.0 - DEPTH_MARGIN),
                    cover * (1.0 + DEPTH_MARGIN),
                );
            }
        }
        Some(())
    }

    /// Adds a sphere at `c` (right, down, forward, metres), or an unknown shape inside the sphere.
    fn round(&mut self, leaf: u32, c: Vec3A, radius: f32, solid: bool) -> Option<()> {
        let distance = c.length();
        let radius = radius * (1.0 + ROUND_MARGIN);
        let rim = (radius / distance).min(1.0).asin();
        if distance <= radius {
            return None;
        }
        let ([left, right], [top, bottom]) = (shadow(c.x, c.z, radius), shadow(c.y, c.z, radius));
        let bounds = Window { lo: Vec2::new(left, top), hi: Vec2::new(right, bottom) };
        let [columns, rows] = self.touched(bounds, 0.0);
        for row in rows {
            for column in columns.clone() {
                let window = self.window(column, row, 0.0);
                let middle = ((window.lo + window.hi) * 0.5).extend(1.0);
                let middle = Vec3A::from(middle).normalize();
                let half =
                    window.corners().iter().map(|p| angle(p.extend(1.0).into(), middle)).fold(0.0, f32::max)
                        + ANGLE_MARGIN;
                let off = angle(middle, c);
                if off > rim + half {
                    continue;
                }
                let covered = solid && off < rim * WELL_INSIDE - half;
                // Because rays are slanted, parts of the front hemisphere may be deeper than the centre.
                let cover = if covered {
                    c.z + radius * (1.0 - middle.z * middle.z).sqrt() + half * radius
                } else {
                    f32::INFINITY
                };
                let leaf = if solid { leaf } else { NOTHING };
                self.enter(column, row, leaf, (c.z - radius).max(0.0), cover);
            }
        }
        Some(())
    }

    /// Returns true if all points are outside the image on the same side, or if there are no points.
    fn is_beside(&self, points: &[Vec3A]) -> bool {
        let all = |f: &dyn Fn(&Vec3A) -> f32| points.iter().all(|c| f(c) > 0.0);
        let whole = self.whole();
        all(&|c| whole.lo.x * c.z - c.x)
            || all(&|c| c.x - whole.hi.x * c.z)
            || all(&|c| whole.lo.y * c.z - c.y)
            || all(&|c| c.y - whole.hi.y * c.z)
    }

    fn whole(&self) -> Window {
        let cells = Vec2::new(self.grid.size[0] as f32, self.grid.size[1] as f32);
        let margin = Vec2::splat(MARGIN) / self.grid.density;
        Window { lo: self.grid.first - margin, hi: self.grid.first + cells / self.grid.density + margin }
    }
}

/// Returns the interval of x that a disk at (x, z) covers on the line z = 1, seen from the origin. The
/// origin is outside the disk.
fn shadow(x: f32, z: f32, radius: f32) -> [f32; 2] {
    let (middle, distance) = (x.atan2(z), x.hypot(z));
    if distance <= radius {
        return [f32::NEG_INFINITY, f32::INFINITY];
    }
    let half = (radius / distance).asin();
    let end = |angle: f32| {
        if angle.abs() < RIGHT_ANGLE { angle.tan() } else { f32::INFINITY.copysign(angle) }
    };
    [end(middle - half), end(middle + half)]
}

/// Returns the corners of a box after padding on all sides by `pad`.
fn corners(aabb: &Aabb, pad: Vec3A) -> [Vec3A; 8] {
    let (lo, hi) = (aabb.min - pad, aabb.max + pad);
    [0, 1, 2, 3, 4, 5, 6, 7].map(|i| Vec3A::from_array([0, 1, 2].map(|k| [lo, hi][i >> k & 1][k])))
}

fn angle(a: Vec3A, b: Vec3A) -> f32 {
    a.cross(b).length().atan2(a.dot(b))
}

/// Returns the part of a convex polygon in which `f` is not negative (Sutherland & Hodgman 1974).
fn clip(polygon: &[Vec3A], f: impl Fn(&Vec3A) -> f32) -> ArrayVec<Vec3A, 8> {
    let mut out = ArrayVec::new();
    for (i, b) in polygon.iter().enumerate() {
        let a = &polygon[(i + polygon.len() - 1) % polygon.len()];
        let (fa, fb) = (f(a), f(b));
        if (fa < 0.0) != (fb < 0.0) {
            out.push(*a + (*b - *a) * (fa / (fa - fb)));
        }
        if fb >= 0.0 {
            out.push(*b);
        }
    }
    out
}
