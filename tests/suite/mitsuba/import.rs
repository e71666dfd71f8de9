//! Scenes that people write for Mitsuba: what is read, and what is told with its place.

use super::{ALL, exported, imported, imported_whole};
use glam::Vec3A;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use sunstone::scene::mitsuba::import::Import;
use sunstone::transport::geometry::ray::Ray;

/// A scene as a person writes it.
const HAND: &str = r#"<scene version="3.0.0">
    <default name="fov" value="30"/>
    <integrator type="path"><integer name="max_depth" value="5"/></integrator>
    <sensor type="perspective">
        <float name="fov" value="$fov"/>
        <string name="fov_axis" value="smaller"/>
        <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="16"/><rfilter type="gaussian"/></film>
    </sensor>
    <bsdf type="twosided" id="wall"><bsdf type="diffuse"><rgb name="reflectance" value="0.1, 0.2, 0.3"/></bsdf></bsdf>
    <bsdf type="conductor" id="gold"><string name="material" value="Au"/></bsdf>
    <shape type="sphere"><point name="center" x="1" y="2" z="0"/><float name="radius" value="0.5"/><ref id="gold"/></shape>
    <shape type="rectangle" id="plate">
        <transform name="to_world"><scale x="2"/><rotate z="1" angle="90"/><translate z="-1"/></transform>
        <ref id="wall"/>
    </shape>
    <emitter type="point"><point name="position" value="0, 3, 0"/><spectrum name="intensity" value="400:1, 500:2, 700:4"/></emitter>
</scene>
"#;

#[test]
fn a_scene_by_hand_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let import = imported(folder.path(), HAND).unwrap();
    let scene = sunstone::scene::from_text(&folder.path().join("scene.toml"), &import.toml).unwrap();
    // The vertical field of view is the smaller one: 30° over 16 pixels.
    let focal = 8.0 / 15_f64.to_radians().tan();
    assert!((scene.camera.focal.x - focal).abs() < 1e-9);
    assert!(
        (scene.camera.right() - Vec3A::X).length() < 1e-6,
        "image right is +x, seen along -z"
    );
    assert!((scene.camera.axes.y_axis + Vec3A::Y).length() < 1e-6);
    assert_eq!(scene.points[0].intensity.to_array()[..3], [1.5, 2.5, 3.6]);
    assert!(
        import
            .toml
            .contains("[materials.wall.diffuse]\nalbedo = [0.3, 0.2, 0.1]\n"),
        "{}",
        import.toml
    );
    let ray = |x: f32, y: f32| Ray {
        origin: Vec3A::new(x, y, 4.0),
        dir: Vec3A::NEG_Z,
    };
    let depth = |x, y| scene.geometry.intersect(&ray(x, y), 100.0).map(|h| h.t);
    // Scaled along x, then turned: it is tall.
    assert_eq!((depth(0.0, -1.9), depth(-1.1, 0.0)), (Some(5.0), None));
    assert!((depth(1.0, 2.0).unwrap() - 3.5).abs() < 1e-6);
    let define = BTreeMap::from([
        ("fov".to_owned(), "40".to_owned()),
        ("wavelengths_nm".to_owned(), "550".to_owned()),
    ]);
    let (xml, toml) = (folder.path().join("a.xml"), folder.path().join("a.toml"));
    let import = Import::from_text(&xml, HAND, &toml, &define).unwrap();
    assert!(
        import.toml.contains("[materials.wall.diffuse]\nalbedo = [0.2]\n"),
        "{}",
        import.toml
    );
    let unknown = BTreeMap::from([("fow".to_owned(), "40".to_owned())]);
    let e = Import::from_text(&xml, HAND, &toml, &unknown).unwrap_err();
    assert!(e.0[0].message.contains("`fow`"), "{e}");
}

