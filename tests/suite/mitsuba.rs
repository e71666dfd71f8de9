//! There and back again: what is expressible comes back the same, what is not is refused by name.

use glam::Vec3A;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use sunstone::base::locate::InputError;
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::sampling::warp;
use sunstone::optics::spectrum::Spectral;
use sunstone::scene::mitsuba::export::Export;
use sunstone::scene::mitsuba::import::Import;
use sunstone::transport::device::pinhole::Pinhole;
use sunstone::transport::geometry::ray::Ray;
use sunstone::transport::material::Lobe;
use sunstone::transport::material::measured::axes::Axes;
use sunstone::transport::material::measured::write::write as write_table;
use sunstone::transport::scene::Scene;

/// Every material and every shape that Mitsuba has too.
const ALL: &str = r#"
wavelengths_nm = [550]
[render]
spp = 7
max_depth = 9
rr_depth = 3
[camera]
resolution = [24, 16]
fov_x_deg = 42
cx = 13.5
cy = 7
pose.look_at = { origin = [0.5, 1, 6], target = [0, 0.1, 0], up = [0.1, 1, 0] }
[projector]
resolution = [20, 12]
fov_y_deg = 33
irradiance = 2.5
pose.look_at = { origin = [-0.5, 1, 6], target = [0, 0, 0] }
[[emitters]]
point = { position = [1, 2, 3], intensity = 4 }
[[emitters]]
environment = { radiance = 0.25 }
[materials]
grey.diffuse.albedo = 0.3
tiles.diffuse.albedo = { image = "tiles.png", scale = 0.9 }
"gold leaf".conductor.metal = "Au"
rough.rough_conductor = { n = 0.4, k = 2.5, alpha = 0.3, masking = "separable" }
spotted.rough_conductor = { metal = "Ag", alpha = { image = "tiles.png" }, distribution = "beckmann", masking = "separable" }
glass.dielectric = { ior = 1.6, exterior_ior = 1.1 }
frosted.rough_dielectric = { ior = "N-BK7", alpha = 0.2, masking = "separable" }
plastic.plastic = { albedo = { image = "tiles.png" }, ior = 1.4, alpha = 0.15, specular = 0.7, masking = "separable" }
polarizer.polarizer = { angle_deg = 33, transmittance = 0.8 }
retarder.retarder = { retardance_deg = 91, angle_deg = -20, transmittance = 0.7, tilt = "cosine" }
table.measured.file = "table.pbsdf"
worn.blend = { a = "rough", b = "glass", weight = { image = "tiles.png", scale = 0.5 } }
sides.two_sided = { front = "rough", back = "grey" }
front.two_sided = { front = "mix" }
mix.blend = { a = "grey", b = "gold leaf", weight = 0.2 }
bumpy.normal_map = { material = "plastic", image = "normals.png" }
[[objects]]
shape.sphere = { center = [-2, 0, 0], radius = 0.4 }
material = "worn"
[[objects]]
shape.sphere = { radius = 0.4 }
material = "glass"
transform = { scale = 1.1, rotate_deg = [10, 20, 30], translate = [-1, 0, 0] }
[[objects]]
shape.disk = { center = [0, 0, 0.2], normal = [0.2, 0.1, 1], radius = 0.4 }
material = "plastic"
[[objects]]
shape.cylinder = { p0 = [1, -0.4, 0], p1 = [1.1, 0.4, 0.1], radius = 0.3, caps = true }
material = "spotted"
[[objects]]
shape.cube = { min = [1.7, -0.3, -0.3], max = [2.3, 0.3, 0.3] }
material = "frosted"
transform.rotate_deg = [0, 12, 0]
[[objects]]
shape.cube = {}
material = "tiles"
transform = { scale = 0.3, translate = [2, 1, 0] }
[[objects]]
shape.rectangle = { corner = [-2.4, 0.7, 0], u = [0.8, 0, 0], v = [0.1, 0.7, 0.1] }
material = "polarizer"
[[objects]]
shape.rectangle = { corner = [-1.4, 0.7, 0], u = [0.8, 0, 0.2], v = [0, 0.7, 0.1] }
material = "retarder"
[[objects]]
shape.rectangle = { corner = [-0.4, 0.7, 0], u = [0.8, 0, 0.2], v = [0, 0.7, 0.1] }
material = "bumpy"
[[objects]]
shape.rectangle = { corner = [1.3, -1.1, 0], u = [-0.8, 0, 0.2], v = [0, 0.6, 0.1] }
material = "sides"
[[objects]]
shape.rectangle = { corner = [0.4, -1.1, 0], u = [0.7, 0, 0.2], v = [0, 0.6, 0.1] }
material = "front"
transform.scale = [1, 1, -1]
[[objects]]
shape.obj = { file = "tent.obj", flat = true }
material = "rough"
transform.translate = [-0.5, -1, 0]
[[objects]]
shape.obj = { file = "tent.obj" }
material = "table"
transform.translate = [-1.5, -1, 0]
[[slices]]
name = "mueller"
polarization = "mueller"
"#;

