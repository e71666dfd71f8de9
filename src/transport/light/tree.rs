//! A tree over many lights that chooses one by what it can contribute at a point.
//!
//! Conty Estévez & Kulla, "Importance sampling of many lights with adaptive tree splitting" (2018), without the splitting, and
//! pbrt-v4's `BVHLightSampler`: going down from the root, a child is chosen with a probability proportional to an upper estimate
//! of its contribution, intensity · cosθ · cosθ' / distance². A node has eight children, whose estimates are
//! vector arithmetic.

use super::bounds::Bounds;
use super::receiver::Receiver;
use glam::Vec3A;
use std::f32::consts::PI;
use wide::f32x4;

/// Children of a node.
const WIDTH: usize = 8;
/// Vectors of four that hold one number of each child.
const ROWS: usize = WIDTH / 4;
/// Set in a child's number if it is a light.
const LEAF: u32 = 1 << 31;
/// Parent of the root.
const NONE: u32 = u32::MAX;
/// Intervals along each axis at whose ends lights may be divided.
const BINS: usize = 12;
/// Largest `f32` below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// One number of each child.
type Row = [f32x4; ROWS];

/// Groups of lights, as rows of numbers.
#[derive(Clone, Debug)]
struct Node {
    centre: [Row; 3],
    /// Radius of the sphere about each, and 3/radius².
    radius: Row,
    nearest: Row,
    axis: [Row; 3],
    /// Of the angle of the cone of normals.
    cos_spread: Row,
    sin_spread: Row,
    /// Of [`Bounds::reach`].
    cos_reach: Row,
    /// 1 if both sides emit, 0 otherwise.
    two_sided: Row,
    /// Over the largest of all lights; 0 where there is no child.
    intensity: Row,
    /// Number of a node, or of a light with [`LEAF`].
    child: [u32; WIDTH],
    /// Number of the parent node times [`WIDTH`] plus the place among its children.
    parent: u32,
}

/// The tree.
#[derive(Clone, Debug)]
pub struct LightTree {
    nodes: Vec<Node>,
    /// The place of each light, as [`Node::parent`].
    places: Vec<u32>,
}

fn put(row: &mut Row, i: usize, value: f32) {
    let mut numbers = row[i / 4].to_array();
    numbers[i % 4] = value;
    row[i / 4] = f32x4::new(numbers);
}

/// cos(a - b) of two angles in [0, π], given by cosine and sine; 1 where a < b.
#[inline(always)]
fn cos_less([cos_a, sin_a]: [f32x4; 2], [cos_b, sin_b]: [f32x4; 2]) -> f32x4 {
    let cos = cos_a * cos_b + sin_a * sin_b;
    cos_a.simd_gt(cos_b).select(f32x4::ONE, cos)
}

#[inline(always)]
fn sine(cos: f32x4) -> f32x4 {
    (f32x4::ONE - cos * cos).fast_max(f32x4::ZERO).sqrt()
}

impl Node {
    fn empty(parent: u32) -> Self {
        let zero = [f32x4::ZERO; ROWS];
        Self {
            centre: [zero; 3],
            radius: zero,
            nearest: zero,
            axis: [zero; 3],
            cos_spread: zero,
            sin_spread: zero,
            cos_reach: zero,
            two_sided: zero,
            intensity: zero,
            child: [NONE; WIDTH],
            parent,
        }
    }

    fn set(&mut self, i: usize, bounds: &Bounds, scale: f32) {
        let (centre, axis) = (bounds.centre(), bounds.axis);
        for k in 0..3 {
            put(&mut self.centre[k], i, centre[k]);
            put(&mut self.axis[k], i, axis[k]);
        }
        let radius = bounds.radius();
        put(&mut self.radius, i, radius);
        put(&mut self.nearest, i, 3.0 / (radius * radius).max(3e-30));
        // A cosine of -2 is less than that of any angle: rounding leaves no direction out.
        let (sin, cos) = if bounds.spread >= PI {
            (0.0, -2.0)
        } else {
            bounds.spread.sin_cos()
        };
        put(&mut self.sin_spread, i, sin);
        put(&mut self.cos_spread, i, cos);
        put(&mut self.cos_reach, i, bounds.reach.cos());
        put(&mut self.two_sided, i, f32::from(u8::from(bounds.two_sided)));
        put(&mut self.intensity, i, bounds.intensity * scale);
    }

