//! Compares bump maps with a closed form: Lambert's cosine law for the tilted normals.

use crate::optics::assert_refused;
use crate::support::render_text;
use glam::DVec3;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};
use sunstone::tensor::axes::AxisKind::{StokesIn, StokesOut, X, Y};

const LIGHT: DVec3 = DVec3::new(-0.3, 0.4, -1.0);

/// Writes the heights `a`·u + `b`·v to an image of 64 × 64 pixels. Interpolated heights are exact away from
/// the edges of the image.
fn ramp(folder: &Path, [a, b]: [f64; 2]) -> PathBuf {
    let file = folder.join("ramp.exr");
    let mid = |i: u32| (f64::from(i) + 0.5) / 64.0;
    let height = |i, j| (a * mid(i) + b * (1.0 - mid(j))) as f32;
    image::Rgb32FImage::from_fn(64, 64, |i, j| image::Rgb([height(i, j); 3])).save(&file).expect("a file");
    file
}

/// Returns the radiance that a camera above the surface measures. The camera has one pixel, so narrow that
/// the pixel sees a single point. `object` contains all keys except the material.
fn seen(folder: &Path, slopes: [f64; 2], map: &str, at: DVec3, object: &str) -> f64 {
    let file = ramp(folder, slopes);
    let file = file.display();
    let text = format!(
        "wavelengths_nm = [550]\n[render]\nspp = 64\nmax_depth = 2\n[camera]\nresolution = [1, 1]\northographic_width = 1e-4\n\
         pose.matrix = [[1, 0, 0, {}], [0, -1, 0, {}], [0, 0, -1, 5], [0, 0, 0, 1]]\n\
         [[emitters]]\ndirectional = {{ direction = {:?}, irradiance = 1 }}\n\
         [materials]\nm.diffuse.albedo = 0.5\nb.bump_map = {{ material = \"m\", image = {{ image = \"{file}\"{map} }}, height = 0.5 }}\n\
         {object}[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n",
        at.x,
        at.y,
        LIGHT.to_array()
    );
    let at = [(Y, 0), (X, 0), (StokesOut, 0), (StokesIn, 0)];
    f64::from(render_text(&text).mean("m").at(&at))
}

/// Returns the radiance of a surface of albedo 0.5. The normal can have any length.
fn lambert(normal: DVec3) -> f64 {
    0.5 / PI * normal.normalize().dot(-LIGHT.normalize())
}

fn check(found: f64, normal: DVec3, what: &str) {
    let want = lambert(normal);
    assert!((found - want).abs() < 2e-3 * want, "{what}: {found}, closed form {want}");
}

/// Tests bump maps on a rectangle of 2 m by 0.5 m whose u runs along y. Heights of 0.5 (a u + b v) have the
/// slopes 0.25 a and b on the rectangle. The slopes of images that `uv` rotates and scales follow from the
/// chain rule. The transform of a group's copy stretches the surface, but not the heights.
#[test]
fn ramps_tilt_a_plane() {
    let folder = tempfile::tempdir().expect("a folder");
    let shape =
        "shape.rectangle = { corner = [0, 0, 0], u = [0, 2, 0], v = [-0.5, 0, 0] }\nmaterial = \"b\"\n";
    let object = format!("[[objects]]\n{shape}");
    let at = DVec3::new(-0.21, 0.83, 0.0);
    let [a, b] = [0.9, -0.4];
    let (along_y, along_x) = (0.5 * a / 2.0, -0.5 * b / 0.5);
    let flat = seen(folder.path(), [0.0, 0.0], "", at, &object);
    check(flat, DVec3::Z, "flat");
    let tilted = seen(folder.path(), [a, b], "", at, &object);
    check(tilted, DVec3::new(-along_x, -along_y, 1.0), "a ramp");
    // The map has u' = v/2 and v' = u/2 + 0.2.
    let map = ", uv = [[0, 0.5, 0], [0.5, 0, 0.2]]";
    let turned = seen(folder.path(), [a, b], map, at, &object);
    let (along_y, along_x) = (0.5 * 0.5 * b / 2.0, -0.5 * 0.5 * a / 0.5);
    check(turned, DVec3::new(-along_x, -along_y, 1.0), "a turned ramp");
    let group = format!(
        "[[groups.g.objects]]\n{shape}[[instances]]\ngroup = \"g\"\ntransform = {{ scale = [2, 1, 1] }}\n"
    );
    let stretched = seen(folder.path(), [a, b], "", DVec3::new(-0.42, 0.83, 0.0), &group);
    let (along_y, along_x) = (0.5 * a / 2.0, -0.5 * b / 1.0);
    check(stretched, DVec3::new(-along_x, -along_y, 1.0), "a stretched copy");
}

/// Tests bump maps on a sphere of 0.8 m. On the sphere, u runs around z, and v runs down from +z.
#[test]
fn ramps_tilt_a_ball() {
    let folder = tempfile::tempdir().expect("a folder");
    let [a, b] = [0.7, 0.5];
    let r = 0.8;
    for shape in
        [format!("shape.sphere.radius = {r}"), format!("shape.sphere.radius = 1\ntransform.scale = {r}")]
    {
        for (theta, phi) in [(0.5_f64, 1.9_f64), (0.9, 4.0), (0.2, 2.5)] {
            let n = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            let (east, south) = (
                DVec3::new(-phi.sin(), phi.cos(), 0.0),
                DVec3::new(theta.cos() * phi.cos(), theta.cos() * phi.sin(), -theta.sin()),
            );
            let gradient = east * (0.5 * a / (TAU * r * theta.sin())) + south * (0.5 * b / (PI * r));
            let object = format!("[[objects]]\nmaterial = \"b\"\n{shape}\n");
            let found = seen(folder.path(), [a, b], "", n * r, &object);
            check(found, n - gradient, &format!("{shape}, {theta}, {phi}"));
        }
    }
}

#[test]
fn heights_without_slopes_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = ramp(folder.path(), [1.0, 0.0]);
    let text = |image: &str, shape: &str| {
        format!(
            "wavelengths_nm = [550]\n[camera]\nresolution = [1, 1]\nfov_x_deg = 9\npose.look_at = {{ origin = [0, 0, 5], target = [0, 0, 0] }}\n\
             [[emitters]]\nenvironment.radiance = 1\n[materials]\nm.diffuse.albedo = 0.5\n\
             b.bump_map = {{ material = \"m\", image = {{ image = {file:?}{image} }} }}\n\
             [[objects]]\nmaterial = \"b\"\nshape.{shape}\n[[slices]]\nname = \"m\"\n"
        )
    };
    for (text, what) in [
        (text(", filter = \"nearest\"", "sphere.radius = 1"), "no slopes"),
        (text(", scale = 0.5", "sphere.radius = 1"), "scale"),
        (text("", "disk.radius = 1"), "a disk has no texture coordinates"),
    ] {
        assert_refused("scene.toml".as_ref(), &text, what);
    }
}
