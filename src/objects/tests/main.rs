//! The unit tests of this crate as a separate target, so that `--test objects` runs only these tests.

#![expect(dead_code, reason = "public items are not exported from a test")]

#[path = "../lib.rs"]
mod objects;
