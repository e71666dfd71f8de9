//! Tests images that spots and projectors project onto a plane. The references are closed forms. The tests
//! use each integrator.

use crate::lights::{check, m00, text};
use crate::support::render_text;
use glam::{DVec2, DVec3};

/// Tests a spot and a projector that project an image of four squares. The irradiance of a projector is
/// constant on a plane perpendicular to its axis.
#[test]
fn images_are_projected() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("squares.exr");
    // The top row is first.
    image::Rgb32FImage::from_fn(2, 2, |i, j| image::Rgb([(1 + i + 2 * j) as f32; 3]))
        .save(&file)
        .expect("a file");
    let image = format!("image = {{ image = {file:?}, filter = \"nearest\" }}");
    let (height, axis) = (2.0_f64, DVec2::new(0.1, 0.1));
    let slide = format!(
        "slide = {{ {image}, irradiance = 2, fov_x_deg = 60, pose.look_at = {{ origin = [0.1, 0.1, 2], target = [0.1, 0.1, 0] }} }}"
    );
    // Right in the spot's image is -y.
    let spot = format!(
        "spot = {{ position = [0.1, 0.1, 2], direction = [0, 0, -1], intensity = 3, cutoff_deg = 40, beam_deg = 40, {image}, \
         up = [1, 0, 0] }}"
    );
    for integrator in ["path", "bidirectional"] {
        for (x, y) in [(0.5, -0.3), (0.4, 0.6), (-0.7, 0.2), (-0.3, -0.9)] {
            let (at, cos) = ([axis.x + x, axis.y + y], height / DVec3::new(x, y, height).length());
            let square = |right: f64, up: f64| f64::from(1 + u8::from(right > 0.0) + 2 * u8::from(up < 0.0));
            let emitter = |light: &str| text(integrator, 200, 2, at, &format!("[[emitters]]\n{light}\n"));
            let what = format!("{integrator} at {x}, {y}");
            let even = 2.0 / (height * height);
            check(&emitter(&slide), even * square(x, y), 0.02, &format!("slide, {what}"));
            let inverse = cos.powi(3) / (height * height);
            check(&emitter(&spot), 3.0 * inverse * square(-y, x), 0.02, &format!("spot, {what}"));
        }
        // The point is outside the frustum, which ends 1.155 m from the axis.
        let beyond = text(integrator, 200, 2, [axis.x, axis.y + 1.2], &format!("[[emitters]]\n{slide}\n"));
        assert_eq!(m00(&render_text(&beyond)).0, 0.0, "{integrator}");
    }
}
