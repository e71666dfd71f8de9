//! Compares measured materials with the materials from which their tables were made. Tests the properties of
//! the interpolation.

use crate::materials::{axes, follow_density, is_reciprocal, pair_in_front, surface, toward, weights_agree};
use crate::optics::M;
use glam::{Mat3A, Vec3A};
use std::f32::consts::{FRAC_PI_2, PI};
use std::f64::consts::TAU;
use std::path::PathBuf;
use sunstone::optics::polarization::frame::project;
use sunstone::optics::polarization::scatter::Scatter;
use sunstone::optics::sampling::microfacet::{Distribution, Masking};
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::spectrum::{Spectral, Wavelengths};
use sunstone::polarimetry::decompose::cloude;
use sunstone::transport::material::facets::Roughness;
use sunstone::transport::material::measured::Measured;
use sunstone::transport::material::measured::axes::Axes;
use sunstone::transport::material::measured::rusinkiewicz::{Coordinates, directions};
use sunstone::transport::material::measured::table::{Options, Table};
use sunstone::transport::material::measured::write::{tabulate, write};
use sunstone::transport::material::rough_conductor::RoughConductor;
use sunstone::transport::material::texture::{Scalar, Spectrum};
use sunstone::transport::material::{Lanes, Material, Materials};

/// Returns rough gold (550 nm) and a silver-like metal in two lanes.
fn metal(alpha: f32) -> Materials {
    Materials {
        list: vec![Material::RoughConductor(RoughConductor {
            n: Spectral::new([0.4242, 0.06, 1.0, 1.0]),
            k: Spectral::new([2.4721, 3.6, 0.0, 0.0]),
            reflectance: Spectrum::uniform(Spectral::ONE),
            roughness: Roughness {
                distribution: Distribution::Ggx,
                masking: Masking::Correlated,
                alpha: Scalar::uniform(alpha),
            },
        })],
        ..Materials::default()
    }
}

/// A temporary folder for tables, which exists while the tests make and open the tables.
struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Self {
        let memory = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir());
        Self(memory.expect("a folder"))
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("t.pbsdf")
    }

    fn open(&self, nm: &[f64]) -> Materials {
        let options = Options {
            wavelengths: Some(Wavelengths::new(nm.to_vec()).expect("wavelengths")),
            ..Options::default()
        };
        let table = Table::open(&self.path(), &options).unwrap_or_else(|e| panic!("{e}"));
        Materials {
            list: vec![Material::Measured(Measured { table: 0 })],
            tables: vec![table],
            ..Materials::default()
        }
    }

    /// Returns a table made from a metal, with bands at 450 and 550 nm.
    fn of_metal(&self, alpha: f32, counts: [usize; 3]) -> Materials {
        let axes = Axes::even(counts, vec![450, 550]);
        tabulate(&self.path(), &axes, &[(&metal(alpha), 0)]).expect("a table");
        self.open(&[450.0, 550.0])
    }

    /// Returns a table of given values.
    fn of(&self, axes: &Axes, nm: &[f64], mut value: impl FnMut([usize; 4], usize) -> f32) -> Materials {
        let (h, bands) = (axes.theta_h.len(), axes.wavelengths_nm.len());
        write(&self.path(), axes, |phi, slab| {
            for (i, x) in slab.iter_mut().enumerate() {
                let cell = i / 16;
                let at = [phi, cell / bands / h, cell / bands % h, cell % bands];
                *x = value(at, i % 16);
            }
        })
        .expect("a table");
        self.open(nm)
    }
}

/// Returns a pair of directions with cosines of at least `least`.
fn pair(stream: &mut Stream, least: f32) -> (Vec3A, Vec3A) {
    let mut draw = || {
        let [u, v] = stream.uniform2();
        toward(least + (1.0 - least) * u, v * TAU as f32)
    };
    (draw(), draw())
}

/// Returns one lane of the matrix in Stokes frames that depend only on the rays.
fn matrix(s: &Scatter, wo: Vec3A, wi: Vec3A, lane: usize) -> M {
    let axis = |d| project(Vec3A::new(0.36, 0.48, 0.8), d);
    let m = s.between(wo, axis(wo), wi, axis(wi)).lane(lane);
    M::from_fn(|i, j| f64::from(m[i][j]))
}

