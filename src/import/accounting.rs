//! Tests that each item of a glTF file is used, named in a note or refused. Each file contains one random
//! unused item.

use super::{ImportError, Model, gltf_tests, parse_gltf};
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
fn every_gltf_key_is_accounted_for() {
    let sample: Value = serde_json::from_slice(&gltf_tests::sample_gltf()).unwrap();
    assert!(parse_gltf(sample.to_string().as_bytes(), None).unwrap().notes.is_empty());
    // Insert the item into objects that the importer reads. Materials have separate tests.
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
