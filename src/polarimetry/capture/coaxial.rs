//! The optics that the outgoing and returning paths of a coaxial rig share. The shared optics are a
//! beamsplitter and a pair of galvo mirrors.
//!
//! According to Baek & Heide (2021, eqs. 12 and 14), the scene receives G B_t Q p, and the detector measures
//! [L Q B_r G' …]_0. In these equations, p is the source, and Q and L are polarizing elements. The states of
//! generator and analyzer include the matrices of the shared optics. The galvo's matrix G depends on the
//! ray's direction.

use super::element::{Mueller, Ray, diattenuator, retarder};
use super::spectral_value::SpectralValue;
use nalgebra::Vector3;
use optics::polarization::fresnel;
use optics::spectrum::Spectral;
use serde::{Deserialize, Serialize};

/// One arm of a beamsplitter. The eigenaxes of the arm are the x and y axes of the frame.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Mean transmittance or reflectance.
    pub efficiency: SpectralValue,
    /// Diattenuation (T_x - T_y)/(T_x + T_y).
    #[serde(default = "nothing")]
    pub diattenuation: SpectralValue,
    /// Phase in degrees by which the y component lags the x component. The phase excludes the 180° of the
    /// mirror image.
    #[serde(default = "nothing")]
    pub retardance_deg: SpectralValue,
}

fn nothing() -> SpectralValue {
    SpectralValue::Same(0.0)
}

impl Arm {
    fn matrix(&self, nm: f64) -> Mueller {
        let (t, d) = (self.efficiency.at(nm), self.diattenuation.at(nm));
        diattenuator(t * (1.0 + d), t * (1.0 - d)) * retarder(self.retardance_deg.at(nm).to_radians())
    }
}

/// The shared optics of a coaxial rig.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Coaxial {
    /// The transmitting arm with the matrix B_t, from the elements to the scene.
    pub transmission: Arm,
    /// The reflecting arm with the matrix B_r, from the scene to the elements.
    pub reflection: Arm,
    /// The mirrors that steer the beam, or `None` if the beam is fixed.
    pub galvo: Option<Galvo>,
}

impl Coaxial {
    /// Returns the fraction of unpolarized light that passes the optics to the scene and back along the axis.
    fn brightness(&self, nm: f64) -> f64 {
        let axis = Ray::axial(nm);
        self.outward(&axis)[(0, 0)] * self.inward(&axis)[(0, 0)]
    }

    /// Scales the efficiency of the transmitting arm. After scaling, the brightness along the axis equals the
    /// brightness of `before`. Use this function after fitting parameters to captures that do not determine
    /// the brightness.
    pub fn keep_brightness(&mut self, before: &Self, wavelengths: &[f64]) {
        let efficiency = |nm: f64| {
            let as_before = before.brightness(nm) / self.brightness(nm);
            (self.transmission.efficiency.at(nm) * as_before).min(1.0)
        };
        let rows: Vec<[f64; 2]> = wavelengths.iter().map(|nm| [*nm, efficiency(*nm)]).collect();
        self.transmission.efficiency = match rows[..] {
            [] => return,
            [[_, value]] => SpectralValue::Same(value),
            _ => SpectralValue::Table(rows),
        };
    }

    /// Returns the Mueller matrix B_t of the transmitting arm at the wavelength `nm`, in nanometres.
    pub fn transmission(&self, nm: f64) -> Mueller {
        self.transmission.matrix(nm)
    }

    /// Returns B_r, which is the matrix of the arm times the matrix of a mirror image.
    pub fn reflection(&self, nm: f64) -> Mueller {
        self.reflection.matrix(nm) * mirror_image()
    }

    /// Returns G B_t for the ray's direction, from the elements to the scene.
    pub fn outward(&self, ray: &Ray) -> Mueller {
        let b = self.transmission(ray.nm);
        let galvo = self.galvo.as_ref();
        galvo.map_or(b, |g| g.outward(ray.nm, ray.direction()) * b)
    }

