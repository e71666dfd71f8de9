//! Replaces every file that a command or scene reads. Each replacement is a missing, empty, endless,
//! truncated or different file, a folder, or a pipe.

use super::case::{Case, Expect, Put};
use super::fixtures::SMALL;

/// For each reader, the command with `{x}` in place of the damaged file, the name of the damaged file, and
/// the valid fixture file.
#[rustfmt::skip]
pub const READERS: &[(&str, &str, &str)] = &[
    ("render {x} -o out.zarr", "x.toml", "scene.toml"),
    ("info {x}", "x.toml", "scene.toml"),
    ("project {x} {f}/points.csv", "x.toml", "scene.toml"),
    ("project {f}/scene.toml {x}", "x.csv", "points.csv"),
    ("export {x} --mitsuba out", "x.toml", "scene.toml"),
    ("import {x} -o out.toml", "x.xml", "mitsuba/scene.xml"),
    ("import {x} -o out.toml", "x.yaml", "calibration.yaml"),
    ("import {x} -o out.toml", "x.json", "calibration.yaml"),
    ("import {x} -o out.toml", "x.npz", "M.npy"),
    ("verify {x}", "x.zarr", "M.npy"),
    ("probe {x} mueller -o out.npy", "x.zarr", "M.npy"),
    ("figure {x} -o out", "x.zarr", "M.npy"),
    ("figure {x} --preview --renders renders -o out.png", "x.toml", "figure.toml"),
    ("apply metamerism --preview --seeds 1 --scenes {f}/scenes --renders renders -o out --capture {x}", "x.toml", "chain.toml"),
    ("layers {x} -o out.npz", "x.toml", "scene.toml"),
    ("merge {x} {f}/t.zarr -o out.zarr", "x.zarr", "M.npy"),
    ("denoise {x} -o out.zarr", "x.zarr", "M.npy"),
    ("denoise {f}/s.zarr {x} -o out.zarr", "x.zarr", "M.npy"),
    ("export {x} mueller -o out.exr", "x.zarr", "M.npy"),
    ("probe {f}/s.zarr mueller --pattern {x} -o out.npy", "x.png", "mask.png"),
    ("decompose {x} -o out.npz", "x.npy", "M.npy"),
    ("decompose {f}/M.npy --errors {x} -o out.npz", "x.npy", "E.npy"),
    ("capture {x} --scheme {f}/drr36.toml -o out.npy", "x.npy", "M.npy"),
    ("capture {f}/M.npy --scheme {x} -o out.npy", "x.toml", "drr36.toml"),
    ("capture {f}/M.npy --scheme {x} -o out.npy", "x.csv", "points.csv"),
    ("capture {f}/M.npy --scheme {f}/drr36.toml --detector {x} -o out.npy", "x.toml", "camera.toml"),
    ("reconstruct {x} --scheme {f}/drr36.toml -o out.npy", "x.npy", "I.npy"),
    ("reconstruct {f}/I.npy --scheme {x} -o out.npy", "x.toml", "drr36.toml"),
    ("reconstruct {f}/I.npy --scheme {f}/drr36.toml --variance {x} -o out.npy", "x.npy", "V.npy"),
    ("reconstruct {f}/I.npy --scheme {f}/drr36.toml --noise 0.1 --prior {x} -o out.npy", "x.toml", "prior.toml"),
    ("trial {x} --scheme {f}/drr36.toml -o out.csv", "x.npy", "M.npy"),
    ("trial {f}/M.npy --scheme {x} -o out.csv", "x.toml", "drr36.toml"),
    ("trial {f}/M.npy --scheme {f}/drr36.toml --detector {x} -o out.csv", "x.toml", "camera.toml"),
    ("trial {f}/M.npy --scheme {f}/drr36.toml --noise 0.1 --prior {x} -o out.csv", "x.toml", "prior.toml"),
    ("rig run {x} -o out.zarr", "x.toml", "plan.toml"),
    ("rig run {f}/plan.toml --rig {x} -o out.zarr", "x.toml", "rig.toml"),
    ("rig check {x}", "x.toml", "plan.toml"),
    ("rig status {x}", "x.zarr", "M.npy"),
    ("rig flash {x} -o out", "x.toml", "plan.toml"),
    ("rig calibrate {x} -o out.toml", "x.zarr", "M.npy"),
    ("reconstruct {x} -o out.zarr", "x.zarr", "M.npy"),
    ("reconstruct {f}/night.zarr --scheme {x} -o out.zarr", "x.toml", "drr36.toml"),
    ("ptu info {x}", "x.ptu", "photons.ptu"),
    ("ptu records {x}", "x.ptu", "photons.ptu"),
    ("ptu histogram {x} -o out.npy", "x.ptu", "photons.ptu"),
    ("ptu write {x} -o out.ptu --record timeharp-260-p-t3 --period-ps 100000", "x.csv", "events.csv"),
    ("calibrate board {x} --columns 4 --rows 3 --square 25mm -o out.toml", "x.png", "image.png"),
    ("calibrate board {x} --columns 4 --rows 3 --square 25mm -o out.toml", "x.npy", "M.npy"),
    ("calibrate counter {x} --distance 1 -o out.toml", "x.zarr", "M.npy"),
    ("calibrate sensor {x} -o out.toml", "x.zarr", "M.npy"),
    ("calibrate projector {x} --columns 4 --rows 3 --square 25mm --projector 6x4 -o out.toml", "x", "image.png"),
    ("scheme show {x}", "x.toml", "drr36.toml"),
    ("scheme matrix {x} -o out.npy", "x.toml", "drr36.toml"),
    ("scheme plot {x} -o out.png", "x.toml", "drr36.toml"),
    ("learn --template {x} --starts 1 --iterations 1 --adam-steps 1 -o out.toml", "x.toml", "drr36.toml"),
    ("learn -k 9 --data {x} --folds 0 --starts 1 --iterations 1 --adam-steps 1 -o out.toml", "x", "table.pbsdf"),
    ("pbrdf eval {x} --in 40,0 --out 20,120", "x.toml", "materials.toml"),
    ("pbrdf eval {f}/materials.toml --directions {x}", "x.csv", "directions.csv"),
    ("pbrdf sheet {x} -o out.png --size 8 --spp 1", "x.toml", "materials.toml"),
    ("pbrdf synth {x} -o out --resolution 3x3x3", "x.toml", "materials.toml"),
    ("pbrdf info {x}", "x.pbsdf", "table.pbsdf"),
    ("pbrdf plot {x} -o out.png", "x.pbsdf", "table.pbsdf"),
    ("pbrdf slice {x} -o out.npy", "x.pbsdf", "table.pbsdf"),
    ("pbrdf pca --data {x} -o out.png --bands 550", "x", "table.pbsdf"),
    ("phase eval {x}", "x.toml", "media.toml"),
];

