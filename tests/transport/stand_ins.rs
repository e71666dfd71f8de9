//! Tests that the 25 built-in stand-ins for measured materials have realizable Mueller matrices and conserve
//! energy.

use crate::optics::surface_at;
use glam::Vec3A;
use std::path::Path;
use sunstone::optics::polarization::frame::perpendicular;
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::spectrum::Spectral;
use sunstone::polarimetry::decompose::cloude;
use sunstone::scene::materials::MaterialSet;
use sunstone::transport::geometry::ray::Surface;
use sunstone::transport::material::Lanes;

fn stand_ins() -> MaterialSet {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pbrdf/stand_ins.toml");
    MaterialSet::load(&path).unwrap_or_else(|e| panic!("{e}"))
}

/// Returns the index and name of every stand-in.
fn likes(set: &MaterialSet) -> Vec<(String, u32)> {
    let all: Vec<_> = set
        .names
        .iter()
        .filter(|(name, _)| name.starts_with("like_"))
        .map(|(name, id)| (name.clone(), *id))
        .collect();
    assert_eq!(all.len(), 25);
    all
}

fn surface() -> Surface {
    surface_at(Vec3A::Z, Vec3A::X, [0.5; 2])
}

fn direction(theta_deg: f32, phi_deg: f32) -> Vec3A {
    let ((s, c), (sp, cp)) = (theta_deg.to_radians().sin_cos(), phi_deg.to_radians().sin_cos());
    Vec3A::new(s * cp, s * sp, c)
}

/// Tests realizability by Cloude's criterion for 12 × 12 × 24 directions. Each eigenvalue must be at least
/// -1e-5 M00.
#[test]
fn stand_ins_are_realizable() {
    let set = stand_ins();
    for (name, id) in likes(&set) {
        for a in 0..12 {
            for b in 0..12 {
                for c in 0..24 {
                    let wo = direction(2.0 + 7.0 * a as f32, 0.0);
                    let wi = direction(4.0 + 7.0 * b as f32, 3.0 + 15.0 * c as f32);
                    let value = set.materials.eval(id, &surface(), wo, wi).expect("a value");
                    let m = value.between(wo, perpendicular(wo), wi, perpendicular(wi));
                    for lane in 0..3 {
                        let m = m.lane(lane).map(|row| row.map(f64::from));
                        let least = cloude::eigenvalues(&m).expect("finite")[3] / m[0][0];
                        assert!(least > -1e-5, "{name} at {wo}, {wi}: {least}");
                    }
                }
            }
        }
    }
}

/// Tests that the directional albedo is at most 1 within 5 standard errors, with 4000 samples per direction.
#[test]
fn stand_ins_create_no_light() {
    let set = stand_ins();
    for (name, id) in likes(&set) {
        for theta in [0.0, 40.0, 70.0, 85.0] {
            let wo = direction(theta, 30.0);
            let n = 4000;
            let (mut sum, mut squares) = (Spectral::ZERO, Spectral::ZERO);
            for i in 0..n {
                let mut stream = Stream::new(5, i, id);
                let mut lanes = Lanes::first(3);
                let sampled = set.materials.sample(id, &surface(), wo, &mut lanes, &mut stream);
                let w = sampled.map_or(Spectral::ZERO, |s| s.scatter.m00());
                sum += w;
                squares += w * w;
            }
            for lane in 0..3 {
                let n = f64::from(n);
                let mean = f64::from(sum.to_array()[lane]) / n;
                let variance = (f64::from(squares.to_array()[lane]) / n - mean * mean).max(0.0);
                let bound = 1.0 + 5.0 * (variance / n).sqrt();
                assert!(mean > 0.01 && mean < bound, "{name} at {theta}°: albedo {mean}");
            }
        }
    }
}
