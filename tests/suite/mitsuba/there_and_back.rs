//! Tests that a scene is unchanged after an export to Mitsuba and an import of the exported files.

use super::{ALL, assert_same, exported, folder};
use std::collections::BTreeMap;
use std::path::Path;
use sunstone::scene::mitsuba::export::Export;
use sunstone::scene::mitsuba::import::Import;
use sunstone::scene::syntax::scene::SceneFile;

#[test]
fn export_and_import_give_the_same_scene() {
    let folder = folder();
    let path = folder.path().join("scene.toml");
    let export = exported(folder.path(), ALL).unwrap();
    let out = folder.path().join("out");
    export.write(&out, false).unwrap();
    let back = Import::load(&out.join("scene.xml"), &path, &BTreeMap::new()).unwrap();
    let (a, b) = (
        sunstone::scene::from_text(&path, ALL).unwrap(),
        sunstone::scene::from_text(&path, &back.toml).unwrap(),
    );
    let (hits, matrices) = assert_same(&a, &b);
    assert!(hits > 500 && matrices > 800, "{hits} {matrices}");
}

#[test]
fn several_wavelengths_round_trip() {
    let folder = folder();
    let path = folder.path().join("scene.toml");
    let text = ALL
        .replace("wavelengths_nm = [550]", "wavelengths_nm = [450, 550, 660]")
        .replace("resolution = [20, 12]", "resolution = [20, 20]")
        .replace("irradiance = 2.5", "irradiance = [2, 3, 4]")
        .replace("intensity = 4", "intensity = [1, 0, 2]")
        .replace("ior = \"N-BK7\"", "ior = 1.5")
        .replace("ior = 1.4,", "ior = [1.41, 1.4, 1.39],");
    let export = exported(folder.path(), &text).unwrap();
    export.write(&folder.path().join("out"), false).unwrap();
    let xml = folder.path().join("out/scene.xml");
    let back = Import::load(&xml, &path, &BTreeMap::new()).unwrap();
    let (a, b) = (
        sunstone::scene::from_text(&path, &text).unwrap(),
        sunstone::scene::from_text(&path, &back.toml).unwrap(),
    );
    assert_same(&a, &b);
    // With a single wavelength, the export contains the scene at that wavelength.
    let one = Export::from_text(&path, &text, Some(450.0)).unwrap();
    assert!(!one.xml.contains("450:"), "plain numbers for mono variants");
    assert!(one.xml.contains("name=\"intensity\" value=\"1\""), "{}", one.xml);
}

#[test]
fn the_mirror_room_round_trips() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("scenes/mirror_room/scene.toml");
    let export = Export::load(&path, None).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("room");
    export.write(&out, false).unwrap();
    let toml = folder.path().join("back.toml");
    let back = Import::load(&out.join("scene.xml"), &toml, &BTreeMap::new()).unwrap();
    back.write(&toml, false).unwrap();
    // The material of the knot has correlated masking in the scene, but Mitsuba's masking is separable.
    let text = std::fs::read_to_string(&path)
        .unwrap()
        .replace("alpha = 0.18", "alpha = 0.18, masking = \"separable\"");
    let (hits, _) = assert_same(
        &sunstone::scene::from_text(&path, &text).unwrap(),
        &sunstone::scene::load(&toml).unwrap(),
    );
    assert!(hits > 1000, "{hits}");
    assert!(back.write(&toml, false).is_err(), "it is there already");
}

#[test]
fn text_and_value_of_an_import_agree() {
    let folder = folder();
    let out = folder.path().join("out");
    exported(folder.path(), ALL).unwrap().write(&out, false).unwrap();
    let toml = folder.path().join("scene.toml");
    let back = Import::load(&out.join("scene.xml"), &toml, &BTreeMap::new()).unwrap();
    let read: SceneFile = toml::from_str(&back.toml).unwrap();
    assert_eq!(read, back.scene);
    assert!(back.toml.starts_with("# Written by sunstone import from scene.xml.\n"));
}
