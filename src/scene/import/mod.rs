//! Meshes from files: Wavefront OBJ, PLY (ASCII and binary) and glTF 2.0 (`.gltf`, `.glb`).
//!
//! The parsers are pure functions of the bytes and hold up against arbitrary input: a broken file gives an
//! [`ImportError`] that says where it is broken, never a panic, and no allocation exceeds what the file's own length
//! supports. All of them finish a mesh the same way: triangles without area are dropped, then unused vertices,
//! normals are made unit length (or dropped where one has no length), and the result is validated.

mod accessor;
mod gltf;
mod obj;
mod ply;
pub(crate) mod write_ply;

#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod gltf_tests;

use std::path::{Path, PathBuf};

use glam::Vec3;
use transport::geometry::mesh::{Mesh, MeshError};

pub use self::gltf::parse_gltf;
pub use self::obj::parse_obj;
pub use self::ply::parse_ply;

/// One mesh of a file with what the file says about it.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshPart {
    /// The object's name in the file; the file's own name (without extension) where it gives none.
    pub name: String,
    /// The material's name in the file (`usemtl`, glTF material), if any.
    pub material: Option<String>,
    /// The triangles, in metres, in the file's world space.
    pub mesh: Mesh,
}

/// Why a file could not be imported; prints as one line: `file:line: what is wrong; how to mend it`.
#[derive(Debug)]
pub struct ImportError {
    /// The file, where it is known.
    pub file: Option<PathBuf>,
    /// The line, from 1, in text formats, where it is known.
    pub line: Option<usize>,
    /// What is wrong.
    pub problem: ImportProblem,
}

/// What can be wrong with a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportProblem {
    /// The file or a file it refers to cannot be read.
    #[error("{what} cannot be read ({cause}); check that it exists and may be read")]
    Read {
        /// What was being read.
        what: String,
        /// The system's answer.
        cause: std::io::Error,
    },
    /// The extension is not one of those known.
    #[error("the extension {0:?} is not a known mesh format; use .obj, .ply, .gltf or .glb")]
    Extension(String),
    /// The file has no bytes.
    #[error("the file is empty; export it again")]
    EmptyFile,
    /// The file breaks its format.
    #[error("{what}; {mend}")]
    Malformed {
        /// What is wrong.
        what: String,
        /// What to do about it.
        mend: &'static str,
    },
    /// The file is sound but uses something that Sunstone does not read.
    #[error("{what}; {mend}")]
    Unsupported {
        /// What is not supported.
        what: String,
        /// What to do about it.
        mend: &'static str,
    },
    /// A mesh in the file cannot be used.
    #[error("{} {cause}", if name.is_empty() { "the mesh".into() } else { format!("mesh {name:?}") })]
    Mesh {
        /// The mesh's name.
        name: String,
        /// What is wrong with it.
        #[source]
        cause: MeshError,
    },
}

impl std::fmt::Display for ImportError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.file {
            Some(file) => write!(f, "{}", file.display())?,
            None => write!(f, "mesh data")?,
        }
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        write!(f, ": {}", self.problem)
    }
}

impl std::error::Error for ImportError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        std::error::Error::source(&self.problem)
    }
}

impl From<ImportProblem> for ImportError {
    fn from(problem: ImportProblem) -> Self {
        Self {
            file: None,
            line: None,
            problem,
        }
    }
}

impl ImportError {
    fn malformed(what: impl Into<String>, mend: &'static str) -> Self {
        let what = what.into();
        ImportProblem::Malformed { what, mend }.into()
    }

    fn unsupported(what: impl Into<String>, mend: &'static str) -> Self {
        let what = what.into();
        ImportProblem::Unsupported { what, mend }.into()
    }

    fn at_line(mut self, line: usize) -> Self {
        self.line = Some(line);
        self
    }
}

