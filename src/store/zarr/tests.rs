//! Tests of stores: layout, atomicity, sparse chunks and refused stores.

use super::*;
use proptest::prelude::*;
use serde_json::json;
use std::path::PathBuf;
use tensor::axes::{AxisKind, Extents};
use tensor::field::Field;
use tensor::slice::{CameraSelect, Polarization, ProjectorSelect, Slice, TimeSelect};

fn extents(tile: u32) -> Extents {
    Extents {
        camera: [11, 7],
        projector: Some([6, 4]),
        wavelengths_nm: vec![450.0, 550.0, 660.0],
        max_depth: 3,
        tile,
    }
}

fn slice(name: &str, projector: ProjectorSelect, time: TimeSelect) -> Slice {
    Slice {
        name: name.into(),
        camera: CameraSelect::All,
        projector,
        time,
        polarization: Polarization::Mueller,
        bounces: false,
        split_first_bounce: true,
        labels: false,
    }
}

/// Returns the layouts of two slices, one with every kind of array and one plain image. Tiles have an edge
/// length of 4 pixels.
fn layouts() -> Vec<(SliceLayout, Map<String, Value>)> {
    let bins = TimeSelect::Bins { start_ps: 100.0, bin_ps: 12.5, bins: 5 };
    let attributes = json!({"pixels_per_element": 1}).as_object().unwrap().clone();
    [
        slice("timed", ProjectorSelect::Binned { nx: 4, ny: 2 }, bins),
        slice("steady", ProjectorSelect::Sum, TimeSelect::Sum),
    ]
    .iter()
    .map(|s| (SliceLayout::new(s, &extents(4)), attributes.clone()))
    .collect()
}

fn create(path: &Path) -> TensorStore {
    let attributes = json!({"scene_sha256": "abc", "seeds": [7]}).as_object().unwrap().clone();
    let samples = SampleGrid { camera: [11, 7], tile: 4 };
    TensorStore::create(path, &layouts(), &attributes, Some(samples), false).unwrap()
}

fn ramp(n: usize) -> Vec<f32> {
    (0..n).map(|i| (i as f32 * 0.37).sin() + 2.0).collect()
}

/// Returns the contents of all files below a folder, by path relative to the folder.
pub(crate) fn files(path: &Path) -> std::collections::BTreeMap<PathBuf, Vec<u8>> {
    let mut all = std::collections::BTreeMap::new();
    let mut todo = vec![path.to_owned()];
    while let Some(next) = todo.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let file = entry.unwrap().path();
            if file.is_dir() {
                todo.push(file);
            } else {
                all.insert(file.strip_prefix(path).unwrap().to_owned(), std::fs::read(&file).unwrap());
            }
        }
    }
    all
}

#[test]
fn layout_attributes_and_values_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("new/out.zarr");
    let store = create(&path);
    let timed = store.slice("timed").unwrap();
    let shape = timed.layout().shape();
    let data = ramp(region::volume(&shape).unwrap());
    timed.write(Field::Mean, &vec![0; shape.len()], &shape, &data).unwrap();
    store.write_samples([2, 3], [5, 8], &[9; 40]).unwrap();
    store.finish().unwrap();

    let store = TensorStore::open(&path).unwrap();
    assert_eq!(store.slice_names(), ["timed", "steady"]);
    assert_eq!(store.attributes()["scene_sha256"], "abc");
    for (layout, _) in layouts() {
        let slice = store.slice(&layout.name).unwrap();
        assert_eq!(*slice.layout(), layout);
        assert_eq!(slice.attributes()["pixels_per_element"], 1);
        assert_eq!(slice.has(Field::Overflow), layout.time.is_some());
    }
    let timed = store.slice("timed").unwrap();
    assert_eq!(timed.attributes()["time_bin_ps"], 12.5);
    assert_eq!(timed.read_all(Field::Mean).unwrap().data, data);
    assert!(timed.read_all(Field::Overflow).unwrap().data.iter().all(|v| *v == 0.0));
    assert_eq!(timed.field_layout(Field::Overflow).unwrap().find(AxisKind::T), None);
    let counts = store.read_samples([0, 0], [7, 11]).unwrap();
    assert_eq!(counts.iter().filter(|c| **c == 9).count(), 40);
    assert_eq!(store.samples_shape(), Some(([7, 11], [4, 4])));
    let steady = store.slice("steady").unwrap();
    let error = steady.read_all(Field::Overflow).unwrap_err().to_string();
    assert!(error.contains("steady") && error.contains("overflow"), "{error}");
}

