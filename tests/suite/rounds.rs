//! Tests renders with a target error. The results are byte-identical for any division of the work, error
//! estimates are correct, and means are unbiased.

use crate::harness::{assert_same_store, mirror_room, read, run, scene, stderr, stdout};
use crate::resume::Impatient;
use std::path::Path;
use std::sync::atomic::AtomicU32;
use sunstone::render::{Part, Render, Target, Unwatched, Watch};
use sunstone::rounds::{Goal, RoundPart, Standing, ToError, folder_of};
use sunstone::store::merge::{Options, merge};
use sunstone::store::zarr::{TensorStore, verify};
use sunstone::tensor::field::Field;
use sunstone::tensor::memory::Arrays;
use sunstone::tensor::target::Next;
use sunstone::transport::scene::Scene;

const SLICES: &str = r#"
[[slices]]
name = "sum"
[[slices]]
name = "mueller"
camera = { binned = 2 }
polarization = "mueller"
[[slices]]
name = "flight"
camera = { rows = [3, 11] }
time = { start_ps = 10000, bin_ps = 500, bins = 24 }
"#;

fn room(integrator: &str) -> Scene {
    let text = mirror_room(24, 16, 4, 4, SLICES);
    scene(&text.replacen("[render]", &format!("[render]\nintegrator = \"{integrator}\""), 1))
}

fn goal(error: f64, share: f64) -> Goal {
    Goal { slice: "sum".into(), error, share, first: 32, most: 1 << 14 }
}

fn to_error(goal: Goal, watch: &dyn Watch) -> ToError<'_> {
    ToError { goal, watch, begins: &|_: &Standing| {}, attributes: vec![], threads: 0 }
}

fn target(path: &Path, resume: bool) -> Target {
    Target { path: path.to_owned(), resume, replace: false }
}

/// Tests that a tile with any number of samples is bit-identical to the tile of a plain render with the same
/// number of samples. The test includes light subpaths.
#[test]
#[ignore = "slow: tools/check --all"]
fn a_tile_equals_that_of_a_plain_render_with_its_samples() {
    for integrator in ["path", "caustics", "bidirectional"] {
        let mut scene = room(integrator);
        scene.change_settings(|s| (s.replicates, s.spp) = (2, 24));
        let counts: Vec<u32> = (0..36).map(|tile| [0, 4, 16, 24][tile % 4]).collect();
        let own = Render::new(&scene).samples(&counts).to_arrays().expect("a render");
        for n in [4, 16, 24] {
            scene.change_settings(|s| s.spp = n);
            let plain = Render::new(&scene).to_arrays().expect("a render");
            for field in [Field::Mean, Field::StdError, Field::TotalStdError] {
                let [own, plain] = [&own, &plain].map(|a| a.get("sum", field).expect("the slice"));
                let values = own.data.len() / (24 * 24);
                let mut compared = 0;
                for (i, (a, b)) in own.data.iter().zip(&plain.data).enumerate() {
                    let (y, x) = (i / values / 24, i / values % 24);
                    if counts[y / 4 * 6 + x / 4] == n {
                        assert_eq!(a.to_bits(), b.to_bits(), "{integrator} {n} {field:?} {y} {x}");
                        compared += 1;
                    }
                }
                assert_eq!(compared, 9 * 16 * values);
            }
        }
    }
    let scene = room("path");
    let few = Render::new(&scene).samples(&[1, 2]).to_arrays().map(drop);
    assert!(few.is_err_and(|e| e.to_string().contains("36")));
}

