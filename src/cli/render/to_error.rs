//! `sunstone render --target-error`.

use super::{Arguments, Progress, again, in_doubt};
use crate::cli::failure::Failure;
use crate::cli::{figure, output};
use serde_json::Value;
use std::path::PathBuf;
use std::sync::Mutex;
use sunstone::render::{Summary, Target};
use sunstone::rounds::{Goal, RoundPart, RoundsError, Standing, ToError};
use sunstone::tensor::target::Next;
use sunstone::transport::scene::Scene;

/// Samples of every pixel in the first round, unless `--spp` says another number.
const FIRST: u32 = 64;

/// Most samples of a pixel, unless `--most-spp` says another number.
const MOST: u32 = 1 << 14;

#[derive(clap::Args)]
#[command(next_help_heading = "To an error, instead of to a number of samples")]
pub(super) struct TargetArguments {
    /// Render rounds of samples until half of the lit pixels of a slice have this relative standard error, such as 0.02. Tiles that
    /// need no more get no more. --spp is then the number of samples of the first round [default: 64].
    #[arg(long, value_name = "ERROR", conflicts_with = "tiles")]
    target_error: Option<f64>,
    /// Which slice [default: the first].
    #[arg(long, value_name = "NAME", requires = "target_error")]
    target_slice: Option<String>,
    /// Share of the lit pixels that shall have the error, such as 0.9 [default: 0.5, the median].
    #[arg(long, value_name = "SHARE", requires = "target_error")]
    target_share: Option<f64>,
    /// Most samples of a pixel, whatever its error [default: 16384].
    #[arg(long, value_name = "N", requires = "target_error")]
    most_spp: Option<u32>,
    /// For many machines: folder of the rounds so far, 0.zarr, 1.zarr and so on. Prints where they stand, as JSON, and renders nothing
    /// unless --round and --part say what.
    #[arg(long, value_name = "FOLDER", requires = "target_error")]
    rounds: Option<PathBuf>,
    /// Round to render a part of.
    #[arg(long, value_name = "K", requires_all = ["rounds", "part"])]
    round: Option<u32>,
}

impl TargetArguments {
    /// What is asked for, of a scene; with `--spp`.
    pub fn goal(&self, spp: Option<u32>, scene: &Scene) -> Option<Goal> {
        let first = || scene.slices.first().map_or(String::new(), |s| s.name.clone());
        Some(Goal {
            error: self.target_error?,
            slice: self.target_slice.clone().unwrap_or_else(first),
            share: self.target_share.unwrap_or(0.5),
            first: spp.unwrap_or(FIRST),
            most: self.most_spp.unwrap_or_else(|| MOST.max(spp.unwrap_or(FIRST))),
        })
    }

    /// The same words again.
    pub fn words(&self) -> String {
        let mut words = String::new();
        let mut word = |name: &str, value: Option<String>| {
            if let Some(value) = value {
                words += &format!(" --{name} {value}");
            }
        };
        word("target-error", self.target_error.map(|v| v.to_string()));
        word("target-slice", self.target_slice.clone());
        word("target-share", self.target_share.map(|v| v.to_string()));
        word("most-spp", self.most_spp.map(|v| v.to_string()));
        word("rounds", self.rounds.as_deref().map(super::quoted));
        word("round", self.round.map(|v| v.to_string()));
        words
    }
}

fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}

/// What a line of progress begins with.
fn about(standing: &Standing, goal: &Goal) -> String {
    let round = standing.round + 1;
    standing.error.map_or_else(
        || format!("round {round}: "),
        |error| {
            format!(
                "round {round}, error so far {} of {}: ",
                percent(error),
                percent(goal.error)
            )
        },
    )
}

pub(super) fn run(
    a: &Arguments,
    scene: &mut Scene,
    goal: Goal,
    figures: Value,
    target: &Target,
    progress: &Progress,
) -> Result<(), Failure> {
    let last = Mutex::new(None);
    let begins = |standing: &Standing| {
        progress.about(about(standing, &goal));
        *last.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = Some(standing.clone());
    };
    let to_error = ToError {
        goal: goal.clone(),
        watch: progress,
        begins: &begins,
        attributes: vec![("figures", figures)],
        threads: a.threads.unwrap_or(0),
    };
    let failed = |e: RoundsError| Failure::of_system(e.is_of_system(), e);
    if let (Some(folder), None) = (&a.target.rounds, a.target.round) {
        let standing = to_error.standing(scene, folder, None).map_err(failed)?;
        return output::print(&standing.to_json().to_string());
    }
    let round = a.target.rounds.as_ref().zip(a.target.round).zip(a.part);
    let summary = match round {
        Some(((folder, round), part)) => {
            let part = RoundPart {
                part,
                light: a.light.as_deref(),
            };
            to_error.part_of_round(scene, folder, round, part, target)
        }
        None if a.part.is_some() => {
            return Err(Failure::input(
                "--part with --target-error is a part of a round: add --rounds FOLDER and --round K",
            ));
        }
        None => to_error.render(scene, target),
    };
    let summary = summary.map_err(failed)?;
    progress.clear();
    if !summary.complete {
        return Err(Failure::Interrupted(format!(
            "stopped after {} of {} tiles of a round; to go on:\n  {}",
            summary.tiles_done,
            summary.tiles,
            again(a, target)
        )));
    }
    let store = target.path.display();
    let standing = last
        .into_inner()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    output::print(&match (a.target.round, standing) {
        (Some(round), _) => format!(
            "{store}: part of round {round}, {} tiles, {} samples, {:.1} s",
            summary.tiles, summary.samples, summary.wall_s
        ),
        (None, None) => format!("{store}: was complete already"),
        (None, Some(standing)) => told(&summary, &standing, &goal, scene, a, target)?,
    })?;
    if !a.no_figures && a.target.round.is_none() {
        figure::draw_all(&target.path, None)?;
    }
    Ok(())
}

/// What was rendered.
fn told(
    summary: &Summary,
    standing: &Standing,
    goal: &Goal,
    scene: &Scene,
    a: &Arguments,
    target: &Target,
) -> Result<String, Failure> {
    let of = if goal.share == 0.5 {
        "median".to_owned()
    } else {
        format!("{} of", percent(goal.share))
    };
    let missed = if standing.next == Next::Exhausted {
        format!(
            ": more than {}, with the most samples that pixels may have (--most-spp {})",
            percent(goal.error),
            goal.most
        )
    } else {
        String::new()
    };
    let rate = summary.samples as f64 / summary.wall_s.max(1e-9) / 1e6;
    Ok(format!(
        "{}: {} slices, error {} ({of} lit pixels of slice {}){missed}, after {} rounds of {:.0} spp in the mean, where one number for \
         all would be about {:.0}; {:.1} s, {rate:.2} Msamples/s, {} samples discarded{}",
        target.path.display(),
        scene.slices.len(),
        percent(standing.error.unwrap_or(0.0)),
        goal.slice,
        standing.round,
        standing.mean,
        standing.uniform,
        summary.wall_s,
        summary.discarded,
        if a.part.is_none() {
            in_doubt(&target.path)?
        } else {
            String::new()
        },
    ))
}
