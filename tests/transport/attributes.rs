//! Tests attributes of PLY meshes that are used as albedos. The references are closed forms. Under uniform
//! white light, the radiance of a surface equals its albedo.

use crate::optics::assert_refused;
use crate::support::render_text;
use std::path::Path;
use sunstone::tensor::axes::AxisKind::{StokesIn, StokesOut, Wavelength, X, Y};

/// Returns the scene-file text of two triangles of the unit square. `more` contains the remaining keys of the
/// object and of the material.
fn scene(folder: &Path, material: &str, more: &str) -> String {
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        property float color_0\nproperty float color_1\nproperty float color_2\nproperty float weight_0\n\
        element face 2\nproperty list uchar int vertex_indices\nproperty float color_0\nproperty float color_1\n\
        property float color_2\nend_header\n\
        0 0 0 0.1 0.8 0 0.1\n1 0 0 0.9 0 0.4 0.3\n1 1 0 0.5 0.4 0.8 0.5\n0 1 0 0 0.2 0.6 0.9\n\
        3 0 1 2 0.2 0.4 0.6\n3 0 2 3 0.7 0.1 0.3\n";
    let file = folder.join("square.ply");
    std::fs::write(&file, ply).expect("a file");
    let file = file.display();
    format!(
        "wavelengths_nm = [450, 550, 660]\n[render]\nspp = 4\nmax_depth = 2\n[camera]\nresolution = [8, 8]\northographic_width = 1\n\
         pose.matrix = [[1, 0, 0, 0.5], [0, -1, 0, 0.5], [0, 0, -1, 2], [0, 0, 0, 1]]\n[[emitters]]\nenvironment.radiance = 1\n\
         [materials]\nblack.diffuse.albedo = 0\nwhite.diffuse.albedo = 1\n{material}\n\
         [[objects]]\nmaterial = \"m\"\nshape.ply = {{ file = \"{file}\" }}\n{more}\
         [[slices]]\nname = \"image\"\npolarization = \"mueller\"\n"
    )
}

/// Returns the red, green and blue values of pixel (i, j), averaged over the pixel.
fn seen(text: &str, [i, j]: [usize; 2]) -> [f32; 3] {
    let image = render_text(text).mean("image");
    [2, 1, 0].map(|l| image.at(&[(Y, j), (X, i), (Wavelength, l), (StokesOut, 0), (StokesIn, 0)]))
}

/// Tests that colours of vertices vary linearly over a triangle. The mean over a pixel is therefore the value
/// at the pixel's centre.
#[test]
fn colours_of_vertices_are_mixed() {
    let folder = tempfile::tempdir().expect("a folder");
    for (more, mirrored) in [
        ("", false),
        ("transform = { scale = [-1, 1, 1], translate = [1, 0, 0] }\nflip_normals = true\n", true),
    ] {
        let text =
            scene(folder.path(), "m.diffuse.albedo = { attribute = \"vertex_color\", scale = 0.5 }", more)
                .replace("spp = 4", "spp = 4096");
        for pixel in [[6, 6], [5, 7], [7, 3]] {
            // Below the diagonal, the value is (0, 0) + x ((1, 0) - (0, 0)) + y ((1, 1) - (1, 0)).
            let [x, y] = [(pixel[0] as f32 + 0.5) / 8.0, (7.5 - pixel[1] as f32) / 8.0];
            let corner = [[0.1, 0.8, 0.0], [0.9, 0.0, 0.4], [0.5, 0.4, 0.8]];
            let want = [0, 1, 2].map(|c| {
                0.5 * (corner[0][c] + x * (corner[1][c] - corner[0][c]) + y * (corner[2][c] - corner[1][c]))
            });
            let column = if mirrored { 7 - pixel[0] } else { pixel[0] };
            let found = seen(&text, [column, pixel[1]]);
            let near = found.iter().zip(want).all(|(a, b)| (a - b).abs() < 2e-3);
            assert!(near, "{pixel:?}, mirrored {mirrored}: {found:?}, closed form {want:?}");
        }
    }
}

/// Tests that each face has one colour. Tests that a scalar attribute can be the weight of a blend.
#[test]
fn faces_have_a_colour_and_numbers_are_weights() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = scene(folder.path(), "m.diffuse.albedo = { attribute = \"face_color\" }", "");
    for (pixel, want) in [([6, 6], [0.2, 0.4, 0.6]), ([1, 1], [0.7, 0.1, 0.3])] {
        let found = seen(&text, pixel);
        assert!(found.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-5), "{pixel:?}: {found:?}");
    }
    let blend = "m.blend = { a = \"black\", b = \"white\", weight = { attribute = \"vertex_weight\" } }";
    let text = scene(folder.path(), blend, "").replace("spp = 4", "spp = 4096");
    let want = 0.1 + 6.5 / 8.0 * 0.2 + 1.5 / 8.0 * 0.2;
    let found = seen(&text, [6, 6]);
    assert!((found[0] - want).abs() < 0.02, "{found:?}, closed form {want}");
}

#[test]
fn unsupported_attributes_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let with = |material: &str| scene(folder.path(), material, "");
    let colours = "m.diffuse.albedo = { attribute = \"vertex_color\" }";
    let blend =
        |a: &str, weight: &str| format!("{a}\nm.blend = {{ a = \"k\", b = \"white\", weight = {weight} }}");
    let own = "k.diffuse.albedo = { attribute = \"face_color\" }";
    let board = "k.diffuse.albedo = { checkerboard = [0.2, 0.4] }";
    let cases = [
        (with("m.diffuse.albedo = { attribute = \"vertex_tint\" }"), "no attribute \"vertex_tint\""),
        (with("m.diffuse.albedo = { attribute = \"tint\" }"), "invalid attribute name"),
        (with(&blend(own, "{ attribute = \"vertex_weight\" }")), "uses the mesh attributes"),
        (with(&blend(board, "{ attribute = \"vertex_weight\" }")), "together with an image"),
        (with(&blend("k.diffuse.albedo = 0", "{ attribute = \"vertex_color\" }")), "is a colour"),
        (with(colours).replace("shape.ply = { file", "shape.obj = { file"), "requires the mesh attribute"),
        (
            with(&format!("{colours}\n[[objects]]\nmaterial = \"m\"\nshape.sphere.radius = 1")),
            "requires the mesh attribute",
        ),
        (with("m.diffuse.albedo = { attribute = \"vertex_color\", raw = true }"), "expected a texture"),
    ];
    for (text, what) in cases {
        assert_refused(&folder.path().join("scene.toml"), &text, what);
    }
    let file = folder.path().join("square.ply");
    let bad = std::fs::read_to_string(&file).expect("a file").replace("0 0 0 0.1", "0 0 0 -0.1");
    let text = with(colours);
    std::fs::write(&file, bad).expect("a file");
    assert_refused(&folder.path().join("scene.toml"), &text, "has the value -0.1");
}
