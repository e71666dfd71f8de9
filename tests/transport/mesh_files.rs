//! Tests mesh files. The tests compare textured glTF files with OBJ files of the same model, and embedded
//! materials with scene-file materials. Tests media in meshes that are open, inside out, or intersecting.

use crate::optics::{Device, head};
use crate::support::render_scene;
use glam::DVec3;
use std::path::Path;
use sunstone::scene::from_text;
use sunstone::tensor::array::Tensor;

const LIGHT: &str =
    "[[emitters]]\npoint = { position = [0.5, 1, 3], intensity = 2 }\n[[slices]]\nname = \"m\"\n";

/// Writes a square with texture coordinates as OBJ with a material library. Writes the same square as glTF
/// with a buffer, and an image without symmetry.
pub fn square(folder: &Path, gltf_material: &str, mtl: &str) {
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect("a file");
    image::RgbImage::from_fn(3, 2, |x, y| {
        image::Rgb([(40 + 60 * x + 90 * y) as u8, (200 - 50 * x) as u8, (30 + 200 * y) as u8])
    })
    .save(folder.join("picture.png"))
    .expect("an image");
    write(
        "square.obj",
        b"mtllib square.mtl\nusemtl painted\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
          f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n",
    );
    write("square.mtl", mtl.as_bytes());
    let positions: [f32; 12] = [-1., -1., 0., 1., -1., 0., 1., 1., 0., -1., 1., 0.];
    // In glTF, v increases downward.
    let uvs: [f32; 8] = [0., 1., 1., 1., 1., 0., 0., 0.];
    let indices: [u32; 6] = [0, 1, 2, 0, 2, 3];
    let floats = positions.iter().chain(&uvs).flat_map(|v| v.to_le_bytes());
    let bytes: Vec<u8> = floats.chain(indices.iter().flat_map(|i| i.to_le_bytes())).collect();
    write("square.bin", &bytes);
    let text = format!(
        r#"{{"asset": {{"version": "2.0"}}, "nodes": [{{"mesh": 0}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0, "TEXCOORD_0": 1}}, "indices": 2, "material": 0}}]}}],
        "materials": [{gltf_material}], "textures": [{{"source": 0}}], "images": [{{"uri": "picture.png"}}],
        "buffers": [{{"uri": "square.bin", "byteLength": {}}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 48}}, {{"buffer": 0, "byteOffset": 48, "byteLength": 32}},
                        {{"buffer": 0, "byteOffset": 80, "byteLength": 24}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, -1, 0], "max": [1, 1, 0]}},
                      {{"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"}},
                      {{"bufferView": 2, "componentType": 5125, "count": 6, "type": "SCALAR"}}]}}"#,
        bytes.len()
    );
    write("square.gltf", text.as_bytes());
}

/// Returns the image of the square seen from the front, and the notes of the scene. `more` contains the
/// square's object and materials.
fn picture(folder: &Path, more: &str) -> (Tensor, Vec<String>) {
    let camera = Device::look_at([0.0, 0.0, 4.0], DVec3::ZERO, [16, 16], 30.0);
    let text = head(16, 3, 2).replace("[550]", "[450, 550, 660]") + &camera.keys("camera") + more + LIGHT;
    let scene = from_text(&folder.join("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"));
    (render_scene(&scene).mean("m"), scene.notes.clone())
}

const PLAIN: &str = r#"{"name": "painted", "emissiveFactor": [1, 0, 0]}"#;

