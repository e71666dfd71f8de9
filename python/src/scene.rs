//! Provides scenes to Python.

use crate::error::{bail, input, located};
use crate::off_python::detached;
use base::document;
use base::locate::InputError;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use sunstone::figure::listed;
use sunstone::figure::spec::Figure;
use sunstone::scene::syntax::scene::SceneFile;
use sunstone::scene::{self, SceneBuilder};
use sunstone::transport::geometry::mesh::Mesh;

/// A scene, ready to render, and the figures that its file lists.
#[pyclass(frozen, module = "pysunstone._native")]
pub struct Scene {
    built: Mutex<sunstone::Scene>,
    pub figures: Vec<Figure>,
    /// Path of the scene file. For a scene without a file, the path that the file would have.
    path: PathBuf,
    /// Files that exist only in memory, by name.
    memory: BTreeMap<String, Vec<u8>>,
}

/// Builds a scene and its figures from the text of its file.
fn from_text(path: &Path, text: &str, variant: Option<u64>) -> Result<Scene, InputError> {
    let scene = match variant {
        Some(number) => scene::variant_from_text(path, text, number)?,
        None => scene::from_text(path, text)?,
    };
    let figures = listed::from_text(path, text, &scene.slices, scene.wavelengths.nm())?;
    Ok(Scene { built: Mutex::new(scene), figures, path: path.to_owned(), memory: BTreeMap::new() })
}

/// Converts a JSON object to equivalent TOML.
pub fn toml_of_json(json: &str) -> PyResult<String> {
    let value: toml::Table = serde_json::from_str(json).map_err(input)?;
    toml::to_string(&value).map_err(input)
}

impl Scene {
    /// Locks the scene. If a render has exclusive access to the scene, waits until the render ends.
    pub fn lock(&self) -> MutexGuard<'_, sunstone::Scene> {
        self.built.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Builds a scene from the text of its file. The meshes and some files of the scene are in memory.
    pub fn in_memory(
        path: &Path,
        text: &str,
        folder: PathBuf,
        meshes: &[(String, Mesh)],
        files: impl IntoIterator<Item = (String, Vec<u8>)>,
    ) -> Result<Self, InputError> {
        let file: SceneFile =
            document::parse(path, text, |_| "`sunstone schema` describes every key of a scene".to_owned())?;
        let mut builder = SceneBuilder::from(file).folder(&folder);
        for (name, mesh) in meshes {
            builder = builder.mesh(name.as_str(), mesh);
        }
        for (name, bytes) in files {
            builder = builder.file_in_memory(name, bytes);
        }
        let memory = builder.files_in_memory().clone();
        let scene = builder.build()?;
        let figures = listed::from_text(path, text, &scene.slices, scene.wavelengths.nm())?;
        Ok(Self {
            // The path that the file of this scene would have.
            path: folder.join(format!("{}.toml", scene.name)),
            built: Mutex::new(scene),
            figures,
            memory,
        })
    }

    /// Calls `at` with the scene. If the scene is being rendered, waits without Python's global
    /// interpreter lock.
    fn look<T: Send>(&self, py: Python<'_>, at: impl FnOnce(&sunstone::Scene) -> T + Send) -> T {
        py.detach(|| at(&self.lock()))
    }
}

/// A mesh: vertices (n, 3) in metres, triangles (m, 3), optional normals (n, 3) and texture coordinates (n,
/// 2).
type Arrays<'py> = (
    PyReadonlyArray2<'py, f32>,
    PyReadonlyArray2<'py, u32>,
    Option<PyReadonlyArray2<'py, f32>>,
    Option<PyReadonlyArray2<'py, f32>>,
);

/// Converts an array to rows of N numbers.
fn rows<const N: usize, T: numpy::Element + Copy>(
    what: &str,
    array: &PyReadonlyArray2<'_, T>,
) -> PyResult<Vec<[T; N]>> {
    let view = array.as_array();
    if view.ncols() != N {
        bail!("{what}: the shape is {:?}; expected rows of {N} numbers", view.shape());
    }
    Ok(view.rows().into_iter().map(|r| std::array::from_fn(|i| r[i])).collect())
}

