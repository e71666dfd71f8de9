//! Tests of Draco-compressed primitives: streams from Google's encoder (DracoPy 1.x), and invalid streams.

use glam::{Vec2, Vec3, vec2, vec3};
use serde_json::{Value, json};

use super::gltf_notes::DRACO;
use super::gltf_tests::glb;
use super::{ImportError, Model, parse_gltf};

/// A stream with sequential triangles in the original order: positions of 14 bits, normals of 10
/// bits, texture coordinates of 12 bits.
const SEQUENTIAL: &str = "\
    445241434f020201000000050601000104010204020304030004010502010303090201000109030001000903000202030200\
    0101000d03ad0a27553503a3a283fc3f00f83f000a4000fefffff93f000200000000ff0f0000000301000b235535ad0a03de\
    5a8300feff07f01fc0fffffe0308e03fff030000ff010000000101000f03ad0a2f553503a3a283f8ff0100000000000001a0\
    ff1f00f87f00c0ff07000e000180ff1700000000ff3f000000000000000000000000803f0c0a000000000000000000000000\
    000000410e";
/// A stream of the same mesh with Edgebreaker connectivity.
const EDGEBREAKER: &str = "\
    445241434f0202010100000006050205010002ef03ff0111ff025540ff02554003ff00010000000100000100090300020201\
    03090201000201010903000103010101000f3301200120030018900020000400ff7f00d0ff0b00fe3f0000000180fff7ff03\
    c0ffefff0100000000000000ff3f0000000000000000000000000000000000410e050101000d2b5515ad2a03282a8bff1f80\
    ff0f80006096cf0e00807cc4ff090004000000400380878000000000ff0f000000000000000000000000803f0c060301000b\
    1fad0aad0aa92a03dc04b075b93043eaa7eb38974789d4ce9d00ff030000ff010000d503dce2800a";

const POSITIONS: [Vec3; 6] = [
    vec3(0., 0., 0.),
    vec3(4., 0., 0.),
    vec3(4., 2., 1.),
    vec3(0., 2., 0.),
    vec3(2., 1., 3.),
    vec3(8., 1., 0.),
];
const NORMALS: [Vec3; 6] = [Vec3::Z, Vec3::X, Vec3::Y, Vec3::NEG_Z, Vec3::NEG_X, Vec3::Z];
const UVS: [Vec2; 6] =
    [vec2(0., 0.), vec2(0.5, 0.), vec2(1., 0.25), vec2(0., 1.), vec2(0.5, 0.75), vec2(1., 1.)];
const TRIANGLES: [[u32; 3]; 5] = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [1, 5, 2]];

pub fn stream(hex: &str) -> Vec<u8> {
    let digits: Vec<u8> = hex.bytes().map(|b| (b as char).to_digit(16).unwrap() as u8).collect();
    digits.as_chunks().0.iter().map(|[a, b]| a << 4 | b).collect()
}

/// Returns a glTF document for a stream. `ids` are the stream's ids of positions, normals and texture
/// coordinates.
fn document(length: usize, ids: [u32; 3]) -> Value {
    json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": [DRACO], "extensionsRequired": [DRACO],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "indices": 3, "mode": 4,
            "extensions": {DRACO: {"bufferView": 0, "attributes": {"POSITION": ids[0], "NORMAL": ids[1], "TEXCOORD_0": ids[2]}}}}]}],
        "accessors": [
            {"componentType": 5126, "count": 6, "type": "VEC3"},
            {"componentType": 5126, "count": 6, "type": "VEC3"},
            {"componentType": 5126, "count": 6, "type": "VEC2"},
            {"componentType": 5123, "count": 15, "type": "SCALAR"}
        ],
        "bufferViews": [{"buffer": 0, "byteLength": length}],
        "buffers": [{"byteLength": length}]
    })
}

/// Ids of the attributes in both streams, as reported by Google's decoder.
const IDS: [u32; 3] = [2, 1, 0];

pub fn sample_glb() -> Vec<u8> {
    let bytes = stream(EDGEBREAKER);
    glb(&document(bytes.len(), IDS), &bytes)
}

