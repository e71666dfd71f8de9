//! Tests that everything in a file is used, noted by name or refused, with files that contain one random
//! unused item.

use super::{ImportError, Model, gltf_tests, parse_gltf, parse_obj, parse_ply};
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde_json::{Value, json};

const FILES: u64 = 250;

fn word(rng: &mut Pcg64Mcg) -> String {
    let letters: String = (0..6).map(|_| char::from(rng.random_range(b'a'..=b'z'))).collect();
    format!("x{letters}")
}

#[track_caller]
fn accounted(parsed: &Result<Model, ImportError>, name: &str, file: &dyn std::fmt::Debug) {
    let is_named = match parsed {
        Ok(model) => model.notes.iter().any(|note| note.contains(name)),
        Err(error) => error.to_string().contains(name),
    };
    assert!(is_named, "{name} is neither noted nor refused: {parsed:?} of {file:?}");
}

#[test]
fn obj() {
    let lines = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\no a\nusemtl m\n\
                 f 1/1/1 2/2/1 3/1/1\ng b\nf 1/1/1 3/2/1 4/2/1";
    assert!(parse_obj(lines.as_bytes()).unwrap().notes.is_empty());
    for seed in 0..FILES {
        let rng = &mut Pcg64Mcg::seed_from_u64(seed);
        let unknown = word(rng);
        let numbers: String = (0..rng.random_range(0..5)).map(|i| format!(" {i}")).collect();
        let (line, name) = match rng.random_range(0..8) {
            0 => ("v 0 0 0 1 0.5 0".to_owned(), "colours"),
            1 => ("v 0 0 0 1 2".to_owned(), "surplus"),
            2 => ("vt 0.5 0.5 0.5".to_owned(), "third coordinate"),
            3 => ("vn 0 0 1 5".to_owned(), "surplus"),
            4 => {
                let known = *["l", "p", "curv", "surf", "lod", "bevel", "usemap", "call", "csh", "mg"]
                    .choose(rng)
                    .unwrap();
                (format!("{known} 1"), known)
            }
            5 => ("f 1 2 3".to_owned(), "texture coordinates"),
            _ => (format!("{unknown}{numbers}"), &*unknown),
        };
        let mut all: Vec<&str> = lines.split('\n').collect();
        // Insert vertices at the end, since they change the numbers of later ones.
        let at = if line.starts_with('v') { all.len() } else { rng.random_range(0..=all.len()) };
        all.insert(at, &line);
        let text = all.join("\n");
        accounted(&parse_obj(text.as_bytes()), name, &text);
    }
}

#[test]
fn ply() {
    for seed in 0..FILES {
        let rng = &mut Pcg64Mcg::seed_from_u64(seed);
        let name = word(rng);
        let kinds = ["char", "uint8", "short", "uint16", "int32", "uint", "float", "double"];
        let kind = kinds.choose(rng).unwrap();
        let is_list = rng.random::<bool>();
        let property = if is_list {
            format!("property list uchar {kind} {name}\n")
        } else {
            format!("property {kind} {name}\n")
        };
        let value = if is_list { " 2 7 8" } else { " 7" };
        let (mut header, mut vertex, mut face, mut more) = (["", "", "", ""].map(str::to_owned), "", "", "");
        let mut noted = name.clone();
        match rng.random_range(0..6) {
            0 => (header[0], vertex) = (property, value),
            1 => (header[1], face) = (property, value),
            2 => {
                header[2] = format!("element {name} 1\n{property}");
                more = value;
            }
            3 => header[3] = format!("comment TextureFile {name}.png\n"),
            4 => header[3] = format!("{name} 1\n"),
            _ => {
                more = " 7";
                noted = "after the last row".into();
            }
        }
        let [a, b, c, d] = header;
        let rows: String = ["0 0 0", "1 0 0", "0 1 0"].map(|v| format!("{v}{vertex}\n")).concat();
        let text = format!(
            "ply\nformat ascii 1.0\n{d}element vertex 3\nproperty float x\nproperty float y\nproperty float z\n{a}\
             element face 1\nproperty list uchar int vertex_indices\n{b}{c}end_header\n{rows}3 0 1 2{face}\n{more}\n"
        );
        accounted(&parse_ply(text.as_bytes()), &noted, &text);
    }
}

#[test]
fn gltf() {
    let sample: Value = serde_json::from_slice(&gltf_tests::sample_gltf()).unwrap();
    assert!(parse_gltf(sample.to_string().as_bytes(), None).unwrap().notes.is_empty());
    // Objects that the importer reads; materials and their parts are tested with the materials.
    let places = [
        "",
        "/asset",
        "/scenes/0",
        "/nodes/0",
        "/nodes/1",
        "/nodes/2",
        "/meshes/0",
        "/meshes/0/primitives/0",
        "/meshes/0/primitives/0/attributes",
        "/accessors/0",
        "/accessors/3",
        "/bufferViews/0",
        "/buffers/0",
    ];
    for seed in 0..FILES {
        let rng = &mut Pcg64Mcg::seed_from_u64(seed);
        let mut document = sample.clone();
        let mut name = word(rng);
        let place = *places.choose(rng).unwrap();
        let object = document.pointer_mut(place).unwrap();
        let value = match rng.random_range(0..3) {
            0 => json!(1),
            1 => json!([1, 2]),
            _ => json!({"a": 1}),
        };
        match rng.random_range(0..4) {
            0 if place != "/meshes/0/primitives/0/attributes" => object["extensions"] = json!({&name: value}),
            1 => {
                let list = if rng.random() { "extensionsRequired" } else { "animations" };
                if list == "animations" {
                    document[list] = json!([{"channels": []}]);
                    name = list.into();
                } else {
                    document[list] = json!([name]);
                }
            }
            2 => {
                let attributes = &mut document["meshes"][0]["primitives"][0]["attributes"];
                name = (*["COLOR_0", "TEXCOORD_1", "_CUSTOM"].choose(rng).unwrap()).to_owned();
                attributes[&name] = json!(0);
            }
            _ if place.ends_with("attributes") => object[format!("_{name}")] = json!(0),
            _ => object[&name] = value,
        }
        accounted(&parse_gltf(document.to_string().as_bytes(), None), &name, &document);
    }
}
