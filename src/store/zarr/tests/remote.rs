//! Tests that stores at a URL are read like stores in a folder, with few requests, and that damage is
//! detected.

use super::*;
use crate::objects::fake::{memory, put, remove, requests, upload};

/// Creates a finished store in a folder and at `memory://NAME/a/out.zarr`.
fn both(name: &str) -> (tempfile::TempDir, TensorStore, PathBuf) {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("out.zarr");
    let store = create(&path);
    for (layout, _) in layouts() {
        let slice = store.slice(&layout.name).expect("a slice");
        let shape = layout.shape();
        let mut data = ramp(region::volume(&shape).expect("a size"));
        // The first camera rows are dark, so their chunks have no files.
        let dark = 4 * data.len() / shape[0] as usize;
        data[..dark].fill(0.0);
        for field in [Field::Mean, Field::StdError] {
            slice.write(field, &vec![0; shape.len()], &shape, &data).expect("writes");
        }
    }
    store.write_samples([0, 0], [7, 11], &[9; 77]).expect("writes");
    store.finish().expect("finishes");
    upload(&path, name, "a/out.zarr");
    let address = PathBuf::from(format!("memory://{name}/a/out.zarr"));
    (dir, TensorStore::open(&path).expect("opens"), address)
}

#[test]
fn an_address_reads_like_a_folder() {
    let (_dir, folder, address) = both("reads");
    let store = TensorStore::open(&address).expect("opens");
    assert!(store.is_finished());
    assert_eq!(store.fingerprint(), folder.fingerprint());
    assert_eq!(store.attributes(), folder.attributes());
    assert_eq!(store.slice_names(), folder.slice_names());
    assert_eq!(store.samples_shape(), folder.samples_shape());
    let samples = |s: &TensorStore| s.read_samples([1, 2], [5, 6]).expect("reads");
    assert_eq!(samples(&store), samples(&folder));
    for name in folder.slice_names() {
        let [near, far] = [&folder, &store].map(|s| s.slice(name).expect("a slice"));
        assert_eq!(far.layout(), near.layout());
        assert_eq!(far.attributes(), near.attributes());
        for field in Field::ALL.into_iter().filter(|f| near.has(*f)) {
            let [near, far] = [&near, &far].map(|s| s.read_all(field).expect("reads"));
            assert_eq!(far.data, near.data, "{name} {}", field.name());
        }
    }
    let verified = verify(&address).expect("a store");
    assert_eq!(verified, verify(folder.path()).expect("a store"));
    assert_eq!(verified.faults, Vec::<String>::new());
}

/// Verifies the number of requests: two to open a store, one per stored coordinate array of a slice, and one
/// per stored chunk.
#[test]
fn opening_and_reading_need_few_requests() {
    let (_dir, _, address) = both("few");
    let store = TensorStore::open(&address).expect("opens");
    assert_eq!(requests("few"), 2);
    let slice = store.slice("timed").expect("a slice");
    let axes = slice.layout().axes.len() as u64;
    let opened = requests("few");
    assert!(opened <= 2 + axes, "{opened}");
    let shape = slice.layout().shape();
    let mut profile = shape.clone();
    (profile[0], profile[1]) = (1, 1);
    let mut at = vec![0; shape.len()];
    (at[0], at[1]) = (5, 6);
    let values = slice.read(Field::Mean, &at, &profile).expect("reads");
    assert!(values.iter().all(|v| *v != 0.0));
    assert_eq!(requests("few"), opened + 1, "a pixel's profile");
    // The manifest contains no chunk of a dark pixel, so no request is needed.
    at[0] = 1;
    slice.read(Field::Mean, &at, &profile).expect("reads");
    assert_eq!(requests("few"), opened + 1);
    slice.read_all(Field::Mean).expect("reads");
    assert_eq!(requests("few"), opened + 1 + 3, "a row of three tiles is lit");
    let chunks: Vec<_> = slice.chunks(Field::StdError).expect("has it").collect();
    let fields = [Field::StdError, Field::Mean];
    assert_eq!(slice.fetch_ahead(&fields, &chunks).expect("fetches"), chunks.len());
    let fetched = requests("few");
    for (start, shape) in &chunks {
        for field in fields {
            slice.read(field, start, shape).expect("reads");
        }
    }
    assert_eq!(requests("few"), fetched, "what is fetched ahead is not fetched again");
}

#[test]
fn damage_is_detected() {
    let (_dir, folder, address) = both("damage");
    let objects = memory("damage");
    let steady = folder.slice("steady").expect("a slice");
    let zeros = ".0".repeat(steady.layout().axes.len() - 2);
    let chunk = format!("steady/mean/c.1.1{zeros}");
    let file = folder.path().join(&chunk);
    let sound = std::fs::read(&file).expect("the chunk's file");
    let key = format!("a/out.zarr/{chunk}");
    let read = || {
        let store = TensorStore::open(&address)?;
        let slice = store.slice("steady")?;
        Ok::<_, OpenError>(slice.read_all(Field::Mean).map(drop))
    };
    let message = || match read() {
        Ok(Ok(())) => "nothing".to_owned(),
        Ok(Err(e)) => e.to_string(),
        Err(e) => e.to_string(),
    };
    let faults = || verify(&address).expect("a store").faults;
    assert_eq!(message(), "nothing");
    let mut damaged = sound.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    put(&objects, &key, damaged);
    assert!(message().contains("chunk [1, 1, 0"), "{}", message());
    assert_eq!(faults(), [format!("{chunk}: was changed after it was written")]);
    remove(&objects, &key);
    assert!(message().contains("missing"), "{}", message());
    assert_eq!(faults(), [format!("{chunk}: is missing")]);
    put(&objects, &key, sound.clone());
    assert_eq!(message(), "nothing");
    // All files except the manifest are from a later render.
    let root = std::fs::read(folder.path().join("zarr.json")).expect("reads");
    let later = String::from_utf8(root.clone()).expect("JSON").replace("abc", "abd");
    put(&objects, "a/out.zarr/zarr.json", later.into_bytes());
    assert!(message().contains("differs from the one written"), "{}", message());
    put(&objects, "a/out.zarr/zarr.json", root);
    put(&objects, "a/out.zarr/steady/mean/c.9.9", vec![1]);
    assert_eq!(faults().len(), 1);
    put(&objects, "a/out.zarr/manifest.txt", b"sunstone manifest 1: 0 files\n".to_vec());
    assert!(message().contains("manifest.txt is damaged"), "{}", message());
}

#[test]
fn unfinished_stores_are_not_read() {
    let (_dir, _, address) = both("unfinished");
    remove(&memory("unfinished"), "a/out.zarr/manifest.txt");
    let store = TensorStore::open(&address).expect("opens");
    assert!(!store.is_finished());
    let slice = store.slice("steady").expect("a slice");
    assert!(matches!(slice.read_all(Field::Mean), Err(AccessError::Unfinished { .. })));
    assert!(matches!(verify(&address), Err(OpenError::Unfinished { .. })));
    let partial = TensorStore::open_partial(&address).expect("opens");
    let values = partial.slice("steady").expect("a slice").read_all(Field::Mean);
    assert!(values.expect("reads").data.iter().all(|v| v.is_finite()));
    let nothing = PathBuf::from("memory://unfinished/b.zarr");
    assert!(matches!(TensorStore::open(&nothing), Err(OpenError::Missing { .. })));
    assert!(matches!(verify(&nothing), Err(OpenError::Missing { .. })));
}
