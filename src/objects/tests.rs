//! Tests with object stores in memory: reads, repeated requests and refused requests.

pub(crate) mod faulty;

use super::*;
use bytes::Bytes;
use object_store::ObjectStoreExt;
use object_store::memory::InMemory;
use std::collections::HashMap;
use std::sync::Mutex;
use store::objects::{Ask, Condition, ObjectClient, Put};

static STORES: LazyLock<Mutex<HashMap<String, Arc<InMemory>>>> = LazyLock::new(Mutex::default);

/// Returns the in-memory object store of test URLs `memory://NAME/..`.
pub(crate) fn memory(name: &str) -> Arc<InMemory> {
    let mut stores = STORES.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    stores.entry(name.to_owned()).or_default().clone()
}

pub(crate) fn put(store: &Arc<InMemory>, key: &str, bytes: Vec<u8>) {
    let (store, key) = (store.clone(), Key::from(key));
    wait(async move { store.put(&key, bytes.into()).await }).expect("runs").expect("is put");
}

#[test]
fn objects_are_read_and_listed_below_their_address() {
    let store = memory("listed");
    for key in ["a/s.zarr/zarr.json", "a/s.zarr/x/c.0.0", "a/s.zarr2/zarr.json"] {
        put(&store, key, key.as_bytes().to_vec());
    }
    let objects = Objects::open("memory", Path::new("memory://listed/a/s.zarr/")).expect("an address");
    assert_eq!(objects.list().expect("lists"), [("x/c.0.0".to_owned(), 16), ("zarr.json".to_owned(), 18)]);
    let keys = ["x/c.0.0", "nothing", "zarr.json"].map(str::to_owned);
    let found = whole(&objects, &keys);
    let expected = [Some("a/s.zarr/x/c.0.0"), None, Some("a/s.zarr/zarr.json")];
    assert_eq!(found, expected.map(|text| text.map(Bytes::from)));
}

#[test]
fn calls_work_inside_another_runtime() {
    put(&memory("within"), "a", vec![1]);
    let objects = Objects::open("memory", Path::new("memory://within")).expect("an address");
    let outer = Builder::new_current_thread().build().expect("a runtime");
    let found = outer.block_on(async { objects.get_version("a") });
    assert_eq!(found.expect("reads").expect("is there").0, vec![1]);
}

#[test]
fn errors_name_the_fix() {
    let generic = |text: &str| Error::Generic { store: "S3", source: text.to_owned().into() };
    for (text, scheme, what, fix) in [
        ("404: <Code>NoSuchBucket</Code>", "s3", "the bucket does not exist", "AWS_ENDPOINT"),
        ("GET http://169.254.169.254/latest", "s3", "no credentials", "AWS_SKIP_SIGNATURE"),
        ("MissingCredential", "az", "no credentials", "AZURE_STORAGE_ACCOUNT_NAME"),
        ("operation timed out", "gs", "in time", "network"),
        ("error sending request: tcp", "gs", "cannot connect", "GOOGLE_BASE_URL"),
        ("error sending request: tcp", "https", "cannot connect", "the address"),
        ("403 <Code>SignatureDoesNotMatch</Code>", "s3", "denies access", "AWS_SECRET_ACCESS_KEY"),
        ("301 Moved Permanently", "s3", "another region", "AWS_REGION"),
        ("what\nnobody knows", "s3", "what nobody knows", "check"),
    ] {
        let message = refusal(scheme, &generic(text));
        assert!(message.what.contains(what) && message.fix.contains(fix), "{text}: {message}");
    }
}

#[test]
fn invalid_addresses_are_refused() {
    for (address, word) in [
        ("s3://", "s3://NAME"),
        ("https://host/s?token=1", "folder"),
        ("s3://bucket/a//b", "path"),
        ("ftp://host/a", "s3://"),
    ] {
        let scheme = store::place::scheme(Path::new(address)).expect("a scheme");
        let message = Objects::open(scheme, Path::new(address)).expect_err("refused").to_string();
        assert!(message.contains(word), "{address}: {message}");
    }
}

fn whole(objects: &Objects, keys: &[String]) -> Vec<Option<Bytes>> {
    let asks = keys.iter().map(|key| (key.clone(), Ask::Whole)).collect();
    let found = objects.ask(asks).expect("reads");
    found.into_iter().map(|f| f.map(|(bytes, _)| bytes)).collect()
}

fn below(address: &str) -> Objects {
    let scheme = store::place::scheme(Path::new(address)).expect("a scheme");
    Objects::open(scheme, Path::new(address)).expect("an address")
}

/// Verifies that lost requests and lost responses are repeated, for all kinds of requests and at all
/// positions of the failure pattern.
#[test]
fn failed_requests_are_repeated() {
    let objects = below("flaky://asked/s.zarr");
    let bytes = |n: u8| Bytes::from(vec![n; 9]);
    for n in 0..12 {
        let keys: Vec<String> = (0..=n).map(|k| format!("a/{k}")).collect();
        let all = keys.iter().map(|key| (key.clone(), bytes(n))).collect();
        objects.put_many(all).expect("puts");
        let found = objects.list().expect("lists");
        assert_eq!(found.len(), keys.len());
        let ends = found.iter().map(|(key, size)| (key.clone(), Ask::End(4, Some(*size))));
        assert_eq!(
            objects.ask(ends.clone().collect()).expect("reads"),
            vec![Some((bytes(n).slice(5..), 9)); keys.len()]
        );
        assert_eq!(whole(&objects, &keys), vec![Some(bytes(n)); keys.len()]);
        let (found, old) = objects.get_version("a/0").expect("reads").expect("is there");
        assert_eq!(found, bytes(n));
        // If the response to the put was lost, the object exists and equals the object of the put.
        let put = objects.put_if("a/0", bytes(99), Condition::Is(old.clone())).expect("puts");
        let (found, now) = objects.get_version("a/0").expect("reads").expect("is there");
        assert_eq!(found, bytes(99));
        assert!(matches!(put, Put::Other) || matches!(put, Put::Done(of) if of == now));
        assert!(matches!(objects.put_if("a/0", bytes(98), Condition::Is(old)), Ok(Put::Other)));
        assert!(matches!(objects.put_if("a/0", bytes(97), Condition::Absent), Ok(Put::Other)));
        assert_eq!(whole(&objects, &["a/0".to_owned()]), [Some(bytes(99))]);
        objects.delete(keys).expect("deletes");
        assert_eq!(objects.list(), Ok(vec![]));
    }
}

#[test]
fn web_servers_are_read_only() {
    let message = below("https://host/s.zarr").may_be_written().expect_err("refused");
    assert!(message.what.contains("read-only") && message.fix.contains("s3://"), "{message}");
    assert_eq!(below("s3://bucket/s.zarr").may_be_written(), Ok(()));
}
