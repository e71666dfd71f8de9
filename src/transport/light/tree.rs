//! A light tree, which samples one of many lights in proportion to the estimated contribution at a point.
//!
//! The method is that of Conty Estévez & Kulla, "Importance sampling of many lights with adaptive tree
//! splitting" (2018), without the splitting, and of pbrt-v4's `BVHLightSampler`. The choice starts at the
//! root and samples one child of each node. The probability of a child is proportional to an upper estimate
//! of the child's contribution, intensity · cosθ · cosθ' / distance². A node has eight children, and the
//! estimates of the children are computed in eight SIMD lanes.

use super::bounds::Bounds;
use super::receiver::Receiver;
use crate::geometry::eight::Eight;
use arrayvec::ArrayVec;
use glam::Vec3A;
use std::f32::consts::PI;

/// Number of children of a node.
const WIDTH: usize = 8;
/// Flag of a child index that is the index of a light, not of a node.
const LEAF: u32 = 1 << 31;
/// Index that denotes the missing parent of the root.
const NONE: u32 = u32::MAX;
/// Number of bins along each axis. Lights may be divided at the bin boundaries.
const BINS: usize = 12;
/// Largest `f32` below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// One value per child of a node.
type Row = Eight;
const ZERO: Row = Eight::splat(0.0);
const ONE: Row = Eight::splat(1.0);

/// The children of a tree node. Each child is a group of lights and occupies one lane.
#[derive(Clone, Debug)]
struct Node {
    centre: [Row; 3],
    /// Radius of each child's bounding sphere, metres, and 3/radius².
    radius: Row,
    nearest: Row,
    /// Radiant intensity of each child as a fraction of the total over all lights, or 0 for an unused lane.
    intensity: Row,
    /// Index of each child: a node index, or a light index with the flag [`LEAF`].
    child: [u32; WIDTH],
    /// Index of the parent node × [`WIDTH`], plus the position of this node among the parent's children.
    parent: u32,
    /// True if the lights of all children have normals in all directions.
    all_around: bool,
    axis: [Row; 3],
    /// Cosine of the half angle of each child's cone of normals.
    cos_spread: Row,
    sin_spread: Row,
    /// Cosine of [`Bounds::reach`] of each child.
    cos_reach: Row,
    /// 1 for children that emit from both sides, otherwise 0.
    two_sided: Row,
}

#[derive(Clone, Debug)]
pub struct LightTree {
    nodes: Vec<Node>,
    /// Position of each light in the tree, in the format of [`Node::parent`].
    places: Vec<u32>,
}

/// The choice of a light, which is in progress or complete.
#[derive(Clone, Copy, Debug)]
pub struct Choice {
    /// Index of the current node, or index of the chosen light with the flag [`LEAF`].
    number: u32,
    /// Probability of this choice up to the current node, or 0 if no light can reach the point.
    pub chance: f32,
    /// The part of the uniform random number that is still unused, rescaled to [0, 1).
    pub which: f32,
}

impl Choice {
    /// A complete choice of no light.
    pub const NONE: Self = Self { number: LEAF, chance: 0.0, which: 0.0 };

    /// Begins a choice by a uniform random number `which`. `chance` is the probability of using the tree.
    #[inline]
    pub fn open(which: f32, chance: f32) -> Self {
        Self { number: 0, chance, which }
    }

    /// Returns a complete choice of a light that was made without the tree.
    #[inline]
    pub fn made(light: u32, which: f32, chance: f32) -> Self {
        Self { number: light | LEAF, chance, which }
    }

    /// Returns the index of the chosen light, or `None` if no light can reach the point.
    #[inline]
    pub fn light(&self) -> Option<u32> {
        (self.chance > 0.0).then_some(self.number ^ LEAF)
    }

    #[inline(always)]
    fn is_open(&self) -> bool {
        self.number & LEAF == 0
    }
}

/// Returns cos(a - b) for two angles in [0, π], each given by its cosine and sine. If a < b, returns 1
/// instead.
#[inline(always)]
fn cos_less([cos_a, sin_a]: [Eight; 2], [cos_b, sin_b]: [Eight; 2]) -> Eight {
    let cos = cos_a * cos_b + sin_a * sin_b;
    cos_b.lt(cos_a).select(ONE, cos)
}

#[inline(always)]
fn sine(cos: Eight) -> Eight {
    (ONE - cos * cos).max(ZERO).sqrt()
}

