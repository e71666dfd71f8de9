//! Tests single media:
//! - Matrices are normalized, realizable and reciprocal.
//! - Samplers follow their densities.
//! - Tables agree with their theory.
//! - Milk has measured properties.

use crate::materials::{elements, pearson, reciprocal};
use crate::optics::{M, turn};
use glam::{DVec3, Vec3A};
use std::f64::consts::{PI, TAU};
use std::sync::OnceLock;
use sunstone::optics::polarization::scatter::Scatter;
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::spectrum::{Spectral, Wavelengths};
use sunstone::polarimetry::decompose::cloude::is_realizable;
use sunstone::transport::material::Lanes;
use sunstone::transport::medium::bulk::{Amount, Bulk, Ensemble, Kind, Optics, PhaseOptics};
use sunstone::transport::medium::henyey_greenstein::HenyeyGreenstein;
use sunstone::transport::medium::presets::{MARBLE, Milk, SKIN, polystyrene, polystyrene_index};
use sunstone::transport::medium::rayleigh::Rayleigh;
use sunstone::transport::medium::size_distribution::SizeDistribution;
use sunstone::transport::medium::table::TOLERANCE;
use sunstone::transport::medium::{Media, Phase};

fn media(phase: PhaseOptics) -> Media {
    let mut media = Media::default();
    media.push(&Optics { bulk: vec![Bulk { index: 1.3, scattering: 1.0, ..Bulk::default() }; 4], phase });
    media
}

fn henyey_greenstein(g: [f32; 4], linear: f32, circular: f32) -> Media {
    media(PhaseOptics::HenyeyGreenstein(HenyeyGreenstein::new(Spectral::new(g), linear, circular)))
}

/// Returns spheres of given sizes in a host of index 1.33, at four wavelengths.
fn spheres(sizes: &SizeDistribution, [n, k]: [f64; 2]) -> Vec<Ensemble> {
    let ensemble = |nm: f64| {
        let mut e = Ensemble::new(1.33, nm);
        e.add(sizes, [n, k], Amount::VolumeFraction(0.01)).expect("admitted particles");
        e.finish();
        e
    };
    [450.0, 550.0, 660.0, 800.0].map(ensemble).to_vec()
}

fn mie(radius: f64, n: f64, k: f64) -> Media {
    media(PhaseOptics::Particles(spheres(&SizeDistribution::Single { radius }, [n, k])))
}

