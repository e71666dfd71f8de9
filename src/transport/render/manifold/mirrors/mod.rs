//! The mirrors of a scene, and initial guesses for specular paths over mirrors (Zeltner, Georgiev & Jakob
//! 2020, "Specular manifold sampling for rendering high-frequency caustics and glints").
//!
//! Camera and emitter are points. No subpath and no straight connection therefore samples the light of a
//! surface that is illuminated and seen through mirrors. [`manifold`](super) finds the specular path from a
//! good initial guess.
//!
//! - Flat mirrors: all mirrors in one plane form a group. The mirror image of the end determines the point of
//!   reflection. Each group and each pair of groups therefore has one candidate path. Sequences of three or
//!   more groups are considered only if no other strategy samples the same light.
//! - Curved mirrors: any number of specular paths may exist. One initial guess is sampled at random. If a
//!   fraction p of all guesses leads to a path, the weight of the path is 1/p. The number of further guesses
//!   until the path is found again has the mean 1/p.
//! - Curved glass, and sequences that include a curved mirror: the method is the same as for curved mirrors,
//!   but the guesses are traced rays ([`super::initial_guess`]).

pub(super) mod glints;
mod instances;

use crate::geometry::bvh::{Geometry, Outline};
use crate::geometry::ray::{Hit, Owner, Ray, Surface};
use crate::material::Materials;
use crate::strategy::{Strategies, Strategy};
use arrayvec::ArrayVec;
use glam::{Mat3A, Vec3A};
use glints::{Glints, reflectance};
use instances::{Copied, area, ends, point_on};
use optics::sampling::stream::Stream;
use std::collections::HashMap;

/// Group number of surfaces that are not mirrors.
const NONE: u32 = u32::MAX;
/// Group number of all curved mirrors.
const CURVED: u32 = u32::MAX - 1;

/// Index of a primitive (as in [`Hit::leaf`]) and its owner.
type Key = (u32, Owner);

const EVERY: Owner = Owner::instance(u32::MAX);

/// Maximum number of mirrors in instances that are listed individually, like the mirrors outside instances.
/// If there are more mirrors, the mirrors of each group are listed once, and flat mirrors are sampled at
/// random like curved mirrors.
const MOST_LISTED: usize = 65536;

/// Maximum number of planes of flat mirrors. If there are more planes, flat mirrors are sampled at random
/// like curved mirrors.
const MOST_FLATS: usize = 2048;

/// Maximum number of planes for which pairs of planes are considered.
const MOST_IN_PAIRS: usize = 64;

/// Maximum number of flat mirrors in a sequence.
const MOST_IN_ROW: usize = 8;

/// Maximum number of sequences of a given length that are considered, for sequences of three or more flat
/// mirrors.
const MOST_ROWS: usize = 1024;

/// Estimated intensity of light that curved glass transmits into π sr, relative to a mirror that scatters
/// light uniformly into 4π sr.
const PASSED: f32 = 4.0;

/// Fraction of random target points that are replaced by their image in a flat mirror.
const IMAGED: f32 = 0.25;

/// Tolerance for equal planes. The tolerance applies to normals, and to distances as a fraction of the
/// scene's extent.
const SAME_PLANE: f32 = 1e-4;

/// Maximum distance of a reflection point from the centre of the mirrors in a plane, in units of the mirrors'
/// radius. `REACH` slightly exceeds 1 because of rounding errors. `REACH_BENT` applies if interfaces on the
/// path may shift the reflection point.
const REACH: f32 = 1.001;
const REACH_BENT: f32 = 1.5;

/// Barycentric coordinates of an inner point of triangles and parallelograms at which surfaces are evaluated.
const INSIDE: f32 = 0.3;

/// A point on a group of mirrors, used as the initial guess for a path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seed {
    pub group: u32,
    pub point: Vec3A,
}

/// All mirrors in a plane n·p = d, within a sphere.
#[derive(Clone, Copy, Debug)]
struct Flat {
    n: Vec3A,
    d: f32,
    centre: Vec3A,
    radius: f32,
}

/// An end point and its successive images in flat mirrors, each with the group of its mirror.
type Images = ArrayVec<(u32, Vec3A), { MOST_IN_ROW + 1 }>;

impl Seed {
    /// Returns true if the seed is on a curved mirror.
    #[inline]
    pub fn is_curved(self) -> bool {
        self.group == CURVED
    }
}