/// Compares the elements of a table with those of its source, for pairs of directions within 60° of the
/// normal. (Cells that touch the horizon have holes.) Returns the root mean square and the maximum of the
/// differences, divided by M00.
fn error(counts: [usize; 3]) -> [f64; 2] {
    let (bench, source) = (Bench::new(), metal(0.5));
    let table = bench.of_metal(0.5, counts);
    let (at, mut stream) = (surface(), Stream::new(11, 0, 0));
    let (mut sum, mut worst) = (0.0, 0.0_f64);
    let n = 4000;
    for _ in 0..n {
        let (wo, wi) = pair(&mut stream, 0.5);
        let [got, want] = [&table, &source].map(|m| {
            let value = m.eval(0, &at, wo, wi).expect("both are above the surface");
            matrix(&value, wo, wi, 1)
        });
        let off = (got - want).abs().max() / want[(0, 0)];
        sum += off * off;
        worst = worst.max(off);
    }
    [(sum / f64::from(n)).sqrt(), worst]
}

/// Tests that linear interpolation has second-order errors, so that half the step gives a quarter of the
/// error.
#[test]
fn tables_converge_to_their_source_at_second_order() {
    let coarse = error([17, 10, 10]);
    let fine = error([33, 19, 19]);
    let order = (coarse[0] / fine[0]).log2();
    assert!((1.8..2.2).contains(&order), "order {order} from {coarse:?} to {fine:?}");
    assert!(fine[0] < 0.008 && fine[1] < 0.02, "{fine:?}");
}

/// Tests that, at an entry, the table equals its source up to rounding, including frames and cosine.
#[test]
fn entries_equal_the_source() {
    let (bench, source) = (Bench::new(), metal(0.4));
    let table = bench.of_metal(0.4, [13, 7, 10]);
    let at = surface();
    let mut compared = 0;
    for (i, j, k) in (0..13).flat_map(|i| (0..7).flat_map(move |j| (0..10).map(move |k| (i, j, k)))) {
        let [p, d, h] = table.tables[0].angles();
        let c = Coordinates { phi_d: p[i], theta_d: d[j], theta_h: h[k] };
        let (wi, wo, _) = directions(c);
        if wi.z < 0.05 || wo.z < 0.05 {
            continue;
        }
        let turn = axes() * Mat3A::from_rotation_z(1.3 * i as f32);
        let (wi, wo) = (turn * wi, turn * wo);
        let [got, want] =
            [&table, &source].map(|m| matrix(&m.eval(0, &at, wo, wi).expect("above"), wo, wi, 0));
        let off = (got - want).abs().max() / want[(0, 0)];
        // Rounding of f32 angles shifts the position in the table by up to 1e-5 of a step.
        assert!(off < 1e-4, "{c:?}: off by {off}\n{got}\n{want}");
        compared += 1;
    }
    assert!(compared > 300, "{compared}");
}

/// Tests that a table is as reciprocal as its source at angles φ_d for which φ_d and φ_d + π are entries.
#[test]
fn reciprocity_is_inherited() {
    let bench = Bench::new();
    let table = bench.of_metal(0.4, [17, 9, 9]);
    assert_eq!(is_reciprocal("table", &table, |_| 1.0, pair_in_front, 5e-4), 700);
}

/// Tests that a table of realizable matrices gives realizable matrices, with or without holes at the horizon.
/// Interpolation is a convex sum and therefore preserves realizability.
#[test]
fn realizability_is_inherited() {
    let bench = Bench::new();
    let table = bench.of_metal(0.3, [9, 7, 7]);
    let (at, mut stream) = (surface(), Stream::new(13, 0, 0));
    let mut lit = 0;
    for _ in 0..3000 {
        let (wo, wi) = pair(&mut stream, 0.005);
        let value = table.eval(0, &at, wo, wi).expect("above");
        let m = matrix(&value, wo, wi, 1);
        assert!(m[(0, 0)] >= 0.0);
        if m[(0, 0)] > 0.0 {
            let rows = std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)] / m[(0, 0)]));
            assert!(cloude::is_realizable(&rows, 1e-5), "{wo} {wi}: {m}");
            lit += 1;
        }
    }
    assert!(lit > 2500, "{lit}");
}

