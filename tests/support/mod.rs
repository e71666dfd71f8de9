//! Renders a scene given as text into a store in a temporary folder.

use std::path::Path;
use sunstone::render::{Target, Unwatched, render};
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::field::Field;
use sunstone::transport::scene::Scene;
use tempfile::TempDir;

/// A finished render; its files live as long as it does.
pub struct Rendered {
    pub store: TensorStore,
    _folder: TempDir,
}

impl Rendered {
    /// A whole field of a slice.
    pub fn field(&self, slice: &str, field: Field) -> Tensor {
        self.store.slice(slice).unwrap().read_all(field).unwrap()
    }

    /// The mean of a slice.
    pub fn mean(&self, slice: &str) -> Tensor {
        self.field(slice, Field::Mean)
    }

    /// The standard error of a slice.
    pub fn std_error(&self, slice: &str) -> Tensor {
        self.field(slice, Field::StdError)
    }
}

/// Renders the scene; panics with the scene's text if it is refused.
pub fn render_text(text: &str) -> Rendered {
    render_scene(&scene_of(text))
}

/// The scene; panics with its text if it is refused.
pub fn scene_of(text: &str) -> Scene {
    sunstone::scene::from_text(Path::new("test.toml"), text)
        .unwrap_or_else(|e| panic!("{e}\nin the scene\n{text}"))
}

/// Renders a scene.
pub fn render_scene(scene: &Scene) -> Rendered {
    let folder = tempfile::tempdir().unwrap();
    let target = Target {
        path: folder.path().join("store"),
        ..Target::default()
    };
    let summary = render(scene, &target, &Unwatched).unwrap();
    assert!(summary.complete);
    assert_eq!(summary.discarded, 0, "samples that are not finite");
    Rendered {
        store: TensorStore::open(&target.path).unwrap(),
        _folder: folder,
    }
}
