//! Mueller matrices of a single material. The matrices describe the BRDF, and the specular reflection and
//! transmission of smooth surfaces.
//!
//! The surface normal is +z, and the tangent is +x. Directions point away from the surface. The incoming
//! direction points to the source of the light, and the outgoing direction to the destination. The horizontal
//! axis of a Stokes frame is (-sin φ, cos φ, 0). The horizontal axis is perpendicular to the plane of the
//! normal and the direction, so "s" is the first axis. The renderer's frames
//! ([`optics::polarization::scatter`]) are therefore rotated for each of the two directions. For
//! transmission, radiance is converted to power.

use glam::Vec3A;
use optics::polarization::mueller::Mueller;
use optics::spectrum::Spectral;
use scene::materials::MaterialSet;
use transport::geometry::ray::Surface;
use transport::material::{Lanes, Lobe, Materials};
use transport::scene::Scene;

/// A direction, given by the polar angle from the normal (+z) and the azimuth from the tangent (+x), in
/// degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// Polar angle from the normal, in degrees. The angle is above 90 for directions behind the surface.
    pub theta_deg: f64,
    /// Azimuth from the tangent, in degrees.
    pub phi_deg: f64,
}

impl Direction {
    /// Returns the direction of a vector of any length.
    pub fn of([x, y, z]: [f64; 3]) -> Self {
        Self { theta_deg: x.hypot(y).atan2(z).to_degrees(), phi_deg: y.atan2(x).to_degrees() }
    }

    /// Returns the unit vector of the direction.
    pub fn vector(self) -> [f64; 3] {
        let [theta, phi] = [self.theta_deg, self.phi_deg].map(f64::to_radians);
        [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
    }

    /// Returns the horizontal axis of the Stokes frame for the direction, (-sin φ, cos φ, 0). The formula
    /// also applies to the direction of the normal.
    pub fn frame(self) -> [f64; 3] {
        let phi = self.phi_deg.to_radians();
        [-phi.sin(), phi.cos(), 0.0]
    }

    /// Returns the vector and the frame in the single-precision types of the renderer.
    fn single(self) -> (Vec3A, Vec3A) {
        let [w, x] = [self.vector(), self.frame()].map(|v| v.map(|c| c as f32).into());
        (w, x)
    }

    /// Returns the direction of specular reflection at the surface.
    fn mirrored(self) -> Self {
        Self { phi_deg: self.phi_deg + 180.0, ..self }
    }

    /// Returns the direction of a vector on the opposite side of the normal, in the plane of incidence of
    /// `self`.
    fn across(self, w: Vec3A) -> Self {
        Self {
            theta_deg: f64::from(w.x.hypot(w.y)).atan2(f64::from(w.z)).to_degrees(),
            phi_deg: self.phi_deg + 180.0,
        }
    }
}

/// The error for a material without the requested specular lobe.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the material does not {} specularly at this point; evaluate the BRDF instead", match .0 { Lobe::Reflected => "reflect", Lobe::Transmitted => "transmit" })]
pub struct NotSpecular(pub Lobe);

/// The BRDF for a pair of directions, and the sampling density.
#[derive(Clone, Debug, PartialEq)]
pub struct BrdfValue {
    /// Mueller BRDF `[wavelength][out][in]` in 1/sr, without the cosine.
    pub mueller: Vec<[[f32; 4]; 4]>,
    /// Probability density in 1/sr. The renderer samples the incoming direction for the outgoing direction
    /// with this density.
    pub pdf: f32,
}

/// Reflection or transmission of a smooth surface at one wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpecularValue {
    /// Mueller matrix `[out][in]` for power. Radiance also changes by the squared ratio of the refractive
    /// indices.
    pub mueller: [[f32; 4]; 4],
    /// Outgoing direction. Under total reflection, the direction is `None` and the transmission matrix is
    /// zero.
    pub outgoing: Option<Direction>,
}

/// A material of a material set or of a scene, applied to a flat surface.
pub struct Specimen<'a> {
    materials: &'a Materials,
    /// Number of wavelengths.
    lanes: usize,
    id: u32,
    at: Surface,
}

