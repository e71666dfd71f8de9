//! Tests the import of hand-written Mitsuba scenes: the imported contents, and errors with their locations.

use super::{ALL, built, exported, imported, imported_whole};
use glam::Vec3A;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use sunstone::scene::mitsuba::import::Import;
use sunstone::scene::syntax::values::TimeFile;
use sunstone::transport::geometry::ray::Ray;

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
fn a_handwritten_scene_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let (import, scene) = built(folder.path(), HAND);
    // The vertical field of view is 30° over 16 pixels, and is smaller than the horizontal field of view.
    let focal = 8.0 / 15_f64.to_radians().tan();
    assert!((scene.camera.focal.x - focal).abs() < 1e-9);
    assert!((scene.camera.axes.x_axis - Vec3A::X).length() < 1e-6, "image right is +x, seen along -z");
    assert!((scene.camera.axes.y_axis + Vec3A::Y).length() < 1e-6);
    assert_eq!(scene.points[0].intensity.to_array()[..3], [1.5, 2.5, 3.6]);
    assert!(import.toml.contains("[materials.wall.diffuse]\nalbedo = [0.3, 0.2, 0.1]\n"), "{}", import.toml);
    let ray = |x: f32, y: f32| Ray { origin: Vec3A::new(x, y, 4.0), dir: Vec3A::NEG_Z };
    let depth = |x, y| scene.geometry.intersect(&ray(x, y), 100.0).map(|h| h.t);
    // The shape is scaled along x and then rotated, so the shape is tall.
    assert_eq!((depth(0.0, -1.9), depth(-1.1, 0.0)), (Some(5.0), None));
    assert!((depth(1.0, 2.0).unwrap() - 3.5).abs() < 1e-6);
    let define = BTreeMap::from([
        ("fov".to_owned(), "40".to_owned()),
        ("wavelengths_nm".to_owned(), "550".to_owned()),
    ]);
    let (xml, toml) = (folder.path().join("a.xml"), folder.path().join("a.toml"));
    let import = Import::from_text(&xml, HAND, &toml, &define).unwrap();
    assert!(import.toml.contains("[materials.wall.diffuse]\nalbedo = [0.2]\n"), "{}", import.toml);
    let unknown = BTreeMap::from([("fow".to_owned(), "40".to_owned())]);
    let e = Import::from_text(&xml, HAND, &toml, &unknown).unwrap_err();
    assert!(e.0[0].message.contains("`fow`"), "{e}");
}

/// For each fault, a passage of [`HAND`], the replacement of the passage, the line of the fault, and words of
/// the message.
const UNREADABLE: &[(&str, &str, usize, &str)] = &[
    ("version=\"3.0.0\"", "version=\"4.0.0\"", 1, "version `4.0.0`"),
    ("</scene>", "", 1, "invalid XML"),
    ("type=\"path\"", "type=\"depth\"", 3, "unsupported integrator `depth`"),
    ("type=\"perspective\"", "type=\"thinlens\"", 4, "no aperture_radius"),
    ("$fov", "$angle", 5, "`$angle` uses an undefined parameter"),
    ("value=\"smaller\"", "value=\"wide\"", 4, "fov_axis is `wide`"),
    ("type=\"diffuse\"", "type=\"hair\"", 10, "unsupported bsdf `hair`"),
    ("0.1, 0.2, 0.3", "0.1, 0.2", 10, "not one or three numbers"),
    ("0.1, 0.2, 0.3", "0.1, 0.2, 1.3", 10, "albedo is 1.3"),
    ("name=\"reflectance\"", "name=\"reflectence\"", 10, "`reflectence` of bsdf `diffuse`"),
    ("value=\"Au\"", "value=\"Unobtainium\"", 11, "unknown optical constants `Unobtainium`"),
    ("<ref id=\"gold\"/>", "<ref id=\"golf\"/>", 12, "unknown id `golf`"),
    ("type=\"sphere\"", "type=\"ellipsoids\"", 12, "unsupported shape `ellipsoids`"),
    ("name=\"radius\"", "name=\"radios\"", 12, "`radios` of shape `sphere`"),
    ("x=\"1\" y=\"2\" z=\"0\"", "x=\"1\" y=\"two\" z=\"0\"", 12, "`y` is not a number"),
    (
        "<ref id=\"gold\"/>",
        "<emitter type=\"directionalarea\"/>",
        12,
        "unsupported emitter `directionalarea`",
    ),
    (
        "<ref id=\"gold\"/>",
        "<medium type=\"homogeneous\" name=\"interior\"/><medium type=\"homogeneous\" name=\"interior\"/>",
        12,
        "a second medium",
    ),
    ("<scale x=\"2\"/>", "<scale x=\"0\"/>", 13, "zero extent"),
    ("<scale x=\"2\"/>", "<shear x=\"2\"/>", 14, "cannot contain <shear>"),
    ("400:1", "480:1", 17, "does not cover 450 nm"),
    ("type=\"point\"", "type=\"sunsky\"", 17, "unsupported emitter `sunsky`"),
    ("id=\"gold\"", "id=\"wall\"", 11, "id `wall` is used more than once"),
    ("id=\"plate\"", "ID=\"plate\"", 13, "unknown attribute `ID`"),
    ("<bsdf type=\"twosided\"", "<include filename=\"x.xml\"/><bsdf type=\"twosided\"", 10, "cannot read"),
];

