//! Standard errors are honest: over many seeds, deviations from the mean over seeds are as large as they say.

use crate::support::{mirror_room, render_scene, scene_of};
use sunstone::tensor::field::Field;
use sunstone::transport::scene::Integrator;

const SEEDS: u64 = 64;

const SLICES: &str = r#"
[[slices]]
name = "sum"
[[slices]]
name = "coarse"
camera = { binned = 2 }
[[slices]]
name = "flight"
time = { start_ps = 12000, bin_ps = 500, bins = 20 }
[[slices]]
name = "mueller"
polarization = "mueller"
[[slices]]
name = "epipolar"
projector = { nonepipolar = { half_width_px = 0.5 } }
"#;

/// z = (mean - mean over seeds) / standard error, with the factor √(S/(S-1)) for the mean over seeds holding the seed
/// itself. An element has enough hits if its standard error hardly varies from seed to seed (by less than 15 %: for n
/// samples of kurtosis κ the variation is ½ √((κ - 1)/n), so κ < 0.09·n): a handful of bright hits do not make a
/// Gaussian. That choice looks at no deviation, so it cannot favour good ones.
#[test]
fn deviations_between_seeds_are_as_stated() {
    honest(Integrator::Path);
}

/// The same where plain paths and samples of redirected light are added, 16 of these.
#[test]
fn deviations_of_added_passes_are_as_stated() {
    honest(Integrator::Caustics);
}

fn honest(integrator: Integrator) {
    let mut scene = scene_of(&mirror_room(16, 16, 256, 16, SLICES));
    scene.set_integrator(integrator);
    let names: Vec<String> = scene.slices.iter().map(|s| s.name.clone()).collect();
    let mut values: Vec<Vec<[Vec<f32>; 2]>> = vec![Vec::new(); names.len()];
    for seed in 0..SEEDS {
        scene.settings.seed = 1000 + seed;
        let store = render_scene(&scene);
        for (name, list) in names.iter().zip(&mut values) {
            list.push([Field::Mean, Field::StdError].map(|f| store.field(name, f).data));
        }
    }
    let s = SEEDS as f64;
    for (name, runs) in names.iter().zip(&values) {
        let (mut elements, mut total, mut squares, mut ratio) = (0, 0.0, 0.0, [0.0; 2]);
        for i in 0..runs[0][0].len() {
            let moments = |f: usize| {
                let mean = runs.iter().map(|r| f64::from(r[f][i])).sum::<f64>() / s;
                let spread = runs
                    .iter()
                    .map(|r| (f64::from(r[f][i]) - mean).powi(2))
                    .sum::<f64>()
                    / (s - 1.0);
                (mean, spread)
            };
            let ((mean, spread), (error, variation)) = (moments(0), moments(1));
            if error == 0.0 {
                assert!(
                    spread < 1e-10 * mean * mean + 1e-30,
                    "{name}: element {i} varies without an error"
                );
                continue;
            }
            if variation.sqrt() > 0.15 * error {
                continue;
            }
            elements += 1;
            ratio[0] += spread / (error * error);
            ratio[1] += 1.0;
            for r in runs {
                let z = (f64::from(r[0][i]) - mean) / f64::from(r[1][i]) * (s / (s - 1.0)).sqrt();
                total += z;
                squares += z * z;
            }
        }
        let n = f64::from(elements) * s;
        let variance = squares / n - (total / n).powi(2);
        println!(
            "{integrator:?}, {name}: {elements} elements, variance of z {variance:.3}, spread {:.3}",
            ratio[0] / ratio[1]
        );
        assert!(
            elements >= 64,
            "{name}: only {elements} elements have enough hits"
        );
        assert!(
            (0.8..1.25).contains(&variance),
            "{name}: z has variance {variance}"
        );
    }
}
