//! Measures `eval`, `pdf` and `sample` of a measured material, and the time to open its table.

use criterion::{Criterion, criterion_group, criterion_main};
use glam::Vec3A;
use sunstone::optics::sampling::microfacet::{Distribution, Masking};
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::sampling::warp;
use sunstone::optics::spectrum::{Spectral, Wavelengths};
use sunstone::transport::geometry::ray::Surface;
use sunstone::transport::material::facets::Roughness;
use sunstone::transport::material::measured::Measured;
use sunstone::transport::material::measured::axes::Axes;
use sunstone::transport::material::measured::table::{Options, Table};
use sunstone::transport::material::measured::write::tabulate;
use sunstone::transport::material::rough_conductor::RoughConductor;
use sunstone::transport::material::texture::{Scalar, Spectrum};
use sunstone::transport::material::{Lanes, Material, Materials};

fn pbsdf(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("cannot create a temporary folder");
    let path = folder.path().join("metal.pbsdf");
    let metal = Materials {
        list: vec![Material::RoughConductor(RoughConductor {
            n: Spectral::new([1.38, 0.42, 0.14, 1.0]),
            k: Spectral::new([1.9, 2.5, 3.7, 0.0]),
            reflectance: Spectrum::uniform(Spectral::ONE),
            roughness: Roughness {
                distribution: Distribution::Ggx,
                masking: Masking::Correlated,
                alpha: Scalar::uniform(0.2),
            },
        })],
        ..Materials::default()
    };
    // The table occupies 38 MB, which exceeds the processor caches.
    let axes = Axes::even([91, 46, 46], vec![450, 550, 650]);
    tabulate(&path, &axes, &[(&metal, 0)]).expect("cannot write the table");
    let open = |nm: &[f64]| {
        let options = Options {
            wavelengths: Some(Wavelengths::new(nm.to_vec()).expect("the wavelengths are valid")),
            ..Options::default()
        };
        Table::open(&path, &options).expect("cannot open the table")
    };
    c.bench_function("open", |b| b.iter(|| open(&[450.0, 550.0, 650.0])));
    let at = Surface {
        p: Vec3A::ZERO,
        ng: Vec3A::Z,
        ns: Vec3A::Z,
        tangent: Vec3A::X,
        bitangent: Vec3A::ZERO,
        uv: [0.0; 2],
        material: 0,
        rounding: 0.0,
    };
    for (name, nm) in
        [("3 wavelengths on bands", [450.0, 550.0, 650.0]), ("3 between bands", [460.0, 540.0, 640.0])]
    {
        let materials = Materials {
            list: vec![Material::Measured(Measured { table: 0 })],
            tables: vec![open(&nm)],
            ..Materials::default()
        };
        let mut stream = Stream::new(1, 0, 0);
        c.bench_function(&format!("eval, {name}, random directions"), |b| {
            b.iter(|| {
                let wo = warp::cosine_hemisphere(stream.uniform2());
                let wi = warp::cosine_hemisphere(stream.uniform2());
                materials.eval(0, &at, wo, wi)
            });
        });
        c.bench_function(&format!("pdf, {name}, random directions"), |b| {
            b.iter(|| {
                let wo = warp::cosine_hemisphere(stream.uniform2());
                let wi = warp::cosine_hemisphere(stream.uniform2());
                materials.pdf(0, &at, wo, wi)
            });
        });
        c.bench_function(&format!("sample, {name}, random viewers"), |b| {
            b.iter(|| {
                let wo = warp::cosine_hemisphere(stream.uniform2());
                materials.sample(0, &at, wo, &mut Lanes::first(3), &mut stream)
            });
        });
    }
}

criterion_group!(benches, pbsdf);
criterion_main!(benches);
