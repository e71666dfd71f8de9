//! Compares the results of probes with the results of brute-force loops.

use super::*;
use crate::zarr::StoredSlice;
use crate::zarr::TensorStore;
use nalgebra::{Matrix4, Vector4};
use rand_core::{Rng, SeedableRng};
use serde_json::{Map, json};
use tensor::array::Tensor;
use tensor::axes::AxisKind;
use tensor::axes::{Extents, SliceLayout};
use tensor::field::Field;
use tensor::slice::{CameraSelect, Polarization, ProjectorSelect, Slice, TimeSelect};

const SIZE: [u32; 2] = [10, 7];

/// Stores a random tensor over y, x, v, u, t, p, p' and wavelength, with several chunks along every axis.
fn stored(dir: &std::path::Path, projector: ProjectorSelect, polarization: Polarization) -> StoredSlice {
    let extents = Extents {
        camera: [5, 3],
        projector: Some(SIZE),
        wavelengths_nm: vec![450.0, 550.0, 660.0],
        max_depth: 2,
        tile: 2,
    };
    let bin = if let ProjectorSelect::Binned { nx, ny } = projector { [nx, ny] } else { [1, 1] };
    let slice = Slice {
        name: "full".into(),
        camera: CameraSelect::All,
        projector,
        time: TimeSelect::Bins { start_ps: 1000.0, bin_ps: 50.0, bins: 5 },
        polarization,
        bounces: false,
        split_first_bounce: true,
        labels: false,
    };
    let mut layout = SliceLayout::new(&slice, &extents);
    layout.totals = false;
    for axis in layout.axes.iter_mut().filter(|a| "vut".contains(a.kind.name())) {
        axis.chunk = axis.chunk.div_ceil(2);
    }
    let attributes = json!({"projector_bin": bin, "projector_size": SIZE}).as_object().unwrap().clone();
    let store =
        TensorStore::create(&dir.join("s.zarr"), &[(layout, attributes)], &Map::new(), None, true).unwrap();
    let slice = store.slice("full").unwrap();
    let mut random = rand_pcg::Pcg32::seed_from_u64(5);
    for field in Field::ALL.into_iter().filter(|f| slice.has(*f)) {
        let shape = slice.field_layout(field).unwrap().shape();
        let n = shape.iter().product::<u64>() as usize;
        let values: Vec<f32> = (0..n).map(|_| (random.next_u32() >> 8) as f32 / 16_777_216.0).collect();
        slice.write(field, &vec![0; shape.len()], &shape, &values).unwrap();
    }
    slice
}

fn binned() -> ProjectorSelect {
    ProjectorSelect::Binned { nx: 4, ny: 3 }
}

fn pattern() -> Pattern {
    let values = (0..SIZE[0] * SIZE[1]).map(|i| ((i * 37) % 11) as f32 / 10.0).collect();
    Pattern { width: SIZE[0], height: SIZE[1], values }
}

fn close(a: f32, b: f64) {
    assert!((f64::from(a) - b).abs() <= 1e-6 * b.abs().max(1e-3), "{a} {b}");
}

/// Iterates over all indices of a tensor, as lists of (axis kind, index).
fn each(t: &Tensor) -> impl Iterator<Item = Vec<(AxisKind, usize)>> {
    let shape: Vec<u64> = t.shape().iter().map(|&n| n as u64).collect();
    let kinds: Vec<AxisKind> = t.axes.iter().map(|a| a.kind).collect();
    tensor::region::indices(&vec![0; shape.len()], &shape)
        .map(move |index| kinds.iter().zip(index).map(|(&k, i)| (k, i as usize)).collect())
}

#[test]
fn the_default_probe_changes_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let slice = stored(dir.path(), binned(), Polarization::Mueller);
    let result = Probe::default().run(&slice).unwrap();
    assert_eq!(result.mean.data, slice.read_all(Field::Mean).unwrap().data);
    assert_eq!(result.std_error.data, slice.read_all(Field::StdError).unwrap().data);
    assert_eq!(result.overflow.as_ref().unwrap().data, slice.read_all(Field::Overflow).unwrap().data);
    assert_eq!(result.layout().axes.len(), slice.layout().axes.len());
    assert_eq!(result.time, Some((1000.0, 50.0)));
}