/// A change of [`HAND`], the line of the fault, words of the message.
const UNREADABLE: &[(&str, &str, usize, &str)] = &[
    ("version=\"3.0.0\"", "version=\"0.6.0\"", 1, "version `0.6.0`"),
    ("</scene>", "", 1, "this is no XML"),
    ("type=\"path\"", "type=\"depth\"", 3, "no integrator `depth`"),
    (
        "type=\"perspective\"",
        "type=\"thinlens\"",
        4,
        "no aperture_radius",
    ),
    ("$fov", "$angle", 5, "`$angle` uses a parameter"),
    ("value=\"smaller\"", "value=\"wide\"", 4, "fov_axis is `wide`"),
    ("type=\"diffuse\"", "type=\"hair\"", 10, "no material `hair`"),
    ("0.1, 0.2, 0.3", "0.1, 0.2", 10, "neither one number nor three"),
    ("0.1, 0.2, 0.3", "0.1, 0.2, 1.3", 10, "albedo is 1.3"),
    (
        "name=\"reflectance\"",
        "name=\"reflectence\"",
        10,
        "`reflectence` of bsdf `diffuse`",
    ),
    (
        "value=\"Au\"",
        "value=\"Unobtainium\"",
        11,
        "no optical constants of `Unobtainium`",
    ),
    (
        "<ref id=\"gold\"/>",
        "<ref id=\"golf\"/>",
        12,
        "nothing has the id `golf`",
    ),
    (
        "type=\"sphere\"",
        "type=\"serialized\"",
        12,
        "no shape `serialized`",
    ),
    (
        "name=\"radius\"",
        "name=\"radios\"",
        12,
        "`radios` of shape `sphere`",
    ),
    (
        "x=\"1\" y=\"2\" z=\"0\"",
        "x=\"1\" y=\"two\" z=\"0\"",
        12,
        "`y` is not a number",
    ),
    (
        "<ref id=\"gold\"/>",
        "<emitter type=\"directionalarea\"/>",
        12,
        "no shapes with an emitter `directionalarea`",
    ),
    ("<scale x=\"2\"/>", "<scale x=\"0\"/>", 13, "squashes it flat"),
    ("<scale x=\"2\"/>", "<shear x=\"2\"/>", 14, "cannot hold <shear>"),
    ("400:1", "480:1", 17, "says nothing of 450 nm"),
    ("type=\"point\"", "type=\"sunsky\"", 17, "no emitter `sunsky`"),
    ("id=\"gold\"", "id=\"wall\"", 11, "id `wall` is given twice"),
    ("id=\"plate\"", "ID=\"plate\"", 13, "no attribute `ID`"),
    (
        "<bsdf type=\"twosided\"",
        "<include filename=\"x.xml\"/><bsdf type=\"twosided\"",
        10,
        "cannot read",
    ),
    (
        "<sensor type",
        "<phase type=\"hg\"/><sensor type",
        4,
        "cannot express a phase",
    ),
];

