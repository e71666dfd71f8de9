//! Measures `eval` and `sample` of each material at 4 wavelengths, for directions in general position.

use criterion::{Criterion, criterion_group, criterion_main};
use glam::Vec3A;
use std::hint::black_box;
use std::path::Path;
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::sampling::warp;
use sunstone::scene::materials::MaterialSet;
use sunstone::transport::geometry::ray::Surface;
use sunstone::transport::material::Lanes;

/// The measured materials, each with the name in the report and the definition in a scene file.
const MATERIALS: &[(&str, &str)] = &[
    ("diffuse", "diffuse.albedo = 0.5"),
    ("conductor", "conductor = { n = 0.4, k = 2.4 }"),
    ("rough_conductor ggx", "rough_conductor = { n = 0.4, k = 2.4, alpha = 0.3 }"),
    (
        "rough_conductor beckmann",
        "rough_conductor = { n = 0.4, k = 2.4, alpha = 0.3, distribution = \"beckmann\" }",
    ),
    ("dielectric", "dielectric.ior = 1.5"),
    ("rough_dielectric ggx", "rough_dielectric = { ior = 1.5, alpha = 0.3 }"),
    (
        "rough_dielectric ggx separable",
        "rough_dielectric = { ior = 1.5, alpha = 0.3, masking = \"separable\" }",
    ),
    (
        "rough_dielectric beckmann",
        "rough_dielectric = { ior = 1.5, alpha = 0.3, distribution = \"beckmann\" }",
    ),
    ("rough_dielectric dispersive", "rough_dielectric = { ior = [1.52, 1.51, 1.50, 1.49], alpha = 0.3 }"),
    ("plastic", "plastic = { albedo = 0.5, ior = 1.5, alpha = 0.3 }"),
    (
        "coated_conductor",
        "coated_conductor = { metal = \"Al\", films = [{ ior = \"SiO\", thickness_nm = 120 }] }",
    ),
    ("polarizer", "polarizer.angle_deg = 30"),
    ("retarder", "retarder.retardance_deg = 90"),
    ("crystal", "crystal = { name = \"calcite\", axis = [1, 0, 1] }"),
    ("crystal split", "crystal = { name = \"calcite\", axis = [1, 0, 1], split = true }"),
    ("blend", "blend = { a = \"metal\", b = \"white\", weight = 0.4 }"),
    ("two_sided", "two_sided = { front = \"metal\", back = \"white\" }"),
    ("partial_depolarizer", "partial_depolarizer = { material = \"metal\", fraction = 0.4 }"),
    ("normal_map", "normal_map = { material = \"metal\", image = \"IMAGE\" }"),
];

/// Definitions of the materials to which composed materials refer.
const PARTS: &str = "metal.rough_conductor = { n = 0.4, k = 2.4, alpha = 0.3 }\nwhite.diffuse.albedo = 0.5\n";

fn materials(c: &mut Criterion) {
    let mut stream = Stream::new(0, 0, 0);
    let wo = Vec3A::new(0.5, 0.1, 0.86).normalize();
    let at = Surface {
        p: Vec3A::ZERO,
        ng: Vec3A::Z,
        ns: Vec3A::Z,
        tangent: Vec3A::X,
        bitangent: Vec3A::ZERO,
        uv: [0.3, 0.6],
        material: 0,
        rounding: 0.0,
    };
    let above: Vec<_> = (0..256).map(|_| warp::cosine_hemisphere(stream.uniform2())).collect();
    let below: Vec<_> = above.iter().map(|w| -*w).collect();
    let folder = tempfile::tempdir().expect("cannot create a temporary folder");
    let normals = folder.path().join("normals.png");
    let picture = image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([100 + x as u8, 100 + y as u8, 240]));
    picture.save(&normals).expect("cannot write the normal map");
    let normals = normals.display().to_string();
    let mut group = c.benchmark_group("materials");
    for (name, definition) in MATERIALS {
        let definition = definition.replace("IMAGE", &normals);
        let text = format!("wavelengths_nm = [450, 520, 590, 660]\n[materials]\n{PARTS}m.{definition}\n");
        let set = MaterialSet::from_text(Path::new("bench.toml"), &text).expect("the material is valid");
        let (m, id) = (&set.materials, set.names["m"]);
        let mut eval = |what: &str, directions: &[Vec3A]| {
            let mut next = directions.iter().cycle();
            group.bench_function(format!("{name}, {what}"), |b| {
                b.iter(|| {
                    let wi = next.next().copied().unwrap_or(wo);
                    m.eval(id, black_box(&at), black_box(wo), black_box(wi))
                });
            });
        };
        eval("eval", &above);
        if name.starts_with("rough_dielectric") {
            eval("eval through", &below);
        }
        group.bench_function(format!("{name}, sample"), |b| {
            b.iter(|| m.sample(id, black_box(&at), black_box(wo), &mut Lanes::first(4), &mut stream));
        });
    }
    group.finish();
}

criterion_group!(benches, materials);
criterion_main!(benches);
