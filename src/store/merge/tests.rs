//! Compares pooled values with the values that all samples together have.

use super::*;
use crate::damage::copy;
use crate::zarr::tests::files;
use tensor::axes::Extents;
use tensor::slice::{CameraSelect, Polarization, ProjectorSelect, Slice, TimeSelect};

const SAMPLES: [usize; 3] = [5, 1, 11];

fn layout(camera: CameraSelect) -> SliceLayout {
    let extents = Extents {
        camera: [5, 3],
        projector: None,
        wavelengths_nm: vec![450.0, 660.0],
        max_depth: 2,
        tile: 2,
    };
    let slice = Slice {
        name: "s".into(),
        camera,
        projector: ProjectorSelect::Sum,
        time: TimeSelect::Bins { start_ps: 0.0, bin_ps: 1.0, bins: 3 },
        polarization: Polarization::Intensity,
        bounces: false,
        split_first_bounce: false,
        labels: false,
    };
    SliceLayout::new(&slice, &extents)
}

fn value(element: usize, sample: usize) -> f64 {
    let x = (element as f64 * 12.9898 + sample as f64 * 78.233).sin() * 43758.5453;
    1.0 + (x - x.floor()) * (1.0 + element as f64)
}

fn statistics(values: &[f64]) -> (f32, f32) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let m2: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean as f32, if n > 1.0 { (m2 / (n * (n - 1.0))).sqrt() as f32 } else { 0.0 })
}

/// Writes a store whose elements contain the values of the samples with the indices `from..from + n`.
fn part(path: &Path, seed: u64, from: usize, n: usize, sha: &str, counted: bool) {
    let attributes = json!({"scene_sha256": sha, "seeds": [seed], "samples_per_pixel": n,
        "discarded_samples": 1, "wall_time_s": 0.5, "version": "x"});
    let grid = counted.then_some(SampleGrid { camera: [5, 3], tile: 2 });
    let group = json!({"pixels_per_element": 1}).as_object().unwrap().clone();
    let slices = [(layout(CameraSelect::All), group)];
    let store = TensorStore::create(path, &slices, attributes.as_object().unwrap(), grid, false).unwrap();
    let slice = store.slice("s").unwrap();
    for (offset, mean, error) in
        [(0, Field::Mean, Field::StdError), (1000, Field::Overflow, Field::OverflowStdError)]
    {
        let shape = slice.field_layout(mean).unwrap().shape();
        let zero = vec![0; shape.len()];
        let (m, e): (Vec<f32>, Vec<f32>) = (0..region::volume(&shape).unwrap())
            .map(|i| {
                let values: Vec<f64> = (from..from + n).map(|s| value(i + offset, s)).collect();
                statistics(&values)
            })
            .unzip();
        slice.write(mean, &zero, &shape, &m).unwrap();
        slice.write(error, &zero, &shape, &e).unwrap();
    }
    // There are 15 camera elements with 3 time bins, overflow and 2 wavelengths.
    let totals: Vec<f32> = (0..15)
        .map(|element| {
            let of = |s| {
                let inside: f64 = (0..6).map(|i| value(6 * element + i, s)).sum();
                let outside: f64 = (0..2).map(|i| value(1000 + 2 * element + i, s)).sum();
                (inside + outside) / 2.0
            };
            statistics(&(from..from + n).map(of).collect::<Vec<f64>>()).1
        })
        .collect();
    slice.write(Field::TotalStdError, &[0, 0], &[3, 5], &totals).unwrap();
    if counted {
        store.write_samples([0, 0], [3, 5], &[n as u32; 15]).unwrap();
    }
    store.finish().unwrap();
}

