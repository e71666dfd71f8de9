//! Tests groups and instances (Mitsuba's `shapegroup` and `instance`) for import and export. Tests files of
//! placements, and the messages of faults.

use super::{exported, imported};
use glam::Vec3A;
use std::collections::BTreeMap;
use std::path::Path;
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::sampling::warp;
use sunstone::scene::mitsuba::import::Import;
use sunstone::transport::geometry::ray::Ray;
use sunstone::transport::scene::Scene;

const HAND: &str = r#"<scene version="3.0.0">
    <integrator type="path"><integer name="max_depth" value="5"/></integrator>
    <sensor type="perspective">
        <float name="fov" value="40"/>
        <transform name="to_world"><lookat origin="0, 0, 9" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="16"/></film>
    </sensor>
    <bsdf type="twosided" id="wall"><bsdf type="diffuse"/></bsdf>
    <shape type="shapegroup" id="tree">
        <shape type="sphere"><point name="center" x="0" y="1" z="0"/><float name="radius" value="0.5"/><ref id="wall"/></shape>
        <shape type="cylinder"><point name="p1" x="0" y="1" z="0"/><float name="radius" value="0.1"/>
            <bsdf type="twosided"><bsdf type="conductor"><string name="material" value="Au"/></bsdf></bsdf></shape>
        <shape type="cube"><transform name="to_world"><scale value="0.2"/><translate x="0.7"/></transform></shape>
    </shape>
    <shape type="instance"><ref id="tree"/></shape>
    <shape type="instance" id="second"><transform name="to_world"><scale x="2" y="0.5"/><rotate z="1" angle="90"/><translate x="3"/></transform><ref id="tree"/></shape>
    <shape type="instance"><transform name="to_world"><scale x="-1"/><translate x="-2" y="-1"/></transform><ref id="tree"/></shape>
    <emitter type="point"><point name="position" value="0, 3, 5"/></emitter>
</scene>
"#;

/// Asserts that rays hit the same surfaces in two scenes. Returns the number of hits.
fn same(a: &Scene, b: &Scene) -> usize {
    let mut stream = Stream::new(31, 0, 0);
    let (mut hits, mut apart) = (0, 0);
    for _ in 0..20_000 {
        let origin = warp::sphere(stream.uniform2()) * 9.0;
        let target = warp::sphere(stream.uniform2()) * 3.0;
        let ray = Ray { origin, dir: (target - origin).normalize() };
        let [p, q] = [a, b].map(|s| {
            let g = &s.geometry;
            g.intersect(&ray, f32::INFINITY).map(|h| g.surface(&ray, &h))
        });
        match (p, q) {
            // In Mitsuba, mirroring reverses the normals of shapes, but not of copies of groups.
            (Some(p), Some(q)) if p.ng.dot(q.ng).abs() > 0.999 => {
                // Away from grazing incidence, rounding errors are small.
                if p.ng.dot(ray.dir).abs() > 0.1 {
                    assert!((p.p - q.p).length() < 1e-4, "{p:?} {q:?}");
                }
                let name = |s: &Scene, m| format!("{:?}", s.materials.list[m as usize]).len();
                assert_eq!(name(a, p.material), name(b, q.material));
                hits += 1;
            }
            (None, None) => {}
            _ => apart += 1,
        }
    }
    assert!(apart < 20, "{apart}");
    hits
}

#[test]
fn shape_groups_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let import = imported(folder.path(), HAND).unwrap();
    assert!(import.toml.contains("[[groups.tree.objects]]"), "{}", import.toml);
    assert_eq!(import.toml.matches("[[instances]]").count(), 3);
    let path = folder.path().join("scene.toml");
    let scene = sunstone::scene::from_text(&path, &import.toml).unwrap();
    assert_eq!(scene.geometry.copies(), (3, 1));
    let meets = |x: f32, y: f32| {
        let ray = Ray { origin: Vec3A::new(x, y, 9.0), dir: Vec3A::NEG_Z };
        scene.geometry.intersect(&ray, 100.0).map(|h| h.t)
    };
    // Tests the spheres of the first tree, of the second tree (on the left, 1 wide and 2 high), and of the
    // third tree.
    assert!((meets(0.0, 1.0).unwrap() - 8.5).abs() < 1e-5);
    assert!(meets(2.5, 0.9).is_some() && meets(2.5, 1.1).is_none() && meets(2.2, 0.0).is_none());
    assert!((meets(-2.0, 0.0).unwrap() - 8.5).abs() < 1e-5);
    // In the mirror image, the cube is on the opposite side.
    assert!(meets(-2.7, -1.0).is_some() && meets(-1.3, -1.0).is_none());
    // Builds the same scene without instances and without uneven scales. Copies apply uneven scales to
    // spheres, but Mitsuba's spheres do not.
    let even = HAND.replace(r#"<scale x="2" y="0.5"/>"#, r#"<scale value="2"/>"#);
    let import = imported(folder.path(), &even).unwrap();
    let scene = sunstone::scene::from_text(&path, &import.toml).unwrap();
    let group =
        &HAND[HAND.find("        <shape type=\"sphere\"").unwrap()..HAND.find("    </shape>\n").unwrap()];
    let start = HAND.find("    <shape type=\"shapegroup\"").unwrap();
    let end = HAND.find("    <emitter").unwrap();
    let cube = r#"<transform name="to_world"><scale value="0.2"/><translate x="0.7"/>"#;
    let places = [
        "",
        r#"<scale value="2"/><rotate z="1" angle="90"/><translate x="3"/>"#,
        r#"<scale x="-1"/><translate x="-2" y="-1"/>"#,
    ];
    let copies: String = places
        .iter()
        .map(|p| {
            let place = format!("<transform name=\"to_world\">{p}</transform>");
            group
                .replace(cube, &format!("{cube}{p}"))
                .replace("<ref id=\"wall\"/></shape>", &format!("{place}<ref id=\"wall\"/></shape>"))
                .replace("</bsdf></bsdf></shape>", &format!("</bsdf></bsdf>{place}</shape>"))
        })
        .collect();
    let text = format!("{}{copies}{}", &HAND[..start], &HAND[end..]);
    let import = imported(folder.path(), &text).unwrap();
    let copied = sunstone::scene::from_text(&path, &import.toml).unwrap();
    assert_eq!(copied.geometry.copies(), (0, 0));
    let hits = same(&scene, &copied);
    assert!(hits > 500, "{hits}");
}

