//! Builds the unit tests of other crates. See Cargo.toml.
