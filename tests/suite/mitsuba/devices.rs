//! Tests the import of cameras, of emitters with images, and of media on grids. The tests cover orthographic
//! sensors, projectors, spots with a texture, and heterogeneous media.

use super::{built, imported};
use glam::Vec3A;
use std::path::Path;
use sunstone::scene::mitsuba::import::Import;
use sunstone::transport::device::emitter::PointEmitter;
use sunstone::transport::geometry::ray::Ray;
use sunstone::transport::light::profile::Profile;
use sunstone::transport::scene::Scene;

/// Returns a scene of one shape with a sensor and an emitter.
fn text(sensor: &str, emitter: &str) -> String {
    format!(
        "<scene version=\"3.0.0\">{sensor}<shape type=\"sphere\"><point name=\"center\" x=\"0\" y=\"0\" z=\"9\"/></shape>{emitter}</scene>"
    )
}

/// Writes an image of four squares. The first row is red and green, and the second row is blue and white.
fn squares(folder: &Path) {
    let rows = vec![255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255];
    let image = image::RgbImage::from_raw(2, 2, rows).unwrap();
    image.save(folder.join("squares.png")).unwrap();
}

const BITMAP: &str = "<string name=\"filename\" value=\"squares.png\"/><string name=\"filter_type\" value=\"nearest\"/></texture>";

/// Tests that grids of extinction and albedo keep their separate boxes. Tests that a medium of constant
/// extinction is bounded by the unit cube.
#[test]
fn heterogeneous_media_keep_their_boxes() {
    let folder = tempfile::tempdir().unwrap();
    let words = [1_i32, 1, 1, 2, 1].map(i32::to_le_bytes);
    let numbers = [0.0_f32, 0.0, 0.0, 2.0, 1.0, 1.0, 0.5, 1.0].map(f32::to_le_bytes);
    let bytes = [b"VOL\x03", words.as_flattened(), numbers.as_flattened()].concat();
    std::fs::write(folder.path().join("ramp.vol"), bytes).unwrap();
    let volume = |name: &str, more: &str| {
        format!(
            "<volume name=\"{name}\" type=\"gridvolume\"><string name=\"filename\" value=\"ramp.vol\"/>{more}\
             <transform name=\"to_world\"><translate z=\"3\"/></transform></volume>"
        )
    };
    let scene = |inside: &str| {
        let shape = format!(
            "<shape type=\"sphere\"><float name=\"radius\" value=\"9\"/><bsdf type=\"null\"/>\
             <medium type=\"heterogeneous\" name=\"interior\"><float name=\"scale\" value=\"4\"/>{inside}</medium></shape>"
        );
        format!(
            "<scene version=\"3.0.0\"><sensor type=\"perspective\"/>{shape}<emitter type=\"constant\"/></scene>"
        )
    };
    let depths = |text: &str| {
        let import = imported(folder.path(), text).unwrap_or_else(|e| panic!("{e}"));
        let toml = folder.path().join("scene.toml");
        import.write(&toml, true).unwrap();
        let scene = sunstone::scene::load(&toml).unwrap_or_else(|e| panic!("{e}"));
        let media = &scene.media;
        let along = |x: f32| Ray { origin: Vec3A::new(x, 0.5, -9.0), dir: Vec3A::Z };
        let at = Vec3A::new(0.5, 0.5, 3.7);
        let depth = |x| media.depth(0, &along(x), 30.0).to_array()[0];
        [depth(0.5), depth(1.5), media.scattering(0, at).to_array()[0]]
    };
    let near = |found: [f32; 3], want: [f32; 3]| {
        let same = found.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-4 * b.max(1.0));
        assert!(same, "{found:?}, {want:?}");
    };
    let own = "<boolean name=\"use_grid_bbox\" value=\"true\"/>";
    // The mean density over 1 m is 0.75. At x = 0.7, the density is 0.95.
    near(depths(&scene(&volume("sigma_t", ""))), [3.0, 0.0, 4.0 * 0.95 * 0.75]);
    // The file's box is 2 m wide, so it includes the position 1.5 m.
    near(depths(&scene(&volume("sigma_t", own)))[..].try_into().unwrap(), [3.0, 3.0, 4.0 * 0.95 * 0.75]);
    let both = volume("sigma_t", "") + &volume("albedo", "");
    near(depths(&scene(&both)), [3.0, 0.0, 4.0 * 0.95 * 0.95]);
    let constant = "<float name=\"sigma_t\" value=\"0.5\"/><float name=\"albedo\" value=\"0.5\"/>";
    near(depths(&scene(constant)), [2.0, 0.0, 0.0]);
    let repeated = volume("sigma_t", "<string name=\"wrap_mode\" value=\"repeat\"/>");
    let e = imported(folder.path(), &scene(&repeated)).unwrap_err();
    assert!(e.message.contains("wrap_mode `repeat`"), "{e}");
}

