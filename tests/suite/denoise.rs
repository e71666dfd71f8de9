//! Tests that denoised stores are closer to the converged render than their input, and have correct errors
//! and physical matrices. Tests that commands refuse a denoised store as a reference.

use crate::harness::{assert_same_store, mirror_room, read, refusals, run, stderr, stdout, sunstone};
use std::path::Path;
use sunstone::denoise::denoise_in_bands;
use sunstone::polarimetry::decompose::cloude;
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::field::Field;

const SLICES: &str = r#"
[[slices]]
name = "mueller"
polarization = "mueller"
[[slices]]
name = "nonepipolar"
projector.nonepipolar = { half_width_px = 1.5 }
polarization = "mueller"
[[slices]]
name = "flight"
time = { start_ps = 13000, bin_ps = 200, bins = 80 }
"#;

const SIZE: usize = 64;
/// Number of values per pixel, which is the number of elements times the number of wavelengths.
const NUMBERS: usize = 48;
/// Number of samples of the converged render, divided by the number of samples of each noisy render.
const CONVERGED: f64 = 64.0;

fn render(at: &Path, seed: &str, spp: &str, store: &str) {
    // The samples are independent. Standard errors are therefore valid for renders with fewer samples.
    let options = ["--seed", seed, "--spp", spp, "--replicates", spp, "--no-figures", "-o", store];
    run(at, &[&["render", "scene.toml"], &options[..]].concat(), 0);
}

fn fields(at: &Path, store: &str, slice: &str) -> [Vec<f64>; 2] {
    let store = TensorStore::open(&at.join(store)).expect("a store");
    let numbers = |t: Tensor| t.data.into_iter().map(f64::from).collect();
    [Field::Mean, Field::StdError].map(|f| numbers(read(&store, slice, f)))
}

/// Comparison of a denoised slice with the converged slice.
#[derive(Debug)]
struct Judged {
    /// Mean squared error before denoising, divided by the mean squared error after denoising, over all
    /// values. The noise of the converged render is subtracted from each error.
    gain: f64,
    /// The ratio `gain` without the 5 % of the pixels with the largest errors in the converged render.
    quiet: f64,
    half: f64,
    /// Root mean square, over all values, of the deviation divided by the stated error.
    z: f64,
    z00: f64,
    /// Relative deviation of Σ M00 from Σ M00 of the converged render.
    bias: f64,
    /// Relative deviation of the input's Σ M00 from Σ M00 of the converged render.
    before: f64,
    /// Fraction of a step between adjacent pixels that remains after denoising. Only steps that are visible
    /// with 16 samples count.
    step: f64,
    edges: usize,
    /// Smallest eigenvalue of the coherency matrix divided by M00.
    least: f64,
}