#[test]
fn parts_merge_to_the_whole() {
    for counted in [false, true] {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let mut from = 0;
        let mut inputs = Vec::new();
        for (i, n) in SAMPLES.into_iter().enumerate() {
            inputs.push(at(&format!("part{i}")));
            part(&inputs[i], i as u64, from, n, "a", counted);
            from += n;
        }
        part(&at("whole"), 9, 0, from, "a", counted);
        merge(&inputs, &at("merged"), Options::default()).unwrap();
        let whole = TensorStore::open(&at("whole")).unwrap();
        let merged = TensorStore::open(&at("merged")).unwrap();
        for field in Field::ALL {
            let a = whole.slice("s").unwrap().read_all(field).unwrap();
            let b = merged.slice("s").unwrap().read_all(field).unwrap();
            for (x, y) in a.data.iter().zip(&b.data) {
                let tolerance = if matches!(field, Field::Mean | Field::Overflow) {
                    2e-7
                } else if field == Field::TotalStdError {
                    // The tolerance is larger because the means of totals are sums of rounded values.
                    1e-5
                } else {
                    1e-6
                };
                assert!((x - y).abs() <= tolerance * x.abs(), "{field:?} {x} {y}");
            }
        }
        let attributes = merged.attributes();
        assert_eq!(attributes["seeds"], json!([0, 1, 2]));
        assert_eq!(attributes["samples_per_pixel"], 17);
        assert_eq!(attributes["discarded_samples"], 3);
        assert_eq!(attributes["wall_time_s"], 1.5);
        assert_eq!(attributes["merged_from"].as_array().unwrap().len(), 3);
        if counted {
            assert_eq!(merged.read_samples([0, 0], [3, 5]).unwrap(), [17; 15]);
        }
    }
}

/// Verifies that a merged store has no errors of totals if an input of an earlier version has none.
#[test]
fn fields_missing_in_one_input_are_dropped() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    part(&at("a"), 1, 0, 4, "a", true);
    part(&at("b"), 2, 4, 4, "a", true);
    std::fs::remove_dir_all(at("b").join("s/total_std_error")).unwrap();
    crate::zarr::reseal(&at("b"));
    let slice = |name: &str| TensorStore::open(&at(name)).unwrap().slice("s").unwrap();
    assert!(slice("a").has(Field::TotalStdError) && !slice("b").has(Field::TotalStdError));
    for (first, second, out) in [("a", "b", "ab"), ("b", "a", "ba")] {
        merge(&[at(first), at(second)], &at(out), Options::default()).unwrap();
        let merged = slice(out);
        assert!(!merged.has(Field::TotalStdError));
        assert!(merged.read_all(Field::Mean).unwrap().data.iter().all(|v| *v > 0.0));
        assert_eq!(crate::doubt::of(&merged).unwrap(), None);
    }
}

#[test]
fn pooling_is_exact_to_a_millionth() {
    for split in [1, 2, 7, 16] {
        let values: Vec<f64> = (0..17).map(|s| value(3, s)).collect();
        let (a, b) = values.split_at(split);
        let mut pool = Pool::default();
        for part in [a, b] {
            let (m, e) = statistics(part);
            pool.add(part.len() as f64, f64::from(m), f64::from(e), true);
        }
        let (m, e) = statistics(&values);
        assert!((pool.mean / f64::from(m) - 1.0).abs() < 1e-6);
        assert!((pool.std_error(true) / f64::from(e) - 1.0).abs() < 1e-6, "{split}");
    }
}

#[test]
fn binned_elements_weigh_by_samples() {
    let mut pool = Pool::default();
    pool.add(30.0, 2.0, 0.5, false);
    pool.add(0.0, 99.0, 99.0, false);
    pool.add(10.0, 6.0, 1.0, false);
    assert!((pool.mean - 3.0).abs() < 1e-12);
    assert!((pool.std_error(false) - (15.0_f64.powi(2) + 100.0).sqrt() / 40.0).abs() < 1e-12);
    let centres = layout(CameraSelect::Binned { nx: 2, ny: 2 }).axes[1].coords.clone();
    assert_eq!(axes::boxes(&centres), Ok(vec![(0, 1), (2, 3), (4, 4)]));
}