/// Returns every phase function that the tests in this file cover.
fn cases() -> &'static [(&'static str, Media)] {
    static CASES: OnceLock<Vec<(&'static str, Media)>> = OnceLock::new();
    CASES.get_or_init(make_cases)
}

fn make_cases() -> Vec<(&'static str, Media)> {
    let rayleigh = |rho| media(PhaseOptics::Rayleigh(Rayleigh::new(rho)));
    let fog = SizeDistribution::Gamma { effective_radius: 2e-6, effective_variance: 0.1 };
    vec![
        ("isotropic", media(PhaseOptics::Isotropic)),
        ("Rayleigh", rayleigh(0.0)),
        ("Rayleigh, air", rayleigh(0.028)),
        ("Rayleigh, needles", rayleigh(0.5)),
        ("flat", henyey_greenstein([0.0; 4], 0.0, 0.0)),
        ("forward", henyey_greenstein([0.7, 0.8, 0.9, 0.95], 0.0, 0.0)),
        ("backward", henyey_greenstein([-0.9, -0.3, 0.1, 0.5], 0.5, 0.0)),
        ("dipole-like", henyey_greenstein([0.3, 0.5, 0.7, 0.9], 1.0, 1.0)),
        ("tiny spheres", mie(1e-9, 1.59, 0.0)),
        ("small spheres", mie(1e-7, 1.59, 0.0)),
        ("spheres", mie(1e-6, 1.59, 0.0)),
        ("gold spheres", mie(1e-7, 0.5, 2.5)),
        ("large spheres", mie(5e-6, 1.45, 1e-3)),
        ("fog", media(PhaseOptics::Particles(spheres(&fog, [1.45, 0.0])))),
    ]
}

/// Samples one lane uniformly. Returns the direction, and the matrix divided by the mean density of the
/// lanes.
fn sample(media: &Media, wo: Vec3A, lanes: Lanes, stream: &mut Stream) -> (Vec3A, Scatter) {
    let lane = lanes.draw(stream);
    let wi = media.sample_direction(0, wo, lane, stream);
    (wi, media.eval(0, wo, wi).scaled(Spectral::splat(1.0 / media.pdf(0, lanes, wo, wi))))
}

fn all() -> Lanes {
    Lanes::first(4)
}

/// Returns a pair of directions with wo in general position. The angle θ between the directions satisfies 2
/// sin²(θ/2) = 1 - cosθ = `forward`.
fn at(forward: f64, phi: f64) -> (Vec3A, Vec3A) {
    let wo = DVec3::new(0.36, -0.48, 0.8);
    let (x, cos) = (wo.any_orthonormal_vector(), 1.0 - forward);
    let sin = (forward * (2.0 - forward)).max(0.0).sqrt();
    let across = x * phi.cos() + wo.cross(x) * phi.sin();
    (wo.as_vec3a(), (across * sin - wo * cos).as_vec3a())
}

/// Returns Σ f(wo, wi) over the sphere, weighted by the solid angle of each direction. The function uses
/// `count` rings of directions, dense near the forward and backward directions.
fn rings(count: usize, mut f: impl FnMut(Vec3A, Vec3A, f64)) {
    // The angle is θ = π s²(3 - 2s), at the midpoints of s.
    for i in 0..count {
        let s = (i as f64 + 0.5) / count as f64;
        let theta = PI * s * s * (3.0 - 2.0 * s);
        let slope = 6.0 * PI * s * (1.0 - s) / count as f64;
        let (wo, wi) = at(2.0 * (theta / 2.0).sin().powi(2), 0.3);
        f(wo, wi, TAU * theta.sin() * slope);
    }
}

#[test]
fn matrices_are_normalized() {
    for (name, media) in cases() {
        let mut sums = [0.0; 4];
        let mut density = 0.0;
        rings(40_000, |wo, wi, area| {
            let s11 = media.eval(0, wo, wi).m00().to_array();
            for (sum, s) in sums.iter_mut().zip(s11) {
                *sum += area * f64::from(s);
            }
            density += area * f64::from(media.pdf(0, all(), wo, wi));
        });
        for sum in sums.into_iter().chain([density]) {
            assert!((sum - 1.0).abs() < 2e-5, "{name}: {sums:?}, density {density}");
        }
    }
    let (wo, wi) = at(0.7, 0.0);
    let isotropic = media(PhaseOptics::Isotropic);
    let value = isotropic.eval(0, wo, wi);
    assert!(matches!(value, Scatter::Depolarize(_)));
    assert!((f64::from(value.m00().to_array()[0]) - 0.25 / PI).abs() < 1e-7);
}

/// Tests that the mean cosine of tables equals the mean cosine of the series. For Henyey & Greenstein, the
/// mean cosine is the parameter g.
#[test]
fn mean_cosines_are_known() {
    let check = |name: &str, media: &Media, want: [f64; 4]| {
        let mut cosines = [0.0; 4];
        rings(40_000, |wo, wi, area| {
            let s11 = media.eval(0, wo, wi).m00().to_array();
            for (sum, s) in cosines.iter_mut().zip(s11) {
                *sum -= area * f64::from(s) * f64::from(wi.dot(wo));
            }
        });
        for (got, want) in cosines.into_iter().zip(want) {
            assert!((got - want).abs() < 2e-5, "{name}: {got} is not {want}");
        }
    };
    let g = [-0.9, -0.3, 0.1, 0.95];
    check("HG", &henyey_greenstein(g.map(|g| g as f32), 0.0, 0.0), g);
    for (radius, n) in [(1e-9, 1.5), (1e-7, 1.59), (1e-6, 1.59), (3e-6, 1.45)] {
        let ensembles = spheres(&SizeDistribution::Single { radius }, [n, 0.0]);
        let want: Vec<f64> = ensembles.iter().map(|e| e.bulk(0.0).asymmetry).collect();
        let want = [want[0], want[1], want[2], want[3]];
        check("Mie", &media(PhaseOptics::Particles(ensembles)), want);
    }
}

fn matrix(s: &Scatter, wo: Vec3A, wi: Vec3A, lane: usize) -> [[f64; 4]; 4] {
    let normal = match s {
        Scatter::Fresnel { s, .. } => *s,
        Scatter::Full { frame_out, .. } => *frame_out,
        Scatter::Depolarize(_) => wo.any_orthonormal_vector(),
    };
    let m = s.between(wo, normal, wi, normal);
    m.lane(lane).map(|row| row.map(f64::from))
}

/// Tests by Cloude's criterion that no matrix gives a degree of polarization above 1, at any angle, for all
/// valid parameters.
#[test]
fn matrices_are_physical() {
    let mut all_cases = cases().to_vec();
    for c in [0.0, 0.2, 0.5, 0.9, 1.0_f32] {
        for share in [0.0, 0.3, 0.7, 1.0] {
            // Parameters beyond the limit are clamped to the limit.
            all_cases.push(("HG", henyey_greenstein([0.5; 4], share * (0.5 + 0.5 * c), c)));
            all_cases.push(("HG", henyey_greenstein([0.5; 4], 1.0, c)));
        }
    }
    for rho in [0.1, 0.2, 0.3, 0.4, 0.7] {
        all_cases.push(("Rayleigh", media(PhaseOptics::Rayleigh(Rayleigh::new(rho)))));
    }
    for (name, media) in all_cases {
        for i in 0..=500 {
            let (wo, wi) = at(2.0 * f64::from(i) / 500.0, 0.3);
            let s = media.eval(0, wo, wi);
            for lane in 0..4 {
                let m = matrix(&s, wo, wi, lane);
                assert!(is_realizable(&m, 2e-6), "{name}, {i}: {m:?}");
            }
        }
    }
    // The limit is sharp. Slightly beyond the limit, the matrix is not realizable at some angle.
    let m = |f: f64| [[1.0, 0.0, 0.0, 0.0], [0.0, 0.52, 0.0, 0.0], [0.0, 0.0, 0.52 * f, 0.0], [0.0; 4]];
    assert!(!is_realizable(&m(1.0), 1e-3) && is_realizable(&m(0.5), 0.0));
}

/// Tests dipole scattering at 90°, forward and backward against closed forms. At 90°, the ratio of parallel
/// to perpendicular light is the depolarization factor.
#[test]
fn rayleigh_has_its_closed_form() {
    let unit = 3.0 / (16.0 * PI);
    for rho in [0.0, 0.028, 0.3, 0.5] {
        let media = media(PhaseOptics::Rayleigh(Rayleigh::new(rho as f32)));
        let delta = (1.0 - rho) / (1.0 + rho / 2.0);
        for forward in [0.0, 0.2, 1.0, 1.7, 2.0] {
            let mu = 1.0 - forward;
            let (wo, wi) = at(forward, 1.0);
            let m = matrix(&media.eval(0, wo, wi), wo, wi, 2);
            let flat = (1.0 - delta) / (4.0 * PI);
            for (got, want) in [
                (m[0][0], delta * unit * (1.0 + mu * mu) + flat),
                (m[0][1], delta * unit * (1.0 - mu * mu)),
                (m[1][1], delta * unit * (1.0 + mu * mu)),
                (m[2][2], delta * unit * 2.0 * mu),
                (m[3][3], delta * unit * 2.0 * mu * (1.0 - 2.0 * rho) / (1.0 - rho)),
                (m[2][3], 0.0),
            ] {
                assert!((got - want).abs() < 3e-7, "ρ = {rho}, μ = {mu}: {m:?}");
            }
        }
        let (wo, wi) = at(1.0, 2.0);
        let m = matrix(&media.eval(0, wo, wi), wo, wi, 0);
        let ratio = (m[0][0] - m[0][1]) / (m[0][0] + m[0][1]);
        assert!((ratio - rho).abs() < 1e-6, "{ratio}");
    }
    // Spheres of 1 nm are dipoles.
    let (tiny, dipole) = (mie(1e-9, 1.59, 0.0), media(PhaseOptics::Rayleigh(Rayleigh::new(0.0))));
    for i in 0..=50 {
        let (wo, wi) = at(f64::from(i) / 25.0, 1.0);
        let [a, b] = [&tiny, &dipole].map(|m| elements(&m.eval(0, wo, wi), wo, wi)[1]);
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).abs() < 3e-5, "{i}: {a} {b}");
        }
    }
}

