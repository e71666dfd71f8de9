//! Tests the output of `sunstone layers`, and tests which existing files remain unchanged.

use crate::commands::{refused, run};
use serde_json::Value;
use std::io::Read;
use std::path::Path;

const SCENE: &str = r#"
wavelengths_nm = [450, 550, 660]
[camera]
resolution = [12, 8]
fov_x_deg = 40
pose.look_at = { origin = [0, 0, 4], target = [0, 0, 0] }
[[emitters]]
environment.radiance = 1
[materials]
wall.diffuse.albedo = [0.5, 0.6, 0.7]
glass.dielectric.ior = 1.5
[[objects]]
name = "Wand, weiß"
shape.rectangle = { corner = [-5, -5, -1], u = [10, 0, 0], v = [0, 10, 0] }
material = "wall"
[[objects]]
shape.cube = { min = [-4, -4, 0], max = [4, 4, 0.5] }
material = "glass"
[[slices]]
name = "image"
"#;

/// Returns the bytes of a member of a zip archive.
fn member(zip: &Path, name: &str) -> Vec<u8> {
    let file = std::fs::File::open(zip).expect("the file");
    let mut archive = zip::ZipArchive::new(file).expect("an archive");
    let mut bytes = vec![];
    let mut member = archive.by_name(name).expect("a member");
    member.read_to_end(&mut bytes).expect("reads");
    bytes
}

/// Returns the header and the data of a `.npy` file, given as bytes.
fn parted(bytes: &[u8]) -> (String, Vec<u8>) {
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let n = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert_eq!((10 + n) % 64, 0);
    let header = String::from_utf8(bytes[10..10 + n].to_vec()).expect("text");
    (header, bytes[10 + n..].to_vec())
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("a file")).expect("JSON")
}

#[test]
fn layers_are_written_as_arrays_and_as_a_store() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = dir.path();
    std::fs::write(at.join("scene.toml"), SCENE).expect("writes");
    run(at, &["layers", "scene.toml", "-o", "truth.npz"]);
    run(at, &["layers", "scene.toml", "--through", "-o", "behind.npz"]);
    let read = |file: &str, name: &str| parted(&member(&at.join(file), name));
    let (header, numbers) = read("truth.npz", "object.npy");
    assert!(header.contains("'<i4'") && header.contains("(8, 12,"), "{header}");
    let objects: Vec<i32> =
        numbers.chunks_exact(4).map(|b| i32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    assert_eq!(objects, [1; 96], "glass is in front of all");
    let (_, numbers) = read("behind.npz", "object.npy");
    assert!(numbers.iter().all(|b| *b == 0), "the wall is behind it");
    let (header, letters) = read("truth.npz", "object_names.npy");
    assert!(header.contains("'<U10'") && header.contains("(2, )"), "{header}");
    let letters: String = letters
        .chunks_exact(4)
        .filter_map(|b| char::from_u32(u32::from_le_bytes([b[0], b[1], b[2], b[3]])))
        .collect();
    assert_eq!(letters, "Wand, weißobjects[1]");
    let (header, _) = read("truth.npz", "albedo.npy");
    assert!(header.contains("'<f4'") && header.contains("(8, 12, 3,"), "{header}");
    // The store has the metadata that xarray needs, and `verify` accepts the store.
    run(at, &["layers", "scene.toml", "-o", "truth.zarr"]);
    let group = json(&at.join("truth.zarr/zarr.json"));
    assert_eq!(group["attributes"]["layers"].as_array().map(Vec::len), Some(10));
    let all = &group["consolidated_metadata"]["metadata"];
    for (name, dimensions) in [("depth", &["y", "x"][..]), ("position", &["y", "x", "vector"])] {
        let array = &all[name];
        assert_eq!(array["dimension_names"], serde_json::json!(dimensions), "{name}");
        assert_eq!(array["attributes"]["units"], "m");
        for dimension in dimensions {
            assert!(all[*dimension]["shape"].is_array(), "{dimension}");
        }
    }
    let labels = &all["object"]["attributes"]["labels"];
    assert_eq!(labels[0], "Wand, weiß");
    assert!(run(at, &["verify", "truth.zarr"]).contains("all intact"));
}

#[test]
fn layers_replace_only_layers() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = dir.path();
    std::fs::write(at.join("scene.toml"), SCENE).expect("writes");
    std::fs::create_dir(at.join("precious.zarr")).expect("a folder");
    std::fs::write(at.join("precious.zarr/note"), "keep").expect("writes");
    let message = refused(at, &["layers", "scene.toml", "--force", "-o", "precious.zarr"]);
    assert!(message.contains("not overwritten"), "{message}");
    assert!(at.join("precious.zarr/note").exists());
    run(at, &["layers", "scene.toml", "-o", "truth.zarr"]);
    let message = refused(at, &["layers", "scene.toml", "-o", "truth.zarr"]);
    assert!(message.contains("--force"), "{message}");
    run(at, &["layers", "scene.toml", "--rays", "2", "--force", "-o", "truth.zarr"]);
    let group = json(&at.join("truth.zarr/zarr.json"));
    assert_eq!(group["attributes"]["rays_per_pixel"], 4);
    for name in ["scene.toml", "out.toml", "truth.exr"] {
        assert!(refused(at, &["layers", "scene.toml", "-o", name]).contains(".npz or .zarr"));
    }
    assert_eq!(std::fs::read_to_string(at.join("scene.toml")).expect("is there"), SCENE);
}
