//! Tests that neither interruptions nor the number of threads change the bytes of a render.

use crate::harness::{assert_same_store, mirror_room, run, scene, stderr, sunstone};
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use sunstone::render::{Summary, Target, Unwatched, Watch, render};
use sunstone::transport::scene::Scene;

const SLICES: &str = r#"
[[slices]]
name = "sum"
[[slices]]
name = "mueller"
camera = { binned = 2 }
polarization = "mueller"
[[slices]]
name = "flight"
camera = { rows = [10, 30] }
projector = { binned = 8 }
time = { start_ps = 10000, bin_ps = 500, bins = 24 }
[[slices]]
name = "epipolar"
projector = { epipolar = { half_width_px = 1.0 } }
bounces = true
split_first_bounce = true
"#;

/// Number of tiles. Each tile has 4 × 4 pixels.
const TILES: usize = 256;

fn text(spp: u32) -> String {
    mirror_room(64, 32, spp, 4, SLICES)
}

/// Tests that the number of threads changes no byte of a bidirectional render. In a bidirectional render,
/// light can reach any tile. (`bytes.rs` compares the remaining integrators.)
#[test]
fn threads_do_not_change_the_output() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = small();
    let paths = [1, 2, 3].map(|threads| {
        let path = folder.path().join(format!("{threads}.zarr"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let target = Target { path: path.clone(), ..Target::default() };
        pool.install(|| render(&scene, &target, &Unwatched)).expect("a render");
        path
    });
    assert_same_store(&paths[0], &paths[1]);
    assert_same_store(&paths[0], &paths[2]);
}

fn small() -> Scene {
    let text = mirror_room(24, 16, 4, 4, SLICES).replace("[10, 30]", "[3, 20]");
    scene(&text.replacen("[render]", "[render]\nintegrator = \"bidirectional\"", 1))
}

/// An observer that stops a render after a given number of tiles.
pub struct Impatient {
    pub tiles: u32,
    pub done: AtomicU32,
}

impl Watch for Impatient {
    fn tile_done(&self, _: &Summary) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }
    fn interrupted(&self) -> bool {
        self.done.load(Ordering::Relaxed) >= self.tiles
    }
}

/// Tests that a resumed render repeats no work of an earlier run, loses no light, and counts no light twice.
#[test]
fn light_subpaths_survive_an_interruption() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = small();
    let [whole, parts] = ["whole", "parts"].map(|name| folder.path().join(name));
    let target = |path: &Path, resume| Target { path: path.to_owned(), resume, ..Target::default() };
    render(&scene, &target(&whole, false), &Unwatched).expect("a render");
    let first = render(&scene, &target(&parts, false), &Impatient { tiles: 7, done: AtomicU32::new(0) })
        .expect("a part");
    assert!(!first.complete && first.tiles_done >= 7, "{first:?}");
    assert!(render(&scene, &target(&parts, true), &Unwatched).expect("the rest").complete);
    assert_same_store(&whole, &parts);
}

fn lines(store: &Path) -> usize {
    std::fs::read(store.join(".sunstone-progress")).map_or(0, |b| b.iter().filter(|c| **c == b'\n').count())
}

/// Waits until a few tiles of the store are finished, then calls `stop`.
pub fn once_under_way(child: &mut Child, store: &Path, stop: impl FnOnce(&mut Child)) {
    let begun = Instant::now();
    while lines(store) < 5 {
        assert!(begun.elapsed() < Duration::from_mins(1), "no tile was finished in a minute");
        assert!(child.try_wait().expect("a child").is_none(), "the render ended before it could be stopped");
        std::thread::sleep(Duration::from_micros(500));
    }
    stop(child);
}

#[test]
#[ignore = "slow: tools/check --all"]
fn a_killed_render_resumes_to_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), text(48)).expect("a scene");
    let begin = ["render", "scene.toml", "--threads", "2", "-o", "killed.zarr"];
    let mut child = sunstone(at, &begin).stderr(Stdio::null()).spawn().expect("the program");
    let store = at.join("killed.zarr");
    once_under_way(&mut child, &store, |c| c.kill().expect("a kill"));
    assert_eq!(child.wait().expect("its end").code(), None, "it was killed");
    let done = lines(&store);
    assert!((5..TILES).contains(&done), "{done} tiles were finished");

    // The program must not restart the render by mistake, and must not mix the render with different slices
    // or settings.
    let refused = |more: &[&str]| {
        let arguments = [&["render", "scene.toml", "-o", "killed.zarr"], more].concat();
        stderr(&run(at, &arguments, 2))
    };
    assert!(refused(&[]).contains("--resume"));
    assert!(refused(&["--resume", "--spp", "64"]).contains("the two renders differ in samples_per_pixel"));
    assert!(refused(&["--resume", "--seed", "5"]).contains("the two renders differ in seeds"));
    assert!(refused(&["--resume", "--slices", "sum"]).contains("the two renders differ in list of slices"));
    assert_eq!(lines(&store), done, "what is refused changes nothing");

    run(at, &[&begin[..], &["--resume"]].concat(), 0);
    run(at, &["render", "scene.toml", "--threads", "1", "-o", "whole.zarr"], 0);
    assert_same_store(&store, &at.join("whole.zarr"));
}

#[test]
#[ignore = "slow: tools/check --all"]
fn an_interrupted_render_prints_how_to_resume() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = &folder.path().join("a folder's name");
    std::fs::create_dir(at).expect("a folder");
    std::fs::write(at.join("my scene.toml"), text(8)).expect("a scene");
    let begin = [
        "render",
        "my scene.toml",
        "--spp",
        "40",
        "--seed",
        "7",
        "--slices",
        "mueller,sum",
        "--threads",
        "2",
    ];
    let mut child = sunstone(at, &[&begin[..], &["-o", "stopped.zarr"]].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program");
    let store = at.join("stopped.zarr");
    once_under_way(&mut child, &store, |c| {
        let sent = std::process::Command::new("kill").args(["-INT", &c.id().to_string()]).status();
        assert!(sent.expect("kill").success());
    });
    let out = child.wait_with_output().expect("its end");
    let message = stderr(&out);
    assert_eq!(out.status.code(), Some(130), "{message}");
    assert!((5..TILES).contains(&lines(&store)));
    let command =
        message.lines().find_map(|l| l.strip_prefix("  sunstone ")).expect("a command to resume with");

    // Runs the command as a user would paste the command into a shell.
    let shell = std::process::Command::new("sh")
        .args(["-c", &format!("'{}' {command}", env!("CARGO_BIN_EXE_sunstone"))])
        .current_dir(at)
        .output()
        .expect("a shell");
    assert_eq!(shell.status.code(), Some(0), "{command}: {}", stderr(&shell));
    run(at, &[&begin[..], &["-o", "whole.zarr"]].concat(), 0);
    assert_same_store(&store, &at.join("whole.zarr"));
}