    /// Returns B_r G' for the ray's direction, from the scene to the elements.
    pub fn inward(&self, ray: &Ray) -> Mueller {
        let b = self.reflection(ray.nm);
        let galvo = self.galvo.as_ref();
        galvo.map_or(b, |g| b * g.inward(ray.nm, ray.direction()))
    }
}

/// Returns the Mueller matrix of a mirror image. The matrix reverses handedness and exchanges ±45°.
fn mirror_image() -> Mueller {
    Mueller::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, -1.0))
}

/// Two metal mirrors at right angles, each at 45° to the undeflected beam.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Galvo {
    /// Refractive index of the metal.
    pub n: SpectralValue,
    /// Extinction coefficient of the metal.
    pub k: SpectralValue,
}

/// A ray and the frame of its Stokes vectors. The x axis is perpendicular to the ray, and y = direction × x.
#[derive(Clone, Copy, Debug)]
struct Framed {
    direction: Vector3<f64>,
    x: Vector3<f64>,
}

impl Galvo {
    /// Returns G for a direction. The direction is given by its x and y angles from the undeflected axis, in
    /// radians. G maps from the frame before the mirrors to the frame of the beam behind the mirrors.
    ///
    /// Before the mirrors, light travels along +X. The first mirror reflects the light to +Y, and the second
    /// mirror reflects the light to +Z. The x axis of a frame is an axis that is projected onto the plane
    /// perpendicular to the beam. The projected axis is Y before the mirrors, and X behind the mirrors.
    pub fn outward(&self, nm: f64, direction: [f64; 2]) -> Mueller {
        let (normals, beam) = self.bounces(direction);
        let start = Framed { direction: Vector3::x(), x: Vector3::y() };
        self.along(nm, start, &normals, across(Vector3::x(), beam))
    }

    /// Returns G' for light that returns from the same direction. The frames are those of [`Galvo::outward`]
    /// with reversed y axes, because the ray is reversed.
    pub fn inward(&self, nm: f64, direction: [f64; 2]) -> Mueller {
        // According to Sekera (1966), the matrix of the reversed path is Q Mᵀ Q.
        let q = Mueller::from_diagonal(&nalgebra::Vector4::new(1.0, 1.0, -1.0, 1.0));
        q * self.outward(nm, direction).transpose() * q
    }

    /// Returns the normals of the mirrors and the direction of the beam behind the mirrors.
    fn bounces(&self, [alpha_x, alpha_y]: [f64; 2]) -> ([Vector3<f64>; 2], Vector3<f64>) {
        // A mirror that is rotated by an angle deflects the beam by twice that angle.
        let (s, c) = (std::f64::consts::FRAC_PI_4 + alpha_x / 2.0).sin_cos();
        let first = Vector3::new(-s, c, 0.0);
        let (s, c) = (std::f64::consts::FRAC_PI_4 + alpha_y / 2.0).sin_cos();
        let second = Vector3::new(0.0, -s, c);
        let beam = reflected(reflected(Vector3::x(), first), second);
        ([first, second], beam)
    }

    fn along(&self, nm: f64, start: Framed, normals: &[Vector3<f64>], end_x: Vector3<f64>) -> Mueller {
        let (mut m, mut ray) = (Mueller::identity(), start);
        for normal in normals {
            let s = ray.direction.cross(normal);
            // At normal incidence, every axis perpendicular to the ray is an s axis.
            let s = s.try_normalize(1e-9).unwrap_or(ray.x);
            m = turned(&ray, s) * m;
            let cos = ray.direction.dot(normal).abs();
            m = self.reflection(nm, cos) * m;
            ray = Framed { direction: reflected(ray.direction, *normal), x: s };
        }
        turned(&ray, end_x) * m
    }

