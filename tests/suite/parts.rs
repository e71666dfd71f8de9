//! Tests that the merged parts of a render equal the whole render byte for byte, for any division.

use crate::harness::{assert_same_store, mirror_room, run, scene, stderr, stdout, sunstone};
use crate::resume::once_under_way;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use sunstone::optics::sampling::stream::Stream;
use sunstone::render::{Part, Render, Target, Unwatched, render};
use sunstone::store::merge::{Options, merge};
use sunstone::store::zarr::{TensorStore, verify};
use sunstone::tensor::field::Field;
use sunstone::transport::scene::Scene;

/// Slices for these tests. The slices have time bins, an epipolar band, labels, camera bins, and a block. The
/// block does not begin with a tile, so its chunks cover four tiles.
const SLICES: &str = r#"
[[slices]]
name = "sum"
[[slices]]
name = "mueller"
camera = { binned = 2 }
polarization = "mueller"
[[slices]]
name = "flight"
camera = { rows = [3, 11] }
projector = { binned = 8 }
time = { start_ps = 10000, bin_ps = 500, bins = 24 }
[[slices]]
name = "block"
camera = { block = [2, 3, 11, 7] }
polarization = "mueller"
[[slices]]
name = "epipolar"
projector = { epipolar = { half_width_px = 1.0 } }
bounces = true
split_first_bounce = true
[[slices]]
name = "labels"
labels = true
"#;

const SHARES: [Part; 3] = [share(1, 3), share(2, 3), share(3, 3)];

const fn share(number: u32, of: u32) -> Part {
    Part::Share { number, of }
}

fn room(integrator: &str) -> String {
    let text = mirror_room(24, 16, 4, 4, SLICES);
    text.replacen("[render]", &format!("[render]\nintegrator = \"{integrator}\""), 1)
}

fn part(scene: &Scene, part: Part, path: &Path) {
    let summary = Render::new(scene).part(part).to_store(path).expect("a part");
    assert!(summary.complete, "{summary:?}");
}

fn whole(scene: &Scene, path: &Path) {
    let target = Target { path: path.to_owned(), ..Target::default() };
    assert!(render(scene, &target, &Unwatched).expect("a render").complete);
}

/// Divides all tiles into `of` parts, either into equal shares or into random ranges. Returns the parts.
fn cuts(tiles: u32, stream: &mut Stream) -> Vec<Part> {
    let mut upto = |n: u32| (stream.uniform() * n as f32) as u32;
    if upto(2) == 0 {
        let of = 2 + upto(5);
        return (1..=of).map(|number| share(number, of)).collect();
    }
    let mut cuts = vec![];
    let mut first = 0;
    while first < tiles {
        let last = (first + upto(tiles / 2 + 1)).min(tiles - 1);
        cuts.push(Part::Tiles { first, last });
        first = last + 1;
    }
    cuts
}

/// Divides a scene at random `times` times, and merges the parts in reverse order. Asserts that the result
/// equals the whole render.
fn assert_parts_equal_the_whole(scene: &Scene, seed: u64, times: u32) {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    whole(scene, &at("whole"));
    let ([w, h], tile) = (scene.camera.resolution, scene.settings.tile);
    let tiles = w.div_ceil(tile) * h.div_ceil(tile);
    let mut stream = Stream::new(seed, 0, 0);
    for time in 0..times {
        let mut paths: Vec<PathBuf> = vec![];
        for (n, cut) in cuts(tiles, &mut stream).into_iter().enumerate() {
            paths.push(at(&format!("{time}-{n}")));
            part(scene, cut, &paths[n]);
        }
        paths.reverse();
        let joined = at(&format!("{time}"));
        merge(&paths, &joined, Options::default()).unwrap_or_else(|e| panic!("{e}"));
        assert_same_store(&at("whole"), &joined);
        assert!(verify(&joined).expect("a store").faults.is_empty());
    }
}

/// Tests merged parts with each integrator, and with shipped scenes of media, crystals and a ball of 412
/// mirrors.
#[test]
#[ignore = "slow: tools/check --all"]
fn merged_parts_equal_the_whole() {
    for (seed, integrator) in (1..).zip(["path", "caustics", "bidirectional"]) {
        assert_parts_equal_the_whole(&scene(&room(integrator)), seed, 3);
    }
    for (seed, name) in (10..).zip(["milky_tank", "crystals", "disco_ball"]) {
        assert_parts_equal_the_whole(&small(name), seed, 1);
    }
}