/// Loads every mesh of a file; the format follows from the extension (`.obj`, `.ply`, `.gltf`, `.glb`, in any case).
///
/// # Errors
/// [`ImportError`], which names the file, if it cannot be read, is not one of those formats, breaks its format, or
/// holds no usable triangles.
pub fn load(path: &Path) -> Result<Vec<MeshPart>, ImportError> {
    let mut parts = load_unnamed(path).map_err(|mut error| {
        error.file = Some(path.to_owned());
        error
    })?;
    let stem = path
        .file_stem()
        .map_or_else(|| "mesh".into(), |s| s.to_string_lossy().into_owned());
    for part in parts.iter_mut().filter(|p| p.name.is_empty()) {
        part.name.clone_from(&stem);
    }
    Ok(parts)
}

fn load_unnamed(path: &Path) -> Result<Vec<MeshPart>, ImportError> {
    let extension = path
        .extension()
        .map_or_else(String::new, |e| e.to_string_lossy().to_lowercase());
    if !["obj", "ply", "gltf", "glb"].contains(&extension.as_str()) {
        return Err(ImportProblem::Extension(extension).into());
    }
    let bytes = std::fs::read(path).map_err(|cause| ImportProblem::Read {
        what: "the file".into(),
        cause,
    })?;
    match extension.as_str() {
        "obj" => parse_obj(&bytes),
        "ply" => parse_ply(&bytes),
        _ => parse_gltf(&bytes, Some(path.parent().unwrap_or(Path::new("")))),
    }
}

/// Brings a freshly read mesh into order and checks it; see the head of this file.
fn finish(name: String, material: Option<String>, mut mesh: Mesh) -> Result<MeshPart, ImportError> {
    if mesh.normals.iter().all(|n| n.is_finite()) {
        for n in &mut mesh.normals {
            *n = n.as_dvec3().try_normalize().map_or(Vec3::ZERO, |n| n.as_vec3());
        }
        if mesh.normals.contains(&Vec3::ZERO) {
            mesh.normals.clear();
        }
    }
    let checked = mesh.validate().and_then(|()| {
        mesh.drop_degenerate();
        mesh.compact();
        if mesh.indices.is_empty() {
            Err(MeshError::Empty)
        } else {
            Ok(())
        }
    });
    match checked {
        Ok(()) => Ok(MeshPart { name, material, mesh }),
        Err(cause) => Err(ImportProblem::Mesh { name, cause }.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn load_goes_by_extension_and_names_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("tri.OBJ");
        std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        let parts = load(&path).unwrap();
        assert_eq!((parts.len(), parts[0].name.as_str()), (1, "tri"));

        std::fs::write(&path, "v 0 0 0\nv 1 zero 0\n").unwrap();
        let message = load(&path).unwrap_err().to_string();
        assert!(
            message.contains("tri.OBJ:2: ") && message.contains("zero"),
            "{message}"
        );

        let message = load(&dir.path().join("a.stl")).unwrap_err().to_string();
        assert!(message.contains("a.stl") && message.contains(".glb"), "{message}");
        let message = load(&dir.path().join("none.ply")).unwrap_err().to_string();
        assert!(
            message.contains("none.ply") && message.contains("exists"),
            "{message}"
        );
    }

    #[test]
    fn empty_files_are_refused() {
        for error in [
            parse_obj(b"").unwrap_err(),
            parse_ply(b"").unwrap_err(),
            parse_gltf(b"", None).unwrap_err(),
        ] {
            assert!(matches!(error.problem, ImportProblem::EmptyFile), "{error}");
        }
    }

    #[test]
    fn finishing_drops_bad_normals_but_not_the_mesh() {
        let mut mesh = Mesh::rectangle();
        mesh.normals[3] = Vec3::ZERO;
        let part = finish("r".into(), None, mesh).unwrap();
        assert!(part.mesh.normals.is_empty());
        let mut mesh = Mesh::rectangle();
        mesh.normals = vec![Vec3::Z * 7.0; 4];
        assert_eq!(finish("r".into(), None, mesh).unwrap().mesh, Mesh::rectangle());
    }
}
