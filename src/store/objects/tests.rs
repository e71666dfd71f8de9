//! Object stores in memory: what is read, asked again and refused.

use super::*;
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
    assert_eq!(objects.list().expect("lists"), ["x/c.0.0", "zarr.json"]);
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
    for (text, scheme, what, mend) in [
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
            told.what.contains(what) && told.mend.contains(mend),
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
