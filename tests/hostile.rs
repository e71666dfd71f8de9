//! Hostile cases: for any input the program answers quickly and briefly, with the right exit code, and leaves
//! no files behind.
//!
//! Every case runs the built program as a child process. `cargo test` runs a fixed subset of the cases;
//! `SUNSTONE_HOSTILE=all cargo test --release --test hostile -- --nocapture` runs all and prints the table.

#![cfg(unix)]

mod harness;

#[path = "hostile/case.rs"]
mod case;
#[path = "hostile/disk.rs"]
mod disk;
#[path = "hostile/documents.rs"]
mod documents;
#[path = "hostile/fixtures.rs"]
mod fixtures;
#[path = "hostile/inputs.rs"]
mod inputs;
#[path = "hostile/options.rs"]
mod options;
#[path = "hostile/outputs.rs"]
mod outputs;
#[path = "hostile/permissions.rs"]
mod permissions;
#[path = "hostile/scenes.rs"]
mod scenes;
#[path = "hostile/stores.rs"]
mod stores;

use case::{Case, Finding, Tally, run_all};
use fixtures::Fixtures;
use std::time::Instant;

/// By default, one of this many cases runs.
const PART: usize = 16;

#[test]
#[ignore = "slow: tools/check --all"]
fn hostile_cases_are_answered() {
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
    let findings = run_all(&part, &fixtures);
    let changed = fixtures.snapshot() != before;
    let tally = Tally::of(&findings);
    println!(
        "{} of {count} cases, {} refused, {} failed, {} accepted as listed, {:.1} s\n{tally}",
        part.len(),
        tally.refused,
        tally.failed,
        tally.accepted,
        begun.elapsed().as_secs_f64()
    );
    let bad: Vec<String> = findings.iter().filter_map(Finding::complaint).collect();
    assert!(bad.is_empty(), "{} cases:\n{}", bad.len(), bad.join("\n"));
    assert!(!changed, "files that were only to be read have changed");
}