/// Tests that an uninterrupted render, a repeatedly stopped render and a merge of parts have the same bytes,
/// with one or two threads.
#[test]
#[ignore = "slow: tools/check --all"]
fn stopped_and_merged_renders_have_the_same_bytes() {
    for integrator in ["path", "caustics"] {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let mut scene = room(integrator);
        let whole = to_error(goal(0.08, 0.9), &Unwatched);
        assert!(whole.render(&mut scene, &target(&at("whole"), false)).expect("a render").complete);
        assert!(!folder_of(&at("whole")).exists());
        assert!(verify(&at("whole")).expect("a store").faults.is_empty());
        let store = TensorStore::open(&at("whole")).expect("a store");
        let message = store.attributes()["target"].clone();
        let number = |key: &str| message[key].as_f64().expect("a number");
        assert!(number("rounds") >= 2.0 && number("reached") <= 0.08, "{message}");
        let counts = store.read_samples([0, 0], [24, 24]).expect("counts");
        let mean = counts.iter().map(|n| f64::from(*n)).sum::<f64>() / 576.0;
        assert!((mean - number("mean_samples_per_pixel")).abs() < 0.1, "{mean} {message}");
        assert!(counts.iter().max() > counts.iter().min());

        // The result of a render to a target error merges with a plain render of another seed. The merged
        // store does not record the target error.
        scene.change_settings(|s| s.seed = 77);
        Render::new(&scene).to_store(&at("plain")).expect("a render");
        scene.change_settings(|s| s.seed = 0);
        merge(&[at("whole"), at("plain")], &at("both"), Options::default()).unwrap_or_else(|e| panic!("{e}"));
        let both = TensorStore::open(&at("both")).expect("a store");
        let sum = both.read_samples([0, 0], [24, 24]).expect("counts");
        assert!(sum.iter().zip(&counts).all(|(sum, own)| *sum == own + 4));
        assert!(!both.attributes().contains_key("target"));

        let one = ToError { threads: 1, ..to_error(goal(0.08, 0.9), &Unwatched) };
        one.render(&mut scene, &target(&at("one"), false)).expect("a render");
        assert_same_store(&at("whole"), &at("one"));

        let mut stops = 0;
        loop {
            let watch = Impatient { tiles: 17, done: AtomicU32::new(0) };
            let part =
                to_error(goal(0.08, 0.9), &watch).render(&mut scene, &target(&at("stopped"), stops > 0));
            if part.expect("a part").complete {
                break;
            }
            stops += 1;
            let again = whole.render(&mut scene, &target(&at("stopped"), false));
            assert!(again.is_err_and(|e| e.to_string().contains("--resume")));
        }
        assert!(stops >= 3, "{stops}");
        assert_same_store(&at("whole"), &at("stopped"));
        // The program does not render a finished store again. A render with another target error is a
        // different render.
        let again = whole.render(&mut scene, &target(&at("stopped"), true)).expect("a store");
        assert!(again.complete && again.samples == 0);
        let other = to_error(goal(0.2, 0.7), &Unwatched).render(&mut scene, &target(&at("stopped"), true));
        assert!(other.is_err_and(|e| e.to_string().contains("differ in target")));

        let rounds = folder_of(&at("joined"));
        for round in 0.. {
            let standing = whole.standing(&scene, &rounds, None).expect("rounds");
            assert_eq!(standing.round, round);
            if !matches!(standing.next, Next::Round(_)) {
                break;
            }
            let light = at(&format!("light{round}"));
            let parts = [1, 2].map(|number| {
                let (path, part) = (at(&format!("{round}-{number}")), Part::Share { number, of: 2 });
                let part = RoundPart { part, light: Some(&light) };
                let made = whole.part_of_round(&mut scene, &rounds, round, part, &target(&path, false));
                assert!(made.expect("a part").complete);
                path
            });
            std::fs::create_dir_all(&rounds).expect("a folder");
            merge(&parts, &rounds.join(format!("{round}.zarr")), Options::default())
                .unwrap_or_else(|e| panic!("{e}"));
        }
        whole.render(&mut scene, &target(&at("joined"), true)).expect("a render");
        assert_same_store(&at("whole"), &at("joined"));
    }
}

/// The total of each pixel, and the standard error of each total.
#[derive(Clone)]
struct Image {
    means: Vec<f64>,
    errors: Vec<f64>,
}

impl Image {
    fn of(mean: &[f32], error: &[f32]) -> Self {
        let lanes = mean.len() / error.len();
        let total = |values: &[f32]| values.iter().map(|v| f64::from(*v)).sum::<f64>() / lanes as f64;
        Self {
            means: mean.chunks(lanes).map(total).collect(),
            errors: error.iter().map(|e| f64::from(*e)).collect(),
        }
    }

    /// Returns the weighted sums of independent images of the same pixels.
    fn pooled(images: &[Self], weights: &[f64]) -> Self {
        let sum: f64 = weights.iter().sum();
        let of = |f: &dyn Fn(&Self, f64) -> f64| {
            images.iter().zip(weights).map(|(i, w)| f(i, w / sum)).sum::<f64>()
        };
        let pixels = 0..images[0].means.len();
        Self {
            means: pixels.clone().map(|p| of(&|i, w| w * i.means[p])).collect(),
            errors: pixels.map(|p| of(&|i, w| (w * i.errors[p]).powi(2)).sqrt()).collect(),
        }
    }
}

/// Results of a comparison of many renders with the ground truth.
#[derive(Debug)]
struct Verdict {
    /// Mean deviation of lit pixels from the ground truth, divided by the standard error of this mean
    /// deviation.
    bias: f64,
    /// Mean square of the deviation divided by the stated error.
    z2: f64,
}

