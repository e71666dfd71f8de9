//! Tests that scenes built in code equal scenes from files, and that their errors have locations.

use super::*;
use crate::{Camera, Emitter, Material, Medium, Object, Projector, Slice};
use glam::{Vec2, Vec3};
use syntax::medium::PhaseFile;
use syntax::texture::ImageAlbedo;
use tensor::field::Field;
use tensor::memory::Arrays;
use transport::render::schedule::{Share, Unwatched, render};

/// Returns a mesh of two triangles with normals and texture coordinates.
fn tent() -> Mesh {
    let point = |x, y, z| Vec3::new(x, y, z);
    Mesh {
        positions: vec![
            point(-0.4, 0.0, 0.0),
            point(0.4, 0.0, 0.0),
            point(0.4, 0.5, 0.2),
            point(-0.4, 0.5, 0.1),
        ],
        normals: vec![Vec3::Z, Vec3::Z, point(0.0, 0.6, 0.8), Vec3::Z],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        indices: vec![[0, 1, 2], [0, 2, 3]],
    }
}

fn checks() -> Vec<u8> {
    let image = image::RgbImage::from_fn(4, 4, |x, y| image::Rgb([(60 * x) as u8, 200, (50 * y) as u8]));
    picture(image, image::ImageFormat::Png)
}

const FILE: &str = r#"
wavelengths_nm = [450, 650]
[render]
spp = 3
seed = 7
tile = 8
[camera]
resolution = [16, 12]
fov_x_deg = 40
pose.look_at = { origin = [0, 0.2, 4], target = [0, 0, 0] }
[projector]
resolution = [8, 8]
fov_x_deg = 45
irradiance = [2, 3]
pose.look_at = { origin = [1, 1, 4], target = [0, 0, 0] }
[[emitters]]
environment.radiance = 0.1
[materials]
gold.rough_conductor = { metal = "Au", alpha = 0.3 }
cloth.diffuse.albedo.image = "checks.png"
edge.null = {}
[media.fog]
homogeneous = { absorption = 0.1, scattering = [0.5, 0.7], phase = "isotropic" }
[[objects]]
shape.sphere = { radius = 0.5 }
material = "gold"
[[objects]]
shape.ply.file = "tent.ply"
material = "cloth"
transform.translate = [-0.5, -0.6, 0.5]
[[objects]]
shape.sphere = { center = [0.6, 0.5, 0.6], radius = 0.3 }
material = "edge"
interior = "fog"
[[slices]]
name = "flight"
polarization = "mueller"
time = { bin_ps = 500, bins = 80 }
projector = { columns = [2, 3] }
"#;

fn in_code() -> SceneBuilder {
    SceneBuilder::new()
        .name("file")
        .wavelengths_nm([450.0, 650.0])
        .spp(3)
        .seed(7)
        .tile(8)
        .camera(Camera::look_at([0.0, 0.2, 4.0], [0.0; 3]).fov_x_deg(40.0).resolution(16, 12))
        .projector(
            Projector::new(Camera::look_at([1.0, 1.0, 4.0], [0.0; 3]).fov_x_deg(45.0).resolution(8, 8))
                .irradiance([2.0, 3.0]),
        )
        .emitter(Emitter::environment(0.1))
        .mesh("tent", &tent())
        .file_in_memory("checks.png", checks())
        .material("gold", Material::rough_metal("Au", 0.3))
        .material("cloth", Material::diffuse(ImageAlbedo::new("checks.png")))
        .material("edge", Material::Null(syntax::material::NullFile::default()))
        .medium("fog", Medium::homogeneous(0.1, [0.5, 0.7], PhaseFile::Isotropic))
        .object(Object::sphere([0.0; 3], 0.5).material("gold"))
        .object(Object::mesh("tent").material("cloth").translate([-0.5, -0.6, 0.5]))
        .object(Object::sphere([0.6, 0.5, 0.6], 0.3).material("edge").interior("fog", 0))
        .slice(
            Slice::new("flight")
                .mueller()
                .time(0.0, 500.0, 80)
                .projector(syntax::slice::ProjectorSelectFile::Columns(vec![2, 3])),
        )
}