#[derive(Debug, Default)]
pub(crate) struct Mirrors {
    flats: Vec<Flat>,
    /// Curved mirrors with their cumulative areas, m².
    curved: Vec<(Outline, f32)>,
    /// Curved mirrors in groups with many instances.
    copied: Copied,
    /// Estimate of the light from curved mirrors. `bright` also includes the light through curved glass.
    pub glints: Glints,
    pub bright: Glints,
    /// Group of each primitive, by [`Hit::leaf`] and [`Hit::owner`]. [`EVERY`] denotes all owners.
    groups: HashMap<Key, u32>,
    /// True if interfaces may shift the point of reflection.
    bent: bool,
    /// True if at least one interface is dispersive.
    pub disperses: bool,
    /// True if at least one crystal produces double images.
    pub splits: bool,
}

impl Flat {
    #[inline]
    fn height(&self, p: Vec3A) -> f32 {
        self.n.dot(p) - self.d
    }

    #[inline]
    fn image(&self, p: Vec3A) -> Vec3A {
        p - self.n * (2.0 * self.height(p))
    }

    /// Returns the reflection point for light between two points, or `None` if the point is outside these
    /// mirrors.
    #[inline]
    fn reflects(&self, a: Vec3A, b: Vec3A, bent: bool) -> Option<Vec3A> {
        let [s, e] = [a, b].map(|p| self.height(p));
        if s * e <= 0.0 {
            return None;
        }
        let p = a + (self.image(b) - a) * (s / (s + e));
        let reach = self.radius * if bent { REACH_BENT } else { REACH };
        (p.distance_squared(self.centre) <= reach * reach).then_some(p)
    }
}

impl Mirrors {
    /// Collects all specularly reflecting surfaces of a scene.
    pub fn new(geometry: &Geometry, materials: &Materials) -> Self {
        let mut out = Self {
            bent: materials.any(Materials::is_interface),
            disperses: materials.any(Materials::disperses),
            splits: materials.any(Materials::splits),
            ..Self::default()
        };
        let mirrors: Vec<f32> =
            (0..materials.list.len() as u32).map(|id| reflectance(materials, id)).collect();
        let reflectance = |s: &Surface| mirrors.get(s.material as usize).copied().unwrap_or(0.0);
        let is_mirror = |s: &Surface| reflectance(s) > 0.0;
        let (mut all, listed) = candidates(geometry, is_mirror);
        if !listed {
            out.copied = copied(geometry, is_mirror, &mut out.groups);
            all.retain(|(key, _)| key.1 == Owner::WORLD);
        }
        let mut planes = HashMap::new();
        let mut pieces: Vec<(Key, Outline, u32, [f32; 2])> = vec![];
        for (key, outline) in all {
            let (surface, flat) = primitive(geometry, key, &outline);
            if !is_mirror(&surface) {
                continue;
            }
            // Flat mirrors with a normal map are treated as curved.
            let group = if flat && !materials.is_turned(surface.material) {
                let d = surface.ng.dot(surface.p);
                let key = [surface.ng.x, surface.ng.y, surface.ng.z, d / geometry.extent];
                let key = key.map(|v| (v / SAME_PLANE).round() as i64);
                *planes.entry((surface.material, key)).or_insert_with(|| {
                    out.flats.push(Flat { n: surface.ng, d, centre: Vec3A::ZERO, radius: 0.0 });
                    out.flats.len() as u32 - 1
                })
            } else {
                CURVED
            };
            let mirrored = reflectance(&surface);
            let all = if materials.is_interface(surface.material) { PASSED } else { mirrored };
            pieces.push((key, outline, group, [mirrored, all]));
        }
        if out.flats.len() > MOST_FLATS {
            out.flats.clear();
            for piece in &mut pieces {
                piece.2 = CURVED;
            }
        }
        let mut all = 0.0;
        for (key, outline, group, _) in &pieces {
            out.groups.insert(*key, *group);
            if *group == CURVED {
                all += area(outline);
                out.curved.push((*outline, all));
            }
        }
        let curved = pieces.iter().filter(|p| p.2 == CURVED);
        let thrown = curved.map(|(_, o, _, share)| (o, ends(o).into(), *share));
        (out.glints, out.bright) = if listed {
            let all = thrown.clone().map(|(o, ends, share)| (o, ends, share[1]));
            let mirrored = thrown.map(|(o, ends, share)| (o, ends, share[0]));
            (Glints::new(mirrored), Glints::new(all))
        } else {
            (Glints::unknown(), Glints::unknown())
        };
        let mut bounds = vec![(Vec3A::INFINITY, Vec3A::NEG_INFINITY); out.flats.len()];
        for (_, outline, group, _) in &pieces {
            if let Some((lo, hi)) = bounds.get_mut(*group as usize) {
                let (a, b) = ends(outline);
                (*lo, *hi) = (lo.min(a), hi.max(b));
            }
        }
        for (flat, (lo, hi)) in out.flats.iter_mut().zip(bounds) {
            flat.centre = 0.5 * (lo + hi);
            flat.radius = 0.5 * (hi - lo).length();
        }
        out
    }

