//! Provides scenes to Python.

use crate::error::{bail, input, located};
use crate::off_python::{detached, off_python};
use base::locate::InputError;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use sunstone::figure::listed;
use sunstone::figure::spec::Figure;
use sunstone::scene::syntax::Syntax;
use sunstone::scene::syntax::scene::SceneFile;
use sunstone::scene::syntax::variant;
use sunstone::scene::{self, SceneBuilder};
use sunstone::tensor::layers::{Layer, LayerValues, Parts};
use sunstone::transport::geometry::mesh::Mesh;
use sunstone::transport::render::layers::{Options, layers};

/// A scene, ready to render, and the figures that its file lists.
#[pyclass(frozen, module = "pysunstone._native")]
pub struct Scene {
    built: Mutex<sunstone::Scene>,
    /// The text from which the scene was built, of all variants.
    source: String,
    pub figures: Vec<Figure>,
    /// Path of the scene file. For a scene without a file, the path that the file would have.
    path: PathBuf,
    /// Files that exist only in memory, by name.
    memory: BTreeMap<String, Vec<u8>>,
}

/// Builds a scene and its figures from the text of its file.
fn from_text(path: &Path, text: &str, variant: Option<u64>) -> Result<Scene, InputError> {
    let scene = scene::variant_from_text(path, text, variant)?;
    let figures = listed::from_text(path, text, &scene.slices, scene.wavelengths.nm())?;
    Ok(Scene {
        built: Mutex::new(scene),
        source: text.to_owned(),
        figures,
        path: path.to_owned(),
        memory: BTreeMap::new(),
    })
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
        variant: Option<u64>,
    ) -> Result<Self, InputError> {
        let (file, variant) = match variant {
            Some(number) => {
                let variant = variant::read(path, text, number)?;
                let recorded = scene::recorded(&variant, number);
                (variant.file, Some(recorded))
            }
            None => (SceneFile::read(path, text)?, None),
        };
        let mut builder = SceneBuilder::from(file).folder(&folder);
        for (name, mesh) in meshes {
            builder = builder.mesh(name.as_str(), mesh);
        }
        for (name, bytes) in files {
            builder = builder.file_in_memory(name, bytes);
        }
        let memory = builder.files_in_memory().clone();
        let mut scene = builder.build()?;
        if let Some(variant) = variant {
            scene.set_variant(variant);
        }
        let figures = listed::from_text(path, text, &scene.slices, scene.wavelengths.nm())?;
        Ok(Self {
            // The path that the file of this scene would have.
            path: folder.join(format!("{}.toml", scene.name)),
            built: Mutex::new(scene),
            source: text.to_owned(),
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

/// A layer: name, axes, unit, description, names of its numbers, and values.
type OfLayer<'py> =
    (&'static str, Vec<&'static str>, &'static str, &'static str, Option<Vec<String>>, Bound<'py, PyAny>);

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
        detached(py, || Self::in_memory(path, &text, folder, &meshes, files, None))?.map_err(located)
    }

    /// Return a variant of the scene, which must have a table `vary`.
    fn variant_of(&self, py: Python<'_>, number: u64) -> PyResult<Self> {
        let build = || {
            if self.memory.is_empty() && self.path.exists() {
                return from_text(&self.path, &self.source, Some(number));
            }
            let folder = self.path.parent().unwrap_or(Path::new("")).to_owned();
            let path = Path::new("scene in code");
            Self::in_memory(path, &self.source, folder, &[], self.memory.clone(), Some(number))
        };
        detached(py, build)?.map_err(located)
    }

    /// Return what the scene contains, as pairs of a key and a value.
    fn description(&self, py: Python<'_>) -> Vec<(String, String)> {
        let text = self.look(py, cli::description);
        let pair = |line: &str| {
            let (key, value) = line.trim().split_once(' ')?;
            Some((key.to_owned(), value.trim().to_owned()))
        };
        text.lines().skip(1).filter(|l| l.starts_with("  ")).filter_map(pair).collect()
    }

    /// Position of the camera, metres.
    #[getter]
    fn camera_origin(&self, py: Python<'_>) -> [f32; 3] {
        self.look(py, |s| s.camera.origin.to_array())
    }

    /// Names of the scene's materials.
    #[getter]
    fn materials(&self, py: Python<'_>) -> Vec<String> {
        self.look(py, |s| s.names.materials.clone())
    }

    /// Names of the scene's objects.
    #[getter]
    fn objects(&self, py: Python<'_>) -> Vec<String> {
        self.look(py, |s| s.names.objects.clone())
    }

    /// Text of the scene file, of all variants.
    #[getter]
    fn source(&self) -> &str {
        &self.source
    }

    /// The keys that each parameter of the table `vary` sets, by the parameter's name.
    #[getter]
    fn varied(&self) -> PyResult<Vec<(String, Vec<String>)>> {
        let file = SceneFile::read(&self.path, &self.source).map_err(located)?;
        Ok(file.vary.iter().map(|(name, p)| (name.clone(), p.path.0.clone())).collect())
    }

    /// Values of the scene's variant by parameter, as texts of a scene file; None without a variant.
    #[getter]
    fn values(&self, py: Python<'_>) -> Option<BTreeMap<String, String>> {
        self.look(py, |s| s.variant.as_ref().map(|v| v.values.clone().into_iter().collect()))
    }

    /// Return the layers of the camera image: name, axes, unit, description, names of the numbers, and values.
    fn layers<'py>(&self, py: Python<'py>, rays: u32, through: bool) -> PyResult<Vec<OfLayer<'py>>> {
        if !(1..=64).contains(&rays) {
            bail!("rays: expected a number from 1 to 64, got {rays}");
        }
        let options = Options { side: rays, through };
        let set = off_python(py, 0, || layers(&self.lock(), options))?;
        let axes = |layer: &Layer| match layer.parts {
            Parts::One => vec!["y", "x"],
            Parts::Vector => vec!["y", "x", "vector"],
            Parts::Wavelengths => vec!["y", "x", "wavelength"],
        };
        let one = |layer: &Layer| {
            let shape: Vec<usize> = set.shape(layer).iter().map(|n| *n as usize).collect();
            let values = match &layer.values {
                LayerValues::Real(v) => PyArray1::from_slice(py, v).reshape(shape)?.into_any(),
                LayerValues::Number(v) => PyArray1::from_slice(py, v).reshape(shape)?.into_any(),
            };
            Ok((layer.name, axes(layer), layer.units, layer.long_name, layer.labels.clone(), values))
        };
        set.layers.iter().map(one).collect()
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
