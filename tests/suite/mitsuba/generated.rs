//! Tests the import of shapes that become mesh files next to the scene file: curves and signed-distance
//! grids.

use super::{imported, imported_whole};
use glam::Vec3A;
use std::collections::BTreeMap;
use std::path::Path;
use sunstone::scene::mitsuba::import::Import;
use sunstone::transport::geometry::ray::{Ray, Surface};
use sunstone::transport::scene::Scene;

const CURVE: &str = "0 0 0 0.5\n1 0 0 0.5\n2 0 0 0.5\n3 0 0 0.5\n";

/// Returns a scene of one shape.
fn text(shape: &str) -> String {
    format!(
        "<scene version=\"3.0.0\"><sensor type=\"perspective\"/><emitter type=\"constant\"/>{shape}</scene>"
    )
}

/// Writes the files of an import and reads the written files. Returns the resulting scene.
fn written(folder: &Path, import: &Import) -> Scene {
    let toml = folder.join("scene.toml");
    import.write(&toml, true).unwrap();
    sunstone::scene::from_text(&toml, &import.toml).unwrap()
}

fn met(scene: &Scene, origin: [f32; 3], dir: [f32; 3]) -> Option<(f32, Surface)> {
    let ray = Ray { origin: Vec3A::from_array(origin), dir: Vec3A::from_array(dir) };
    let hit = scene.geometry.intersect(&ray, 100.0)?;
    Some((hit.t, scene.geometry.surface(&ray, &hit)))
}

/// Returns a grid of 9 x 9 x 9 signed distances from a sphere of radius 0.3 around the centre of the unit
/// cube.
fn sphere() -> Vec<u8> {
    let mut out = b"VOL\x03".to_vec();
    [1_i32, 9, 9, 9, 1].iter().for_each(|v| out.extend(v.to_le_bytes()));
    [0.0_f32, 0.0, 0.0, 1.0, 1.0, 1.0].iter().for_each(|v| out.extend(v.to_le_bytes()));
    for i in 0..729 {
        let at = [i % 9, i / 9 % 9, i / 81].map(|k| k as f32 / 8.0 - 0.5);
        let distance = at.iter().map(|v| v * v).sum::<f32>().sqrt() - 0.3;
        out.extend(distance.to_le_bytes());
    }
    out
}

/// Tests that `to_world` moves points but does not scale radii, as in Mitsuba's `bsplinecurve` and
/// `linearcurve`.
#[test]
fn curves_become_tubes_of_their_radius() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("curve.txt"), CURVE).unwrap();
    let shape = |kind: &str| {
        text(&format!(
            "<shape type=\"{kind}\" id=\"hair\"><string name=\"filename\" value=\"curve.txt\"/>\
             <transform name=\"to_world\"><scale x=\"2\" y=\"3\" z=\"3\"/></transform></shape>"
        ))
    };
    for (kind, ends) in [("bsplinecurve", [2.0, 4.0]), ("linearcurve", [-0.5, 6.5])] {
        let import = imported(folder.path(), &shape(kind)).unwrap();
        assert!(import.files.contains_key("scene_hair.ply"), "{:?}", import.files.keys());
        assert!(import.notes.iter().any(|n| n.contains("triangles")), "{:?}", import.notes);
        let scene = written(folder.path(), &import);
        let (t, at) = met(&scene, [3.0, 0.05, 9.0], [0.0, 0.0, -1.0]).unwrap();
        assert!((t - 8.5).abs() < 0.01 && at.ns.z > 0.98, "{kind} {t} {at:?}");
        for (end, inward) in ends.into_iter().zip([0.05, -0.05]) {
            let seen = |x: f32| met(&scene, [x, 0.01, 9.0], [0.0, 0.0, -1.0]).is_some();
            assert!(seen(end + inward) && !seen(end - inward), "{kind} {end}");
        }
    }
}

