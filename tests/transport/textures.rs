//! Tests the orientation of albedo images, sRGB decoding, the image channel of each wavelength, and bilinear
//! filtering with repetition.

use crate::support::render_text;
use sunstone::tensor::axes::AxisKind;

/// Returns a 4 × 4 image without symmetry.
fn picture() -> image::RgbImage {
    image::RgbImage::from_fn(4, 4, |x, y| {
        let v = |k: u32| ((x * 61 + y * 97 + k * 53 + x * y * 29) % 256) as u8;
        image::Rgb([v(0), v(1), v(2)])
    })
}

fn linear(c: u8) -> f64 {
    let c = f64::from(c) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// Tests that a plane under a constant sky of radiance 1 shows its albedo. Camera pixels coincide with
/// texels, so the value of a pixel is the mean of the bilinearly filtered image over a texel. Along each
/// axis, and across the border, the weights are 1/8, 6/8 and 1/8. The test uses 20,000 samples per pixel and
/// 5 standard errors (plus 1e-5 for f32).
#[test]
fn a_textured_plane_shows_its_picture() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("picture.png");
    picture().save(&file).unwrap();
    let text = format!(
        r#"
wavelengths_nm = [450, 550, 660]
[render]
spp = 20000
max_depth = 2
[camera]
resolution = [4, 4]
fx = 4
pose.look_at = {{ origin = [0, 0, 2], target = [0, 0, 0] }}
[[emitters]]
environment.radiance = 1
[materials]
picture.diffuse.albedo = {{ image = {:?}, scale = 0.5 }}
[[objects]]
shape.rectangle = {{}}
material = "picture"
[[slices]]
name = "image"
"#,
        file.to_str().unwrap()
    );
    let rendered = render_text(&text);
    let (mean, error) = (rendered.mean("image"), rendered.std_error("image"));
    let picture = picture();
    for y in 0..4_i32 {
        for x in 0..4_i32 {
            // 450 nm uses blue, 550 nm uses green, and 660 nm uses red.
            for (lane, channel) in [(0, 2), (1, 1), (2, 0)] {
                let mut want = 0.0;
                for (dx, wx) in [(-1, 0.125), (0, 0.75), (1, 0.125)] {
                    for (dy, wy) in [(-1, 0.125), (0, 0.75), (1, 0.125)] {
                        let (i, j) = ((x + dx).rem_euclid(4) as u32, (y + dy).rem_euclid(4) as u32);
                        want += 0.5 * wx * wy * linear(picture.get_pixel(i, j).0[channel]);
                    }
                }
                let at = [(AxisKind::Y, y as usize), (AxisKind::X, x as usize), (AxisKind::Wavelength, lane)];
                let (got, sigma) = (f64::from(mean.at(&at)), f64::from(error.at(&at)));
                assert!(sigma < 0.01 * want.max(0.1), "the test can see errors");
                assert!(
                    (got - want).abs() < 5.0 * sigma + 1e-5,
                    "pixel ({x}, {y}) lane {lane}: {got} ± {sigma}, expected {want}"
                );
            }
        }
    }
}
