//! Kills one to three processes that write the same store, at random times. Tests that an unfinished store is
//! never reported as finished. Tests that the final bytes equal the bytes of an undisturbed run.
//!
//! By default, the tests run few trials. `SUNSTONE_KILLS=200 cargo test --release --test suite kills --
//! --nocapture` sets the number of trials of each kind.

use crate::harness::{assert_same_store, files, mirror_room, run, stderr, sunstone};
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};
use sunstone::optics::sampling::stream::Stream;
use sunstone::store::zarr::verify;

const SLICES: &str = r#"
[[slices]]
name = "mueller"
polarization = "mueller"
[[slices]]
name = "flight"
time = { start_ps = 12000, bin_ps = 500, bins = 20 }
[[slices]]
name = "sum"
camera = { binned = 4 }
"#;

fn trials() -> u32 {
    std::env::var("SUNSTONE_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(6)
}

/// Numbers of stores in each state after the writing processes were killed.
#[derive(Debug, Default)]
struct Outcomes {
    nothing: u32,
    unfinished: u32,
    finished: u32,
}

/// Starts processes in parallel, and kills each process at a random time of at most `longest`.
fn kill_some(at: &Path, commands: &[&[&str]], random: &mut Stream, longest: Duration) {
    let mut children: Vec<Child> = commands
        .iter()
        .map(|arguments| {
            let mut command = sunstone(at, arguments);
            command.stderr(Stdio::null()).stdout(Stdio::null()).spawn().expect("the program")
        })
        .collect();
    let share = f64::from(random.uniform());
    std::thread::sleep(longest.mul_f64(share));
    for child in &mut children {
        // The process may have ended already.
        let _ = child.kill();
    }
    for child in &mut children {
        child.wait().expect("its end");
    }
}

/// Asserts that a store that is reported as finished has the written content. Asserts that an unfinished
/// store cannot be read as finished.
fn check(at: &Path, store: &str, outcomes: &mut Outcomes) {
    let path = at.join(store);
    if !path.exists() {
        outcomes.nothing += 1;
    } else if path.join("manifest.txt").exists() {
        let found = verify(&path).expect("a finished store");
        assert!(found.faults.is_empty(), "{found:?}");
        outcomes.finished += 1;
    } else {
        let text = stderr(&run(at, &["probe", store, "mueller", "-o", "probe.npy"], 2));
        assert!(text.contains("unfinished"), "{text}");
        outcomes.unfinished += 1;
    }
}

/// Returns 1.6 times the duration of an undisturbed command.
fn duration(at: &Path, arguments: &[&str]) -> Duration {
    let begun = Instant::now();
    run(at, arguments, 0);
    begun.elapsed().mul_f64(1.6)
}

/// Repeatedly kills and restarts a command that writes a store or a file. Asserts that the result equals the
/// result `whole` of an undisturbed run, and that no other files remain. If `replaces` is set, every second
/// trial replaces an existing output.
fn killed(
    at: &Path,
    command: impl Fn(&'static str) -> Vec<&'static str>,
    outputs: [&'static str; 2],
    replaces: bool,
) -> Outcomes {
    let [output, whole] = outputs;
    let mut longest = duration(at, &command(whole));
    let mut random = Stream::new(1, 0, 0);
    let mut outcomes = Outcomes::default();
    let before = files(at);
    for trial in 0..trials() {
        if trial % 2 == 0 || !replaces {
            let _ = std::fs::remove_dir_all(at.join(output));
            let _ = std::fs::remove_file(at.join(output));
        }
        let one = command(output);
        kill_some(at, &vec![&one[..]; 1 + trial as usize % 3], &mut random, longest);
        let earlier = (outcomes.nothing, outcomes.finished);
        if output.ends_with(".zarr") {
            check(at, output, &mut outcomes);
        } else if let Ok(bytes) = std::fs::read(at.join(output)) {
            assert!(bytes == before[Path::new(whole)], "half a file");
        }
        assert!(trial % 2 == 0 || !replaces || at.join(output).exists(), "the old output is lost");
        // The duration of a command varies with the load of the machine.
        if outcomes.finished > earlier.1 {
            longest = longest.mul_f64(0.8);
        } else if outcomes.nothing > earlier.0 {
            longest = longest.mul_f64(1.25);
        }
        run(at, &one, 0);
        if output.ends_with(".zarr") {
            assert_same_store(&at.join(output), &at.join(whole));
        } else {
            assert!(std::fs::read(at.join(output)).expect("a file") == before[Path::new(whole)]);
        }
        let left = files(at);
        let is_own = |path: &Path| path.starts_with(output) || path == "probe.npy";
        assert!(left.keys().all(|path| before.contains_key(path) || is_own(path)), "{:?}", left.keys());
        assert!(before.iter().all(|(path, bytes)| left.get(path) == Some(bytes)), "an input has changed");
    }
    println!("{} times {:?} killed: {outcomes:?}", trials(), command(output));
    outcomes
}

#[test]
#[ignore = "slow: tools/check --all"]
fn killed_renders_resume() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), mirror_room(32, 32, 16, 4, SLICES)).expect("a scene");
    let command = |store| vec!["render", "scene.toml", "--no-figures", "--resume", "-o", store];
    let outcomes = killed(at, command, ["s.zarr", "whole.zarr"], false);
    assert!(outcomes.unfinished > 0, "{outcomes:?}");
}