/// Returns the checksums of all files of a part except the metadata of the store's root, which contain the
/// render time.
fn values(part: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(part.join("part.txt")).expect("a manifest");
    let lines = text.lines().filter(|line| !line.ends_with(" zarr.json") && !line.ends_with(" lines above"));
    lines.map(str::to_owned).collect()
}

/// Tests parts that share light subpaths, in parallel or one after another. The bytes must be identical, and
/// each subpath must be traced once.
#[test]
#[ignore = "slow: tools/check --all"]
fn shared_light_subpaths_give_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    for (integrator, of) in [("bidirectional", 3), ("caustics", 4)] {
        let scene = scene(&room(integrator));
        let name = |what: &str| at(&format!("{integrator}-{what}"));
        whole(&scene, &name("whole"));
        let light = name("light");
        let paths: Vec<PathBuf> = (1..=of).map(|n| name(&n.to_string())).collect();
        let one = |n: u32, path: &Path| {
            let render = Render::new(&scene).part(share(n, of)).shared_light(&light);
            assert!(render.to_store(path).expect("a part").complete);
        };
        std::thread::scope(|scope| {
            for (n, path) in (1..).zip(&paths) {
                scope.spawn(move || one(n, path));
            }
        });
        merge(&paths, &name("joined"), Options::default()).expect("all parts");
        assert_same_store(&name("whole"), &name("joined"));
        let made: Vec<String> = std::fs::read_dir(&light)
            .expect("a folder")
            .map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned())
            .filter(|n| n.ends_with(".light"))
            .collect();
        assert_eq!(made.len(), of as usize, "{made:?}");
        let share_of = |n: u32| made.iter().find(|name| name.ends_with(&format!("-{n}of{of}.light")));
        let file = |n: u32| light.join(share_of(n).expect("a share"));
        // Negative control: a share with another seed changes the result. The program therefore reads the
        // light of the share and does not trace this light again.
        let first = std::fs::read(file(1)).expect("a share");
        let mut other = crate::harness::scene(&room(integrator));
        other.change_settings(|s| s.seed += 1);
        let foreign = name("foreign");
        let render = Render::new(&other).part(share(1, of)).shared_light(&foreign);
        render.to_store(&name("other")).expect("a part");
        let found = std::fs::read_dir(&foreign).expect("a folder").map(|e| e.expect("an entry").path());
        let foreign = found.filter(|p| p.to_string_lossy().ends_with(&format!("-1of{of}.light")));
        std::fs::copy(foreign.last().expect("a share"), file(1)).expect("a copy");
        let planted = name("planted");
        one(2, &planted);
        assert_ne!(values(&planted), values(&paths[1]));
        // The program traces a missing share again, and does not use a damaged share.
        std::fs::remove_file(file(1)).expect("a share");
        let again = name("again");
        one(2, &again);
        assert_eq!(std::fs::read(file(1)).expect("a share"), first);
        let mut damaged = first.clone();
        damaged[first.len() / 3] ^= 16;
        for damaged in [&damaged[..], &first[..first.len() - 5], &[]] {
            std::fs::write(file(1), damaged).expect("a file");
            let fixed = name("fixed");
            let _ = std::fs::remove_dir_all(&fixed);
            one(2, &fixed);
            for store in [&fixed, &again] {
                assert_eq!(values(store), values(&paths[1]));
            }
        }
    }
}

