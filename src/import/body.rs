//! Computes the albedo of the body below a coat from another model's base colour. The body albedo gives the
//! two models the same directional albedo at normal incidence.
//!
//! Other models add diffuse reflection of albedo `base` to the coat's directional albedo E(θ), and
//! attenuate the diffuse reflection by an approximation. In Sunstone, the body receives the light that the
//! coat does not reflect. With a body albedo ρ, the directional albedo is E(θ) + ρ (1 - E(θ)). The factor ρ
//! / base makes both albedos equal for light that exits along the normal. `validation/import_albedo.py`
//! prints the remaining difference at other angles.

use glam::Vec3A;
use optics::sampling::microfacet::{Distribution, Masking, Microfacet};
use optics::spectrum::Spectral;
use transport::material::coat;

/// Number of samples per dimension of the integral over facet normals.
const DRAWN: u32 = 48;

/// Returns the directional albedo at normal incidence of a coat of GGX facets of roughness `alpha` and
/// relative index `eta`.
pub fn coat_albedo(eta: f64, alpha: f64, masking: Masking) -> f64 {
    let model = Microfacet { distribution: Distribution::Ggx, masking, alpha: alpha.max(0.001) as f32 };
    let eta = Spectral::splat(eta as f32);
    f64::from(coat::reflected(&model, eta, Vec3A::Z.z, DRAWN).to_array()[0])
}

/// Returns the integral of 2 cosθ f(cosθ) over cosθ from 0 to 1.
fn cosine_mean(f: impl Fn(f64) -> f64) -> f64 {
    const STEPS: u32 = 1000;
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(STEPS);
    (0..STEPS).map(|i| 2.0 * at(i) * f(at(i))).sum::<f64>() / f64::from(STEPS)
}

/// Returns Schlick's weight (1 - c)⁵ for the cosine c.
fn schlick(cos: f64) -> f64 {
    (1.0 - cos).powi(5)
}

/// Returns the ratio of body albedo ρ to base colour for glTF's dielectric, whose diffuse BRDF is base (1 -
/// F(v·h)) / π (glTF 2.0, appendix B.3).
pub fn gltf(eta: f64, alpha: f64) -> f64 {
    let f0 = ((eta - 1.0) / (eta + 1.0)).powi(2);
    let diffuse = cosine_mean(|cos| {
        // The half vector between the normal and a direction at the angle θ is at the angle θ/2 from the
        // normal.
        let half = ((1.0 + cos) / 2.0).sqrt();
        (1.0 - f0) * (1.0 - schlick(half))
    });
    diffuse / (1.0 - coat_albedo(eta, alpha, Masking::Correlated))
}

/// Returns the ratio of body albedo ρ to base colour for Disney's `principled` as in Mitsuba 3. The diffuse
/// BRDF has the factor (1 - Fo/2)(1 - Fi/2) and a retro-reflection that depends on `roughness` (Burley
/// 2012, sect. 5.3). Retro-reflection adds energy, so the ratio can exceed 1.
pub fn principled(eta: f64, roughness: f64) -> f64 {
    let diffuse = cosine_mean(|cos| {
        let fo = schlick(cos);
        1.0 - 0.5 * fo + 2.0 * roughness * 0.5 * (1.0 + cos) * fo
    });
    diffuse / (1.0 - coat_albedo(eta, roughness * roughness, Masking::Separable))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares directional albedos for base colours 0.2, 0.5 and 0.8 at roughness 1 with values from glTF's
    /// specification and from Mitsuba. Separate scripts computed these values.
    #[test]
    fn base_colours_keep_their_directional_albedo() {
        let specified = [0.204, 0.492, 0.780];
        let disney = [0.220, 0.530, 0.840];
        for (factor, coat, want) in [
            (gltf(1.5, 1.0), coat_albedo(1.5, 1.0, Masking::Correlated), specified),
            (principled(1.5, 1.0), coat_albedo(1.5, 1.0, Masking::Separable), disney),
        ] {
            for (base, want) in [0.2, 0.5, 0.8].into_iter().zip(want) {
                let got = coat + factor * base * (1.0 - coat);
                assert!((got / want - 1.0).abs() < 0.005, "{base}: {got}, not {want}");
            }
        }
    }
}
