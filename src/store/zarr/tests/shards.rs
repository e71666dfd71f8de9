//! Tests that sharded stores are bit-identical to their source, and that damage is reported.

use super::*;
use crate::merge::{Options, merge};
use crate::shard::{ShardError, shard, shard_to};

/// Limits with which the small test stores have shards of several chunks.
pub(super) const SMALL: Limits = Limits { piece: 900, enough: 20 << 10, most: 60 << 10, pieces: 400 };

/// Writes a finished store with dark tiles, negative zeros and NaN.
pub(super) fn finished(path: &Path, seed: u64) {
    let attributes =
        json!({"scene_sha256": "abc", "seeds": [seed], "samples_per_pixel": 9, "wall_time_s": 0.5});
    let samples = SampleGrid { camera: [11, 7], tile: 4 };
    let attributes = attributes.as_object().expect("a table");
    let store = TensorStore::create(path, &layouts(), attributes, Some(samples), false).expect("makes");
    for (layout, _) in layouts() {
        let slice = store.slice(&layout.name).expect("a slice");
        for field in Field::ALL.into_iter().filter(|f| slice.has(*f)) {
            let shape = slice.field_layout(field).expect("has it").shape();
            let n = region::volume(&shape).expect("a size");
            let mut data: Vec<f32> =
                (0..n).map(|i| ((i + 7 * seed as usize) as f32 * 0.37).sin() + 2.0).collect();
            data[..4 * n / shape[0] as usize].fill(0.0);
            data[n / 2] = f32::NAN;
            data[n - 40..].fill(-0.0);
            slice.write(field, &vec![0; shape.len()], &shape, &data).expect("writes");
        }
    }
    store.write_samples([0, 0], [7, 11], &[9; 77]).expect("writes");
    store.finish().expect("finishes");
}

/// Creates a store in a folder, and a sharded copy of the store.
pub(super) fn both() -> (tempfile::TempDir, [PathBuf; 2]) {
    let dir = tempfile::tempdir().expect("a folder");
    let paths = ["s.zarr", "shards.zarr"].map(|name| dir.path().join(name));
    finished(&paths[0], 7);
    shard_to(&paths[0], &paths[1], false, SMALL).expect("shards");
    (dir, paths)
}

/// Checks that reading two stores, completely and by regions, gives bit-identical values.
pub(super) fn same(a: &Path, b: &Path) {
    let [a, b] = [a, b].map(|path| TensorStore::open(path).expect("opens"));
    assert!(a.is_finished() && b.is_finished());
    assert_eq!(a.attributes(), b.attributes());
    assert_eq!(a.slice_names(), b.slice_names());
    assert_eq!(a.samples_shape(), b.samples_shape());
    let samples = |s: &TensorStore| s.read_samples([1, 2], [6, 9]).expect("reads");
    assert_eq!(samples(&a), samples(&b));
    let bits = |values: Vec<f32>| values.into_iter().map(f32::to_bits).collect::<Vec<_>>();
    for name in a.slice_names() {
        let [a, b] = [&a, &b].map(|s| s.slice(name).expect("a slice"));
        assert_eq!(a.layout(), b.layout());
        assert_eq!(a.attributes(), b.attributes());
        for field in Field::ALL.into_iter().filter(|f| a.has(*f)) {
            let all = [&a, &b].map(|s| bits(s.read_all(field).expect("reads").data));
            assert!(all[0] == all[1], "{name} {}", field.name());
            let shape = a.field_layout(field).expect("has it").shape();
            let chunks = |s: &StoredSlice| s.chunks(field).expect("has it").collect::<Vec<_>>();
            assert_eq!(chunks(&a), chunks(&b));
            for (start, size) in [([5, 6], [1, 1]), ([3, 2], [3, 7]), ([6, 0], [1, 11])] {
                let (mut from, mut region) = (vec![0; shape.len()], shape.clone());
                from[..2].copy_from_slice(&start);
                region[..2].copy_from_slice(&size);
                let parts = [&a, &b].map(|s| bits(s.read(field, &from, &region).expect("reads")));
                assert!(parts[0] == parts[1], "{name} {} {start:?}", field.name());
            }
        }
    }
}

/// Returns the shards of a store by path.
pub(super) fn shards(path: &Path) -> Vec<(PathBuf, usize)> {
    let names: Vec<String> = manifest::files(path).expect("a folder");
    let of = shard::Shards::in_folder(path, &names);
    let all = names.iter().filter_map(|name| Some((name.into(), of.frames(name)?)));
    all.collect()
}