/// A folder with the files that [`ALL`] names.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let tile = |x: u32, y: u32| ((x * 50 + y * 71 + x * y * 13) % 200 + 40) as u8;
    image::GrayImage::from_fn(4, 3, |x, y| image::Luma([tile(x, y)]))
        .save(at("tiles.png"))
        .unwrap();
    image::RgbImage::from_fn(4, 3, |x, y| {
        image::Rgb([128 + 5 * x as u8, 120 + 7 * y as u8, 240])
    })
    .save(at("normals.png"))
    .unwrap();
    let tent = "v -0.4 0 0\nv 0.4 0 0\nv 0.4 0.5 0.2\nv -0.4 0.5 0.1\nvt 0 0\nvt 1 0.1\nvt 1 1\nvt 0 1\n\
                vn 0 0 1\nvn 0.1 0 1\nvn 0 0.1 1\nvn 0.1 0.1 1\nf 1/1/1 2/2/2 3/3/3\nf 1/1/1 3/3/3 4/4/4\n";
    std::fs::write(at("tent.obj"), tent).unwrap();
    write_table(
        &at("table.pbsdf"),
        &Axes::even([5, 4, 4], vec![500, 550, 600]),
        |_, slab| {
            for (k, v) in slab.iter_mut().enumerate() {
                *v = if k % 16 == 0 {
                    0.4
                } else {
                    0.02 * (k % 7) as f32 - 0.05
                } + 1e-3 * (k / 48) as f32;
            }
        },
    )
    .unwrap();
    folder
}

fn exported(folder: &Path, text: &str) -> Result<Export, InputError> {
    Export::from_text(&folder.join("scene.toml"), text, None)
}

fn imported(folder: &Path, xml: &str) -> Result<Import, InputError> {
    Import::from_text(
        &folder.join("scene.xml"),
        xml,
        &folder.join("scene.toml"),
        &BTreeMap::new(),
    )
}

fn near(a: f32, b: f32, scale: f32) -> bool {
    (a - b).abs() <= 2e-4 * scale.max(1e-3)
}

fn same_device(a: &Pinhole, b: &Pinhole) {
    assert_eq!(a.resolution, b.resolution);
    assert!(
        (a.focal - b.focal).length() < 1e-9 * a.focal.x,
        "{} {}",
        a.focal,
        b.focal
    );
    assert!((a.principal - b.principal).length() < 1e-9);
    assert_eq!(a.origin, b.origin);
    for (x, y) in [
        (a.axes.x_axis, b.axes.x_axis),
        (a.axes.y_axis, b.axes.y_axis),
        (a.axes.z_axis, b.axes.z_axis),
    ] {
        assert!((x - y).length() < 1e-6);
    }
}

fn same_spectrum(a: Spectral, b: Spectral) {
    for (x, y) in a.to_array().into_iter().zip(b.to_array()) {
        assert!((x - y).abs() <= 1e-6 * x.abs(), "{x} {y}");
    }
}