#[test]
fn gltf_and_obj_show_the_same_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    square(folder.path(), PLAIN, "newmtl painted\nKd 1 0 0\n");
    let object = |shape: &str| {
        format!(
            "[materials]\np.diffuse.albedo = {{ image = \"picture.png\" }}\n[[objects]]\nmaterial = \"p\"\nshape.{shape}\n"
        )
    };
    let (obj, notes) = picture(folder.path(), &object("obj.file = \"square.obj\""));
    assert!(
        notes.len() == 1 && notes[0].contains("the file's materials (painted) are not used"),
        "{notes:?}"
    );
    let (gltf, notes) = picture(folder.path(), &object("gltf.file = \"square.gltf\""));
    assert!(notes.len() == 1 && notes[0].contains("square.gltf"), "{notes:?}");
    let (rectangle, notes) = picture(folder.path(), &object("rectangle = {}"));
    assert!(notes.is_empty(), "{notes:?}");
    assert_eq!(obj.data, gltf.data, "the same model in two formats");
    assert_eq!(obj.data, rectangle.data, "the same square of our own");
    // Negative control: the image of the square upside down differs.
    let flipped = object("obj.file = \"square.obj\"")
        .replace("picture.png\"", "picture.png\", uv = [[1, 0, 0], [0, -1, 1]]");
    assert_ne!(obj.data, picture(folder.path(), &flipped).0.data);
}

#[test]
fn materials_of_files_equal_handwritten_ones() {
    let folder = tempfile::tempdir().expect("a folder");
    let own = |shape: &str| {
        format!("[materials]\np.diffuse.albedo = 0\n[[objects]]\nmaterial = \"p\"\nshape.{shape}\n")
    };
    let by_hand = |shape: &str, material: &str| {
        format!("[materials]\n{material}\n[[objects]]\nmaterial = \"p\"\nshape.{shape}\n")
    };
    // Computes the body's fraction of the base colour. Another test compares `import::body` with the
    // specification.
    let factor = sunstone::scene::import::body::gltf(1.4, 0.36);
    let albedo = |base: [f64; 3]| base.map(|v| v * factor);
    let coat = "interreflection = \"linear\", passage = \"facets\", ior = 1.4, alpha = 0.36";
    let [n, k] = sunstone::scene::import::metal::metal(0.25);
    let cases = [
        (
            r#"{"name": "painted", "pbrMetallicRoughness": {"baseColorFactor": [0.9, 0.5, 0.1, 1], "metallicFactor": 0,
               "roughnessFactor": 0.6}, "extensions": {"KHR_materials_ior": {"ior": 1.4}}}"#,
            format!("p.plastic = {{ albedo = {:?}, {coat} }}", albedo([0.1, 0.5, 0.9])),
        ),
        (
            r#"{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform":
               {"offset": [0.25, 0], "scale": [0.5, 2]}}}, "metallicFactor": 0, "roughnessFactor": 0.6},
               "extensions": {"KHR_materials_ior": {"ior": 1.4}}}"#,
            format!(
                "p.plastic = {{ albedo = {{ image = \"picture.png\", scale = {factor}, uv = [[0.5, 0, 0.25], [0, 2, -1]] }}, {coat} }}"
            ),
        ),
        (
            r#"{"pbrMetallicRoughness": {"baseColorFactor": [0.25, 0.25, 0.25, 1], "roughnessFactor": 0.6}}"#,
            format!("p.rough_conductor = {{ n = {n}, k = {k}, alpha = 0.36 }}"),
        ),
    ];
    for (gltf, hand) in cases {
        square(folder.path(), gltf, "");
        let (file, notes) =
            picture(folder.path(), &own("gltf = { file = \"square.gltf\", materials = true }"));
        let (ours, _) = picture(folder.path(), &by_hand("gltf.file = \"square.gltf\"", &hand));
        // Images have 16 bits.
        let close = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-4 * b.abs() + 1e-6;
        assert!(
            notes.is_empty() && file.data.iter().zip(&ours.data).all(close),
            "{gltf} is not {hand}; {notes:?}"
        );
        assert!(file.data.iter().sum::<f32>() > 0.0);
    }
    square(folder.path(), PLAIN, "newmtl painted\nKd 1 1 1\nmap_Kd -s 2 1 1 picture.png\nKe 1 0 0\n");
    let (file, notes) = picture(folder.path(), &own("obj = { file = \"square.obj\", materials = true }"));
    let hand = "p.diffuse.albedo = { image = \"picture.png\", uv = [[2, 0, 0], [0, 1, 0]] }";
    let (ours, _) = picture(folder.path(), &by_hand("obj.file = \"square.obj\"", hand));
    assert_eq!(file.data, ours.data);
    assert!(notes.iter().any(|n| n.contains("keys of the material are not used: Ke")), "{notes:?}");
}

