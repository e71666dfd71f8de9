//! Files and folders without read or write permission. If the user is root, the user `nobody` runs the
//! program, if possible.

use crate::case::{Case, Expect, Put, is_root};
use std::process::{Command, Stdio};

/// Commands that read a file without read permission.
#[rustfmt::skip]
const READERS: &[(&str, &str)] = &[
    ("render x.toml -o out.zarr", "x.toml"),
    ("info x.toml", "x.toml"),
    ("export x.toml --mitsuba out", "x.toml"),
    ("import x.xml -o out.toml", "x.xml"),
    ("import x.yaml -o out.toml", "x.yaml"),
    ("verify x.zarr", "x.zarr"),
    ("probe x.zarr mueller -o out.npy", "x.zarr"),
    ("denoise x.zarr -o out.zarr", "x.zarr"),
    ("probe {f}/s.zarr lit --pattern x.png -o out.npy", "x.png"),
    ("decompose x.npy -o out.npz", "x.npy"),
    ("reconstruct x.npy --scheme {f}/drr36.toml -o out.npy", "x.npy"),
    ("scheme show x.toml", "x.toml"),
    ("capture {f}/M.npy --scheme {f}/drr36.toml --detector x.toml -o out.npy", "x.toml"),
    ("pbrdf info x.pbsdf", "x.pbsdf"),
    ("pbrdf eval {f}/materials.toml --directions x.csv", "x.csv"),
    ("phase eval x.toml", "x.toml"),
    ("figure x.toml --preview --renders renders -o out.png", "x.toml"),
    ("apply metamerism --preview --scenes {f}/scenes --renders renders -o out --capture x.toml", "x.toml"),
];

/// Commands that write into a folder without write permission.
#[rustfmt::skip]
const WRITERS: &[&str] = &[
    "render {f}/scene.toml -o d/out.zarr --no-figures",
    "merge {f}/s.zarr {f}/t.zarr -o d/out.zarr",
    "denoise {f}/s.zarr -o d/out.zarr",
    "probe {f}/s.zarr mueller -o d/out.npy",
    "probe {f}/s.zarr mueller -o d/out.csv",
    "probe {f}/s.zarr mueller -o d/out.zarr",
    "figure {f}/s.zarr -o d",
    "figure {f}/s.zarr --view photo --slice mueller -o d/out.png",
    "export {f}/s.zarr mueller -o d/out.exr",
    "export {f}/scene.toml --mitsuba d/out",
    "import {f}/calibration.yaml -o d/out.toml",
    "import {f}/mitsuba/scene.xml -o d/out.toml",
    "decompose {f}/M.npy -o d/out.npz",
    "capture {f}/M.npy --scheme {f}/drr36.toml -o d/out.npy",
    "reconstruct {f}/I.npy --scheme {f}/drr36.toml -o d/out.npy",
    "trial {f}/M.npy --scheme {f}/drr36.toml -o d/out.csv",
    "scheme drr -k 16 -o d/out.toml",
    "scheme matrix {f}/drr36.toml -o d/out.npy",
    "scheme plot {f}/drr36.toml -o d/out.png",
    "pbrdf sheet {f}/materials.toml -o d/out.png --size 8 --spp 1",
    "pbrdf synth {f}/materials.toml -o d/out --resolution 3x3x3 --bands 550",
    "pbrdf plot {f}/table.pbsdf -o d/out.png",
    "pbrdf slice {f}/table.pbsdf -o d/out.npy",
    "pbrdf pca --data {f}/tables --bands 550 -o d/out.png",
    "phase eval {f}/media.toml -o d/out.csv",
    "figure {f}/figure.toml --preview --renders d/renders -o d/out.png",
    "apply metamerism --preview --seeds 1 --scenes {f}/scenes --renders d/renders -o d/out",
];

/// Whether the program can run as a user without root's rights.
fn possible() -> bool {
    let nobody = || {
        Command::new("setpriv")
            .args(["--reuid=65534", "--regid=65534", "--clear-groups"])
            .args([env!("CARGO_BIN_EXE_sunstone"), "--version"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
    };
    !is_root() || nobody().is_ok_and(|s| s.success())
}

pub fn cases() -> Vec<Case> {
    if !possible() {
        println!("nobody cannot run the program: no cases of permissions");
        return vec![];
    }
    let mut cases = vec![];
    for (line, file) in READERS {
        let put = if file.ends_with(".zarr") { Put::Folder } else { Put::Text("x".into()) };
        let mut case = Case::new(format!("not to be read: {line}"), line).put(*file, put);
        (case.mode, case.says) = (Some(0), "ermission");
        cases.push(case);
    }
    for line in WRITERS {
        let mut case = Case::new(format!("not to be written: {line}"), line).put("d", Put::Folder);
        (case.mode, case.says) = (Some(0o555), "ermission denied");
        cases.push(case.expect(Expect::Failed));
    }
    cases
}
