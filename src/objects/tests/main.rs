//! The unit tests of this crate as a target of its own, so that `--test objects` runs them alone.

#![expect(dead_code, reason = "public items are not exported from a test")]

#[path = "../lib.rs"]
mod objects;
