//! Scenes of Mitsuba.

use crate::off_python::detached;
use crate::scene::Scene;
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use sunstone::InputError;
use sunstone::scene::mitsuba::import::Import;

/// What is wrong: file, line, column, message and fix.
type Fault = (String, Option<usize>, Option<usize>, String, Option<String>);

fn fault(e: &InputError) -> Fault {
    let (line, column) = e.line_column().unzip();
    (
        e.file.display().to_string(),
        line,
        column,
        e.message.clone(),
        e.help.clone(),
    )
}

/// A scene and what changed its meaning on the way; or none, and all that is wrong. `files` are those that are in memory, by the names
/// that the text has of them.
#[pyfunction]
pub fn import_mitsuba(
    py: Python<'_>,
    text: &str,
    path: PathBuf,
    parameters: BTreeMap<String, String>,
    files: Vec<(String, Vec<u8>)>,
) -> PyResult<(Option<Scene>, Vec<String>, Vec<Fault>)> {
    detached(py, || {
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let mut files: BTreeMap<String, Vec<u8>> = files.into_iter().collect();
        let toml = folder.join("scene.toml");
        let import = match Import::with_files(&path, text, &toml, &parameters, &files) {
            Ok(import) => import,
            Err(e) => return (None, vec![], e.0.iter().map(fault).collect()),
        };
        files.extend(import.files);
        match Scene::in_memory(&toml, &import.toml, folder, &[], files) {
            Ok(scene) => (Some(scene), import.notes, vec![]),
            Err(e) => (None, vec![], vec![fault(&e)]),
        }
    })
}
