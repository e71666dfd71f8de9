//! Tables of scattering by a participating medium. A table contains the Mueller matrix as a function of the
//! scattering angle.

use base::locate::InputError;
use glam::Vec3A;
use optics::spectrum::Wavelengths;
use scene::media::MediumSet;
use std::path::Path;

/// Optical properties and scattering matrix of a medium at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseTable {
    /// Vacuum wavelength, in nanometres.
    pub nm: f64,
    /// Refractive index of the host medium.
    pub index: f64,
    /// Scattering coefficient in 1/m.
    pub scattering: f64,
    /// Absorption coefficient in 1/m.
    pub absorption: f64,
    /// Mean cosine of the scattering angle.
    pub asymmetry: f64,
    /// Mean scattering cross section of a particle in m². The value is 0 if the medium does not define
    /// particles.
    pub scattering_cross_section: f64,
    /// Mean absorption cross section of a particle in m². The value is 0 if the medium does not define
    /// particles.
    pub absorption_cross_section: f64,
    /// S11, S12, S22, S33, S34, S44 at each angle, per steradian. S11 is normalized to an integral of 1 over
    /// the sphere. The first axis of the incoming and outgoing Stokes frames is perpendicular to the
    /// scattering plane (S12 = M01 = M10, S34 = M23 = -M32).
    pub elements: Vec<[f32; 6]>,
}

/// Returns tables of the medium `name` of a file. The scattering angles are in degrees, 0 to 180. There is
/// one table for each of `wavelengths_nm`, a list of any length and order. If `wavelengths_nm` is empty, the
/// wavelengths of the file are used.
///
/// # Errors
/// Returns [`InputError`] with the file, the location and the fix.
pub fn tables(
    file: &Path,
    name: &str,
    wavelengths_nm: &[Wavelengths],
    degrees: &[f64],
) -> Result<Vec<PhaseTable>, InputError> {
    if wavelengths_nm.is_empty() {
        return Ok(of_set(&MediumSet::load(file, Some(name), None)?, name, degrees));
    }
    let mut out = vec![];
    for wavelengths in wavelengths_nm {
        let set = MediumSet::load(file, Some(name), Some(wavelengths.clone()))?;
        out.extend(of_set(&set, name, degrees));
    }
    Ok(out)
}

/// Returns the tables of the medium `name`, one per wavelength of the set. The list is empty if the name is
/// unknown.
pub fn of_set(set: &MediumSet, name: &str, degrees: &[f64]) -> Vec<PhaseTable> {
    let mut out = vec![];
    let Some(&id) = set.names.get(name) else {
        return out;
    };
    for (lane, (nm, bulk)) in set.wavelengths.nm().iter().zip(&set.bulk[id as usize]).enumerate() {
        let at = |deg: &f64| {
            // The incident light travels along +z and is scattered in the z-x plane, whose normal is y.
            let (sin, cos) = deg.to_radians().sin_cos();
            let (wi, wo) = (-Vec3A::Z, Vec3A::new(sin as f32, 0.0, cos as f32));
            let m = set.media.eval(id, wo, wi).between(wo, Vec3A::Y, wi, Vec3A::Y).lane(lane);
            [m[0][0], m[0][1], m[1][1], m[2][2], m[2][3], m[3][3]]
        };
        out.push(PhaseTable {
            nm: *nm,
            index: bulk.index,
            scattering: bulk.scattering,
            absorption: bulk.absorption,
            asymmetry: bulk.asymmetry,
            scattering_cross_section: bulk.c_sca,
            absorption_cross_section: bulk.c_abs,
            elements: degrees.iter().map(at).collect(),
        });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies that Rayleigh scattering at right angles is fully polarized and equals 3/(16π) at any
    /// wavelength.
    #[test]
    fn rayleigh_polarizes_at_right_angles() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("m.toml");
        let text = "[media.air.homogeneous]\nscattering = 1.0\nabsorption = 0.5\nphase.rayleigh = { depolarization = 0.0 }\n";
        std::fs::write(&file, text).expect("is written");
        let of = |nm: &[f64]| {
            let each = |nm: &f64| Wavelengths::new(vec![*nm]).expect("a wavelength");
            let wavelengths: Vec<Wavelengths> = nm.iter().map(each).collect();
            tables(&file, "air", &wavelengths, &[0.0, 90.0]).expect("is sound")
        };
        let found = of(&[700.0, 650.0, 550.0, 500.0, 450.0]);
        assert_eq!((found.len(), of(&[]).len()), (5, 3));
        for table in found {
            let [s11, s12, ..] = table.elements[1];
            let want = 3.0 / (16.0 * std::f32::consts::PI);
            assert!((s11 - want).abs() < 1e-4 && (s12 - s11).abs() < 1e-4, "{table:?}");
            assert_eq!((table.scattering, table.absorption), (1.0, 0.5));
        }
    }
}
