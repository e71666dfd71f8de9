//! Tests the values of materials with images, and of materials that combine other materials.

use crate::optics::surface_at;
use crate::support::render_text;
use glam::Vec3A;
use std::path::Path;
use sunstone::optics::polarization::frame::perpendicular;
use sunstone::optics::polarization::mueller::Mueller;
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::sampling::warp;
use sunstone::optics::spectrum::max_lane;
use sunstone::scene::materials::MaterialSet;
use sunstone::transport::geometry::ray::Surface;
use sunstone::transport::material::{Lanes, Lobe};

const FILE: &str = r#"
[materials]
rough.rough_conductor = { n = 0.4, k = 2.4, alpha = 0.3 }
mirror.conductor = { n = 0.4, k = 2.4 }
white.diffuse.albedo = 0.8
mixed.blend = { a = "rough", b = "white", weight = 0.3 }
sheen.blend = { a = "mirror", b = "white", weight = 0.25 }
dull.partial_depolarizer = { material = "rough", fraction = 0.6 }
faces.two_sided = { front = "rough", back = "white" }
front.two_sided = { front = "rough" }
"#;

fn set(text: &str) -> MaterialSet {
    MaterialSet::from_text(Path::new("test.toml"), text).unwrap_or_else(|e| panic!("{e}"))
}

fn flat(uv: [f32; 2]) -> Surface {
    surface_at(Vec3A::Z, Vec3A::X, uv)
}

/// Returns the Mueller matrix of a named material for two directions. The frames do not depend on the
/// material.
fn value(set: &MaterialSet, name: &str, at: &Surface, wo: Vec3A, wi: Vec3A) -> Mueller {
    set.materials
        .eval(set.names[name], at, wo, wi)
        .map(|s| s.between(wo, perpendicular(wo), wi, perpendicular(wi)))
        .unwrap_or_default()
}

/// Returns the largest absolute difference between the elements of two matrices.
fn off(a: &Mueller, b: &Mueller) -> f32 {
    (0..16).map(|i| max_lane((a.m[i / 4][i % 4] - b.m[i / 4][i % 4]).abs())).fold(0.0, f32::max)
}

fn weighted(terms: &[(f32, Mueller)]) -> Mueller {
    terms
        .iter()
        .fold(Mueller::ZERO, |sum, (w, m)| sum + m.scaled(sunstone::optics::spectrum::Spectral::splat(*w)))
}

/// Returns `n` pairs of random directions above the surface.
fn directions(n: usize, seed: u64) -> Vec<[Vec3A; 2]> {
    let mut stream = Stream::new(seed, 0, 0);
    let mut draw = || warp::cosine_hemisphere(stream.uniform2());
    (0..n).map(|_| [draw(), draw()]).collect()
}

#[test]
fn mixtures_are_sums() {
    let set = set(FILE);
    let at = flat([0.5; 2]);
    for [wo, wi] in directions(500, 1) {
        let get = |name| value(&set, name, &at, wo, wi);
        let want = weighted(&[(0.7, get("rough")), (0.3, get("white"))]);
        assert!(off(&get("mixed"), &want) < 1e-5);
        // M00 is unchanged, and all other elements decrease to 0.4 of their values.
        let mut want = weighted(&[(0.4, get("rough"))]);
        want.m[0][0] = get("rough").m[0][0];
        assert!(off(&get("dull"), &want) < 1e-5);
        // The cases are the front, the back, and a missing back.
        assert_eq!(off(&get("faces"), &get("rough")), 0.0);
        assert_eq!(off(&get("front"), &get("rough")), 0.0);
        let below = |name| value(&set, name, &at, -wo, -wi);
        assert_eq!(off(&below("faces"), &below("white")), 0.0);
        assert_eq!(below("front"), Mueller::ZERO);
        let pdf = |name: &str| set.materials.pdf(set.names[name], &at, wo, wi);
        assert!((pdf("mixed") - 0.7 * pdf("rough") - 0.3 * pdf("white")).abs() < 1e-5);
        assert_eq!(pdf("dull"), pdf("rough"));
    }
}