impl<'a> Specimen<'a> {
    /// Creates a specimen of a material at texture coordinates `uv`. Returns `None` if the name is unknown.
    pub fn new(set: &'a MaterialSet, name: &str, uv: [f32; 2]) -> Option<Self> {
        let id = *set.names.get(name)?;
        Some(Self::of(&set.materials, set.wavelengths.count(), id, uv))
    }

    /// Creates a specimen of a scene's material at texture coordinates `uv`. Returns `None` if the name is
    /// unknown.
    pub fn in_scene(scene: &'a Scene, name: &str, uv: [f32; 2]) -> Option<Self> {
        let names = &scene.names;
        let place = names.materials.iter().position(|other| other == name)?;
        let id = names.material_of.iter().position(|of| *of as usize == place)?;
        Some(Self::of(&scene.materials, scene.wavelengths.count(), id as u32, uv))
    }

    fn of(materials: &'a Materials, lanes: usize, id: u32, uv: [f32; 2]) -> Self {
        let at = Surface {
            p: Vec3A::ZERO,
            ng: Vec3A::Z,
            ns: Vec3A::Z,
            tangent: Vec3A::X,
            bitangent: Vec3A::ZERO,
            uv,
            material: id,
            rounding: 0.0,
        };
        Self { materials, lanes, id, at }
    }

    /// Returns the BRDF for light from `incoming` to `outgoing`, or zero if the material scatters no light to
    /// `outgoing`.
    pub fn brdf(&self, incoming: Direction, outgoing: Direction) -> BrdfValue {
        let m = self.mueller(incoming, outgoing);
        let (wi, wo) = (incoming.single().0, outgoing.single().0);
        BrdfValue {
            mueller: (0..self.lanes).map(|lane| m.lane(lane)).collect(),
            pdf: self.materials.pdf(self.id, &self.at, wo, wi),
        }
    }

    /// Returns the matrices of [`Self::brdf`] without the density.
    pub fn mueller(&self, incoming: Direction, outgoing: Direction) -> Mueller {
        let ((wi, xi), (wo, xo)) = (incoming.single(), outgoing.single());
        self.materials
            .eval(self.id, &self.at, wo, wi)
            .map(|s| s.scaled(Spectral::splat(1.0 / wi.z.abs())).between(wo, xo, wi, xi))
            .unwrap_or_default()
    }

    /// Returns the specular reflection or transmission of light from `incoming`, per wavelength.
    ///
    /// Light paths are reversible, so the outgoing direction is computed by tracing light backwards.
    ///
    /// # Errors
    /// Returns [`NotSpecular`] if the material does not have this lobe at the specimen's texture coordinates.
    pub fn specular(&self, incoming: Direction, lobe: Lobe) -> Result<Vec<SpecularValue>, NotSpecular> {
        (0..self.lanes).map(|lane| self.specular_lane(incoming, lobe, lane)).collect()
    }

    fn specular_lane(
        &self,
        incoming: Direction,
        lobe: Lobe,
        lane: usize,
    ) -> Result<SpecularValue, NotSpecular> {
        let materials = self.materials;
        let (wi, xi) = incoming.single();
        // Under total reflection, the reversed direction is also `None`, and no light is transmitted.
        let back = materials.specular(self.id, &self.at, wi, lobe, lane);
        let total = back.is_none()
            && lobe == Lobe::Transmitted
            && materials.specular(self.id, &self.at, wi, Lobe::Reflected, lane).is_some();
        if total && materials.beyond(self.id, &self.at, wi, Lanes::first(1)).is_some() {
            return Ok(SpecularValue { mueller: Mueller::ZERO.lane(0), outgoing: None });
        }
        let wo = back.ok_or(NotSpecular(lobe))?.wi;
        let forth = materials.specular(self.id, &self.at, wo, lobe, lane).ok_or(NotSpecular(lobe))?;
        let outgoing = match lobe {
            Lobe::Reflected => incoming.mirrored(),
            Lobe::Transmitted => incoming.across(wo),
        };
        let power = forth.scatter.scaled(Spectral::splat(self.index_ratio2(wo, wi, lane)));
        let m = power.between(wo, outgoing.single().1, wi, xi);
        Ok(SpecularValue { mueller: m.lane(lane), outgoing: Some(outgoing) })
    }