/// Tests that the image of an orthographic sensor is twice as wide as the scale of `to_world`. Tests that the
/// rays of an orthographic sensor begin at the near plane.
#[test]
fn orthographic_sensors_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let sensor = |scale: &str, more: &str| {
        format!(
            "<sensor type=\"orthographic\"><float name=\"near_clip\" value=\"0.5\"/><transform name=\"to_world\"><scale {scale}/>\
             <lookat origin=\"0, 0, 4\" target=\"0, 0, 9\" up=\"0, 1, 0\"/></transform><film type=\"hdrfilm\">\
             <integer name=\"width\" value=\"40\"/><integer name=\"height\" value=\"20\"/>{more}<rfilter type=\"box\"/></film></sensor>"
        )
    };
    let light = "<emitter type=\"constant\"/>";
    let (import, scene) = built(folder.path(), &text(&sensor("x=\"3\" y=\"3\"", ""), light));
    let camera = &scene.camera;
    assert!(camera.parallel, "{}", import.toml);
    assert_eq!((camera.origin, camera.resolution), (Vec3A::new(0.0, 0.0, 4.5), [40, 20]));
    assert!((camera.focal.x - 40.0 / 6.0).abs() < 1e-9, "{}", import.toml);
    // The centre of the first pixel is up and to the left, which is +x for this camera.
    let first = camera.at(glam::DVec2::splat(0.5));
    let want = Vec3A::new(3.0 - 0.075, 1.5 - 0.075, 4.5);
    assert!((first.origin - want).length() < 1e-5, "{}", first.origin);
    assert_eq!(first.direction(glam::DVec2::splat(0.5)), Vec3A::Z);
    let crop = "<integer name=\"crop_offset_x\" value=\"10\"/><integer name=\"crop_offset_y\" value=\"5\"/>\
        <integer name=\"crop_width\" value=\"8\"/><integer name=\"crop_height\" value=\"4\"/>";
    let (_, scene) = built(folder.path(), &text(&sensor("x=\"3\" y=\"3\"", crop), light));
    let window = &scene.camera;
    let moved = camera.at(glam::DVec2::new(10.5, 5.5)).origin;
    let found = window.at(glam::DVec2::splat(0.5)).origin;
    assert!((moved - found).length() < 1e-5 && window.resolution == [8, 4], "{found}, {moved}");
    let e = imported(folder.path(), &text(&sensor("x=\"3\" y=\"2\"", ""), light)).unwrap_err();
    assert!(e.message.contains("different scales of x and y"), "{e}");
}

/// Returns a scene with one emitter and a perspective sensor.
fn lights(folder: &Path, emitter: &str) -> (Import, Scene) {
    built(folder, &text("<sensor type=\"perspective\"/>", emitter))
}

/// Returns the radiant intensity in a direction, at the scene's wavelengths.
fn sent(scene: &Scene, light: &PointEmitter, dir: Vec3A) -> [f32; 3] {
    let share = light.profile.value(dir.normalize());
    let all = light.share(&scene.materials.textures, dir.normalize(), share).to_array();
    [all[2], all[1], all[0]]
}

