//! Tests of the OBJ reader with valid and invalid files.

use super::curve_tests::measures;
use super::{MeshPart, Model, parse_obj};
use glam::{Vec3, vec2, vec3};

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

fn fails(text: &str, line: Option<usize>, word: &str) {
    let error = parse_obj(text.as_bytes()).unwrap_err();
    assert_eq!(error.line, line, "{error}");
    assert!(error.to_string().contains(word), "{error}");
}

#[test]
fn parts_follow_objects_and_materials() {
    let text = format!(
        "# a comment\nmtllib missing.mtl\n{SQUARE}o left side\nusemtl  dark glass\nf 1 2 3\nusemtl wall\nf 1 3 4\n\
         o right\ns off\nf -4 -3 -2 -1\nl 1 2\np 1\n"
    );
    let parts = parse_obj(text.as_bytes()).unwrap().parts;
    let described: Vec<_> =
        parts.iter().map(|p| (p.name.as_str(), p.material.as_deref(), p.mesh.indices.len())).collect();
    assert_eq!(
        described,
        [("left side", Some("dark glass"), 1), ("left side", Some("wall"), 1), ("right", Some("wall"), 2),]
    );
    assert_eq!(parts[1].mesh.positions, [Vec3::ZERO, vec3(1.0, 1.0, 0.0), vec3(0.0, 1.0, 0.0)]);
}

#[test]
fn corners_with_their_own_normals_and_uvs() {
    let text = format!(
        "{SQUARE}vt 0 0\nvt 1 0 0\nvt .5 1\nvn 0 0 2\nvn 0 3 0\nf 1/1/1 2/2/1 3/3/1 # front\nf 1/1/2 3/3/2 \\\n4/2/2\n"
    );
    let mesh = &parse_obj(text.as_bytes()).unwrap().parts[0].mesh;
    assert_eq!(mesh.positions.len(), 6);
    assert_eq!(mesh.normals[..3], [Vec3::Z; 3]);
    assert_eq!(mesh.normals[3..], [Vec3::Y; 3]);
    assert_eq!(mesh.uvs[2], vec2(0.5, 1.0));
    assert_eq!(mesh.indices, [[0, 1, 2], [3, 4, 5]]);
}

/// Tests areas of concave faces against the shoelace formula.
#[test]
fn concave_faces_keep_their_area() {
    let u = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv .75 1 0\nv .75 .25 0\nv .25 .25 0\nv .25 1 0\nv 0 1 0\nf 1 2 3 4 5 6 7 8\n";
    let l = "v 0 0 0\nv 1 0 0\nv 1 .5 0\nv .5 .5 0\nv .5 1 0\nv 0 1 0\nf 6 5 4 3 2 1\n";
    let chevron = "v 0 0 0\nv .5 .25 0\nv 1 0 0\nv .5 1 0\nf 1 2 3 4\n";
    for (text, expected) in [(u, 0.625), (l, 0.75), (chevron, 0.375)] {
        let model = parse_obj(text.as_bytes()).unwrap();
        let mesh = &model.parts[0].mesh;
        let [area, _] = measures(mesh);
        assert!((area - expected).abs() < 1e-6, "{text}: {area}");
        assert!(model.notes.is_empty(), "{:?}", model.notes);
    }
}

fn described(model: &Model) -> Vec<(usize, usize, usize)> {
    let part = |p: &MeshPart| (p.mesh.indices.len(), p.mesh.uvs.len(), p.mesh.normals.len());
    model.parts.iter().map(part).collect()
}

#[test]
fn faces_without_an_attribute_do_not_affect_others() {
    let text = format!(
        "{SQUARE}v 0 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\nf 1 2 5\nf 4/4 3/3 2/2 1/1\n"
    );
    let model = parse_obj(text.as_bytes()).unwrap();
    assert_eq!(described(&model), [(4, 4, 0), (1, 0, 0)]);
    assert_eq!(model.parts[0].mesh.uvs[2], vec2(1.0, 1.0));
    assert_eq!(model.notes, ["1 of 3 faces have no texture coordinates"]);

    let text = format!("{SQUARE}vn 0 0 1\nf 1//1 2//1 3//1\nf 1 3 4\no b\nf 1//1 2//1 4//1\n");
    let model = parse_obj(text.as_bytes()).unwrap();
    assert_eq!(described(&model), [(1, 0, 3), (1, 0, 0), (1, 0, 3)]);
    assert_eq!(model.notes, ["1 of 3 faces have no normals"]);

    // If one corner lacks an attribute, the attribute cannot be interpolated, so the whole face lacks the
    // attribute.
    let text = format!("{SQUARE}vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3//1\nf 1/1 3/1/1 4/1/1\n");
    let model = parse_obj(text.as_bytes()).unwrap();
    assert_eq!(described(&model), [(1, 3, 0), (1, 0, 3)]);
    assert_eq!(model.notes.len(), 2);
}