/// Tests that, near the forward and backward directions, the matrix does not depend on the scattering plane,
/// which is undefined in these directions.
#[test]
fn forward_and_backward_matrices_do_not_depend_on_the_plane() {
    for (name, media) in cases() {
        // The directions are 10⁻⁵ rad away from forward and backward, so a scattering plane exists.
        for forward in [1e-10, 2.0 - 1e-10] {
            let (wo, wi) = at(forward, 0.0);
            let first = elements(&media.eval(0, wo, wi), wo, wi);
            for turn in 1..8 {
                let (wo, wi) = at(forward, f64::from(turn) * 0.7);
                let again = elements(&media.eval(0, wo, wi), wo, wi);
                for lane in 0..4 {
                    for (a, b) in first[lane].iter().zip(again[lane]) {
                        assert!((a - b).abs() < 2e-5 * first[lane][0], "{name}: {a} {b}");
                    }
                }
            }
        }
    }
}

/// Tests that samples follow their density. The test uses Pearson's chi² of 10⁵ samples in 64 rings of equal
/// probability times 8 sectors.
#[test]
#[ignore = "slow: tools/check --all"]
fn samples_follow_their_density() {
    const N: usize = 100_000;
    const RINGS: usize = 64;
    const SECTORS: usize = 8;
    for (case, (name, media)) in cases().iter().enumerate() {
        for (which, lanes) in [all(), Lanes { mask: 0b0100 }].into_iter().enumerate() {
            // Computes the distribution function over 1 - cosθ, and the borders of the rings from this
            // function.
            let (mut borders, mut shares) = (vec![], vec![]);
            let (mut sum, mut before, mut last) = (0.0, 0.0, 0.0);
            rings(40_000, |wo, wi, area| {
                sum += area * f64::from(media.pdf(0, lanes, wo, wi));
                // The rings are so thin that their centres can replace their ends.
                let forward = 0.5 * f64::from((wo + wi).length_squared());
                if sum * RINGS as f64 >= (shares.len() + 1) as f64 && shares.len() + 1 < RINGS {
                    borders.push(0.5 * (forward + last));
                    let below = sum - area * f64::from(media.pdf(0, lanes, wo, wi));
                    shares.push(below - before);
                    before = below;
                }
                last = forward;
            });
            shares.push(sum - before);
            let wo = at(0.0, 0.0).0;
            let x = wo.any_orthonormal_vector();
            let y = wo.cross(x);
            let mut observed = vec![0.0; shares.len() * SECTORS];
            let mut stream = Stream::new(77, case as u32, which as u32);
            for _ in 0..N {
                let (wi, _) = sample(media, wo, lanes, &mut stream);
                assert!((wi.length() - 1.0).abs() < 1e-5, "{name}: {wi}");
                let forward = 0.5 * f64::from((wo + wi).length_squared());
                let ring = borders.partition_point(|b| *b < forward);
                let turn = (f64::from(wi.dot(y)).atan2(f64::from(wi.dot(x))) / TAU).rem_euclid(1.0);
                let sector = ((turn * SECTORS as f64) as usize).min(SECTORS - 1);
                observed[ring * SECTORS + sector] += 1.0;
            }
            let expected: Vec<f64> =
                shares.iter().flat_map(|s| [s * N as f64 / SECTORS as f64; SECTORS]).collect();
            pearson(&format!("{name}, lanes {:b}", lanes.mask), &observed, &expected);
        }
    }
}

