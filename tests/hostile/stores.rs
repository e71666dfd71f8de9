//! Tests that no command returns a result with missing data if a file of a store is damaged.

use super::case::{Case, Expect, Put};

/// Commands that read the complete store `s.zarr`. The list excludes `info`, because `info` reads only
/// metadata.
#[rustfmt::skip]
const READERS: &[&str] = &[
    "verify s.zarr",
    "probe s.zarr mueller -o out.npy",
    "decompose s.zarr mueller -o out.npz",
    "capture s.zarr mueller --scheme {f}/drr36.toml -o out.npy",
    "export s.zarr mueller -o out.exr",
    "figure s.zarr --view photo --slice mueller -o out.png",
    "merge s.zarr {f}/t.zarr -o out.zarr",
    "denoise s.zarr {f}/t.zarr -o out.zarr",
];

/// Files of a store that all commands need.
const FILES: &[&str] = &[
    "s.zarr/zarr.json",
    "s.zarr/mueller/zarr.json",
    "s.zarr/mueller/mean/zarr.json",
    "s.zarr/mueller/mean/c.0.0.0.0.0",
    "s.zarr/manifest.txt",
];

pub fn cases() -> Vec<Case> {
    let mut cases = vec![];
    for line in READERS {
        for file in FILES {
            let edits = [
                ("gone", Put::Gone),
                ("empty", Put::Bytes(vec![])),
                ("a pipe", Put::Fifo),
                ("a folder", Put::Folder),
                ("/dev/zero", Put::Link("/dev/zero")),
                ("a link to nothing", Put::Link("nothing")),
                ("something else", Put::Bytes(b"not what was written".to_vec())),
                ("a tebibyte", Put::Sparse(1 << 40)),
            ];
            for (what, put) in edits {
                let case =
                    Case::new(format!("{line}: {file} is {what}"), line).put("s.zarr", Put::Copy("s.zarr"));
                let case = case.put(*file, Put::Gone).put(*file, put);
                // For a finished store, `verify` reports the damage with a separate exit code.
                let damaged = line.starts_with("verify") && *file != "s.zarr/manifest.txt";
                cases.push(if damaged { case.expect(Expect::Failed) } else { case });
            }
        }
    }
    cases
}
