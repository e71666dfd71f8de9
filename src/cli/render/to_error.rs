//! The `sunstone render --target-error` option.

use super::arguments::{Arguments, again};
use super::in_doubt;
use super::progress::Progress;
use crate::{Failure, bail, figure, print};
use serde_json::Value;
use std::sync::Mutex;
use sunstone::render::{Summary, Target};
use sunstone::rounds::{Goal, RoundPart, RoundsError, Standing, ToError};
use sunstone::tensor::target::Next;
use sunstone::transport::scene::Scene;

fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}

/// Returns the prefix of the progress line.
fn about(standing: &Standing, goal: &Goal) -> String {
    let round = standing.round + 1;
    standing.error.map_or_else(
        || format!("round {round}: "),
        |error| format!("round {round}, current error {} (target {}): ", percent(error), percent(goal.error)),
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
        return print(&standing.to_json().to_string());
    }
    let round = a.target.rounds.as_ref().zip(a.target.round).zip(a.part);
    let summary = match round {
        Some(((folder, round), part)) => {
            let part = RoundPart { part, light: a.light.as_deref() };
            to_error.part_of_round(scene, folder, round, part, target)
        }
        None if a.part.is_some() => bail!(
            "--part with --target-error requires the options --rounds and --round; pass --rounds FOLDER and --round K"
        ),
        None => to_error.render(scene, target),
    };
    let summary = summary.map_err(failed)?;
    progress.clear();
    if !summary.complete {
        return Err(Failure::Interrupted(format!(
            "stopped after {} of {} tiles of a round; to resume:\n  {}",
            summary.tiles_done,
            summary.tiles,
            again(a, target)
        )));
    }
    let store = target.path.display();
    let standing = last.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    print(&match (a.target.round, standing) {
        (Some(round), _) => format!(
            "{store}: part of round {round}, {} tiles, {} samples, {:.1} s",
            summary.tiles, summary.samples, summary.wall_s
        ),
        (None, None) => format!("{store}: already complete"),
        (None, Some(standing)) => describe(&summary, &standing, &goal, scene, a, target)?,
    })?;
    if !a.no_figures && a.target.round.is_none() {
        figure::draw_all(&target.path, None)?;
    }
    Ok(())
}

/// Formats the summary of a render.
fn describe(
    summary: &Summary,
    standing: &Standing,
    goal: &Goal,
    scene: &Scene,
    a: &Arguments,
    target: &Target,
) -> Result<String, Failure> {
    let of = if goal.share == 0.5 { "median of".to_owned() } else { format!("{} of", percent(goal.share)) };
    let missed = if standing.next == Next::Exhausted {
        format!(
            ", above the target of {}: some pixels reached the sample limit (--most-spp {})",
            percent(goal.error),
            goal.most
        )
    } else {
        String::new()
    };
    let rate = summary.samples as f64 / summary.wall_s.max(1e-9) / 1e6;
    Ok(format!(
        "{}: {} slices, error {} ({of} the lit pixels of slice {}){missed}, after {} rounds with {:.0} spp on average (uniform sampling: \
         about {:.0}); {:.1} s, {rate:.2} Msamples/s, {} samples discarded{}",
        target.path.display(),
        scene.slices.len(),
        percent(standing.error.unwrap_or(0.0)),
        goal.slice,
        standing.round,
        standing.mean,
        standing.uniform,
        summary.wall_s,
        summary.discarded,
        if a.part.is_none() { in_doubt(&target.path)? } else { String::new() },
    ))
}
