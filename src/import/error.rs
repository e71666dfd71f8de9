//! Errors of the mesh readers.

use std::path::PathBuf;
use transport::geometry::mesh::MeshError;

/// An import error, which is displayed as one line: `file:line: problem; fix`.
#[derive(Debug)]
pub struct ImportError {
    pub file: Option<PathBuf>,
    /// Line number, from 1, if known. Binary formats have no line numbers.
    pub line: Option<usize>,
    pub problem: ImportProblem,
}

#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportProblem {
    /// The mesh file, or a file to which the mesh file refers, cannot be read.
    #[error("cannot read {what} ({cause}); check that the file exists and is readable")]
    Read { what: String, cause: std::io::Error },
    /// The extension is not a known mesh format.
    #[error("unknown mesh format {0:?}; expected .obj, .ply, .gltf, .glb or .serialized")]
    Extension(String),
    #[error("the file is empty; export the mesh again")]
    EmptyFile,
    /// The file is invalid, or uses an unsupported feature.
    #[error("{what}; {fix}")]
    Content { what: String, fix: &'static str },
    /// The file is valid but has no triangle with an area.
    #[error("the file has no triangles of non-zero area{notes}; {fix}")]
    NoArea {
        /// Names of omitted contents, separated by semicolons.
        notes: String,
        fix: &'static str,
    },
    /// A mesh in the file is invalid.
    #[error("{}: {cause}", if name.is_empty() { "the mesh".into() } else { format!("mesh {name:?}") })]
    Mesh {
        name: String,
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
        Self { file: None, line: None, problem }
    }
}

impl ImportError {
    pub(super) fn new(what: impl Into<String>, fix: &'static str) -> Self {
        ImportProblem::Content { what: what.into(), fix }.into()
    }

    pub(super) fn at_line(mut self, line: usize) -> Self {
        self.line = Some(line);
        self
    }
}

const FIX: &str = "export the file again with an exporter whose files pass the glTF validator";

pub(super) fn broken(what: impl Into<String>) -> ImportError {
    ImportError::new(what, FIX)
}
