//! Tests rough metal, rough glass and plastic without a scene. The tests cover samplers, weights,
//! reciprocity, realizability, energy, and limits with closed forms.

use crate::materials::{
    bsdf, elements, follow_density, is_reciprocal, pair_in_front, surface, table, toward, weights_agree,
};
use crate::optics::{C, Device, M, assert_close, head, mueller, plate, project, turn};
use crate::support::render_text;
use glam::{DVec3, Vec3A};
use std::f32::consts::FRAC_PI_6;
use std::f64::consts::{PI, TAU};
use sunstone::optics::sampling::microfacet::Distribution::{Beckmann, Ggx};
use sunstone::optics::sampling::microfacet::Masking::{Correlated, Separable};
use sunstone::optics::sampling::microfacet::{Distribution, Masking};
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::spectrum::Spectral;
use sunstone::polarimetry::decompose::cloude;
use sunstone::tensor::axes::AxisKind::T;
use sunstone::transport::material::coat::{self, Passage};
use sunstone::transport::material::dielectric::Dielectric;
use sunstone::transport::material::facets::Roughness;
use sunstone::transport::material::plastic::{Interreflection, Plastic, SingleScatter};
use sunstone::transport::material::rough_conductor::RoughConductor;
use sunstone::transport::material::rough_dielectric::RoughDielectric;
use sunstone::transport::material::texture::{Scalar, Spectrum};
use sunstone::transport::material::{Lanes, Lobe, Material, Materials};

const IOR: f32 = 1.5;

fn roughness(distribution: Distribution, masking: Masking, alpha: f32) -> Roughness {
    Roughness { distribution, masking, alpha: Scalar::uniform(alpha) }
}

fn metal(roughness: Roughness) -> Materials {
    table(Material::RoughConductor(RoughConductor {
        n: Spectral::new([0.4242, 1.5, 0.2, 2.0]),
        k: Spectral::new([2.4721, 1.9, 3.1, 0.5]),
        reflectance: Spectrum::uniform(Spectral::ONE),
        roughness,
    }))
}

fn interface(interior: Spectral) -> Dielectric {
    let lanes = interior.to_array();
    Dielectric { interior, exterior: Spectral::ONE, dispersive: lanes.iter().any(|n| *n != lanes[0]) }
}

fn glass(interior: Spectral, roughness: Roughness) -> Materials {
    table(Material::RoughDielectric(RoughDielectric {
        interface: interface(interior),
        roughness,
        lanes: Lanes::first(4),
    }))
}

/// Returns plastic with all options or without options.
fn plastic(roughness: Roughness, options: bool) -> Materials {
    let eta = Spectral::new([1.5, 1.52, 1.6, 1.4]);
    let mut materials = Materials::default();
    let passage = options.then(|| coat::Table::new(&mut materials.textures, &roughness, eta, false));
    let inside = coat::internal_reflectance(&roughness, eta, Passage::Facets);
    materials.list.push(Material::Plastic(Plastic {
        albedo: Spectrum::uniform(Spectral::new([0.9, 0.5, 0.2, 0.02])),
        eta,
        roughness,
        specular: Spectral::ONE,
        interreflection: if options { Interreflection::Coloured(inside) } else { Interreflection::Lost },
        passage,
        single_scatter: options.then(|| SingleScatter {
            albedo: Spectrum::uniform(Spectral::new([0.1, 0.2, 0.3, 0.4])),
            alpha: Scalar::uniform(0.5),
        }),
    }));
    materials
}

/// Returns a direction from outside (cos > 0) or from inside.
fn seen_from(cos: f32, phi: f32) -> Vec3A {
    if cos > 0.0 { toward(cos, phi) } else { -toward(-cos, phi) }
}