/// Tests that weights are values divided by densities. No active lane's weight may exceed the number of
/// active lanes, except for the difference between the interpolations of value and density.
#[test]
fn weights_are_values_over_densities() {
    for (case, (name, media)) in cases().iter().enumerate() {
        for lanes in [all(), Lanes { mask: 0b0110 }] {
            let mut stream = Stream::new(78, case as u32, 0);
            let wo = at(0.0, 0.0).0;
            for _ in 0..1000 {
                let (wi, scatter) = sample(media, wo, lanes, &mut stream);
                let pdf = media.pdf(0, lanes, wo, wi);
                assert!(pdf > 0.0, "{name}: {wi}");
                let got = elements(&scatter, wo, wi);
                let value = media.eval(0, wo, wi).scaled(Spectral::splat(1.0 / pdf));
                let want = elements(&value, wo, wi);
                for lane in (0..4).filter(|l| lanes.mask >> l & 1 == 1) {
                    // Near the forward direction, single-precision directions do not determine the plane.
                    for (e, (g, w)) in got[lane].iter().zip(want[lane]).enumerate() {
                        let tolerance = if e == 0 { 3e-4 } else { 2e-3 };
                        assert!((g - w).abs() < tolerance * want[lane][0].max(0.01), "{name}, {e}: {g} {w}");
                    }
                    assert!(got[lane][0] < 1.1 * lanes.count() as f32, "{name}: {}", got[lane][0]);
                }
            }
        }
    }
}

