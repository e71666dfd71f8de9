//! Tests the output of `export --mitsuba` and `import`. Tests that refused commands write nothing.

use crate::harness::{MIRROR_ROOM, edit, files, mirror_room, run, stderr};

#[test]
fn a_scene_round_trips_through_mitsuba() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let out = run(at, &["export", MIRROR_ROOM, "--mitsuba", "out"], 0);
    assert!(
        stderr(&out).contains("note: material `gold`: Mitsuba uses separable masking"),
        "{}",
        stderr(&out)
    );
    let written = files(&at.join("out"));
    assert_eq!(written.len(), 5, "four meshes and the scene: {:?}", written.keys());
    // The command keeps existing files unless the user requests their replacement.
    let out = run(at, &["export", MIRROR_ROOM, "--mitsuba", "out", "--wavelength", "550"], 2);
    assert!(stderr(&out).contains("--force"), "{}", stderr(&out));
    assert_eq!(files(&at.join("out")), written);
    run(at, &["export", MIRROR_ROOM, "--mitsuba", "out", "--wavelength", "550", "--force"], 0);
    let xml = std::fs::read_to_string(at.join("out/scene.xml")).expect("the scene");
    assert!(xml.contains("name=\"wavelengths_nm\" value=\"550\""), "{xml}");
    run(at, &["import", "out/scene.xml"], 0);
    run(at, &["import", "out/scene.xml"], 2);
    // A scene file in another folder contains file paths relative to the folder of the scene file.
    run(at, &["import", "out/scene.xml", "-o", "room.toml"], 0);
    let toml = std::fs::read_to_string(at.join("room.toml")).expect("the scene file");
    assert!(toml.contains("file = \"out/mesh_007.ply\""), "{toml}");
    run(at, &["render", "room.toml", "--spp", "1", "-o", "room.zarr"], 0);
}

#[test]
fn refusals_write_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let text = mirror_room(8, 8, 1, 8, "");
    let crystal = edit(
        &text,
        "glass.dielectric = { ior = 1.5185 }",
        "glass.crystal = { name = \"quartz\", axis = [0, 0, 1] }",
    );
    std::fs::write(at.join("scene.toml"), crystal).expect("a file");
    let before = files(at);
    let out = run(at, &["export", "scene.toml", "--mitsuba", "out"], 2);
    let message = stderr(&out);
    assert!(message.contains("Mitsuba cannot express a crystal (material `glass`)"), "{message}");
    assert!(message.contains("scene.toml:") && message.contains("fix:"), "{message}");
    assert_eq!(files(at), before);
    assert!(!at.join("out").exists());
    std::fs::write(at.join("a.xml"), "<scene version=\"3.0.0\">\n  <shape type=\"sphere\"/>\n</scene>")
        .expect("a file");
    let out = run(at, &["import", "a.xml"], 2);
    assert!(stderr(&out).contains("a.xml:1:1: the scene has no sensor"), "{}", stderr(&out));
    assert!(!at.join("a.toml").exists());
    run(at, &["export", "scene.toml"], 2);
    run(at, &["import", "missing.xml"], 2);
}
