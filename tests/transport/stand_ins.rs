//! The 25 shipped stand-ins: realizable Mueller matrices, energy conservation, and a render with a table that
//! agrees with a render of its source.

use crate::support::render_text;
use glam::Vec3A;
use std::path::Path;
use sunstone::optics::polarization::frame::perpendicular;
use sunstone::optics::sampling::stream::Stream;
use sunstone::optics::spectrum::Spectral;
use sunstone::polarimetry::decompose::cloude;
use sunstone::scene::materials::MaterialSet;
use sunstone::transport::geometry::ray::Surface;
use sunstone::transport::material::Lanes;
use sunstone::transport::material::measured::axes::Axes;
use sunstone::transport::material::measured::write::tabulate;

fn stand_ins() -> MaterialSet {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pbrdf/stand_ins.toml");
    MaterialSet::load(&path).unwrap_or_else(|e| panic!("{e}"))
}

/// Index and name of every stand-in.
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
    Surface {
        p: Vec3A::ZERO,
        ng: Vec3A::Z,
        ns: Vec3A::Z,
        tangent: Vec3A::X,
        bitangent: Vec3A::ZERO,
        uv: [0.5; 2],
        material: 0,
        rounding: 0.0,
    }
}

fn direction(theta_deg: f32, phi_deg: f32) -> Vec3A {
    let ((s, c), (sp, cp)) = (theta_deg.to_radians().sin_cos(), phi_deg.to_radians().sin_cos());
    Vec3A::new(s * cp, s * sp, c)
}

/// Cloude's test on 12 × 12 × 24 directions of each material: no eigenvalue below -1e-5 of M00.
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

/// Directional albedo by sampling, 4000 samples per direction: at most 1, within 5 standard errors.
#[test]
fn stand_ins_make_no_light() {
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

/// A ball of rough gold and one of its table, with the same random numbers: the largest differences are those
/// of linear interpolation in 2° steps at α = 0.3.
#[test]
fn a_table_renders_as_its_source() {
    let folder = tempfile::tempdir().unwrap();
    let source = r"{ rough_conductor = { n = 0.4242, k = 2.4721, alpha = 0.3 } }";
    let text = format!("wavelengths_nm = [550]\n[materials]\nball = {source}\n");
    let set = MaterialSet::from_text(Path::new("test.toml"), &text).unwrap_or_else(|e| panic!("{e}"));
    let path = folder.path().join("ball.pbsdf");
    let axes = Axes::even([91, 46, 46], vec![550]);
    tabulate(&path, &axes, &[(&set.materials, 0)]).unwrap();
    let render = |material: &str| {
        render_text(&format!(
            r#"
wavelengths_nm = [550]
[render]
spp = 8
max_depth = 2
[camera]
resolution = [16, 16]
fov_x_deg = 14
pose.look_at = {{ origin = [0, 0, 6], target = [0, 0, 0] }}
[projector]
resolution = [4, 4]
fov_x_deg = 40
pose.look_at = {{ origin = [3, 2, 5], target = [0, 0, 0] }}
[materials]
ball = {material}
[[objects]]
shape.sphere = {{}}
material = "ball"
[[slices]]
name = "image"
polarization = "mueller"
"#
        ))
        .mean("image")
    };
    let analytic = render(source);
    let table = render(&format!("{{ measured = {{ file = {:?} }} }}", path.to_str().unwrap()));
    // Where light or camera directions are grazing, cells extend below the horizon and only their known
    // corners count.
    let (mut compared, mut off, mut light) = (0, 0.0, 0.0);
    for (a, t) in analytic.data.chunks_exact(16).zip(table.data.chunks_exact(16)) {
        compared += u32::from(a[0] > 0.0);
        light += a[0];
        let differences = a.iter().zip(t).map(|(x, y)| (x - y).abs());
        off += differences.fold(0.0, f32::max);
    }
    let off = off / light;
    assert!(compared > 100 && off < 0.004, "{compared} pixels, off by {off}");
    assert!(off > 1e-6, "the table was rendered, not its source");
}