#[test]
fn invalid_groups_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    for (from, to, line, message) in [
        ("<ref id=\"tree\"/></shape>\n", "</shape>\n", 15, "the instance has no shapegroup"),
        ("<ref id=\"tree\"/>", "<ref id=\"wall\"/>", 15, "one shapegroup"),
        ("<ref id=\"tree\"/>", "<ref id=\"bush\"/>", 15, "unknown id `bush`"),
        (
            "<shape type=\"shapegroup\" id=\"tree\">",
            "<shape type=\"shapegroup\" id=\"tree\"><shape type=\"instance\"/>",
            9,
            "a shapegroup cannot contain `instance`",
        ),
        (
            "<shape type=\"shapegroup\" id=\"tree\">",
            "<shape type=\"shapegroup\" id=\"tree\"><ref id=\"wall\"/>",
            9,
            "a bsdf in a shapegroup has no effect",
        ),
        ("<scale x=\"-1\"/>", "<scale x=\"0\"/>", 17, "zero extent"),
        (
            "<shape type=\"instance\"><ref",
            "<shape type=\"shapegroup\" id=\"none\"/><shape type=\"instance\"><ref",
            15,
            "the shapegroup is empty",
        ),
    ] {
        let text = HAND.replacen(from, to, 1);
        assert_ne!(text, HAND, "{from}");
        let e = imported(folder.path(), &text).unwrap_err();
        assert!(e.message.contains(message), "{message}: {e}");
        assert_eq!(e.line_column().unwrap().0, line, "{e}");
    }
}

const SCENE: &str = r#"
wavelengths_nm = [550]
[camera]
resolution = [8, 8]
fov_x_deg = 40
pose.look_at = { origin = [0, 0, 9], target = [0, 0, 0] }
[[emitters]]
point = { position = [1, 2, 3], intensity = 4 }
[materials]
grey.diffuse.albedo = 0.3
tree.conductor.metal = "Au"
[[objects]]
shape.rectangle = { corner = [-4, -4, -2], u = [8, 0, 0], v = [0, 8, 0] }
material = "grey"
[[groups.tree.objects]]
shape.sphere = { center = [0, 1, 0], radius = 0.4 }
material = "tree"
[[groups.tree.objects]]
name = "trunk"
shape.cube = { min = [-0.1, 0, -0.1], max = [0.1, 0.6, 0.1] }
material = "grey"
[[groups.stone.objects]]
shape.sphere = { radius = 0.3 }
material = "grey"
[[instances]]
group = "tree"
places = "trees.txt"
transform.translate = [0.5, 0, 0]
[[instances]]
name = "a stone"
group = "stone"
transform = { scale = [1, -2, 0.5], rotate_deg = [0, 0, 20], translate = [0, -1, 1] }
"#;

const TREES: &str =
    "# x y z\n1 0 0 -2  0 1 0 0  0 0 1 0\n\n0.5,0,0,1, 0,0.7,0,0, 0,0,-0.5,0, 0,0,0,1 # small\n";

fn built(folder: &Path, text: &str) -> Result<Scene, sunstone::base::locate::InputError> {
    sunstone::scene::from_text(&folder.join("scene.toml"), text)
}