/// Tests that each delta lobe of a mixture has the fraction that the mixture specifies. The test checks the
/// list of lobes, and the mean of 40,000 samples (within 5 sigma).
#[test]
fn mixtures_of_mirrors_keep_shares() {
    let set = set(FILE);
    let at = flat([0.5; 2]);
    let wo = Vec3A::new(0.6, 0.0, 0.8);
    let lobe = |name: &str| {
        set.materials.specular(set.names[name], &at, wo, Lobe::Reflected, 0).unwrap().scatter.m00().to_array()
            [0]
    };
    assert!((lobe("sheen") - 0.75 * lobe("mirror")).abs() < 1e-6);
    assert!(set.materials.specular(set.names["white"], &at, wo, Lobe::Reflected, 0).is_none());
    let n = 40_000;
    let (mut deltas, mut sum) = (0.0, 0.0);
    for i in 0..n {
        let mut stream = Stream::new(9, i, 0);
        let s = set.materials.sample(set.names["sheen"], &at, wo, &mut Lanes::first(3), &mut stream).unwrap();
        deltas += f64::from(u8::from(s.delta));
        sum += f64::from(s.scatter.m00().to_array()[0]);
    }
    let n = f64::from(n);
    assert!((deltas / n - 0.75).abs() < 5.0 * (0.75 * 0.25 / n).sqrt());
    // A sample returns the reflectance of the mirror, or the albedo.
    let (m, d) = (f64::from(lobe("mirror")), 0.8);
    let want = 0.75 * m + 0.25 * d;
    assert!((sum / n - want).abs() < 5.0 * (m - d).abs() * (0.75 * 0.25 / n).sqrt());
}

/// Writes an image of one colour. Returns the name of the PNG file in TOML syntax.
fn picture(folder: &Path, name: &str, rgb: [u8; 3]) -> String {
    let path = folder.join(name);
    image::RgbImage::from_pixel(4, 4, image::Rgb(rgb)).save(&path).unwrap();
    format!("{:?}", path.to_str().unwrap())
}

/// Tests that images of numbers are linear, so that 102/255 is 0.4.
#[test]
fn images_of_numbers_are_linear() {
    let folder = tempfile::tempdir().unwrap();
    let gray = picture(folder.path(), "gray.png", [102; 3]);
    let set = set(&format!(
        r#"{FILE}
plain.rough_conductor = {{ n = 0.4, k = 2.4, alpha = 0.2 }}
image.rough_conductor = {{ n = 0.4, k = 2.4, alpha = {{ image = {gray}, scale = 0.5 }} }}
plainmix.blend = {{ a = "rough", b = "white", weight = 0.4 }}
imagemix.blend = {{ a = "rough", b = "white", weight = {{ image = {gray} }} }}
plaindull.partial_depolarizer = {{ material = "rough", fraction = 0.4 }}
imagedull.partial_depolarizer = {{ material = "rough", fraction = {{ image = {gray} }} }}
"#
    ));
    let at = flat([0.3, 0.8]);
    for [wo, wi] in directions(200, 2) {
        let get = |name| value(&set, name, &at, wo, wi);
        for (a, b) in [("plain", "image"), ("plainmix", "imagemix"), ("plaindull", "imagedull")] {
            assert!(off(&get(a), &get(b)) < 1e-4 * max_lane(get(a).m[0][0]).max(1e-3), "{b}");
        }
    }
}

