//! Tests of removing stores.

use crate::zarr::build::ORIGIN;
use crate::zarr::remote_store::{self, ROOT};
use crate::zarr::{RemoveError, TensorStore, remove};
use std::path::Path;

fn store(path: &Path) {
    let made = TensorStore::create(path, &[], &serde_json::Map::new(), None, false);
    drop(made.expect("a store"));
}

#[test]
fn folders_that_are_not_stores_are_kept() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a");
    assert!(!remove(&path).expect("nothing there"));
    std::fs::create_dir(&path).expect("a folder");
    std::fs::write(path.join("letter.txt"), "dear").expect("writes");
    assert!(matches!(remove(&path), Err(RemoveError::NotAStore { .. })));
    assert!(path.join("letter.txt").is_file());
}

#[test]
fn removed_stores_leave_nothing_and_can_be_recreated() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.zarr");
    for _ in 0..2 {
        store(&path);
        assert!(remove(&path).expect("removes"));
        assert!(!remove(&path).expect("nothing there"));
    }
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
}

#[test]
fn removal_at_an_address_works_as_in_a_folder() {
    let path = Path::new("memory://remove/a.zarr");
    let objects = || {
        let found = remote_store::objects_of(path).expect("a place");
        found.expect("an address")
    };
    assert!(!remove(path).expect("nothing there"));
    objects().put("letter.txt", b"dear".to_vec().into()).expect("puts");
    assert!(matches!(remove(path), Err(RemoveError::NotAStore { .. })));
    assert_eq!(objects().list().expect("lists").len(), 1);
    objects().delete(vec!["letter.txt".into()]).expect("deletes");
    for _ in 0..2 {
        store(path);
        // After an interrupted removal, the file that identifies the store is already removed.
        objects().put(ORIGIN, vec![].into()).expect("puts");
        objects().delete(vec![ROOT.into()]).expect("deletes");
        assert!(remove(path).expect("removes"));
        assert!(!remove(path).expect("nothing there"));
        assert!(objects().list().expect("lists").is_empty());
    }
}