/// Returns an array of f8 values in NumPy's format, version 1.0.
fn npy(shape: &str, by_column: bool, values: &[f64]) -> Vec<u8> {
    let order = if by_column { "True" } else { "False" };
    let mut head = format!("{{'descr': '<f8', 'fortran_order': {order}, 'shape': {shape}, }}");
    while (head.len() + 11) % 64 != 0 {
        head.push(' ');
    }
    head.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((head.len() as u16).to_le_bytes());
    bytes.extend(head.as_bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

#[test]
fn groups_round_trip_through_mitsuba() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("trees.txt"), TREES).unwrap();
    let export = exported(folder.path(), SCENE).unwrap();
    assert_eq!(export.xml.matches("type=\"shapegroup\"").count(), 2);
    assert_eq!(export.xml.matches("type=\"instance\"").count(), 3);
    assert!(export.xml.contains("id=\"tree_group\""), "the material has the name\n{}", export.xml);
    let out = folder.path().join("out");
    export.write(&out, false).unwrap();
    let path = folder.path().join("scene.toml");
    let back = Import::load(&out.join("scene.xml"), &path, &BTreeMap::new()).unwrap();
    let (a, b) = (built(folder.path(), SCENE).unwrap(), built(folder.path(), &back.toml).unwrap());
    assert_eq!((a.geometry.copies(), b.geometry.copies()), ((3, 2), (3, 2)));
    assert!(same(&a, &b) > 5000);
}

#[test]
fn placements_are_lists_or_arrays() {
    let folder = tempfile::tempdir().unwrap();
    let write = |bytes: &[u8]| std::fs::write(folder.path().join("trees.txt"), bytes).unwrap();
    write(TREES.as_bytes());
    let listed = built(folder.path(), SCENE).unwrap();
    let one = [1., 0., 0., -2., 0., 1., 0., 0., 0., 0., 1., 0.];
    let two = [0.5, 0., 0., 1., 0., 0.7, 0., 0., 0., 0., -0.5, 0.];
    let rows = [one, two].concat();
    // Writes the same array with the first index varying fastest.
    let columns: Vec<f64> = (0..24).map(|k| [one, two][k % 2][(k / 2 % 3) * 4 + k / 6]).collect();
    for bytes in [npy("(2, 3, 4)", false, &rows), npy("(2, 3, 4)", true, &columns)] {
        write(&bytes);
        let scene = built(folder.path(), SCENE).unwrap();
        assert_eq!(
            scene.geometry.instances().collect::<Vec<_>>(),
            listed.geometry.instances().collect::<Vec<_>>()
        );
        assert_ne!(scene.sha256, listed.sha256, "the hash is of the files too");
    }
    for (bytes, message) in [
        (b"1 2 3\n".to_vec(), "line 1: expected 12 or 16 numbers, got 3"),
        (b"# nothing\n".to_vec(), "trees.txt contains no transforms"),
        (TREES.replace("-2", "x").into_bytes(), "line 2: `x` is not a number"),
        (TREES.replace("-2", "inf").into_bytes(), "line 2: inf is not a finite number"),
        (TREES.replace("0,0,0,1 #", "0,0,1,1 #").into_bytes(), "line 4: the last row"),
        (TREES.replace("0.7", "0").into_bytes(), "copy 2 of the group has zero extent"),
        (vec![0xff, 0xfe, 0], "expected a text file or a .npy file"),
        (npy("(2, 12)", false, &rows), "got [2, 12]"),
        (npy("(2000000000, 3, 4)", false, &rows), "the file is truncated"),
        (npy("(3, 3, 4)", false, &rows), "trees.txt: "),
    ] {
        write(&bytes);
        let e = built(folder.path(), SCENE).err().expect(message);
        assert!(e.message.contains(message) && e.help.is_some(), "{message}: {e}");
        assert_eq!(e.line_column().map(|p| p.0), Some(27), "{e}");
    }
    write(TREES.as_bytes());
    for (from, to, message) in [
        ("group = \"stone\"", "group = \"rock\"", "unknown group `rock`"),
        ("scale = [1, -2, 0.5]", "scale = 0", "zero extent"),
        ("scale = [1, -2, 0.5]", "scale = 1e13", "is too large"),
        ("group = \"stone\"\n", "", "missing key `group`"),
        (
            "[[groups.stone.objects]]\nshape.sphere = { radius = 0.3 }\nmaterial = \"grey\"",
            "[groups.stone]",
            "the group `stone` is empty",
        ),
        ("material = \"tree\"", "material = \"leaf\"", "unknown material `leaf`"),
        ("[[groups.stone.objects]]", "[[groups.stone.things]]", "unknown key `things`"),
    ] {
        let text = SCENE.replacen(from, to, 1);
        assert_ne!(text, SCENE, "{from}");
        let e = built(folder.path(), &text).err().expect(message);
        assert!(e.message.contains(message) && e.help.is_some(), "{message}: {e}");
    }
    // The placements affect a scene's hash.
    let moved = built(folder.path(), &SCENE.replace("[0, -1, 1]", "[0, -1, 1.5]")).unwrap();
    assert_ne!(moved.sha256, listed.sha256);
}
