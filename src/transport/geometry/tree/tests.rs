//! Tests of both kinds of trees: contents, ray queries, and equal results for any number of threads.

use super::super::binned::LEAF_SIZE;
use super::super::tests::inward;
use super::*;
use glam::Vec3A;
use optics::sampling::stream::Stream;
use optics::sampling::warp;

/// Visitor that records the visited leaves, and stops at the first leaf if `stop` is set.
struct Seen {
    met: Vec<bool>,
    stop: bool,
}

impl Visit for Seen {
    fn leaf(&mut self, leaf: u32, end: f32) -> f32 {
        self.met[leaf as usize] = true;
        if self.stop { 0.0 } else { end }
    }

    fn expect(&self, _: u32) {}
}

fn boxes(n: usize, seed: u64) -> Vec<Aabb> {
    let mut stream = Stream::new(seed, 0, 0);
    (0..n)
        .map(|_| {
            let c = warp::sphere(stream.uniform2()) * 3.0;
            let half = Vec3A::splat(0.2 * stream.uniform());
            Aabb::new(c - half, c + half)
        })
        .collect()
}

/// Returns true if the primitives may share a leaf.
fn fits(run: &[u32]) -> bool {
    run.iter().all(|i| i % 5 != 0)
}

/// Returns both kinds of trees over `bounds`, and the primitives of their leaves.
fn both(bounds: &[Aabb]) -> [(Tree, Vec<Vec<u32>>); 2] {
    let at = |i: usize| bounds[i];
    let clustered = Binary::clustered(bounds.len(), &at);
    let split = Binary::split(bounds.len(), &at, &fits);
    [clustered, split].map(|binary| {
        let mut leaves: Vec<Vec<u32>> = vec![];
        let tree = Tree::of(binary, at, fits, |run| {
            leaves.push(run.to_vec());
            leaves.len() as u32 - 1
        });
        (tree, leaves)
    })
}

fn union(boxes: impl Iterator<Item = Aabb>) -> Aabb {
    boxes.fold(Aabb::empty(), |all, b| all.union(&b))
}

/// Verifies the structure and the traversal of a tree:
/// - each primitive is in one leaf,
/// - leaves are valid,
/// - boxes are tight,
/// - a ray visits all leaves whose boxes are hit.
fn check(bounds: &[Aabb]) {
    for (tree, leaves) in both(bounds) {
        check_one(bounds, &tree, &leaves);
    }
}

fn check_one(bounds: &[Aabb], tree: &Tree, leaves: &[Vec<u32>]) {
    assert!(7 * tree.depth() + 8 <= STACK);
    assert_eq!(tree.extent(), union(bounds.iter().copied()));
    // The list includes the leaves of rejected trees.
    let mut used = vec![false; leaves.len()];
    let mut seen = vec![0; bounds.len()];
    for (aabb, child) in (0..tree.nodes.len()).flat_map(|n| tree.children(n as u32)) {
        match child {
            Child::Branch(node) => assert_eq!(aabb, union(tree.children(node).map(|c| c.0))),
            Child::Leaf(leaf) => {
                used[leaf as usize] = true;
                let run = &leaves[leaf as usize];
                assert!(run.len() == 1 || (run.len() <= LEAF_SIZE && fits(run)));
                assert_eq!(aabb, union(run.iter().map(|i| bounds[*i as usize])));
                run.iter().for_each(|i| seen[*i as usize] += 1);
            }
        }
    }
    assert!(seen.iter().all(|n| *n == 1));
    let mut stream = Stream::new(1, 1, 1);
    for _ in 0..200 {
        let ray = inward(&mut stream, 5.0, 2.0);
        let Ray { origin, dir } = ray;
        let mut seen = Seen { met: vec![false; leaves.len()], stop: false };
        tree.traverse::<true>(&ray, 100.0, &mut seen);
        let met = seen.met;
        for (leaf, run) in leaves.iter().enumerate().filter(|(l, _)| used[*l]) {
            for i in run {
                let b = &bounds[*i as usize];
                let (t0, t1) = ((b.min - origin) / dir, (b.max - origin) / dir);
                let (enter, leave) = (t0.min(t1).max_element(), t0.max(t1).min_element());
                if enter < leave.min(100.0) && leave > 0.0 {
                    assert!(met[leaf], "box {i}");
                }
            }
        }
    }
}

#[test]
fn trees_cover_everything() {
    for n in [1, 2, 3, 4, 5, 8, 9, 17, 1000, 20_000] {
        check(&boxes(n, n as u64));
    }
}

