//! Object stores in a build without them: every address is refused, and there is nothing else to do.

use crate::refusal::Refusal;
use bytes::Bytes;
use get::Ask;
use std::path::Path;

/// What there is none of. (Within types, so that what does with these is no dead code.)
#[derive(Clone, Debug)]
enum Never {}

/// The objects below an address: none.
#[derive(Clone, Debug)]
pub(crate) struct Objects(Never);

/// What is asked of objects.
pub(crate) mod get {
    use std::ops::Range;

    /// What is asked of an object.
    #[derive(Clone, Debug, PartialEq, Eq, Hash)]
    pub(crate) enum Ask {
        Whole,
        Bytes(Range<u64>),
        End(u64, Option<u64>),
    }
}

impl Objects {
    pub(crate) fn open(scheme: &str, _: &Path) -> Result<Self, Refusal> {
        Err(Refusal::new(
            format!("this program was built without object stores, and knows no {scheme}://"),
            "build it with `cargo build --release --features object-stores`, or copy the store to a folder",
        ))
    }

    pub(crate) fn get(&self, _: &str) -> Result<Option<Bytes>, Refusal> {
        match self.0 {}
    }

    pub(crate) fn get_many(&self, _: &[String]) -> Result<Vec<Option<Bytes>>, Refusal> {
        match self.0 {}
    }

    pub(crate) fn ask(&self, _: Vec<(String, Ask)>) -> Result<Vec<Option<(Bytes, u64)>>, Refusal> {
        match self.0 {}
    }

    pub(crate) fn list(&self) -> Result<Vec<(String, u64)>, Refusal> {
        match self.0 {}
    }

    pub(crate) fn may_be_written(&self) -> Result<(), Refusal> {
        match self.0 {}
    }

    pub(crate) fn put(&self, _: &str, _: Bytes) -> Result<(), Refusal> {
        match self.0 {}
    }

    pub(crate) fn put_many(&self, _: Vec<(String, Bytes)>) -> Result<(), Refusal> {
        match self.0 {}
    }

    pub(crate) fn delete(&self, _: Vec<String>) -> Result<(), Refusal> {
        match self.0 {}
    }
}

/// Locks of what lies there: none.
pub(crate) mod lock {
    use super::{Never, Objects, Refusal};
    use std::sync::Arc;
    use std::time::Duration;

    pub(crate) const FILE: &str = ".sunstone-lock";

    pub(crate) fn lease() -> Duration {
        Duration::ZERO
    }

    #[allow(dead_code)] // as the real one, which is matched
    #[derive(Debug)]
    pub(crate) enum NoLock {
        Held(String),
        Refused(Refusal),
    }

    #[derive(Debug)]
    pub(crate) struct Hold(Never);

    impl Hold {
        pub(crate) fn is_sure(&self) -> bool {
            match self.0 {}
        }
    }

    #[derive(Debug)]
    pub(crate) struct ObjectLock(Never);

    impl ObjectLock {
        pub(crate) fn take(objects: &Objects, _: Duration) -> Result<Self, NoLock> {
            match objects.0 {}
        }

        pub(crate) fn hold(&self) -> Arc<Hold> {
            match self.0 {}
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::zarr::TensorStore;
    use serde_json::Map;
    use std::path::Path;

    #[test]
    fn every_address_is_refused_with_a_fix() {
        let address = Path::new("s3://bucket/a.zarr");
        let made = TensorStore::create(address, &[], &Map::new(), None, false);
        for told in [
            TensorStore::open(address).expect_err("refused").to_string(),
            TensorStore::open_for_write(address)
                .expect_err("refused")
                .to_string(),
            made.expect_err("refused").to_string(),
        ] {
            assert!(
                told.contains("s3://") && told.contains("--features object-stores"),
                "{told}"
            );
        }
    }
}