fn changed(path: &str, value: Value) -> Result<Model, ImportError> {
    let bytes = stream(SEQUENTIAL);
    let mut document = document(bytes.len(), IDS);
    *document.pointer_mut(path).unwrap() = value;
    parse_gltf(&glb(&document, &bytes), None)
}

#[test]
fn both_kinds_of_connectivity_give_the_mesh_that_was_compressed() {
    for hex in [SEQUENTIAL, EDGEBREAKER] {
        let bytes = stream(hex);
        let model = parse_gltf(&glb(&document(bytes.len(), IDS), &bytes), None).unwrap();
        assert!(model.notes.is_empty(), "{:?}", model.notes);
        let mesh = &model.parts[0].mesh;
        // Tolerances are half a quantization step: 8 / (2^14 - 1) for positions, and 1 / (2^12 - 1) for
        // texture coordinates.
        let original: Vec<usize> = mesh
            .positions
            .iter()
            .map(|p| POSITIONS.iter().position(|q| p.abs_diff_eq(*q, 2.5e-4)).unwrap())
            .collect();
        for (i, &k) in original.iter().enumerate() {
            assert!(mesh.normals[i].abs_diff_eq(NORMALS[k], 2e-3), "{:?}", mesh.normals[i]);
            let uv = vec2(UVS[k].x, 1.0 - UVS[k].y);
            assert!(mesh.uvs[i].abs_diff_eq(uv, 1.3e-4), "{:?}", mesh.uvs[i]);
        }
        let first = |mut t: [u32; 3]| {
            let least = (0..3).min_by_key(|&i| t[i]).unwrap_or(0);
            t.rotate_left(least);
            t
        };
        let mut triangles: Vec<_> =
            mesh.indices.iter().map(|t| first(t.map(|i| original[i as usize] as u32))).collect();
        triangles.sort_unstable();
        let mut expected = TRIANGLES.map(first);
        expected.sort_unstable();
        assert_eq!(triangles, expected);
    }
}

#[test]
fn uncompressed_values_take_precedence() {
    let mut bytes = stream(SEQUENTIAL);
    let length = bytes.len();
    bytes.resize(length.next_multiple_of(4), 0);
    let start = bytes.len();
    bytes.extend([0., 0., 0., 1., 0., 0., 0., 1., 0.0_f32].iter().flat_map(|x| x.to_le_bytes()));
    let mut document = document(bytes.len(), IDS);
    document["extensionsRequired"] = json!([]);
    document["bufferViews"] =
        json!([{"buffer": 0, "byteLength": length}, {"buffer": 0, "byteOffset": start, "byteLength": 36}]);
    document["accessors"] = json!([{"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3"}]);
    let primitive = &mut document["meshes"][0]["primitives"][0];
    primitive["attributes"] = json!({"POSITION": 0});
    primitive.as_object_mut().unwrap().remove("indices");
    let model = parse_gltf(&glb(&document, &bytes), None).unwrap();
    assert_eq!(model.parts[0].mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
}

#[test]
fn errors_name_the_fault() {
    let fails = |path: &str, value: Value, word: &str| {
        let message = changed(path, value).unwrap_err().to_string();
        assert!(message.contains(word), "{path}: {message}");
    };
    let extension = format!("/meshes/0/primitives/0/extensions/{DRACO}");
    fails(&format!("{extension}/attributes/NORMAL"), json!(7), "does not contain the attribute NORMAL");
    fails(&format!("{extension}/attributes/NORMAL"), json!("x"), "does not contain the attribute NORMAL");
    fails(&format!("{extension}/attributes/POSITION"), json!(0), "does not match the compressed data");
    fails(&format!("{extension}/bufferView"), json!(1), "beyond its buffer");
    fails(&extension, json!({}), "no buffer view");
    fails("/bufferViews/0/byteLength", json!(100), "cannot be decoded");
    fails("/accessors/0/count", json!(5), "does not match the compressed data");
    fails("/accessors/3/count", json!(12), "does not match the compressed data");
    fails("/meshes/0/primitives/0/mode", json!(6), "the mode TRIANGLES");
}
