//! How many samples each tile of an image needs until a slice is known to the error that was asked for.
//!
//! Rounds of samples are added up. After each, every lit pixel tells by its relative error e and its samples n that it needs
//! n (e / goal)² samples. The slice is there once a share of its lit pixels is (half of them: the median). So samples go first to tiles
//! where the next ones bring most pixels there, and are saved where pixels are there already or would not be for long. No tile gets less than
//! half of the number that would do the same everywhere, so that no error is more than √2 times what it then would be.
//!
//! A count that a pixel's own noise decides makes its mean wrong: where the dim samples came first, sampling stops. So
//! tiles decide, by at least [`LEAST_LIT`] pixels, of which one moves a quantile hardly.

use serde_json::{Value, json};

/// Root attribute of a store that was rendered to an error.
pub const ATTRIBUTE: &str = "target";

/// Root attribute of a round's store: its number and what it is a round of.
pub const ROUND: &str = "round";

/// Root attribute of a store whose tiles have each its own number of samples.
pub const TILE_SAMPLES: &str = "tile_samples";

/// Least number of lit pixels that decide over a tile; where it has fewer, those of its neighbours do too, or all.
pub const LEAST_LIT: usize = 64;

/// Counts of tiles that are thought of: so many times what would do everywhere, from half of it.
const STEPS: i32 = 16;
const COUNTS: std::ops::RangeInclusive<i32> = -STEPS..=3 * STEPS;

/// A round is at most so many times what was there before, whose errors are the less sure the fewer it was.
const GROWTH: f64 = 4.0;

/// Rounds aim a little below the goal, so that the last one does not miss it by a hair.
const MARGIN: f64 = 0.99;

/// Least number of samples of a tile in a round, more than half of which are worth its while.
const LEAST_ROUND: u32 = 16;

/// Groups of samples that a round's errors come from.
const GROUPS: u32 = 32;

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal {
    /// Name of the slice.
    pub slice: String,
    /// Relative standard error of a pixel, such as 0.02.
    pub error: f64,
    /// Share of the lit pixels that shall be known so well: 0.5 for the median.
    pub share: f64,
    /// Samples of each pixel in the first round.
    pub first: u32,
    /// Most samples of a pixel in all rounds.
    pub most: u32,
}

impl Goal {
    /// Says what is wrong with it, if anything. `dashes` stand before the names of choices: those of a command, or nothing.
    #[must_use]
    pub fn fault(&self, dashes: &str) -> Option<String> {
        if !(self.error > 0.0 && self.error < 1.0) {
            return Some(format!(
                "{dashes}target-error is {}; give a relative error between 0 and 1, such as 0.02",
                self.error
            ));
        }
        if !(self.share > 0.0 && self.share < 1.0) {
            return Some(format!(
                "{dashes}target-share is {}; give a share between 0 and 1, such as 0.5",
                self.share
            ));
        }
        if !(GROUPS..=1 << 20).contains(&self.first) {
            return Some(format!(
                "{dashes}spp is {}; give {GROUPS} to {} samples for the first round",
                self.first,
                1 << 20
            ));
        }
        if !(self.first..=1 << 30).contains(&self.most) {
            return Some(format!(
                "{dashes}most-spp is {}; give {} to {}: no less than the first round",
                self.most,
                self.first,
                1 << 30
            ));
        }
        None
    }

    /// As an attribute of a store.
    #[must_use]
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

/// A lit pixel, or element of several, as the rounds so far know it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lit {
    /// Its tile.
    pub tile: u32,
    /// Samples of each of its pixels.
    pub samples: f64,
    /// Its relative standard error; infinite where it is not known.
    pub error: f64,
}

/// A tile as the rounds so far made it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tile {
    /// Camera pixels.
    pub pixels: u32,
    /// Samples of each.
    pub samples: u32,
    /// Whether the slice keeps some of them.
    pub kept: bool,
}

/// What rounds so far tell of a slice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Survey {
    /// Its lit pixels.
    pub lit: Vec<Lit>,
    /// All tiles, row by row.
    pub tiles: Vec<Tile>,
    /// Tiles in a row.
    pub across: u32,
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Next {
    /// Nothing: the goal is reached.
    Reached,
    /// Nothing more may be: pixels have the most samples that they may have.
    Exhausted,
    /// A round of so many samples a pixel of each tile.
    Round(Vec<u32>),
}

/// The smallest number that at least a share of sorted ones does not exceed; none of none.
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let rank = (share * sorted.len() as f64).ceil().max(1.0) as usize;
    sorted.get(rank - 1).copied()
}

fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// The samples that pixels need.
struct Needs {
    /// Lit ones of a tile.
    own: Vec<f64>,
    /// Sorted, of those that decide over it.
    samples: Vec<f64>,
}