/// Writes a cube as OBJ with changed triangles.
fn cube(folder: &Path, change: impl Fn(&mut Vec<[usize; 3]>)) {
    let mut text = String::new();
    for i in 0..8 {
        let at = |bit: usize| if i & bit == 0 { -0.5 } else { 0.5 };
        text += &format!("v {} {} {}\n", at(1), at(2), at(4));
    }
    let mut faces = vec![
        [1, 3, 2],
        [2, 3, 4],
        [5, 6, 7],
        [6, 8, 7],
        [1, 2, 5],
        [2, 6, 5],
        [3, 7, 4],
        [4, 7, 8],
        [1, 5, 3],
        [3, 5, 7],
        [2, 4, 6],
        [4, 8, 6],
    ];
    change(&mut faces);
    for [a, b, c] in faces {
        text += &format!("f {a} {b} {c}\n");
    }
    std::fs::write(folder.join("cube.obj"), text).expect("a file");
}

fn fog(folder: &Path, objects: &str) -> Result<(f64, Vec<String>), String> {
    let camera = Device::ray([0.1, 0.2, 4.0], DVec3::new(0.1, 0.2, 0.0));
    let text = head(4, 8, 2)
        + &camera.keys("camera")
        + "[materials]\nedge.null = {}\n[media]\nfog.homogeneous = { absorption = 0.6 }\nmist.homogeneous = { absorption = 0.3 }\n"
        + objects
        + "[[emitters]]\nenvironment = { radiance = 1 }\n[[slices]]\nname = \"m\"\n";
    let scene = from_text(&folder.join("scene.toml"), &text).map_err(|e| e.to_string())?;
    Ok((f64::from(render_scene(&scene).mean("m").data[0]), scene.notes.clone()))
}

#[test]
fn filled_meshes_must_be_closed_and_are_turned_outward() {
    let folder = tempfile::tempdir().expect("a folder");
    let object = "[[objects]]\nmaterial = \"edge\"\ninterior = \"fog\"\nshape.obj.file = \"cube.obj\"\n";
    let want = (-0.6_f64).exp();
    cube(folder.path(), |_| {});
    let (light, notes) = fog(folder.path(), object).expect("a closed cube");
    assert!((light - want).abs() < 1e-5 && notes.is_empty(), "{light}, {notes:?}");
    cube(folder.path(), |faces| faces.iter_mut().for_each(|f| f.swap(0, 1)));
    let (light, notes) = fog(folder.path(), object).expect("a cube inside out");
    assert!((light - want).abs() < 1e-5, "{light}");
    assert!(
        notes.len() == 1 && notes[0].contains("point inward, so the orientation of the mesh is reversed"),
        "{notes:?}"
    );
    cube(folder.path(), |faces| {
        faces.pop();
    });
    let error = fog(folder.path(), object).expect_err("an open cube");
    assert!(error.contains("the surface is open at 3 of") && error.contains("from [0.5, "), "{error}");
    cube(folder.path(), |faces| faces[3].swap(0, 1));
    let error = fog(folder.path(), object).expect_err("a triangle the wrong way");
    assert!(error.contains("inconsistent winding"), "{error}");
    for open in ["disk = {}", "rectangle = {}", "cylinder = { caps = false }"] {
        let object = format!("[[objects]]\nmaterial = \"edge\"\ninterior = \"fog\"\nshape.{open}\n");
        assert!(fog(folder.path(), &object).expect_err(open).contains("open"), "{open}");
    }
}