    /// Removes the mirrors that the enabled strategies do not use.
    pub fn only(mut self, strategies: Strategies) -> Self {
        if !strategies.has(Strategy::FlatMirrors) {
            self.flats.clear();
        }
        if !strategies.has(Strategy::CurvedMirrors) {
            self.curved.clear();
            self.copied = Copied::default();
            self.splits = false;
        }
        self
    }

    /// Returns the group of the surface that was hit. For other surfaces, returns an index that no seed has.
    #[inline]
    pub fn group(&self, hit: &Hit) -> u32 {
        let of = |owner| self.groups.get(&(hit.leaf, owner)).copied();
        of(hit.owner).or_else(|| of(EVERY)).unwrap_or(NONE)
    }

    /// Returns the seed at a hit point on a mirror, or `None` on other surfaces.
    #[inline]
    pub fn seed(&self, hit: &Hit, point: Vec3A) -> Option<Seed> {
        let group = self.group(hit);
        (group != NONE).then_some(Seed { group, point })
    }

    /// Returns true if there are no mirrors.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }

    /// Returns true if there are no curved mirrors.
    #[inline]
    pub fn is_flat(&self) -> bool {
        self.curved.is_empty() && self.copied.area() <= 0.0
    }

    /// Returns true if the weights of other strategies must account for paths over flat mirrors from all
    /// vertices.
    #[inline]
    pub fn flats_weigh(&self) -> bool {
        (1..=MOST_IN_PAIRS).contains(&self.flats.len())
    }

    /// Calls `f` with each sequence of one or two flat mirrors that can reflect light from `from` to `to`.
    pub fn flat_paths(&self, from: Vec3A, to: Vec3A, mut f: impl FnMut(&[Seed])) {
        let seed = |group: usize, point| Seed { group: group as u32, point };
        for (i, a) in self.flats.iter().enumerate() {
            if let Some(p) = a.reflects(from, to, self.bent) {
                f(&[seed(i, p)]);
            }
        }
        if self.flats.len() > MOST_IN_PAIRS {
            return;
        }
        for (j, b) in self.flats.iter().enumerate() {
            let image = b.image(to);
            for (i, a) in self.flats.iter().enumerate() {
                if i != j
                    && let Some(p) = a.reflects(from, image, self.bent)
                    && let Some(q) = b.reflects(p, to, self.bent)
                {
                    f(&[seed(i, p), seed(j, q)]);
                }
            }
        }
    }

    /// Returns the maximum length of sequences of flat mirrors.
    fn longest_row(&self) -> usize {
        let next = self.flats.len().saturating_sub(1);
        let mut rows = self.flats.len();
        (1..=MOST_IN_ROW)
            .take_while(|n| {
                rows = if *n > 1 { rows * next } else { rows };
                *n <= 2 || rows <= MOST_ROWS
            })
            .count()
    }

    /// Calls `f` with each sequence of three to `most` flat mirrors that can reflect light between `from` and
    /// `to`. The mirrors of a sequence are in the order from `from` to `to`. If there are many mirrors, the
    /// maximum length is smaller.
    pub fn flat_sequences(&self, from: Vec3A, to: Vec3A, most: usize, f: &mut impl FnMut(&[Seed])) {
        let most = most.min(self.longest_row());
        if self.flats.len() > 1 && most > 2 {
            self.add_rows(from, &mut ArrayVec::from_iter([(NONE, to)]), most, f);
        }
    }

    /// Calls `f` with all sequences that end with the given mirrors. `images` are the end point and its
    /// successive images in the given mirrors, starting with the last mirror on the path.
    fn add_rows(&self, from: Vec3A, images: &mut Images, most: usize, f: &mut impl FnMut(&[Seed])) {
        let (last, image) = *images.last().expect("internal error: no end point");
        for (group, flat) in (0..).zip(&self.flats) {
            if group == last {
                continue;
            }
            images.push((group, flat.image(image)));
            if images.len() > 3
                && let Some(seeds) = self.row(from, images)
            {
                f(&seeds);
            }
            if images.len() <= most {
                self.add_rows(from, images, most, f);
            }
            images.pop();
        }
    }