fn rendered(scene: &Scene) -> Vec<Vec<u32>> {
    let mut arrays = Arrays::default();
    render(scene, &[], Share::default(), &mut arrays, &Unwatched).expect("a render");
    let fields = Field::ALL.iter().filter_map(|f| arrays.get("flight", *f));
    fields.map(|t| t.data.iter().map(|v| v.to_bits()).collect()).collect()
}

#[test]
fn a_scene_in_code_equals_the_scene_of_a_file() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("tent.ply"), write_ply::write(&tent())).expect("a mesh");
    std::fs::write(folder.path().join("checks.png"), checks()).expect("an image");
    let file = crate::from_text(&folder.path().join("file.toml"), FILE).expect("a scene");
    let code = in_code().build().expect("a scene");
    assert_eq!(file.name, code.name);
    let (a, b) = (rendered(&file), rendered(&code));
    assert!(!a.is_empty() && a[0].iter().any(|v| *v != 0));
    assert!(a == b, "the renders differ");
}

/// Returns the bytes of an image encoded in the given file format.
fn picture(image: impl Into<image::DynamicImage>, format: image::ImageFormat) -> Vec<u8> {
    import::picture::encoded(&image.into(), format).expect("a picture")
}

/// Builds a scene with an image and returns the first texel of the image.
fn texel(bytes: Vec<u8>, raw: bool) -> f32 {
    let image = ImageAlbedo { raw, ..ImageAlbedo::new("picture") };
    let scene = SceneBuilder::new()
        .camera(Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]).fov_x_deg(40.0).resolution(4, 4))
        .emitter(Emitter::environment(1.0))
        .file_in_memory("picture", bytes)
        .material("cloth", Material::diffuse(image))
        .object(Object::sphere([0.0; 3], 0.5).material("cloth"))
        .build()
        .expect("a scene");
    scene.materials.textures.texels[0][0]
}

/// Tests that the data type, not the file name, determines the encoding of an image. Bytes are sRGB-encoded
/// (IEC 61966-2-1). Floating-point values are linear.
#[test]
fn real_numbers_of_images_are_linear() {
    use image::ImageFormat::{Hdr, OpenExr, Png};
    let bytes = picture(image::RgbImage::from_pixel(2, 2, image::Rgb([128; 3])), Png);
    let real = image::Rgb32FImage::from_pixel(2, 2, image::Rgb([0.5; 3]));
    let encoded = ((128.0 / 255.0 + 0.055_f32) / 1.055).powf(2.4);
    assert!((texel(bytes.clone(), false) - encoded).abs() < 1e-6);
    assert!((texel(bytes, true) - 128.0 / 255.0).abs() < 1e-6);
    for format in [OpenExr, Hdr] {
        for raw in [false, true] {
            assert!((texel(picture(real.clone(), format), raw) - 0.5).abs() < 0.003, "{format:?}");
        }
    }
}

/// Tests that the numbers of an image are its undecoded first channel, or the Rec. 709 luminance of its
/// colours. Colours are decoded unless `raw` is set.
#[test]
fn numbers_of_images_are_channels_or_luminances() {
    let bytes =
        picture(image::RgbImage::from_pixel(2, 2, image::Rgb([255, 128, 0])), image::ImageFormat::Png);
    let weight = |raw, luminance| {
        let image = ImageAlbedo { raw, luminance, ..ImageAlbedo::new("picture") };
        let both = Material::Blend(syntax::material::BlendFile {
            a: "dark".to_owned().into(),
            b: "light".to_owned().into(),
            weight: syntax::texture::ScalarFile::from(image).into(),
        });
        let scene = SceneBuilder::new()
            .camera(Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]).fov_x_deg(40.0).resolution(4, 4))
            .emitter(Emitter::environment(1.0))
            .file_in_memory("picture", bytes.clone())
            .material("dark", Material::diffuse(0.2))
            .material("light", Material::diffuse(0.8))
            .material("both", both)
            .object(Object::sphere([0.0; 3], 0.5).material("both"))
            .build()
            .expect("a scene");
        scene.materials.textures.texels[0][0]
    };
    let code = 128.0 / 255.0_f32;
    let green = ((code + 0.055) / 1.055).powf(2.4);
    for (raw, luminance, expected) in [
        (false, false, 1.0),
        (true, false, 1.0),
        (false, true, 0.2126 + 0.7152 * green),
        (true, true, 0.2126 + 0.7152 * code),
    ] {
        let found = weight(raw, luminance);
        assert!((found - expected).abs() < 1e-5, "{found}, not {expected}");
    }
}

