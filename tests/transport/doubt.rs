//! Tests that unreliable error estimates are marked, and that unmarked error estimates are correct. The scene
//! is marble, in which few samples contribute most of a pixel's light. Deviations over seeds must agree with
//! the unmarked errors.

use crate::support::edit;
use std::path::Path;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::doubt::doubtful;
use sunstone::tensor::field::Field;
use sunstone::tensor::memory::Arrays;
use sunstone::transport::render::schedule::{Share, Unwatched, render};
use sunstone::transport::strategy::{Strategies, Strategy};

/// Number of camera pixels per row.
const SIZE: usize = 48;
const SPP: u32 = 32;
const SEEDS: usize = 24;

/// Returns the means over wavelengths of the statue's pixels, with the errors of these means.
fn statue() -> Vec<(Vec<f64>, Tensor)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/sss_statue/scene.toml");
    let all = std::fs::read_to_string(&path).expect("the scene");
    let text = all[..all.find("[[slices]]").expect("slices")].to_owned();
    let size = format!("resolution = [{SIZE}, {SIZE}]");
    let text = edit(&text, "resolution = [128, 128]", &size) + "[[slices]]\nname = \"i\"\n";
    let mut scene = sunstone::scene::from_text(&path, &text).expect("the scene");
    scene.change_settings(|s| (s.spp, s.tile) = (SPP, 8));
    // Disables connections through the stone's surface, because their errors are reliable.
    scene.change_settings(|s| s.strategies = Strategies::ALL.without(&[Strategy::RoughInterface]));
    let seeds = 1..=SEEDS as u64;
    seeds
        .map(|seed| {
            scene.change_settings(|s| s.seed = seed);
            let mut arrays = Arrays::default();
            render(&scene, &[], Share::default(), &mut arrays, &Unwatched).expect("arrays take everything");
            let mut take = |field| arrays.take("i", field).expect("the field");
            let means = take(Field::Mean);
            let means = means.data.chunks_exact(3);
            let means = means.map(|v| v.iter().map(|x| f64::from(*x)).sum::<f64>() / 3.0);
            (means.collect(), take(Field::TotalStdError))
        })
        .collect()
}

/// Returns the mean of z² over selected pixels and all seeds, and five standard errors of this mean. The
/// variable z is the deviation from the mean of the remaining seeds, divided by the standard error of the
/// deviation.
fn deviations(seeds: &[(Vec<f64>, Tensor)], chosen: &[Vec<bool>]) -> [f64; 2] {
    let others = (seeds.len() - 1) as f64;
    let each: Vec<f64> = seeds
        .iter()
        .zip(chosen)
        .map(|((means, errors), chosen)| {
            let (mut squares, mut n) = (0.0, 0.0);
            for i in (0..chosen.len()).filter(|i| chosen[*i]) {
                let [sum, square] = seeds.iter().fold([0.0; 2], |[s, q], (m, _)| [s + m[i], q + m[i] * m[i]]);
                let mean = (sum - means[i]) / others;
                let spread = square - means[i] * means[i] - others * mean * mean;
                let of_mean = spread.max(0.0) / (others - 1.0) / others;
                squares += (means[i] - mean).powi(2) / (f64::from(errors.data[i]).powi(2) + of_mean);
                n += 1.0;
            }
            squares / n
        })
        .collect();
    let n = each.len() as f64;
    let mean = each.iter().sum::<f64>() / n;
    let spread = each.iter().map(|z| (z - mean).powi(2)).sum::<f64>();
    [mean, 5.0 * (spread / (n - 1.0) / n).sqrt()]
}

/// Tests error estimates with 32 samples per pixel and 24 seeds. The negative controls are marks shifted by
/// half an image, and errors multiplied by 2/3.
#[test]
#[ignore = "slow: tools/check --all"]
fn unmarked_errors_are_correct_and_marked_ones_too_small() {
    let mut seeds = statue();
    let marks: Vec<Vec<bool>> = seeds.iter().map(|(_, errors)| doubtful(errors, true)).collect();
    let lit = |marks: &[Vec<bool>], want: bool| -> Vec<Vec<bool>> {
        let pixels = seeds.iter().zip(marks);
        let chosen = pixels.map(|((_, errors), marks)| {
            let all = errors.data.iter().zip(marks);
            all.map(|(e, mark)| *e > 0.0 && *mark == want).collect()
        });
        chosen.collect()
    };
    let aside: Vec<Vec<bool>> =
        marks.iter().map(|m| (0..m.len()).map(|i| m[(i + SIZE / 2) % m.len()]).collect()).collect();
    let (unmarked, marked, aside) = (lit(&marks, false), lit(&marks, true), lit(&aside, false));
    let count = |chosen: &[Vec<bool>]| chosen.iter().flatten().filter(|c| **c).count() as f64;
    let share = count(&marked) / (count(&marked) + count(&unmarked));
    let trusted = |[variance, unsure]: [f64; 2]| (0.8 - unsure..1.25 + unsure).contains(&variance);
    let found = [&unmarked, &marked, &aside].map(|chosen| deviations(&seeds, chosen));
    println!(
        "z² of unmarked, marked, and unmarked by displaced marks, ± 5σ: {found:.3?}; marked: {share:.3}"
    );
    assert!(trusted(found[0]), "{found:?}");
    assert!(found[1][0] > 2.0 + found[1][1], "{found:?}");
    assert!(!trusted(found[2]), "displaced marks are not found: {found:?}");
    assert!((0.3..0.7).contains(&share), "{share} is marked");
    for (_, errors) in &mut seeds {
        errors.data.iter_mut().for_each(|e| *e /= 1.5);
    }
    let short = deviations(&seeds, &unmarked);
    assert!(!trusted(short), "short errors are not found: {short:?}");
}
