//! Tests the notes about input that is valid but probably a mistake, and that correct input gives no note.

use crate::harness::{run, stderr, stdout};
use std::path::Path;

/// A scene that gives no note: a wall, a ball, and bins in which light arrives.
const SCENE: &str = r#"name = "wall"
render = { spp = 2, max_depth = 3 }
camera = { resolution = [12, 8], fov_x_deg = 50, pose.look_at = { origin = [0, 0, 3], target = [0, 0, 0] } }
projector = { resolution = [8, 8], fov_x_deg = 60, pose.look_at = { origin = [0.4, 0, 3], target = [0, 0, 0] } }
materials.white.diffuse.albedo = 0.7
[[objects]]
name = "plane"
shape.rectangle = { corner = [-2, -2, 0], u = [4, 0, 0], v = [0, 4, 0] }
material = "white"
[[slices]]
name = "photo"
polarization = "mueller"
[[slices]]
name = "times"
camera = { rows = [4] }
time = { start_ps = 19000, bin_ps = 200, bins = 40 }
"#;

/// Renders the scene with a replacement, and returns the messages.
fn rendered(at: &Path, name: &str, old: &str, new: &str) -> String {
    assert!(SCENE.contains(old), "{old}");
    std::fs::write(at.join("scene.toml"), SCENE.replace(old, new)).expect("writes");
    stderr(&run(at, &["render", "scene.toml", "-o", name, "--no-figures"], 0))
}

#[test]
fn black_images_and_missed_bins_are_noted() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let good = rendered(at, "good.zarr", "spp = 2", "spp = 2");
    assert!(!good.contains("note:"), "{good}");
    // Closed form: 6 m to 7.4 m of path, 20 014 ps and more.
    let late = rendered(at, "late.zarr", "start_ps = 19000", "start_ps = 90000");
    let part = "slice `times` has time bins from 90000 to 98000 ps, but direct light arrives from 20";
    assert!(late.contains(part), "{late}");
    let early = rendered(at, "early.zarr", "start_ps = 19000", "start_ps = 0");
    assert!(early.contains("time bins from 0 to 8000 ps"), "{early}");
    let ball = "[[objects]]\nname = \"ball\"\nshape.sphere = { center = [0, 0, 3], radius = 0.1 }\nmaterial = \"white\"\n[[slices]]\nname = \"photo\"";
    let inside = rendered(at, "inside.zarr", "[[slices]]\nname = \"photo\"", ball);
    assert!(inside.contains("the image is black: the camera is inside the object `ball`"), "{inside}");
    let away = "origin = [0, 0, 3], target = [0, 0, 9]";
    let away = rendered(at, "away.zarr", "origin = [0, 0, 3], target = [0, 0, 0]", away);
    assert!(away.contains("the image is black: no camera ray hits an object"), "{away}");
    let unlit = "origin = [0.4, 0, 3], target = [0.4, 0, 9]";
    let unlit = rendered(at, "unlit.zarr", "origin = [0.4, 0, 3], target = [0, 0, 0]", unlit);
    assert!(
        unlit.contains("; 0 % of the visible points are in the field of view of the projector"),
        "{unlit}"
    );
}

#[test]
fn images_on_meshes_without_coordinates_are_noted() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let corners = "v -2 -2 0\nv 2 -2 0\nv 0 2 0\n";
    std::fs::write(at.join("bare.obj"), format!("{corners}f 1 2 3\n")).expect("writes");
    let coordinates = "vt 0 0\nvt 1 0\nvt 0 1\n";
    std::fs::write(at.join("full.obj"), format!("{corners}{coordinates}f 1/1 2/2 3/3\n")).expect("writes");
    image::RgbImage::from_pixel(2, 2, image::Rgb([200; 3])).save(at.join("a.png")).expect("writes");
    let plane = "shape.rectangle = { corner = [-2, -2, 0], u = [4, 0, 0], v = [0, 4, 0] }";
    let text = SCENE.replace("albedo = 0.7", "albedo = { image = \"a.png\" }");
    let info = |file: &str, material: &str| {
        let text = text.replace(plane, &format!("shape.obj.file = \"{file}\""));
        let text = text.replace("material = \"white\"", &format!("material = \"{material}\""));
        let more = "materials.both.two_sided = { front = \"white\", back = \"white\" }\nmaterials.grey.diffuse.albedo = 0.4\n[[objects]]";
        std::fs::write(at.join("scene.toml"), text.replacen("[[objects]]", more, 1)).expect("writes");
        stdout(&run(at, &["info", "scene.toml"], 0))
    };
    let note = |material: &str| {
        format!("plane: the material `{material}` has an image, but the mesh has no texture coordinates")
    };
    for material in ["white", "both"] {
        assert!(info("bare.obj", material).contains(&note(material)), "{}", info("bare.obj", material));
        assert!(!info("full.obj", material).contains("texture coordinates"));
    }
    assert!(!info("bare.obj", "grey").contains("texture coordinates"));
}

