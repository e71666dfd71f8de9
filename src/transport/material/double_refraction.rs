//! Crystals that split light into ordinary and extraordinary rays (double images).
//!
//! A plane wave inside the crystal is described by its index vector k (refractive index times unit normal).
//! With the optic axis c and
//!
//! > F(k) = α k² + β (k·c)²,  α = 1/n_e²,  β = 1/n_o² - 1/n_e²,
//!
//! extraordinary waves satisfy F(k) = 1, and ordinary waves satisfy k² = n_o² (Born & Wolf 1999, 15.2 and
//! 15.3.3). A face conserves the tangential part of k (Snell's law). The normal part of k solves a quadratic
//! equation. Light travels along the ray S ∝ ∇F ∝ αk + β(k·c)c, which deviates from k (walk-off). The optical
//! path per unit length is k·S. The electric vector of the ordinary ray is along S × c. The electric vector
//! of the extraordinary ray is perpendicular to S × c and to S.
//!
//! Entry into the crystal is modelled as a Fresnel face with the wave's own index |k|, followed by an ideal
//! polarizer along the wave's electric vector. The two rays are incoherent. This treatment is exact if the
//! crystal is much thicker than the coherence length, or if the beams are narrower than their separation.
//! Because the faces are approximate, the total transmitted power has a relative error of about (n_e -
//! n_o)²/2 (1 to 2 % for calcite). A projector inside a birefringent crystal is treated as a projector inside
//! glass.
//!
//! At a surface, the wave to which a path from inside belongs is unknown. One of the two waves is therefore
//! sampled, and the polarizers correct the result. For the wrong wave, the polarizers are crossed, and the
//! path contributes nothing.

use super::crystal::Crystal;
use super::filling::Filling;
use super::lanes::Lanes;
use super::lobe::{Lobe, Sampled, Specular};
use super::side::s_vector;
use crate::geometry::ray::Surface;
use glam::Vec3A;
use optics::polarization::elements::polarizer;
use optics::polarization::frame::{perpendicular, project, turn};
use optics::polarization::fresnel;
use optics::polarization::fresnel::FresnelBlock;
use optics::polarization::mueller::Mueller;
use optics::polarization::scatter::Scatter;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// A wave in the crystal, at one wavelength.
#[derive(Clone, Copy, Debug)]
struct Wave {
    /// Index vector k (refractive index times unit normal).
    k: Vec3A,
    /// Unit vector along the ray.
    ray: Vec3A,
    /// Electric vector: a unit vector perpendicular to the ray.
    electric: Vec3A,
}

/// Optical properties of the crystal at one wavelength.
#[derive(Clone, Copy)]
struct Optics {
    axis: Vec3A,
    n_o: f32,
    n_e: f32,
    outside: f32,
}

/// Returns a unit vector perpendicular to a ray and to the optic axis.
#[inline]
fn across(ray: Vec3A, axis: Vec3A) -> Vec3A {
    ray.cross(axis).try_normalize().unwrap_or_else(|| perpendicular(ray))
}

impl Optics {
    #[inline]
    fn ordinary(&self, ray: Vec3A) -> Wave {
        Wave { k: ray * self.n_o, ray, electric: across(ray, self.axis) }
    }

    #[inline]
    fn extraordinary(&self, k: Vec3A, ray: Vec3A) -> Wave {
        Wave { k, ray, electric: ray.cross(across(ray, self.axis)) }
    }

    /// Returns the two waves (ordinary first) with rays along `ray`.
    #[inline]
    fn along(&self, ray: Vec3A) -> [Wave; 2] {
        let c = self.axis;
        let (o2, e2) = (self.n_o * self.n_o, self.n_e * self.n_e);
        // The inverse of ∇F, scaled to F(k) = 1.
        let k = ray * e2 + c * ((o2 - e2) * ray.dot(c));
        let k = k / k.dot(ray).sqrt();
        [self.ordinary(ray), self.extraordinary(k, ray)]
    }