#[test]
fn sharded_values_are_bit_identical() {
    let (_dir, [plain, sharded]) = both();
    same(&plain, &sharded);
    let found = verify(&sharded).expect("a store");
    assert_eq!(found.faults, Vec::<String>::new());
    let store = TensorStore::open(&sharded).expect("opens");
    assert!(store.is_sharded().expect("opens"));
    // Some chunks of shards cover several unsharded chunks, others cover only a few pixels of an unsharded
    // chunk. An array has several shards.
    let all = shards(&sharded);
    let of_timed = all.iter().filter(|(p, _)| p.starts_with("timed/mean"));
    assert!(of_timed.clone().count() > 1 && of_timed.clone().all(|(_, n)| *n > 8), "{all:?}");
    let [before, after] = [&plain, &sharded].map(|p| files(p).len());
    assert!(after < before, "{after} files of {before}");
    // Sharded stores are read-only.
    let mean = store.slice("timed").expect("a slice");
    let message = mean.write(Field::Mean, &[0; 8], &[1; 8], &[1.0]);
    assert!(message.is_err());
}

/// Verifies that the same command writes the same bytes, and that larger limits give fewer files with the
/// same values.
#[test]
fn shards_are_reproducible() {
    let (dir, [plain, sharded]) = both();
    let [again, large] = ["again", "large"].map(|name| dir.path().join(name));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("threads");
    pool.install(|| shard_to(&plain, &again, false, SMALL)).expect("shards");
    assert!(files(&again) == files(&sharded));
    shard(&plain, &large, false).expect("shards");
    same(&plain, &large);
    assert!(shards(&large).len() < shards(&sharded).len());
    assert!(shards(&large).iter().all(|(_, n)| *n >= 1));
}

#[test]
fn merges_of_sharded_stores_equal_merges_of_plain_ones() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = |name: &str| dir.path().join(name);
    let mut inputs: [Vec<PathBuf>; 2] = [vec![], vec![]];
    for seed in [1, 2] {
        let [plain, sharded] = ["a", "b"].map(|name| path(&format!("{name}{seed}")));
        finished(&plain, seed);
        shard_to(&plain, &sharded, false, SMALL).expect("shards");
        inputs[0].push(plain);
        inputs[1].push(sharded);
    }
    let [plain, sharded] = ["plain", "sharded"].map(path);
    merge(&inputs[0], &plain, Options::default()).expect("merges");
    merge(&inputs[1], &sharded, Options::default()).expect("merges");
    let chunks = |path| {
        let mut all = files(path);
        all.retain(|name, _| name.components().count() == 3);
        all
    };
    assert!(chunks(&plain).len() > 20 && chunks(&plain) == chunks(&sharded));
}

#[test]
fn invalid_requests_are_refused() {
    let (dir, [plain, sharded]) = both();
    let out = dir.path().join("out");
    let message = |input: &Path, out: &Path| shard(input, out, false).expect_err("refused").to_string();
    assert!(message(&plain, &plain).contains("both the input and the output"));
    assert!(message(&sharded, &out).contains("already"));
    assert!(message(&plain, &sharded).contains("--force"));
    assert!(matches!(shard(&dir.path().join("none"), &out, false), Err(ShardError::Open(_))));
    TensorStore::open_for_write(&plain).expect("opens").unfinish().expect("is writable");
    assert!(message(&plain, &out).contains("not finished"));
    assert!(!out.exists());
}