use tensor::region;

#[test]
fn regions_can_be_anywhere() {
    let dir = tempfile::tempdir().unwrap();
    let store = create(&dir.path().join("s"));
    let slice = store.slice("steady").unwrap();
    let shape = slice.layout().shape();
    let (start, size) = (vec![2, 3, 1, 0, 1, 0], vec![4, 6, 1, 2, 3, 3]);
    let data = ramp(region::volume(&size).unwrap());
    slice.write(Field::StdError, &start, &size, &data).unwrap();
    assert_eq!(slice.read(Field::StdError, &start, &size).unwrap(), data);
    let whole = slice.read_all(Field::StdError).unwrap();
    assert_eq!(whole.data.iter().filter(|v| **v != 0.0).count(), data.len());
    let bad = slice.write(Field::Mean, &shape, &size, &data).unwrap_err();
    assert!(matches!(bad, AccessError::Region { .. }), "{bad}");
    let bad = slice.write(Field::Mean, &start, &size, &data[1..]).unwrap_err();
    assert!(matches!(bad, AccessError::Length { .. }), "{bad}");
    assert!(slice.read(Field::Mean, &start[1..], &size).is_err());
    assert!(slice.read(Field::Mean, &[u64::MAX; 6], &size).is_err());
}

#[test]
fn zero_chunks_are_not_stored() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s");
    let store = create(&path);
    let slice = store.slice("steady").unwrap();
    let size = [4, 4, 2, 4, 4, 3];
    let n = region::volume(&size).unwrap();
    let chunk = path.join("steady/mean/c.0.0.0.0.0.0");
    slice.write(Field::Mean, &[0; 6], &size, &vec![0.0; n]).unwrap();
    assert!(!chunk.exists());
    slice.write(Field::Mean, &[0; 6], &size, &vec![1.0; n]).unwrap();
    assert!(chunk.exists());
    slice.write(Field::Mean, &[0; 6], &size, &vec![-0.0; n]).unwrap();
    assert!(!chunk.exists());
}

/// Writes one pixel at a time from `threads` threads. `step` determines the order of the pixels.
fn write_pixels(store: &TensorStore, threads: usize, step: usize) {
    let slice = store.slice("timed").unwrap();
    let shape = slice.layout().shape();
    let size: Vec<u64> = [1, 1].into_iter().chain(shape[2..].iter().copied()).collect();
    let per = region::volume(&size).unwrap();
    let data = ramp(per * 77);
    std::thread::scope(|scope| {
        for thread in 0..threads {
            let (slice, data, size) = (slice.clone(), &data, &size);
            scope.spawn(move || {
                for i in (0..77).map(|i| i * step % 77).filter(|i| i % threads == thread) {
                    let mut start = vec![0; size.len()];
                    (start[0], start[1]) = ((i / 11) as u64, (i % 11) as u64);
                    slice.write(Field::Mean, &start, size, &data[i * per..(i + 1) * per]).unwrap();
                }
            });
        }
    });
}

#[test]
fn threads_share_chunks_and_bytes_do_not_depend_on_order() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (dir.path().join("a"), dir.path().join("b"));
    let store = create(&a);
    write_pixels(&store, 1, 1);
    store.finish().unwrap();
    let other = create(&b);
    write_pixels(&other, 4, 10);
    other.finish().unwrap();
    let slice = store.slice("timed").unwrap();
    assert_eq!(
        slice.read_all(Field::Mean).unwrap().data,
        ramp(region::volume(&slice.layout().shape()).unwrap())
    );
    assert_eq!(files(&a), files(&b));
}

#[test]
fn leftovers_are_ignored_and_removed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s");
    let store = create(&path);
    write_pixels(&store, 2, 1);
    store.finish().unwrap();
    let before = files(&path);
    let leftover = path.join("timed/mean/.c.0.0.0.0.0.0.0.0.123-4.tmp");
    std::fs::write(&leftover, b"half a chu").unwrap();
    let read = TensorStore::open(&path).unwrap().slice("timed").unwrap().read_all(Field::Mean).unwrap();
    assert_eq!(read, store.slice("timed").unwrap().read_all(Field::Mean).unwrap());
    assert!(leftover.exists());
    // Only one process may write a store at a time.
    let held = TensorStore::open_for_write(&path).unwrap_err().to_string();
    assert!(held.contains("is being written by process"), "{held}");
    drop(store);
    TensorStore::open_for_write(&path).unwrap();
    assert_eq!(files(&path), before);
}