    /// Returns the two waves (ordinary first) that travel to the side of the unit normal `n` and have the
    /// tangential index vector `t`. Evanescent waves are `None`.
    #[inline]
    fn refracted(&self, t: Vec3A, n: Vec3A) -> [Option<Wave>; 2] {
        let c = self.axis;
        let o2 = self.n_o * self.n_o - t.length_squared();
        let ordinary = (o2 > 0.0).then(|| self.ordinary((t + n * o2.sqrt()).normalize()));
        let alpha = 1.0 / (self.n_e * self.n_e);
        let beta = 1.0 / (self.n_o * self.n_o) - alpha;
        let (tc, nc) = (t.dot(c), n.dot(c));
        // F(t + q n) = 1 is a q² + 2 b q + d = 0. Use the root whose ray is on the side of n.
        let (a, b) = (alpha + beta * nc * nc, beta * tc * nc);
        let d = alpha * t.length_squared() + beta * tc * tc - 1.0;
        let root2 = b * b - a * d;
        let extraordinary = (root2 > 0.0).then(|| {
            let k = t + n * ((root2.sqrt() - b) / a);
            let ray = (k * alpha + c * (beta * k.dot(c))).normalize();
            self.extraordinary(k, ray)
        });
        [ordinary, extraordinary]
    }
}

/// Returns a Fresnel block as a Mueller matrix between two frames. `out` is the frame of light along `d_out`,
/// and `inn` is the frame of light along `d_in`. The block's own frame vector is `s`, projected perpendicular
/// to each direction.
#[inline]
fn between(block: FresnelBlock, s: Vec3A, [d_out, out]: [Vec3A; 2], [d_in, inn]: [Vec3A; 2]) -> Mueller {
    let mut m = block.to_mueller();
    let (c2, s2) = turn(d_out, project(s, d_out), out);
    m.rotate_out(c2, s2);
    let (c2, s2) = turn(d_in, inn, project(s, d_in));
    m.rotate_in(c2, s2);
    m
}

impl Crystal {
    #[inline]
    fn optics(&self, lane: usize) -> Optics {
        Optics {
            axis: self.axis,
            n_o: self.n_o[lane] as f32,
            n_e: self.n_e[lane] as f32,
            outside: self.faces.exterior.to_array()[lane],
        }
    }

    /// Samples a direction for a crystal that splits light (see [`super::Materials::sample`]).
    pub(super) fn sample_split(
        &self,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        if at.ng.dot(wo) > 0.0 {
            self.sample_from_outside(at, wo, lanes, stream)
        } else {
            self.sample_from_inside(at, wo, *lanes, stream)
        }
    }

    fn sample_from_outside(
        &self,
        at: &Surface,
        wo: Vec3A,
        lanes: &mut Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        let mirror = self.faces.interface(at, wo)?.specular(at, Lobe::Reflected, 0);
        let reflectance = mirror.map_or(0.0, |m| lanes.mean(m.scatter.m00()));
        if stream.uniform() < reflectance {
            return mirror.map(|m| m.chosen(reflectance));
        }
        let (lane, weight) = self.faces.refracted_lane(lanes, stream);
        let lobes = self.entered(at, wo, lane, weight);
        choose(&lobes, 1.0 - reflectance, *lanes, stream)
    }

    /// Returns the lobes of light that leaves along `wo` on the outside of the crystal, one lobe per wave
    /// inside.
    fn entered(&self, at: &Surface, wo: Vec3A, lane: usize, weight: Spectral) -> [Option<Specular>; 2] {
        let (optics, n, s) = (self.optics(lane), at.ns, s_vector(at.ns, wo));
        let cos = n.dot(wo);
        // Tangential part of the index vectors, for propagation away from the camera.
        let t = (n * cos - wo) * optics.outside;
        optics.refracted(t, -n).map(|wave| {
            let wave = wave.filter(|w| at.ng.dot(w.ray) < 0.0)?;
            let eta = Spectral::splat(wave.k.length() / optics.outside);
            let block = fresnel::dielectric(cos, eta).transmission.scaled(Spectral::ONE / (eta * eta));
            let m = between(block, s, [wo, s], [-wave.ray, wave.electric]) * polarizer(0.0);
            Some(Specular {
                wi: wave.ray,
                scatter: Scatter::Full { mueller: m.scaled(weight), frame_out: s, frame_in: wave.electric },
                filling: Some(Filling::clear(wave.k.dot(wave.ray))),
            })
        })
    }

