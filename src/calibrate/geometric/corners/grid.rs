//! Joins neighbouring corners of a board into a grid.

use super::saddle::Saddle;
use crate::geometric::image::Image;
use nalgebra::Vector2;
use std::collections::{BTreeMap, VecDeque};

/// A position on the grid as (column, row). Seen from the front of the board, columns count to the right
/// and rows downward.
pub type Place = (i32, i32);

/// Maximum angle between the direction to a neighbour and the direction of an edge, given as sine or tangent.
const ASIDE: f64 = 0.3;

/// Returns the nearest corner in direction `way` that is connected to corner `from` by a black-white edge.
fn neighbour(image: &Image, all: &[Saddle], from: usize, way: Vector2<f64>) -> Option<usize> {
    let here = &all[from];
    let mut near: Vec<(f64, usize)> = all
        .iter()
        .enumerate()
        .filter_map(|(i, other)| {
            let d = other.at - here.at;
            let along = d.dot(&way);
            let ahead = along > 4.0 && d.perp(&way).abs() < ASIDE * along;
            ahead.then_some((along, i))
        })
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    near.into_iter().take(3).map(|(_, i)| i).find(|i| joined(image, here, &all[*i]))
}

/// Returns whether the side of a square connects two corners. Along the whole line between the corners, the
/// image must be black on one side and white on the opposite side.
fn joined(image: &Image, a: &Saddle, b: &Saddle) -> bool {
    let d = b.at - a.at;
    let length = d.norm();
    let way = d / length;
    let across = Vector2::new(-way.y, way.x);
    let aligned = b.edges.iter().any(|e| e.perp(&way).abs() < ASIDE);
    let off = (0.2 * length).clamp(1.5, 12.0);
    let least = 0.4 * a.contrast.abs().min(b.contrast.abs());
    let mut signs = [0.25, 0.4, 0.5, 0.6, 0.75].iter().map(|t| {
        let p = a.at + d * *t;
        let (l, r) = (p + across * off, p - across * off);
        let step = f64::from(image.between(l.x, l.y) - image.between(r.x, r.y));
        if step.abs() < least { 0.0 } else { step.signum() }
    });
    let first = signs.next().unwrap_or(0.0);
    let equal = a.contrast.abs() < 4.0 * b.contrast.abs() && b.contrast.abs() < 4.0 * a.contrast.abs();
    aligned && equal && first != 0.0 && signs.all(|s| s == first)
}

/// Returns all grids of neighbouring corners, the largest first. Columns increase with the image's x, and
/// rows with the image's y.
pub fn grids(image: &Image, all: &[Saddle]) -> Vec<BTreeMap<Place, usize>> {
    // Returns the four directions of a corner, which are along e1 and e2, and opposite to e1 and e2.
    let ways = |s: &Saddle| {
        let [mut x, mut y] = s.edges;
        // Make x the edge that is closer to the image's x axis. y has the orientation of the image's y axis.
        if x.x.abs() < y.x.abs() {
            (x, y) = (y, x);
        }
        if x.perp(&y) < 0.0 {
            y = -y;
        }
        [x, y, -x, -y]
    };
    let links: Vec<[Option<usize>; 4]> =
        (0..all.len()).map(|i| ways(&all[i]).map(|way| neighbour(image, all, i, way))).collect();
    // Returns the direction of `to` that is closest to `way`.
    let same = |to: usize, way: Vector2<f64>| {
        let w = ways(&all[to]);
        (0..4).max_by(|a, b| w[*a].dot(&way).total_cmp(&w[*b].dot(&way))).unwrap_or(0)
    };
    let mut taken = vec![false; all.len()];
    let mut grids = vec![];
    for seed in 0..all.len() {
        if taken[seed] {
            continue;
        }
        let mut grid = BTreeMap::from([((0, 0), seed)]);
        // For each corner, the index of the direction along the grid's rows.
        let mut turns = BTreeMap::from([(seed, 0)]);
        let mut places = BTreeMap::from([(seed, (0, 0))]);
        let mut queue = VecDeque::from([seed]);
        let mut whole = true;
        while let Some(i) = queue.pop_front() {
            let (place, turn) = (places[&i], turns[&i]);
            for step in 0..4 {
                let way = ways(&all[i])[(turn + step) % 4];
                let Some(next) = links[i][(turn + step) % 4] else {
                    continue;
                };
                let back = same(next, -way);
                if links[next][back] != Some(i) {
                    continue;
                }
                let to = match step {
                    0 => (place.0 + 1, place.1),
                    1 => (place.0, place.1 + 1),
                    2 => (place.0 - 1, place.1),
                    _ => (place.0, place.1 - 1),
                };
                match (grid.get(&to), places.get(&next)) {
                    (None, None) => {
                        grid.insert(to, next);
                        places.insert(next, to);
                        // `back` is the direction opposite to the step.
                        turns.insert(next, (back + 2 + 4 - step) % 4);
                        queue.push_back(next);
                    }
                    (Some(there), Some(at)) if *there == next && *at == to => {}
                    _ => whole = false,
                }
            }
        }
        for i in places.keys() {
            taken[*i] = true;
        }
        if whole && grid.len() >= 4 {
            grids.push(grid);
        }
    }
    grids.sort_by_key(|g| std::cmp::Reverse(g.len()));
    grids
}

/// Returns the first position and the size of the bounding rectangle of a grid.
pub fn extent(grid: &BTreeMap<Place, usize>) -> (Place, [usize; 2]) {
    let range = |of: fn(&Place) -> i32| {
        let least = grid.keys().map(of).min().unwrap_or(0);
        let most = grid.keys().map(of).max().unwrap_or(-1);
        (least, (most - least + 1) as usize)
    };
    let ((x, w), (y, h)) = (range(|p| p.0), range(|p| p.1));
    ((x, y), [w, h])
}
