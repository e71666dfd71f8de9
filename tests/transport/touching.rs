//! Tests the light of stacked objects whose surfaces touch within rounding.

use crate::optics::{Device, head};
use crate::support::render_scene;
use glam::DVec3;
use std::path::Path;
use sunstone::scene::from_text;

const MATERIALS: &str = "[materials]\ntable.diffuse.albedo = 0.5\nglass.dielectric.ior = 1.5\nwater.dielectric.ior = 1.33\n\
    sheet.null = {}\n";
const SKY: &str = "[[emitters]]\nenvironment = { radiance = 1 }\n[[slices]]\nname = \"m\"\n";

fn block(name: &str, material: &str, low: f64, high: f64) -> String {
    format!(
        "[[objects]]\nname = \"{name}\"\nmaterial = \"{material}\"\n\
         shape.cube = {{ min = [-100, -100, {low}], max = [100, 100, {high}] }}\n"
    )
}

fn table(z: f64) -> String {
    format!(
        "[[objects]]\nname = \"table\"\nmaterial = \"table\"\n\
         shape.rectangle = {{ corner = [-120, -120, {z}], u = [240, 0, 0], v = [0, 240, 0] }}\n"
    )
}

/// Returns the text of a scene that is seen from above.
fn text(objects: &str, more: &str) -> String {
    let camera = Device::ray([0.1, 0.2, 4.0], DVec3::new(0.1, 0.2, 0.0));
    head(60_000, 80, 3) + more + &camera.keys("camera") + MATERIALS + objects + SKY
}

fn seen(objects: &str) -> (f64, f64, Vec<String>) {
    let scene = from_text(Path::new("test.toml"), &text(objects, "")).unwrap_or_else(|e| panic!("{e}"));
    let render = render_scene(&scene);
    let one = |t: sunstone::tensor::array::Tensor| f64::from(t.data[0]);
    (one(render.mean("m")), one(render.std_error("m")), scene.notes.clone())
}

/// Returns Fresnel's reflectance for unpolarized light that is incident from outside on glass of index n.
fn fresnel(cos: f64, n: f64) -> f64 {
    let inner = (1.0 - (1.0 - cos * cos) / (n * n)).sqrt();
    let (s, p) = ((cos - n * inner) / (cos + n * inner), (n * cos - inner) / (n * cos + inner));
    0.5 * (s * s + p * p)
}

/// Tests a wide glass block on a table under uniform illumination 1. A diffuse base of albedo ρ below an
/// interface of index n and reflectance F has the radiance F + (1 - F) ρ (1 - r) / (n² (1 - ρ r'))
/// (Saunderson 1942). The interface's hemispherical reflectances are r from outside and r' = 1 - (1 - r)/n²
/// from inside. The light in the glass hits the table for any rounding of the heights.
#[test]
fn glass_on_a_table_is_in_contact_with_it() {
    let (n, albedo) = (1.5, 0.5);
    let steps = 20_000;
    let r: f64 = (0..steps)
        .map(|i| (f64::from(i) + 0.5) / f64::from(steps))
        .map(|cos| 2.0 * cos * fresnel(cos, n) / f64::from(steps))
        .sum();
    let inside = 1.0 - (1.0 - r) / (n * n);
    let f = fresnel(1.0, n);
    let want = f + (1.0 - f) * albedo * (1.0 - r) / (n * n * (1.0 - albedo * inside));
    for z in [0.0, 0.1, -0.3] {
        // The rounding of the table's height differs from that of the block's height.
        for off in [0.0, 1e-7, -1e-7] {
            let (got, error, notes) = seen(&(block("block", "glass", z, z + 1.0) + &table(z + off)));
            assert!(
                (got - want).abs() < 5.0 * error + 1e-3 && error < 4e-3,
                "{z} {off}: {got} ± {error}, not {want}"
            );
            assert!(
                notes.len() == 1 && notes[0].contains("`block`") && notes[0].contains("touches `table`"),
                "{notes:?}"
            );
        }
    }
}

/// Tests that a table looks the same with and without a non-refracting boundary on it. The program shifts the
/// boundary.
#[test]
fn a_boundary_that_does_not_refract_is_shifted() {
    let (got, error, notes) = seen(&(block("block", "sheet", 0.0, 1.0) + &table(0.0)));
    assert!((got - 0.5).abs() < 5.0 * error + 1e-3, "{got} ± {error}");
    assert!(notes.len() == 1 && notes[0].contains("away from the other object"), "{notes:?}");
}

/// Tests a glass block that touches a water block. The light depends on whether air separates the blocks. The
/// scene is refused, or rendered with a note.
#[test]
fn two_refracting_objects_that_touch_are_refused() {
    let both = block("upper", "glass", 1.0, 2.0) + &block("lower", "water", 0.0, 1.0);
    let error = from_text(Path::new("test.toml"), &text(&both, "")).err().expect("refused");
    assert!(error.message.contains("m apart at"), "{}", error.message);
    let scene = from_text(Path::new("test.toml"), &text(&both, "gaps = \"warn\"\n")).expect("a scene");
    assert!(scene.notes.iter().any(|n| n.contains("m apart at")), "{:?}", scene.notes);
}
