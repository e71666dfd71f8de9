//! Tests that imported materials keep the albedo of their source models. A square under uniform illumination
//! 1, seen along its normal, shows the directional albedo at normal incidence. The expected values are those
//! of the specifications, those of Mitsuba 3.9.1, or closed forms. `validation/import_albedo.py` compares all
//! angles with Mitsuba.

use crate::mesh_files::square;
use crate::optics::{Device, head};
use crate::support::render_scene;
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::Path;
use sunstone::scene::from_text;
use sunstone::scene::mitsuba::import::Import;

const SKY: &str = "[[emitters]]\nenvironment = { radiance = 1 }\n[[slices]]\nname = \"m\"\n";

/// Returns the radiance of a scene at 450, 550 and 660 nm.
fn seen(folder: &Path, text: &str) -> [f64; 3] {
    let scene = from_text(&folder.join("scene.toml"), text).unwrap_or_else(|e| panic!("{e}"));
    let mean = render_scene(&scene).mean("m");
    let one = mean.data.len() / 3;
    std::array::from_fn(|i| f64::from(mean.data[i * one]))
}

fn object(folder: &Path, shape: &str) -> [f64; 3] {
    let camera = Device::ray([0.05, 0.02, 4.0], DVec3::new(0.05, 0.02, 0.0));
    let text = head(20_000, 2, 2).replace("[550]", "[450, 550, 660]")
        + &camera.keys("camera")
        + &format!(
            "[materials]\nbare.diffuse.albedo = 0\n[[objects]]\nmaterial = \"bare\"\nshape.{shape}, materials = true }}\n"
        )
        + SKY;
    seen(folder, &text)
}

fn mtl(text: &str) -> [f64; 3] {
    let folder = tempfile::tempdir().unwrap();
    square(folder.path(), "{}", &format!("newmtl painted\n{text}\n"));
    image::RgbImage::from_pixel(2, 2, image::Rgb([188, 188, 188]))
        .save(folder.path().join("grey.png"))
        .unwrap();
    object(folder.path(), "obj = { file = \"square.obj\"")
}

fn gltf(material: &str) -> [f64; 3] {
    let folder = tempfile::tempdir().unwrap();
    square(folder.path(), material, "");
    // In the map `picture.png`, the green channel (roughness) and the blue channel (metal) are half.
    image::RgbImage::from_pixel(2, 2, image::Rgb([255, 128, 128]))
        .save(folder.path().join("picture.png"))
        .unwrap();
    object(folder.path(), "gltf = { file = \"square.gltf\"")
}

/// Returns the radiance, at 450, 550 and 660 nm, of a rectangle with a BSDF imported from Mitsuba.
fn mitsuba(bsdf: &str) -> [f64; 3] {
    let folder = tempfile::tempdir().unwrap();
    let xml = format!(
        r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="2"/></integrator>
        <sensor type="perspective"><float name="fov" value="0.01"/><transform name="to_world"><lookat origin="0.05,0.02,4" target="0.05,0.02,0" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/></film>
        <sampler type="independent"><integer name="sample_count" value="20000"/></sampler></sensor>
        <emitter type="constant"/><shape type="rectangle">{bsdf}</shape></scene>"#
    );
    let toml = folder.path().join("scene.toml");
    let import = Import::from_text(&folder.path().join("scene.xml"), &xml, &toml, &BTreeMap::new())
        .unwrap_or_else(|e| panic!("{bsdf}: {e}"));
    let (scene, _) = import.toml.split_once("[[slices]]").expect("a slice");
    seen(folder.path(), &format!("{scene}[[slices]]\nname = \"m\"\n"))
}

#[track_caller]
fn near(what: &str, got: [f64; 3], want: [f64; 3], off: f64) {
    for (got, want) in got.into_iter().zip(want) {
        assert!((got - want).abs() <= off * want.max(0.05), "{what}: {got:.4}, not {want}");
    }
}

/// Directional albedo at normal incidence of facets with α = 0.5 and Schlick's reflectance, which is 0.5 at
/// normal incidence.
const METAL: f64 = 0.344;

/// Relative tolerance for 20,000 samples. Five standard errors of a rough mirror, which has the largest
/// variance of all tested materials, are 0.7 %.
const NOISE: f64 = 0.012;

#[test]
fn a_base_colour_is_not_weakened_twice() {
    for (base, specified, disney) in [(0.2, 0.204, 0.220), (0.5, 0.492, 0.530), (0.8, 0.780, 0.840)] {
        let got = gltf(&format!(
            r#"{{"pbrMetallicRoughness": {{"baseColorFactor": [{base}, {base}, {base}, 1], "metallicFactor": 0}}}}"#
        ));
        near("glTF", got, [specified; 3], NOISE);
        let got = mitsuba(&format!(
            r#"<bsdf type="principled"><rgb name="base_color" value="{base}"/><float name="roughness" value="1"/></bsdf>"#
        ));
        near("principled", got, [disney; 3], NOISE);
    }
}