/// Returns a shipped scene with 20 × 20 pixels, in tiles of 4 × 4 pixels. The scene has two samples per pixel
/// and the slices of these tests.
fn small(name: &str) -> Scene {
    let path =
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(format!("scenes/{name}/scene.toml"));
    let text = std::fs::read_to_string(&path).expect("a shipped scene");
    let text = &text[..text.find("[[slices]]").expect("slices")];
    let text = text.replace("resolution = [128, 128]", "resolution = [20, 20]").replacen(
        "spp = 128",
        "spp = 2\ntile = 4",
        1,
    );
    sunstone::scene::from_text(&path, &(text + SLICES)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// Tests that the program reports the store of a part as a part. Tests that no command accepts a part as a
/// finished render.
#[test]
fn a_part_is_not_a_finished_render() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), room("path")).expect("a scene");
    let message = stdout(&run(at, &["render", "scene.toml", "--part", "2/3", "-o", "p2"], 0));
    assert!(message.contains("part 2 of 3, 12 tiles"), "{message}");
    let info = stdout(&run(at, &["info", "p2"], 0));
    assert!(info.contains("part 2 of 3 of a render") && info.contains("complete part"), "{info}");
    assert!(!info.contains("Σ"), "{info}");
    let checked = stdout(&run(at, &["verify", "p2"], 0));
    assert!(checked.contains("part 2 of 3 of a render"), "{checked}");
    for command in [
        &["probe", "p2", "sum", "-o", "sum.npy"][..],
        &["export", "p2", "mueller", "-o", "m.exr"],
        &["decompose", "p2", "mueller", "-o", "m.npz"],
        &["denoise", "p2", "-o", "d.zarr"],
    ] {
        let text = stderr(&run(at, command, 2));
        assert!(text.contains("part 2 of 3") && text.contains("sunstone merge"), "{command:?}: {text}");
    }
    let store = TensorStore::open(&at.join("p2")).expect("a store");
    assert!(!store.is_finished() && store.part() == Some(share(2, 3)));
    // Commands can read the finished pixels. Pixels of the remaining parts are NaN, not zero.
    run(at, &["probe", "p2", "sum", "--partial", "-o", "sum.npy"], 0);
    let partial = TensorStore::open_partial(&at.join("p2")).expect("a store");
    let sum = partial.slice("sum").expect("a slice").read_all(Field::Mean).expect("values");
    let missing = sum.data.iter().filter(|v| v.is_nan()).count();
    assert_eq!(missing, sum.data.len() / 3 * 2);
    // A merge refuses a part that lacks a byte.
    for number in [1, 3] {
        let option = format!("{number}/3");
        run(at, &["render", "scene.toml", "--part", &option, "-o", &format!("p{number}")], 0);
    }
    let chunk = at.join("p2/sum/mean/c.0.1.0");
    let mut bytes = std::fs::read(&chunk).expect("a chunk of the second tile");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(&chunk, &bytes).expect("a file");
    let text = stderr(&run(at, &["merge", "p1", "p2", "p3", "-o", "all"], 2));
    assert!(text.contains("p2/sum/mean"), "{text}");
    assert!(!at.join("all").exists());
}

/// Tests that a merge requires all parts of one render, each exactly once.
#[test]
fn wrong_sets_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let mut scene = scene(&room("path"));
    for (n, one) in (1..).zip(SHARES) {
        part(&scene, one, &at(&format!("p{n}")));
    }
    part(&scene, share(1, 2), &at("half"));
    part(&scene, Part::Tiles { first: 0, last: 3 }, &at("first"));
    part(&scene, Part::Tiles { first: 6, last: 35 }, &at("last"));
    whole(&scene, &at("whole"));
    scene.change_settings(|s| s.seed += 1);
    part(&scene, SHARES[1], &at("seed"));
    whole(&scene, &at("other"));
    scene.change_settings(|s| (s.seed, s.spp) = (s.seed - 1, 8));
    part(&scene, SHARES[1], &at("spp"));
    let refused = |names: &[&str], words: &[&str]| {
        let paths: Vec<PathBuf> = names.iter().map(|name| at(name)).collect();
        let text = match merge(&paths, &at("joined"), Options::default()) {
            Ok(()) => panic!("{names:?} were joined"),
            Err(e) => e.to_string(),
        };
        for word in words {
            assert!(text.contains(word), "{names:?}: {text}");
        }
        assert!(!at("joined").exists());
    };
    refused(&["p1", "p3"], &["part 2 of 3 is missing", "--part 2/3"]);
    refused(&["p3"], &["parts 1 and 2 of 3 are missing"]);
    refused(&["first", "last"], &["tiles 4 to 5 are missing", "--tiles 4-5"]);
    refused(&["p1", "p2", "p3", "first"], &["both contain tile", "pass only one of the two parts"]);
    refused(&["p1", "half"], &["both contain tile 0"]);
    // Negative control: one part has a different seed or a different number of samples.
    refused(&["p1", "seed", "p3"], &["different renders", "`seeds` differs"]);
    refused(&["p1", "p2", "seed", "p3"], &["`seeds` differs"]);
    refused(&["p1", "spp", "p3"], &["per_pixel` differs"]);
    refused(&["p1", "p2", "p3", "other"], &["part 1 of 3", "is a whole render"]);
    refused(&["other", "p1"], &["is a whole render"]);
    // Two equal copies of a part count once.
    scene.change_settings(|s| s.spp = 4);
    part(&scene, SHARES[1], &at("twin"));
    merge(&["p1", "twin", "p2", "p3"].map(at), &at("joined"), Options::default()).expect("all parts");
    assert_same_store(&at("whole"), &at("joined"));
    let partial = Options { partial: true, ..Options::default() };
    let text = merge(&SHARES.map(|_| at("p1")), &at("no"), partial).map_err(|e| e.to_string());
    assert!(text.expect_err("refused").contains("--partial"));
    // Negative control: one number differs between two copies of a part.
    std::fs::remove_dir_all(at("joined")).expect("a folder");
    let twin = TensorStore::open_for_write(&at("twin")).expect("a store");
    let sum = twin.slice("sum").expect("a slice");
    sum.write(Field::Mean, &[0, 5, 1], &[1, 1, 1], &[7.0]).expect("a number");
    twin.finish().expect("a part");
    refused(&["p1", "twin", "p2", "p3"], &["both part 2 of 3", "sum/mean/c.0.1.0"]);
    // Negative control: a part contains a number in a tile of another part.
    sum.write(Field::Mean, &[0, 0, 1], &[1, 1, 1], &[7.0]).expect("a number");
    twin.finish().expect("a part");
    refused(&["p1", "twin", "p3"], &["also have values in another part"]);
}