/// Tests that equal shapes use the same file. Tests that a scene without generated shapes has no files.
#[test]
fn equal_shapes_share_a_file() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("curve.txt"), CURVE).unwrap();
    let shape = "<shape type=\"linearcurve\"><string name=\"filename\" value=\"curve.txt\"/></shape>";
    let moved =
        shape.replace("<string", "<transform name=\"to_world\"><translate y=\"4\"/></transform><string");
    let import = imported(folder.path(), &text(&[shape, shape, &moved].concat())).unwrap();
    let names: Vec<&String> = import.files.keys().collect();
    assert_eq!(names, ["scene_linearcurve.ply", "scene_linearcurve_2.ply"]);
    let toml = folder.path().join("scene.toml");
    import.write(&toml, false).unwrap();
    std::fs::remove_file(&toml).unwrap();
    assert!(import.write(&toml, false).is_err() && !toml.exists());
}

#[test]
fn grids_of_distances_become_their_surface() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("ball.vol"), sphere()).unwrap();
    // Along the common edge of four cells, the gradient of each cell deviates by 0.2 in two directions.
    for (normals, least) in [("", -0.999), ("<string name=\"normals\" value=\"analytic\"/>", -0.95)] {
        let shape = format!(
            "<shape type=\"sdfgrid\"><string name=\"filename\" value=\"ball.vol\"/>{normals}\
             <transform name=\"to_world\"><scale value=\"2\"/><translate x=\"1\"/></transform></shape>"
        );
        let import = imported(folder.path(), &text(&shape)).unwrap();
        let scene = written(folder.path(), &import);
        for dir in [[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0_f32]] {
            let origin = [2.0 - 5.0 * dir[0], 1.0 - 5.0 * dir[1], 1.0 - 5.0 * dir[2]];
            let (t, at) = met(&scene, origin, dir).unwrap();
            assert!((t - 4.4).abs() < 0.01 && at.ns.dot(Vec3A::from_array(dir)) < least, "{t} {at:?}");
        }
    }
    let textured = "<shape type=\"sdfgrid\"><string name=\"filename\" value=\"ball.vol\"/><emitter type=\"area\"/></shape>";
    let e = imported(folder.path(), &text(textured)).unwrap_err();
    assert!(e.to_string().contains("unsupported emitter"), "{e}");
}

/// Tests that each message states the location in the scene, the file and the fault.
#[test]
fn broken_curves_and_grids_are_refused_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("curve.txt"), "0 0 0 1\n1 0 0 -1\n").unwrap();
    std::fs::write(folder.path().join("ball.vol"), &sphere()[..900]).unwrap();
    for (kind, file, expected) in [
        ("linearcurve", "curve.txt", "curve.txt:2"),
        ("linearcurve", "none.txt", "none.txt"),
        ("bsplinecurve", "curve.txt", "at least 0"),
        ("sdfgrid", "ball.vol", "the 213 values"),
        ("sdfgrid", "curve.txt", "does not start"),
    ] {
        let shape = format!("\n<shape type=\"{kind}\"><string name=\"filename\" value=\"{file}\"/></shape>");
        let e = imported_whole(folder.path(), &text(&shape)).unwrap_err().to_string();
        assert!(e.contains("scene.xml:2") && e.contains(expected), "{e}");
    }
}

/// Tests the import of a Python dictionary whose files are in memory.
#[test]
fn files_in_memory_are_imported() {
    let files: BTreeMap<String, Vec<u8>> = [("curve.txt".to_owned(), CURVE.into())].into();
    let shape = text("<shape type=\"bsplinecurve\"><string name=\"filename\" value=\"curve.txt\"/></shape>");
    let (xml, toml) = (Path::new("/nowhere/scene.xml"), Path::new("/nowhere/scene.toml"));
    let import = Import::with_files(xml, &shape, toml, &BTreeMap::new(), &files).unwrap();
    assert_eq!(import.files.len(), 1);
}
