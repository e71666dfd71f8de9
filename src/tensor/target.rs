//! Implements adaptive sampling, which chooses the number of samples per tile so that a slice reaches a
//! requested error.
//!
//! Samples are added in rounds. A lit pixel that has the relative error e after n samples needs n (e / goal)²
//! samples in total. The slice reaches the goal when a given share of its lit pixels has reached the goal. A
//! share of 0.5 corresponds to the median error. Samples are therefore assigned first to the tiles in which
//! they make the most pixels reach the goal. Tiles whose pixels have reached the goal, or would need many
//! samples to reach it, receive fewer samples. Each tile receives at least half of the number of samples with
//! which uniform sampling would reach the goal. Therefore, no error exceeds √2 times the error of uniform
//! sampling.
//!
//! If the noise of a single pixel determined the pixel's sample count, the mean would be biased, because
//! sampling would stop at pixels whose first samples are dim. Therefore, at least [`LEAST_LIT`] pixels
//! determine the samples of a tile, so that a single pixel barely affects the sample count.

use serde_json::{Value, json};

/// Name of the root attribute of a store that was rendered to a target error.
pub const ATTRIBUTE: &str = "target";

/// Name of the root attribute of a round's store that identifies the round and the render.
pub const ROUND: &str = "round";

/// Name of the root attribute of a store whose tiles have different numbers of samples.
pub const TILE_SAMPLES: &str = "tile_samples";

/// Minimum number of lit pixels that determine the samples of a tile. If a tile has fewer lit pixels, the lit
/// pixels of neighbouring tiles or of all tiles are included.
pub const LEAST_LIT: usize = 64;

/// Number of candidate sample counts per factor of 2. Candidates are 2^(i/`STEPS`) times the sample count of
/// uniform sampling, where the factor is between 1/2 and 8.
const STEPS: i32 = 16;
const COUNTS: std::ops::RangeInclusive<i32> = -STEPS..=3 * STEPS;

/// Maximum ratio of a round's samples to the samples of all earlier rounds. The ratio is limited because
/// error estimates from few samples are less reliable.
const GROWTH: f64 = 4.0;

/// Ratio of a round's target error to the goal, so that the last round does not narrowly miss the goal.
const MARGIN: f64 = 0.99;

/// Minimum number of samples per pixel of a tile in a round. Tiles that need at most half of this minimum are
/// skipped.
const LEAST_ROUND: u32 = 16;

/// Minimum number of sample groups from which a round's errors are estimated, unless the round has fewer
/// samples.
const GROUPS: u32 = 32;

/// Goal of adaptive sampling.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal {
    /// Name of the slice whose error is measured.
    pub slice: String,
    /// Target error: the relative standard error of a pixel, such as 0.02.
    pub error: f64,
    /// Fraction of the lit pixels that must reach the target error, 0 to 1. With 0.5, the median error must
    /// reach the target error.
    pub share: f64,
    /// Samples per pixel in the first round.
    pub first: u32,
    /// Maximum number of samples per pixel, summed over all rounds.
    pub most: u32,
}

impl Goal {
    /// Returns an error message if the goal is invalid. `dashes` is the prefix of option names (`--`).
    pub fn fault(&self, dashes: &str) -> Option<String> {
        if !(self.error > 0.0 && self.error < 1.0) {
            return Some(format!(
                "{dashes}target-error: expected a relative error between 0 and 1, such as 0.02, got {}",
                self.error
            ));
        }
        if !(self.share > 0.0 && self.share < 1.0) {
            return Some(format!(
                "{dashes}target-share: expected a share between 0 and 1, such as 0.5, got {}",
                self.share
            ));
        }
        if !(GROUPS..=1 << 20).contains(&self.first) {
            return Some(format!(
                "{dashes}spp is {}; give a number of samples per pixel from {GROUPS} to {} for the first round",
                self.first,
                1 << 20
            ));
        }
        if !(self.first..=1 << 30).contains(&self.most) {
            return Some(format!(
                "{dashes}most-spp is {}; give a number of samples per pixel from {} to {} (at least the number of the first round)",
                self.most,
                self.first,
                1 << 30
            ));
        }
        None
    }

    /// Converts the goal to a store attribute.
    pub fn to_json(&self) -> Value {
        json!({
            "slice": self.slice,
            "error": self.error,
            "share": self.share,
            "first_samples_per_pixel": self.first,
            "most_samples_per_pixel": self.most,
        })
    }
}

/// Statistics of a lit pixel, or of an element of several pixels, after the completed rounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lit {
    /// Number of the tile that contains the pixel.
    pub tile: u32,
    /// Number of samples per pixel in the completed rounds.
    pub samples: f64,
    /// Relative standard error, or infinity if the error is unknown.
    pub error: f64,
}