/// Tests that, for a single lane with S11 sampling, every weight is 1. Closed forms are exact, and tables are
/// accurate within the error of the grid.
#[test]
fn single_wavelengths_have_constant_weights() {
    for (name, media) in cases() {
        let exact = !matches!(media.list[0].phase, Phase::Table(_));
        let mut stream = Stream::new(79, 0, 0);
        let wo = at(0.0, 0.0).0;
        for _ in 0..700 {
            let (_, s) = sample(media, wo, Lanes { mask: 0b0010 }, &mut stream);
            let off = (s.m00().to_array()[1] - 1.0).abs();
            assert!(off < if exact { 1e-5 } else { 0.02 }, "{name}: {off}");
        }
    }
}

#[test]
fn media_are_reciprocal() {
    let pair =
        |stream: &mut Stream| [0; 2].map(|_| sunstone::optics::sampling::warp::sphere(stream.uniform2()));
    for (name, media) in cases() {
        let value = |o: Vec3A, i: Vec3A, [xo, xi]: [DVec3; 2]| {
            let s = media.eval(0, o, i);
            let n = match &s {
                Scatter::Fresnel { s, .. } => *s,
                Scatter::Full { frame_out, .. } => *frame_out,
                Scatter::Depolarize(_) => o.cross(i).normalize(),
            };
            let m = matrix(&s, o, i, 0);
            let m = M::from_fn(|r, c| m[r][c]);
            Some(turn(o.as_dvec3(), n.as_dvec3(), xo) * m * turn(-i.as_dvec3(), xi, n.as_dvec3()))
        };
        reciprocal(name, value, pair, 1e-4);
    }
}

