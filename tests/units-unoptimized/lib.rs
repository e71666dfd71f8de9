//! Unit tests of other crates: see Cargo.toml.
