//! Chunk files are byte-identical between versions: five shipped scenes with few samples, against committed
//! checksums.
//!
//! `bytes.txt` has a line per scene: its name, samples per pixel, and a SHA-256 over all files of the store
//! except `zarr.json` files and the manifest. The hash covers, in the order of relative paths, the path, a
//! zero byte, the length (u64, little-endian) and the bytes of each file. A change of these bytes changes
//! users' results: make it deliberately, document it, and print the new lines with `cargo test --release
//! --test suite bytes -- --ignored --nocapture` (`SUNSTONE_PROGRAM` selects another program than the one just
//! built).

use crate::harness::files;
use sha2::{Digest, Sha256};
use std::path::Path;
use std::process::Command;

const CHECKSUMS: &str = include_str!("bytes.txt");

/// Renders a shipped scene and returns the checksum of its chunk files.
fn checksum(program: &str, scene: &str, spp: &str, threads: &str) -> String {
    let folder = tempfile::tempdir().expect("a folder");
    let store = folder.path().join("out.zarr");
    let file =
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(format!("scenes/{scene}/scene.toml"));
    let out = Command::new(program)
        .args(["render", "--spp", spp, "--threads", threads, "--no-figures", "-o"])
        .args([&store, &file])
        .output()
        .expect("the program runs");
    assert!(out.status.success(), "{scene}: {}", String::from_utf8_lossy(&out.stderr));
    let mut chunks: Vec<(String, Vec<u8>)> = files(&store)
        .into_iter()
        .map(|(path, bytes)| (path.to_string_lossy().replace('\\', "/"), bytes))
        .filter(|(path, _)| !path.ends_with("zarr.json") && path != "manifest.txt")
        .collect();
    chunks.sort();
    assert!(chunks.len() > 50, "{scene}: {} files", chunks.len());
    let mut hash = Sha256::new();
    for (path, bytes) in chunks {
        hash.update(path);
        hash.update([0]);
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    }
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

/// Scene, samples per pixel, checksum.
fn lines() -> impl Iterator<Item = [&'static str; 3]> {
    CHECKSUMS.lines().map(|line| {
        let words: Vec<&str> = line.split_whitespace().collect();
        words.try_into().expect("three words a line")
    })
}

#[test]
fn shipped_scenes_give_the_committed_bytes_on_one_thread_and_two() {
    let mut count = 0;
    for [scene, spp, want] in lines() {
        for threads in ["1", "2"] {
            let got = checksum(env!("CARGO_BIN_EXE_sunstone"), scene, spp, threads);
            assert_eq!(got, want, "{scene} at {spp} samples on {threads} threads");
        }
        count += 1;
    }
    assert_eq!(count, 5);
}

#[test]
#[ignore = "prints the lines of bytes.txt"]
fn print_the_lines() {
    let other = std::env::var("SUNSTONE_PROGRAM");
    let program = other.as_deref().unwrap_or(env!("CARGO_BIN_EXE_sunstone"));
    for [scene, spp, _] in lines() {
        println!("{scene} {spp} {}", checksum(program, scene, spp, "2"));
    }
}
