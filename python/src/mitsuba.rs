//! Imports Mitsuba scenes.

use crate::off_python::detached;
use crate::scene::Scene;
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use sunstone::InputError;
use sunstone::scene::mitsuba::import::Import;

/// An import error, given by file, line, column, message and fix.
type Fault = (String, Option<usize>, Option<usize>, String, Option<String>);

fn fault(e: &InputError) -> Fault {
    let (line, column) = e.line_column().unzip();
    (e.file.display().to_string(), line, column, e.message.clone(), e.help.clone())
}

/// Import a scene. Return the scene and notes about differences from the Mitsuba scene. If the
/// import fails, return no scene and all errors. `files` maps names in the text to files in memory.
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
        match Scene::in_memory(&toml, &import.toml, folder, &[], files, None) {
            Ok(scene) => (Some(scene), import.notes, vec![]),
            Err(e) => (None, vec![], vec![fault(&e)]),
        }
    })
}