/// Returns every material and every cosine of `wo` that the tests in this file cover.
fn cases() -> Vec<(String, Materials, f32)> {
    let mut list = vec![];
    for distribution in [Ggx, Beckmann] {
        for (masking, alpha) in [(Correlated, 0.12_f32), (Separable, 0.6)] {
            let r = roughness(distribution, masking, alpha);
            let mut add = |name: &str, materials: Materials, cos: f32| {
                list.push((format!("{name} {distribution:?} {alpha}, cos {cos}"), materials, cos));
            };
            for cos in [1.0, 0.5, 0.1] {
                add("metal", metal(r), cos);
                add("plastic", plastic(r, cos == 0.5), cos);
                add("glass", glass(Spectral::splat(IOR), r), cos);
                add("glass", glass(Spectral::splat(IOR), r), -cos);
            }
        }
        let r = roughness(distribution, Correlated, 0.3);
        let flint = Spectral::new([1.5, 1.6, 1.8, 2.0]);
        list.push((format!("flint {distribution:?}"), glass(flint, r), 0.6));
        list.push((format!("flint {distribution:?} inside"), glass(flint, r), -0.8));
    }
    list
}

#[test]
#[ignore = "slow: tools/check --all"]
fn samples_follow_their_density() {
    for (case, (name, materials, cos)) in cases().into_iter().enumerate() {
        follow_density(&name, &materials, seen_from(cos, 1.4), case as u32, 12);
    }
}

#[test]
fn weights_are_values_over_densities() {
    for (case, (name, materials, cos)) in cases().into_iter().enumerate() {
        // A dispersive refraction continues with one wavelength, so the weight is not a ratio of value and
        // density.
        if name.starts_with("flint") {
            continue;
        }
        let compared = weights_agree(&name, &materials, seen_from(cos, -1.0), case as u32, 5e-4);
        assert!(compared > 1000, "{name}: only {compared} samples");
    }
}

/// Tests dispersive glass for any two directions. Each wavelength must have the value of glass with the index
/// at that wavelength.
#[test]
fn each_wavelength_has_its_own_facet() {
    let flint = [1.5, 1.6, 1.8, 2.0];
    let r = roughness(Beckmann, Correlated, 0.4);
    let all = glass(Spectral::new(flint), r);
    let mut stream = Stream::new(7, 0, 0);
    let mut differ = 0;
    for _ in 0..500 {
        let [u, v, w] = std::array::from_fn(|_| stream.uniform());
        let (wo, wi) = (toward(0.1 + 0.9 * u, 0.0), -toward(0.1 + 0.9 * v, w * TAU as f32));
        for (o, i) in [(wo, wi), (wi, wo)] {
            let Some(together) = all.eval(0, &surface(), o, i) else {
                continue;
            };
            let together = elements(&together, o, i);
            for (lane, n) in flint.into_iter().enumerate() {
                let alone = glass(Spectral::splat(n), r).eval(0, &surface(), o, i);
                let want = alone.map_or([0.0; 16], |s| elements(&s, o, i)[lane]);
                for (a, b) in together[lane].iter().zip(want) {
                    assert!((a - b).abs() <= 1e-5 * want[0], "lane {lane}: {a} is not {b}");
                }
            }
            differ += u32::from(together[0][0] != together[3][0]);
        }
    }
    assert!(differ > 200, "{differ}");
}

#[test]
fn materials_are_reciprocal() {
    for distribution in [Ggx, Beckmann] {
        for masking in [Correlated, Separable] {
            let r = roughness(distribution, masking, 0.4);
            let name = format!("{distribution:?} {masking:?}");
            for m in [metal(r), plastic(r, false), plastic(r, true)] {
                assert_eq!(is_reciprocal(&name, &m, |_| 1.0, pair_in_front, 2e-4), 700);
            }
            let g = glass(Spectral::splat(IOR), r);
            let index = |w: Vec3A| {
                if surface().ng.dot(w) > 0.0 { 1.0 } else { f64::from(IOR) }
            };
            assert_eq!(is_reciprocal(&name, &g, index, pair_in_front, 2e-4), 700);
            let inside = |s: &mut Stream| pair_in_front(s).map(|w| -w);
            assert_eq!(is_reciprocal(&name, &g, index, inside, 2e-4), 700);
            let through = |s: &mut Stream| {
                let [a, b] = pair_in_front(s);
                [a, -b]
            };
            let pairs = is_reciprocal(&name, &g, index, through, 2e-4);
            assert!(pairs > 100, "{name}: {pairs} pairs see each other");
        }
    }
}