fn judge(at: &Path, made: &str, renders: &[&str], slice: &str) -> Judged {
    let [truth, unsure] = fields(at, "converged.zarr", slice);
    let [mean, error] = fields(at, made, slice);
    let all: Vec<Vec<f64>> = renders.iter().map(|r| fields(at, r, slice)[0].clone()).collect();
    let raw: Vec<f64> =
        (0..truth.len()).map(|i| all.iter().map(|r| r[i]).sum::<f64>() / all.len() as f64).collect();
    let square = |a: &[f64], i: usize| (a[i] - truth[i]).powi(2);
    // Sorts the pixels by the error of the converged render, with the largest error last.
    let doubt = |p: usize| unsure[p * NUMBERS..(p + 1) * NUMBERS].iter().map(|e| e * e).sum::<f64>();
    let mut pixels: Vec<usize> = (0..SIZE * SIZE).collect();
    pixels.sort_by(|a, b| doubt(*a).total_cmp(&doubt(*b)));
    let sum = |a: &[f64], part: f64| -> f64 {
        let some = &pixels[..(part * pixels.len() as f64) as usize];
        let numbers = some.iter().flat_map(|p| p * NUMBERS..(p + 1) * NUMBERS);
        numbers.map(|i| square(a, i) - unsure[i].powi(2)).sum()
    };
    let gain = |part: f64| sum(&raw, part) / sum(&mean, part);
    let z = |numbers: &dyn Fn(usize) -> bool| {
        let some = (0..truth.len()).filter(|i| numbers(i % NUMBERS) && error[*i] > 0.0);
        let all = some.map(|i| square(&mean, i) / (error[i].powi(2) + unsure[i].powi(2)));
        let (n, sum) = all.fold((0.0, 0.0), |(n, sum), z| (n + 1.0, sum + z));
        (sum / n).sqrt()
    };
    let light = |a: &[f64]| a.chunks(NUMBERS).map(|m| m[1]).sum::<f64>();
    // Selects pairs of adjacent pixels in a row, at 550 nm, whose step exceeds three times the noise of 16
    // samples.
    let step = |a: &[f64], p: usize| a[(p + 1) * NUMBERS + 1] - a[p * NUMBERS + 1];
    let noise = |p: usize| unsure[p * NUMBERS + 1].hypot(unsure[(p + 1) * NUMBERS + 1]) * CONVERGED.sqrt();
    let pairs: Vec<usize> = (0..SIZE * SIZE - 1)
        .filter(|p| (p + 1) % SIZE > 0 && step(&truth, *p).abs() > 3.0 * noise(*p))
        .collect();
    let edge = |a: &[f64]| pairs.iter().map(|p| step(a, *p) * step(&truth, *p)).sum::<f64>();
    let least = (0..SIZE * SIZE * 3).map(|i| {
        let (p, lane) = (i / 3, i % 3);
        let element = |c: usize| mean[p * NUMBERS + 3 * c + lane];
        let matrix: cloude::Matrix = [0, 1, 2, 3].map(|r| [0, 1, 2, 3].map(|c| element(4 * r + c)));
        cloude::eigenvalues(&matrix).expect("finite")[3] / element(0).max(1e-12)
    });
    Judged {
        gain: gain(1.0),
        quiet: gain(0.95),
        half: gain(0.5),
        z: z(&|_| true),
        z00: z(&|c| c < 3),
        bias: light(&mean) / light(&truth) - 1.0,
        before: light(&raw) / light(&truth) - 1.0,
        step: edge(&mean) / edge(&truth),
        edges: pairs.len(),
        least: least.fold(0.0, f64::min),
    }
}

/// Compares renders of 64 × 64 pixels with 16 samples and with 1024 samples per pixel. A few tens of pixels
/// on the glossy knot cause most of the squared error. The image contains no similar pixels for averaging.
/// Denoising therefore reduces the mean squared error over all pixels far less than the error without the
/// noisiest 5 % of the pixels.
#[test]
#[ignore = "slow: tools/check --all"]
fn denoising_reduces_the_error_and_states_it_correctly() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let size = SIZE as u32;
    std::fs::write(at.join("scene.toml"), mirror_room(size, size, 16, 16, SLICES)).expect("a scene");
    render(at, "1", "16", "a.zarr");
    render(at, "2", "16", "b.zarr");
    render(at, "3", "1024", "converged.zarr");
    run(at, &["denoise", "a.zarr", "-o", "one.zarr"], 0);
    run(at, &["denoise", "a.zarr", "b.zarr", "-o", "two.zarr"], 0);
    for (made, renders) in [("one.zarr", &["a.zarr"][..]), ("two.zarr", &["a.zarr", "b.zarr"])] {
        for slice in ["mueller", "nonepipolar"] {
            let judged = judge(at, made, renders, slice);
            println!("{made} {slice}: {judged:.4?}");
            // For two renders, the result is compared with their mean, which has half of the error variance.
            let least_gain = 4.0 - renders.len() as f64;
            assert!(judged.gain > 1.1 && judged.quiet > least_gain && judged.half > least_gain);
            assert!((0.7..1.4).contains(&judged.z) && (0.7..1.4).contains(&judged.z00));
            assert!(judged.bias.abs() < 0.02 && (judged.bias - judged.before).abs() < 0.02);
            assert!(judged.edges > 9 && (judged.step - 1.0).abs() < 0.1);
            assert!(judged.least > -1e-5);
        }
    }
    // Slices of light in flight have few samples per bin. The gain is smaller, but no value becomes worse.
    for (made, renders) in [("one.zarr", &["a.zarr"][..]), ("two.zarr", &["a.zarr", "b.zarr"])] {
        let [truth, unsure] = fields(at, "converged.zarr", "flight");
        let [mean, error] = fields(at, made, "flight");
        let all: Vec<Vec<f64>> = renders.iter().map(|r| fields(at, r, "flight")[0].clone()).collect();
        let [mut before, mut after, mut z, mut n] = [0.0; 4];
        for i in 0..truth.len() {
            let raw = all.iter().map(|r| r[i]).sum::<f64>() / all.len() as f64;
            let own = unsure[i].powi(2);
            before += (raw - truth[i]).powi(2) - own;
            after += (mean[i] - truth[i]).powi(2) - own;
            if error[i] > 0.0 {
                z += (mean[i] - truth[i]).powi(2) / (error[i].powi(2) + own);
                n += 1.0;
            }
        }
        let z: f64 = (z / n).sqrt();
        println!("{made} flight: gain {:.3}, z {z:.3}", before / after);
        assert!(before > after && (0.7..1.4).contains(&z));
    }
    // Negative control: weights that ignore the similarity of pixels fail the test.
    let mut flat = fields(at, "a.zarr", "mueller")[0].clone();
    let [truth, _] = fields(at, "converged.zarr", "mueller");
    let old = flat.clone();
    for p in SIZE..SIZE * (SIZE - 1) {
        for c in 0..NUMBERS {
            let near = [p - SIZE, p - 1, p, p + 1, p + SIZE];
            flat[p * NUMBERS + c] = near.iter().map(|q| old[q * NUMBERS + c]).sum::<f64>() / 5.0;
        }
    }
    let off = |a: &[f64]| a.iter().zip(&truth).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    assert!(off(&flat) > 2.0 * off(&old), "a blur is no denoiser");
}

