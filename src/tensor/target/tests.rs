//! Tests the sample counts that are chosen for each round.

use super::*;

const EDGE: u32 = 16;

/// Tiles of pixels with relative variances per sample. The variances are log-normally distributed between
/// tiles and within tiles.
struct Image {
    variances: Vec<(u32, f64)>,
    samples: Vec<u32>,
}

impl Image {
    fn new(between: f64, within: f64) -> Self {
        let mut state = 7_u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
        };
        let mut normal = move || (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
        let mut variances = vec![];
        for tile in 0..EDGE * EDGE {
            let level = between * normal();
            for _ in 0..256 {
                variances.push((tile, (2.0 * (level + within * normal())).exp()));
            }
        }
        Self { variances, samples: vec![64; (EDGE * EDGE) as usize] }
    }

    fn survey(&self) -> Survey {
        let lit = self.variances.iter().map(|(tile, v)| {
            let samples = f64::from(self.samples[*tile as usize]);
            Lit { tile: *tile, samples, error: (v / samples).sqrt() }
        });
        let tile = |samples: &u32| Tile { pixels: 256, samples: *samples, kept: true };
        Survey { lit: lit.collect(), tiles: self.samples.iter().map(tile).collect(), across: EDGE }
    }

    /// Renders rounds until the goal is reached, and returns the number of rounds.
    fn render(&mut self, goal: &Goal) -> u32 {
        for rounds in 0..20 {
            match self.survey().next(goal) {
                Next::Round(more) => self.samples.iter_mut().zip(more).for_each(|(n, m)| *n += m),
                Next::Reached => return rounds,
                Next::Exhausted => panic!("exhausted"),
            }
        }
        panic!("no end");
    }
}

fn goal(error: f64, share: f64) -> Goal {
    Goal { slice: "s".into(), error, share, first: 64, most: 1 << 20 }
}

/// Verifies that adaptive sampling reaches the goal with fewer samples than uniform sampling if variances
/// differ between tiles. The saving is small for the median, which excludes the noisy half of the pixels, and
/// large for a share of 0.9.
#[test]
fn the_goal_is_reached_with_fewer_samples() {
    for (share, least, most) in [(0.5, 0.60, 0.9), (0.9, 0.3, 0.6)] {
        let mut image = Image::new(1.0, 0.3);
        let rounds = image.render(&goal(0.03, share));
        let survey = image.survey();
        let reached = survey.reached(share);
        assert!(reached <= 0.03 && reached > 0.028, "{reached}");
        let saved = survey.mean_samples() / survey.uniform(share);
        assert!((2..=5).contains(&rounds) && (least..most).contains(&saved), "{rounds} {saved}");
    }
}

/// Verifies that equal tiles receive no more samples than with uniform sampling, because no samples can be
/// saved.
#[test]
fn equal_tiles_cost_as_much_as_uniform_sampling() {
    let mut image = Image::new(0.0, 0.5);
    image.render(&goal(0.03, 0.5));
    let survey = image.survey();
    let cost = survey.mean_samples() / survey.uniform(0.5);
    assert!((0.95..1.06).contains(&cost), "{cost}");
}

/// Verifies that the noise of the only lit pixel of a tile barely affects the sample counts.
#[test]
fn a_single_pixel_does_not_determine_its_tile() {
    let counts = |variance: f64| {
        let mut image = Image::new(0.5, 0.3);
        // Tile 20 has one lit pixel.
        let mut seen = 0;
        image.variances.retain(|(tile, _)| {
            seen += u32::from(*tile == 20);
            *tile != 20 || seen == 1
        });
        image.variances.iter_mut().filter(|p| p.0 == 20).for_each(|p| p.1 = variance);
        let Next::Round(counts) = image.survey().next(&goal(0.1, 0.9)) else {
            panic!("no round");
        };
        counts
    };
    let (low, high) = (counts(0.01), counts(100.0));
    let moved: u32 = low.iter().zip(&high).map(|(a, b)| a.abs_diff(*b)).sum();
    let all: u32 = low.iter().sum();
    // The counts of tile 20, and of tiles close to a threshold, may change by one or two steps.
    let own = f64::from(low[20]) / f64::from(high[20]);
    assert!(moved * 200 < all && (0.9..1.1).contains(&own), "{moved} of {all}, {own}");
    // As a control, if a single pixel determines the count, the pixel's error does change the count.
    let mut image = Image::new(0.5, 0.3);
    let alone = |image: &Image| image.survey().next_by(&goal(0.1, 0.9), 1);
    let before = alone(&image);
    image.variances.iter_mut().filter(|p| p.0 == 20).for_each(|p| p.1 = 1e-3);
    assert!(alone(&image) != before);
}

#[test]
fn rounds_end_at_the_maximum_number_of_samples() {
    let mut image = Image::new(0.5, 0.3);
    let goal = Goal { most: 100, ..goal(0.001, 0.5) };
    let Next::Round(more) = image.survey().next(&goal) else {
        panic!("no round");
    };
    assert!(more.iter().all(|n| *n == 36), "{more:?}");
    image.samples.fill(100);
    assert_eq!(image.survey().next(&goal), Next::Exhausted);
    assert_eq!(Survey::default().next(&goal), Next::Reached);
}

#[test]
fn counts_are_whole_numbers_of_groups() {
    assert_eq!([0.0, 8.0, 8.1, 33.0].map(round_count), [0, 0, 16, 33]);
    assert_eq!([64.5, 127.0, 128.5, 5000.0].map(round_count), [66, 128, 132, 5056]);
}

#[test]
fn invalid_goals_are_refused() {
    assert_eq!(goal(0.02, 0.5).fault(""), None);
    for wrong in [goal(0.0, 0.5), goal(f64::NAN, 0.5), goal(0.1, 1.0)] {
        assert!(wrong.fault("--").is_some_and(|m| m.contains("--target-")));
    }
    let few = Goal { first: 8, ..goal(0.1, 0.5) };
    let less = Goal { most: 32, ..goal(0.1, 0.5) };
    assert!(few.fault("").is_some() && less.fault("").is_some());
}