/// Tests that Cloude's coherency matrix has no negative eigenvalue, for any pair of directions.
#[test]
fn matrices_are_realizable() {
    let r = roughness(Ggx, Correlated, 0.3);
    let flint = Spectral::new([1.5, 1.6, 1.8, 2.0]);
    let cosines = [0.02, 0.2, 0.45, 0.7, 0.9, 0.999];
    let mut checked = 0;
    for m in [metal(r), plastic(r, false), plastic(r, true), glass(flint, r)] {
        for co in cosines {
            for wo in [toward(co, 0.3), -toward(co, 0.3)] {
                for ci in cosines {
                    for k in 0..12 {
                        let up = toward(ci, 0.3 + k as f32 * FRAC_PI_6);
                        for wi in [up, -up] {
                            let Some(s) = m.eval(0, &surface(), wo, wi) else {
                                continue;
                            };
                            for e in elements(&s, wo, wi) {
                                if e[0] == 0.0 {
                                    continue;
                                }
                                let matrix =
                                    std::array::from_fn(|i| std::array::from_fn(|j| f64::from(e[4 * i + j])));
                                let least = cloude::eigenvalues(&matrix).expect("finite")[3];
                                assert!(least >= -1e-5 * matrix[0][0], "{wo} {wi}: {least}\n{matrix:?}");
                                checked += 1;
                            }
                        }
                    }
                }
            }
        }
    }
    assert!(checked > 14_000, "{checked}");
}

/// Returns the error function erf(x), computed from its series.
fn erf(x: f64) -> f64 {
    let (mut term, mut sum) = (x, x);
    for n in 1..100 {
        term *= -x * x / f64::from(n);
        sum += term / f64::from(2 * n + 1);
    }
    sum * 2.0 / PI.sqrt()
}

fn g1(distribution: Distribution, cos: f64, alpha: f64) -> f64 {
    let tan = (1.0 - cos * cos).max(0.0).sqrt() / cos.abs();
    if distribution == Ggx {
        return 2.0 / (1.0 + (1.0 + (alpha * tan).powi(2)).sqrt());
    }
    let a = 1.0 / (alpha * tan).max(1e-9);
    if a > 4.5 {
        return 1.0;
    }
    1.0 / (1.0 + (erf(a) - 1.0) / 2.0 + (-a * a).exp() / (2.0 * a * PI.sqrt()))
}

/// Returns Fresnel's power reflectance.
fn reflectance(cos: f64, eta: f64) -> f64 {
    let root = eta * eta - 1.0 + cos * cos;
    if root <= 0.0 {
        return 1.0;
    }
    let (s, p) = (
        (cos - root.sqrt()) / (cos + root.sqrt()),
        (eta * eta * cos - root.sqrt()) / (eta * eta * cos + root.sqrt()),
    );
    (s * s + p * p) / 2.0
}

/// Returns the power that facets with separable masking reflect and transmit, E[F·G1(wi)] over the visible
/// facets. The function uses a midpoint rule over facet slopes. For facets without transmission, `through` is
/// false.
fn albedo(distribution: Distribution, cos: f64, alpha: f64, eta: f64) -> [f64; 2] {
    const U: u32 = 250;
    const PHI: u32 = 100;
    let wo = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let mut sum = [0.0; 2];
    for k in 0..U * PHI {
        // With this variable t, D cosθ_h dω_h = 2t dt dφ / 2π. The squares of t shift points into the tails.
        let t = (f64::from(k / PHI) + 0.5) / f64::from(U);
        let left = 1.0 - (1.0 - t).powi(2);
        let (u, stretch) = (left, 2.0 * (1.0 - t));
        let tan2 = alpha
            * alpha
            * match distribution {
                Ggx => u / (1.0 - u),
                Beckmann => -(1.0 - u).ln(),
            };
        let phi = PI * (f64::from(k % PHI) + 0.5) / f64::from(PHI);
        let cos_h = 1.0 / (1.0 + tan2).sqrt();
        let sin_h = (1.0 - cos_h * cos_h).sqrt();
        let h = DVec3::new(sin_h * phi.cos(), sin_h * phi.sin(), cos_h);
        let oh = wo.dot(h);
        if oh <= 0.0 {
            continue;
        }
        let visible = g1(distribution, cos, alpha) * oh / (cos * cos_h) * stretch / f64::from(U * PHI);
        let f = reflectance(oh, eta);
        let up = h * (2.0 * oh) - wo;
        if up.z > 0.0 {
            sum[0] += visible * f * g1(distribution, up.z, alpha);
        }
        if f < 1.0 {
            let down = h * (oh / eta - (1.0 - (1.0 - oh * oh) / (eta * eta)).sqrt()) - wo / eta;
            if down.z < 0.0 {
                sum[1] += visible * (1.0 - f) * g1(distribution, down.z, alpha);
            }
        }
    }
    sum
}