#[test]
fn contraction_equals_the_brute_force_sum() {
    use AxisKind::{StokesIn, T, U, V};
    let dir = tempfile::tempdir().unwrap();
    let slice = stored(dir.path(), binned(), Polarization::Mueller);
    let (pattern, stokes) = (pattern(), [1.0, -0.5, 0.25, 0.75]);
    let probe = Probe { pattern: Some(pattern.clone()), stokes: Some(stokes), ..Probe::default() };
    let result = probe.run(&slice).unwrap();
    let (full, error) = (slice.read_all(Field::Mean).unwrap(), slice.read_all(Field::StdError).unwrap());
    assert!(result.notes.is_empty());
    assert_eq!(result.mean.extent(T), 5);
    assert_eq!(result.mean.find(V).or(result.mean.find(U)).or(result.mean.find(StokesIn)), None);
    for index in each(&result.mean) {
        let (mut sum, mut bound) = (0.0, 0.0);
        for y in 0..SIZE[1] as usize {
            for x in 0..SIZE[0] as usize {
                let (v, u) = (y / 3, x / 4);
                let width = 4.min(SIZE[0] as usize - u * 4);
                let height = 3.min(SIZE[1] as usize - v * 3);
                let drive = f64::from(pattern.values[y * SIZE[0] as usize + x]) / (width * height) as f64;
                for (p, s) in stokes.iter().enumerate() {
                    let at = [&index[..], &[(V, v), (U, u), (StokesIn, p)]].concat();
                    sum += drive * f64::from(*s) * f64::from(full.at(&at));
                    bound += (drive * f64::from(*s)).abs() * f64::from(error.at(&at));
                }
            }
        }
        close(result.mean.at(&index), sum);
        close(result.std_error.at(&index), bound);
    }
    let full_on =
        Probe { pattern: Some(Pattern::uniform(10, 7, 1.0)), ..Probe::default() }.run(&slice).unwrap();
    let summed = Probe { sum: vec![V, U], ..Probe::default() }.run(&slice).unwrap();
    assert_eq!(full_on.mean, summed.mean);
}

#[test]
fn stokes_contraction_is_a_matrix_product() {
    use AxisKind::{StokesIn, StokesOut, Wavelength, X, Y};
    let dir = tempfile::tempdir().unwrap();
    let slice = stored(dir.path(), ProjectorSelect::Sum, Polarization::Mueller);
    let stokes = [1.0, 0.3, -0.8, 0.1];
    let sum = vec![AxisKind::T, AxisKind::Component];
    let mueller = Probe { sum: sum.clone(), ..Probe::default() }.run(&slice).unwrap().mean;
    let result = Probe { sum, stokes: Some(stokes), ..Probe::default() }.run(&slice).unwrap().mean;
    for index in each(&result).filter(|i| i.contains(&(StokesOut, 0))) {
        let at =
            |extra: &[(AxisKind, usize)]| [&[index[0], index[1], (Wavelength, index[3].1)], extra].concat();
        assert_eq!((index[0].0, index[1].0, index[3].0), (Y, X, Wavelength));
        let m = Matrix4::from_fn(|r, c| f64::from(mueller.at(&at(&[(StokesOut, r), (StokesIn, c)]))));
        let out = m * Vector4::from(stokes.map(f64::from));
        for (r, value) in out.iter().enumerate() {
            close(result.at(&at(&[(StokesOut, r)])), *value);
        }
    }
}

