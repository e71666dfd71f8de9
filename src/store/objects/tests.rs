//! Object stores in memory: what is read, asked again and refused.

pub(crate) mod faulty;

use super::get::Ask;
use super::lock::{NoLock, ObjectLock};
use super::put::Put;
use super::*;
use bytes::Bytes;
use object_store::ObjectStoreExt;
use object_store::memory::InMemory;
use std::collections::HashMap;
use std::sync::Mutex;

static STORES: LazyLock<Mutex<HashMap<String, Arc<InMemory>>>> = LazyLock::new(Mutex::default);

/// The object store in memory that addresses `memory://NAME/..` of tests lie in.
pub(crate) fn memory(name: &str) -> Arc<InMemory> {
    let mut stores = STORES.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    stores.entry(name.to_owned()).or_default().clone()
}

/// Puts the files of a folder below `memory://NAME/PATH`.
pub(crate) fn upload(folder: &Path, name: &str, path: &str) {
    let store = memory(name);
    let mut folders = vec![folder.to_owned()];
    while let Some(at) = folders.pop() {
        for entry in std::fs::read_dir(at).expect("a folder") {
            let file = entry.expect("an entry").path();
            if file.is_dir() {
                folders.push(file);
                continue;
            }
            let key = format!("{path}/{}", file.strip_prefix(folder).expect("below").display());
            let bytes = std::fs::read(&file).expect("reads");
            put(&store, &key, bytes);
        }
    }
}

/// Puts one object.
pub(crate) fn put(store: &Arc<InMemory>, key: &str, bytes: Vec<u8>) {
    let (store, key) = (store.clone(), Key::from(key));
    wait(async move { store.put(&key, bytes.into()).await })
        .expect("runs")
        .expect("is put");
}

/// Removes one object.
pub(crate) fn remove(store: &Arc<InMemory>, key: &str) {
    let (store, key) = (store.clone(), Key::from(key));
    wait(async move { store.delete(&key).await })
        .expect("runs")
        .expect("is removed");
}

impl Objects {
    /// Requests until now.
    pub(crate) fn requests(&self) -> u64 {
        self.requests.load(std::sync::atomic::Ordering::Relaxed)
    }
}

#[test]
fn objects_are_read_and_listed_below_their_address() {
    let store = memory("listed");
    for key in ["a/s.zarr/zarr.json", "a/s.zarr/x/c.0.0", "a/s.zarr2/zarr.json"] {
        put(&store, key, key.as_bytes().to_vec());
    }
    let objects = Objects::open("memory", Path::new("memory://listed/a/s.zarr/")).expect("an address");
    assert_eq!(
        objects.list().expect("lists"),
        [("x/c.0.0".to_owned(), 16), ("zarr.json".to_owned(), 18)]
    );
    let keys = ["x/c.0.0", "nothing", "zarr.json"].map(str::to_owned);
    let found = objects.get_many(&keys).expect("reads");
    let expected = [Some("a/s.zarr/x/c.0.0"), None, Some("a/s.zarr/zarr.json")];
    assert_eq!(found, expected.map(|text| text.map(Bytes::from)));
    assert_eq!(objects.get("nothing"), Ok(None));
    assert_eq!(objects.requests(), 5);
}

/// Within another runtime's threads as well.
#[test]
fn another_runtime_is_not_in_the_way() {
    put(&memory("within"), "a", vec![1]);
    let objects = Objects::open("memory", Path::new("memory://within")).expect("an address");
    let outer = Builder::new_current_thread().build().expect("a runtime");
    let found = outer.block_on(async { objects.get("a") });
    assert_eq!(found, Ok(Some(Bytes::from(vec![1]))));
}

#[test]
fn errors_say_what_is_to_be_done() {
    let generic = |text: &str| Error::Generic {
        store: "S3",
        source: text.to_owned().into(),
    };
    for (text, scheme, what, fix) in [
        (
            "404: <Code>NoSuchBucket</Code>",
            "s3",
            "no such bucket",
            "AWS_ENDPOINT",
        ),
        (
            "GET http://169.254.169.254/latest",
            "s3",
            "no credentials",
            "AWS_SKIP_SIGNATURE",
        ),
        (
            "MissingCredential",
            "az",
            "no credentials",
            "AZURE_STORAGE_ACCOUNT_NAME",
        ),
        ("operation timed out", "gs", "in time", "network"),
        ("error sending request: tcp", "gs", "reached", "GOOGLE_BASE_URL"),
        ("error sending request: tcp", "https", "reached", "the address"),
        (
            "403 <Code>SignatureDoesNotMatch</Code>",
            "s3",
            "denied",
            "AWS_SECRET_ACCESS_KEY",
        ),
        ("301 Moved Permanently", "s3", "another region", "AWS_REGION"),
        ("what\nnobody knows", "s3", "what nobody knows", "check"),
    ] {
        let told = refusal(scheme, &generic(text));
        assert!(
            told.what.contains(what) && told.fix.contains(fix),
            "{text}: {told}"
        );
    }
}