const SMALL: &str = r#"
[[slices]]
name = "mueller"
polarization = "mueller"
[[slices]]
name = "flight"
time = { start_ps = 12000, bin_ps = 500, bins = 20 }
polarization = "mueller"
[[slices]]
name = "coarse"
camera = { binned = 4 }
bounces = true
[[slices]]
name = "rows"
camera = { rows = [1, 2, 6] }
[[figures]]
name = "photo"
view.photo = { slice = "mueller" }
"#;

#[test]
#[ignore = "slow: tools/check --all"]
fn bits_depend_on_neither_threads_nor_bands() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), mirror_room(40, 16, 8, 8, SMALL)).expect("a scene");
    render(at, "1", "8", "a.zarr");
    render(at, "2", "8", "b.zarr");
    for (threads, store) in [("1", "one.zarr"), ("3", "three.zarr")] {
        let done = sunstone(at, &["denoise", "a.zarr", "b.zarr", "-o", store])
            .env("RAYON_NUM_THREADS", threads)
            .status();
        assert!(done.expect("the program runs").success());
    }
    assert_same_store(&at.join("one.zarr"), &at.join("three.zarr"));
    // Uses the smallest possible bands, of 16 rows.
    let inputs = ["a.zarr", "b.zarr"].map(|name| at.join(name));
    denoise_in_bands(&inputs, &at.join("bands.zarr"), false, 1).expect("a store");
    let [whole, bands] = ["one.zarr", "bands.zarr"].map(|s| TensorStore::open(&at.join(s)).expect("a store"));
    for name in whole.slice_names() {
        let slice = whole.slice(name).expect("a slice");
        for field in Field::ALL.into_iter().filter(|f| slice.has(*f)) {
            assert_eq!(read(&whole, name, field).data, read(&bands, name, field).data, "{name} {field:?}");
        }
    }
    // Rows that are not adjacent are not mixed. Row 6 alone gives the same result as row 6 with other rows.
    let rows = read(&whole, "rows", Field::Mean);
    let lone = SMALL.replace("rows = [1, 2, 6]", "rows = [6]");
    std::fs::write(at.join("scene.toml"), mirror_room(40, 16, 8, 8, &lone)).expect("a scene");
    render(at, "1", "8", "c.zarr");
    render(at, "2", "8", "d.zarr");
    run(at, &["denoise", "c.zarr", "d.zarr", "-o", "lone.zarr"], 0);
    let lone = read(&TensorStore::open(&at.join("lone.zarr")).expect("a store"), "rows", Field::Mean);
    assert_eq!(rows.data[2 * lone.data.len()..], lone.data[..]);
}