/// Tests that tables have equal values at φ_d = -π and φ_d = π. Some tables include entries at -π and π. All
/// tables must be continuous at φ_d = ±π, and must agree with each other.
#[test]
fn tables_are_continuous_across_the_azimuth_boundary() {
    let bench = Bench::new();
    let wave = |phi: f32, e: usize| {
        if e == 0 { 2.0 + phi.cos() + 0.5 * (2.0 * phi).sin() } else { 0.0 }
    };
    let mut half_open = Axes::even([48, 4, 4], vec![550]);
    for (i, p) in half_open.phi_d.iter_mut().enumerate() {
        *p = -PI + 0.07 + i as f32 * 2.0 * PI / 48.0;
    }
    for axes in [Axes::even([49, 4, 4], vec![550]), half_open] {
        let phi = axes.phi_d.clone();
        let materials = bench.of(&axes, &[550.0], |at, e| wave(phi[at[0]], e));
        let m00 = |phi_d: f32| {
            let at = Coordinates { phi_d, theta_d: 0.5, theta_h: 0.4 };
            materials.tables[0].eval(at).m[0][0].to_array()[0]
        };
        for k in 0..=400 {
            let p = PI * (k as f32 / 200.0 - 1.0);
            assert!((m00(p) - wave(p, 0)).abs() < 0.01, "{p}: {} is not {}", m00(p), wave(p, 0));
        }
        assert!((m00(PI) - m00(-PI)).abs() < 1e-5);
    }
}

/// Tests that holes are excluded and that the remaining corners have more weight. The interpolated value of a
/// constant table is the constant if at least one corner exists, and 0 if no corner exists. An entry with one
/// invalid element is a hole in the band of that element.
#[test]
fn holes_are_excluded_from_interpolation() {
    let bench = Bench::new();
    let axes = Axes::even([9, 6, 6], vec![450, 550]);
    let hole = |at: [usize; 4]| !(at[0] * 7 + at[1] * 5 + at[2] * 3).is_multiple_of(4) || at[1] == 5;
    let constant = |e: usize| if e == 0 { 0.3 } else { 0.01 * e as f32 };
    for bad in [f32::NAN, f32::INFINITY] {
        for element in [0, 9] {
            let materials = bench.of(&axes, &[450.0, 500.0, 550.0], |at, e| {
                if at[3] == 1 && hole(at) && e == element { bad } else { constant(e) }
            });
            let table = &materials.tables[0];
            let (mut stream, mut dark) = (Stream::new(14, 0, 0), 0);
            for _ in 0..3000 {
                let at = Coordinates {
                    phi_d: PI * (2.0 * stream.uniform() - 1.0),
                    theta_d: FRAC_PI_2 * stream.uniform(),
                    theta_h: FRAC_PI_2 * stream.uniform(),
                };
                let m = table.eval(at);
                for e in 0..16 {
                    let lanes = m.m[e / 4][e % 4].to_array();
                    let near = |x: f32| (x - constant(e)).abs() < 1e-6;
                    assert!(near(lanes[0]) && near(lanes[1]), "{at:?}: {lanes:?}");
                    assert!(near(lanes[2]) || lanes[2] == 0.0, "{at:?}: {lanes:?}");
                    assert_eq!(lanes[3], 0.0, "an unused lane");
                }
                dark += u32::from(m.m[0][0].to_array()[2] == 0.0);
            }
            assert!((10..1500).contains(&dark), "{dark} of 3000 have no corner");
        }
    }
}