/// Verifies that `verify` detects any changed byte and reports the path of the file, and that reads of the
/// affected values report an error.
#[test]
fn damage_is_detected_and_named() {
    let (_dir, [plain, sharded]) = both();
    let read = |path: &Path| -> Result<Vec<u32>, String> {
        let store = TensorStore::open(path).map_err(|e| e.to_string())?;
        let slice = store.slice("timed").map_err(|e| e.to_string())?;
        let all = slice.read_all(Field::Mean).map_err(|e| e.to_string())?;
        Ok(all.data.into_iter().map(f32::to_bits).collect())
    };
    let expected = read(&plain);
    let all: Vec<_> =
        shards(&sharded).into_iter().filter(|(name, _)| name.starts_with("timed/mean")).collect();
    let found = |name: &Path, what: &str| {
        let message = read(&sharded).expect_err(what);
        assert!(message.contains("timed/mean") && message.contains("cannot read"), "{what}: {message}");
        let faults = verify(&sharded).expect("a store").faults;
        assert_eq!(faults.len(), 1, "{what}: {faults:?}");
        assert!(faults[0].starts_with(name.to_str().expect("text")), "{what}: {faults:?}");
        message
    };
    for (name, frames) in &all {
        let file = sharded.join(name);
        let sound = std::fs::read(&file).expect("reads");
        let tail = sound.len() - shard::tail_len(*frames) as usize;
        for at in (0..tail).step_by(tail / 7).chain((tail..sound.len()).step_by(97)).chain([sound.len() - 1])
        {
            let mut bytes = sound.clone();
            bytes[at] ^= 4;
            std::fs::write(&file, bytes).expect("writes");
            let message = found(name, &format!("byte {at} of {}, tail at {tail}", sound.len()));
            assert!(at < tail || message.contains("shard ["), "{message}");
        }
        for length in [0, 3, tail / 2, sound.len() - 1] {
            std::fs::write(&file, &sound[..length]).expect("writes");
            found(name, "a truncated shard");
        }
        std::fs::write(&file, [&sound[..], &[0]].concat()).expect("writes");
        found(name, "a longer shard");
        std::fs::remove_file(&file).expect("is there");
        assert!(found(name, "a lost shard").contains("missing"));
        std::fs::write(&file, &sound).expect("writes");
    }
    assert_eq!(read(&sharded), expected);
    // Two valid shards are exchanged.
    let [a, b] = [0, 1].map(|n| sharded.join(&all[n].0));
    let [of_a, of_b] = [&a, &b].map(|path| std::fs::read(path).expect("reads"));
    std::fs::write(&a, &of_b).expect("writes");
    std::fs::write(&b, &of_a).expect("writes");
    assert!(read(&sharded).expect_err("exchanged").contains("cannot read"));
    assert_eq!(verify(&sharded).expect("a store").faults.len(), 2);
}

/// Verifies that the manifest detects a frame that was replaced by another valid frame of the same size,
/// with an unchanged index.
#[test]
fn exchanged_frames_are_detected() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("s.zarr");
    let sealed = |byte: u8| {
        let frame = vec![byte; 40];
        [&frame[..], &crc32c::crc32c(&frame).to_le_bytes()].concat()
    };
    let file = |byte| {
        let mut builder = shard::Builder::new(1);
        builder.push(0, &sealed(byte));
        builder.finish().expect("has a frame").0
    };
    let json = json!({"chunk_grid": {"configuration": {"chunk_shape": [4]}},
        "codecs": [{"name": "sharding_indexed", "configuration": {"chunk_shape": [4]}}]});
    base::whole_file::write(&path.join("a/zarr.json"), json.to_string().as_bytes()).expect("writes");
    base::whole_file::write(&path.join("a/c.0"), &file(1)).expect("writes");
    Manifest::write(&path).expect("writes");
    assert_eq!(verify(&path).expect("a store").faults, Vec::<String>::new());
    std::fs::write(path.join("a/c.0"), file(2)).expect("writes");
    assert_eq!(file(1)[64..], file(2)[64..], "the index and its checksum");
    assert_eq!(verify(&path).expect("a store").faults, ["a/c.0: was changed after it was written"]);
}

/// Prints how the file size and the time for sharding depend on the chunk size. Run the test with
/// `SUNSTONE_STORE=PATH cargo test --release -p sunstone-store -- --ignored --nocapture costs`.
#[test]
#[ignore = "a measurement"]
fn costs_of_small_chunks() {
    let input = PathBuf::from(std::env::var_os("SUNSTONE_STORE").expect("a store"));
    let store = TensorStore::open(&input).expect("opens");
    let dir = tempfile::tempdir().expect("a folder");
    let size = |path: &Path, folder: &str| -> usize {
        let all = files(path).into_iter();
        let of = all.filter(|(name, _)| name.starts_with(folder) && !name.ends_with("zarr.json"));
        of.map(|(_, bytes)| bytes.len()).sum()
    };
    for kib in [2, 4, 8, 16, 32, 64, 1 << 20] {
        let limits = Limits { piece: kib << 10, ..Limits::default() };
        let out = dir.path().join("out");
        let begun = std::time::Instant::now();
        shard_to(&input, &out, true, limits).expect("shards");
        let seconds = begun.elapsed().as_secs_f64();
        let sharded = TensorStore::open(&out).expect("opens");
        let of: Vec<String> = store
            .slice_names()
            .iter()
            .map(|name| {
                let slice = sharded.slice(name).expect("a slice");
                let inner = slice.field(Field::Mean).expect("has it").1.unit().to_vec();
                let folder = format!("{name}/mean");
                let more = 100.0 * (size(&out, &folder) as f64 / size(&input, &folder) as f64 - 1.0);
                format!("{name} {} x {} px {more:+.2} %", inner[0], inner[1])
            })
            .collect();
        println!("{kib} KiB, {seconds:.1} s: {}", of.join(", "));
    }
}