#[test]
fn an_existing_path_is_replaced_only_on_request() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s");
    let store = create(&path);
    write_pixels(&store, 1, 1);
    let create = |replace| TensorStore::create(&path, &layouts(), &Map::new(), None, replace);
    let error = create(false).unwrap_err().to_string();
    let held = create(true).unwrap_err().to_string();
    assert!(held.contains("is being written by process"), "{held}");
    drop(store);
    assert!(["--resume", "--force", "-o", "s already"].iter().all(|w| error.contains(w)), "{error}");
    let again = create(true).unwrap();
    assert!(again.slice("timed").unwrap().read_all(Field::Mean).unwrap().data.iter().all(|v| *v == 0.0));
    assert!(matches!(again.read_samples([0, 0], [1, 1]), Err(AccessError::NoSamples { .. })));
    drop(again);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    let home = dir.path().join("precious");
    std::fs::create_dir(&home).unwrap();
    let error = TensorStore::create(&home, &layouts(), &Map::new(), None, true).unwrap_err();
    assert!(matches!(error, CreateError::NotAStore { .. }));
    assert!(home.exists());
}

#[test]
fn bad_slices_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s");
    for name in ["", "a/b", "../x", ".x", "__y", "samples", "ä"] {
        let mut slices = layouts();
        slices[0].0.name = name.into();
        let error = TensorStore::create(&path, &slices, &Map::new(), None, false).unwrap_err();
        assert!(matches!(error, CreateError::Slice { .. }), "{name}");
    }
    let mut slices = layouts();
    slices[1].0.name = slices[0].0.name.clone();
    assert!(TensorStore::create(&path, &slices, &Map::new(), None, false).is_err());
    let mut slices = layouts();
    slices[1].0.axes[0].coords.clear();
    assert!(TensorStore::create(&path, &slices, &Map::new(), None, false).is_err());
    assert!(!path.exists());
}

#[test]
fn damaged_descriptions_are_errors() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s");
    create(&path);
    let file = |inner: &str| path.join(inner);
    let edits: [(&str, &str, &str); 9] = [
        ("steady/mean/zarr.json", "float32", "float64"),
        ("steady/mean/zarr.json", "\"stokes_in\"", "\"stokes_on\""),
        ("steady/std_error/zarr.json", "\"stokes_in\"", "\"stokes_on\""),
        ("steady/mean/zarr.json", "\"shape\": [\n    7", "\"shape\": [\n    8"),
        ("steady/mean/zarr.json", "\"chunk_shape\": [", "\"chunk_shape\": [0,"),
        ("steady/y/zarr.json", "\"shape\": [\n    7", "\"shape\": [\n    99999999999"),
        ("steady/mean/zarr.json", "zstd", "blosc"),
        ("steady/mean/zarr.json", "{", ""),
        ("steady/zarr.json", "node_type", "\"node_type"),
    ];
    for (name, from, to) in edits {
        let good = std::fs::read_to_string(file(name)).unwrap();
        let bad = good.replacen(from, to, 1);
        assert_ne!(good, bad, "{name}: {from}");
        std::fs::write(file(name), bad).unwrap();
        let error = TensorStore::open(&path).unwrap().slice("steady").unwrap_err();
        assert!(matches!(error, OpenError::Damaged { .. }), "{error}");
        assert!(error.to_string().contains("steady"), "{error}");
        std::fs::write(file(name), good).unwrap();
    }
    TensorStore::open(&path).unwrap().slice("steady").unwrap();
    std::fs::remove_dir_all(file("steady/std_error")).unwrap();
    let error = TensorStore::open(&path).unwrap().slice("steady").unwrap_err().to_string();
    assert!(error.contains("std_error") && error.contains("missing"), "{error}");
    let error = TensorStore::open(&path).unwrap().slice("stedy").unwrap_err().to_string();
    assert!(error.contains("timed, steady"), "{error}");
    assert!(matches!(TensorStore::open(&file("none")), Err(OpenError::Missing { .. })));
    assert!(matches!(TensorStore::open(&file("steady")), Err(OpenError::NotAStore { .. })));
    assert!(matches!(TensorStore::open(&file("steady/mean/c")), Err(OpenError::Missing { .. })));
}