/// Tests that a projector with a colour image becomes an emitter of the scene. Tests that a white projector
/// becomes the scene's projector.
#[test]
fn projectors_of_images_become_slides() {
    let folder = tempfile::tempdir().unwrap();
    squares(folder.path());
    let emitter = format!(
        "<emitter type=\"projector\"><float name=\"fov\" value=\"90\"/><float name=\"scale\" value=\"2\"/>\
         <texture type=\"bitmap\" name=\"irradiance\">{BITMAP}</emitter>"
    );
    let (import, scene) = lights(folder.path(), &emitter);
    assert!(
        scene.projector.is_none() && import.notes.iter().any(|n| n.contains("slide")),
        "{:?}",
        import.notes
    );
    let [light] = &scene.points[..] else {
        panic!("{}", import.toml);
    };
    // Mitsuba's right is -x of the emitter, which points along +z with +y up. Irradiances are π times the
    // value in Mitsuba's file.
    for (dir, colour) in [
        (Vec3A::new(0.5, 0.5, 1.0), [1.0, 0.0, 0.0]),
        (Vec3A::new(-0.5, 0.5, 1.0), [0.0, 1.0, 0.0]),
        (Vec3A::new(0.5, -0.5, 1.0), [0.0, 0.0, 1.0]),
        (Vec3A::new(-0.5, -0.5, 1.0), [1.0, 1.0, 1.0]),
        (Vec3A::new(-0.5, -1.1, 1.0), [0.0, 0.0, 0.0]),
    ] {
        let want = colour.map(|c| 2.0 * std::f32::consts::PI * c * dir.length().powi(3));
        let found = sent(&scene, light, dir);
        assert!(found.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-4), "{dir}: {found:?}, {want:?}");
    }
    image::RgbImage::from_pixel(3, 2, image::Rgb([255; 3])).save(folder.path().join("squares.png")).unwrap();
    let (_, scene) = lights(folder.path(), &emitter);
    let projector = scene.projector.expect("a projector");
    assert_eq!((projector.pinhole.resolution, scene.points.len()), ([3, 2], 0));
}

/// Tests that the image of a spot covers the square around the cone of the spot. The upward direction of the
/// image is the emitter's +y axis.
#[test]
fn spots_project_textures() {
    let folder = tempfile::tempdir().unwrap();
    squares(folder.path());
    let emitter = format!(
        "<emitter type=\"spot\"><float name=\"cutoff_angle\" value=\"45\"/><float name=\"beam_width\" value=\"45\"/>\
         <texture type=\"bitmap\" name=\"texture\">{BITMAP}</emitter>"
    );
    let (import, scene) = lights(folder.path(), &emitter);
    let [light] = &scene.points[..] else {
        panic!("{}", import.toml);
    };
    assert!(matches!(light.profile, Profile::Spot { .. }));
    // As in Mitsuba's own `eval_direction`, u increases with +x, v increases with +y, and image rows start at
    // the top.
    for (dir, colour) in [
        (Vec3A::new(-0.5, -0.5, 1.0), [1.0, 0.0, 0.0]),
        (Vec3A::new(0.5, -0.5, 1.0), [0.0, 1.0, 0.0]),
        (Vec3A::new(-0.5, 0.5, 1.0), [0.0, 0.0, 1.0]),
        (Vec3A::new(0.5, 0.5, 1.0), [1.0, 1.0, 1.0]),
        (Vec3A::new(0.9, 0.9, 1.0), [0.0, 0.0, 0.0]),
    ] {
        let found = sent(&scene, light, dir);
        assert!(found.iter().zip(colour).all(|(a, b)| (a - b).abs() < 1e-5), "{dir}: {found:?}, {colour:?}");
    }
    let mirrored =
        emitter.replace("<texture", "<transform name=\"to_world\"><scale x=\"-1\"/></transform><texture");
    let e = imported(folder.path(), &text("<sensor type=\"perspective\"/>", &mirrored)).unwrap_err();
    assert!(e.message.contains("reflection"), "{e}");
}
