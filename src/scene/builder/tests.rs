//! Scenes in code are the scenes of files, and their faults have places.

use super::*;
use crate::{Camera, Emitter, Material, Medium, Object, Projector, Slice};
use glam::{Vec2, Vec3};
use syntax::medium::PhaseFile;
use syntax::texture::ImageAlbedo;
use tensor::field::Field;
use tensor::memory::Arrays;
use transport::render::schedule::{Share, Unwatched, render};

/// A tent of two triangles with normals and texture coordinates.
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
    let mut bytes = std::io::Cursor::new(vec![]);
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("a picture");
    bytes.into_inner()
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
        .camera(
            Camera::look_at([0.0, 0.2, 4.0], [0.0; 3])
                .fov_x_deg(40.0)
                .resolution(16, 12),
        )
        .projector(
            Projector::new(
                Camera::look_at([1.0, 1.0, 4.0], [0.0; 3])
                    .fov_x_deg(45.0)
                    .resolution(8, 8),
            )
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
        .object(
            Object::mesh("tent")
                .material("cloth")
                .translate([-0.5, -0.6, 0.5]),
        )
        .object(
            Object::sphere([0.6, 0.5, 0.6], 0.3)
                .material("edge")
                .interior("fog", 0),
        )
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
    fields
        .map(|t| t.data.iter().map(|v| v.to_bits()).collect())
        .collect()
}

#[test]
fn a_scene_in_code_is_the_scene_of_its_file() {
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

/// The place and the message of what is wrong with a scene.
fn refusal(scene: SceneBuilder, words: &str) -> String {
    let error = scene
        .build()
        .err()
        .unwrap_or_else(|| panic!("not refused: {words}"));
    assert!(error.help.is_some() && error.span.is_none(), "{error}");
    error.to_string().lines().next().unwrap_or_default().to_owned()
}

#[test]
fn faults_name_what_was_given() {
    let said = |scene: SceneBuilder, words: &str| {
        let message = refusal(scene, words);
        assert!(message.contains(words), "{message}");
    };
    said(
        SceneBuilder::new(),
        "scene in code: camera: the scene has no camera",
    );
    said(
        in_code().material("red", Material::diffuse(1.5)),
        "scene in code: materials.red.diffuse.albedo: albedo is 1.5",
    );
    said(
        in_code().object(Object::sphere([0.0; 3], 1.0).material("wood")),
        "scene in code: objects[3].material: there is no material `wood`",
    );
    said(
        in_code().object(Object::mesh("roof").material("gold")),
        "scene in code: objects[3].shape.ply.file: cannot read roof",
    );
    said(
        in_code().slice(Slice::new("flight")),
        "scene in code: slices[1].name: a second slice `flight`",
    );
    said(in_code().spp(0), "scene in code: render.spp: spp is 0");
    said(
        in_code().material("gold", Material::diffuse(0.5)),
        "scene in code: materials.gold: the name is given twice",
    );
    let mut mesh = tent();
    mesh.normals.pop();
    said(
        in_code().mesh("roof", &mesh),
        "scene in code: mesh(\"roof\"): the mesh has 3 normals for 4 vertices",
    );
    said(in_code().mesh("roof.obj", &tent()), "another format");
}
