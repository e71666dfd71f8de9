//! Checks the paths that a command reads and writes. No output may be an input, no two outputs may have the
//! same path, and extensions must match the formats.

use crate::{Failure, bail};
use std::path::{Path, PathBuf};
use sunstone::base::input::is_special;
use sunstone::base::whole_file::{is_same, real};
use sunstone::store::place::is_address;
use sunstone::store::zarr::around;

/// Known file extensions. A folder or a store with one of these extensions is assumed to be a mistake.
const OF_FILES: [&str; 28] = [
    "apng", "bin", "bmp", "csv", "exr", "gif", "glb", "gltf", "h5", "hdr", "jpeg", "jpg", "json", "mat",
    "nc", "npy", "npz", "obj", "pbsdf", "pdf", "ply", "png", "svg", "tif", "tiff", "toml", "txt", "xml",
];

/// Refuses output files that are inputs of the same command, that have equal paths, or that cannot be files.
pub fn files<'a>(
    inputs: impl IntoIterator<Item = Option<&'a PathBuf>>,
    outputs: impl IntoIterator<Item = Option<&'a PathBuf>>,
) -> Result<(), Failure> {
    let outputs: Vec<&PathBuf> = outputs.into_iter().flatten().collect();
    if let Some(folder) = outputs.iter().find(|o| o.is_dir()) {
        bail!("{}: the output must be a file, but is a folder; choose a file name", folder.display());
    }
    check(inputs, outputs)
}

/// Applies the checks of [`files`] to folders and stores.
pub fn folders<'a>(
    inputs: impl IntoIterator<Item = Option<&'a PathBuf>>,
    outputs: impl IntoIterator<Item = Option<&'a PathBuf>>,
) -> Result<(), Failure> {
    let outputs: Vec<&PathBuf> = outputs.into_iter().flatten().collect();
    for output in &outputs {
        if output.exists() && !output.is_dir() {
            bail!("{}: the output must be a folder, but is a file; choose another name", output.display());
        }
        let extension = lower_extension(output);
        if OF_FILES.contains(&extension.as_str()) && !output.is_dir() {
            bail!(
                "{}: the output is a folder, not a .{extension} file; remove the extension, or use .zarr for a store",
                output.display()
            );
        }
    }
    check(inputs, outputs)
}

/// Applies the checks of [`folders`] to a store, unless the store is the URL of an object store.
pub fn store<'a>(inputs: impl IntoIterator<Item = &'a PathBuf>, output: &'a PathBuf) -> Result<(), Failure> {
    if !is_address(output) {
        return folders(inputs.into_iter().map(Some), [Some(output)]);
    }
    if inputs.into_iter().any(|input| input == output) {
        bail!("{}: this path is both an input and the output; choose another output", output.display());
    }
    Ok(())
}

/// Refuses outputs inside a store or another Zarr hierarchy, because a finished store must not change.
pub fn outside_stores<'a>(outputs: impl IntoIterator<Item = &'a PathBuf>) -> Result<(), Failure> {
    for output in outputs {
        let real = real(output);
        if let Some(store) = real.ancestors().find(|a| a.join("zarr.json").is_file()) {
            return Err(lies_in(output, store));
        }
    }
    Ok(())
}

fn lies_in(output: &Path, store: &Path) -> Failure {
    Failure::input(format!(
        "{}: this output is inside the store {}; choose an output outside the store",
        output.display(),
        store.display()
    ))
}

/// Refuses files whose extension is not `known`. `what` names the content in the error message.
pub fn extension<'a>(
    paths: impl IntoIterator<Item = &'a PathBuf>,
    what: &str,
    known: &[&str],
) -> Result<(), Failure> {
    // The comparison is case-sensitive, as in the writers.
    let is_known = |path: &&PathBuf| path.extension().is_some_and(|e| known.iter().any(|k| e == *k));
    if let Some(path) = paths.into_iter().find(|path| !is_known(path)) {
        let known: Vec<String> = known.iter().map(|e| format!(".{e}")).collect();
        bail!(
            "{}: unsupported extension: {what} written as {}; change the extension",
            path.display(),
            known.join(" or ")
        );
    }
    Ok(())
}

fn lower_extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

fn check<'a>(
    inputs: impl IntoIterator<Item = Option<&'a PathBuf>>,
    outputs: Vec<&PathBuf>,
) -> Result<(), Failure> {
    let inputs: Vec<&PathBuf> = inputs.into_iter().flatten().collect();
    for (i, output) in outputs.iter().enumerate() {
        let shown = output.display();
        let refused = |why: String| Err(Failure::input(format!("{shown}: {why}")));
        let text = output.to_string_lossy();
        if text.is_empty() {
            bail!("the name of an output is empty; set a file or a folder");
        }
        if text == "-" {
            return refused("this output cannot be written to standard output; choose a file name".into());
        }
        if is_address(output) {
            return refused("this output must be a local file, not an address; choose a local path".into());
        }
        if is_special(output) {
            return refused("this output is a device or a pipe; choose a file name".into());
        }
        let above = output.ancestors().skip(1).find(|a| a.exists());
        if let Some(file) = above.filter(|a| !a.is_dir()) {
            return refused(format!(
                "the output cannot be inside {}, which is a file; choose another output",
                file.display()
            ));
        }
        let real = real(output);
        for input in &inputs {
            let read = input.display();
            if is_same(input, output) {
                return refused(format!(
                    "this path is both an input ({read}) and the output; choose another output"
                ));
            }
            if is_within(&real, input) {
                return refused(format!(
                    "this output is inside the input store ({read}); choose an output outside the store"
                ));
            }
            if input.exists() && is_within(&self::real(input), output) {
                return refused(format!("this store contains the input {read}; choose another output"));
            }
        }
        if let Some(store) = around(output) {
            return Err(lies_in(output, &store));
        }
        for other in &outputs[..i] {
            if is_same(other, output) || self::real(other) == real {
                return refused("this path is used for two outputs; choose different names".into());
            }
        }
    }
    Ok(())
}

/// Returns whether a canonical path is inside a store.
fn is_within(real: &Path, store: &Path) -> bool {
    store.join("zarr.json").exists() && store.canonicalize().is_ok_and(|store| real.starts_with(store))
}

/// Parses a number. If the number does not satisfy the condition, returns an error message with `expected`.
pub fn number(text: &str, is_good: impl Fn(f64) -> bool, expected: &str) -> Result<f64, String> {
    text.trim().parse().ok().filter(|v| is_good(*v)).ok_or_else(|| expected.to_owned())
}

/// Parses a wavelength in nanometres.
pub fn wavelength(text: &str) -> Result<f64, String> {
    number(text, |nm| (100.0..=100_000.0).contains(&nm), "expected a wavelength from 100 to 100000 nm")
}

/// Parses a horizontal field of view in degrees.
pub fn view(text: &str) -> Result<f64, String> {
    number(text, |deg| deg > 0.0 && deg < 180.0, "expected an angle above 0 and below 180 degrees")
}