impl Node {
    fn empty(parent: u32) -> Self {
        let zero = ZERO;
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
            all_around: true,
        }
    }

    fn set(&mut self, i: usize, bounds: &Bounds, scale: f32) {
        let (centre, axis) = (bounds.centre(), bounds.axis);
        for k in 0..3 {
            self.centre[k].0[i] = centre[k];
            self.axis[k].0[i] = axis[k];
        }
        let radius = bounds.radius();
        self.radius.0[i] = radius;
        self.nearest.0[i] = 3.0 / (radius * radius).max(3e-30);
        // The value -2 is below the cosine of any angle, so rounding cannot exclude a direction.
        let (sin, cos) = if bounds.spread >= PI {
            (0.0, -2.0)
        } else {
            self.all_around = false;
            bounds.spread.sin_cos()
        };
        self.sin_spread.0[i] = sin;
        self.cos_spread.0[i] = cos;
        self.cos_reach.0[i] = bounds.reach.cos();
        self.two_sided.0[i] = f32::from(u8::from(bounds.two_sided));
        self.intensity.0[i] = bounds.intensity * scale;
    }

    /// Returns an estimate of the contribution of each child, up to a factor common to all children.
    #[inline(always)]
    fn importances(&self, at: &Receiver) -> [f32; WIDTH] {
        if self.all_around { self.importances_of::<true>(at) } else { self.importances_of::<false>(at) }
    }

    #[inline(always)]
    fn importances_of<const AROUND: bool>(&self, at: &Receiver) -> [f32; WIDTH] {
        let splat = |v: Vec3A| v.to_array().map(Eight::splat);
        let (p, n) = (splat(at.p), splat(at.normal));
        let half = Eight::splat(0.5);
        let d = [0, 1, 2].map(|x| self.centre[x] - p[x]);
        let d2 = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).max(Eight::splat(1e-30));
        let over = d2.sqrt().recip();
        // Sine of the half angle of the lights' bounding sphere, as seen from the point.
        let sin_ball = self.radius * over;
        let inside = ONE.le(sin_ball);
        let emits = if AROUND {
            ONE
        } else {
            // Minimum angle between a light's normal and the direction to the point.
            let axis = &self.axis;
            let along = (axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2]) * over.neg();
            let along = ZERO.lt(self.two_sided).select(along.max(along.neg()), along);
            let middle = cos_less([along, sine(along)], [self.cos_spread, self.sin_spread]);
            // Upper bound of the cosine over the bounding sphere: cos(a - b) ≤ cos a + sin b.
            let most = inside.select(ONE, (middle + sin_ball).min(ONE));
            // Average the bound and the value at the centre, because the lights fill the bounding sphere.
            let emits = half * (most + middle.max(ZERO));
            self.cos_reach.lt(most).select(emits, ZERO)
        };
        // Apply the same computation to the angle between the receiver's normal and the direction to the
        // lights.
        let receives = if at.normal == Vec3A::ZERO {
            ONE
        } else {
            let up = (n[0] * d[0] + n[1] * d[1] + n[2] * d[2]) * over;
            let most = inside.select(ONE, (up + sin_ball).min(ONE)).max(ZERO);
            half * (most + up.max(ZERO))
        };
        // For a point inside the group, limit 1/distance² to its mean over a ball, 3/radius².
        let near = (over * over).min(self.nearest);
        (self.intensity * emits * receives * near).0
    }

    #[inline(always)]
    fn descend(&self, at: &Receiver, choice: &mut Choice) {
        let weights = self.importances(at);
        // Start of each child's interval of cumulative weights, and end of the last interval.
        let mut begins = [0.0; WIDTH + 1];
        for i in 0..WIDTH {
            begins[i + 1] = begins[i] + weights[i];
        }
        let all = begins[WIDTH];
        // The sum is infinite or NaN if estimates overflow.
        if !(all > 0.0 && all < f32::INFINITY) {
            *choice = Choice::NONE;
            return;
        }
        let target = choice.which * all;
        // A child with weight 0 has an empty interval and cannot be chosen.
        let mut i: usize = begins[1..WIDTH].iter().map(|end| usize::from(target >= *end)).sum();
        while weights[i] == 0.0 {
            i -= 1;
        }
        choice.chance *= weights[i] / all;
        choice.which = ((target - begins[i]) / weights[i]).clamp(0.0, BELOW_ONE);
        choice.number = self.child[i];
    }
}

impl LightTree {
    /// Builds a tree over lights. The lights keep their indices. Returns `None` if there are fewer than two
    /// lights, or if no light emits.
    pub fn new(lights: &[Bounds]) -> Option<Self> {
        let most = lights.iter().map(|b| b.intensity).fold(0.0, f32::max);
        if lights.len() < 2 || !(most > 0.0 && most.is_finite()) {
            return None;
        }
        let mut items: Vec<(u32, Bounds)> = (0..).zip(lights.iter().copied()).collect();
        let mut tree = Self { nodes: vec![], places: vec![NONE; lights.len()] };
        tree.add(&mut items, NONE, 1.0 / most);
        Some(tree)
    }

    /// Adds a node with all its descendants, and returns the index of the node.
    fn add(&mut self, items: &mut [(u32, Bounds)], parent: u32, scale: f32) -> u32 {
        let number = self.nodes.len() as u32;
        self.nodes.push(Node::empty(parent));
        // Divide the group with the highest cost until there are enough groups.
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

    /// Completes the choices of lights for several points. The choices descend the tree in lockstep, so that
    /// the arithmetic of one choice hides the latency of the others.
    #[inline(always)]
    pub fn choose<const N: usize>(&self, at: &[Receiver; N], choices: &mut [Choice; N]) {
        let mut open: ArrayVec<u8, N> = (0..N as u8).filter(|i| choices[*i as usize].is_open()).collect();
        while !open.is_empty() {
            let mut kept = 0;
            for n in 0..open.len() {
                let i = open[n] as usize;
                let choice = &mut choices[i];
                self.nodes[choice.number as usize].descend(&at[i], choice);
                open[kept] = i as u8;
                kept += usize::from(choice.is_open());
            }
            open.truncate(kept);
        }
    }

    /// Returns the probability with which [`Self::choose`] chooses light `light` for a point.
    #[inline]
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

fn bounds_of(items: &[(u32, Bounds)]) -> Bounds {
    let [(_, first), rest @ ..] = items else {
        unreachable!("internal error: an empty group of lights");
    };
    rest.iter().fold(*first, |all, (_, b)| all.union(b))
}

/// Divides lights into two groups at minimum total cost. Returns the index of the first light of the second
/// group.
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
    // The lowest cost among the tested divisions, with the axis and the first bin of the second group.
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
        // Increase the cost of thin groups.
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
        // All lights are at the same position.
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