/// Tests that a plane with a tilting normal map is as bright as a tilted plane. For a distant point light,
/// the radiance is E·ρ/π times the cosine of the angle between the tilted normal and the light. The map's x
/// is the surface's u, and the map's y is up.
#[test]
fn a_normal_map_tilts_the_normal() {
    let folder = tempfile::tempdir().unwrap();
    for rgb in [[128_u8, 128, 255], [191, 128, 237], [64, 128, 237], [128, 191, 237], [100, 70, 230]] {
        let map = picture(folder.path(), "normal.png", rgb);
        let text = format!(
            r#"
wavelengths_nm = [550]
[render]
spp = 16
max_depth = 2
[camera]
resolution = [4, 4]
fov_x_deg = 1
pose.look_at = {{ origin = [0, 0, 4], target = [0, 0, 0] }}
[[emitters]]
point = {{ position = [3000, 1000, 5000], intensity = 35e6 }}
[materials]
white.diffuse.albedo = 0.5
bumpy.normal_map = {{ material = "white", image = {map} }}
[[objects]]
shape.rectangle = {{ corner = [-1, -1, 0], u = [2, 0, 0], v = [0, 2, 0] }}
material = "bumpy"
[[slices]]
name = "image"
"#
        );
        let mean = render_text(&text).mean("image");
        let n = rgb.map(|c| f64::from(c) / 255.0 * 2.0 - 1.0);
        let length = n.iter().map(|c| c * c).sum::<f64>().sqrt();
        let light = [3.0, 1.0, 5.0].map(|c| c / 35.0_f64.sqrt());
        let cos: f64 = n.iter().zip(light).map(|(a, b)| a / length * b).sum();
        let want = 0.5 / std::f64::consts::PI * cos;
        for got in &mean.data {
            assert!((f64::from(*got) - want).abs() < 2e-3 * want, "{rgb:?}: {got}, expected {want}");
        }
    }
}

/// Tests a material that is white in front and black behind. The render of the back side must be black.
#[test]
fn a_black_back_is_black() {
    for (z, want) in [(3.0, 0.8), (-3.0, 0.0)] {
        let text = format!(
            r#"
wavelengths_nm = [550]
[render]
spp = 8
max_depth = 2
[camera]
resolution = [4, 4]
fov_x_deg = 1
pose.look_at = {{ origin = [0, 0, {z}], target = [0, 0, 0] }}
[[emitters]]
environment.radiance = 1
[materials]
white.diffuse.albedo = 0.8
page.two_sided = {{ front = "white" }}
[[objects]]
shape.rectangle = {{ corner = [-1, -1, 0], u = [2, 0, 0], v = [0, 2, 0] }}
material = "page"
[[slices]]
name = "image"
"#
        );
        for got in &render_text(&text).mean("image").data {
            assert!((got - want).abs() < 1e-5, "{got}, expected {want}");
        }
    }
}

/// Tests that the shipped metamers have the same colour in every direction under unpolarized light, but
/// different polarization. The depolarization index of Gil & Bernabéu (1985) distinguishes the metamers. The
/// index is |M without M00| / (√3 M00).
#[test]
fn metamers_differ_only_in_depolarization() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pbrdf/metamers.toml");
    let set = MaterialSet::load(&path).unwrap_or_else(|e| panic!("{e}"));
    let at = flat([0.5; 2]);
    let mut widest = 0.0_f32;
    for [wo, wi] in directions(2000, 3) {
        let [paint, organic] = ["painted_plastic", "organic"].map(|n| value(&set, n, &at, wo, wi));
        for lane in 0..3 {
            let [p, o] = [&paint, &organic].map(|m| m.lane(lane));
            assert!((p[0][0] - o[0][0]).abs() <= 1e-6 * p[0][0], "colours differ");
            let index = |m: [[f32; 4]; 4]| {
                let square: f32 = m.iter().flatten().map(|e| (e / m[0][0]).powi(2)).sum();
                ((square - 1.0).max(0.0) / 3.0).sqrt()
            };
            assert!((index(o) - 0.25 * index(p)).abs() < 1e-3);
            widest = widest.max(index(p) - index(o));
        }
    }
    assert!(widest > 0.5, "the gloss tells them apart: {widest}");
}