/// Asserts that two scenes are one: devices, emitters, and what rays meet, 16 elements and all. Gives how many rays met
/// something, and how many comparisons of matrices were made.
fn assert_same(a: &Scene, b: &Scene) -> (usize, usize) {
    assert_eq!(a.wavelengths, b.wavelengths);
    assert_eq!(a.settings.spp, b.settings.spp);
    assert_eq!(a.settings.max_depth, b.settings.max_depth);
    assert_eq!(a.settings.rr_depth, b.settings.rr_depth);
    same_device(&a.camera, &b.camera);
    assert_eq!(a.projector.is_some(), b.projector.is_some());
    if let (Some(p), Some(q)) = (&a.projector, &b.projector) {
        same_device(&p.pinhole, &q.pinhole);
        same_spectrum(p.irradiance, q.irradiance);
    }
    assert_eq!(a.points.len(), b.points.len());
    for (p, q) in a.points.iter().zip(&b.points) {
        assert_eq!(p.position, q.position);
        same_spectrum(p.intensity, q.intensity);
    }
    assert_eq!(a.environment.is_some(), b.environment.is_some());
    if let (Some(p), Some(q)) = (a.environment, b.environment) {
        same_spectrum(p.radiance, q.radiance);
    }
    assert_eq!(a.geometry.counts(), b.geometry.counts());
    let mut stream = Stream::new(11, 0, 0);
    let (mut hits, mut matrices) = (0, 0);
    for _ in 0..3000 {
        let target = Vec3A::new(stream.uniform() * 5.0 - 2.5, stream.uniform() * 3.0 - 1.2, 0.0);
        let origin = target + warp::sphere(stream.uniform2()) * 5.0;
        let ray = Ray {
            origin,
            dir: (target - origin).normalize(),
        };
        let (ha, hb) = (
            a.geometry.intersect(&ray, f32::INFINITY),
            b.geometry.intersect(&ray, f32::INFINITY),
        );
        assert_eq!(ha.is_some(), hb.is_some(), "{ray:?}");
        let (Some(ha), Some(hb)) = (ha, hb) else { continue };
        hits += 1;
        let (sa, sb) = (a.geometry.surface(&ray, &ha), b.geometry.surface(&ray, &hb));
        assert!((sa.p - sb.p).length() < 1e-5);
        assert!((sa.ng - sb.ng).length() < 1e-4 && (sa.ns - sb.ns).length() < 1e-4);
        assert!((sa.tangent_frame().x_axis - sb.tangent_frame().x_axis).length() < 1e-3);
        let (wo, wi) = (-ray.dir, warp::sphere(stream.uniform2()));
        let x = sunstone::optics::polarization::frame::perpendicular;
        for way in [wi, -wi] {
            let values = [(a, &sa), (b, &sb)].map(|(scene, at)| {
                let m = scene.materials.eval(at.material, at, wo, way);
                m.map(|m| m.between(wo, x(wo), way, x(way)).lane(0))
            });
            matrices += usize::from(same_matrix(values));
        }
        for lobe in [Lobe::Reflected, Lobe::Transmitted] {
            let values = [(a, &sa), (b, &sb)].map(|(scene, at)| {
                let found = scene.materials.specular(at.material, at, wo, lobe, 0);
                found.map(|s| s.scatter.between(wo, x(wo), s.wi, x(s.wi)).lane(0))
            });
            matrices += usize::from(same_matrix(values));
        }
    }
    (hits, matrices)
}

/// True if there was anything to compare. At the horizon f32 of moved shapes decides; values near zero may be missing.
fn same_matrix([a, b]: [Option<[[f32; 4]; 4]>; 2]) -> bool {
    let zero = [[0.0; 4]; 4];
    let compared = a.is_some() && b.is_some();
    let (a, b) = (a.unwrap_or(zero), b.unwrap_or(zero));
    let scale = a[0][0].max(b[0][0]);
    for (x, y) in a.as_flattened().iter().zip(b.as_flattened()) {
        assert!(near(*x, *y, scale.max(0.1)), "{a:?} {b:?}");
    }
    compared
}

#[test]
fn there_and_back_is_the_same_scene() {
    let folder = folder();
    let path = folder.path().join("scene.toml");
    let export = exported(folder.path(), ALL).unwrap();
    let out = folder.path().join("out");
    export.write(&out, false).unwrap();
    let back = Import::load(&out.join("scene.xml"), &path, &BTreeMap::new()).unwrap();
    let (a, b) = (
        sunstone::scene::from_text(&path, ALL).unwrap(),
        sunstone::scene::from_text(&path, &back.toml).unwrap(),
    );
    let (hits, matrices) = assert_same(&a, &b);
    assert!(hits > 500 && matrices > 800, "{hits} {matrices}");
}