#[test]
fn encodings_and_line_endings_do_not_matter() {
    let text = format!("mtllib a.mtl\nusemtl caf\u{e9}\n{SQUARE}f 1 2 \\\n3\n\nf 1 3 4\n");
    let expected = parse_obj(text.as_bytes()).unwrap();
    assert_eq!(expected.parts[0].material.as_deref(), Some("café"));
    let utf16 = |order: fn(u16) -> [u8; 2]| -> Vec<u8> {
        format!("\u{feff}{text}").encode_utf16().flat_map(order).collect()
    };
    let latin1: Vec<u8> = text.chars().map(|c| c as u8).collect();
    for bytes in [
        [b"\xef\xbb\xbf", text.as_bytes()].concat(),
        [b"\xef\xbb\xbf", &text.as_bytes()["mtllib a.mtl\n".len()..]].concat(),
        utf16(u16::to_le_bytes),
        utf16(u16::to_be_bytes),
        latin1,
        text.replace('\n', "\r").into_bytes(),
        text.replace('\n', "\r\n").into_bytes(),
        text.replace("\nv ", "\n\t V\t").replace("f ", "F\t").replace("usemtl ", "UseMtl  ").into_bytes(),
        text.replace("f ", "fo ").into_bytes(),
    ] {
        assert_eq!(parse_obj(&bytes).unwrap(), expected, "{}", String::from_utf8_lossy(&bytes));
    }
    let bad = text.replace("f 1 3 4", "f 1 3 x").replace('\n', "\r");
    assert_eq!(parse_obj(bad.as_bytes()).unwrap_err().line, Some(10));
}

#[test]
fn faces_may_come_before_their_vertices() {
    let first = parse_obj(format!("f 1 2 3 4\n{SQUARE}").as_bytes()).unwrap();
    assert_eq!(first, parse_obj(format!("{SQUARE}f 1 2 3 4\n").as_bytes()).unwrap());
}

#[test]
fn unused_items_are_noted() {
    let noted = |line: &str, word: &str| {
        let model = parse_obj(format!("{SQUARE}f 1 2 3\n{line}\n").as_bytes()).unwrap();
        assert!(model.notes.len() == 1 && model.notes[0].contains(word), "{line}: {:?}", model.notes);
    };
    noted("l 1 2", "lines");
    noted("p 1", "points");
    noted("v 0 0 0 1 .5 0", "colours of 1 vertices");
    noted("v 0 0 0 1 2", "surplus");
    noted("vn 0 0 1 5", "surplus");
    noted("vt 0 0 1", "third coordinate");
    noted("curv 0 1 1 2", "free-form");
    noted("bevel on", "display");
    noted("made_up 3", "`made_up`");
    noted("s 1\nf 1 3 4", "smoothing groups");
    noted("f 1 2", "fewer than three corners");
    noted("f 1/1 3/1 4/1", "texture coordinates that do not exist");
    noted("f 1//6148914691236517206 3//1 4//1", "normals that do not exist");
    noted("v 0 0 0 nan nan nan", "colours of 1 vertices");
    noted("f 1 2 3 4\nf 1 3 2 4", "self-intersecting");
    let silent = format!("mtllib a.mtl\n{SQUARE}s off\ng\nusemtl\nvt 0 0 0\nf 1 2 3 # ok\n");
    assert!(parse_obj(silent.as_bytes()).unwrap().notes.is_empty());
    for keyword in ["call", "csh"] {
        fails(&format!("{SQUARE}{keyword} other.obj\n"), Some(5), &format!("`{keyword}`"));
    }
    fails(&format!("{SQUARE}l 1 2\n"), None, "lines");
}

#[test]
fn colours_weights_tabs_and_foreign_bytes() {
    let mut bytes = b"# caf\xe9\n\tv\t0 0 0 1 0.5 0\nv 2 0 0 2\r\nv 0 1 0\nusemtl\tred\n f\t1 2 3\n".to_vec();
    let part = &parse_obj(&bytes).unwrap().parts[0];
    assert_eq!(part.material.as_deref(), Some("red"));
    assert_eq!(part.mesh.positions[1], Vec3::X);
    bytes.truncate(bytes.len() - 2);
    assert!(parse_obj(&bytes).is_err());
}

#[test]
fn errors_have_line_numbers() {
    fails("v 0 0\n", Some(1), "coordinates");
    fails("v 0 0 0\nv nan 0 0\n", Some(2), "finite");
    fails("v 1e999 0 0\n", Some(1), "finite");
    fails("v 1 0 0 0\n", Some(1), "w");
    fails(&format!("{SQUARE}f 1 2\n"), None, "fewer than three corners");
    fails(&format!("{SQUARE}f 1 2 0\n"), Some(5), "\"0\"");
    fails(&format!("{SQUARE}f 1 2 -5\n"), Some(5), "-5");
    fails(&format!("{SQUARE}f 1 2 3\nf 1 2 9\n"), Some(6), "position 9");
    fails(SQUARE, None, "no triangles");
    fails(&format!("{SQUARE}o flat\nf 1 1 2\n"), None, "flat");
    fails("v 0 0 0 # f 1 2 3\n", None, "no triangles");
}