/// Tests that the output of a command is either complete or absent.
#[test]
#[ignore = "slow: tools/check --all"]
fn killed_merges_exports_and_shards_leave_no_partial_output() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), mirror_room(64, 64, 4, 16, SLICES)).expect("a scene");
    for (seed, store) in [("1", "a.zarr"), ("2", "b.zarr")] {
        run(at, &["render", "scene.toml", "--seed", seed, "--no-figures", "-o", store], 0);
    }
    let merge = |store| vec!["merge", "a.zarr", "b.zarr", "--force", "-o", store];
    let export = |file| vec!["export", "a.zarr", "mueller", "--mueller", "-o", file];
    let shard = |store| vec!["shard", "a.zarr", "--force", "-o", store];
    assert_eq!(killed(at, merge, ["m.zarr", "merged.zarr"], true).unfinished, 0);
    killed(at, export, ["e.exr", "exported.exr"], false);
    assert_eq!(killed(at, shard, ["s.zarr", "sharded.zarr"], true).unfinished, 0);
}

/// Starts several processes that write to one path. Tests that one process writes, and that the error
/// messages of the remaining processes name the writing process.
#[test]
fn only_one_process_writes() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), mirror_room(64, 64, 64, 8, SLICES)).expect("a scene");
    let command = |seed| ["render", "scene.toml", "--no-figures", "--force", "--seed", seed, "-o", "s.zarr"];
    let children: Vec<Child> = ["1", "2", "3"]
        .iter()
        .map(|seed| {
            let mut command = sunstone(at, &command(seed));
            command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("the program")
        })
        .collect();
    let ends: Vec<(Option<i32>, String)> = children
        .into_iter()
        .map(|child| child.wait_with_output().expect("its end"))
        .map(|out| (out.status.code(), stderr(&out)))
        .collect();
    let refused: Vec<_> = ends.iter().filter(|e| e.0 == Some(2)).collect();
    assert_eq!(refused.len(), 2, "{ends:?}");
    assert!(refused.iter().all(|e| e.1.contains("is being written by process")), "{ends:?}");
    assert!(verify(&at.join("s.zarr")).expect("a finished store").faults.is_empty());
    let other = |path: &Path| !path.starts_with("s.zarr") && path != "scene.toml";
    assert!(!files(at).keys().any(|path| other(path)), "{:?}", files(at).keys());
}