#[test]
fn a_scene_lists_its_files() {
    let code = in_code().build().expect("a scene");
    assert_eq!(code.files, ["checks.png", "tent"]);
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).expect("writes");
    std::fs::create_dir(folder.path().join("meshes")).expect("a folder");
    // A glTF document with an external buffer, and an OBJ whose material library names an image.
    let positions: Vec<u8> =
        [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    write("meshes/a b.bin", &positions);
    write(
        "meshes/t.gltf",
        br#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "buffers": [{"byteLength": 36, "uri": "a%20b.bin"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}]}"#,
    );
    write("meshes/o.obj", b"mtllib o.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl red\nf 1/1 2/1 3/1\n");
    write("meshes/o.mtl", b"newmtl red\nKd 1 0 0\nmap_Kd checks.png\n");
    write("meshes/checks.png", &checks());
    let text = r#"
        camera = { resolution = [4, 4], fov_x_deg = 40, pose.look_at = { origin = [0, 0, 4], target = [0, 0, 0] } }
        emitters = [{ environment = { radiance = 1 } }]
        materials.wall.diffuse.albedo = 0.5
        objects = [
            { shape.gltf = { file = "meshes/t.gltf" }, material = "wall" },
            { shape.obj = { file = "meshes/o.obj", materials = true }, material = "wall" },
        ]
    "#;
    let scene = crate::from_text(&folder.path().join("s.toml"), text).expect("a scene");
    assert_eq!(
        scene.files,
        ["meshes/a b.bin", "meshes/checks.png", "meshes/o.mtl", "meshes/o.obj", "meshes/t.gltf"]
    );
}

/// Builds an invalid scene and returns the location and the message of the error.
fn refusal(scene: SceneBuilder, words: &str) -> String {
    let error = scene.build().err().unwrap_or_else(|| panic!("not refused: {words}"));
    assert!(error.help.is_some() && error.span.is_none(), "{error}");
    error.to_string().lines().next().unwrap_or_default().to_owned()
}

#[test]
fn errors_name_the_key() {
    let refused = |scene: SceneBuilder, words: &str| {
        let message = refusal(scene, words);
        assert!(message.contains(words), "{message}");
    };
    refused(SceneBuilder::new(), "scene in code: camera: the scene has no camera");
    refused(
        in_code().material("red", Material::diffuse(1.5)),
        "scene in code: materials.red.diffuse.albedo: albedo is 1.5",
    );
    refused(
        in_code().object(Object::sphere([0.0; 3], 1.0).material("wood")),
        "scene in code: objects[3].material: unknown material `wood`",
    );
    refused(
        in_code().object(Object::mesh("roof").material("gold")),
        "scene in code: objects[3].shape.ply.file: cannot read roof",
    );
    refused(
        in_code().slice(Slice::new("flight")),
        "scene in code: slices[1].name: duplicate slice name `flight`",
    );
    refused(in_code().spp(0), "scene in code: render.spp: spp is 0");
    refused(
        in_code().material("gold", Material::diffuse(0.5)),
        "scene in code: materials.gold: duplicate name",
    );
    let mut mesh = tent();
    mesh.normals.pop();
    refused(
        in_code().mesh("roof", &mesh),
        "scene in code: mesh(\"roof\"): invalid mesh: the mesh has 3 normals for 4 vertices",
    );
    refused(in_code().mesh("roof.obj", &tent()), "the extension of a file format");
}