/// Verifies that the dimensions of the sample counts do not have the names `y` and `x`. In
/// `xarray.open_datatree`, dimensions of the root's arrays apply to every group, so xarray would refuse
/// slices of a part of the camera. Stores of earlier versions, whose sample counts have the dimensions `y`
/// and `x`, can still be opened.
#[test]
fn sample_counts_use_dimensions_of_no_slice() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s");
    create(&path).write_samples([0, 0], [7, 11], &[3; 77]).unwrap();
    let description = path.join("samples/zarr.json");
    let mut json = description::read_json(&description).unwrap();
    for name in json["dimension_names"].as_array().unwrap() {
        assert_eq!(AxisKind::from_name(name.as_str().unwrap()), None, "{name}");
    }
    json["dimension_names"] = json!(["y", "x"]);
    description::write_json(&description, &json).unwrap();
    let old = TensorStore::open_for_write(&path).unwrap();
    assert_eq!(old.read_samples([0, 0], [7, 11]).unwrap(), [3; 77]);
    old.finish().unwrap();
    let old = TensorStore::open(&path).unwrap();
    assert_eq!(old.read_samples([6, 10], [1, 1]).unwrap(), [3]);
}

#[test]
fn consolidated_metadata_lists_every_array() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s");
    let store = create(&path);
    let mut attributes = store.attributes();
    attributes.insert("wall_time_s".into(), json!(1.5));
    store.set_attributes(attributes).unwrap();
    let check = || {
        let root = description::read_json(&path.join("zarr.json")).unwrap();
        let all = root["consolidated_metadata"]["metadata"].as_object().unwrap();
        for key in [
            "samples",
            "timed",
            "timed/mean",
            "timed/overflow_std_error",
            "timed/total_std_error",
            "steady/stokes_in",
        ] {
            assert!(all.contains_key(key), "{key}");
        }
        assert_eq!(root["attributes"]["wall_time_s"], 1.5);
        let group = description::read_json(&path.join("timed/zarr.json")).unwrap();
        assert_eq!(group["consolidated_metadata"]["metadata"]["t"]["attributes"]["units"], "ps");
        assert_eq!(group["consolidated_metadata"]["metadata"].as_object().unwrap().len(), 14);
    };
    check();
    store.finish().unwrap();
    check();
    assert_eq!(TensorStore::open(&path).unwrap().attributes()["wall_time_s"], 1.5);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    /// Verifies that reading a damaged chunk file gives an error or values, and never a panic or a huge
    /// allocation.
    #[test]
    fn damaged_chunks_are_errors(cut in 0_usize..600, at in 0_usize..600, value in any::<u8>(), tail in 0_usize..9) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s");
        let samples = SampleGrid { camera: [11, 7], tile: 8 };
        let store = TensorStore::create(&path, &[], &Map::new(), Some(samples), false).unwrap();
        let counts: Vec<u32> = (0..77).map(|i| i * i).collect();
        store.write_samples([0, 0], [7, 11], &counts).unwrap();
        let chunk = path.join("samples/c.0.0");
        let good = std::fs::read(&chunk).unwrap();
        let mut bytes = good[..cut.min(good.len())].to_vec();
        if let Some(b) = bytes.get_mut(at) {
            *b = value;
        }
        bytes.extend(std::iter::repeat_n(value, tail));
        std::fs::write(&chunk, &bytes).unwrap();
        let read = store.read_samples([0, 0], [7, 11]);
        if bytes == good {
            prop_assert_eq!(read.unwrap(), counts);
        } else if let Ok(read) = read {
            // A change of unused header bits may remain undetected, but a change of values may not.
            prop_assert_eq!(read, counts);
        } else if let Err(e) = read {
            prop_assert!(e.to_string().contains("samples"), "{}", e);
        }
    }
}