impl Verdict {
    fn of(renders: &[Image], truth: &[Image]) -> Self {
        let all = Image::pooled(truth, &vec![1.0; truth.len()]);
        let bright = all.means.iter().fold(0.0, |a: f64, b| a.max(*b));
        let lit: Vec<usize> = (0..all.means.len()).filter(|p| all.means[*p] > 0.01 * bright).collect();
        // Pixels with small errors have the largest weights.
        let off = |i: &Image| lit.iter().map(|p| (i.means[*p] - all.means[*p]) / all.errors[*p]).sum::<f64>();
        let moments = |images: &[Image]| {
            let n = images.len() as f64;
            let mean = images.iter().map(off).sum::<f64>() / n;
            (mean, images.iter().map(|i| (off(i) - mean).powi(2)).sum::<f64>() / (n - 1.0) / n)
        };
        let ((mean, variance), (_, of_truth)) = (moments(renders), moments(truth));
        let z2 = |i: &Image| {
            let z2 = |p: &usize| {
                (i.means[*p] - all.means[*p]).powi(2) / (i.errors[*p].powi(2) + all.errors[*p].powi(2))
            };
            lit.iter().map(z2).sum::<f64>() / lit.len() as f64
        };
        Self {
            bias: mean / (variance + of_truth).sqrt(),
            z2: renders.iter().map(z2).sum::<f64>() / renders.len() as f64,
        }
    }

    fn is_honest(&self) -> bool {
        self.bias.abs() < 5.0 && (0.8..1.25).contains(&self.z2)
    }
}

/// Tests, over 32 seeds, that means equal those of plain renders with other seeds (5 sigma). Tests that
/// deviations agree with the stated errors.
///
/// The same comparison must detect two negative controls. If single pixels stop by their own errors, means
/// are biased. If weights ignore the numbers of samples, errors are wrong.
#[test]
#[ignore = "slow: tools/check --all"]
fn stated_errors_match_actual_errors() {
    const SEEDS: u64 = 32;
    const ROUNDS: u64 = 8;
    let text = mirror_room(32, 16, 32, 8, "[[slices]]\nname = \"sum\"\n");
    let mut scene = scene(&text.replacen("[render]", "[render]\nintegrator = \"path\"", 1));
    let folder = tempfile::tempdir().expect("a folder");
    let mut mean = 0.0;
    let mut rounds = 0.0;
    let mut counts: Vec<Vec<u32>> = vec![];
    let renders: Vec<Image> = (0..SEEDS)
        .map(|seed| {
            scene.change_settings(|s| s.seed = 1000 + seed);
            let path = folder.path().join(seed.to_string());
            let run = to_error(goal(0.05, 0.7), &Unwatched);
            run.render(&mut scene, &target(&path, false)).expect("a render");
            let store = TensorStore::open(&path).expect("a store");
            let message = &store.attributes()["target"];
            mean += message["mean_samples_per_pixel"].as_f64().unwrap_or(0.0) / SEEDS as f64;
            rounds += message["rounds"].as_f64().unwrap_or(0.0) / SEEDS as f64;
            // Collects the number of samples of the first pixel of each tile.
            let samples = store.read_samples([0, 0], [32, 32]).expect("counts");
            counts.push((0..16).map(|tile| samples[tile / 4 * 8 * 32 + tile % 4 * 8]).collect());
            let [mean, error] = [Field::Mean, Field::TotalStdError].map(|f| read(&store, "sum", f).data);
            Image::of(&mean, &error)
        })
        .collect();
    // Plain renders are the truth and the input of the negative controls.
    let image = |arrays: &Arrays| {
        let [mean, error] =
            [Field::Mean, Field::TotalStdError].map(|f| arrays.get("sum", f).expect("it").data);
        Image::of(&mean, &error)
    };
    scene.change_settings(|s| s.spp = 32);
    let plain: Vec<Image> = (0..SEEDS * ROUNDS)
        .map(|seed| {
            scene.change_settings(|s| s.seed = 100_000 + seed);
            image(&Render::new(&scene).to_arrays().expect("a render"))
        })
        .collect();
    let verdict = Verdict::of(&renders, &plain);
    println!("{mean:.0} samples in {rounds:.1} rounds: {verdict:?}");
    assert!(verdict.is_honest() && rounds > 2.0, "{verdict:?}");

    let sets = plain.chunks(ROUNDS as usize);
    // Renders the same numbers of samples in the same tiles, with another seed.
    let same: Vec<Image> = counts
        .iter()
        .zip(50_000..)
        .map(|(counts, seed)| {
            scene.change_settings(|s| (s.seed, s.spp) = (seed, counts.iter().copied().max().unwrap_or(0)));
            image(&Render::new(&scene).samples(counts).to_arrays().expect("a render"))
        })
        .collect();
    let same = Verdict::of(&same, &plain);
    println!("the same numbers of other samples: {same:?}");
    assert!(same.is_honest() && (verdict.z2 - same.z2).abs() < 0.06, "{verdict:?}, {same:?}");

    let greedy: Vec<Image> = sets
        .clone()
        .map(|set| {
            let upto: Vec<Image> = (1..=set.len()).map(|n| Image::pooled(&set[..n], &vec![1.0; n])).collect();
            let stop = |p: usize| {
                upto.iter().find(|i| i.errors[p] <= 0.1 * i.means[p]).unwrap_or(&upto[set.len() - 1])
            };
            let pixels = 0..set[0].means.len();
            Image {
                means: pixels.clone().map(|p| stop(p).means[p]).collect(),
                errors: pixels.map(|p| stop(p).errors[p]).collect(),
            }
        })
        .collect();
    let verdict = Verdict::of(&greedy, &plain);
    println!("pixels that stop by themselves: {verdict:?}");
    assert!(!verdict.is_honest(), "{verdict:?}");

    let unweighted: Vec<Image> = sets
        .map(|set| {
            let two = [set[0].clone(), Image::pooled(&set[1..], &[1.0; 7])];
            Image {
                means: Image::pooled(&two, &[1.0, 1.0]).means,
                errors: Image::pooled(&two, &[1.0, 7.0]).errors,
            }
        })
        .collect();
    let verdict = Verdict::of(&unweighted, &plain);
    println!("weights that ignore counts: {verdict:?}");
    assert!(!verdict.is_honest(), "{verdict:?}");
}