    /// Returns the lobe of light that crosses the face as one wave at one wavelength, for a crystal that
    /// splits light. `wave` is 0 for the ordinary wave and 1 for the extraordinary wave. If `wo` is inside,
    /// the light along `wo` must be this wave.
    pub fn passed(&self, at: &Surface, wo: Vec3A, lane: usize, wave: usize) -> Option<Specular> {
        if at.ng.dot(wo) > 0.0 {
            return self.entered(at, wo, lane, Spectral::ONE)[wave & 1];
        }
        self.left(at, wo, lane, wave & 1)?[0]
    }

    fn sample_from_inside(
        &self,
        at: &Surface,
        wo: Vec3A,
        lanes: Lanes,
        stream: &mut Stream,
    ) -> Option<Sampled> {
        let guess = usize::from(stream.uniform() < 0.5);
        let lobes = self.left(at, wo, lanes.nth(0), guess)?;
        choose(&lobes, 0.5, lanes, stream)
    }

    /// Returns the lobes of light that leaves along `wo` inside the crystal as one wave. The first lobe is
    /// for light from the outside, and the other two are for waves that the face reflects.
    fn left(&self, at: &Surface, wo: Vec3A, lane: usize, wave: usize) -> Option<[Option<Specular>; 3]> {
        let (optics, n) = (self.optics(lane), at.ns);
        let from = optics.along(-wo)[wave];
        let near = from.k.length();
        let normal = from.k.dot(n);
        if normal <= 0.0 {
            return None;
        }
        let t = from.k - n * normal;
        let eta = Spectral::splat(optics.outside / near);
        let fresnel = fresnel::dielectric((normal / near).min(1.0), eta);
        let s = s_vector(n, from.k / near);
        let out = [wo, from.electric];
        let polarized = polarizer(0.0);
        let sin2 = t.length_squared() / (optics.outside * optics.outside);
        let through = (sin2 < 1.0).then(|| {
            let wi = (t / optics.outside + n * (1.0 - sin2).sqrt()).normalize();
            let block = fresnel.transmission.scaled(Spectral::ONE / (eta * eta));
            let s = project(s, wi);
            Specular {
                wi,
                scatter: Scatter::Full {
                    mueller: polarized * between(block, s, out, [-wi, s]),
                    frame_out: from.electric,
                    frame_in: s,
                },
                filling: Some(Filling::clear(optics.outside)),
            }
        });
        let [o, e] = optics.refracted(t, -n).map(|wave| {
            let wave = wave?;
            let inn = [-wave.ray, wave.electric];
            Some(Specular {
                wi: wave.ray,
                scatter: Scatter::Full {
                    mueller: polarized * between(fresnel.reflection, s, out, inn) * polarized,
                    frame_out: from.electric,
                    frame_in: wave.electric,
                },
                filling: Some(Filling::clear(wave.k.dot(wave.ray))),
            })
        });
        let inward = |lobe: Option<Specular>| lobe.filter(|l| at.ng.dot(l.wi) < 0.0);
        let outward = |lobe: Option<Specular>| lobe.filter(|l| at.ng.dot(l.wi) > 0.0);
        Some([outward(through), inward(o), inward(e)])
    }
}

/// Samples one of several lobes by intensity. `chance` is the probability of all earlier choices.
fn choose(lobes: &[Option<Specular>], chance: f32, lanes: Lanes, stream: &mut Stream) -> Option<Sampled> {
    let share = |l: &Specular| lanes.mean(l.scatter.m00()).max(0.0);
    let total: f32 = lobes.iter().flatten().map(share).sum();
    let mut left = stream.uniform() * total;
    let mut last = None;
    for lobe in lobes.iter().flatten().filter(|l| share(l) > 0.0) {
        let p = share(lobe);
        last = Some((lobe, p));
        left -= p;
        if left < 0.0 {
            break;
        }
    }
    last.map(|(lobe, p)| lobe.chosen(chance * p / total))
}