/// Statistics of a tile after the completed rounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tile {
    /// Number of camera pixels.
    pub pixels: u32,
    /// Number of samples per pixel in the completed rounds.
    pub samples: u32,
    /// True if the slice keeps at least one pixel of the tile.
    pub kept: bool,
}

/// Results of the completed rounds for a slice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Survey {
    pub lit: Vec<Lit>,
    /// All tiles, row-major.
    pub tiles: Vec<Tile>,
    /// Number of tiles per row.
    pub across: u32,
}

/// Next step of adaptive sampling.
#[derive(Clone, Debug, PartialEq)]
pub enum Next {
    /// Stop, because the slice has reached the goal.
    Reached,
    /// Stop, because all pixels that need more samples have the maximum number of samples.
    Exhausted,
    /// Render a round with the given number of samples per pixel for each tile.
    Round(Vec<u32>),
}

/// Returns the quantile `share` of the `sorted` values, or `None` if there are no values. The quantile is the
/// smallest of the values for which at least a fraction `share` of the values is not larger.
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let rank = (share * sorted.len() as f64).ceil().max(1.0) as usize;
    sorted.get(rank - 1).copied()
}

fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// Numbers of samples per pixel with which the pixels of a tile reach the goal.
struct Needs {
    /// Number of samples that each lit pixel of the tile needs.
    own: Vec<f64>,
    /// Number of samples that each pixel needs, sorted, for all pixels that determine the sample count of the
    /// tile.
    samples: Vec<f64>,
}

impl Needs {
    /// Returns the expected number of the tile's lit pixels that reach the goal with `n` samples per pixel.
    fn there(&self, n: f64) -> f64 {
        let there = self.samples.partition_point(|need| *need <= n);
        (self.own.len() * there) as f64 / self.samples.len().max(1) as f64
    }
}

impl Tile {
    /// Returns the larger of `samples` and the tile's current number of samples per pixel. If the slice keeps
    /// no pixel of the tile, returns the current number.
    fn at_least(&self, samples: f64) -> f64 {
        let had = f64::from(self.samples);
        if self.kept { had.max(samples) } else { had }
    }
}

impl Survey {
    /// Returns the relative error that a fraction `share` of the lit pixels does not exceed, or 0 if there
    /// are no lit pixels.
    pub fn reached(&self, share: f64) -> f64 {
        let errors = sorted(self.lit.iter().map(|p| p.error).collect());
        quantile(&errors, share).unwrap_or(0.0)
    }

    /// Returns the number of samples per pixel with which uniform sampling would reach the error
    /// [`Self::reached`], estimated from the errors and sample counts of the lit pixels.
    pub fn uniform(&self, share: f64) -> f64 {
        let reached = self.reached(share);
        let needs = self.lit.iter().map(|p| p.samples * (p.error / reached).powi(2));
        quantile(&sorted(needs.collect()), share).unwrap_or(0.0)
    }

    /// Returns the total number of samples of all tiles.
    pub fn samples(&self) -> u64 {
        let of = |t: &Tile| u64::from(t.pixels) * u64::from(t.samples);
        self.tiles.iter().map(of).sum()
    }

    /// Returns the mean number of samples per pixel over the image.
    pub fn mean_samples(&self) -> f64 {
        let pixels: u64 = self.tiles.iter().map(|t| u64::from(t.pixels)).sum();
        self.samples() as f64 / pixels.max(1) as f64
    }

    /// Returns the next step of adaptive sampling.
    pub fn next(&self, goal: &Goal) -> Next {
        self.next_by(goal, LEAST_LIT)
    }

    /// Returns the next step as [`Self::next`] does, but at least `least` pixels determine the samples of a
    /// tile.
    pub(crate) fn next_by(&self, goal: &Goal, least: usize) -> Next {
        if self.reached(goal.share) <= goal.error {
            return Next::Reached;
        }
        let needs = self.needs(goal.error * MARGIN, least);
        let all = sorted(needs.iter().flat_map(|n| n.own.iter().copied()).collect());
        let everywhere = quantile(&all, goal.share).unwrap_or(0.0);
        let most = f64::from(goal.most);
        let counts: Vec<f64> = COUNTS
            .map(|step| (everywhere * 2.0_f64.powf(f64::from(step) / f64::from(STEPS))).min(most))
            .collect();
        let wanted = goal.share * all.len() as f64;
        let plan = self.plan(&needs, &counts, wanted);
        let same: Vec<f64> = self.tiles.iter().map(|t| t.at_least(everywhere.min(most))).collect();
        let cheapest = plan.filter(|plan| self.cost(plan) < self.cost(&same)).unwrap_or(same);
        self.round(&cheapest, goal)
    }

    /// Returns the total number of samples if each tile has the given number of samples per pixel.
    fn cost(&self, counts: &[f64]) -> f64 {
        let tiles = self.tiles.iter().zip(counts);
        tiles.map(|(t, n)| f64::from(t.pixels) * n).sum()
    }