    /// Returns (n_in / n_out)², which converts radiance to power for transmitted light.
    fn index_ratio2(&self, wo: Vec3A, wi: Vec3A, lane: usize) -> f32 {
        let lanes = Lanes { mask: 1 << lane };
        let beyond = |w: Vec3A| self.materials.beyond(self.id, &self.at, w, lanes);
        match (wo.z * wi.z < 0.0, beyond(wo), beyond(wi)) {
            (true, Some(on_wi), Some(on_wo)) => (on_wi.index / on_wo.index).powi(2),
            _ => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use optics::spectrum::Wavelengths;
    use std::path::Path;

    fn set(text: &str) -> MaterialSet {
        let nm = Wavelengths::new(vec![550.0]).expect("a wavelength");
        MaterialSet::at(Path::new("m.toml"), &format!("[materials]\n{text}"), nm).expect("materials")
    }

    fn at(theta_deg: f64, phi_deg: f64) -> Direction {
        Direction { theta_deg, phi_deg }
    }

    /// Verifies that glass of index 1.5 transmits the power that the glass does not reflect (Fresnel
    /// equations, 50°). The test covers light from either side.
    #[test]
    fn smooth_surfaces_keep_power() {
        let set = set("g.dielectric = { ior = 1.5 }");
        let glass = Specimen::new(&set, "g", [0.5, 0.5]).expect("is there");
        for theta in [0.0, 50.0, 150.0] {
            let of = |lobe| glass.specular(at(theta, 20.0), lobe).expect("is specular")[0];
            let (r, t) = (of(Lobe::Reflected), of(Lobe::Transmitted));
            let sum = r.mueller[0][0] + t.mueller[0][0];
            assert!((sum - 1.0).abs() < 1e-5, "{theta}: {sum}");
        }
        let t = glass.specular(at(50.0, 20.0), Lobe::Transmitted).expect("is specular")[0];
        let out = t.outgoing.expect("leaves");
        let sine = f64::sin(out.theta_deg.to_radians()) * 1.5;
        assert!((sine - f64::sin(50_f64.to_radians())).abs() < 1e-6 && out.phi_deg == 200.0);
        let total = glass.specular(at(120.0, 0.0), Lobe::Transmitted).expect("is specular")[0];
        assert_eq!((total.outgoing, total.mueller), (None, [[0.0; 4]; 4]));
    }

    /// Verifies that vectors of any length result in the correct angles. The zenith must have the azimuth 0.
    #[test]
    fn vectors_convert_to_directions() {
        for (theta, phi) in [(0.0, 0.0), (30.0, 170.0), (90.0, -60.0), (150.0, 45.0)] {
            let want = at(theta, phi);
            let got = Direction::of(want.vector().map(|c| 3.0 * c));
            assert!((got.theta_deg - theta).abs() < 1e-12 && (got.phi_deg - phi).abs() < 1e-12, "{got:?}");
        }
    }

    /// Verifies that a diffuse surface of albedo a has the BRDF a/π and no specular lobes.
    #[test]
    fn rough_surfaces_have_a_brdf() {
        let rough = set("r.rough_dielectric = { ior = 1.5, alpha = 0.3 }");
        let frosted = Specimen::new(&rough, "r", [0.5, 0.5]).expect("is there");
        assert_eq!(frosted.specular(at(40.0, 0.0), Lobe::Transmitted), Err(NotSpecular(Lobe::Transmitted)));
        let set = set("d.diffuse = { albedo = 0.5 }");
        assert!(Specimen::new(&set, "none", [0.0; 2]).is_none());
        let diffuse = Specimen::new(&set, "d", [0.5, 0.5]).expect("is there");
        let value = diffuse.brdf(at(40.0, 0.0), at(20.0, 120.0));
        let want = 0.5 * std::f32::consts::FRAC_1_PI;
        assert!((value.mueller[0][0][0] - want).abs() < 1e-6 && value.pdf > 0.0);
        assert_eq!(diffuse.specular(at(40.0, 0.0), Lobe::Reflected), Err(NotSpecular(Lobe::Reflected)));
    }
}