/// Verifies that values that are not rendered are not read as zeros. Reading fails, or returns NaN with
/// `open_partial`.
#[test]
fn unfinished_stores_do_not_read_as_zeros() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s");
    let store = create(&path);
    let writing = store.slice("steady").unwrap();
    let shape = writing.layout().shape();
    let whole = ramp(region::volume(&shape).unwrap());
    writing.write(Field::Mean, &vec![0; shape.len()], &shape, &whole).unwrap();
    // The first tile has samples.
    store.write_samples([0, 0], [4, 4], &[3; 16]).unwrap();
    let read = |store: &TensorStore| store.slice("steady").unwrap().read_all(Field::Mean);
    let error = read(&TensorStore::open(&path).unwrap()).unwrap_err().to_string();
    assert!(error.contains("--resume") && error.contains("--partial"), "{error}");
    let partial = read(&TensorStore::open_partial(&path).unwrap()).unwrap();
    let inner = whole.len() / (11 * 7);
    for (i, (found, want)) in partial.data.iter().zip(&whole).enumerate() {
        let (y, x) = (i / inner / 11, i / inner % 11);
        if y < 4 && x < 4 {
            assert_eq!(found, want);
        } else {
            assert!(found.is_nan(), "({x}, {y})");
        }
    }
    store.finish().unwrap();
    assert_eq!(read(&TensorStore::open(&path).unwrap()).unwrap().data, whole);
}

/// Verifies that both reading and `verify` report lost, exchanged and additional chunks.
#[test]
fn changes_of_finished_stores_are_detected() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s");
    let store = create(&path);
    write_pixels(&store, 2, 1);
    store.finish().unwrap();
    let found = verify(&path).unwrap();
    assert!(found.faults.is_empty() && found.files > 20, "{found:?}");
    let chunks: Vec<PathBuf> =
        files(&path).into_keys().filter(|f| f.to_string_lossy().contains("timed/mean/c.")).collect();
    let [a, b] = [&chunks[0], &chunks[1]].map(|c| path.join(c));
    let sound = std::fs::read(&a).unwrap();
    let mut flipped = sound.clone();
    flipped[9] ^= 1;
    let other = std::fs::read(&b).unwrap();
    let foreign = path.join("timed/mean/c.9.9.9.9.9.9.9.9");
    type Harm<'a> = (&'a str, Box<dyn Fn() + 'a>);
    let harms: [Harm; 4] = [
        ("is missing", Box::new(|| std::fs::remove_file(&a).unwrap())),
        ("was changed", Box::new(|| std::fs::write(&a, &flipped).unwrap())),
        ("", Box::new(|| std::fs::write(&a, &other).unwrap())),
        ("was not in the store", Box::new(|| std::fs::write(&foreign, &other).unwrap())),
    ];
    for (expected, harm) in harms {
        harm();
        let faults = verify(&path).unwrap().faults;
        assert!(faults.len() == 1 && faults[0].contains(expected), "{faults:?}");
        if expected != "was not in the store" {
            let read = TensorStore::open(&path).unwrap().slice("timed").unwrap().read_all(Field::Mean);
            assert!(matches!(read, Err(AccessError::Chunk { .. })), "{read:?}");
        }
        std::fs::write(&a, &sound).unwrap();
    }
    std::fs::remove_file(foreign).unwrap();
    assert!(verify(&path).unwrap().faults.is_empty());
    store.unfinish().unwrap();
    assert!(verify(&path).unwrap_err().to_string().contains("not finished"));
}

/// Verifies that a region with the shape of a chunk that is not aligned with the grid covers several chunks.
#[test]
fn an_unaligned_region_of_chunk_shape_covers_several_chunks() {
    let dir = tempfile::tempdir().unwrap();
    let store = create(&dir.path().join("s"));
    let slice = store.slice("steady").unwrap();
    let layout = slice.field_layout(Field::Mean).unwrap().clone();
    let shape = layout.chunk_shape();
    let mut start = vec![0; shape.len()];
    start[1] = 3;
    let values = ramp(shape.iter().product::<u64>() as usize);
    let touched = vec![u64::MAX; values.len()];
    slice.write_touched(Field::Mean, &start, &shape, &values, &touched).unwrap();
    assert_eq!(slice.read(Field::Mean, &start, &shape).unwrap(), values);
    let all = slice.read_all(Field::Mean).unwrap().data;
    assert_eq!(all.iter().filter(|v| **v != 0.0).count(), values.len());
}

mod remote;
mod remote_shards;
mod remote_writing;
mod remove;
mod shards;
