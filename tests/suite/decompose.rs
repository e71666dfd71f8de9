//! Tests `sunstone decompose` on arrays and stores.

use crate::commands::{rendered, run};
use crate::harness::refusals;
use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use sunstone::polarimetry::decompose::lu_chipman::{SINGLE, decompose};
use sunstone::polarimetry::decompose::properties::Properties;
use sunstone::store::numpy;
use sunstone::store::numpy::{NumpyArray, Values};
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::axes::AxisKind;
use sunstone::tensor::field::Field;

/// Returns all arrays of an archive.
pub fn arrays(path: &Path) -> HashMap<String, NumpyArray> {
    let mut zip = zip::ZipArchive::new(File::open(path).expect("a file")).expect("an archive");
    let folder = tempfile::tempdir().expect("a folder");
    (0..zip.len())
        .map(|i| {
            let mut entry = zip.by_index(i).expect("an array");
            let name = entry.name().expect("a name").trim_end_matches(".npy").to_owned();
            let mut bytes = vec![];
            entry.read_to_end(&mut bytes).expect("bytes");
            let at = folder.path().join("one.npy");
            std::fs::write(&at, bytes).expect("space");
            (name, NumpyArray::read(&at).expect("numbers"))
        })
        .collect()
}

/// Saves numbers as a NumPy array in the file `NAME.npy`.
pub fn save(folder: &Path, name: &str, shape: &[usize], values: &[f64]) {
    let file = File::create(folder.join(format!("{name}.npy"))).expect("a file");
    numpy::write(file, shape, values.iter().copied()).expect("space");
}

pub fn values(array: &NumpyArray) -> Vec<f64> {
    match &array.values {
        Values::Single(v) => v.iter().map(|v| f64::from(*v)).collect(),
        Values::Double(v) => v.clone(),
    }
}

/// Tests that an array of matrices of shape 3 × 1 is decomposed into arrays of shape 3 × 1. The matrices are
/// a quarter-wave retarder, an ideal depolarizer and an unphysical matrix.
#[test]
fn arrays_are_decomposed_to_arrays() {
    let folder = tempfile::tempdir().expect("a folder");
    let d = folder.path();
    let retarder = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 0., 1., 0., 0., -1., 0.];
    let mut depolarizer = [0.0; 16];
    depolarizer[0] = 2.0;
    let all = [retarder, depolarizer, [0.0; 16]].concat();
    save(d, "m", &[3, 1, 4, 4], &all);
    run(d, &["decompose", "m.npy", "-o", "p.npz"]);
    let found = arrays(&d.join("p.npz"));
    let mut names: Vec<&str> = found.keys().map(String::as_str).collect();
    names.sort_unstable();
    assert_eq!(
        names,
        [
            "depolarization",
            "diattenuation",
            "m_d",
            "m_delta",
            "m_r",
            "polarizance",
            "retardance",
            "retardance_axis"
        ]
    );
    assert_eq!(found["m_r"].shape, [3, 1, 4, 4]);
    assert_eq!(found["retardance_axis"].shape, [3, 1, 3]);
    let retardance = values(&found["retardance"]);
    assert!((retardance[0] - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    assert_eq!(retardance[1], 0.0);
    assert!(retardance[2].is_nan());
    assert_eq!(values(&found["depolarization"])[..2], [0.0, 1.0]);
    // Decomposes with errors, and selects arrays.
    save(d, "e", &[3, 1, 4, 4], &[0.01; 48]);
    let only = ["decompose", "m.npy", "--errors", "e.npy", "--only", "retardance,entropy", "-o", "q.npz"];
    run(d, &only);
    let found = arrays(&d.join("q.npz"));
    assert_eq!(found.len(), 3);
    // The standard error of the retardance follows from the four elements that contain the sine and cosine of
    // the retardance.
    let error = values(&found["retardance_error"])[0];
    assert!(error > 0.005 && error < 0.01, "{error}");
    assert_eq!(values(&found["entropy"])[..2], [0.0, 1.0]);
}

/// Tests that a stored image has the same results and errors as its matrices, decomposed one by one.
#[test]
fn slices_of_stores() {
    let folder = rendered();
    let d = folder.path();
    run(d, &["decompose", "out/room.zarr", "image", "-o", "p.npz"]);
    let found = arrays(&d.join("p.npz"));
    assert_eq!(found["retardance"].shape, [12, 16, 3]);
    assert_eq!(found["m_delta"].shape, [12, 16, 3, 4, 4]);
    let store = TensorStore::open(&d.join("out/room.zarr")).expect("a store");
    let slice = store.slice("image").expect("a slice");
    let mean = slice.read_all(Field::Mean).expect("values");
    let at = |y, x, w, i, j| {
        f64::from(mean.at(&[
            (AxisKind::Y, y),
            (AxisKind::X, x),
            (AxisKind::Wavelength, w),
            (AxisKind::StokesOut, i),
            (AxisKind::StokesIn, j),
        ]))
    };
    let (polarizance, m_d) = (values(&found["polarizance"]), values(&found["m_d"]));
    let mut lit = 0;
    for y in 0..12 {
        for x in 0..16 {
            for w in 0..3 {
                let k = (y * 16 + x) * 3 + w;
                let m = std::array::from_fn(|i| std::array::from_fn(|j| at(y, x, w, i, j)));
                let Some(parts) = decompose(&m, SINGLE) else {
                    assert!(polarizance[k].is_nan());
                    continue;
                };
                lit += 1;
                let p = Properties::of(&m, &parts);
                assert!((polarizance[k] - p.polarizance).abs() < 1e-6);
                assert!((m_d[16 * k] / m[0][0] - 1.0).abs() < 1e-6);
            }
        }
    }
    assert!(lit > 200, "{lit}");
    let errors = values(&found["polarizance_error"]);
    assert!(errors.iter().filter(|e| **e > 0.0).count() > 20);
    // Decomposes a selected range of an axis.
    run(d, &["decompose", "out/room.zarr", "xt", "-k", "t=9000:9500", "--only", "retardance", "-o", "t.npz"]);
    let found = arrays(&d.join("t.npz"));
    assert_eq!(found["retardance"].shape.iter().product::<usize>() % 5, 0);
}

/// Tests that the command refuses input other than arrays of matrices. The error message must contain a fix,
/// and the command must write nothing.
#[test]
fn invalid_inputs_are_refused() {
    let folder = rendered();
    let d = folder.path();
    save(d, "flat", &[2, 16], &[0.0; 32]);
    save(d, "m", &[2, 4, 4], &[1.0; 32]);
    std::fs::write(d.join("text.npy"), "not an array").expect("space");
    refusals(
        d,
        &[
            ("decompose flat.npy -o p.npz", "(..., 4, 4)"),
            ("decompose text.npy -o p.npz", "numpy.save"),
            ("decompose missing.npy -o p.npz", "missing.npy"),
            ("decompose m.npy -o p.csv", ".npz"),
            ("decompose m.npy --errors flat.npy -o p.npz", "(..., 4, 4)"),
            ("decompose m.npy --only phase -o p.npz", "retardance"),
            ("decompose out/room.zarr -o p.npz", "name the slice"),
            ("decompose out/room.zarr image -k stokes_in=0 -o p.npz", "mueller"),
        ],
    );
}