#[test]
fn several_wavelengths_come_back() {
    let folder = folder();
    let path = folder.path().join("scene.toml");
    let text = ALL
        .replace("wavelengths_nm = [550]", "wavelengths_nm = [450, 550, 660]")
        .replace("resolution = [20, 12]", "resolution = [20, 20]")
        .replace("irradiance = 2.5", "irradiance = [2, 3, 4]")
        .replace("intensity = 4", "intensity = [1, 0, 2]")
        .replace("ior = \"N-BK7\"", "ior = 1.5")
        .replace("ior = 1.4,", "ior = [1.41, 1.4, 1.39],");
    let export = exported(folder.path(), &text).unwrap();
    export.write(&folder.path().join("out"), false).unwrap();
    let xml = folder.path().join("out/scene.xml");
    let back = Import::load(&xml, &path, &BTreeMap::new()).unwrap();
    let (a, b) = (
        sunstone::scene::from_text(&path, &text).unwrap(),
        sunstone::scene::from_text(&path, &back.toml).unwrap(),
    );
    assert_same(&a, &b);
    // One of them alone is the scene at that wavelength.
    let one = Export::from_text(&path, &text, Some(450.0)).unwrap();
    assert!(!one.xml.contains("450:"), "plain numbers for mono variants");
    assert!(one.xml.contains("name=\"intensity\" value=\"1\""), "{}", one.xml);
}

/// What is put in place of a passage of [`ALL`], and words of the message.
const INEXPRESSIBLE: &[(&str, &str, &str)] = &[
    (
        "cx = 13.5",
        "cx = 13.5\nfx = 30\nfy = 31",
        "non-square pixels of the camera",
    ),
    (
        "cx = 13.5",
        "cx = 13.5\ndistortion.k1 = 0.01",
        "distortion of the camera",
    ),
    (
        "irradiance = 2.5",
        "irradiance = 2.5\ncx = 3",
        "principal point off the centre",
    ),
    (
        "albedo = 0.3",
        "albedo = 0.3\nx.crystal = { name = \"quartz\", axis = [0, 0, 1] }",
        "a crystal (material `x`)",
    ),
    (
        "albedo = 0.3",
        "albedo = 0.3\nx.coated_conductor = { metal = \"Ag\", films = [] }",
        "thin films on a conductor",
    ),
    (
        "albedo = 0.3",
        "albedo = 0.3\nx.partial_depolarizer = { material = \"grey\", fraction = 0.5 }",
        "a partial depolarizer",
    ),
    ("tilt = \"cosine\"", "tilt = \"plate\"", "how the retardance"),
    ("tilt = \"cosine\"", "tilt = \"constant\"", "how the retardance"),
    (
        "angle_deg = -20",
        "axis = [1, 0, 0]",
        "an axis in world space (material `retarder`)",
    ),
    (
        "angle_deg = 33",
        "axis = [1, 0, 0]",
        "an axis in world space (material `polarizer`)",
    ),
    ("angle_deg = 33", "extinction = 0.01", "some of the blocked light"),
    ("specular = 0.7", "interreflection = true", "interreflection"),
    (
        "specular = 0.7",
        "single_scatter = { albedo = 0.1, alpha = 0.5 }",
        "single scattering",
    ),
    (
        "image = \"normals.png\"",
        "image = \"normals.png\", strength = 2",
        "a strength of normals",
    ),
    (
        "front = \"rough\", back",
        "front = \"glass\", back",
        "one side of this material (material `glass`)",
    ),
    (
        "material = \"plastic\"\n[[",
        "material = \"polarizer\"\n[[",
        "a disk of a material with a direction",
    ),
    (
        "{ radius = 0.4 }",
        "{ radius = 0.4 }\ntransform = { scale = [1, 2, 1] }\nname = \"egg\"",
        "an ellipsoid",
    ),
    (
        "material = \"spotted\"",
        "material = \"spotted\"\ntransform = { scale = [1, 2, 1], rotate_deg = [0, 0, 50] }",
        "a tube that is not round",
    ),
    (
        "wavelengths_nm = [550]",
        "wavelengths_nm = [450, 550]",
        "refractive index that differs between wavelengths (material `frosted`)",
    ),
    ("irradiance = 2.5", "irradiance = [1, 2]", "an oblong projector"),
];

