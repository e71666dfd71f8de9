//! Shared code of tests that render. The code builds scenes from text, and writes stores to temporary
//! folders.

use std::path::Path;
use sunstone::render::{Target, Unwatched, render};
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::field::Field;
use sunstone::transport::scene::Scene;
use tempfile::TempDir;

/// The shipped scene of mirrors, metal and glass.
pub const MIRROR_ROOM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/mirror_room/scene.toml");

/// Replaces one passage of `text`. Panics if the passage does not exist.
pub fn edit(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "the scene has no `{from}` to edit");
    text.replacen(from, to, 1)
}

/// Returns the mirror room as shipped.
pub fn shipped() -> String {
    std::fs::read_to_string(MIRROR_ROOM).expect("the shipped scene")
}

/// Returns the mirror room with square images of `camera` and `projector` pixels, and with other slices and
/// figures. The mesh paths are absolute, so that the text works in any folder.
pub fn mirror_room(camera: u32, projector: u32, spp: u32, tile: u32, slices: &str) -> String {
    let all = shipped();
    let mut text = all[..all.find("[[slices]]").expect("slices")].to_owned();
    for (size, fov) in [(camera, 50), (projector, 58)] {
        text = edit(
            &text,
            &format!("resolution = [256, 256]\nfov_x_deg = {fov}"),
            &format!("resolution = [{size}, {size}]\nfov_x_deg = {fov}"),
        );
    }
    text = edit(&text, "spp = 128", &format!("spp = {spp}\ntile = {tile}"));
    let folder = Path::new(MIRROR_ROOM).parent().expect("a folder");
    for name in ["pedestal.obj", "knot.glb", "vase.ply"] {
        let path = folder.join(name);
        text = text.replace(&format!("file = \"{name}\""), &format!("file = \"{}\"", path.display()));
    }
    text + slices
}

/// A finished render. Dropping this value deletes the files of the render.
pub struct Rendered {
    pub store: TensorStore,
    _folder: TempDir,
}

impl Rendered {
    /// Returns a whole field of a slice.
    pub fn field(&self, slice: &str, field: Field) -> Tensor {
        self.store.slice(slice).unwrap().read_all(field).unwrap()
    }

    pub fn mean(&self, slice: &str) -> Tensor {
        self.field(slice, Field::Mean)
    }

    pub fn std_error(&self, slice: &str) -> Tensor {
        self.field(slice, Field::StdError)
    }
}

/// Renders a scene from text. Panics with the text if the scene is refused.
pub fn render_text(text: &str) -> Rendered {
    render_scene(&scene_of(text))
}

/// Parses a scene. Panics with the text if the scene is refused.
pub fn scene_of(text: &str) -> Scene {
    sunstone::scene::from_text(Path::new("test.toml"), text)
        .unwrap_or_else(|e| panic!("{e}\nin the scene\n{text}"))
}

pub fn render_scene(scene: &Scene) -> Rendered {
    let folder = tempfile::tempdir().unwrap();
    let target = Target { path: folder.path().join("store"), ..Target::default() };
    let summary = render(scene, &target, &Unwatched).unwrap();
    assert!(summary.complete);
    assert_eq!(summary.discarded, 0, "samples that are not finite");
    Rendered { store: TensorStore::open(&target.path).unwrap(), _folder: folder }
}
