//! Mesh import: Wavefront OBJ, PLY (ASCII and binary), glTF 2.0 (`.gltf`, `.glb`) and Mitsuba's `serialized`.
//! The crate also checks closed surfaces, reads images, and reads files with the transforms of many copies of
//! an object.
//!
//! The parsers are pure functions of the bytes and accept arbitrary input. An invalid file gives an
//! [`ImportError`] with its location, never a panic. The file's length bounds all allocations. All parsers
//! finish a mesh with the same steps:
//!
//! - Degenerate triangles and then unused vertices are dropped.
//! - Normals are normalized, and normals of zero length are replaced.
//! - The result is validated.
//!
//! Each item of a file is used, mentioned in a note or refused.

mod accessor;
pub mod appearance;
pub mod attribute;
pub mod body;
pub mod closed;
pub mod curve;
mod draco;
mod error;
mod gltf;
mod gltf_deform;
mod gltf_materials;
mod gltf_notes;
mod meshopt;
pub mod metal;
pub mod mtl;
mod notes;
mod obj;
mod part;
pub mod picture;
pub mod places;
mod ply;
mod ply_body;
mod ply_header;
mod polygon;
pub mod sdf;
mod serialized;
mod text;
pub mod vol;
pub mod write_ply;

#[cfg(test)]
mod accounting;
#[cfg(test)]
mod attribute_tests;
#[cfg(test)]
mod curve_tests;
#[cfg(test)]
mod draco_tests;
#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod gltf_tests;
#[cfg(test)]
mod obj_tests;
#[cfg(test)]
mod ply_tests;

use std::path::Path;

pub use self::error::{ImportError, ImportProblem};
pub use self::gltf::{gltf_buffers, parse_gltf};
pub use self::gltf_materials::appearances as gltf_appearances;
pub use self::obj::parse_obj;
pub use self::part::{MeshPart, Model, lies_within};
pub use self::ply::{parse_ply, parse_ply_attribute};
pub use self::serialized::parse_serialized;

/// Loads all meshes of a file. The extension selects the format: `.obj`, `.ply`, `.gltf`, `.glb` or
/// `.serialized` (first mesh only), in any case.
///
/// # Errors
/// Returns [`ImportError`] with the file's name, if the file cannot be read, has another format, is invalid
/// or has no usable triangles.
pub fn load(path: &Path) -> Result<Model, ImportError> {
    let mut model = load_unnamed(path).map_err(|mut error| {
        error.file = Some(path.to_owned());
        error
    })?;
    let stem = path.file_stem().map_or_else(|| "mesh".into(), |s| s.to_string_lossy().into_owned());
    for part in model.parts.iter_mut().filter(|p| p.name.is_empty()) {
        part.name.clone_from(&stem);
    }
    Ok(model)
}

fn load_unnamed(path: &Path) -> Result<Model, ImportError> {
    let extension = path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_lowercase());
    if !["obj", "ply", "gltf", "glb", "serialized"].contains(&extension.as_str()) {
        return Err(ImportProblem::Extension(extension).into());
    }
    let bytes =
        base::input::read(path).map_err(|cause| ImportProblem::Read { what: "the file".into(), cause })?;
    match extension.as_str() {
        "obj" => parse_obj(&bytes),
        "ply" => parse_ply(&bytes),
        "serialized" => parse_serialized(&bytes, 0),
        _ => parse_gltf(&bytes, Some(path.parent().unwrap_or(Path::new("")))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn format_follows_the_extension_and_errors_name_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("tri.OBJ");
        std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        let parts = load(&path).unwrap().parts;
        assert_eq!((parts.len(), parts[0].name.as_str()), (1, "tri"));

        std::fs::write(&path, "v 0 0 0\nv 1 zero 0\n").unwrap();
        let message = load(&path).unwrap_err().to_string();
        assert!(message.contains("tri.OBJ:2: ") && message.contains("zero"), "{message}");

        let message = load(&dir.path().join("a.stl")).unwrap_err().to_string();
        assert!(message.contains("a.stl") && message.contains(".glb"), "{message}");
        let message = load(&dir.path().join("none.ply")).unwrap_err().to_string();
        assert!(message.contains("none.ply") && message.contains("exists"), "{message}");
    }

    #[test]
    fn empty_files_are_refused() {
        for error in
            [parse_obj(b"").unwrap_err(), parse_ply(b"").unwrap_err(), parse_gltf(b"", None).unwrap_err()]
        {
            assert!(matches!(error.problem, ImportProblem::EmptyFile), "{error}");
        }
    }
}
