//! Shared functions of the benchmarks.

use std::path::{Path, PathBuf};

/// Returns the path of a scene file in `scenes/`, independent of the working directory.
pub fn shipped(scene: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes").join(scene).join("scene.toml")
}