#[test]
fn denoised_stores_are_marked_and_refused_as_references() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), mirror_room(16, 16, 4, 8, SMALL)).expect("a scene");
    render(at, "1", "4", "a.zarr");
    render(at, "2", "4", "b.zarr");
    let done = run(at, &["denoise", "a.zarr", "b.zarr", "-o", "d.zarr"], 0);
    assert!(stdout(&done).contains("error estimates"));
    let info = stdout(&run(at, &["info", "d.zarr"], 0));
    assert!(
        info.contains("denoised") && info.contains("non-local means") && info.contains("a.zarr"),
        "{info}"
    );
    // Commands that display or analyze stores accept the denoised store.
    run(at, &["verify", "d.zarr"], 0);
    run(at, &["figure", "d.zarr", "--format", "svg"], 0);
    let text = std::fs::read_to_string(at.join("d.figures/photo.svg")).expect("a figure");
    assert!(text.contains("denoised"), "the title does not say it");
    run(at, &["decompose", "d.zarr", "mueller", "-o", "d.npz"], 0);
    run(at, &["probe", "d.zarr", "mueller", "--sum", "y", "-o", "sum.zarr"], 0);
    // Commands that would use the denoised store as a reference refuse the store.
    run(at, &["scheme", "drr", "-k", "36", "-o", "drr.toml"], 0);
    let refused: [&[&str]; 7] = [
        &["merge", "d.zarr", "a.zarr", "-o", "m.zarr"],
        &["merge", "a.zarr", "d.zarr", "-o", "m.zarr"],
        &["render", "scene.toml", "--spp", "4", "--seed", "1", "-o", "d.zarr", "--resume"],
        &["capture", "d.zarr", "mueller", "--scheme", "drr.toml", "-o", "I.npy"],
        &["trial", "d.zarr", "mueller", "--scheme", "drr.toml"],
        &["trial", "sum.zarr", "mueller", "--scheme", "drr.toml"],
        &["denoise", "d.zarr", "-o", "m.zarr"],
    ];
    for arguments in refused {
        let message = stderr(&run(at, arguments, 2));
        assert!(message.contains("is denoised") && message.contains("a.zarr"), "{arguments:?}: {message}");
        assert!(!at.join("m.zarr").exists(), "{arguments:?}");
    }
    run(at, &["merge", "a.zarr", "b.zarr", "-o", "m.zarr"], 0);
    // Denoising copies a slice without an image, and does not change a slice without standard errors.
    run(at, &["probe", "a.zarr", "mueller", "--sum", "y", "-o", "profile.zarr"], 0);
    let done = run(at, &["denoise", "profile.zarr", "-o", "copy.zarr"], 0);
    assert!(stdout(&done).contains("copied"));
    let [from, to] = ["profile.zarr", "copy.zarr"].map(|s| TensorStore::open(&at.join(s)).expect("a store"));
    assert_eq!(read(&from, "mueller", Field::Mean).data, read(&to, "mueller", Field::Mean).data);
    // The sample counts of the denoised store are the sums of the sample counts of the two inputs.
    let made = TensorStore::open(&at.join("d.zarr")).expect("a store");
    assert!(made.read_samples([0, 0], [16, 16]).expect("counts").iter().all(|n| *n == 8));
    assert_eq!(made.attributes()["seeds"], serde_json::json!([1, 2]));
}

#[test]
fn invalid_inputs_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    std::fs::write(at.join("scene.toml"), mirror_room(8, 8, 4, 8, SMALL)).expect("a scene");
    render(at, "1", "4", "a.zarr");
    render(at, "2", "4", "b.zarr");
    refusals(
        at,
        &[
            ("denoise a.zarr -o a.zarr --force", "both an input"),
            ("denoise a.zarr a.zarr -o d.zarr", "seed 1"),
            ("denoise a.zarr b.zarr a.zarr -o d.zarr", "'a.zarr'"),
            ("denoise a.zarr -o b.zarr", "b.zarr"),
            ("denoise missing.zarr -o d.zarr", "does not exist"),
        ],
    );
    std::fs::remove_file(at.join("b.zarr/manifest.txt")).expect("a manifest");
    refusals(at, &[("denoise b.zarr -o d.zarr", "finish"), ("denoise a.zarr b.zarr -o d.zarr", "finish")]);
}