/// Tests each lobe in a white furnace, from outside and inside. Mean sampled weights must equal the
/// directional albedos, per wavelength if the index is dispersive. Returned light never exceeds incident
/// light.
#[test]
fn rough_glass_returns_its_directional_albedo() {
    const N: u32 = 50_000;
    let flint = [1.3, 1.5, 1.8, 2.2];
    for distribution in [Ggx, Beckmann] {
        for (cos, alpha) in [(0.9_f32, 0.2_f32), (0.4, 0.5), (-0.85, 0.2), (-0.4, 0.5)] {
            let m = glass(Spectral::new(flint), roughness(distribution, Separable, alpha));
            let wo = seen_from(cos, 0.7);
            let mut stream = Stream::new(9, 0, 0);
            // Collects the sum and the sum of squares by lobe and wavelength.
            let mut sums = [[[0.0_f64; 2]; 4]; 2];
            for _ in 0..N {
                let mut lanes = Lanes::first(4);
                let Some(s) = m.sample(0, &surface(), wo, &mut lanes, &mut stream) else {
                    continue;
                };
                let through = surface().ng.dot(s.wi) * cos < 0.0;
                assert_eq!(s.filling.is_some(), through);
                for (lane, w) in s.scatter.m00().to_array().into_iter().enumerate() {
                    let [a, b] = &mut sums[usize::from(through)][lane];
                    *a += f64::from(w);
                    *b += f64::from(w).powi(2);
                }
            }
            for (lane, n) in flint.into_iter().enumerate() {
                let n = f64::from(n);
                let eta = if cos > 0.0 { n } else { 1.0 / n };
                let want = albedo(distribution, f64::from(cos.abs()), f64::from(alpha), eta);
                assert!(want[0] + want[1] <= 1.0);
                for (lobe, want) in want.into_iter().enumerate() {
                    let [a, b] = sums[lobe][lane].map(|s| s / f64::from(N));
                    let sigma = ((b - a * a) / f64::from(N)).sqrt();
                    // Transmission scales radiance, but not power, by 1/η².
                    let scale = [1.0, eta * eta][lobe];
                    assert!(
                        (a * scale - want).abs() < 5.0 * sigma * scale + 1e-4,
                        "{distribution:?} {alpha}, cos {cos}, n {n}, lobe {lobe}: {} is not {want} ± {}",
                        a * scale,
                        sigma * scale
                    );
                    assert!(sigma * scale < 0.015);
                }
            }
        }
    }
}

/// Tests that no material increases the power of unpolarized light. The test includes correlated masking.
#[test]
fn no_energy_is_created() {
    for (case, (name, m, cos)) in cases().into_iter().enumerate() {
        const N: u32 = 20_000;
        let wo = seen_from(cos, 0.2);
        let mut stream = Stream::new(10, case as u32, 0);
        let (mut sum, mut squares) = ([0.0_f64; 4], [0.0_f64; 4]);
        for _ in 0..N {
            let mut lanes = Lanes::first(4);
            let Some(s) = m.sample(0, &surface(), wo, &mut lanes, &mut stream) else {
                continue;
            };
            let eta2 = match &m.list[0] {
                Material::RoughDielectric(g) if s.filling.is_some() => {
                    let n2 = g.interface.interior * g.interface.interior;
                    if cos > 0.0 { n2 } else { Spectral::ONE / n2 }
                }
                _ => Spectral::ONE,
            };
            for (lane, w) in (s.scatter.m00() * eta2).to_array().into_iter().enumerate() {
                sum[lane] += f64::from(w) / f64::from(N);
                squares[lane] += f64::from(w).powi(2) / f64::from(N);
            }
        }
        for (a, b) in sum.iter().zip(squares) {
            let sigma = ((b - a * a).max(0.0) / f64::from(N)).sqrt();
            assert!(*a <= 1.0 + 5.0 * sigma + 1e-5, "{name}: {a} ± {sigma}");
            assert!(*a > 0.03, "{name}: {a}");
        }
    }
}