#[test]
fn addresses_that_cannot_be_are_refused() {
    for (address, word) in [
        ("s3://", "s3://NAME"),
        ("https://host/s?token=1", "folder"),
        ("s3://bucket/a//b", "path"),
        ("ftp://host/a", "s3://"),
    ] {
        let scheme = crate::place::scheme(Path::new(address)).expect("a scheme");
        let told = Objects::open(scheme, Path::new(address))
            .expect_err("refused")
            .to_string();
        assert!(told.contains(word), "{address}: {told}");
    }
}

fn below(address: &str) -> Objects {
    let scheme = crate::place::scheme(Path::new(address)).expect("a scheme");
    Objects::open(scheme, Path::new(address)).expect("an address")
}

/// Requests that are not heard, and answers that are lost: all kinds of requests, at all places in the pattern of failures.
#[test]
fn what_fails_is_asked_again() {
    let objects = below("flaky://asked/s.zarr");
    let bytes = |n: u8| Bytes::from(vec![n; 9]);
    for n in 0..12 {
        let keys: Vec<String> = (0..=n).map(|k| format!("a/{k}")).collect();
        let all = keys.iter().map(|key| (key.clone(), bytes(n))).collect();
        objects.put_many(all).expect("puts");
        let found = objects.list().expect("lists");
        assert_eq!(found.len(), keys.len());
        let ends = found
            .iter()
            .map(|(key, size)| (key.clone(), Ask::End(4, Some(*size))));
        assert_eq!(
            objects.ask(ends.clone().collect()).expect("reads"),
            vec![Some((bytes(n).slice(5..), 9)); keys.len()]
        );
        assert_eq!(
            objects.get_many(&keys).expect("reads"),
            vec![Some(bytes(n)); keys.len()]
        );
        let (found, old) = objects.get_version("a/0").expect("reads").expect("is there");
        assert_eq!(found, bytes(n));
        // The answer may be lost: then something is there, which is this.
        let put = objects.put_over("a/0", bytes(99), old.clone()).expect("puts");
        let (found, now) = objects.get_version("a/0").expect("reads").expect("is there");
        assert_eq!(found, bytes(99));
        assert!(matches!(put, Put::Other) || matches!(put, Put::Done(of) if of == now));
        assert!(matches!(objects.put_over("a/0", bytes(98), old), Ok(Put::Other)));
        assert!(matches!(objects.put_new("a/0", bytes(97)), Ok(Put::Other)));
        assert_eq!(objects.get("a/0"), Ok(Some(bytes(99))));
        objects.delete(keys).expect("deletes");
        assert_eq!(objects.list(), Ok(vec![]));
    }
}

#[test]
fn web_servers_are_read_only() {
    let told = below("https://host/s.zarr")
        .may_be_written()
        .expect_err("refused");
    assert!(
        told.what.contains("read only") && told.fix.contains("s3://"),
        "{told}"
    );
    assert_eq!(below("s3://bucket/s.zarr").may_be_written(), Ok(()));
}

/// Long enough for a busy machine to renew it.
const LEASE: Duration = Duration::from_secs(3);

#[test]
fn a_lock_is_one_process_s_and_ends_with_it() {
    let objects = below("memory://locks/s.zarr");
    let first = ObjectLock::take(&objects, LEASE).expect("free");
    let Err(NoLock::Held(who)) = ObjectLock::take(&objects, LEASE) else {
        panic!("two hold it");
    };
    assert!(who.starts_with("process "), "{who}");
    drop(first);
    assert_eq!(objects.list(), Ok(vec![]));
    let second = ObjectLock::take(&objects, LEASE).expect("free");
    second.abandon();
    let begun = Instant::now();
    let third = ObjectLock::take(&objects, LEASE).expect("its holder is dead");
    assert!(begun.elapsed() >= LEASE, "who lives is not robbed");
    assert!(third.hold().is_sure());
    // Another's in its place: it is lost, and not removed.
    put(&memory("locks"), "s.zarr/.sunstone-lock", b"{}".to_vec());
    let hold = third.hold();
    let begun = Instant::now();
    while hold.is_sure() {
        assert!(begun.elapsed() < 20 * LEASE, "it is not noticed");
        std::thread::sleep(LEASE / 30);
    }
    drop(third);
    assert_eq!(objects.list().expect("lists").len(), 1);
}

/// A conditional put whose answer was lost is its own when it is made again.
#[test]
fn locks_are_taken_over_a_bad_line() {
    let objects = below("flaky://bad_line/s.zarr");
    for _ in 0..12 {
        let lock = ObjectLock::take(&objects, LEASE).expect("free");
        assert!(lock.hold().is_sure());
        drop(lock);
        assert_eq!(objects.list(), Ok(vec![]));
    }
}

/// While its server does not answer, a holder is sure of its lock no longer than a lease.
#[test]
fn a_lock_that_cannot_be_renewed_is_not_sure() {
    let left = faulty::life("cut_off");
    left.store(i64::MAX, std::sync::atomic::Ordering::Relaxed);
    let lock = ObjectLock::take(&below("mortal://cut_off/s.zarr"), LEASE).expect("free");
    left.store(0, std::sync::atomic::Ordering::Relaxed);
    let begun = Instant::now();
    while lock.hold().is_sure() {
        assert!(begun.elapsed() <= LEASE, "it is believed for longer");
        std::thread::sleep(LEASE / 100);
    }
    assert!(begun.elapsed() > LEASE / 2);
}
