//! Tests that every reader of a damaged store succeeds or reports an error, within limits on time and memory.

use crate::exr::{ExrOptions, export};
use crate::merge::merge;
use crate::probe::{Pattern, Probe, Pulse};
use crate::shard::shard_to;
use crate::zarr::{Limits, SampleGrid, TensorStore};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use serde_json::{Map, Value, json};
use std::alloc::{GlobalAlloc, Layout, System};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use tensor::axes::{AxisKind, Extents, SliceLayout};
use tensor::field::Field;
use tensor::region;
use tensor::slice::{CameraSelect, Polarization, ProjectorSelect, Slice, TimeSelect};

/// Allocator that records the largest allocation of any test of this crate.
struct Watched;

static LARGEST: AtomicUsize = AtomicUsize::new(0);

unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Watched = Watched;

/// Maximum size of one allocation, in bytes: the size of the coordinates of the longest valid axis.
const MEMORY: usize = 1 << 27;
/// Maximum time in which all readers must finish on one damaged store.
const PATIENCE: Duration = Duration::from_secs(20);

fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
}

/// Creates a store with axes of all kinds and with sample counts.
fn make(path: &Path, seed: u64) {
    let extents = Extents {
        camera: [6, 5],
        projector: Some([6, 4]),
        wavelengths_nm: vec![450.0, 550.0, 660.0],
        max_depth: 3,
        tile: 2,
    };
    let slice = |name: &str, camera, projector, time, polarization, split| Slice {
        name: name.into(),
        camera,
        projector,
        time,
        polarization,
        bounces: split,
        split_first_bounce: split,
        labels: false,
    };
    let bins = TimeSelect::Bins { start_ps: 100.0, bin_ps: 12.5, bins: 4 };
    use CameraSelect as C;
    use Polarization::{Intensity, Mueller};
    use ProjectorSelect as P;
    let slices: Vec<_> = [
        (slice("image", C::All, P::Sum, TimeSelect::Sum, Mueller, false), 1),
        (slice("timed", C::Binned { nx: 2, ny: 2 }, P::Binned { nx: 4, ny: 2 }, bins, Intensity, true), 4),
    ]
    .into_iter()
    .map(|(slice, pixels)| {
        let bin = if pixels == 1 { [1, 1] } else { [4, 2] };
        let attributes =
            json!({"pixels_per_element": pixels, "projector_size": [6, 4], "projector_bin": bin});
        (SliceLayout::new(&slice, &extents), attributes.as_object().unwrap().clone())
    })
    .collect();
    let attributes = json!({"scene_sha256": "abc", "seeds": [seed], "samples_per_pixel": 4, "wall_time_s": 0.5,
        "discarded_samples": 1, "status": "complete"});
    let grid = SampleGrid { camera: [6, 5], tile: 2 };
    let attributes = attributes.as_object().unwrap();
    let store = TensorStore::create(path, &slices, attributes, Some(grid), false).unwrap();
    for (layout, _) in &slices {
        let slice = store.slice(&layout.name).unwrap();
        for field in Field::ALL.into_iter().filter(|f| slice.has(*f)) {
            let shape = slice.field_layout(field).unwrap().shape();
            let n = region::volume(&shape).unwrap();
            let data: Vec<f32> = (0..n).map(|i| 1.0 + (i as f32 * 0.37).sin()).collect();
            slice.write(field, &vec![0; shape.len()], &shape, &data).unwrap();
        }
    }
    store.write_samples([0, 0], [5, 6], &[4; 30]).unwrap();
    store.finish().unwrap();
}

fn files(path: &Path) -> Vec<PathBuf> {
    crate::zarr::tests::files(path).into_keys().map(|file| path.join(file)).collect()
}

pub(crate) fn copy(from: &Path, to: &Path) {
    for file in files(from) {
        let target = to.join(file.strip_prefix(from).unwrap());
        std::fs::create_dir_all(target.parent().unwrap()).unwrap();
        std::fs::copy(file, target).unwrap();
    }
}

/// A change that damages a store. Numbers in 0..1 select a file, or a position in the file, as a fraction.
#[derive(Clone, Debug)]
enum Damage {
    /// Replaces a value in a metadata file.
    Value(f64, f64, usize),
    /// Removes a value from a metadata file.
    Drop(f64, f64),
    /// Replaces coordinates, and encodes the file correctly.
    Coordinates(f64, Vec<(f64, f64)>),
    /// Truncates or deletes a file, or replaces a byte of the file.
    Cut(f64, f64),
    Byte(f64, f64, u8),
    Delete(f64),
    /// Replaces one file by another file.
    Over(f64, f64),
}

fn values() -> [Value; 24] {
    let big = f64::MAX;
    [
        json!(null),
        json!(true),
        json!("x"),
        json!("NaN"),
        json!([]),
        json!({}),
        json!(0),
        json!(-1),
        json!(1),
        json!(2),
        json!(3),
        json!(5),
        json!(0.5),
        json!(big),
        json!(-big),
        json!(1e-300),
        json!(32768),
        json!(4294967296_u64),
        json!(u64::MAX),
        json!(i64::MIN),
        json!([1, 1]),
        json!([u64::MAX, 2]),
        json!(["mean", "mean"]),
        json!(16777216),
    ]
}