    fn needs(&self, error: f64, least: usize) -> Vec<Needs> {
        let mut own = vec![vec![]; self.tiles.len()];
        for p in &self.lit {
            let need = p.samples * (p.error / error).powi(2);
            if let Some(own) = own.get_mut(p.tile as usize) {
                own.push(need);
            }
        }
        let all = sorted(own.concat());
        let across = self.across.max(1) as usize;
        let around = |tile: usize| {
            let (row, column) = (tile / across, tile % across);
            let rows = row.saturating_sub(1)..=row + 1;
            let columns = column.saturating_sub(1)..=(column + 1).min(across - 1);
            rows.flat_map(move |r| columns.clone().map(move |c| r * across + c))
        };
        let of = |tile: usize| {
            let lit = own[tile].len();
            let samples = if lit == 0 || lit >= least {
                sorted(own[tile].clone())
            } else {
                let near: Vec<f64> = around(tile).filter_map(|t| own.get(t)).flatten().copied().collect();
                if near.len() >= least { sorted(near) } else { all.clone() }
            };
            Needs { own: own[tile].clone(), samples }
        };
        (0..own.len()).map(of).collect()
    }

    /// Returns the samples per pixel for each tile with which `wanted` lit pixels reach the goal. The numbers
    /// are chosen from the increasing `counts`. For each tile, the choice maximizes the number of pixels at
    /// the goal minus the number of samples times a price (a Lagrange multiplier). The price is the highest
    /// price with which `wanted` pixels reach the goal. Returns `None` if no price is low enough.
    fn plan(&self, needs: &[Needs], counts: &[f64], wanted: f64) -> Option<Vec<f64>> {
        // Choices for each tile: the samples per pixel, and the number of pixels at the goal.
        let choices: Vec<Vec<[f64; 2]>> = self
            .tiles
            .iter()
            .zip(needs)
            .map(|(tile, needs)| {
                let choice = |n: &f64| [tile.at_least(*n), needs.there(tile.at_least(*n))];
                counts.iter().map(choice).collect()
            })
            .collect();
        let best = |price: f64| -> Vec<[f64; 2]> {
            let of = |(tile, choices): (&Tile, &Vec<[f64; 2]>)| {
                let worth = |[n, there]: &[f64; 2]| there - price * f64::from(tile.pixels) * n;
                // Of equally good choices, use the first, which has the fewest samples.
                let better = |a: [f64; 2], b: &[f64; 2]| if worth(b) > worth(&a) { *b } else { a };
                choices.iter().fold(choices[0], better)
            };
            self.tiles.iter().zip(&choices).map(of).collect()
        };
        let enough = |price: f64| best(price).iter().map(|c| c[1]).sum::<f64>() >= wanted;
        // The price in pixels per sample is searched on a logarithmic scale.
        let (mut low, mut high) = (-40.0_f64, 5.0);
        if counts.is_empty() || !enough(low.exp()) {
            return None;
        }
        for _ in 0..60 {
            let price = 0.5 * (low + high);
            if enough(price.exp()) {
                low = price;
            } else {
                high = price;
            }
        }
        Some(best(low.exp()).into_iter().map(|c| c[0]).collect())
    }

    /// Returns the part of a plan that the next round renders.
    fn round(&self, plan: &[f64], goal: &Goal) -> Next {
        let more: Vec<f64> =
            self.tiles.iter().zip(plan).map(|(t, n)| (n - f64::from(t.samples)).max(0.0)).collect();
        let share = (GROWTH * self.samples() as f64 / self.cost(&more)).min(1.0);
        let left = |t: &Tile| goal.most.saturating_sub(t.samples);
        let tiles = self.tiles.iter().zip(&more);
        let mut counts: Vec<u32> = tiles.map(|(t, n)| round_count(n * share).min(left(t))).collect();
        if counts.iter().all(|n| *n == 0) {
            let least = |t: &Tile| if t.kept { LEAST_ROUND.min(left(t)) } else { 0 };
            counts = self.tiles.iter().map(least).collect();
        }
        // A single sample gives no error estimate.
        counts.iter_mut().filter(|n| **n < 2).for_each(|n| *n = 0);
        if counts.iter().all(|n| *n == 0) { Next::Exhausted } else { Next::Round(counts) }
    }
}

/// Returns 0 for few samples. Otherwise, rounds `samples` up to whole stratified groups, and returns the
/// rounded number. The size of a group is the smallest power of two, at most 64, for which the number of
/// groups is less than 2 × [`GROUPS`].
fn round_count(samples: f64) -> u32 {
    if samples <= f64::from(LEAST_ROUND / 2) {
        return 0;
    }
    let samples = samples.ceil().min(f64::from(1 << 30)) as u32;
    let mut group = 1;
    while samples >= 2 * GROUPS * group && group < 64 {
        group *= 2;
    }
    samples.max(LEAST_ROUND).next_multiple_of(group)
}

#[cfg(test)]
mod tests;