/// Tests that, at α = 0.001, the mean of each lobe equals that of the smooth interface, in all 16 elements
/// and from each side.
#[test]
fn the_smooth_limit_is_the_smooth_interface() {
    const N: u32 = 20_000;
    let smooth = table(Material::Dielectric(interface(Spectral::splat(IOR))));
    for distribution in [Ggx, Beckmann] {
        let m = glass(Spectral::splat(IOR), roughness(distribution, Correlated, 1e-3));
        for cos in [0.95_f32, 0.4, -0.9, -0.2] {
            let wo = seen_from(cos, 0.7);
            let mut stream = Stream::new(11, 0, 0);
            let (mut sums, mut counts) = ([[0.0_f64; 16]; 2], [0_u32; 2]);
            for _ in 0..N {
                let s = m.sample(0, &surface(), wo, &mut Lanes::first(4), &mut stream);
                let s = s.expect("nothing is lost");
                let lobe = usize::from(s.filling.is_some());
                counts[lobe] += 1;
                let e = elements(&s.scatter, wo, s.wi)[0];
                sums[lobe].iter_mut().zip(e).for_each(|(s, e)| *s += f64::from(e));
            }
            for (lobe, sums) in [Lobe::Reflected, Lobe::Transmitted].into_iter().zip(sums) {
                let Some(want) = smooth.specular(0, &surface(), wo, lobe, 0) else {
                    continue;
                };
                let n = f64::from(counts[lobe as usize]);
                let want = elements(&want.scatter, wo, want.wi)[0].map(f64::from);
                // The number of samples of a lobe has a binomial distribution. Within a lobe, weights are
                // nearly constant.
                let share = n / f64::from(N);
                let spread = ((1.0 - share) / n).sqrt();
                let off = sums[0] / f64::from(N) / want[0] - 1.0;
                assert!(off.abs() < 5.0 * spread + 1e-3, "cos {cos}, {lobe:?}: M00 off by {off}");
                for (got, want) in sums.iter().zip(want.map(|w| w / want[0])) {
                    let got = got / sums[0];
                    assert!((got - want).abs() < 1e-3, "cos {cos}, {lobe:?}: {got} is not {want}");
                }
            }
        }
    }
}

/// Returns the Fresnel refraction of power from `d_in` to `d_out` by the facet between these directions. Each
/// direction has its own frame.
fn refraction(d_in: DVec3, x_in: DVec3, d_out: DVec3, x_out: DVec3, cos: f64, eta: f64) -> M {
    let root = (eta * eta - 1.0 + cos * cos).sqrt();
    let (s, p) = (2.0 * cos / (cos + root), 2.0 * eta * cos / (eta * eta * cos + root));
    let power = root / cos;
    let (a, b) = ((s * s + p * p) / 2.0 * power, (s * s - p * p) / 2.0 * power);
    let c = s * p * power;
    let block = M::new(a, b, 0., 0., b, a, 0., 0., 0., 0., c, 0., 0., 0., 0., c);
    let axis = d_in.cross(d_out).normalize();
    turn(d_out, axis, x_out) * block * turn(d_in, x_in, axis)
}

