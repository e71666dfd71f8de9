//! Tests the selection among many lights. The tests check exact probabilities, irradiance against closed
//! forms, and the noise of lamps of unequal brightness.

use crate::lights::{check, m00, quadrature, shining, text};
use crate::support::render_text;
use glam::{DVec3, Vec3A};
use std::f64::consts::PI;
use std::fmt::Write as _;
use sunstone::optics::sampling::{stream::Stream, warp};
use sunstone::transport::light::bounds::Bounds;
use sunstone::transport::light::receiver::Receiver;
use sunstone::transport::light::tree::{Choice, LightTree};

const BOTH: [&str; 2] = ["path", "bidirectional"];

/// Returns spheres, flat lamps and spots of all sizes and intensities. Some lights are at the same position.
fn lights(stream: &mut Stream) -> Vec<Bounds> {
    let one = |i: usize, stream: &mut Stream| {
        let [x, y] = stream.uniform2();
        let centre = if i < 10 { Vec3A::splat(0.5) } else { Vec3A::new(x, y, stream.uniform()) * 4.0 };
        let half = Vec3A::splat(0.3 * stream.uniform().powi(4));
        let intensity = stream.uniform().powi(3) * 10.0;
        let axis = warp::sphere(stream.uniform2());
        match i % 4 {
            0 => Bounds::all_around(centre - half, centre + half, intensity),
            1 => Bounds::flat(centre - half, centre + half, axis, false, intensity),
            2 => Bounds::flat(centre - half, centre + half, axis, true, intensity),
            _ => Bounds { axis, spread: 0.2, reach: 0.3, ..Bounds::all_around(centre, centre, intensity) },
        }
    };
    (0..300).map(|i| one(i, stream)).collect()
}

fn receiver(stream: &mut Stream) -> Receiver {
    let [x, y] = stream.uniform2();
    let p = Vec3A::new(x, y, stream.uniform()) * 6.0 - 1.0;
    if stream.uniform() < 0.2 {
        return Receiver::anywhere(p);
    }
    Receiver { p, normal: warp::sphere(stream.uniform2()) }
}

/// Tests the selection of lights by evenly spaced numbers. The fraction of numbers that select each light
/// must equal the stated probability.
#[test]
#[ignore = "slow: tools/check --all"]
fn lights_are_chosen_with_the_stated_probabilities() {
    const N: u32 = 40_000;
    let mut stream = Stream::new(8, 0, 0);
    let lights = lights(&mut stream);
    let tree = LightTree::new(&lights).expect("lights that shine");
    for _ in 0..60 {
        let at = receiver(&mut stream);
        let mut counts = vec![0.0_f64; lights.len()];
        let mut none = 0.0;
        let chances: Vec<f64> = (0..lights.len()).map(|light| f64::from(tree.chance(&at, light))).collect();
        for k in 0..N {
            let mut choice = [Choice::open((k as f32 + 0.5) / N as f32, 1.0)];
            tree.choose(&[at], &mut choice);
            let [Choice { chance, which, .. }] = choice;
            match choice[0].light() {
                Some(light) => {
                    let light = light as usize;
                    let stated = chances[light];
                    assert!((f64::from(chance) / stated - 1.0).abs() < 1e-5, "{chance}, stated {stated}");
                    assert!((0.0..1.0).contains(&which));
                    counts[light] += 1.0 / f64::from(N);
                }
                None => none += 1.0 / f64::from(N),
            }
        }
        assert!((chances.iter().sum::<f64>() + none - 1.0).abs() < 2e-3);
        let worst = |chances: &[f64]| {
            let off = counts.iter().zip(chances).map(|(a, b)| (a - b).abs());
            off.fold(0.0, f64::max)
        };
        // Each light corresponds to a single interval of the numbers.
        assert!(worst(&chances) < 3.0 / f64::from(N), "{}", worst(&chances));
        // Negative control: the probabilities at another point differ.
        let other = Receiver::anywhere(at.p + Vec3A::splat(0.5));
        let planted: Vec<f64> =
            (0..lights.len()).map(|light| f64::from(tree.chance(&other, light))).collect();
        assert!(worst(&planted) > 3.0 / f64::from(N), "a planted error is not found");
    }
}

/// Tests that every light that reaches a point has a positive probability.
#[test]
fn every_light_that_reaches_a_point_can_be_chosen() {
    let mut stream = Stream::new(9, 0, 0);
    let lights = lights(&mut stream);
    let tree = LightTree::new(&lights).expect("lights that shine");
    let mut reached = 0;
    for _ in 0..300 {
        let at = receiver(&mut stream);
        for (i, light) in lights.iter().enumerate() {
            let [x, y] = stream.uniform2();
            let q = light.low + (light.high - light.low) * Vec3A::new(x, y, stream.uniform());
            let to = (q - at.p).normalize();
            let mut cos = -light.axis.dot(to);
            if light.two_sided {
                cos = cos.abs();
            }
            let emits = cos.clamp(-1.0, 1.0).acos() < light.spread + light.reach - 1e-3;
            let receives = at.normal == Vec3A::ZERO || at.normal.dot(to) > 1e-3;
            if emits && receives && light.intensity > 0.0 {
                reached += 1;
                assert!(tree.chance(&at, i) > 0.0, "light {i}");
            }
        }
    }
    assert!(reached > 20_000, "{reached}");
}