#[test]
fn mtl_colours_are_those_of_the_whole_surface() {
    for (text, want) in [
        ("Kd .8 .8 .8\nKs .5 .5 .5\nNs 250", [0.8; 3]),
        ("Kd 0 0 0\nKs 1 1 1\nillum 3", [1.0; 3]),
        ("Kd .2 .2 .2\nKs .5 .5 .5\nillum 3", [0.7; 3]),
        ("Kd .5 .5 .5\nd .5", [0.75; 3]),
        ("Kd .1 .1 .8\nTr 1.0\nillum 1", [0.8, 0.1, 0.1]),
        ("Kd .1 .2 .3\nKs .9 .9 .9\nillum 0", [0.3, 0.2, 0.1]),
        // Half of the surface is metal with α = 0.5 (`gltf` of `validation/import_albedo.py`), and the
        // remaining half is base and mirror.
        ("Kd .5 .5 .5\nKs .4 .4 .4\nillum 3\nPm .5", [0.5 * METAL + 0.5 * 0.9; 3]),
        // The sRGB value 188 is 0.503.
        ("map_Kd grey.png", [0.503; 3]),
        ("Kd .5 .25 1\nmap_Kd grey.png", [0.503, 0.1257, 0.2515]),
        ("Kd .5 .5 .5\nmap_d grey.png", [(1.0 - 188.0 / 255.0) + 0.5 * 188.0 / 255.0; 3]),
    ] {
        near(text, mtl(text), want, NOISE);
    }
}

/// Compares the radiance along the normal with Mitsuba 3.9.1 (scalar_rgb, 65,536 samples).
#[test]
fn rough_coats_darken_the_body_as_in_mitsuba() {
    for (alpha, want) in [("0.1", 0.5033), ("0.4", 0.4242), ("1", 0.2649)] {
        let got = mitsuba(&format!(
            r#"<bsdf type="roughplastic"><rgb name="diffuse_reflectance" value="0.5"/><float name="alpha" value="{alpha}"/></bsdf>"#
        ));
        near(alpha, got, [want; 3], 0.02);
    }
}

#[test]
fn metals_without_indices_reflect_all_light() {
    for bsdf in [
        r#"<bsdf type="conductor"/>"#,
        r#"<bsdf type="conductor"><string name="material" value="none"/></bsdf>"#,
    ] {
        near(bsdf, mitsuba(bsdf), [1.0; 3], 1e-5);
    }
    let tinted = r#"<bsdf type="conductor"><rgb name="specular_reflectance" value="0.2 0.4 0.6"/></bsdf>"#;
    near(tinted, mitsuba(tinted), [0.6, 0.4, 0.2], 1e-5);
}

/// Tests glTF's default material, which is white metal of roughness 1. With single reflections from GGX
/// facets, the directional albedo at normal incidence is 0.3069. A material with a roughness map and default
/// factors has α = 0.252 and is half metal (`gltf` of `validation/import_albedo.py`).
#[test]
fn white_metal_loads_and_reflects() {
    near("{}", gltf("{}"), [0.3069; 3], NOISE);
    let smooth = r#"{"pbrMetallicRoughness": {"roughnessFactor": 0}}"#;
    near(smooth, gltf(smooth), [1.0; 3], NOISE);
    let map = r#"{"pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}}}"#;
    near(map, gltf(map), [0.9553; 3], NOISE);
}

#[test]
fn holes_show_the_background() {
    let blend = r#"{"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 0.25], "metallicFactor": 0}}"#;
    near(blend, gltf(blend), [0.75 + 0.25 * 0.492; 3], NOISE);
    let cut = r#"{"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 0.25], "metallicFactor": 0}}"#;
    near(cut, gltf(cut), [1.0; 3], NOISE);
    let opaque =
        r#"{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 0.25], "metallicFactor": 0}}"#;
    near(opaque, gltf(opaque), [0.492; 3], NOISE);
}

/// Tests that Mitsuba's clipping planes are refused if they cut the scene, because the result would differ.
/// Planes that cut nothing are ignored.
#[test]
fn clipping_planes_that_cut_are_refused() {
    let imported = |near: &str, far: &str| {
        let folder = tempfile::tempdir().unwrap();
        let xml = format!(
            r#"<scene version="3.0.0"><sensor type="perspective"><float name="near_clip" value="{near}"/><float name="far_clip" value="{far}"/>
            <transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform></sensor>
            <emitter type="constant"/><shape type="rectangle"/></scene>"#
        );
        let toml = folder.path().join("scene.toml");
        Import::from_text(&folder.path().join("scene.xml"), &xml, &toml, &BTreeMap::new())
            .map_err(|e| e.to_string())
    };
    assert!(imported("0.1", "100").is_ok());
    let error = imported("5", "100").expect_err("in front of the near plane");
    assert!(error.contains("near_clip = 5 clips") && error.contains("scene.xml:1"), "{error}");
    let error = imported("0.1", "3").expect_err("behind the far plane");
    assert!(error.contains("far_clip = 3 clips"), "{error}");
}