#[test]
fn convolution_conserves_light() {
    use AxisKind::T;
    let dir = tempfile::tempdir().unwrap();
    let slice = stored(dir.path(), ProjectorSelect::Sum, Polarization::Intensity);
    let plain = slice.read_all(Field::Mean).unwrap();
    for pulse in [
        Pulse::Gaussian { fwhm_ps: 120.0 },
        Pulse::Gaussian { fwhm_ps: 0.0 },
        Pulse::Samples(vec![1.0, 0.0, 3.0]),
    ] {
        let result = Probe { pulse: Some(pulse.clone()), ..Probe::default() }.run(&slice).unwrap();
        let (stay, leave) = (result.mean.sum(T), result.shifted_out.unwrap());
        for ((before, after), out) in plain.sum(T).data.iter().zip(&stay.data).zip(&leave.data) {
            close(after + out, f64::from(*before));
        }
        if let Pulse::Samples(_) = pulse {
            for index in each(&result.mean) {
                let t = index.iter().find(|(k, _)| *k == T).unwrap().1;
                let back = |k: usize| {
                    let mut index = index.clone();
                    index.retain(|(kind, _)| *kind != T);
                    if t < k { 0.0 } else { f64::from(plain.at(&[&index[..], &[(T, t - k)]].concat())) }
                };
                close(result.mean.at(&index), 0.25 * back(0) + 0.75 * back(2));
            }
        }
        // Selecting and summing within a probe equals selecting and summing the result of a probe with only
        // the pulse.
        let select = vec!["t=1050:1200".parse().unwrap()];
        let part =
            Probe { pulse: Some(pulse), select, sum: vec![T], ..Probe::default() }.run(&slice).unwrap();
        for index in each(&part.mean) {
            let at = |t: usize| f64::from(result.mean.at(&[&index[..], &[(T, t)]].concat()));
            close(part.mean.at(&index), at(1) + at(2) + at(3));
        }
        assert_eq!(part.shifted_out.unwrap().data, leave.data);
    }
}

#[test]
fn spatial_and_temporal_probes_equal_sums() {
    use AxisKind::{Component, StokesIn, StokesOut, T, U, V, X, Y};
    let dir = tempfile::tempdir().unwrap();
    let slice = stored(dir.path(), ProjectorSelect::All, Polarization::Mueller);
    let full = slice.read_all(Field::Mean).unwrap().sum(Component);
    let m00 = full.select(StokesIn, 0).select(StokesOut, 0);
    let check = |probe: Probe, expected: Tensor| {
        let result = probe.run(&slice).unwrap().mean;
        assert_eq!(result.shape(), expected.shape());
        result.data.iter().zip(&expected.data).for_each(|(a, b)| close(*a, f64::from(*b)));
    };
    check(Probe::spatial(), m00.sum(T));
    check(Probe::temporal(), m00.sum(Y).sum(X).sum(V).sum(U));
    check(Probe::polarimetric(), full.sum(Y).sum(X).sum(V).sum(U).sum(T));
}

#[test]
fn errors_add_in_quadrature_over_pixels_and_linearly_within() {
    use AxisKind::{Component, StokesIn, T, X, Y};
    let dir = tempfile::tempdir().unwrap();
    let slice = stored(dir.path(), ProjectorSelect::Sum, Polarization::Mueller);
    let error = slice.read_all(Field::StdError).unwrap();
    let sum = vec![Y, X, T, Component, StokesIn];
    let result = Probe { sum, ..Probe::default() }.run(&slice).unwrap().std_error;
    let within = error.sum(T).sum(Component).sum(StokesIn);
    for index in each(&result) {
        let mut variance = 0.0;
        for (y, x) in (0..3).flat_map(|y| (0..5).map(move |x| (y, x))) {
            variance += f64::from(within.at(&[&index[..], &[(Y, y), (X, x)]].concat())).powi(2);
        }
        close(result.at(&index), variance.sqrt());
    }
}

#[test]
fn selections_take_nearest_entries() {
    use AxisKind::{T, Wavelength, X, Y};
    let dir = tempfile::tempdir().unwrap();
    let slice = stored(dir.path(), ProjectorSelect::Sum, Polarization::Intensity);
    let full = slice.read_all(Field::Mean).unwrap();
    let select = ["y=1.4", "x=1:3", "t=1080:", "wavelength=600"].iter().map(|s| s.parse().unwrap()).collect();
    let result = Probe { select, ..Probe::default() }.run(&slice).unwrap();
    assert_eq!(result.mean.shape(), [3, 4, 2]);
    assert_eq!(result.time, Some((1050.0, 50.0)));
    for index in each(&result.mean) {
        let at = [(Y, 1), (X, index[0].1 + 1), (T, index[1].1 + 1), index[2], (Wavelength, 1)];
        assert_eq!(result.mean.at(&index), full.at(&at));
    }
    let fails = |probe: Probe| probe.run(&slice).unwrap_err().to_string();
    let one = |s: &str| Probe { select: vec![s.parse().unwrap()], ..Probe::default() };
    assert!(fails(one("y=30")).contains("outside"));
    assert!(fails(one("t=1:2")).contains("outside"));
    assert!(fails(one("v=3")).contains("no axis"));
    assert!(fails(one("stokes_in=1")).contains("no axis"));
    assert!(one("stokes_in=0").run(&slice).is_ok());
    assert!(
        fails(Probe { select: vec![Selection::nearest(Y, f64::NAN)], ..Probe::default() }).contains("number")
    );
    assert!(fails(Probe { stokes: Some([1.0, 1.0, 0.0, 0.0]), ..Probe::default() }).contains("mueller"));
    assert!(fails(Probe { pattern: Some(pattern()), ..Probe::default() }).contains("already summed"));
    assert!(Probe { pattern: Some(Pattern::uniform(10, 7, 1.0)), ..Probe::default() }.run(&slice).is_ok());
    assert!(fails(Probe { pulse: Some(Pulse::Samples(vec![])), ..Probe::default() }).contains("sum"));
    assert!(
        fails(Probe { pulse: Some(Pulse::Gaussian { fwhm_ps: 1e300 }), ..Probe::default() })
            .contains("width")
    );
}