/// Tests that tables agree with the theory to 10⁻⁵ of S11 at the same angle. The tables range from dipoles to
/// forward peaks half a degree wide. Exceptions are counted, because large transparent spheres of one size
/// have deeper minima between their fringes.
#[test]
fn tables_match_the_theory() {
    for (radius, n, k, bound) in [
        (1e-9, 1.59, 0.0, 2.0),
        (1e-7, 1.59, 0.0, 2.0),
        (1e-6, 1.59, 0.0, 2.0),
        (5e-6, 1.45, 0.01, 5.0),
        (27e-6, 1.59, 0.0, 30.0),
    ] {
        let mut ensembles = spheres(&SizeDistribution::Single { radius }, [n, k]);
        ensembles.truncate(1);
        let mut scratch = vec![];
        let media = media(PhaseOptics::Particles(ensembles.clone()));
        let mut worst = 0.0_f64;
        let mut stream = Stream::new(81, 0, 0);
        for _ in 0..3000 {
            // The number of angles near the ends equals the number of angles between the ends.
            let s = f64::from(stream.uniform());
            let theta = PI * s * s * (3.0 - 2.0 * s);
            let angle = sunstone::transport::medium::scattered::Angle {
                forward: (2.0 * (theta / 2.0).sin().powi(2)) as f32,
                backward: (2.0 * (theta / 2.0).cos().powi(2)) as f32,
            };
            let small = f64::from(angle.forward.min(angle.backward));
            let cos = if angle.forward < angle.backward { 1.0 - small } else { small - 1.0 };
            let want = ensembles[0].matrix(cos, &mut scratch);
            let f = media.tables[0].block(angle);
            for (got, want_e) in [f.a, f.b, f.c, f.d].into_iter().zip(want) {
                worst = worst.max((f64::from(got.to_array()[0]) - want_e).abs() / want[0]);
            }
        }
        let cells = media.tables[0].cells();
        assert!(worst < bound * TOLERANCE, "{radius} m: {worst:.2e} with {cells} cells");
    }
}

/// Tests the bulk properties N = f/V and μ_s = N C_sca. Amounts by volume, number and mass agree. The
/// properties of mixtures add up, and a list of sizes is a mixture.
#[test]
fn bulk_properties_add_up() {
    let (radius, f) = (3e-7, 0.02);
    let sizes = SizeDistribution::Single { radius };
    let volume = 4.0 / 3.0 * PI * radius.powi(3);
    let kind =
        |sizes: &SizeDistribution, amount| Kind { sizes: sizes.clone(), index: vec![[1.5, 1e-3]], amount };
    let of = |kinds: &[Kind]| Optics::particles(&[500.0], &[1.33], &[0.7], kinds).expect("admitted").bulk[0];
    let one = of(&[kind(&sizes, Amount::VolumeFraction(f))]);
    let close = |a: f64, b: f64, what: &str| assert!((a / b - 1.0).abs() < 1e-12, "{what}: {a} {b}");
    close(one.scattering, one.c_sca * f / volume, "scattering");
    close(one.absorption, 0.7 + one.c_abs * f / volume, "absorption");
    for amount in
        [Amount::NumberDensity(f / volume), Amount::Mass { concentration: f * 1050.0, density: 1050.0 }]
    {
        close(of(&[kind(&sizes, amount)]).scattering, one.scattering, "amount");
    }
    let other = SizeDistribution::Single { radius: 1e-7 };
    let alone = of(&[kind(&other, Amount::NumberDensity(1e18))]);
    let both = of(&[kind(&sizes, Amount::VolumeFraction(f)), kind(&other, Amount::NumberDensity(1e18))]);
    close(both.scattering, one.scattering + alone.scattering, "mixture");
    let g = (one.scattering * one.asymmetry + alone.scattering * alone.asymmetry) / both.scattering;
    close(both.asymmetry, g, "mean cosine of a mixture");
    let listed = SizeDistribution::List(vec![[radius, 1.0], [1e-7, 3.0]]);
    let listed = of(&[kind(&listed, Amount::NumberDensity(4e15))]);
    let apart = of(&[kind(&sizes, Amount::NumberDensity(1e15)), kind(&other, Amount::NumberDensity(3e15))]);
    close(listed.scattering, apart.scattering, "a list");
    for bad in [
        Amount::VolumeFraction(1.1),
        Amount::VolumeFraction(-0.1),
        Amount::NumberDensity(f64::NAN),
        Amount::Mass { concentration: 1.0, density: 0.0 },
    ] {
        assert!(bad.number_density(&sizes).is_err(), "{bad:?}");
    }
}

