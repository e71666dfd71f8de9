//! One to three processes that write one store are killed at random times. A store is never falsely reported
//! as finished, and in the end its bytes equal those of an undisturbed run.
//!
//! A few trials by default; `SUNSTONE_KILLS=200 cargo test --release --test suite kills -- --nocapture` sets
//! the number of each kind.

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
    std::env::var("SUNSTONE_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(12)
}

/// States of the stores that killed processes leave.
#[derive(Debug, Default)]
struct Outcomes {
    nothing: u32,
    unfinished: u32,
    finished: u32,
}

/// Starts some processes in parallel and kills them at a random time of up to `longest`.
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
        // It may have ended.
        let _ = child.kill();
    }
    for child in &mut children {
        child.wait().expect("its end");
    }
}

/// A store that is reported as finished has the written content; an unfinished one does not read as finished.
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

/// 1.5 times the duration of an undisturbed command.
fn duration(at: &Path, arguments: &[&str]) -> Duration {
    let begun = Instant::now();
    run(at, arguments, 0);
    begun.elapsed().mul_f64(1.6)
}

/// Asserts that a folder contains only the named entries.
fn only(at: &Path, names: &[&str]) {
    let mut left: Vec<String> = std::fs::read_dir(at)
        .expect("a folder")
        .map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned())
        .filter(|name| !names.contains(&name.as_str()))
        .collect();
    left.sort();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
#[ignore = "slow: tools/check --all"]
fn renders() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), mirror_room(32, 32, 16, 4, SLICES)).expect("a scene");
    let command = |store: &'static str| ["render", "scene.toml", "--no-figures", "--resume", "-o", store];
    let mut longest = duration(at, &command("whole.zarr"));
    let mut random = Stream::new(1, 0, 0);
    let mut outcomes = Outcomes::default();
    for trial in 0..trials() {
        let store = at.join("s.zarr");
        let _ = std::fs::remove_dir_all(&store);
        let one = command("s.zarr");
        let some = vec![&one[..]; 1 + trial as usize % 3];
        kill_some(at, &some, &mut random, longest);
        let before = (outcomes.nothing, outcomes.finished);
        check(at, "s.zarr", &mut outcomes);
        // Other load on the machine varies, and with it the time of a render.
        if outcomes.finished > before.1 {
            longest = longest.mul_f64(0.8);
        } else if outcomes.nothing > before.0 {
            longest = longest.mul_f64(1.25);
        }
        run(at, &one, 0);
        assert!(verify(&store).expect("a finished store").faults.is_empty());
        assert_same_store(&store, &at.join("whole.zarr"));
        only(at, &["scene.toml", "whole.zarr", "s.zarr"]);
    }
    println!("{} renders killed: {outcomes:?}", trials());
    assert!(outcomes.unfinished > 0, "{outcomes:?}");
}

#[test]
#[ignore = "slow: tools/check --all"]
fn merges_and_exports() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), mirror_room(64, 64, 4, 16, SLICES)).expect("a scene");
    for (seed, store) in [("1", "a.zarr"), ("2", "b.zarr")] {
        run(at, &["render", "scene.toml", "--seed", seed, "--no-figures", "-o", store], 0);
    }
    let merge = |store: &'static str| ["merge", "a.zarr", "b.zarr", "--force", "-o", store];
    let export = |file: &'static str| ["export", "a.zarr", "mueller", "--mueller", "-o", file];
    let longest = duration(at, &merge("whole.zarr"));
    let export_longest = duration(at, &export("whole.exr"));
    let mut random = Stream::new(2, 0, 0);
    let mut outcomes = Outcomes::default();
    let inputs = [files(&at.join("a.zarr")), files(&at.join("b.zarr"))];
    for trial in 0..trials() {
        // Every second trial replaces an existing store.
        if trial % 2 == 0 {
            let _ = std::fs::remove_dir_all(at.join("s.zarr"));
        }
        let one = merge("s.zarr");
        let some = vec![&one[..]; 1 + trial as usize % 3];
        kill_some(at, &some, &mut random, longest);
        check(at, "s.zarr", &mut outcomes);
        assert!(trial % 2 == 0 || at.join("s.zarr").exists(), "the old store is lost");
        run(at, &one, 0);
        assert_same_store(&at.join("s.zarr"), &at.join("whole.zarr"));

        let one = export("e.exr");
        let some = vec![&one[..]; 1 + trial as usize % 3];
        kill_some(at, &some, &mut random, export_longest);
        let whole = std::fs::read(at.join("whole.exr")).expect("an image");
        if let Ok(bytes) = std::fs::read(at.join("e.exr")) {
            assert!(bytes == whole, "half an image");
        }
        run(at, &one, 0);
        assert!(std::fs::read(at.join("e.exr")).expect("an image") == whole);
        only(at, &["scene.toml", "a.zarr", "b.zarr", "whole.zarr", "whole.exr", "s.zarr", "e.exr"]);
        std::fs::remove_file(at.join("e.exr")).expect("an image");
    }
    assert_eq!(outcomes.unfinished, 0, "a merge is there whole or not at all");
    assert!([files(&at.join("a.zarr")), files(&at.join("b.zarr"))] == inputs);
    println!("{} merges and exports killed: {outcomes:?}", trials());
}

#[test]
#[ignore = "slow: tools/check --all"]
fn copies_into_shards() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), mirror_room(64, 64, 4, 16, SLICES)).expect("a scene");
    run(at, &["render", "scene.toml", "--no-figures", "-o", "a.zarr"], 0);
    let shard = |store: &'static str| ["shard", "a.zarr", "--force", "-o", store];
    let longest = duration(at, &shard("whole.zarr"));
    let mut random = Stream::new(3, 0, 0);
    let mut outcomes = Outcomes::default();
    let input = files(&at.join("a.zarr"));
    for trial in 0..trials() {
        if trial % 2 == 0 {
            let _ = std::fs::remove_dir_all(at.join("s.zarr"));
        }
        let one = shard("s.zarr");
        let some = vec![&one[..]; 1 + trial as usize % 3];
        kill_some(at, &some, &mut random, longest);
        check(at, "s.zarr", &mut outcomes);
        run(at, &one, 0);
        assert_same_store(&at.join("s.zarr"), &at.join("whole.zarr"));
        only(at, &["scene.toml", "a.zarr", "whole.zarr", "s.zarr"]);
    }
    assert_eq!(outcomes.unfinished, 0, "a copy is there whole or not at all");
    assert!(files(&at.join("a.zarr")) == input);
    println!("{} copies into shards killed: {outcomes:?}", trials());
}

/// Of several processes at one path, one writes and the others report which one.
#[test]
fn one_writes() {
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
    only(at, &["scene.toml", "s.zarr"]);
}