/// Tests light of a projector inside rough glass that is seen from outside, and vice versa. Compares the
/// light with Walter's closed form, and tests the travel time.
#[test]
fn a_projector_shines_through_rough_glass() {
    let (alpha, n) = (0.4, f64::from(IOR));
    for inside in [true, false] {
        let flip = if inside { 1.0 } else { -1.0 };
        let camera = Device::ray([0.5, 0.3, 0.8 * flip], DVec3::ZERO);
        let projector = Device::look_at([-0.3, 0.2, -0.7 * flip], DVec3::ZERO, [3, 3], 20.0);
        let wo = camera.origin.normalize();
        let wi = projector.origin.normalize();
        let eta = if inside { n } else { 1.0 / n };
        let normal = DVec3::Z * flip;
        let v = wo + wi * eta;
        let h = v.normalize() * v.dot(normal).signum();
        let (ch, cn) = (h.dot(normal), wo.dot(normal));
        let d = (-(1.0 - ch * ch) / (alpha * alpha * ch * ch)).exp() / (PI * alpha * alpha * ch.powi(4));
        let g = g1(Beckmann, cn, alpha) * g1(Beckmann, wi.dot(normal), alpha);
        let factor = d * g * wo.dot(h) * wi.dot(h).abs() / (cn * v.length_squared());
        let (x_out, x_in) = (project(camera.right, wo), project(projector.right, wi));
        let want =
            refraction(-wi, x_in, wo, x_out, wo.dot(h), eta) * factor * projector.project(DVec3::ZERO).1;
        let text = head(4, 2, 6)
            + &camera.keys("camera")
            + &projector.keys("projector")
            + "[materials.m.rough_dielectric]\nior = 1.5\nalpha = 0.4\ndistribution = \"beckmann\"\n\
               masking = \"separable\"\n"
            + &plate(DVec3::ZERO, DVec3::Z, 2.0, "m")
            + "[[slices]]\nname = \"m\"\npolarization = \"mueller\"\n\
               [[slices]]\nname = \"t\"\ntime = { bin_ps = 1, bins = 12000 }\n";
        let r = render_text(&text);
        assert_close(&mueller(&r.mean("m"), &[]), &want, 2e-5, "through");
        let path = camera.origin.length() + projector.origin.length() * if inside { n } else { 1.0 };
        let time = r.mean("t");
        let bin = (path / C) as usize;
        assert!(time.at(&[(T, bin)]) > 0.0, "nothing after {} ps", path / C);
    }
}

/// Tests a white base under a smooth surface with interreflection. The reflections of base and surface
/// together must return all light. The model of Baek et al. is the product of two transmittances.
#[test]
fn interreflection_conserves_energy() {
    let eta = Spectral::new([1.5, 1.33, 2.0, 1.05]);
    for (lane, eta) in eta.to_array().into_iter().enumerate() {
        let white = |interreflection| Plastic {
            albedo: Spectrum::uniform(Spectral::ONE),
            eta: Spectral::splat(eta),
            roughness: roughness(Ggx, Correlated, 0.1),
            specular: Spectral::ZERO,
            interreflection,
            passage: None,
            single_scatter: None,
        };
        let inner = coat::smooth_internal_reflectance(Spectral::splat(eta));
        let [closed, linear, open] =
            [Interreflection::Coloured(inner), Interreflection::Linear(inner), Interreflection::Lost]
                .map(|i| table(Material::Plastic(white(i))));
        for cos in [1.0_f32, 0.5, 0.1] {
            let wo = toward(cos, 0.0);
            let through = 1.0 - reflectance(f64::from(cos), f64::from(eta));
            const STEPS: u32 = 2000;
            let mut sum = 0.0;
            for k in 0..STEPS {
                let c = (k as f32 + 0.5) / STEPS as f32;
                let wi = toward(c, 0.0);
                let value =
                    |m: &Materials| f64::from(m.eval(0, &surface(), wo, wi).unwrap().m00().to_array()[lane]);
                sum += value(&closed) * TAU / f64::from(STEPS);
                // The value of a white base is the same in the closed and the linear mode.
                assert_eq!(value(&closed), value(&linear));
                let want = through * (1.0 - reflectance(f64::from(c), f64::from(eta))) * f64::from(c) / PI;
                assert!((value(&open) - want).abs() < 1e-5, "{} is not {want}", value(&open));
            }
            assert!((sum - through).abs() < 1e-4, "eta {eta}, cos {cos}: {sum} is not {through}");
        }
    }
}

