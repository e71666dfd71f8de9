//! Tests of the locks of stores at URLs, and of URLs without a client.

use super::fake::{life, memory, put};
use super::lock::{NoLock, ObjectLock};
use super::*;
use crate::zarr::TensorStore;
use std::time::{Duration, Instant};

fn below(address: &str) -> Objects {
    let scheme = crate::place::scheme(Path::new(address)).expect("a scheme");
    Objects::open(scheme, Path::new(address)).expect("an address")
}

/// Lease of the tests. The lease is long enough for a busy machine to renew the lock.
const LEASE: Duration = Duration::from_millis(1500);

#[test]
fn a_lock_is_exclusive_and_ends_with_its_holder() {
    let objects = below("memory://locks/s.zarr");
    let first = ObjectLock::take(&objects, LEASE).expect("free");
    let Err(NoLock::Held(who)) = ObjectLock::take(&objects, LEASE) else {
        panic!("two processes hold it");
    };
    assert!(who.starts_with("process "), "{who}");
    drop(first);
    assert_eq!(objects.list(), Ok(vec![]));
    let second = ObjectLock::take(&objects, LEASE).expect("free");
    second.abandon();
    let begun = Instant::now();
    let third = ObjectLock::take(&objects, LEASE).expect("its holder is dead");
    assert!(begun.elapsed() >= LEASE, "the lock of a living process was taken");
    assert!(third.hold().is_sure());
    // After another process has replaced the lock's object, the lock is lost, and the object is not removed.
    put(&memory("locks"), "s.zarr/.sunstone-lock", b"{}".to_vec());
    let hold = third.hold();
    let begun = Instant::now();
    while hold.is_sure() {
        assert!(begun.elapsed() < 20 * LEASE, "the loss is not noticed");
        std::thread::sleep(LEASE / 30);
    }
    drop(third);
    assert_eq!(objects.list().expect("lists").len(), 1);
}

/// Verifies that a conditional put whose response was lost finds its own object when it is repeated.
#[test]
fn locks_are_taken_despite_lost_responses() {
    let objects = below("flaky://bad_line/s.zarr");
    for _ in 0..12 {
        let lock = ObjectLock::take(&objects, LEASE).expect("free");
        assert!(lock.hold().is_sure());
        drop(lock);
        assert_eq!(objects.list(), Ok(vec![]));
    }
}

/// Verifies that a holder relies on its lock no longer than a lease if the server does not respond.
#[test]
fn a_lock_that_cannot_be_renewed_expires() {
    let left = life("cut_off");
    left.store(i64::MAX / 2, std::sync::atomic::Ordering::Relaxed);
    let lock = ObjectLock::take(&below("mortal://cut_off/s.zarr"), LEASE).expect("free");
    left.store(0, std::sync::atomic::Ordering::Relaxed);
    let begun = Instant::now();
    while lock.hold().is_sure() {
        assert!(begun.elapsed() <= LEASE, "it lasts longer than its lease");
        std::thread::sleep(LEASE / 100);
    }
    assert!(begun.elapsed() > LEASE / 2);
}

#[test]
fn without_a_client_every_address_is_refused_with_a_fix() {
    let address = Path::new("s3://bucket/a.zarr");
    let created = TensorStore::create(address, &[], &serde_json::Map::new(), None, false);
    for message in [
        TensorStore::open(address).expect_err("refused").to_string(),
        TensorStore::open_for_write(address).expect_err("refused").to_string(),
        created.expect_err("refused").to_string(),
    ] {
        assert!(message.contains("s3://") && message.contains("--features object-stores"), "{message}");
    }
}
