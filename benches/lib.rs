//! What the benchmarks share.

use std::path::{Path, PathBuf};

/// The file of a scene that is shipped, from wherever a benchmark runs.
#[must_use]
pub fn shipped(scene: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../scenes")
        .join(scene)
        .join("scene.toml")
}