/// Tests the noise of a distant large lamp and a near small lamp that cause equal irradiance on a plane. The
/// power ratio is 3200.
#[test]
fn a_weak_near_lamp_is_sampled_despite_a_strong_far_one() {
    // The irradiance is π L (r/d)² cosθ. The far lamp has radiance 2, and the near lamp has radiance 1. The
    // lamps do not occlude each other.
    let (far, near) = (DVec3::new(0.0, 0.0, 40.0), DVec3::new(0.3, 0.0, 0.597));
    let mut light = shining("sphere = { center = [0, 0, 40], radius = 2 }", "");
    light += "[[objects]]\nmaterial = \"black\"\nshape.sphere = { center = [0.3, 0, 0.597], radius = 0.05 }\n\
        emission.radiance = 1\n";
    for integrator in BOTH {
        for at in [[0.0, 0.0], [-0.2, 0.1]] {
            let p = DVec3::new(at[0], at[1], 0.0);
            let irradiance = |centre: DVec3, r: f64| {
                let to = centre - p;
                PI * r * r * to.z / to.length().powi(3)
            };
            let want = 0.6 / PI * (2.0 * irradiance(far, 2.0) + irradiance(near, 0.05));
            let text = text(integrator, 4096, 2, at, &light);
            let (got, sigma) = m00(&render_text(&text));
            assert!((got - want).abs() <= 5.0 * sigma + 3e-5 * want, "{got} ± {sigma}, closed form {want}");
            // Scales the variance to 64 samples.
            let variance = (sigma / want).powi(2) * 4096.0 / 64.0;
            assert!(variance <= 0.005, "{integrator}: relative variance {variance}");
        }
    }
}

/// Tests the irradiance of a ceiling of 300 spheres. Each sphere contributes π L (r/d)² cosθ.
#[test]
fn many_spheres_light_a_plane() {
    let (mut light, mut irradiance) = (String::new(), 0.0);
    let at = [0.2, 0.1];
    for k in 0..300 {
        let centre = DVec3::new(0.3 * f64::from(k % 20) - 3.0, 0.3 * f64::from(k / 20) - 2.0, 3.0);
        let r = 0.01 * f64::from(1 + k % 7);
        light += &shining(&format!("sphere = {{ center = {:?}, radius = {r} }}", centre.to_array()), "");
        let to = centre - DVec3::new(at[0], at[1], 0.0);
        irradiance += 2.0 * PI * r * r * to.z / to.length().powi(3);
    }
    for integrator in BOTH {
        check(&text(integrator, 4000, 2, at, &light), irradiance, 0.01, integrator);
    }
}

/// Tests that an emitting mesh of 800 triangles illuminates a plane as the equivalent rectangle does, near a
/// corner of the rectangle.
#[test]
fn a_lamp_of_many_triangles_lights_a_plane() {
    const N: i32 = 20;
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("lamp.obj");
    let (corner, u, v) = (DVec3::new(-0.2, -0.3, 0.4), DVec3::new(0.0, 6.0, 1.0), DVec3::new(5.0, 0.0, 0.5));
    let place = |a: f64, b: f64| corner + u * a + v * b;
    let mut obj = String::new();
    for k in 0..(N + 1) * (N + 1) {
        let p = place(f64::from(k % (N + 1)) / f64::from(N), f64::from(k / (N + 1)) / f64::from(N));
        let _ = writeln!(obj, "v {} {} {}", p.x, p.y, p.z);
    }
    for k in 0..N * N {
        let a = k / N * (N + 1) + k % N + 1;
        let _ = writeln!(obj, "f {} {} {}", a, a + 1, a + N + 2);
        let _ = writeln!(obj, "f {} {} {}", a, a + N + 2, a + N + 1);
    }
    std::fs::write(&file, obj).expect("a file");
    let at = [0.1, 0.0];
    let want = quadrature(at, |a, b| (place(a, b), u.cross(v), 1.0));
    for integrator in BOTH {
        let light = shining(&format!("obj = {{ file = {file:?} }}"), "");
        check(&text(integrator, 8000, 2, at, &light), want, 0.01, integrator);
    }
}

/// Tests the irradiance of 400 points and spots. Each light contributes I cosθ/d², and each sample selects
/// one light.
#[test]
fn many_points_light_a_plane() {
    let (mut light, mut irradiance) = (String::new(), 0.0);
    let at = [0.2, 0.1];
    for k in 0..400 {
        let p = DVec3::new(0.3 * f64::from(k % 20) - 3.0, 0.3 * f64::from(k / 20) - 3.0, 1.0);
        let to = p - DVec3::new(at[0], at[1], 0.0);
        let intensity = f64::from(1 + k % 5);
        let mut share = 1.0;
        let _ = if k % 2 == 0 {
            writeln!(
                light,
                "[[emitters]]\npoint = {{ position = {:?}, intensity = {intensity} }}",
                p.to_array()
            )
        } else {
            let (beam, cutoff) = (30.0, 50.0);
            let angle = (to.z / to.length()).acos().to_degrees();
            share = ((cutoff - angle) / (cutoff - beam)).clamp(0.0, 1.0);
            writeln!(
                light,
                "[[emitters]]\nspot = {{ position = {:?}, direction = [0, 0, -1], intensity = {intensity}, \
                 beam_deg = {beam}, cutoff_deg = {cutoff} }}",
                p.to_array()
            )
        };
        irradiance += intensity * share * to.z / to.length().powi(3);
    }
    check(&text("path", 8000, 2, at, &light), irradiance, 0.01, "points");
}