#[test]
fn different_scenes_and_equal_seeds_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    part(&at("a"), 1, 0, 4, "a", false);
    part(&at("b"), 2, 0, 4, "b", false);
    part(&at("c"), 1, 0, 4, "a", true);
    let error =
        |x: &str, y: &str| merge(&[at(x), at(y)], &at("out"), Options::default()).unwrap_err().to_string();
    assert!(error("a", "b").contains("different scenes"));
    assert!(error("a", "c").contains("seed 1"));
    assert!(error("a", "a").contains("seed 1"));
    assert!(error("a", "none").contains("does not exist"));
    assert!(matches!(merge(&[at("a")], &at("out"), Options::default()), Err(MergeError::TooFew)));
    assert!(!at("out").exists());
}

/// Verifies that a slice whose row coordinates do not increase cannot be opened, and that the message
/// contains the path of the store.
#[test]
fn rows_that_do_not_increase_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    for (i, name) in ["a", "b"].into_iter().enumerate() {
        part(&at(name), i as u64, 4 * i, 4, "a", true);
        let rows: [f64; 3] = [2.0, 1.0, 0.0];
        let bytes: Vec<u8> = rows.iter().flat_map(|c| c.to_le_bytes()).collect();
        let mut frame = zstd::bulk::compress(&bytes, 1).unwrap();
        frame.extend(crc32c::crc32c(&frame).to_le_bytes());
        std::fs::write(at(name).join("s/y/c.0"), frame).unwrap();
        crate::zarr::reseal(&at(name));
    }
    let error = merge(&[at("a"), at("b")], &at("out"), Options::default()).unwrap_err().to_string();
    assert!(error.contains("s/y") && error.contains("increase"), "{error}");
    assert!(!at("out").exists());
}

/// Verifies that no store exists after a merge that is interrupted at any chunk. Verifies that the next merge
/// resumes the work and writes the same bytes as a merge without interruption.
#[test]
fn an_interrupted_merge_resumes() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    for (i, name) in ["a", "b"].into_iter().enumerate() {
        part(&at(name), i as u64, 4 * i, 4, "a", true);
    }
    let inputs = [at("a"), at("b")];
    merge(&inputs, &at("whole"), Options::default()).unwrap();
    // A killed process leaves the temporary folder with some of its files and without a manifest.
    let rest = at(".out.part");
    let left = |from: &Path| {
        let _ = std::fs::remove_dir_all(&rest);
        copy(from, &rest);
        let _ = std::fs::remove_file(rest.join("manifest.txt"));
    };
    for missing in ["s/mean/c.0.0.0", "s/std_error/c.0.0.0"] {
        left(&at("whole"));
        let _ = std::fs::remove_file(rest.join(missing));
        let opened = open_inputs(&inputs, false).unwrap();
        std::fs::write(rest.join(".sunstone-origin"), merge_origin(&opened, Options::default())).unwrap();
        merge(&inputs, &at("out"), Options { replace: true, ..Options::default() }).unwrap();
        assert!(!rest.exists());
        assert_eq!(files(&at("out")), files(&at("whole")));
        assert!(crate::zarr::verify(&at("out")).unwrap().faults.is_empty());
    }
    // With another origin, the merge starts again, so damaged files do not matter.
    left(&at("a"));
    std::fs::write(rest.join(".sunstone-origin"), "another").unwrap();
    merge(&inputs, &at("out"), Options { replace: true, ..Options::default() }).unwrap();
    assert_eq!(files(&at("out")), files(&at("whole")));
    // The output may not be an input, even through a symbolic link.
    std::os::unix::fs::symlink(at("a"), at("link")).unwrap();
    for out in ["a", "link"] {
        let error = merge(&inputs, &at(out), Options { replace: true, ..Options::default() }).unwrap_err();
        assert!(matches!(error, MergeError::Itself { .. }), "{error}");
    }
    assert!(crate::zarr::verify(&at("a")).unwrap().faults.is_empty());
}