#[test]
fn unsupported_items_are_reported_with_their_position() {
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
    // Tests references that form a cycle, and elements that are nested endlessly.
    let text = HAND.replace("<rgb name=\"reflectance\" value=\"0.1, 0.2, 0.3\"/>", "");
    let text = text.replace(
        "<bsdf type=\"diffuse\">",
        "<bsdf type=\"blendbsdf\"><float name=\"weight\" value=\"0.5\"/><ref id=\"wall\"/><ref id=\"gold\"/>",
    );
    let e = imported(folder.path(), &text).unwrap_err();
    assert!(e.message.contains("refers to itself"), "{e}");
    let deep = "<bsdf type=\"twosided\">".repeat(50_000) + &"</bsdf>".repeat(50_000);
    let e = imported(folder.path(), &HAND.replace("</scene>", &(deep + "</scene>"))).unwrap_err();
    assert!(e.message.contains("nested too deeply"), "{}", e.message);
}

/// Tests that the import reports all faults in order, each with the line of the fault.
#[test]
fn all_errors_are_reported_at_once() {
    let folder = tempfile::tempdir().unwrap();
    // The faults are in separate elements, from top to bottom.
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
    let answer: Vec<_> = e.0.iter().filter_map(|e| Some((e.line_column()?.0, e.message.clone()))).collect();
    for (_, _, line, message) in &faults {
        assert!(answer.iter().any(|(l, m)| l == line && m.contains(message)), "{message}: {answer:#?}");
    }
    assert!(answer.is_sorted_by_key(|t| t.0), "{answer:#?}");
}

