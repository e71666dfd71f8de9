//! Tests that stores written at a URL are byte-identical to stores in a folder, even after failures and
//! killed processes.

use super::*;
use crate::objects::fake::life;
use crate::objects::fake::{memory, put, remove};
use crate::objects::lock::ObjectLock;
use crate::sink::{SinkError, Target, ZarrSink};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;
use tensor::sink::{Job, JobSlice, Piece, SampleCounts, Sink, Summary, TileRecord};

const LOCK: &str = "s.zarr/.sunstone-lock";

pub(super) fn address(scheme: &str, name: &str) -> PathBuf {
    PathBuf::from(format!("{scheme}://{name}/s.zarr"))
}

/// Returns the objects of a store by path, with their bytes.
pub(super) fn objects_of(name: &str) -> BTreeMap<PathBuf, Vec<u8>> {
    let address = address("memory", name);
    let objects = remote_store::objects_of(&address).expect("an address").expect("objects");
    let found = objects.list().expect("lists");
    let names: Vec<String> = found.into_iter().map(|(name, _)| name).collect();
    let bytes = objects.get_many(&names).expect("reads");
    let all = names.into_iter().zip(bytes);
    all.map(|(name, bytes)| (name.into(), bytes.expect("is there").to_vec())).collect()
}

fn job(part: Option<Part>) -> Job {
    let mut attributes = json!({"scene_sha256": "abc", "seeds": [7], "samples_per_pixel": 4});
    if let Some(part) = part {
        attributes[tensor::part::ATTRIBUTE] = part.to_json();
    }
    Job {
        slices: layouts().into_iter().map(|(layout, attributes)| JobSlice { layout, attributes }).collect(),
        attributes: attributes.as_object().expect("a table").clone(),
        camera: [11, 7],
        tile: 4,
    }
}

/// Renders the missing tiles of a store.
fn render(path: &Path, resume: bool, part: Option<Part>) -> Result<(), SinkError> {
    let mut sink = ZarrSink::new(Target { path: path.to_owned(), resume, replace: false });
    let done = sink.begin(&job(part))?;
    for tile in 0..6 {
        if done.iter().any(|r| r.tile == tile) || part.is_some_and(|p| !p.contains(tile)) {
            continue;
        }
        let corner = [u64::from(tile / 3 * 4), u64::from(tile % 3 * 4)];
        let size = [(7 - corner[0]).min(4), (11 - corner[1]).min(4)];
        for (slice, (layout, _)) in layouts().iter().enumerate() {
            for field in [Field::Mean, Field::StdError] {
                let mut shape = layout.shape();
                let mut start = vec![0; shape.len()];
                shape[..2].copy_from_slice(&size);
                start[..2].copy_from_slice(&corner);
                let mut data = ramp(region::volume(&shape).expect("a size"));
                if tile == 1 {
                    data.fill(0.0);
                }
                sink.put(&Piece { slice, field, start: &start, shape: &shape, data: &data, touched: &[] })?;
            }
        }
        let counts = vec![4; (size[0] * size[1]) as usize];
        sink.put_samples(&SampleCounts { start: corner, shape: size, counts: &counts })?;
        sink.tile_done(&TileRecord { tile, ..TileRecord::default() })?;
    }
    sink.end(&Summary { complete: true, ..Summary::default() })
}

/// Returns the files of a store that `make` creates in a folder.
fn in_folder(make: impl FnOnce(&Path)) -> BTreeMap<PathBuf, Vec<u8>> {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("s.zarr");
    make(&path);
    files(&path)
}

