//! Tests that, for any input, the program ends quickly with a short message and the correct exit code, and
//! leaves no files.
//!
//! Every case runs the built program as a child process. `cargo test` runs a fixed subset of the cases.
//!
//! `SUNSTONE_HOSTILE=all cargo test --release --test suite hostile -- --ignored --nocapture` runs all cases.

mod case;
mod disk;
mod documents;
mod fixtures;
mod inputs;
mod options;
mod outputs;
mod permissions;
mod scenes;
mod stores;

use case::{Case, run_all};
use fixtures::Fixtures;
use std::time::Instant;

/// Divisor of the number of cases. By default, one case in `PART` runs.
const PART: usize = 16;

#[test]
#[ignore = "slow: tools/check --all"]
fn hostile_cases_end_as_expected() {
    let begun = Instant::now();
    let fixtures = Fixtures::make();
    let all: Vec<Case> = [
        scenes::cases(),
        options::cases(),
        inputs::cases(),
        outputs::cases(),
        disk::cases(),
        documents::cases(),
        permissions::cases(),
        stores::cases(),
    ]
    .concat();
    let count = all.len();
    assert!(count >= 900, "{count} cases");
    let wanted = std::env::var("SUNSTONE_HOSTILE").unwrap_or_default();
    let part: Vec<Case> = match wanted.as_str() {
        "" => all.into_iter().step_by(PART).collect(),
        "all" => all,
        word => all.into_iter().filter(|c| c.name.contains(word)).collect(),
    };
    let before = fixtures.snapshot();
    let bad = run_all(&part, &fixtures);
    println!("{} of {count} cases, {:.1} s", part.len(), begun.elapsed().as_secs_f64());
    assert!(bad.is_empty(), "{} cases:\n{}", bad.len(), bad.join("\n"));
    assert!(fixtures.snapshot() == before, "files that were only to be read have changed");
}
