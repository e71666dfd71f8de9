//! Render tests of a scene that is built in code.

use super::schedule::{Share, Unwatched, WALKS_AT_ONCE, render_in_parts};
use crate::device::distortion::Distortion;
use crate::device::emitter::{Environment, PointEmitter};
use crate::device::pinhole::Pinhole;
use crate::device::projector::Projector;
use crate::geometry::builder::GeometryBuilder;
use crate::geometry::mesh::Mesh;
use crate::geometry::quadric::{Quadric, QuadricKind};
use crate::light::Lights;
use crate::light::profile::Profile;
use crate::material::conductor::Conductor;
use crate::material::diffuse::Diffuse;
use crate::material::facets::Roughness;
use crate::material::rough_conductor::RoughConductor;
use crate::material::texture::{Scalar, Spectrum};
use crate::material::{Material, Materials};
use crate::medium::Media;
use crate::medium::nesting::Boundary;
use crate::scene::{Integrator, Scene, SceneTables, Settings};
use crate::strategy::Strategies;
use glam::{Affine3A, DVec2, Mat3A, Quat, Vec3, Vec3A};
use optics::sampling::microfacet::{Distribution, Masking};
use optics::spectrum::{Spectral, Wavelengths};
use tensor::field::Field;
use tensor::memory::Arrays;
use tensor::slice::{CameraSelect, Polarization, ProjectorSelect, Slice, TimeSelect};

/// Returns a scene with an open box, a smooth and a rough conducting sphere, and all kinds of lights.
fn scene(integrator: Integrator, plain: bool) -> Scene {
    Scene::new(tables(integrator, plain))
}

/// Returns the tables of [`scene`].
pub(super) fn tables(integrator: Integrator, plain: bool) -> SceneTables {
    let (n, k) = (Spectral::new([0.4, 1.5, 0.2, 2.0]), Spectral::new([2.5, 1.9, 3.4, 2.0]));
    let reflectance = Spectrum::uniform(Spectral::ONE);
    let roughness = Roughness {
        distribution: Distribution::Ggx,
        masking: Masking::default(),
        alpha: Scalar::uniform(0.3),
    };
    let materials = Materials {
        list: vec![
            Material::Diffuse(Diffuse { albedo: Spectrum::uniform(Spectral::new([0.3, 0.5, 0.7, 0.0])) }),
            Material::Conductor(Conductor { n, k, reflectance }),
            Material::RoughConductor(RoughConductor { n, k, reflectance, roughness }),
        ],
        ..Materials::default()
    };
    let mut builder = GeometryBuilder::default();
    for turn in [0.0, 0.5, -0.5] {
        let mut wall = Mesh::rectangle();
        let middle = Affine3A::from_translation(Vec3::new(-0.5, -0.5, 0.0));
        let size = Affine3A::from_scale_rotation_translation(
            Vec3::new(6.0, 6.0, 1.0),
            Quat::IDENTITY,
            Vec3::new(0.0, 0.0, -2.0),
        );
        let turned = Affine3A::from_rotation_y(turn * std::f32::consts::PI);
        wall.transform(&(turned * size * middle));
        builder.mesh(&wall, 0);
    }
    for (material, radius, at) in [(1, 0.6, [-0.7, -0.2, 0.0]), (2, 0.5, [0.6, 0.2, 0.4])] {
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::splat(radius),
            Quat::IDENTITY,
            Vec3::from_array(at),
        );
        builder.quadric(Quadric::new(QuadricKind::Sphere, place, material));
    }
    let geometry = builder.build();
    let axes = Mat3A::from_cols(Vec3A::X, -Vec3A::Y, -Vec3A::Z);
    let device = |x: f32| {
        let (focal, middle) = (DVec2::splat(20.0), DVec2::splat(12.0));
        let origin = Vec3A::new(x, 0.1, 4.0);
        Pinhole::new([24, 24], focal, middle, Distortion::default(), origin, axes).expect("no distortion")
    };
    SceneTables {
        name: "test".to_owned(),
        text: String::new(),
        wavelengths: Wavelengths::default(),
        geometry: if plain { geometry.plain() } else { geometry },
        boundaries: vec![Boundary::NONE; materials.list.len()],
        names: crate::names::Names::default(),
        materials,
        media: Media::default(),
        camera: device(0.0),
        projector: Some(Projector { pinhole: device(0.3), irradiance: Spectral::splat(3.0), coaxial: false }),
        points: vec![PointEmitter {
            position: Vec3A::new(-1.0, 1.5, 2.0),
            intensity: Spectral::ONE,
            profile: Profile::Even,
            slide: None,
            axis: Vec3A::X,
        }],
        environment: Some(Environment { radiance: Spectral::splat(0.1), axis: Vec3A::Y }),
        lights: Lights::default(),
        slices: vec![Slice {
            name: "all".to_owned(),
            camera: CameraSelect::All,
            projector: ProjectorSelect::Sum,
            time: TimeSelect::Sum,
            polarization: Polarization::Mueller,
            bounces: true,
            split_first_bounce: false,
            labels: false,
        }],
        settings: Settings {
            spp: 9,
            replicates: 1,
            max_depth: 6,
            rr_depth: 3,
            integrator,
            manifold: integrator != Integrator::Path,
            strategy: None,
            strategies: Strategies::ALL,
            seed: 7,
            tile: 8,
        },
        sha256: String::new(),
        variant: None,
        notes: vec![],
        files: vec![],
    }
}

/// Returns the bits of all means and errors, and the number of non-zero values.
fn bits(scene: &Scene) -> (Vec<u32>, usize) {
    bits_in_parts(scene, WALKS_AT_ONCE)
}

fn bits_in_parts(scene: &Scene, walks: u64) -> (Vec<u32>, usize) {
    let mut arrays = Arrays::default();
    let summary = render_in_parts(scene, &[], Share::default(), &mut arrays, &Unwatched, walks)
        .expect("arrays store all values");
    assert!(summary.complete && summary.discarded == 0);
    let bits: Vec<u32> = [Field::Mean, Field::StdError]
        .into_iter()
        .flat_map(|field| arrays.get("all", field).expect("the field exists").data)
        .map(f32::to_bits)
        .collect();
    let lit = bits.iter().filter(|b| **b != 0).count();
    (bits, lit)
}

/// Verifies that AVX2 code and portable code give the same bits, for paths and for bidirectional subpaths.
#[test]
fn renders_are_bit_identical_on_all_processors() {
    for integrator in [Integrator::Path, Integrator::Caustics, Integrator::Bidirectional] {
        let [fast, plain] = [false, true].map(|plain| {
            let scene = scene(integrator, plain);
            assert!(!(plain && scene.geometry.avx2));
            bits(&scene)
        });
        assert!(fast.1 > 10_000, "{} of {} are lit", fast.1, fast.0.len());
        assert!(fast == plain, "{integrator:?}");
    }
}

/// Verifies that a render in parts, with splats in a file, is bit-identical to a render in a single part. The
/// test compares renders with 1 and 3 threads.
#[test]
fn rendering_in_parts_is_bit_identical() {
    // The image has 24 × 24 pixels with 9 samples each. The render has 3 or 9 parts with 9 tiles in total.
    for (integrator, walks) in
        [(Integrator::Bidirectional, 2000), (Integrator::Bidirectional, 100), (Integrator::Caustics, 2000)]
    {
        let scene = scene(integrator, false);
        let whole = bits(&scene);
        assert!(whole.1 > 1000, "{}", whole.1);
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
            assert!(
                pool.install(|| bits_in_parts(&scene, walks)) == whole,
                "{walks} walks, {threads} threads"
            );
        }
    }
}
