//! Tests that sharded stores at a URL have the values of their source when read by byte ranges, even after
//! failures and killed processes.

use super::remote_writing::{address, kill_everywhere, objects_of};
use super::shards::{SMALL, both, same, shards};
use super::*;
use crate::objects::fake::{memory, put, remove, requests, upload};
use crate::shard::{ShardError, shard_to};

#[test]
fn a_profile_needs_few_range_requests() {
    let (_dir, [plain, sharded]) = both();
    upload(&sharded, "ranges", "s.zarr");
    let address = address("memory", "ranges");
    same(&plain, &address);
    assert_eq!(verify(&address).expect("a store"), verify(&sharded).expect("a store"));
    let earlier = requests("ranges");
    let store = TensorStore::open(&address).expect("opens");
    assert_eq!(requests("ranges") - earlier, 2);
    let slice = store.slice("timed").expect("a slice");
    let opened = requests("ranges");
    assert_eq!(opened - earlier, 2, "its coordinates came with the root's description");
    let shape = slice.layout().shape();
    let region = |y, x| {
        let (mut at, mut profile) = (vec![0; shape.len()], shape.clone());
        (profile[0], profile[1]) = (1, 1);
        (at[0], at[1]) = (y, x);
        (at, profile)
    };
    let read = |y, x| {
        let (at, profile) = region(y, x);
        slice.read(Field::Mean, &at, &profile).expect("reads")
    };
    assert!(read(5, 6).iter().all(|v| *v != 0.0));
    let first = requests("ranges") - opened;
    let _ = read(5, 7);
    let second = requests("ranges") - opened - first;
    // The first read requests the shard's tail and the pixel's chunk. A read of a neighbouring pixel does
    // not request the tail again.
    assert!(second >= 1 && first == second + 1, "{first}, then {second}");
    // A dark pixel needs at most the tail.
    let before = requests("ranges");
    assert!(read(1, 6).iter().all(|v| *v == 0.0));
    assert!(requests("ranges") - before <= 1);
    // Reads of whole arrays request the tails, and adjacent chunks together.
    let all = shards(&sharded);
    let of_error = all.iter().filter(|(p, _)| p.starts_with("timed/std_error")).count() as u64;
    let before = requests("ranges");
    slice.read_all(Field::StdError).expect("reads");
    let asked = requests("ranges") - before;
    assert!((of_error + 1..=2 * of_error).contains(&asked), "{asked} of {of_error} shards");
    // Data that was fetched together is not fetched again.
    let (at, profile) = region(6, 2);
    let fields = [Field::Mean, Field::StdError];
    slice.fetch_together(&fields.map(|f| (f, at.clone(), profile.clone()))).expect("fetches");
    let fetched = requests("ranges");
    for field in fields {
        slice.read(field, &at, &profile).expect("reads");
    }
    assert_eq!(requests("ranges"), fetched);
}

#[test]
fn sharding_works_over_an_unreliable_connection() {
    let (_dir, [plain, sharded]) = both();
    let there = address("flaky", "badshards");
    shard_to(&plain, &there, false, SMALL).expect("shards");
    same(&plain, &there);
    assert!(objects_of("badshards") == files(&sharded));
    assert_eq!(verify(&there).expect("a store").faults, Vec::<String>::new());
}

#[test]
fn sharding_can_be_killed_at_any_change() {
    let (_dir, [plain, sharded]) = both();
    let expected = files(&sharded);
    let _ = kill_everywhere(
        "sharding",
        &expected,
        |path| shard_to(&plain, path, false, SMALL).is_ok(),
        |path| match shard_to(&plain, path, false, SMALL) {
            Ok(()) => true,
            // The process was killed after the last put, so the store is complete.
            Err(ShardError::Create(CreateError::Exists { .. })) => {
                let name = path.to_str().expect("text").split('/').nth(2).expect("a name");
                remove(&memory(name), "s.zarr/.sunstone-origin");
                true
            }
            Err(e) => panic!("{e}"),
        },
    );
}

#[test]
fn damage_is_detected_by_range_requests() {
    let (_dir, [plain, sharded]) = both();
    upload(&sharded, "shardfaults", "s.zarr");
    let address = address("memory", "shardfaults");
    let all: Vec<_> =
        shards(&sharded).into_iter().filter(|(name, _)| name.starts_with("timed/mean")).collect();
    let read = || {
        let store = TensorStore::open(&address).expect("opens");
        let slice = store.slice("timed").expect("a slice");
        slice.read_all(Field::Mean).map(drop).map_err(|e| e.to_string())
    };
    let objects = memory("shardfaults");
    let place = |n: usize| format!("s.zarr/{}", all[n].0.display());
    let file = |n: usize| std::fs::read(sharded.join(&all[n].0)).expect("reads");
    let sound = file(0);
    let tail = sound.len() - shard::tail_len(all[0].1) as usize;
    let changed = |at: usize| {
        let mut bytes = sound.clone();
        bytes[at] ^= 1;
        bytes
    };
    for (what, bytes) in [
        ("a byte of a frame", changed(tail / 2)),
        ("a byte of the seals", changed(tail + 1)),
        ("a byte of the index", changed(sound.len() - 30)),
        ("a byte of its checksum", changed(sound.len() - 2)),
        ("a truncated shard", sound[..sound.len() - 7].to_vec()),
        ("a stub", sound[..20].to_vec()),
        ("another shard", file(1)),
    ] {
        put(&objects, &place(0), bytes);
        let message = read().expect_err(what);
        assert!(message.contains("timed/mean") && message.contains("cannot read"), "{what}: {message}");
        let faults = verify(&address).expect("a store").faults;
        assert!(
            faults.len() == 1 && faults[0].starts_with(all[0].0.to_str().expect("text")),
            "{what}: {faults:?}"
        );
    }
    remove(&objects, &place(0));
    assert!(read().expect_err("lost").contains("missing"));
    put(&objects, &place(0), sound);
    same(&plain, &address);
}