    /// Estimates of what each child contributes, up to a factor that they share.
    #[inline(always)]
    fn importances(&self, at: &Receiver) -> [f32; WIDTH] {
        let splat = |v: Vec3A| v.to_array().map(f32x4::splat);
        let (p, n) = (splat(at.p), splat(at.normal));
        let (zero, one, half) = (f32x4::ZERO, f32x4::ONE, f32x4::splat(0.5));
        let free = f32x4::splat(if at.normal == Vec3A::ZERO { 1.0 } else { 0.0 });
        let mut out = [0.0; WIDTH];
        for k in 0..ROWS {
            let d = [0, 1, 2].map(|x| self.centre[x][k] - p[x]);
            let d2 = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).fast_max(f32x4::splat(1e-30));
            let over = one / d2.sqrt();
            // Half angle of the sphere about the lights, as seen from the point.
            let sin_ball = self.radius[k] * over;
            let inside = sin_ball.simd_ge(one);
            // Least angle between a normal and a direction to the point.
            let axis = &self.axis;
            let along = (axis[0][k] * d[0] + axis[1][k] * d[1] + axis[2][k] * d[2]) * -over;
            let along = self.two_sided[k].simd_gt(zero).select(along.abs(), along);
            let off = [along, sine(along)];
            let cone = [self.cos_spread[k], self.sin_spread[k]];
            let middle = cos_less(off, cone);
            // Over the sphere a cosine is at most so much larger: cos(a - b) ≤ cos a + sin b.
            let most = inside.select(one, (middle + sin_ball).fast_min(one));
            // A group counts by the mean of the bound and its middle, since not all of it is where it is best.
            let emits = half * (most + middle.fast_max(zero));
            let emits = most.simd_gt(self.cos_reach[k]).select(emits, zero);
            // The same between the receiver's normal and the direction to the lights.
            let up = (n[0] * d[0] + n[1] * d[1] + n[2] * d[2]) * over;
            let most = inside.select(one, (up + sin_ball).fast_min(one)).fast_max(zero);
            let receives = half * (most + up.fast_max(zero));
            let receives = free.simd_gt(zero).select(one, receives);
            // Of a group about the point the mean of 1/distance² is that of a ball, 3/radius².
            let near = (over * over).fast_min(self.nearest[k]);
            let all = self.intensity[k] * emits * receives * near;
            out[4 * k..4 * k + 4].copy_from_slice(&all.to_array());
        }
        out
    }
}

impl LightTree {
    /// A tree over lights, which keep their numbers. `None` of fewer than two, and where no light shines.
    #[must_use]
    pub fn new(lights: &[Bounds]) -> Option<Self> {
        let most = lights.iter().map(|b| b.intensity).fold(0.0, f32::max);
        if lights.len() < 2 || !(most > 0.0 && most.is_finite()) {
            return None;
        }
        let mut items: Vec<(u32, Bounds)> = (0..).zip(lights.iter().copied()).collect();
        let mut tree = Self {
            nodes: vec![],
            places: vec![NONE; lights.len()],
        };
        tree.add(&mut items, NONE, 1.0 / most);
        Some(tree)
    }

    /// Adds a node with all it holds; returns its number.
    fn add(&mut self, items: &mut [(u32, Bounds)], parent: u32, scale: f32) -> u32 {
        let number = self.nodes.len() as u32;
        self.nodes.push(Node::empty(parent));
        // The costliest group is divided until there are enough.
        let mut groups = vec![items];
        while groups.len() < WIDTH {
            let costs = groups.iter().map(|g| (g.len() > 1).then(|| bounds_of(g).cost()));
            let costliest = costs.enumerate().filter_map(|(i, c)| Some((i, c?)));
            let Some((i, _)) = costliest.max_by(|a, b| a.1.total_cmp(&b.1)) else {
                break;
            };
            let group = groups.swap_remove(i);
            let middle = divide(group);
            let (left, right) = group.split_at_mut(middle);
            groups.extend([left, right]);
        }
        for (i, group) in groups.into_iter().enumerate() {
            let place = number * WIDTH as u32 + i as u32;
            self.nodes[number as usize].set(i, &bounds_of(group), scale);
            let child = if let [(light, _)] = group {
                self.places[*light as usize] = place;
                *light | LEAF
            } else {
                self.add(group, place, scale)
            };
            self.nodes[number as usize].child[i] = child;
        }
        number
    }