    /// Returns the Mueller matrix of Fresnel reflection, in frames whose x axis is the s direction. `cos` is
    /// the cosine of the angle of incidence.
    fn reflection(&self, nm: f64, cos: f64) -> Mueller {
        let lane = |v: f64| Spectral::splat(v as f32);
        let block = fresnel::conductor(cos as f32, lane(self.n.at(nm)), lane(self.k.at(nm)));
        let m = block.to_mueller().lane(0);
        Mueller::from_fn(|i, j| f64::from(m[i][j]))
    }
}

fn reflected(d: Vector3<f64>, normal: Vector3<f64>) -> Vector3<f64> {
    d - normal * (2.0 * d.dot(&normal))
}

/// Returns the component of an axis that is perpendicular to a direction. The component is normalized.
fn across(axis: Vector3<f64>, direction: Vector3<f64>) -> Vector3<f64> {
    (axis - direction * axis.dot(&direction)).normalize()
}

/// Returns the rotation from a ray's frame to the frame with the x axis `x`.
fn turned(ray: &Framed, x: Vector3<f64>) -> Mueller {
    let y = ray.direction.cross(&ray.x);
    super::element::rotator(x.dot(&y).atan2(x.dot(&ray.x)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn silver() -> Galvo {
        Galvo { n: SpectralValue::Same(0.0596), k: SpectralValue::Same(3.5974) }
    }

    /// Verifies that the matrix of the return path, computed mirror by mirror, equals the matrix from
    /// reciprocity ([`Galvo::inward`]).
    #[test]
    fn the_return_path_is_the_reversed_forward_path() {
        let galvo = silver();
        for direction in [[0.0, 0.0], [0.1, -0.05], [-0.2, 0.15]] {
            let (normals, beam) = galvo.bounces(direction);
            let start = Framed { direction: -beam, x: across(Vector3::x(), beam) };
            let back = galvo.along(550.0, start, &[normals[1], normals[0]], Vector3::y());
            assert!((back - galvo.inward(550.0, direction)).amax() < 1e-6);
        }
    }

    /// Verifies that perfect undeflected mirrors rotate the frame and have no other effect. The s axes of the
    /// two mirrors are perpendicular, and the two mirror images cancel.
    #[test]
    fn perfect_mirrors_keep_all_light_polarized() {
        let mut galvo = silver();
        (galvo.n, galvo.k) = (SpectralValue::Same(0.0), SpectralValue::Same(1e4));
        let m = galvo.outward(550.0, [0.0, 0.0]);
        assert!((m * m.transpose() - Mueller::identity()).amax() < 1e-3, "{m}");
        assert!((m[(3, 3)] - 1.0).abs() < 1e-3);
        // The undeflected beam leaves along its axis, and a deflected beam has the requested angle.
        let (_, beam) = galvo.bounces([0.0, 0.0]);
        assert!((beam - Vector3::z()).norm() < 1e-12);
        let (_, beam) = galvo.bounces([0.0, 0.1]);
        assert!((beam.dot(&Vector3::z()) - 0.1_f64.cos()).abs() < 1e-12);
    }

    #[test]
    fn arm_matrices_have_the_stated_properties() {
        let arm = Arm {
            efficiency: SpectralValue::Same(0.45),
            diattenuation: SpectralValue::Same(0.1),
            retardance_deg: SpectralValue::Same(30.0),
        };
        let m = arm.matrix(550.0);
        assert!((m[(0, 0)] - 0.45).abs() < 1e-12 && (m[(0, 1)] / m[(0, 0)] - 0.1).abs() < 1e-12);
        assert!((m[(2, 3)].atan2(m[(2, 2)]) - 30.0_f64.to_radians()).abs() < 1e-12);
        let rig = Coaxial { transmission: arm.clone(), reflection: arm, galvo: None };
        assert!((rig.reflection(550.0)[(3, 3)] + rig.transmission(550.0)[(3, 3)]).abs() < 1e-12);
    }
}