/// Tests that values are linear between bands and constant beyond the outermost bands. Angles beyond the axes
/// use the last entry. Negative radiance counts as zero.
#[test]
fn values_beyond_the_axes_use_the_last_entry() {
    let bench = Bench::new();
    let mut axes = Axes::even([5, 3, 3], vec![450, 550, 650]);
    axes.theta_d = vec![0.1, 0.6, 1.2];
    axes.theta_h = vec![0.0, 0.4, 1.3];
    let spectrum = [1.0, 2.0, 5.0];
    let slope = |at: [usize; 4], e: usize| {
        let sign = if at[2] == 2 { -1.0 } else { 1.0 };
        (if e == 0 { sign } else { 0.1 }) * spectrum[at[3]] * (1.0 + at[1] as f32)
    };
    let materials = bench.of(&axes, &[400.0, 475.0, 550.0, 660.0], slope);
    let eval = |theta_d: f32, theta_h: f32| {
        let at = Coordinates { phi_d: 0.3, theta_d, theta_h };
        materials.tables[0].eval(at).m
    };
    let near = |got: Spectral, want: [f32; 4]| {
        let off = (got - Spectral::new(want)).abs().to_array();
        assert!(off.iter().all(|o| *o < 1e-5), "{got} is not {want:?}");
    };
    near(eval(0.6, 0.2)[0][0], [2.0, 2.5, 4.0, 10.0]);
    near(eval(0.02, 0.2)[0][0], [1.0, 1.25, 2.0, 5.0]);
    near(eval(1.5, 0.2)[0][0], [3.0, 3.75, 6.0, 15.0]);
    near(eval(0.6, 1.5)[0][0], [0.0; 4]);
    near(eval(0.6, 1.5)[2][1], [0.0; 4]);
}

/// Returns glossy, satin and coarse tables for the sampling tests.
fn sampled() -> Vec<(String, Materials)> {
    let bench = Bench::new();
    [(0.1, [19, 31, 46]), (0.3, [19, 19, 19]), (0.6, [7, 5, 6])]
        .map(|(alpha, counts)| (format!("alpha {alpha}"), bench.of_metal(alpha, counts)))
        .into_iter()
        .collect()
}

#[test]
fn samples_follow_their_density_and_weights_are_values_over_it() {
    for (case, (name, materials)) in sampled().into_iter().enumerate() {
        for cos in [&[1.0_f32, 0.3, 0.05][..], &[0.7, 0.1], &[1.0, 0.05]][case].iter().copied() {
            let name = format!("{name}, cos {cos}");
            follow_density(&name, &materials, toward(cos, 0.4), case as u32, 24);
            let compared = weights_agree(&name, &materials, toward(cos, -1.0), case as u32, 1e-5);
            assert!(compared > 600, "{name}: {compared} samples");
        }
    }
}

/// Tests that sampling with the table has a smaller second moment of the weight's M00 than cosine sampling.
/// The mean of M00, which is the reflected fraction of light, must be equal for sampling with the table and
/// for cosine sampling.
#[test]
fn importance_tables_reduce_variance() {
    let bench = Bench::new();
    let materials = bench.of_metal(0.1, [19, 31, 91]);
    let at = surface();
    for cos in [1.0_f32, 0.7, 0.3] {
        let wo = toward(cos, 0.4);
        const N: usize = 50_000;
        let moments = |mut weight: Box<dyn FnMut(&mut Stream) -> f64>| {
            let mut stream = Stream::new(17, 0, 0);
            let (mut a, mut b, mut top) = (0.0, 0.0, 0.0_f64);
            for _ in 0..N {
                let w = weight(&mut stream);
                (a, b, top) = (a + w, b + w * w, top.max(w));
            }
            let mean = a / N as f64;
            (mean, b / N as f64 - mean * mean, top)
        };
        let (m, s) = (materials.clone(), at);
        let table = moments(Box::new(move |stream| {
            let sampled = m.sample(0, &s, wo, &mut Lanes::first(2), stream);
            sampled.map_or(0.0, |s| f64::from(s.scatter.m00().to_array()[0]))
        }));
        let (m, s) = (materials.clone(), at);
        let cosine = moments(Box::new(move |stream| {
            let local = sunstone::optics::sampling::warp::cosine_hemisphere(stream.uniform2());
            let pdf = sunstone::optics::sampling::warp::cosine_pdf(local);
            let value = m.eval(0, &s, wo, axes() * local);
            value.map_or(0.0, |v| f64::from(v.m00().to_array()[0] / pdf))
        }));
        let error = ((table.1 + cosine.1) / N as f64).sqrt();
        assert!((table.0 - cosine.0).abs() < 5.0 * error, "{table:?} {cosine:?}");
        assert!(table.1 * 20.0 < cosine.1, "{table:?} {cosine:?}");
    }
}