#[test]
fn overlapping_filled_objects_need_a_priority() {
    let folder = tempfile::tempdir().expect("a folder");
    cube(folder.path(), |_| {});
    let object = |shape: &str, medium: &str, priority: i32| {
        format!(
            "[[objects]]\nmaterial = \"edge\"\ninterior = \"{medium}\"\npriority = {priority}\nshape.{shape}\n"
        )
    };
    let ball = "sphere = { center = [0.1, 0.2, 0.5], radius = 0.3 }";
    let mesh = "obj.file = \"cube.obj\"";
    for (a, b) in [(mesh, ball), (ball, mesh)] {
        let text = object(a, "fog", 0) + &object(b, "mist", 0);
        let error = fog(folder.path(), &text).expect_err("cut into one another");
        assert!(error.contains("equal priorities (0)"), "{error}");
        assert!(fog(folder.path(), &(object(a, "fog", 0) + &object(b, "mist", 1))).is_ok());
        assert!(fog(folder.path(), &(object(a, "fog", 0) + &object(b, "fog", 0))).is_ok(), "the same medium");
    }
    // The pairs of meshes are nested, side by side, and nearly touching.
    for other in [
        "sphere = { center = [0.1, 0.2, 0], radius = 0.2 }",
        "sphere = { center = [0.1, 0.2, 1.1], radius = 0.3 }",
        "cube = { min = [-0.5, -0.5, 0.50001], max = [0.5, 0.5, 0.7] }",
    ] {
        assert!(fog(folder.path(), &(object(mesh, "fog", 0) + &object(other, "mist", 0))).is_ok(), "{other}");
    }
    // The program renders touching surfaces as if there were a small air gap.
    let touching = object(mesh, "fog", 0)
        + &object("cube = { min = [-0.5, -0.5, 0.5], max = [0.5, 0.5, 0.7] }", "mist", 0);
    let (got, notes) = fog(folder.path(), &touching).expect("touching");
    let apart = touching.replace("-0.5, 0.5]", "-0.5, 0.50001]");
    let (want, _) = fog(folder.path(), &apart).expect("apart");
    assert!((got - want).abs() < 0.01 * want, "{got} {want}");
    assert!(notes.iter().any(|n| n.contains("touches")), "{notes:?}");
}

/// Tests light that enters a filled object through one surface and leaves the object through a second
/// surface. The surfaces are the end and the side of a tube, or parts of a mesh with different materials. The
/// expected transmittance is exp(-2 · length) of the path inside.
#[test]
fn parts_of_a_filled_object_count_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("box.obj");
    std::fs::write(
        &file,
        "v -.5 -.5 -.5\nv .5 -.5 -.5\nv -.5 .5 -.5\nv .5 .5 -.5\nv -.5 -.5 .5\nv .5 -.5 .5\nv -.5 .5 .5\nv .5 .5 .5\n\
         f 1 3 4 2\nf 5 6 8 7\nusemtl rest\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n",
    )
    .unwrap();
    let mesh =
        format!("obj = {{ file = {:?} }}\npart_materials = {{ rest = \"c\" }}", file.to_str().unwrap());
    let tube = "cylinder = { p0 = [0, 0, -0.5], p1 = [0, 0, 0.5], radius = 0.5, caps = true }";
    // Each ray ends at (0.5, 0, 0). Rays from outside enter the object at z = 0.5. Rays from inside start at
    // a camera inside the object.
    for (shape, z, length) in [
        (tube, 1.5, f64::hypot(0.5, 1.0 / 6.0)),
        (&mesh, 2.0, f64::hypot(0.5, 0.125)),
        (tube, 0.25, f64::hypot(0.5, 0.25)),
        (&mesh, 0.25, f64::hypot(0.5, 0.25)),
    ] {
        let text = format!(
            "wavelengths_nm = [550]\n[render]\nspp = 4\nmax_depth = 4\n[camera]\nresolution = [1, 1]\nfx = 1e7\n\
             pose.look_at = {{ origin = [0, 0, {z:?}], target = [0.5, 0, 0] }}\n[[emitters]]\nenvironment = {{ radiance = 1 }}\n\
             [media.fog.homogeneous]\nabsorption = 2\n[materials.b.null]\n[materials.c.null]\n\
             [[objects]]\nmaterial = \"b\"\ninterior = \"fog\"\nshape.{shape}\n[[slices]]\nname = \"m\"\n"
        );
        let got = f64::from(crate::support::render_text(&text).mean("m").data[0]);
        let want = f64::exp(-2.0 * length);
        assert!((got / want - 1.0).abs() < 1e-4, "{shape} from {z}: {got} is not {want}");
    }
}