/// Returns the coordinate `own`, or an invalid value that `kind` (0..1) selects.
fn coordinate(kind: f64, own: f64) -> f64 {
    match (kind * 16.0) as u32 {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => -1.0,
        3 => 1e300,
        4 => 0.5,
        5 => 4294967296.0,
        6 => 5e-324,
        _ => own,
    }
}

fn damage() -> impl Strategy<Value = Damage> {
    let share = || 0.0..1.0_f64;
    prop_oneof![
        8 => (share(), share(), 0..24_usize).prop_map(|(a, b, v)| Damage::Value(a, b, v)),
        2 => (share(), share()).prop_map(|(a, b)| Damage::Drop(a, b)),
        5 => (share(), prop::collection::vec((share(), share()), 1..9))
            .prop_map(|(a, c)| Damage::Coordinates(a, c)),
        1 => (share(), share()).prop_map(|(a, b)| Damage::Cut(a, b)),
        1 => (share(), share(), any::<u8>()).prop_map(|(a, b, v)| Damage::Byte(a, b, v)),
        1 => share().prop_map(Damage::Delete),
        1 => (share(), share()).prop_map(|(a, b)| Damage::Over(a, b)),
    ]
}

/// Lists the JSON pointers to all values of a metadata file, except the values in consolidated metadata.
fn pointers(value: &Value, at: &str, out: &mut Vec<String>) {
    let mut child = |key: &str, v: &Value| {
        let path = format!("{at}/{}", key.replace('~', "~0").replace('/', "~1"));
        out.push(path.clone());
        pointers(v, &path, out);
    };
    match value {
        Value::Object(map) => {
            map.iter().filter(|(k, _)| *k != "consolidated_metadata").for_each(|(k, v)| child(k, v))
        }
        Value::Array(list) => list.iter().enumerate().for_each(|(i, v)| child(&i.to_string(), v)),
        _ => {}
    }
}

fn pick<T>(list: &[T], share: f64) -> &T {
    &list[((list.len() as f64 * share) as usize).min(list.len() - 1)]
}

impl Damage {
    fn do_to(&self, store: &Path) {
        let all = files(store);
        let descriptions: Vec<&PathBuf> = all.iter().filter(|f| f.ends_with("zarr.json")).collect();
        if all.is_empty() || descriptions.is_empty() {
            return;
        }
        let edit = |file: f64, place: f64, with: Option<&Value>| {
            let path = pick(&descriptions, file);
            let Ok(mut json) = serde_json::from_slice::<Value>(&std::fs::read(path).unwrap()) else {
                return;
            };
            let mut places = Vec::new();
            pointers(&json, "", &mut places);
            if places.is_empty() {
                return;
            }
            let place = pick(&places, place);
            if let Some(value) = with {
                *json.pointer_mut(place).unwrap() = value.clone();
            } else {
                let (parent, key) = place.rsplit_once('/').unwrap();
                match json.pointer_mut(parent) {
                    Some(Value::Object(map)) => drop(map.remove(key)),
                    Some(Value::Array(list)) => drop(list.remove(key.parse().unwrap())),
                    _ => {}
                }
            }
            std::fs::write(path, serde_json::to_vec(&json).unwrap()).unwrap();
        };
        match self {
            Self::Value(file, place, value) => edit(*file, *place, Some(&values()[*value])),
            Self::Drop(file, place) => edit(*file, *place, None),
            Self::Coordinates(axis, list) => {
                let axes = ["image", "timed"].map(|slice| AxisKind::ALL.map(|k| (slice, k))).concat();
                let (slice, kind) = pick(&axes, *axis);
                // Write the coordinates in random order, with some random replacements.
                let mut order: Vec<(f64, usize)> = list.iter().enumerate().map(|(i, l)| (l.1, i)).collect();
                order.sort_by(|a, b| a.0.total_cmp(&b.0));
                let bytes: Vec<u8> =
                    order.iter().flat_map(|&(_, i)| coordinate(list[i].0, i as f64).to_le_bytes()).collect();
                let mut frame = zstd::bulk::compress(&bytes, 1).unwrap();
                frame.extend(crc32c::crc32c(&frame).to_le_bytes());
                let folder = store.join(slice).join(kind.name());
                if folder.is_dir() {
                    std::fs::write(folder.join("c.0"), frame).unwrap();
                }
            }
            Self::Cut(file, share) => {
                let path = pick(&all, *file);
                let bytes = std::fs::read(path).unwrap();
                std::fs::write(path, &bytes[..(bytes.len() as f64 * share) as usize]).unwrap();
            }
            Self::Byte(file, place, value) => {
                let path = pick(&all, *file);
                let mut bytes = std::fs::read(path).unwrap();
                let n = bytes.len() as f64;
                if let Some(byte) = bytes.get_mut((n * place) as usize) {
                    *byte = *value;
                }
                std::fs::write(path, bytes).unwrap();
            }
            Self::Delete(file) => std::fs::remove_file(pick(&all, *file)).unwrap(),
            Self::Over(from, to) => {
                let bytes = std::fs::read(pick(&all, *from)).unwrap();
                std::fs::write(pick(&all, *to), bytes).unwrap();
            }
        }
    }
}

