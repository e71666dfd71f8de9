//! Tests of the glTF importer with valid and invalid files, which the tests construct.

use glam::{Vec2, Vec3, vec3};
use serde_json::{Value, json};

use super::gltf_notes::INSTANCING;
use super::{ImportError, Model, parse_gltf};

/// Returns a GLB container with a document and a binary chunk.
pub fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = 12 + 8 + text.len() + 8 + bin.len();
    let mut out = b"glTF".to_vec();
    for word in [2, length as u32, text.len() as u32] {
        out.extend(word.to_le_bytes());
    }
    out.extend(b"JSON");
    out.extend(text);
    out.extend((bin.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(bin);
    out
}

/// Returns a buffer with the data of a tetrahedron's corner:
/// - 4 positions.
/// - 4 normals along +z.
/// - 4 texture coordinates as u16.
/// - Indices as u8, u16 and u32.
/// - Two translations.
fn bin() -> Vec<u8> {
    let mut b = Vec::new();
    for x in [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.0_f32] {
        b.extend(x.to_le_bytes());
    }
    for x in [0., 0., 1.0_f32].repeat(4) {
        b.extend(x.to_le_bytes());
    }
    for x in [0_u16, 0, 65535, 0, 0, 65535, 65535, 65535] {
        b.extend(x.to_le_bytes());
    }
    b.extend([0, 1, 2, 0_u8]);
    for i in [0_u16, 1, 2, 3] {
        b.extend(i.to_le_bytes());
    }
    for i in [0_u32, 1, 2, 0, 2, 3] {
        b.extend(i.to_le_bytes());
    }
    for x in [0., 0., 5., 0., 7., 0.0_f32] {
        b.extend(x.to_le_bytes());
    }
    b
}

/// Returns a document with two nodes that instance one mesh. The parent of the first node rotates, scales and
/// translates the mesh. A matrix mirrors the mesh of the second node.
fn document() -> Value {
    json!({
        "asset": {"version": "2.0"}, "scene": 0,
        "scenes": [{"nodes": [2, 1]}],
        "nodes": [
            {"name": "turned", "mesh": 0, "rotation": [0, 0, std::f32::consts::FRAC_1_SQRT_2, std::f32::consts::FRAC_1_SQRT_2],
             "scale": [2, 3, 4], "translation": [0, 0, 1]},
            {"name": "mirrored", "mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 10, 0, 0, 1]},
            {"children": [0], "translation": [10, 20, 30]}
        ],
        "meshes": [{"name": "corner", "primitives": [{"material": 1, "indices": 3,
            "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}}]}],
        "materials": [{}, {"name": "jade"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
            {"bufferView": 0, "byteOffset": 48, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 96, "componentType": 5123, "normalized": true, "count": 4, "type": "VEC2"},
            {"bufferView": 0, "byteOffset": 112, "componentType": 5121, "count": 3, "type": "SCALAR"},
            {"bufferView": 0, "byteOffset": 116, "componentType": 5123, "count": 4, "type": "SCALAR"},
            {"bufferView": 0, "byteOffset": 124, "componentType": 5125, "count": 6, "type": "SCALAR"},
            {"bufferView": 0, "byteOffset": 148, "componentType": 5126, "count": 2, "type": "VEC3"}
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 172}],
        "buffers": [{"byteLength": 172}]
    })
}

pub fn sample_glb() -> Vec<u8> {
    glb(&document(), &bin())
}

/// Returns the sample document as glTF JSON whose buffer is a data URI.
pub fn sample_gltf() -> Vec<u8> {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut uri = String::from("data:application/octet-stream;base64,");
    let mut padded = bin();
    padded.resize(padded.len().next_multiple_of(3), 0);
    for c in padded.as_chunks::<3>().0 {
        let n = u32::from_be_bytes([0, c[0], c[1], c[2]]);
        uri.extend([18, 12, 6, 0].map(|s| char::from(DIGITS[(n >> s) as usize & 63])));
    }
    let mut d = document();
    d["buffers"][0]["uri"] = uri.into();
    d.to_string().into_bytes()
}

fn changed(path: &str, value: Value) -> Result<Model, ImportError> {
    let mut d = document();
    let (parent, key) = path.rsplit_once('/').unwrap();
    let parent = d.pointer_mut(parent).unwrap();
    match parent {
        Value::Array(a) => a[key.parse::<usize>().unwrap()] = value,
        other => other[key] = value,
    }
    parse_gltf(&glb(&d, &bin()), None)
}

fn fails(path: &str, value: Value, word: &str) {
    let message = changed(path, value).unwrap_err().to_string();
    assert!(message.contains(word), "{path}: {message}");
}

#[test]
fn instances_are_baked_to_world_space() {
    let parts = parse_gltf(&sample_glb(), None).unwrap().parts;
    assert_eq!(parts.len(), 2);
    let close = |a: &[Vec3], b: &[Vec3]| {
        assert!(a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.abs_diff_eq(*b, 1e-5)), "{a:?}");
    };
    let turned = &parts[0];
    assert_eq!((turned.name.as_str(), turned.material.as_deref()), ("turned", Some("jade")));
    // The node scales by (2, 3, 4), rotates by 90° about z and translates by 1 along z. The parent then
    // translates by (10, 20, 30).
    close(&turned.mesh.positions, &[vec3(10., 20., 31.), vec3(10., 22., 31.), vec3(7., 20., 31.)]);
    close(&turned.mesh.normals, &[Vec3::Z; 3]);
    // v points up in Sunstone and down in glTF.
    assert_eq!(turned.mesh.uvs, [Vec2::Y, Vec2::ONE, Vec2::ZERO]);
    assert_eq!(turned.mesh.indices, [[0, 1, 2]]);
    let mirrored = &parts[1].mesh;
    close(&mirrored.positions, &[vec3(10., 0., 0.), vec3(9., 0., 0.), vec3(10., 1., 0.)]);
    close(&mirrored.normals, &[Vec3::Z; 3]);
    assert_eq!(mirrored.indices, [[0, 2, 1]], "the reflection turns the winding");
}

#[test]
fn buffers_from_data_uris_and_files() {
    let expected = parse_gltf(&sample_glb(), None).unwrap();
    assert_eq!(parse_gltf(&sample_gltf(), None).unwrap(), expected);
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("my data.bin"), bin()).unwrap();
    let mut d = document();
    d["buffers"][0]["uri"] = "my%20data.bin".into();
    assert_eq!(parse_gltf(d.to_string().as_bytes(), Some(dir.path())).unwrap(), expected);
    let message = parse_gltf(d.to_string().as_bytes(), None).unwrap_err().to_string();
    assert!(message.contains("external file"), "{message}");
    for (uri, word) in
        [("%ff", "file name"), ("/dev/zero", "relative"), (".", "expected a file"), ("no", "exists")]
    {
        d["buffers"][0]["uri"] = uri.into();
        let error = parse_gltf(d.to_string().as_bytes(), Some(dir.path())).unwrap_err();
        assert!(error.to_string().contains(word), "{error}");
    }
}

#[test]
fn modes_and_index_types() {
    let indices = |mode: u32, accessor: Option<u32>| {
        let mut p = json!({"mode": mode, "attributes": {"POSITION": 0}});
        if let Some(a) = accessor {
            p["indices"] = a.into();
        }
        changed("/meshes/0/primitives/0", p).map(|model| model.parts[0].mesh.indices.clone())
    };
    assert_eq!(indices(4, Some(5)).unwrap(), [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(indices(5, Some(4)).unwrap(), [[0, 1, 2], [1, 3, 2]]);
    assert_eq!(indices(5, None).unwrap(), [[0, 1, 2], [1, 3, 2]]);
    assert_eq!(indices(6, None).unwrap(), [[1, 2, 0], [2, 3, 0]]);
    assert_eq!(indices(4, None).unwrap(), [[0, 1, 2]]);
    for mode in [0, 1, 2, 3] {
        let message = indices(mode, Some(5)).unwrap_err().to_string();
        assert!(message.contains("points or lines of mesh \"corner\""), "{message}");
    }
    assert!(indices(7, Some(5)).unwrap_err().to_string().contains("`mode` is unknown"));
}

#[test]
fn gpu_instances() {
    let extension = json!({INSTANCING: {"attributes": {"TRANSLATION": 6}}});
    let parts = changed("/nodes/1/extensions", extension).unwrap().parts;
    assert_eq!(parts.len(), 3);
    assert_eq!(parts[1].name, "mirrored#0");
    assert_eq!(parts[1].mesh.positions[0], vec3(10., 0., 5.));
    assert_eq!(parts[2].mesh.positions[1], vec3(9., 7., 0.));
    let bad = json!({INSTANCING: {"attributes": {"TRANSLATION": 6, "SCALE": 0}}});
    fails("/nodes/1/extensions", bad, "different numbers of elements");
}

#[test]
fn scenes_may_be_missing_or_empty() {
    let mut missing = document();
    missing.as_object_mut().unwrap().remove("scenes");
    let parts = parse_gltf(&glb(&missing, &bin()), None).unwrap().parts;
    assert_eq!(parts.len(), changed("/asset/version", json!("2.0")).unwrap().parts.len());
    fails("/scenes", json!([{}]), "no triangles");
}

#[test]
fn sparse_accessors() {
    let sparse = json!({"count": 1, "indices": {"bufferView": 0, "byteOffset": 113, "componentType": 5121},
        "values": {"bufferView": 0, "byteOffset": 148}});
    let parts = changed("/accessors/0/sparse", sparse.clone()).unwrap().parts;
    assert_eq!(parts[1].mesh.positions[1], vec3(10., 0., 5.));
    let huge = json!({"componentType": 5126, "count": 4_000_000_000_u64, "type": "VEC3", "sparse": sparse});
    fails("/accessors/0", huge, "number of elements exceeds");
}

#[test]
fn errors_name_the_element() {
    fails("/nodes/0/children", json!([2]), "cycle");
    fails("/nodes/2/children", json!([0, 0]), "node 0 is listed as a child more than once");
    fails("/nodes/2/children", json!([9]), "node 9 does not exist");
    fails("/scene", json!(3), "default scene");
    fails("/nodes/1/mesh", json!(5), "mesh 5");
    fails("/nodes/1/matrix/3", json!(0.5), "affine");
    fails("/nodes/2/scale", json!([3e38, 3e38, 3e38]), "not finite");
    fails("/nodes/0/rotation", json!([0, 0, 0, 0]), "quaternion");
    fails("/nodes/1/skin", json!(0), "skin 0");
    fails("/meshes/0/primitives/0/attributes/POSITION", json!(70), "accessor 70");
    fails("/meshes/0/primitives/0/attributes", json!({}), "POSITION");
    fails("/meshes/0/primitives/0/material", json!(7), "material 7");
    fails("/accessors/0/count", json!(4_294_967_295_u64), "beyond its buffer");
    fails("/accessors/0/count", json!(1), "normals for 1 vertices");
    fails("/accessors/3/componentType", json!(5126), "does not contain unsigned integers");
    fails("/accessors/3/byteOffset", json!(99), "vertex 255");
    fails("/accessors/1/type", json!("VEC4"), "3 components");
    fails("/bufferViews/0/byteOffset", json!(u64::MAX), "beyond its buffer");
    fails("/extensionsRequired", json!(["KHR_gaussian_splatting"]), "KHR_gaussian_splatting");
    fails("/asset/version", json!("1.0"), "2.0");
    fails("/scenes/0/nodes", json!([]), "no triangles");
    let known = json!([INSTANCING, "KHR_mesh_quantization", "KHR_materials_ior"]);
    assert!(changed("/extensionsRequired", known).is_ok());
    let mut short = sample_glb();
    short[8..12].copy_from_slice(&[3, 0, 0, 0]);
    assert!(parse_gltf(&short, None).is_err());
}

#[test]
fn ignored_and_skipped_items_are_noted() {
    let noted = |path: &str, value: Value, word: &str| {
        let model = changed(path, value).unwrap();
        assert!(model.notes.iter().any(|n| n.contains(word)), "{path}: {:?}", model.notes);
        model
    };
    let line = json!({"mode": 1, "attributes": {"POSITION": 0}});
    let model = noted(
        "/meshes/0/primitives",
        json!([line, {"attributes": {"POSITION": 0}}]),
        "lines of mesh \"corner\"",
    );
    assert_eq!(model.parts.len(), 2);
    noted("/nodes/0/scale", json!([0, 0, 0]), "\"turned\"");
    noted("/buffers/0/byteLength", json!(500), "expected 500 bytes");
    let required = json!(["KHR_texture_basisu", "EXT_texture_webp", "KHR_materials_ior"]);
    assert_eq!(changed("/extensionsRequired", required).unwrap().parts.len(), 2);
    noted("/nodes/1/extensions", json!({"KHR_lights_punctual": {"light": 0}}), "KHR_lights_punctual");
    let hidden =
        noted("/nodes/2/extensions", json!({"KHR_node_visibility": {"visible": false}}), "invisible");
    assert_eq!(hidden.parts.len(), 1);
    noted("/scenes", json!([{"nodes": [1]}, {"nodes": [2]}]), "scene 0 (counted from 0) is used");
    noted("/scenes/0/nodes", json!([1]), "is not part of the scene");
    noted("/animations", json!([{}]), "`animations`");
    noted("/nodes/1/camera", json!(0), "`camera` of `nodes`");
    noted("/meshes/0/primitives/0/attributes/COLOR_0", json!(0), "COLOR_0");
    noted("/meshes/0/primitives/0/indices", json!(4), "surplus index");
}

/// Tests displacements with the weights of the mesh and with the weights of a node.
#[test]
fn morph_targets_are_applied() {
    let mut d = document();
    d["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 1}, {"POSITION": 0, "NORMAL": 0}]);
    d["meshes"][0]["weights"] = json!([0.5, 0.0]);
    d["nodes"][1]["weights"] = json!([0.0, 2.0]);
    let parts = parse_gltf(&glb(&d, &bin()), None).unwrap().parts;
    // The vertex is displaced by half of (0, 0, 1), then scaled by 4 and translated by 31 along z.
    assert_eq!(parts[0].mesh.positions[0], vec3(10., 20., 33.));
    // The vertex is at three times its position, mirrored along x and translated by 10.
    assert_eq!(parts[1].mesh.positions[1], vec3(7., 0., 0.));
    assert!(parts[1].mesh.normals[1].abs_diff_eq(vec3(-2.0, 0.0, 1.0).normalize(), 1e-6));
}

/// Tests skinning: v = Σ weight · joint transform · inverse bind matrix · p, independent of the node's own
/// transform.
#[test]
fn skins_are_applied() {
    let mut d = document();
    let mut bytes = bin();
    // All vertices have their full weight on joint 0, except vertex 1, which has half of its weight on
    // joint 1. Weights do not sum to 1 exactly.
    let joints = bytes.len();
    bytes.extend([0_u8, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    let weights = bytes.len();
    for w in [1.0, 0.0, 0.5, 0.5, 1.0, 0.0, 1.0, 0.0_f32].as_chunks::<2>().0 {
        [w[0], w[1], 0.0, 0.0].iter().for_each(|w| bytes.extend(w.to_le_bytes()));
    }
    let matrices = bytes.len();
    for shift in [0.0, -1.0_f32] {
        let m = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., shift, 0., 0., 1.0_f32];
        m.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
    }
    let view = json!({"buffer": 0, "byteLength": bytes.len()});
    d["bufferViews"] = json!([view]);
    d["buffers"][0]["byteLength"] = json!(bytes.len());
    let accessors = d["accessors"].as_array_mut().unwrap();
    let more = json!([
        {"bufferView": 0, "byteOffset": joints, "componentType": 5121, "count": 4, "type": "VEC4"},
        {"bufferView": 0, "byteOffset": weights, "componentType": 5126, "count": 4, "type": "VEC4"},
        {"bufferView": 0, "byteOffset": matrices, "componentType": 5126, "count": 2, "type": "MAT4"}
    ]);
    accessors.extend(more.as_array().unwrap().clone());
    d["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = json!(7);
    d["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(8);
    d["nodes"][1]["skin"] = json!(0);
    d["nodes"]
        .as_array_mut()
        .unwrap()
        .extend([json!({"translation": [0, 0, 3]}), json!({"translation": [5, 0, 0], "scale": [2, 2, 2]})]);
    d["scenes"][0]["nodes"] = json!([1, 3, 4]);
    d["skins"] = json!([{"joints": [3, 4], "inverseBindMatrices": 9}]);
    let model = parse_gltf(&glb(&d, &bytes), None).unwrap();
    assert_eq!(model.parts.len(), 1);
    // Vertex 1 at (1, 0, 0) is moved to half of (1, 0, 3) plus half of 2 (1 - 1, 0, 0) + (5, 0, 0).
    assert_eq!(model.parts[0].mesh.positions, [vec3(0., 0., 3.), vec3(3., 0., 1.5), vec3(0., 1., 3.)]);
    assert_eq!(model.parts[0].mesh.indices, [[0, 1, 2]], "the node's own mirror is ignored");
    d["skins"][0]["joints"] = json!([3]);
    let error = parse_gltf(&glb(&d, &bytes), None).unwrap_err().to_string();
    assert!(error.contains("joint 1"), "{error}");
}

#[test]
fn containers_are_read_as_the_specification_asks() {
    let expected = parse_gltf(&sample_glb(), None).unwrap();
    let json_end = 20 + u32::from_le_bytes(sample_glb()[12..16].try_into().unwrap()) as usize;
    // Insert a chunk of an unknown kind before the binary chunk.
    let mut more = sample_glb();
    more.splice(json_end..json_end, [4, 0, 0, 0, b'X', b'Y', b'Z', 0, 1, 2, 3, 4]);
    let length = more.len() as u32;
    more[8..12].copy_from_slice(&length.to_le_bytes());
    assert_eq!(parse_gltf(&more, None).unwrap(), expected);
    let mut old = sample_glb();
    old[4] = 1;
    assert!(parse_gltf(&old, None).unwrap_err().to_string().contains("GLB container of version 2, got 1"));
    let marked = [b"\xef\xbb\xbf", &sample_gltf()[..]].concat();
    assert_eq!(parse_gltf(&marked, None).unwrap(), expected);
}

/// Tests a triangle in buffer views compressed with `EXT_meshopt_compression` and
/// `KHR_meshopt_compression`. The uncompressed buffer has no bytes.
#[test]
fn compressed_views_are_read() {
    let view = |start: u32, length: u32, stride: u32, mode: &str| json!({"buffer": 0, "byteOffset": start, "byteLength": length, "byteStride": stride, "count": 3, "mode": mode});
    let text = |name: &str, mode: &str| {
        json!({
            "asset": {"version": "2.0"},
            "extensionsRequired": [name],
            "buffers": [
                {"byteLength": 80, "uri": "data:application/octet-stream;base64,oAAAATwAAAD//wE8AAAAfn0AAAABDAAAAIAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAADh8AB2h1ZneKmGZYlomAFpAAA="},
                {"byteLength": 48, "extensions": {name: {"fallback": true}}}
            ],
            "bufferViews": [
                {"buffer": 1, "byteLength": 36, "byteStride": 12, "extensions": {name: view(0, 62, 12, mode)}},
                {"buffer": 1, "byteOffset": 36, "byteLength": 12, "extensions": {name: view(62, 18, 4, "TRIANGLES")}}
            ],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"}
            ],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}]
        })
        .to_string()
    };
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let model = parse_gltf(text(name, "ATTRIBUTES").as_bytes(), None).unwrap();
        assert_eq!(model.parts[0].mesh.positions, [Vec3::ZERO, Vec3::X, vec3(0., 2., 0.)]);
        assert_eq!(model.parts[0].mesh.indices, [[0, 1, 2]]);
        assert!(model.notes.is_empty(), "{:?}", model.notes);
        let bare = text(name, "ATTRIBUTES").replace("\"fallback\":true", "");
        assert!(parse_gltf(bare.as_bytes(), None).is_ok());
        let broken = parse_gltf(text(name, "INDICES").as_bytes(), None).unwrap_err();
        assert!(broken.to_string().contains("of buffer view 0"), "{broken}");
    }
    // Scenes without nodes are valid.
    fails("/scenes/0", json!({}), "no triangles");
}