    /// Chooses a light for a point by the uniform number `which`; returns its number, the probability of that, and a uniform
    /// number that is left. `None` if it comes to a group of which no light can reach the point.
    #[inline]
    #[must_use]
    pub fn choose(&self, at: &Receiver, mut which: f32) -> Option<(usize, f32, f32)> {
        let (mut number, mut chance) = (0, 1.0);
        loop {
            let node = &self.nodes[number];
            let weights = node.importances(at);
            let mut ends = weights;
            for i in 1..WIDTH {
                ends[i] += ends[i - 1];
            }
            let all = ends[WIDTH - 1];
            // Not a number where estimates overflow.
            if !(all > 0.0 && all.is_finite()) {
                return None;
            }
            let target = which * all;
            // One of weight 0 ends where it begins, and is passed over.
            let mut i: usize = ends[..WIDTH - 1]
                .iter()
                .map(|end| usize::from(target >= *end))
                .sum();
            while weights[i] == 0.0 {
                i -= 1;
            }
            let begin = if i > 0 { ends[i - 1] } else { 0.0 };
            chance *= weights[i] / all;
            which = ((target - begin) / weights[i]).clamp(0.0, BELOW_ONE);
            let child = node.child[i];
            if child & LEAF != 0 {
                return Some(((child ^ LEAF) as usize, chance, which));
            }
            number = child as usize;
        }
    }

    /// Probability with which [`Self::choose`] returns a light for a point.
    #[inline]
    #[must_use]
    pub fn chance(&self, at: &Receiver, light: usize) -> f32 {
        let (mut place, mut chance) = (self.places[light], 1.0);
        while place != NONE {
            let (node, i) = (&self.nodes[place as usize / WIDTH], place as usize % WIDTH);
            let weights = node.importances(at);
            let all: f32 = weights.iter().sum();
            if !(weights[i] > 0.0 && all.is_finite()) {
                return 0.0;
            }
            chance *= weights[i] / all;
            place = node.parent;
        }
        chance
    }
}

/// Bounds of several lights.
fn bounds_of(items: &[(u32, Bounds)]) -> Bounds {
    let [(_, first), rest @ ..] = items else {
        unreachable!("groups are divided into two that are not empty");
    };
    rest.iter().fold(*first, |all, (_, b)| all.union(b))
}

/// Orders lights so that those before the returned number and those from there on are cheap together.
fn divide(items: &mut [(u32, Bounds)]) -> usize {
    let mut low = items[0].1.centre();
    let mut high = low;
    for (_, b) in items.iter() {
        (low, high) = (low.min(b.centre()), high.max(b.centre()));
    }
    let extent = high - low;
    let bin = |b: &Bounds, axis: usize| {
        let x = (b.centre()[axis] - low[axis]) / extent[axis];
        ((x * BINS as f32) as usize).min(BINS - 1)
    };
    // Cost, axis and first bin of the second part.
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|axis| extent[*axis] > 0.0) {
        let mut bins = [None::<Bounds>; BINS];
        for (_, b) in items.iter() {
            let all = &mut bins[bin(b, axis)];
            *all = Some(all.map_or(*b, |all| all.union(b)));
        }
        let join = |all: &mut Option<Bounds>, bin: &Option<Bounds>| {
            *all = match (*all, bin) {
                (Some(a), Some(b)) => Some(a.union(b)),
                (a, b) => a.or(*b),
            };
            *all
        };
        let before: Vec<_> = bins.iter().scan(None, |all, bin| Some(join(all, bin))).collect();
        let mut after = None;
        // Thin groups are no good whatever they cost.
        let thin = extent.max_element() / extent[axis];
        for at in (1..BINS).rev() {
            let (Some(left), Some(right)) = (before[at - 1], join(&mut after, &bins[at])) else {
                continue;
            };
            let cost = thin * (left.cost() + right.cost());
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, at));
            }
        }
    }
    let Some((_, axis, at)) = best else {
        // All in one place.
        return items.len() / 2;
    };
    let mut middle = 0;
    for i in 0..items.len() {
        if bin(&items[i].1, axis) < at {
            items.swap(i, middle);
            middle += 1;
        }
    }
    middle
}