#[test]
fn the_command_reports_the_reached_error_and_invalid_options() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("scene.toml"), mirror_room(24, 16, 4, 8, SLICES)).expect("a file");
    let words = ["render", "scene.toml", "--integrator", "path", "--no-figures", "--target-error", "0.1"];
    let with = |more: &[&str], code| run(folder.path(), &[&words[..], more].concat(), code);
    let message = stdout(&with(&["--spp", "32", "-o", "s"], 0));
    assert!(message.contains("median") && message.contains("rounds"), "{message}");
    let message = stdout(&run(folder.path(), &["info", "s"], 0));
    assert!(message.contains("target") && message.contains("slice sum"), "{message}");
    let most = ["--most-spp", "64", "-o", "most"];
    let message = stdout(&run(folder.path(), &[&words[..6], &["0.001"][..], &most].concat(), 0));
    assert!(message.contains("--most-spp 64") && message.contains("above the target of 0.10 %"), "{message}");
    for (more, fix) in [
        (&["--target-slice", "none"][..], "sum, mueller, flight"),
        (&["--target-share", "1.5"], "--target-share"),
        (&["--spp", "2"], "--spp"),
        (&["--most-spp", "8"], "--most-spp"),
        (&["--part", "1/2"], "--rounds"),
    ] {
        let out = with(&[more, &["-o", "t"]].concat(), 2);
        assert!(stderr(&out).contains(fix), "{}", stderr(&out));
        assert!(!at("t").exists());
    }
}

/// Tests that the program never removes files in the folder of the rounds that are not rounds. Tests that
/// rounds that another process is writing are not removed.
#[test]
fn other_files_are_kept_and_only_one_process_renders() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("scene.toml"), mirror_room(24, 16, 4, 8, SLICES)).expect("a file");
    let words = ["render", "scene.toml", "--no-figures", "--target-error", "0.5", "-o"];
    let with = |more: &[&str], code| run(folder.path(), &[&words[..], more].concat(), code);
    std::fs::create_dir_all(at("s.rounds")).expect("a folder");
    std::fs::write(at("s.rounds/thesis.tex"), "years of work").expect("a file");
    let message = stderr(&with(&["s", "--force"], 2));
    assert!(message.contains("thesis.tex") && message.contains("another name"), "{message}");
    assert!(at("s.rounds/thesis.tex").exists() && !at("s").exists());
    // While another process writes the rounds, `--force` removes nothing.
    std::fs::create_dir_all(at("t.rounds/0.zarr")).expect("a folder");
    let held = sunstone::base::lock::Lock::take(&at("t.rounds")).expect("nobody is there");
    let message = stderr(&with(&["t", "--force"], 2));
    assert!(message.contains("being written by process"), "{message}");
    assert!(at("t.rounds/0.zarr").exists());
    drop(held);
    with(&["t", "--force"], 0);
    assert!(at("t").exists() && !at("t.rounds").exists());
}