#[test]
fn equal_boxes_do_not_give_a_deep_tree() {
    // For equal boxes, clustering takes quadratic time, and the tree becomes too deep for the stack.
    let equal = vec![Aabb::new(Vec3A::ZERO, Vec3A::ONE); 1000];
    let clustered = Binary::clustered(equal.len(), &|i| equal[i]);
    let tree = Tree::collapsed(&clustered, &fits, &mut |_| 0).expect("the tree is not empty");
    assert!(7 * tree.depth() + 8 > STACK);
    check(&equal);
    let row = |f: &dyn Fn(f32) -> [Vec3A; 2]| -> Vec<Aabb> {
        let ends = (0..1000).map(|i| f(i as f32));
        ends.map(|[a, b]| Aabb::new(a, b)).collect()
    };
    // Test sets of boxes with a common corner, with a common centre, without height, and of zero size. Then
    // test long thin boxes that cross each other, and increasingly distant boxes.
    check(&row(&|i| [Vec3A::ZERO, Vec3A::splat(1.0 + i)]));
    check(&row(&|i| [Vec3A::splat(-1.0 - i), Vec3A::splat(1.0 + i)]));
    check(&row(&|i| [Vec3A::new(i, -i, 0.0), Vec3A::new(i + 2.0, 1.0 - i, 0.0)]));
    check(&row(&|i| [Vec3A::new(0.01 * i, 0.0, 1.0); 2]));
    check(&row(&|i| {
        let along = Vec3A::AXES[i as usize % 3];
        let at = Vec3A::splat(0.001 * i);
        [at - along * 1e4, at + along * 1e4]
    }));
    check(&row(&|i| {
        let at = Vec3A::new((0.01 * i).exp2(), 0.0, 0.0);
        [at, at * 1.001]
    }));
}

/// Visitor that finds the nearest hit among triangles.
struct Nearest<'a> {
    triangles: &'a [[Vec3A; 3]],
    leaves: &'a [Vec<u32>],
    ray: &'a Ray,
    t: f32,
}

impl Visit for Nearest<'_> {
    fn leaf(&mut self, leaf: u32, end: f32) -> f32 {
        let hits = self.leaves[leaf as usize].iter().map(|i| {
            let [a, b, c] = self.triangles[*i as usize];
            let (e1, e2, s) = (b - a, c - a, self.ray.origin - a);
            let (p, q) = (self.ray.dir.cross(e2), s.cross(e1));
            let scale = 1.0 / e1.dot(p);
            let (t, u, v) = (e2.dot(q) * scale, s.dot(p) * scale, self.ray.dir.dot(q) * scale);
            let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0;
            if inside { t } else { f32::INFINITY }
        });
        self.t = hits.fold(end, f32::min);
        self.t
    }

    fn expect(&self, _: u32) {}
}

#[test]
fn both_trees_give_the_same_hits() {
    let mut stream = Stream::new(5, 0, 0);
    let triangles: Vec<[Vec3A; 3]> = (0..30_000)
        .map(|_| {
            let at = warp::sphere(stream.uniform2()) * (1.0 + stream.uniform());
            [0, 1, 2].map(|_| at + warp::sphere(stream.uniform2()) * 0.03)
        })
        .collect();
    let bounds: Vec<Aabb> = triangles.iter().map(|t| Aabb::from_points(t)).collect();
    let trees = both(&bounds);
    let mut hits = 0;
    for _ in 0..5000 {
        let ray = inward(&mut stream, 4.0, 1.0);
        let [clustered, split] = trees.each_ref().map(|(tree, leaves)| {
            let mut nearest = Nearest { triangles: &triangles, leaves, ray: &ray, t: f32::INFINITY };
            tree.traverse::<true>(&ray, f32::INFINITY, &mut nearest);
            nearest.t
        });
        assert_eq!(clustered.to_bits(), split.to_bits());
        hits += u32::from(clustered < f32::INFINITY);
    }
    assert!(hits > 2500, "{hits}");
}

#[test]
fn split_trees_are_the_same_on_any_number_of_threads() {
    let boxes = boxes(40_000, 7);
    let built = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let [_, (tree, leaves)] = pool.expect("cannot create threads").install(|| both(&boxes));
        let nodes: Vec<_> = tree.nodes.iter().map(|n| (n.bounds.map(|b| b.0), n.child)).collect();
        (nodes, leaves)
    };
    let one = built(1);
    assert!(one == built(2) && one == built(5));
}

#[test]
fn traversal_stops_at_an_end_of_zero() {
    let boxes = boxes(100, 3);
    let tree = Tree::build(100, |i| boxes[i], |_| false, |run| run[0]);
    let (origin, dir) = (Vec3A::splat(-5.0), Vec3A::splat(1.0).normalize());
    let mut seen = Seen { met: vec![false; 100], stop: true };
    tree.traverse::<false>(&Ray { origin, dir }, 100.0, &mut seen);
    assert!(seen.met.iter().filter(|m| **m).count() <= 1);
    assert!(Tree::build(0, |_| Aabb::empty(), |_| true, |_| 0).nodes.is_empty());
}