    /// Returns the reflection points on a sequence of flat mirrors, or `None` if light misses a mirror.
    fn row(&self, mut from: Vec3A, images: &Images) -> Option<ArrayVec<Seed, MOST_IN_ROW>> {
        let mut seeds = ArrayVec::new();
        for pair in images.windows(2).rev() {
            let ([(_, image), (group, _)], flat) = ([pair[0], pair[1]], self.flats.get(pair[1].0 as usize)?);
            from = flat.reflects(from, image, self.bent)?;
            seeds.push(Seed { group, point: from });
        }
        Some(seeds)
    }

    /// Samples a random point on the curved mirrors, or its image in one or more flat mirrors, as the target
    /// of a ray.
    pub fn aim(&self, stream: &mut Stream) -> Option<Vec3A> {
        let mut point = self.draw(stream)?.point;
        if !self.flats.is_empty() {
            while stream.uniform() < IMAGED {
                let i = (stream.uniform() * self.flats.len() as f32) as usize;
                point = self.flats[i.min(self.flats.len() - 1)].image(point);
            }
        }
        Some(point)
    }

    /// Samples a random point on the curved mirrors. Returns `None` if there are no curved mirrors.
    pub fn draw(&self, stream: &mut Stream) -> Option<Seed> {
        let listed = self.curved.last().map_or(0.0, |c| c.1);
        let all = listed + self.copied.area();
        if all <= 0.0 {
            return None;
        }
        let at = stream.uniform() * all;
        let point = if at < listed || self.copied.area() <= 0.0 {
            let i = self.curved.partition_point(|(_, area)| *area <= at);
            let uniforms = stream.uniform2();
            point_on(&self.curved[i.min(self.curved.len() - 1)].0, uniforms)
        } else {
            self.copied.point(at - listed, stream.uniform(), stream.uniform2())
        };
        Some(Seed { group: CURVED, point })
    }
}

/// Returns the primitives that may be mirrors, and true. If there are too many primitives in instances,
/// returns only the primitives outside instances, and false.
fn candidates(geometry: &Geometry, is_mirror: impl Fn(&Surface) -> bool) -> (Vec<(Key, Outline)>, bool) {
    let world = geometry.outlines().map(|(leaf, o)| ((leaf, Owner::WORLD), o));
    let mut all: Vec<_> = world.collect();
    let own = all.len();
    let mut groups: HashMap<u32, Vec<(u32, Outline)>> = HashMap::new();
    for (number, group, place) in geometry.instances() {
        let mirrors = groups.entry(group).or_insert_with(|| {
            let surface = |leaf, o: &Outline| primitive(geometry, (leaf, Owner::instance(number)), o).0;
            let outlines = geometry.group_outlines(group).into_iter();
            outlines.filter(|(leaf, o)| is_mirror(&surface(*leaf, o))).collect()
        });
        if all.len() - own + mirrors.len() > MOST_LISTED {
            all.truncate(own);
            return (all, false);
        }
        all.extend(mirrors.iter().map(|(leaf, o)| ((*leaf, Owner::instance(number)), o.placed(&place))));
    }
    (all, true)
}

/// Lists the mirrors in instances by group.
fn copied(
    geometry: &Geometry,
    is_mirror: impl Fn(&Surface) -> bool,
    numbers: &mut HashMap<Key, u32>,
) -> Copied {
    let mut groups = vec![vec![]; geometry.copies().1];
    let mut done = vec![false; groups.len()];
    for (number, group, _) in geometry.instances() {
        if std::mem::replace(&mut done[group as usize], true) {
            continue;
        }
        for (leaf, outline) in geometry.group_outlines(group) {
            if is_mirror(&primitive(geometry, (leaf, Owner::instance(number)), &outline).0) {
                numbers.insert((leaf, EVERY), CURVED);
                groups[group as usize].push(outline);
            }
        }
    }
    Copied::new(groups, geometry.instances().map(|(_, group, place)| (group, place)))
}

/// Returns the surface of a primitive at an inner point, and true if the primitive is flat.
fn primitive(geometry: &Geometry, (leaf, owner): Key, outline: &Outline) -> (Surface, bool) {
    let (lo, hi) = ends(outline);
    let ray = Ray { origin: 0.5 * (lo + hi), dir: Vec3A::Z };
    let hit = Hit { t: 0.0, leaf, owner, u: INSIDE, v: INSIDE };
    let surface = geometry.surface(&ray, &hit);
    (surface, geometry.bend(&hit, &surface) == Mat3A::ZERO)
}

#[cfg(test)]
mod tests;