#[test]
fn one_sided_materials_are_black_behind() {
    let folder = tempfile::tempdir().unwrap();
    let import = imported(folder.path(), &HAND.replace("<ref id=\"wall\"/>", "<ref id=\"gold\"/>")).unwrap();
    assert!(import.toml.contains("[materials.gold.two_sided]\nfront = \"gold_front\""), "{}", import.toml);
    let import = imported(folder.path(), &HAND.replace("<ref id=\"wall\"/>", "")).unwrap();
    assert!(import.toml.contains("[materials.mitsuba_default.two_sided]\nfront"), "{}", import.toml);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    /// Tests that the import of a damaged file gives a scene or an error, for any damage.
    #[test]
    fn damaged_files_never_panic(
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
    for (text, expected) in
        [(HAND.to_owned(), Vec3A::Z), (HAND.replace("<ref id=\"wall\"/>", flipped), Vec3A::NEG_Z)]
    {
        let (_, scene) = built(folder.path(), &text);
        let ray = Ray { origin: Vec3A::Z, dir: Vec3A::NEG_Z };
        let hit = scene.geometry.intersect(&ray, 100.0).unwrap();
        let at = scene.geometry.surface(&ray, &hit);
        assert!((at.ng - expected).length() < 1e-6 && (at.ns - expected).length() < 1e-6);
    }
}

/// Returns 1 if the normals of a shape that is hit from outside point toward the ray's origin, and -1 if the
/// normals point away.
fn facing(folder: &Path, shape: &str) -> f32 {
    let text = format!(
        "<scene version=\"3.0.0\"><sensor type=\"perspective\"/><emitter type=\"constant\"/>{shape}</scene>"
    );
    let (_, scene) = built(folder, &text);
    let ray = Ray { origin: Vec3A::new(0.1, 0.05, 9.0), dir: Vec3A::NEG_Z };
    let hit = scene.geometry.intersect(&ray, 100.0).unwrap();
    let at = scene.geometry.surface(&ray, &hit);
    assert!(at.ng.dot(at.ns) > 0.0, "{at:?}");
    -at.ns.dot(ray.dir).signum()
}

/// A pyramid whose tip points toward +z.
const TENT: &str = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv 0 0 1\n";
const TENT_FACES: &str = "f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n";

/// Compares the orientations of shapes with Mitsuba 3.9.1 (the shading normals of `scene.ray_intersect`).
/// Mirroring reverses the normals of spheres and of meshes with computed normals, but of no other shapes.
/// `flip_normals` reverses the normals of all shapes.
#[test]
fn mirrors_and_flips_orient_shapes_as_in_mitsuba() {
    let folder = tempfile::tempdir().unwrap();
    let with_normals = format!("{TENT}vn -1 -1 1\nvn 1 -1 1\nvn 1 1 1\nvn -1 1 1\nvn 0 0 1\n")
        + "f 1//1 2//2 5//5\nf 2//2 3//3 5//5\nf 3//3 4//4 5//5\nf 4//4 1//1 5//5\n";
    std::fs::write(folder.path().join("bare.obj"), format!("{TENT}{TENT_FACES}")).unwrap();
    std::fs::write(folder.path().join("normals.obj"), with_normals).unwrap();
    // Each case has the content of the element, and the signs for no scale, x = -1, z = -1, and -1 for all
    // three axes.
    let bare = "<string name=\"filename\" value=\"bare.obj\"/>";
    let normals = "<string name=\"filename\" value=\"normals.obj\"/>";
    let flat = format!("{normals}<boolean name=\"face_normals\" value=\"true\"/>");
    let cases: [(&str, &str, [f32; 4]); 8] = [
        ("sphere", "", [1.0, -1.0, -1.0, -1.0]),
        (
            "cylinder",
            "<point name=\"p0\" x=\"0\" y=\"-1\" z=\"0\"/><point name=\"p1\" x=\"0\" y=\"1\" z=\"0\"/>",
            [1.0; 4],
        ),
        ("disk", "", [1.0, 1.0, -1.0, -1.0]),
        ("rectangle", "", [1.0, 1.0, -1.0, -1.0]),
        ("cube", "", [1.0; 4]),
        ("obj", bare, [1.0, -1.0, -1.0, -1.0]),
        ("obj", normals, [1.0; 4]),
        ("obj", &flat, [1.0, -1.0, -1.0, -1.0]),
    ];
    for (kind, inside, signs) in cases {
        let scales = ["x=\"1\"", "x=\"-1\"", "z=\"-1\"", "x=\"-1\" y=\"-1\" z=\"-1\""];
        for (scale, sign) in scales.into_iter().zip(signs) {
            for (flip, turned) in [("false", 1.0), ("true", -1.0)] {
                // If mirroring turns a pyramid downwards, the ray hits the pyramid from below, through its
                // open base.
                let up = if kind == "obj" && scale.contains("z=") {
                    "<rotate x=\"1\" angle=\"180\"/>"
                } else {
                    ""
                };
                let shape = format!(
                    "<shape type=\"{kind}\">{inside}<boolean name=\"flip_normals\" value=\"{flip}\"/>\
                     <transform name=\"to_world\"><scale {scale}/>{up}</transform></shape>"
                );
                assert_eq!(facing(folder.path(), &shape), sign * turned, "{shape}");
            }
        }
    }
}

/// Tests that meshes without normals are smooth, unless `face_normals` is set. Where two faces form a right
/// angle, the normal at the edge is directed between the two face normals.
#[test]
fn meshes_without_normals_are_smooth_as_in_mitsuba() {
    let folder = tempfile::tempdir().unwrap();
    let roof = "v -1 0 -1\nv 0 1 -1\nv 0 1 1\nv -1 0 1\nv 1 0 -1\nv 1 0 1\n\
                o a\nusemtl x\nf 1 4 3 2\no b\nusemtl y\nf 2 3 6 5\n";
    std::fs::write(folder.path().join("roof.obj"), roof).unwrap();
    let normal = |more: &str| {
        let text = format!(
            "<scene version=\"3.0.0\"><sensor type=\"perspective\"/><emitter type=\"constant\"/><shape type=\"obj\">\
             <string name=\"filename\" value=\"roof.obj\"/>{more}</shape></scene>"
        );
        let (_, scene) = built(folder.path(), &text);
        let ray = Ray { origin: Vec3A::new(-0.01, 5.0, 0.2), dir: Vec3A::NEG_Y };
        let hit = scene.geometry.intersect(&ray, 100.0).unwrap();
        scene.geometry.surface(&ray, &hit).ns
    };
    // The expected normal is that of Mitsuba 3.9.1, although the faces belong to two groups.
    let expected = Vec3A::new(-0.007_091_65, 0.999_975, 0.0);
    assert!((normal("") - expected).length() < 1e-5, "{}", normal(""));
    let flat = normal("<boolean name=\"face_normals\" value=\"true\"/>");
    assert!((flat - Vec3A::new(-1.0, 1.0, 0.0).normalize()).length() < 1e-6, "{flat}");
}

/// Tests that the import upgrades names of Mitsuba 0.x to those of Mitsuba 3, with a note. Each included file
/// is read according to the version in that file.
#[test]
fn old_files_are_upgraded() {
    let folder = tempfile::tempdir().unwrap();
    let new = HAND.to_owned();
    let old = [
        ("version=\"3.0.0\"", "version=\"0.6.0\""),
        ("to_world", "toWorld"),
        ("fov_axis", "fovAxis"),
        ("max_depth", "maxDepth"),
        ("<lookat", "<lookAt"),
    ]
    .iter()
    .fold(new.clone(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    });
    let [a, b] = [&new, &old].map(|text| imported(folder.path(), text).unwrap());
    assert_eq!(a.toml, b.toml);
    assert!(b.notes.iter().any(|n| n.contains("Mitsuba 0.x")) && !a.notes.iter().any(|n| n.contains("0.x")));
    // The old names are unknown in a file of Mitsuba 3.
    let e = imported(folder.path(), &HAND.replace("max_depth", "maxDepth")).unwrap_err();
    assert!(e.message.contains("`maxDepth`"), "{e}");
    let part = "<scene version=\"0.5.0\"><shape type=\"sphere\"><transform name=\"toWorld\"><translate x=\"3\"/>\
                </transform></shape></scene>";
    std::fs::write(folder.path().join("part.xml"), part).unwrap();
    let text = HAND.replace("</scene>", "<include filename=\"part.xml\"/></scene>");
    assert!(imported(folder.path(), &text).unwrap().toml.contains("3.0"));
}

/// Tests the search order if several folders contain a file. The last `<path>` has precedence over earlier
/// `<path>` elements. The import searches the scene's own folder last.
#[test]
fn paths_are_searched_as_in_mitsuba() {
    let folder = tempfile::tempdir().unwrap();
    let scale =
        |k: f32| TENT.replace("-1", &format!("{}", -k)).replace(" 1 ", &format!(" {k} ")) + TENT_FACES;
    for (name, k) in [("", 1.0), ("a", 2.0), ("b", 3.0)] {
        std::fs::create_dir_all(folder.path().join(name)).unwrap();
        std::fs::write(folder.path().join(name).join("tent.obj"), scale(k)).unwrap();
    }
    let tent = "<shape type=\"obj\"><string name=\"filename\" value=\"tent.obj\"/></shape></scene>";
    for (paths, file) in [
        ("", "tent.obj"),
        ("<path value=\"a\"/>", "a/tent.obj"),
        ("<path value=\"a\"/><path value=\"b\"/>", "b/tent.obj"),
    ] {
        let text = HAND.replace("</scene>", &format!("{paths}{tent}"));
        let toml = imported(folder.path(), &text).unwrap().toml;
        assert!(toml.contains(&format!("file = \"{file}\"")), "{paths}: {toml}");
    }
    let e = imported(folder.path(), &HAND.replace("</scene>", "<path value=\"none\"/></scene>")).unwrap_err();
    assert!(e.message.contains("does not exist"), "{e}");
}

/// Tests a rotation about an axis that is not of unit length. The rotation scales and shears as in Mitsuba 3,
/// with a note.
#[test]
fn rotations_about_long_axes_match_mitsuba() {
    let folder = tempfile::tempdir().unwrap();
    let turned = |op: &str| HAND.replace("<rotate z=\"1\" angle=\"90\"/>", op);
    let import = imported(folder.path(), &turned("<rotate x=\"2\" angle=\"90\"/>")).unwrap();
    assert!(import.notes.iter().any(|n| n.contains("<rotate>")), "{:?}", import.notes);
    // The matrix is cos I + sin [a]x + (1 - cos) a aᵀ for a = (2, 0, 0). The matrix scales x by 4 and maps y
    // to 2 z. An earlier transform scales x by 2.
    assert!(
        ["[8.0, 0.0", "[7.99999999999999"].iter().any(|row| import.toml.contains(row)),
        "{}",
        import.toml
    );
    assert!(import.toml.contains("[0.0, 2.0, "), "{}", import.toml);
    let import = imported(folder.path(), HAND).unwrap();
    assert!(!import.notes.iter().any(|n| n.contains("<rotate>")));
    let e = imported(folder.path(), &turned("<rotate angle=\"90\"/>")).unwrap_err();
    assert!(e.message.contains("no axis"), "{e}");
}

/// Tests that a film with a crop window shows the corresponding window of the full film's image.
#[test]
fn cropped_films_are_windows_of_the_whole_image() {
    let folder = tempfile::tempdir().unwrap();
    let crop = "<integer name=\"crop_offset_x\" value=\"5\"/><integer name=\"crop_offset_y\" value=\"3\"/>\
                <integer name=\"crop_width\" value=\"10\"/><integer name=\"crop_height\" value=\"8\"/><rfilter";
    let [whole, part] =
        [HAND.to_owned(), HAND.replace("<rfilter", crop)].map(|text| built(folder.path(), &text).1.camera);
    assert_eq!(part.resolution, [10, 8]);
    assert!((whole.focal - part.focal).length() < 1e-9);
    let moved = whole.principal - part.principal;
    assert!((moved.x - 5.0).abs() < 1e-9 && (moved.y - 3.0).abs() < 1e-9, "{moved}");
    let e =
        imported(folder.path(), &HAND.replace("<rfilter", &crop.replace("\"10\"", "\"28\""))).unwrap_err();
    assert!(e.message.contains("crop window"), "{e}");
}

/// Tests that a film of mitransient becomes a slice of time bins in addition to the image. Tests that
/// integrators of Mitsuba's Python package have a maximum depth of 6.
#[test]
fn transient_films_become_time_bins() {
    let folder = tempfile::tempdir().unwrap();
    let text = HAND
        .replace("type=\"path\"><integer name=\"max_depth\" value=\"5\"/>", "type=\"transient_path\">")
        .replace("type=\"hdrfilm\">", "type=\"transient_hdr_film\"><integer name=\"temporal_bins\" value=\"40\"/>\
            <float name=\"bin_width_opl\" value=\"0.299792458\"/><float name=\"start_opl\" value=\"2.98792458\"/>");
    let import = imported(folder.path(), &text).unwrap();
    let [image, transient] = &import.scene.slices[..] else {
        panic!("{}", import.toml);
    };
    assert_eq!((image.name.as_str(), transient.name.as_str()), ("mueller", "transient"));
    let TimeFile::Bins(bins) = &transient.time else {
        panic!("{}", import.toml);
    };
    // A bin is 1 ns wide. Path lengths start at the near clipping plane, at 0.01 m.
    assert!((*bins.bin_ps - 1000.0).abs() < 1e-6 && (bins.start_ps - 10_000.0).abs() < 1e-6, "{bins:?}");
    assert_eq!((*bins.bins, *import.scene.render.max_depth), (40, 6));
    assert!(import.notes.iter().any(|n| n.contains("near clipping plane")), "{:?}", import.notes);
    let warped = text
        .replace("transient_path\">", "transient_path\"><boolean name=\"camera_unwarp\" value=\"true\"/>");
    let import = imported(folder.path(), &warped).unwrap();
    assert!(import.notes.iter().any(|n| n.contains("camera_unwarp")));
}

/// Tests the approximations of the import. Facets have a single roughness above 0: the square root of the
/// product of the roughnesses along u and v. The import reads numbers in images as luminances.
#[test]
fn anisotropic_roughness_and_encoded_numbers_are_approximated() {
    let folder = tempfile::tempdir().unwrap();
    let squares = |name: &str, a: f64, b: f64| {
        format!(
            r#"<texture type="checkerboard" name="{name}"><float name="color0" value="{a}"/><float name="color1" value="{b}"/></texture>"#
        )
    };
    let number = |name: &str, v: f64| format!(r#"<float name="{name}" value="{v}"/>"#);
    let rough = |inside: String| {
        let bsdf = format!(
            r#"<bsdf type="roughconductor" id="gold"><string name="material" value="a-C"/>{inside}</bsdf>"#
        );
        let (before, after) = HAND.split_once(r#"<bsdf type="conductor" id="gold">"#).unwrap();
        let (_, after) = after.split_once("</bsdf>").unwrap();
        imported(folder.path(), &format!("{before}{bsdf}{after}"))
    };
    for (inside, alpha, note) in [
        (number("alpha_u", 0.25) + &number("alpha_v", 1.0), "alpha = 0.5", "alpha_u and alpha_v"),
        (number("alpha", 0.0), "alpha = 0.001", "alpha below 0.001"),
        (
            squares("alpha_u", 0.25, 0.0625) + &squares("alpha_v", 1.0, 0.25),
            // Mitsuba exchanges the squares of a checkerboard where a number is required.
            "checkerboard = [0.125, 0.5]",
            "alpha_u and alpha_v",
        ),
    ] {
        let import = rough(inside).unwrap();
        assert!(import.toml.contains(alpha), "{}", import.toml);
        assert!(import.notes.iter().any(|n| n.contains(note)), "{:?}", import.notes);
    }
    let mixed = rough(number("alpha_u", 0.1) + &squares("alpha_v", 0.4, 0.9));
    assert!(mixed.unwrap_err().to_string().contains("different textures"));

    std::fs::write(folder.path().join("w.pgm"), b"P5 1 1 255\n\x80").unwrap();
    for (raw, keys) in [("", "luminance = true"), (r#"<boolean name="raw" value="true"/>"#, "raw = true")] {
        let weight = format!(
            r#"<bsdf type="blendbsdf" id="gold"><texture type="bitmap" name="weight"><string name="filename" value="w.pgm"/>{raw}</texture>
            <bsdf type="diffuse"/><bsdf type="diffuse"/></bsdf>"#
        );
        let (before, after) = HAND.split_once(r#"<bsdf type="conductor" id="gold">"#).unwrap();
        let (_, after) = after.split_once("</bsdf>").unwrap();
        let toml = imported(folder.path(), &format!("{before}{weight}{after}")).unwrap().toml;
        assert!(toml.contains(keys) && toml.contains("luminance = true"), "{toml}");
    }
}

/// Tests that the import applies Mitsuba's defaults, such as unlimited path lengths, black emitting surfaces
/// and grey shapes.
#[test]
fn defaults_match_mitsuba() {
    let folder = tempfile::tempdir().unwrap();
    let text =
        HAND.replace("<integrator type=\"path\"><integer name=\"max_depth\" value=\"5\"/></integrator>", "");
    assert_eq!(*imported(folder.path(), &text).unwrap().scene.render.max_depth, 64);
    let bare = |inside: &str| {
        let shape = format!("<shape type=\"sphere\">{inside}</shape></scene>");
        imported(folder.path(), &HAND.replace("</scene>", &shape)).unwrap().toml
    };
    assert!(bare("").contains("albedo = 0.5"));
    let lamp = bare("<emitter type=\"area\"/>");
    assert!(lamp.contains("albedo = 0.0") && !lamp.contains("albedo = 0.5"), "{lamp}");
}

/// Tests that the import adds a note if integrators count path lengths differently.
#[test]
fn thin_glass_under_volumetric_integrators_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let glass = HAND.replace("<ref id=\"gold\"/>", "<bsdf type=\"thindielectric\"/>");
    let noted = |text: &str| {
        let notes = imported(folder.path(), text).unwrap().notes;
        notes.iter().any(|n| n.contains("counts towards max_depth"))
    };
    assert!(!noted(&glass) && !noted(&HAND.replace("\"path\"", "\"volpath\"")));
    assert!(noted(&glass.replace("\"path\"", "\"volpath\"")));
}

/// Tests that references can name any top-level element. Tests that the import adds a note about unreferenced
/// elements.
#[test]
fn references_can_name_any_top_level_element() {
    let folder = tempfile::tempdir().unwrap();
    let text = HAND
        .replace("<film type=\"hdrfilm\"><integer name=\"width\" value=\"32\"/><integer name=\"height\" value=\"16\"/><rfilter type=\"gaussian\"/></film>",
            "<ref id=\"film\"/><ref id=\"sampler\"/>")
        .replace("<ref id=\"gold\"/>", "<ref id=\"gold\"/><ref id=\"lamp\"/>")
        .replace("<sensor", "<rfilter type=\"box\" id=\"filter\"/><sampler type=\"multijitter\" id=\"sampler\">\
            <integer name=\"sample_count\" value=\"77\"/></sampler><film type=\"hdrfilm\" id=\"film\">\
            <integer name=\"width\" value=\"32\"/><integer name=\"height\" value=\"16\"/><ref id=\"filter\"/></film>\
            <emitter type=\"area\" id=\"lamp\"/><sensor");
    let import = imported(folder.path(), &text).unwrap();
    assert_eq!(*import.scene.render.spp, 77);
    assert_eq!(*import.scene.camera.resolution, [32, 16]);
    assert!(import.toml.contains("[objects.emission]"), "{}", import.toml);
    assert!(
        !import.notes.iter().any(|n| n.contains("is not used") || n.contains("box filter")),
        "{:?}",
        import.notes
    );
    let text = text.replace("<ref id=\"gold\"/><ref id=\"lamp\"/>", "<ref id=\"gold\"/>");
    let notes = imported(folder.path(), &text).unwrap().notes;
    assert!(notes.iter().any(|n| n.contains("`lamp`") && n.contains("is not used")), "{notes:?}");
    // Adds a second sensor.
    let two =
        HAND.replace("<bsdf type=\"conductor\"", "<sensor type=\"perspective\"/><bsdf type=\"conductor\"");
    let import = imported(folder.path(), &two).unwrap();
    assert!(import.notes.iter().any(|n| n.contains("several sensors")));
    assert_eq!(*import.scene.camera.resolution, [32, 16]);
}