impl Needs {
    /// How many of the tile's lit pixels are there with `n` samples.
    fn there(&self, n: f64) -> f64 {
        let there = self.samples.partition_point(|need| *need <= n);
        (self.own.len() * there) as f64 / self.samples.len().max(1) as f64
    }
}

impl Tile {
    /// So many samples, or what it has, which is all where nothing of it is kept.
    fn at_least(&self, samples: f64) -> f64 {
        let had = f64::from(self.samples);
        if self.kept { had.max(samples) } else { had }
    }
}

impl Survey {
    /// The relative error that a share of the lit pixels does not exceed; zero if nothing is lit.
    #[must_use]
    pub fn reached(&self, share: f64) -> f64 {
        let errors = sorted(self.lit.iter().map(|p| p.error).collect());
        quantile(&errors, share).unwrap_or(0.0)
    }

    /// Samples a pixel that, the same number everywhere, would reach the same error, so far as variances tell.
    #[must_use]
    pub fn uniform(&self, share: f64) -> f64 {
        let reached = self.reached(share);
        let needs = self.lit.iter().map(|p| p.samples * (p.error / reached).powi(2));
        quantile(&sorted(needs.collect()), share).unwrap_or(0.0)
    }

    /// Samples of all pixels.
    #[must_use]
    pub fn samples(&self) -> u64 {
        let of = |t: &Tile| u64::from(t.pixels) * u64::from(t.samples);
        self.tiles.iter().map(of).sum()
    }

    /// Samples a pixel, the mean over the image.
    #[must_use]
    pub fn mean_samples(&self) -> f64 {
        let pixels: u64 = self.tiles.iter().map(|t| u64::from(t.pixels)).sum();
        self.samples() as f64 / pixels.max(1) as f64
    }

    /// The next round.
    #[must_use]
    pub fn next(&self, goal: &Goal) -> Next {
        self.next_by(goal, LEAST_LIT)
    }

    /// [`Self::next`] with tiles that so many pixels decide over.
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
        let same: Vec<f64> = self
            .tiles
            .iter()
            .map(|t| t.at_least(everywhere.min(most)))
            .collect();
        let cheapest = plan
            .filter(|plan| self.cost(plan) < self.cost(&same))
            .unwrap_or(same);
        self.round(&cheapest, goal)
    }

    /// Samples of all pixels, of so many of the pixels of each tile.
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
                let near: Vec<f64> = around(tile)
                    .filter_map(|t| own.get(t))
                    .flatten()
                    .copied()
                    .collect();
                if near.len() >= least {
                    sorted(near)
                } else {
                    all.clone()
                }
            };
            Needs {
                own: own[tile].clone(),
                samples,
            }
        };
        (0..own.len()).map(of).collect()
    }

    /// Samples of each tile's pixels, each one of the rising `counts`, by which `wanted` lit pixels are there: each tile takes what
    /// brings most of them there, less a price of samples, which is as high as may be. None if no price is low enough.
    fn plan(&self, needs: &[Needs], counts: &[f64], wanted: f64) -> Option<Vec<f64>> {
        // Samples and pixels there of each tile's choices.
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
                // Of equals the first, which costs least.
                let better = |a: [f64; 2], b: &[f64; 2]| if worth(b) > worth(&a) { *b } else { a };
                choices.iter().fold(choices[0], better)
            };
            self.tiles.iter().zip(&choices).map(of).collect()
        };
        let enough = |price: f64| best(price).iter().map(|c| c[1]).sum::<f64>() >= wanted;
        // Pixels for a sample, on a scale of logarithms.
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

    /// What of a plan the next round brings.
    fn round(&self, plan: &[f64], goal: &Goal) -> Next {
        let more: Vec<f64> = self
            .tiles
            .iter()
            .zip(plan)
            .map(|(t, n)| (n - f64::from(t.samples)).max(0.0))
            .collect();
        let share = (GROWTH * self.samples() as f64 / self.cost(&more)).min(1.0);
        let left = |t: &Tile| goal.most.saturating_sub(t.samples);
        let tiles = self.tiles.iter().zip(&more);
        let mut counts: Vec<u32> = tiles.map(|(t, n)| round_count(n * share).min(left(t))).collect();
        if counts.iter().all(|n| *n == 0) {
            let least = |t: &Tile| if t.kept { LEAST_ROUND.min(left(t)) } else { 0 };
            counts = self.tiles.iter().map(least).collect();
        }
        // One sample alone has no error.
        counts.iter_mut().filter(|n| **n < 2).for_each(|n| *n = 0);
        if counts.iter().all(|n| *n == 0) {
            Next::Exhausted
        } else {
            Next::Round(counts)
        }
    }
}

/// At least so many samples, in whole stratified groups of a power of two, of which there are [`GROUPS`] to twice as many; none of few.
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