/// Tests facets above a white base in a white furnace. The material must return all light, at any roughness
/// and angle. With transmittances of the smooth mean surface instead, rough coats would lose or gain up to a
/// third of the light.
#[test]
fn a_white_base_below_facets_returns_all_light() {
    const STEPS: u32 = 400;
    let eta = Spectral::splat(1.5);
    for alpha in [0.2_f32, 0.5, 1.0] {
        let r = roughness(Ggx, Correlated, alpha);
        let mut materials = Materials::default();
        let passage = Some(coat::Table::new(&mut materials.textures, &r, eta, false));
        let inside = coat::internal_reflectance(&r, eta, Passage::Facets);
        let white = Plastic {
            albedo: Spectrum::uniform(Spectral::ONE),
            eta,
            roughness: r,
            specular: Spectral::ONE,
            interreflection: Interreflection::Linear(inside),
            passage,
            single_scatter: None,
        };
        materials.list = vec![
            Material::Plastic(white),
            Material::Plastic(Plastic {
                passage: None,
                interreflection: Interreflection::Linear(coat::smooth_internal_reflectance(eta)),
                ..white
            }),
        ];
        for (cos, smooth_is_off) in [(0.95_f32, false), (0.5, false), (0.15, true)] {
            let wo = toward(cos, 0.0);
            let mut sum = [0.0; 2];
            for k in 0..STEPS * STEPS {
                let [c, phi] = [k % STEPS, k / STEPS].map(|i| (i as f32 + 0.5) / STEPS as f32);
                let wi = toward(c, phi * std::f32::consts::TAU);
                for (id, sum) in sum.iter_mut().enumerate() {
                    let value = materials.eval(id as u32, &surface(), wo, wi);
                    *sum += value.map_or(0.0, |v| f64::from(v.m00().to_array()[0])) * TAU
                        / f64::from(STEPS * STEPS);
                }
            }
            assert!((sum[0] - 1.0).abs() < 5e-3, "α {alpha}, cos {cos}: {}", sum[0]);
            assert!(!smooth_is_off || (sum[1] - 1.0).abs() > 0.05, "α {alpha}: {}", sum[1]);
        }
    }
}

/// Tests that the single-scattering lobe is a surface reflection with a separate width and colour.
#[test]
fn single_scattering_is_a_second_reflection() {
    let layer = |alpha: f32, specular: Spectral, single_scatter| {
        table(Material::Plastic(Plastic {
            albedo: Spectrum::uniform(Spectral::ZERO),
            eta: Spectral::splat(IOR),
            roughness: roughness(Ggx, Correlated, alpha),
            specular,
            interreflection: Interreflection::Lost,
            passage: None,
            single_scatter,
        }))
    };
    let colour = Spectral::new([0.1, 0.2, 0.3, 0.4]);
    let single = SingleScatter { albedo: Spectrum::uniform(colour), alpha: Scalar::uniform(0.6) };
    let both = layer(0.2, Spectral::ONE, Some(single));
    let (narrow, wide) = (layer(0.2, Spectral::ONE, None), layer(0.6, colour, None));
    let mut stream = Stream::new(12, 0, 0);
    for _ in 0..200 {
        let [wo, wi] = pair_in_front(&mut stream);
        let e = |m: &Materials| elements(&m.eval(0, &surface(), wo, wi).expect("in front"), wo, wi);
        let (sum, a, b) = (e(&both), e(&narrow), e(&wide));
        for (lane, sum) in sum.iter().enumerate() {
            for (k, got) in sum.iter().enumerate() {
                let want = a[lane][k] + b[lane][k];
                assert!((got - want).abs() <= 1e-5 * sum[0], "{got} is not {want}");
            }
        }
    }
}

/// Tests that, away from the highlight, plastic's light is polarized in the plane of n and `wo`. In a frame
/// perpendicular to the plane of n and `wo`, s1 is negative. The polarization increases with the angle
/// between n and `wo`. Shape from polarization relies on the negative sign of s1.
#[test]
fn light_from_inside_is_polarized_across() {
    let m = plastic(roughness(Beckmann, Correlated, 0.05), false);
    let n = surface().ns.as_dvec3();
    let mut last = 0.0;
    for degrees in [20.0_f32, 45.0, 70.0, 80.0] {
        let wo = toward(degrees.to_radians().cos(), 0.0);
        let wi = toward(0.9, 1.5);
        let across = n.cross(wo.as_dvec3()).normalize();
        let f = bsdf(&m, wo, wi, [across, project(DVec3::X, wi.as_dvec3())]).unwrap();
        let degree = -f[(1, 0)] / f[(0, 0)];
        assert!(degree > last, "{degrees}°: {degree} after {last}");
        last = degree;
    }
    assert!(last > 0.2);
}