fn mesh(name: &str, (vertices, faces, normals, uvs): &Arrays<'_>) -> PyResult<Mesh> {
    let points =
        |what: &str, a: &PyReadonlyArray2<'_, f32>| rows::<3, f32>(&format!("mesh {name}, {what}"), a);
    Ok(Mesh {
        positions: points("vertices", vertices)?.into_iter().map(Into::into).collect(),
        normals: match normals {
            Some(n) => points("normals", n)?.into_iter().map(Into::into).collect(),
            None => vec![],
        },
        uvs: match uvs {
            Some(uv) => {
                rows::<2, f32>(&format!("mesh {name}, uvs"), uv)?.into_iter().map(Into::into).collect()
            }
            None => vec![],
        },
        indices: rows(&format!("mesh {name}, faces"), faces)?,
    })
}

#[pymethods]
impl Scene {
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, variant: Option<u64>) -> PyResult<Self> {
        let read = || from_text(&path, &scene::read(&path)?, variant);
        detached(py, read)?.map_err(located)
    }

    #[staticmethod]
    fn from_toml(py: Python<'_>, text: &str, path: PathBuf, variant: Option<u64>) -> PyResult<Self> {
        detached(py, || from_text(&path, text, variant))?.map_err(located)
    }

    /// Create a scene from a JSON document. The scene's meshes and files are in memory.
    #[staticmethod]
    fn from_json(
        py: Python<'_>,
        json: &str,
        folder: PathBuf,
        meshes: Vec<(String, Arrays<'_>)>,
        files: Vec<(String, Vec<u8>)>,
    ) -> PyResult<Self> {
        let text = toml_of_json(json)?;
        let meshes: Vec<(String, Mesh)> = meshes
            .into_iter()
            .map(|(name, arrays)| Ok((name.clone(), mesh(&name, &arrays)?)))
            .collect::<PyResult<_>>()?;
        let path = Path::new("scene in code");
        detached(py, || Self::in_memory(path, &text, folder, &meshes, files))?.map_err(located)
    }

    #[getter]
    fn name(&self, py: Python<'_>) -> String {
        self.look(py, |s| s.name.clone())
    }

    #[getter]
    fn text(&self, py: Python<'_>) -> String {
        self.look(py, |s| s.text.clone())
    }

    #[getter]
    fn path(&self) -> &Path {
        &self.path
    }

    /// Number of the variant; None if the scene is not a variant of its file.
    #[getter]
    fn variant(&self, py: Python<'_>) -> Option<u64> {
        self.look(py, |s| s.variant.as_ref().map(|v| v.number))
    }

    /// Return the names and the bytes of the scene's files. As in the scene's text, the names are paths
    /// relative to the scene's folder.
    fn files(&self, py: Python<'_>) -> PyResult<Vec<(String, Cow<'_, [u8]>)>> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let names = self.look(py, |s| s.files.clone());
        let read = |name: String| {
            if let Some(bytes) = self.memory.get(&name) {
                return Some(Ok((name, Cow::Borrowed(&bytes[..]))));
            }
            let path = folder.join(&name);
            // An entry within an archive or another file is not a separate file.
            path.exists().then(|| {
                let bytes = std::fs::read(&path).map_err(|e| input(format!("{}: {e}", path.display())))?;
                Ok((name, Cow::Owned(bytes)))
            })
        };
        py.detach(|| names.into_iter().filter_map(read).collect())
    }

    #[getter]
    fn sha256(&self, py: Python<'_>) -> String {
        self.look(py, |s| s.sha256.clone())
    }

    #[getter]
    fn notes(&self, py: Python<'_>) -> Vec<String> {
        self.look(py, |s| s.notes.clone())
    }

    #[getter]
    fn slices(&self, py: Python<'_>) -> Vec<String> {
        self.look(py, |s| s.slices.iter().map(|slice| slice.name.clone()).collect())
    }

    #[getter]
    fn wavelengths_nm(&self, py: Python<'_>) -> Vec<f64> {
        self.look(py, |s| s.wavelengths.nm().to_vec())
    }

    /// Width and height of the camera image, in pixels.
    #[getter]
    fn resolution(&self, py: Python<'_>) -> (u32, u32) {
        self.look(py, |s| s.camera.resolution.into())
    }

    #[getter]
    fn spp(&self, py: Python<'_>) -> u32 {
        self.look(py, |s| s.settings.spp)
    }

    #[getter]
    fn seed(&self, py: Python<'_>) -> u64 {
        self.look(py, |s| s.settings.seed)
    }
}