#[test]
fn what_mitsuba_lacks_is_refused_by_name() {
    let folder = folder();
    let mut wrong = vec![];
    for (from, to, message) in INEXPRESSIBLE {
        let mut text = ALL.replacen(from, to, 1);
        assert_ne!(text, ALL, "{from}");
        if to.starts_with("albedo") {
            text = text.replacen("material = \"worn\"", "material = \"x\"", 1);
        }
        if to.contains("egg") {
            text = text.replacen(
                "\ntransform = { scale = 1.1, rotate_deg = [10, 20, 30], translate = [-1, 0, 0] }",
                "",
                1,
            );
        }
        if to.contains("[1, 2]") {
            text = text
                .replacen("wavelengths_nm = [550]", "wavelengths_nm = [450, 550]", 1)
                .replacen("\"N-BK7\"", "1.5", 1);
        }
        if to.contains("fx = 30") {
            text = text.replacen("fov_x_deg = 42\n", "", 1);
        }
        match exported(folder.path(), &text) {
            Err(e) if e.message.contains(message) && e.line_column().is_some() && e.help.is_some() => {}
            other => wrong.push((*message, other.map(|_| ()).map_err(|e| e.to_string()))),
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn colours_of_images_need_one_wavelength() {
    let folder = folder();
    image::RgbImage::from_fn(4, 3, |x, _| image::Rgb([50 * x as u8, 20, 90]))
        .save(folder.path().join("tiles.png"))
        .unwrap();
    let text = ALL
        .replace("wavelengths_nm = [550]", "wavelengths_nm = [450, 660]")
        .replace("\"N-BK7\"", "1.5");
    let e = exported(folder.path(), &text).unwrap_err();
    assert!(e.message.contains("image of colours"), "{e}");
    let path = folder.path().join("scene.toml");
    Export::from_text(&path, &text, Some(660.0)).unwrap();
}

#[test]
fn differences_of_models_are_said() {
    let folder = folder();
    let text = ALL.replace("masking = \"separable\"", "masking = \"correlated\"");
    let notes = exported(folder.path(), &text).unwrap().notes.join("\n");
    for word in [
        "`frosted`: Mitsuba's roughdielectric",
        "`rough`: Mitsuba masks",
        "retarder",
        "twosided",
        "`bumpy`",
    ] {
        assert!(notes.contains(word), "{word}: {notes}");
    }
    let notes = exported(folder.path(), ALL).unwrap().notes.join("\n");
    assert!(!notes.contains("masks"), "{notes}");
}

#[test]
fn the_mirror_room_goes_there_and_back() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/mirror_room/scene.toml");
    let export = Export::load(&path, None).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("room");
    export.write(&out, false).unwrap();
    let toml = folder.path().join("back.toml");
    let back = Import::load(&out.join("scene.xml"), &toml, &BTreeMap::new()).unwrap();
    back.write(&toml, false).unwrap();
    // The knot has correlated masking there; Mitsuba's is separable.
    let text = std::fs::read_to_string(&path)
        .unwrap()
        .replace("alpha = 0.18", "alpha = 0.18, masking = \"separable\"");
    let (hits, _) = assert_same(
        &sunstone::scene::from_text(&path, &text).unwrap(),
        &sunstone::scene::load(&toml).unwrap(),
    );
    assert!(hits > 1000, "{hits}");
    assert!(back.write(&toml, false).is_err(), "it is there already");
}

#[test]
fn a_folder_in_use_is_left_alone() {
    let folder = folder();
    let export = exported(folder.path(), ALL).unwrap();
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    export.write(&out, false).unwrap();
    assert!(out.join("table.pbsdf").exists());
    std::fs::write(out.join("mine.txt"), "mine").unwrap();
    std::fs::write(out.join("scene.xml"), "old").unwrap();
    assert!(export.write(&out, false).is_err());
    assert_eq!(std::fs::read_to_string(out.join("scene.xml")).unwrap(), "old");
    export.write(&out, true).unwrap();
    assert_eq!(
        std::fs::read_to_string(out.join("scene.xml")).unwrap(),
        export.xml
    );
    assert_eq!(std::fs::read_to_string(out.join("mine.txt")).unwrap(), "mine");
    // A file that cannot be copied leaves nothing behind.
    std::fs::remove_file(folder.path().join("table.pbsdf")).unwrap();
    let fresh = folder.path().join("fresh");
    assert!(export.write(&fresh, false).is_err());
    let left: Vec<_> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert!(
        !left
            .iter()
            .any(|n| n.to_string_lossy().starts_with('.') || n == "fresh"),
        "{left:?}"
    );
}

/// A scene as a person writes it.
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
fn a_scene_by_hand_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let import = imported(folder.path(), HAND).unwrap();
    let scene = sunstone::scene::from_text(&folder.path().join("scene.toml"), &import.toml).unwrap();
    // The vertical field of view is the smaller one: 30° over 16 pixels.
    let focal = 8.0 / 15_f64.to_radians().tan();
    assert!((scene.camera.focal.x - focal).abs() < 1e-9);
    assert!(
        (scene.camera.right() - Vec3A::X).length() < 1e-6,
        "image right is +x, seen along -z"
    );
    assert!((scene.camera.axes.y_axis + Vec3A::Y).length() < 1e-6);
    assert_eq!(scene.points[0].intensity.to_array()[..3], [1.5, 2.5, 3.6]);
    assert!(
        import
            .toml
            .contains("wall.diffuse = { albedo = [0.3, 0.2, 0.1] }"),
        "{}",
        import.toml
    );
    let ray = |x: f32, y: f32| Ray {
        origin: Vec3A::new(x, y, 4.0),
        dir: Vec3A::NEG_Z,
    };
    let depth = |x, y| scene.geometry.intersect(&ray(x, y), 100.0).map(|h| h.t);
    // Scaled along x, then turned: it is tall.
    assert_eq!((depth(0.0, -1.9), depth(-1.1, 0.0)), (Some(5.0), None));
    assert!((depth(1.0, 2.0).unwrap() - 3.5).abs() < 1e-6);
    let define = BTreeMap::from([
        ("fov".to_owned(), "40".to_owned()),
        ("wavelengths_nm".to_owned(), "550".to_owned()),
    ]);
    let (xml, toml) = (folder.path().join("a.xml"), folder.path().join("a.toml"));
    let import = Import::from_text(&xml, HAND, &toml, &define).unwrap();
    assert!(
        import.toml.contains("wall.diffuse = { albedo = [0.2] }"),
        "{}",
        import.toml
    );
    let unknown = BTreeMap::from([("fow".to_owned(), "40".to_owned())]);
    let e = Import::from_text(&xml, HAND, &toml, &unknown).unwrap_err();
    assert!(e.message.contains("`fow`"), "{e}");
}

/// A change of [`HAND`], the line of the fault, words of the message.
const UNREADABLE: &[(&str, &str, usize, &str)] = &[
    ("version=\"3.0.0\"", "version=\"0.6.0\"", 1, "version `0.6.0`"),
    ("</scene>", "", 1, "this is no XML"),
    ("type=\"path\"", "type=\"volpath\"", 3, "no integrator `volpath`"),
    (
        "type=\"perspective\"",
        "type=\"thinlens\"",
        4,
        "no sensor `thinlens`",
    ),
    ("$fov", "$angle", 5, "`$angle` uses a parameter"),
    ("value=\"smaller\"", "value=\"wide\"", 4, "fov_axis is `wide`"),
    (
        "type=\"diffuse\"",
        "type=\"principled\"",
        10,
        "no material `principled`",
    ),
    ("0.1, 0.2, 0.3", "0.1, 0.2", 10, "neither one number nor three"),
    ("0.1, 0.2, 0.3", "0.1, 0.2, 1.3", 10, "albedo is 1.3"),
    (
        "name=\"reflectance\"",
        "name=\"reflectence\"",
        10,
        "`reflectence` of bsdf `diffuse`",
    ),
    (
        "value=\"Au\"",
        "value=\"Unobtainium\"",
        11,
        "no optical constants of `Unobtainium`",
    ),
    (
        "<ref id=\"gold\"/>",
        "<ref id=\"golf\"/>",
        12,
        "nothing has the id `golf`",
    ),
    (
        "type=\"sphere\"",
        "type=\"serialized\"",
        12,
        "no shape `serialized`",
    ),
    (
        "name=\"radius\"",
        "name=\"radios\"",
        12,
        "`radios` of shape `sphere`",
    ),
    (
        "x=\"1\" y=\"2\" z=\"0\"",
        "x=\"1\" y=\"two\" z=\"0\"",
        12,
        "`y` is not a number",
    ),
    (
        "<ref id=\"gold\"/>",
        "<emitter type=\"area\"/>",
        12,
        "shapes that shine",
    ),
    ("<scale x=\"2\"/>", "<scale x=\"0\"/>", 13, "squashes it flat"),
    ("<scale x=\"2\"/>", "<shear x=\"2\"/>", 14, "cannot hold <shear>"),
    ("400:1", "480:1", 17, "says nothing of 450 nm"),
    ("type=\"point\"", "type=\"envmap\"", 17, "no emitter `envmap`"),
    ("id=\"gold\"", "id=\"wall\"", 11, "id `wall` is given twice"),
    ("id=\"plate\"", "ID=\"plate\"", 13, "no attribute `ID`"),
    (
        "<bsdf type=\"twosided\"",
        "<include filename=\"x.xml\"/><bsdf type=\"twosided\"",
        10,
        "cannot read <include>",
    ),
    (
        "<sensor type",
        "<medium type=\"homogeneous\"/><sensor type",
        4,
        "cannot express a medium",
    ),
];

#[test]
fn what_is_not_understood_is_told_with_its_place() {
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
    // A circle of references, and elements nested without end.
    let text = HAND.replace("<rgb name=\"reflectance\" value=\"0.1, 0.2, 0.3\"/>", "");
    let text = text.replace(
        "<bsdf type=\"diffuse\">",
        "<bsdf type=\"blendbsdf\"><float name=\"weight\" value=\"0.5\"/><ref id=\"wall\"/><ref id=\"gold\"/>",
    );
    let e = imported(folder.path(), &text).unwrap_err();
    assert!(e.message.contains("made of itself"), "{e}");
    let deep = "<bsdf type=\"twosided\">".repeat(50_000) + &"</bsdf>".repeat(50_000);
    let e = imported(folder.path(), &HAND.replace("</scene>", &(deep + "</scene>"))).unwrap_err();
    assert!(e.message.contains("nested too deeply"), "{}", e.message);
}

#[test]
fn one_sided_is_black_behind() {
    let folder = tempfile::tempdir().unwrap();
    let import = imported(
        folder.path(),
        &HAND.replace("<ref id=\"wall\"/>", "<ref id=\"gold\"/>"),
    )
    .unwrap();
    assert!(
        import.toml.contains("gold.two_sided.front = \"gold_front\""),
        "{}",
        import.toml
    );
    let import = imported(folder.path(), &HAND.replace("<ref id=\"wall\"/>", "")).unwrap();
    assert!(
        import.toml.contains("mitsuba_default.two_sided.front"),
        "{}",
        import.toml
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    /// Whatever happens to a file, the answer is a scene or an error.
    #[test]
    fn broken_files_do_no_harm(
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
        if let Err(e) = imported(folder, &text) {
            prop_assert!(!e.message.is_empty() && e.help.is_some());
        }
    }
}

#[test]
fn flipped_rectangles_face_the_other_way() {
    let folder = tempfile::tempdir().unwrap();
    let flipped = "<boolean name=\"flip_normals\" value=\"true\"/><ref id=\"wall\"/>";
    for (text, expected) in [
        (HAND.to_owned(), Vec3A::Z),
        (HAND.replace("<ref id=\"wall\"/>", flipped), Vec3A::NEG_Z),
    ] {
        let import = imported(folder.path(), &text).unwrap();
        let scene = sunstone::scene::from_text(&folder.path().join("scene.toml"), &import.toml).unwrap();
        let ray = Ray {
            origin: Vec3A::Z,
            dir: Vec3A::NEG_Z,
        };
        let hit = scene.geometry.intersect(&ray, 100.0).unwrap();
        let at = scene.geometry.surface(&ray, &hit);
        assert!((at.ng - expected).length() < 1e-6 && (at.ns - expected).length() < 1e-6);
    }
    let ball = HAND.replace(
        "<ref id=\"gold\"/>",
        "<boolean name=\"flip_normals\" value=\"true\"/>",
    );
    let e = imported(folder.path(), &ball).unwrap_err();
    assert!(e.message.contains("inside out"), "{e}");
}
