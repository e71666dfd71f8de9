//! What can be wrong with a mesh file.

use std::path::PathBuf;
use transport::geometry::mesh::MeshError;

/// Why a file could not be imported; prints as one line: `file:line: what is wrong; how to fix it`.
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
    #[error("cannot read {what} ({cause}); check that it exists and is readable")]
    Read {
        /// What was being read.
        what: String,
        /// The system's answer.
        cause: std::io::Error,
    },
    /// The extension is not one of those known.
    #[error("unknown mesh format {0:?}; expected .obj, .ply, .gltf, .glb or .serialized")]
    Extension(String),
    /// The file has no bytes.
    #[error("the file is empty; export it again")]
    EmptyFile,
    /// The file breaks its format.
    #[error("{what}; {fix}")]
    Malformed {
        /// What is wrong.
        what: String,
        /// What to do about it.
        fix: &'static str,
    },
    /// The file is sound but uses something that Sunstone does not read.
    #[error("{what}; {fix}")]
    Unsupported {
        /// What is not supported.
        what: String,
        /// What to do about it.
        fix: &'static str,
    },
    /// The file is sound, and nothing in it has an area.
    #[error("the file has no triangles of non-zero area{notes}; {fix}")]
    NoArea {
        /// What was left out, each after a semicolon.
        notes: String,
        /// What to do about it.
        fix: &'static str,
    },
    /// A mesh in the file cannot be used.
    #[error("{}: {cause}", if name.is_empty() { "the mesh".into() } else { format!("mesh {name:?}") })]
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
    pub(super) fn malformed(what: impl Into<String>, fix: &'static str) -> Self {
        let what = what.into();
        ImportProblem::Malformed { what, fix }.into()
    }

    pub(super) fn unsupported(what: impl Into<String>, fix: &'static str) -> Self {
        let what = what.into();
        ImportProblem::Unsupported { what, fix }.into()
    }

    pub(super) fn at_line(mut self, line: usize) -> Self {
        self.line = Some(line);
        self
    }
}

const FIX: &str = "export the file again with an exporter whose files pass the glTF validator";

/// Something wrong with a glTF file itself.
pub(super) fn broken(what: impl Into<String>) -> ImportError {
    ImportError::malformed(what, FIX)
}