#[test]
fn schemes_that_do_not_determine_the_matrix_and_saturation_are_noted() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let made = |k: &str| stderr(&run(at, &["scheme", "drr", "-k", k, "-o", &format!("{k}.toml")], 0));
    assert!(made("2").contains("note: the scheme has rank 2 of 16 and does not determine"), "{}", made("2"));
    assert_eq!(made("36"), "");
    // One of four pixels is a million times brighter than the others.
    let m00 = |pixel: usize| if pixel == 3 { 1e4 } else { 1e-2 };
    let matrices: Vec<f32> = (0..4 * 16).map(|i| if i % 16 == 0 { m00(i / 16) } else { 0.0 }).collect();
    sunstone::store::numpy::save(&at.join("m.npy"), &[2, 2, 4, 4], &matrices).expect("writes");
    let captured = |exposure: &str, code| {
        std::fs::write(at.join("d.toml"), format!("[cmos]\nexposure_s = {exposure}\n")).expect("writes");
        let words = ["capture", "m.npy", "--scheme", "36.toml", "--detector", "d.toml", "-o", "i.npy"];
        stderr(&run(at, &words, code))
    };
    let some = captured("1e-3", 0);
    assert_eq!(
        some,
        "note: 25.000 % of the intensities are saturated, and NaN in the file; reduce exposure_s in the detector file\n"
    );
    let all = captured("1e6", 2);
    assert!(all.contains("no matrix gives a finite intensity"), "{all}");
    assert_eq!(captured("1e-9", 0), "");
}

#[test]
fn layers_of_a_variant_and_data_sets_are_described() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let vary = "[vary.depth]\npath = \"objects.plane.shape.rectangle.corner.2\"\nvalues = [0, -1]\n";
    std::fs::write(at.join("scene.toml"), format!("{SCENE}{vary}")).expect("writes");
    for (variant, distance) in [("0", 3.0), ("1", 4.0)] {
        let file = format!("{variant}.npz");
        run(at, &["layers", "scene.toml", "--variant", variant, "-o", &file], 0);
        let mut zip =
            zip::ZipArchive::new(std::fs::File::open(at.join(file)).expect("opens")).expect("a zip");
        let mut bytes = vec![];
        std::io::copy(&mut zip.by_name("position.npy").expect("an array"), &mut bytes).expect("reads");
        let last: [u8; 4] = bytes[bytes.len() - 4..].try_into().expect("four bytes");
        assert!((f64::from(f32::from_le_bytes(last)) - (3.0 - distance)).abs() < 1e-5);
    }
    let missing = stderr(&run(at, &["layers", "scene.toml", "--variant", "2", "-o", "2.npz"], 2));
    assert!(missing.contains("variant 2 does not exist: the scene has 2 variants"), "{missing}");
    // The manifest of a data set, as `pysunstone.dataset` writes it.
    std::fs::create_dir(at.join("set.zarr")).expect("a folder");
    let manifest = r#"{"form": 1, "settings": {"scene": "s.toml", "slices": ["photo"], "spp": null}, "places": {"depth": "objects.plane"},
        "finished": true, "samples": [{"variant": 0, "values": {"depth": -1}}, {"variant": 1, "values": {"depth": 0}}]}"#;
    std::fs::write(at.join("set.zarr/dataset.json"), manifest).expect("writes");
    let probe = stderr(&run(at, &["probe", "set.zarr", "photo"], 2));
    assert!(
        probe.contains("set.zarr is a data set of several renders, not the store of one render"),
        "{probe}"
    );
    let info = stdout(&run(at, &["info", "set.zarr"], 0));
    for part in [
        "data set, finished, 2 samples",
        "s.toml",
        "parameter depth",
        "-1 in the first sample (objects.plane)",
    ] {
        assert!(info.contains(part), "{info}");
    }
}
