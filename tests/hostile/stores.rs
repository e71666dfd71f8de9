//! Stores whose files are missing, pipes, devices, truncated or different. No command may answer with missing
//! data.

use crate::case::{Case, Expect, Put};

/// Commands that read the whole store `s.zarr`, except `info`, which reads less.
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
const FILES: &[&str] =
    &["zarr.json", "mueller/zarr.json", "mueller/mean/zarr.json", "mueller/mean/c.0.0.0.0.0", "manifest.txt"];

pub fn cases() -> Vec<Case> {
    let mut cases = vec![];
    for line in READERS {
        for file in FILES {
            let spoilt = [
                ("gone", None),
                ("empty", Some(Put::Bytes(vec![]))),
                ("a pipe", Some(Put::Fifo)),
                ("a folder", Some(Put::Folder)),
                ("/dev/zero", Some(Put::Link("/dev/zero"))),
                ("a link to nothing", Some(Put::Link("nothing"))),
                ("something else", Some(Put::Bytes(b"not what was written".to_vec()))),
                ("a tebibyte", Some(Put::Sparse(1 << 40))),
            ];
            for (what, put) in spoilt {
                let name = format!("s.zarr/{file}");
                let case = Case::new(format!("{line}: {file} is {what}"), line);
                // For a finished store, verify reports the damage, with a separate exit code.
                let case = if line.starts_with("verify") && *file != "manifest.txt" {
                    case.expect(Expect::Failed)
                } else {
                    case
                };
                let case = case.put("s.zarr", Put::Copy("s.zarr")).put(name.clone(), Put::Gone);
                cases.push(match put {
                    Some(put) => case.put(name, put),
                    None => case,
                });
            }
        }
    }
    cases
}