/// Files to which a scene refers. Each entry has a passage of the scene, the replacement of the passage, the
/// file name, and the valid file.
#[rustfmt::skip]
const NAMED: &[(&str, &str, &str, &str)] = &[
    ("[0.7, 0.7, 0.7]", "{ image = \"x.png\" }", "x.png", "image.png"),
    ("[0.7, 0.7, 0.7]", "{ image = \"x.jpg\" }", "x.jpg", "image.png"),
    ("white.diffuse.albedo = [0.7, 0.7, 0.7]", "white.measured = { file = \"x.pbsdf\" }", "x.pbsdf", "table.pbsdf"),
    ("rectangle = { corner = [-1, 0, -1], u = [2, 0, 0], v = [0, 2, 0] }", "obj = { file = \"x.obj\" }", "x.obj", "shape.obj"),
    ("rectangle = { corner = [-1, 0, -1], u = [2, 0, 0], v = [0, 2, 0] }", "ply = { file = \"x.ply\" }", "x.ply", "shape.ply"),
    ("rectangle = { corner = [-1, 0, -1], u = [2, 0, 0], v = [0, 2, 0] }", "gltf = { file = \"x.gltf\" }", "x.gltf", "shape.gltf"),
    ("rectangle = { corner = [-1, 0, -1], u = [2, 0, 0], v = [0, 2, 0] }", "gltf = { file = \"x.glb\" }", "x.glb", "shape.bin"),
    ("polarization = \"mueller\"", "projector = { mask = \"x.png\" }", "x.png", "mask.png"),
];

/// Damaged files that are still valid.
#[rustfmt::skip]
const ACCEPTED: &[&str] = &[
    "project {f}/scene.toml {x}: x.csv is empty",
    "pbrdf eval {f}/materials.toml --directions {x}: x.csv is empty",
    "pbrdf eval {f}/materials.toml --directions {x}: x.csv is cut short",
    "a scene's { image = \"x.png\" } is a picture",
    "a scene's { image = \"x.jpg\" } is a picture",
];

/// Returns named replacements of the valid fixture file `right`.
fn damaged(right: &'static str) -> Vec<(&'static str, Put)> {
    vec![
        ("missing", Put::Gone),
        ("empty", Put::Bytes(vec![])),
        ("a folder", Put::Folder),
        ("a pipe", Put::Fifo),
        ("/dev/zero", Put::Link("/dev/zero")),
        ("/dev/random", Put::Link("/dev/random")),
        ("a link to nothing", Put::Link("nothing")),
        ("a link to itself", Put::Link("x")),
        ("cut short", Put::Half(right)),
        ("a picture", Put::Copy("mask8.png")),
        ("no text", Put::Bytes((0..=255).cycle().take(5000).collect())),
        ("one long line", Put::Text("[1, 2".repeat(400_000))),
        ("a tebibyte", Put::Sparse(1 << 40)),
    ]
}

pub fn cases() -> Vec<Case> {
    let mut cases = vec![];
    let mut add = |case: Case, file: &str, put: Put| {
        let case = case.put(file, put);
        let accepted = ACCEPTED.contains(&case.name.as_str());
        cases.push(if accepted { case.expect(Expect::Accepted) } else { case });
    };
    for (line, file, right) in READERS {
        for (what, put) in damaged(right) {
            add(Case::new(format!("{line}: {file} is {what}"), &line.replace("{x}", file)), file, put);
        }
    }
    for (from, to, file, right) in NAMED {
        for (what, put) in damaged(right) {
            let text = SMALL.replacen(from, to, 1);
            assert!(text != SMALL, "{from}");
            let case = Case::new(format!("a scene's {to} is {what}"), "render scene.toml -o out.zarr");
            add(case.put("scene.toml", Put::Text(text)), file, put);
        }
    }
    cases
}