#[test]
fn what_is_not_understood_is_told_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let mut wrong = vec![];
    for (from, to, line, message) in UNREADABLE {
        let text = HAND.replacen(from, to, 1);
        assert_ne!(text, HAND, "{from}");
        match imported(folder.path(), &text) {
            Err(e) if e.message.contains(message) && e.line_column().is_some_and(|p| p.0 == *line) => {
                assert!(e.help.is_some() && e.file.ends_with("scene.xml"), "{e}");
            }
            other => wrong.push((*message, *line, other.map(|i| i.toml).map_err(|e| e.to_string()))),
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    // A circle of references, and elements nested without end.
    let text = HAND.replace("<rgb name=\"reflectance\" value=\"0.1, 0.2, 0.3\"/>", "");
    let text = text.replace(
        "<bsdf type=\"diffuse\">",
        "<bsdf type=\"blendbsdf\"><float name=\"weight\" value=\"0.5\"/><ref id=\"wall\"/><ref id=\"gold\"/>",
    );
    let e = imported(folder.path(), &text).unwrap_err();
    assert!(e.message.contains("made of itself"), "{e}");
    let deep = "<bsdf type=\"twosided\">".repeat(50_000) + &"</bsdf>".repeat(50_000);
    let e = imported(folder.path(), &HAND.replace("</scene>", &(deep + "</scene>"))).unwrap_err();
    assert!(e.message.contains("nested too deeply"), "{}", e.message);
}

/// Whatever else is wrong does not hide a fault: all are told, each at its line, in order.
#[test]
fn all_problems_are_told_at_once() {
    let folder = tempfile::tempdir().unwrap();
    // Faults in elements of their own, from top to bottom.
    let faults: Vec<_> = [3, 4, 10, 11, 12, 14, 17]
        .into_iter()
        .filter_map(|line| UNREADABLE.iter().find(|f| f.2 == line))
        .collect();
    assert_eq!(faults.len(), 7);
    let mut text = HAND.to_owned();
    for (from, to, ..) in &faults {
        text = text.replacen(from, to, 1);
    }
    let e = imported_whole(folder.path(), &text).unwrap_err();
    let told: Vec<_> =
        e.0.iter()
            .filter_map(|e| Some((e.line_column()?.0, e.message.clone())))
            .collect();
    for (_, _, line, message) in &faults {
        assert!(
            told.iter().any(|(l, m)| l == line && m.contains(message)),
            "{message}: {told:#?}"
        );
    }
    assert!(told.is_sorted_by_key(|t| t.0), "{told:#?}");
}

#[test]
fn one_sided_is_black_behind() {
    let folder = tempfile::tempdir().unwrap();
    let import = imported(
        folder.path(),
        &HAND.replace("<ref id=\"wall\"/>", "<ref id=\"gold\"/>"),
    )
    .unwrap();
    assert!(
        import
            .toml
            .contains("[materials.gold.two_sided]\nfront = \"gold_front\""),
        "{}",
        import.toml
    );
    let import = imported(folder.path(), &HAND.replace("<ref id=\"wall\"/>", "")).unwrap();
    assert!(
        import
            .toml
            .contains("[materials.mitsuba_default.two_sided]\nfront"),
        "{}",
        import.toml
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    /// Whatever happens to a file, the answer is a scene or an error.
    #[test]
    fn broken_files_do_no_harm(
        whole in any::<bool>(),
        cuts in prop::collection::vec((any::<prop::sample::Index>(), 0_usize..30, "[<>/\"=a-z0-9$ .-]{0,6}"), 1..4),
    ) {
        let folder = Path::new("nowhere");
        let mut text: Vec<char> = if whole {
            HAND.chars().collect()
        } else {
            let small = ALL.split("[materials]").next().unwrap_or_default().to_owned() + "[materials]\n";
            exported(folder, &small).unwrap().xml.chars().collect()
        };
        for (at, length, new) in cuts {
            let at = at.index(text.len());
            let end = (at + length).min(text.len());
            text.splice(at..end, new.chars());
        }
        let text: String = text.into_iter().collect();
        if let Err(e) = imported_whole(folder, &text) {
            prop_assert!(!e.0.is_empty() && e.0.iter().all(|e| !e.message.is_empty() && e.help.is_some()));
        }
    }
}

#[test]
fn flipped_rectangles_face_the_other_way() {
    let folder = tempfile::tempdir().unwrap();
    let flipped = "<boolean name=\"flip_normals\" value=\"true\"/><ref id=\"wall\"/>";
    for (text, expected) in [
        (HAND.to_owned(), Vec3A::Z),
        (HAND.replace("<ref id=\"wall\"/>", flipped), Vec3A::NEG_Z),
    ] {
        let import = imported(folder.path(), &text).unwrap();
        let scene = sunstone::scene::from_text(&folder.path().join("scene.toml"), &import.toml).unwrap();
        let ray = Ray {
            origin: Vec3A::Z,
            dir: Vec3A::NEG_Z,
        };
        let hit = scene.geometry.intersect(&ray, 100.0).unwrap();
        let at = scene.geometry.surface(&ray, &hit);
        assert!((at.ng - expected).length() < 1e-6 && (at.ns - expected).length() < 1e-6);
    }
    let ball = HAND.replace(
        "<ref id=\"gold\"/>",
        "<boolean name=\"flip_normals\" value=\"true\"/>",
    );
    let e = imported(folder.path(), &ball).unwrap_err();
    assert!(e.message.contains("inside out"), "{e}");
}