/// Compares milk with the measurements of whole and skimmed milk by Jensen et al. (2001). In red, green and
/// blue, reduced scattering is 2.55, 3.21 and 3.77 per mm for whole milk, and 0.70, 1.22 and 1.90 per mm for
/// skimmed milk. Absorption increases tenfold from red to blue.
#[test]
fn milk_matches_measurements() {
    let milk = |fat_percent, concentration| {
        let milk = Milk { fat_percent, protein_percent: 3.4, homogenization_mpa: 20.0, concentration };
        milk.optics(&Wavelengths::new(vec![450.0, 550.0, 650.0]).expect("three")).expect("milk").bulk
    };
    let reduced = |b: &Bulk| b.scattering * (1.0 - b.asymmetry) / 1000.0;
    for (fat, measured, most) in [(3.5, [3.77, 3.21, 2.55], 1.7), (0.1, [1.90, 1.22, 0.70], 1.3)] {
        let bulk = milk(fat, 1.0);
        for (b, want) in bulk.iter().zip(measured) {
            let ratio = reduced(b) / want;
            assert!(ratio < most && ratio > 1.0 / most, "{fat} % fat: {ratio} of {want}");
        }
        assert!(bulk[0].absorption > 4.0 * bulk[1].absorption, "yellowish");
        assert!(reduced(&bulk[0]) > reduced(&bulk[1]) && reduced(&bulk[1]) > reduced(&bulk[2]), "bluish");
    }
    assert!(milk(3.5, 1.0)[1].asymmetry > 0.85 && milk(0.1, 1.0)[1].asymmetry < 0.35);
    // Dilution scales the number of scatterers and does not change the water.
    let (whole, thin) = (milk(1.5, 1.0), milk(1.5, 0.01));
    for (w, t) in whole.iter().zip(&thin) {
        assert!((t.scattering * 100.0 / w.scattering - 1.0).abs() < 1e-9);
        assert!((t.asymmetry - w.asymmetry).abs() < 1e-9 && t.absorption < w.absorption);
    }
}

#[test]
fn presets_match_their_papers() {
    let w = Wavelengths::new(vec![450.0, 550.0, 650.0]).expect("three");
    let marble = MARBLE.optics(0.0, &w).bulk;
    let skin = SKIN.optics(0.8, &w).bulk;
    for (b, [scattering, absorption]) in marble.iter().zip([[3000.0, 7.1], [2620.0, 4.1], [2190.0, 2.1]]) {
        assert!((b.scattering - scattering).abs() < 1e-9 && (b.absorption - absorption).abs() < 1e-9);
    }
    for (b, [reduced, absorption]) in skin.iter().zip([[1010.0, 480.0], [880.0, 170.0], [740.0, 32.0]]) {
        assert!((b.scattering * 0.2 - reduced).abs() < 1e-9 && (b.absorption - absorption).abs() < 1e-9);
    }
    // The value is that of Ma et al. 2003 at the wavelength of the helium–neon laser.
    assert!((polystyrene_index(632.8) - 1.582_43).abs() < 1e-5);
    let sizes = SizeDistribution::Single { radius: 2.5e-7 };
    let beads = polystyrene(sizes, Amount::VolumeFraction(0.01), &w).expect("beads").bulk;
    assert!(beads[1].scattering > 1e4 && (beads[1].absorption - 0.0565).abs() < 1e-9);
}
