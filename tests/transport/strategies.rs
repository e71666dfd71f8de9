//! Tests the effect of disabling a sampling strategy. Light that other strategies sample must not change. If
//! all strategies are enabled, light that several strategies sample must be less noisy.

use crate::bidirectional::{DIFFUSE, FOG, WALLS, assert_agree, devices};
use crate::support::{Rendered, render_scene, scene_of};
use sunstone::tensor::axes::AxisKind;
use sunstone::transport::render::strategies::strategies;
use sunstone::transport::scene::Integrator;
use sunstone::transport::strategy::{Strategies, Strategy};

/// Returns a render in which the strategies of `list` are disabled.
fn without(text: &str, integrator: Integrator, list: &[Strategy]) -> Rendered {
    let mut scene = scene_of(text);
    let manifold = scene.settings.manifold;
    scene.set_integrator(integrator);
    scene.change_settings(|s| s.manifold = manifold && integrator != Integrator::Path);
    assert!(list.iter().all(|s| strategies(&scene).has(*s)));
    scene.change_settings(|s| s.strategies = Strategies::ALL.without(list));
    assert!(!list.iter().any(|s| strategies(&scene).has(*s)));
    render_scene(&scene)
}

/// Returns the scene-file text of a ball of stone in front of a wall. A point light is next to the projector.
fn stone(spp: u32, seed: u64, ior: &str, medium: &str) -> String {
    devices(spp, 60, seed as u32)
        + DIFFUSE
        + &format!(
            "stone.rough_dielectric = {{ ior = {ior}, alpha = 0.3 }}\n[media.stone.homogeneous]\n{medium}\n"
        )
        + WALLS
        + "[[objects]]\nmaterial = \"stone\"\ninterior = \"stone\"\nshape.sphere = { center = [0.0, -0.1, 0.2], radius = 0.6 }\n\
           [[emitters]]\npoint = { position = [0.5, 0.9, 2.5], intensity = [0.8, 0.6, 0.4] }\n"
}

/// Returns the squared standard error of the light in a slice, divided by the squared light.
fn noise(r: &Rendered) -> f64 {
    let (mean, error) = (r.mean("m"), r.std_error("m"));
    let sum = |v: &[f32]| v.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
    sum(&error.data) / sum(&mean.data)
}

/// Returns the largest difference between the light of two renders, in standard errors. The function compares
/// all light, and the light of one to four bounces.
fn apart(a: &Rendered, b: &Rendered) -> f64 {
    let [a, b] = [a, b].map(|r| {
        let (mean, error) = (r.mean("m"), r.std_error("m"));
        let bounces = mean.extent(AxisKind::Bounces);
        let mut sums = vec![[0.0; 2]; bounces];
        // Each pixel has the matrices of three wavelengths. The first three numbers are M00.
        for i in (0..mean.data.len()).filter(|i| i % 48 < 3) {
            let [light, variance] = &mut sums[i / 48 % bounces];
            *light += f64::from(mean.data[i]);
            *variance += f64::from(error.data[i]).powi(2);
        }
        let all = sums.iter().fold([0.0; 2], |all, s| [all[0] + s[0], all[1] + s[1]]);
        sums[0] = all;
        sums
    });
    let deviations = a.iter().zip(&b).take(5).map(|([x, v], [y, w])| {
        let sigma = (v + w).sqrt();
        (x - y).abs() / sigma
    });
    deviations.fold(0.0, f64::max)
}

/// Returns the largest deviation, in standard errors, of elements with errors below 1/20 in each of two
/// renders, and the number of such elements. Elements with larger errors have few random samples, so their
/// errors are unreliable.
fn known(a: &Rendered, b: &Rendered) -> (f32, usize) {
    let (mut most, mut count) = (0.0_f32, 0);
    for slice in ["m", "t", "p"] {
        let top = a.mean(slice).data.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
        let [x, y] = [a, b].map(|r| r.mean(slice).data.into_iter().zip(r.std_error(slice).data));
        for ((x, dx), (y, dy)) in x.zip(y) {
            if x.abs() > 1e-6 * top && dx < 0.05 * x.abs() && dy < 0.05 * y.abs() {
                most = most.max((x - y).abs() / dx.hypot(dy).max(1e-6 * x.abs()));
                count += 1;
            }
        }
    }
    (most, count)
}

/// Tests light that leaves a stone through its rough surface. Next-event estimation through the surface and
/// random paths agree in every element, number of bounces, projector pixel and time bin.
///
/// The light of the two methods equals that of bidirectional paths, and differs if the medium absorbs 50 %
/// more. For equal numbers of samples, next-event estimation has at most a tenth of the variance.
#[test]
#[ignore = "slow: tools/check --all"]
fn strategies_agree_on_light_that_leaves_rough_stones() {
    let phases = [
        ("1.5", "rayleigh = {}"),
        ("[1.4, 1.5, 1.6]", "henyey_greenstein = { g = 0.6, linear = 0.5, circular = 0.5 }"),
    ];
    for (ior, phase) in phases {
        let text = |spp, seed, absorption| {
            stone(spp, seed, ior, &format!("scattering = 12\nabsorption = {absorption}\nphase.{phase}"))
        };
        let all = without(&text(512, 1, 0.2), Integrator::Path, &[]);
        let chance = without(&text(512, 1, 0.2), Integrator::Path, &[Strategy::RoughInterface]);
        let gain = noise(&chance) / noise(&all);
        assert!(gain > 10.0, "{gain}");
        let chance = without(&text(2048, 2, 0.2), Integrator::Path, &[Strategy::RoughInterface]);
        let (most, compared) = known(&chance, &all);
        assert!(most < 5.0 && compared > 150, "{most}, {compared}");
        let both = without(&text(512, 3, 0.2), Integrator::Bidirectional, &[]);
        let darker = without(&text(512, 4, 0.3), Integrator::Path, &[]);
        let [chance, both, darker] = [chance, both, darker].map(|r| apart(&r, &all));
        assert!(chance < 5.0 && both < 5.0 && darker > 5.0);
    }
}

/// Disables a strategy of bidirectional paths. The remaining strategies sample the same paths. Tests that the
/// weights still sum to one.
#[test]
#[ignore = "slow: tools/check --all"]
fn other_strategies_replace_a_missing_one() {
    let text = |spp, seed| {
        devices(spp, 5, seed)
            + DIFFUSE
            + "none.null = {}\n"
            + FOG
            + "phase.rayleigh = {}\n"
            + WALLS
            + "[[objects]]\nmaterial = \"none\"\ninterior = \"fog\"\nshape.cube = { min = [-0.9, -0.9, -0.9], max = [0.9, 0.9, 0.9] }\n"
    };
    let path = without(&text(512, 1), Integrator::Path, &[]);
    for left_out in [
        &[Strategy::NextEvent][..],
        &[Strategy::LightTracing],
        &[Strategy::VertexConnection],
        &[Strategy::LightTracing, Strategy::VertexConnection],
    ] {
        let rest = without(&text(256, 2), Integrator::Bidirectional, left_out);
        assert_agree(&path, &rest, 0.05, 20);
    }
}