/// Runs `make` repeatedly, each time as a process that is killed before a change, for about every third
/// change. Then resumes with `again`. Checks that incomplete stores never count as finished, and that the
/// final objects equal `expected`. Returns the number of changes.
pub(super) fn kill_everywhere(
    name: &str,
    expected: &BTreeMap<PathBuf, Vec<u8>>,
    make: impl Fn(&Path) -> bool,
    again: impl Fn(&Path) -> bool,
) -> i64 {
    let left = |name: &str, n: i64| -> std::sync::Arc<AtomicI64> {
        let life = life(name);
        life.store(n, Ordering::Relaxed);
        life
    };
    let whole = left(name, 1 << 40);
    assert!(make(&address("mortal", name)));
    let changes = (1 << 40) - whole.load(Ordering::Relaxed);
    assert!(changes > 40, "{changes}");
    assert_eq!(objects_of(name), *expected);
    // Also test each of the first and last changes, which begin and finish the store.
    let all = 0..changes;
    for n in all.filter(|n| n % 3 == 0 || *n < 6 || changes - n < 16) {
        let name = format!("{name}{n}");
        let path = address("mortal", &name);
        let life = left(&name, n);
        let message = make(&path);
        life.store(1 << 40, Ordering::Relaxed);
        let seen = objects_of(&name);
        let finished = TensorStore::open(&path).is_ok_and(|s| s.is_finished() || s.is_finished_part());
        let has_all = expected.iter().all(|(name, bytes)| seen.get(name) == Some(bytes));
        assert_eq!(finished, has_all, "{n}");
        assert!(finished || !message, "{n}");
        // The lease has expired.
        remove(&memory(&name), LOCK);
        assert!(again(&path), "{n}");
        assert_eq!(objects_of(&name), *expected, "{n}");
    }
    changes
}

#[test]
fn a_render_can_be_killed_at_any_change() {
    let expected = in_folder(|path| render(path, false, None).expect("renders"));
    let _ = kill_everywhere(
        "killed",
        &expected,
        |path| render(path, false, None).is_ok(),
        |path| render(path, true, None).map_err(|e| eprintln!("{e}")).is_ok(),
    );
}

#[test]
fn a_part_can_be_killed_at_any_change() {
    let part = Some(Part::Share { number: 1, of: 2 });
    let expected = in_folder(|path| render(path, false, part).expect("renders"));
    assert!(expected.contains_key(Path::new(manifest::OF_PART)));
    let _ = kill_everywhere(
        "part",
        &expected,
        |path| render(path, false, part).is_ok(),
        |path| render(path, true, part).map_err(|e| eprintln!("{e}")).is_ok(),
    );
    let address = address("memory", "part");
    let verified = verify(&address).expect("a part");
    assert_eq!(verified.part, part);
    assert_eq!(verified.faults, Vec::<String>::new());
    assert!(TensorStore::open_part(&address).expect("opens").is_some());
}

/// Verifies that a repeated creation of a store with values resumes the interrupted creation.
#[test]
fn a_merge_can_be_killed_at_any_change() {
    let make = |path: &Path, origin: &str| {
        let fill = |store: &TensorStore| -> Result<(), CreateError> {
            for (layout, _) in layouts() {
                let slice = store.slice(&layout.name).expect("a slice");
                for (start, shape) in slice.chunks(Field::Mean).expect("has it") {
                    if slice.is_stored(Field::Mean, &start).expect("has it") {
                        continue;
                    }
                    let data = ramp(region::volume(&shape).expect("a size"));
                    let failed = |e: String| CreateError::Write { path: path.to_owned(), cause: e };
                    slice.write(Field::Mean, &start, &shape, &data).map_err(|e| failed(e.to_string()))?;
                }
            }
            store.finish().map_err(|e| CreateError::Write { path: path.to_owned(), cause: e.to_string() })
        };
        let none = Map::new();
        TensorStore::create_from(path, &layouts(), &none, None, false, Some(origin), fill)
    };
    let expected = in_folder(|path| drop(make(path, "a b").expect("makes")));
    let is_there = |e| matches!(e, CreateError::Exists { .. });
    let all = kill_everywhere(
        "merged",
        &expected,
        |path| make(path, "a b").is_ok(),
        |path| match (TensorStore::is_taken(path).expect("answers"), make(path, "a b")) {
            (taken, Ok(_)) => !taken,
            // The process was killed after the last put, so the store is complete.
            (taken, Err(e)) => {
                assert!(taken, "{e}");
                remove(
                    &memory(path.to_str().expect("text").split('/').nth(2).expect("a name")),
                    "s.zarr/.sunstone-origin",
                );
                is_there(e)
            }
        },
    );
    // A creation reuses chunks of the same origin, but not chunks of another origin.
    let begun = |name: &str| {
        let life = life(name);
        life.store(all - 4, Ordering::Relaxed);
        assert!(make(&address("mortal", name), "a b").is_err());
        life.store(1 << 40, Ordering::Relaxed);
        remove(&memory(name), LOCK);
        life
    };
    let changes = |name: &str, origin: &str| {
        let life = begun(name);
        make(&address("mortal", name), origin).expect("makes");
        assert_eq!(objects_of(name), expected);
        (1 << 40) - life.load(Ordering::Relaxed)
    };
    let (same, other) = (changes("same", "a b"), changes("other", "a c"));
    assert!(same < 12 && other >= all, "{same} changes, and {other} of {all}");
}

