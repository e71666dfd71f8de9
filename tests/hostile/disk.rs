//! Tests that, on a full disk, the program exits with code 1 and prints the file and the reason. Tests that
//! the program leaves no output that can be read as finished.

use super::case::{Case, Expect, Put};
use super::fixtures::SMALL;

/// Commands whose output is larger than the smallest limit, each with the store that the command writes, if
/// any.
#[rustfmt::skip]
const WRITERS: &[(&str, Option<&str>)] = &[
    ("render scene.toml -o out.zarr --no-figures", Some("out.zarr")),
    ("merge {f}/s.zarr {f}/t.zarr -o out.zarr", Some("out.zarr")),
    ("denoise {f}/s.zarr {f}/t.zarr -o out.zarr", Some("out.zarr")),
    ("probe {f}/s.zarr mueller -o out.zarr", Some("out.zarr")),
    ("probe {f}/s.zarr mueller -o out.npy", None),
    ("probe {f}/s.zarr mueller -o out.csv", None),
    ("figure {f}/s.zarr --view photo --slice mueller -o out.png", None),
    ("figure {f}/s.zarr --view mueller --slice mueller -o out.pdf", None),
    ("figure {f}/s.zarr -o out", None),
    ("figure {f}/figure.toml --preview --renders renders -o out.png", None),
    ("export {f}/s.zarr mueller --mueller -o out.exr", None),
    ("export {f}/scene.toml --mitsuba out --wavelength 550", None),
    ("decompose {f}/s.zarr mueller -o out.npz", None),
    ("capture {f}/s.zarr mueller --scheme {f}/drr36.toml -o out.npy", None),
    ("reconstruct {f}/I.npy --scheme {f}/drr36.toml -o out.npy --errors e.npy", None),
    ("scheme drr -k 360 -o out.toml", None),
    ("scheme matrix {f}/drr36.toml -o out.npy", None),
    ("scheme plot {f}/drr36.toml -o out.png", None),
    ("pbrdf sheet {f}/materials.toml -o out.png --size 8 --spp 1", None),
    ("pbrdf synth {f}/materials.toml -o out --resolution 9x9x9 --bands 550", None),
    ("pbrdf plot {f}/table.pbsdf -o out.png", None),
    ("pbrdf slice {f}/table.pbsdf -o out.npy", None),
    ("pbrdf slice {f}/table.pbsdf -o out.csv", None),
    ("pbrdf pca --data {f}/tables --bands 550 -o out.png", None),
    ("phase eval {f}/media.toml -o out.csv", None),
];

pub fn cases() -> Vec<Case> {
    let mut cases = vec![];
    for (line, store) in WRITERS {
        for blocks in [1, 2, 3] {
            let case = Case::new(format!("{line}: a disk with room for {blocks} blocks"), line);
            let mut case = case
                .put("scene.toml", Put::Text(SMALL.replace("[4, 4]", "[16, 16]")))
                .expect(Expect::Failed)
                .says("File too large");
            case.limit = Some(blocks);
            if line.contains("--renders") {
                case.may_leave = &["renders"];
            }
            if let Some(store) = store {
                case.verify = Some(store);
                // The program keeps an unfinished render, so that the user can resume the render.
                case.may_leave = &["out.zarr", ".out.zarr"];
            }
            cases.push(case);
        }
    }
    cases
}