#[test]
fn pattern_sizes_are_checked() {
    let dir = tempfile::tempdir().unwrap();
    let slice = stored(dir.path(), ProjectorSelect::Rows(vec![1, 4]), Polarization::Intensity);
    let run = |pattern| Probe { pattern: Some(pattern), ..Probe::default() }.run(&slice);
    let result = run(pattern()).unwrap();
    assert!(result.notes[0].contains("projector pixels"), "{:?}", result.notes);
    assert!(run(Pattern::uniform(11, 7, 1.0)).unwrap_err().to_string().contains("10 × 7"));
    assert!(
        run(Pattern { width: 10, height: 7, values: vec![] }).unwrap_err().to_string().contains("0 values")
    );
}

#[test]
fn results_are_written_and_read_back() {
    let dir = tempfile::tempdir().unwrap();
    let slice = stored(dir.path(), ProjectorSelect::Sum, Polarization::Intensity);
    let probe =
        Probe { sum: vec![AxisKind::Component], select: vec!["y=1".parse().unwrap()], ..Probe::default() };
    let result = probe.run(&slice).unwrap();
    let at = |name: &str| dir.path().join(name);
    let none = Map::new();
    for name in ["out.npy", "out.csv", "out.zarr"] {
        result.write(&at(name), &none, false).unwrap();
    }
    let npy = |path: &std::path::Path| {
        let array = crate::numpy::NumpyArray::read(path).unwrap();
        assert_eq!(array.shape, [5, 5, 3]);
        array.values
    };
    let single = |data: &[f32]| crate::numpy::Values::Single(data.to_vec());
    assert_eq!(npy(&at("out.npy")), single(&result.mean.data));
    assert_eq!(npy(&std_error_path(&at("out.npy"))), single(&result.std_error.data));
    let csv = std::fs::read_to_string(at("out.csv")).unwrap();
    assert!(csv.starts_with("x,t,wavelength,mean,std_error\n0,1025,450,"));
    let last: Vec<&str> = csv.lines().last().unwrap().split(',').collect();
    assert_eq!(csv.lines().count(), 76);
    assert_eq!(last[..3], ["4", "1225", "660"]);
    assert_eq!(last[3].parse::<f32>().unwrap(), *result.mean.data.last().unwrap());
    let stored = TensorStore::open(&at("out.zarr")).unwrap().slice("full").unwrap();
    assert_eq!(stored.read_all(Field::Mean).unwrap(), result.mean);
    assert_eq!(stored.read_all(Field::Overflow).unwrap().data, result.overflow.as_ref().unwrap().data);
    assert_eq!(stored.layout().time, Some((1000.0, 50.0)));
    assert!(matches!(result.write(&at("out.zarr"), &none, false), Err(ProbeError::Create(_))));
    assert!(result.write(&at("out.txt"), &none, false).is_err());
    let mut number = Probe::temporal();
    number.sum.extend([AxisKind::T, AxisKind::Wavelength]);
    let number = number.run(&slice).unwrap();
    assert_eq!(number.mean.data.len(), 1);
    for name in ["one.npy", "one.csv", "one.zarr"] {
        number.write(&at(name), &none, false).unwrap();
    }
    let stored = TensorStore::open(&at("one.zarr")).unwrap().slice("full").unwrap();
    assert_eq!(stored.read_all(Field::Mean).unwrap().data, number.mean.data);
}