/// Tests that the merged parts equal the whole render if there are more parts than tiles. Some of the parts
/// are empty but valid.
#[test]
#[ignore = "slow: tools/check --all"]
fn more_parts_than_tiles_merge_to_the_whole() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let scene = scene(&mirror_room(8, 8, 2, 4, "[[slices]]\nname = \"sum\"\n[[slices]]\nname = \"two\""));
    whole(&scene, &at("whole"));
    let paths: Vec<PathBuf> = (1..=6).map(|n| at(&n.to_string())).collect();
    for (number, path) in (1..).zip(&paths) {
        part(&scene, share(number, 6), path);
    }
    merge(&paths, &at("joined"), Options::default()).expect("all parts");
    assert_same_store(&at("whole"), &at("joined"));
}

/// Tests that a part whose process was killed can be resumed as the same part, but not as another part.
#[test]
#[ignore = "slow: tools/check --all"]
fn a_killed_part_resumes_to_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let text = mirror_room(64, 32, 48, 4, "[[slices]]\nname = \"sum\"\npolarization = \"mueller\"");
    std::fs::write(at.join("scene.toml"), text).expect("a scene");
    let begin = ["render", "scene.toml", "--threads", "2", "--part", "1/2", "-o", "1"];
    let mut child = sunstone(at, &begin).stderr(Stdio::null()).spawn().expect("the program");
    once_under_way(&mut child, &at.join("1"), |c| c.kill().expect("a kill"));
    child.wait().expect("its end");
    run(at, &["render", "scene.toml", "--part", "2/2", "-o", "2"], 0);
    let text = stderr(&run(at, &["merge", "1", "2", "-o", "all"], 2));
    assert!(text.contains("part 1 of 2") && text.contains("not finished"), "{text}");
    for other in [&["--part", "2/2"][..], &["--tiles", "0-9"], &[]] {
        let arguments = [&["render", "scene.toml", "-o", "1", "--resume"], other].concat();
        assert!(stderr(&run(at, &arguments, 2)).contains("the two renders differ in part"));
    }
    run(at, &[&begin[..], &["--resume"]].concat(), 0);
    let again = run(at, &[&begin[..], &["--resume"]].concat(), 0);
    assert!(stdout(&again).contains("already complete"));
    run(at, &["merge", "1", "2", "-o", "all"], 0);
    run(at, &["render", "scene.toml", "-o", "whole"], 0);
    assert_same_store(&at.join("whole"), &at.join("all"));
}

#[test]
fn invalid_options_are_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), room("path")).expect("a scene");
    for (option, value, words) in [
        ("--part", "0/8", "part 0/8 does not exist"),
        ("--part", "9/8", "part 9/8 does not exist"),
        ("--part", "3", "expected K/N"),
        ("--part", "3/8/9", "expected K/N"),
        ("--part", "-1/8", "expected K/N"),
        ("--tiles", "5-4", "lower number first"),
        ("--tiles", "x", "expected A-B"),
        ("--tiles", "0-36", "tiles 0 to 35"),
    ] {
        let option = format!("{option}={value}");
        let text = stderr(&run(at, &["render", "scene.toml", "-o", "p", &option], 2));
        assert!(text.contains(words), "{option}: {text}");
        assert!(!at.join("p").exists());
    }
    run(at, &["render", "scene.toml", "-o", "p", "--part", "1/2", "--tiles", "1-2"], 2);
}