#[test]
fn a_render_works_over_an_unreliable_connection() {
    let expected = in_folder(|path| render(path, false, None).expect("renders"));
    render(&address("flaky", "bad"), false, None).expect("renders");
    assert_eq!(objects_of("bad"), expected);
    render(&address("flaky", "bad"), true, None).expect("is complete");
    assert_eq!(objects_of("bad"), expected);
    assert_eq!(verify(&address("flaky", "bad")).expect("a store").faults, Vec::<String>::new());
}

/// Verifies that chunks can be written repeatedly, pixel by pixel.
#[test]
fn pixels_are_written_into_existing_chunks() {
    let write = |path: &Path| {
        let store = create(path);
        for (layout, _) in layouts() {
            let slice = store.slice(&layout.name).expect("a slice");
            let mut shape = layout.shape();
            let (rows, columns) = (shape[0], shape[1]);
            (shape[0], shape[1]) = (1, 1);
            let data = ramp(region::volume(&shape).expect("a size"));
            for (y, x) in (2..rows).flat_map(|y| (0..columns).step_by(3).map(move |x| (y, x))) {
                let mut start = vec![0; shape.len()];
                (start[0], start[1]) = (y, x);
                slice.write(Field::Mean, &start, &shape, &data).expect("writes");
                let zero = vec![0.0; data.len()];
                start[1] = (x + 1).min(columns - 1);
                slice.write(Field::Mean, &start, &shape, &zero).expect("writes");
            }
        }
        store.finish().expect("finishes");
    };
    write(&address("memory", "pixels"));
    assert_eq!(objects_of("pixels"), in_folder(write));
}

#[test]
fn only_stores_are_replaced() {
    let objects = memory("replaced");
    let address = address("memory", "replaced");
    let make = |replace| TensorStore::create(&address, &layouts(), &Map::new(), None, replace);
    put(&objects, "s.zarr/thesis.tex", vec![1]);
    for replace in [false, true] {
        assert!(matches!(make(replace), Err(CreateError::NotAStore { .. })));
    }
    remove(&objects, "s.zarr/thesis.tex");
    drop(make(false).expect("free"));
    assert!(matches!(make(false), Err(CreateError::Exists { .. })));
    render(&address, true, None).expect_err("another render");
    let begun = objects_of("replaced");
    drop(make(true).expect("may be replaced"));
    assert_eq!(objects_of("replaced"), begun);
    remove(&objects, "s.zarr/zarr.json");
    assert!(matches!(make(true), Err(CreateError::NotAStore { .. })));
}

#[test]
fn writes_stop_after_the_lock_is_lost() {
    let address = address("memory", "lost");
    drop(create(&address));
    let objects = remote_store::objects_of(&address).expect("an address").expect("objects");
    let lock = ObjectLock::take(&objects, Duration::from_secs(1)).expect("free");
    let (storage, held) = remote_store::open_locked(&address, &objects, lock).expect("opens");
    let store = TensorStore::over(storage, State::Writing, Some(held)).expect("opens");
    store.write_samples([0, 0], [1, 1], &[1]).expect("writes");
    put(&memory("lost"), LOCK, b"{}".to_vec());
    let begun = std::time::Instant::now();
    let message = loop {
        if let Err(e) = store.write_samples([0, 0], [1, 1], &[1]) {
            break e.to_string();
        }
        assert!(begun.elapsed() < Duration::from_secs(30), "it is not noticed");
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(message.contains("lock") && message.contains("--resume"), "{message}");
    assert!(store.finish().is_err());
    assert!(!TensorStore::open(&address).expect("opens").is_finished());
    drop(store);
    assert!(objects_of("lost").contains_key(Path::new(".sunstone-lock")), "it is another's");
}

#[test]
fn stores_opened_for_reading_are_not_written() {
    render(&address("memory", "kept"), false, None).expect("renders");
    let before = objects_of("kept");
    let store = TensorStore::open(&address("memory", "kept")).expect("opens");
    assert!(store.write_samples([0, 0], [1, 1], &[1]).is_err());
    assert!(store.unfinish().is_err());
    assert_eq!(objects_of("kept"), before);
}