/// Runs all readers on a damaged store, and returns the number of successes and the number of errors.
fn read_all(folder: &Path, damaged: &Path, sound: &Path) -> [usize; 2] {
    let mut counts = [0, 0];
    let mut note = |fault: Option<String>| {
        counts[usize::from(fault.is_some())] += 1;
        if let Some(text) = fault {
            assert!(text.len() > 20, "{text}");
        }
    };
    let out = folder.join("out.zarr");
    for pair in [[damaged, sound], [sound, damaged]] {
        note(
            merge(&pair.map(Path::to_owned), &out, crate::merge::Options { replace: true, partial: true })
                .err()
                .map(|e| e.to_string()),
        );
    }
    let store = match TensorStore::open(damaged) {
        Ok(store) => store,
        Err(e) => {
            note(Some(e.to_string()));
            return counts;
        }
    };
    let select = |text: &str| Probe { select: vec![text.parse().unwrap()], ..Probe::default() };
    let driven = Probe { pattern: Some(Pattern::uniform(6, 4, 0.5)), ..Probe::default() };
    let pulsed = Probe {
        pulse: Some(Pulse::Gaussian { fwhm_ps: 30.0 }),
        sum: vec![AxisKind::U, AxisKind::Y],
        ..Probe::default()
    };
    let probes = [
        Probe::default(),
        Probe::spatial(),
        Probe::temporal(),
        Probe::polarimetric(),
        select("t=110:130"),
        select("wavelength=500"),
        select("y=2:3"),
        driven,
        pulsed,
    ];
    for name in store.slice_names() {
        let slice = match store.slice(name) {
            Ok(slice) => slice,
            Err(e) => {
                note(Some(e.to_string()));
                continue;
            }
        };
        for field in Field::ALL {
            note(slice.read_all(field).err().map(|e| e.to_string()));
        }
        for probe in &probes {
            let result = probe.run(&slice).and_then(|r| r.write(&out, &Map::new(), true));
            note(result.err().map(|e| e.to_string()));
        }
        for expand in [vec![], vec![AxisKind::T, AxisKind::Component]] {
            let options = ExrOptions { expand, mueller: name == "image", ..ExrOptions::default() };
            note(export(&slice, &options, &folder.join("out.exr")).err().map(|e| e.to_string()));
        }
    }
    counts
}

#[test]
fn damaged_stores_give_results_or_errors() {
    let whole = folder();
    let [a, b] = [("a", 1), ("b", 2)].map(|(name, seed)| {
        let path = whole.path().join(name);
        make(&path, seed);
        path
    });
    let [answers, errors] = read_all(whole.path(), &a, &b);
    // The image has no axes t, v, u and no overflow, so readers of these axes and of the overflow report
    // errors.
    assert!(answers > 25 && errors < 8, "{answers} answers, {errors} errors");
    let config = Config { cases: 40, failure_persistence: None, max_shrink_iters: 100, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &[5; 32]));
    let (sound, broken) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let sharded = whole.path().join("sharded");
    let limits = Limits { piece: 500, enough: 10 << 10, ..Limits::default() };
    shard_to(&a, &sharded, false, limits).unwrap();
    let damages = (any::<bool>(), prop::collection::vec(damage(), 1..4));
    let tested = runner.run(&damages, |(in_shards, list)| {
        let folder = folder();
        let damaged = folder.path().join("damaged");
        copy(if in_shards { &sharded } else { &a }, &damaged);
        list.iter().for_each(|d| d.do_to(&damaged));
        // In half of the cases, a new manifest is written after the damage. With a new manifest, the damage
        // passes the manifest check and reaches the readers.
        if list.len() % 2 == 0 {
            crate::zarr::reseal(&damaged);
        }
        let begun = Instant::now();
        let counts = read_all(folder.path(), &damaged, &b);
        prop_assert!(begun.elapsed() < PATIENCE, "it took {:?}", begun.elapsed());
        let largest = LARGEST.load(Ordering::Relaxed);
        prop_assert!(largest <= MEMORY, "{largest} bytes at once");
        sound.fetch_add(counts[0], Ordering::Relaxed);
        broken.fetch_add(counts[1], Ordering::Relaxed);
        Ok(())
    });
    tested.unwrap_or_else(|e| panic!("{e}"));
    println!("{sound:?} answers, {broken:?} errors");
    assert!(sound.into_inner() > 130 && broken.into_inner() > 130);
}
