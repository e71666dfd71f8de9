//! The order of the house: crates and rooms use only those above them, files make no circles, every file introduces itself,
//! and none grows too large.

use crate::source_tree::{CRATES, Crate, code, root, shipped, sources, test_files, text};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// What each crate may use of the others: Cargo refuses circles, this list everything else that is not meant.
const WALLS: [(&str, &[&str]); 13] = [
    ("base", &[]),
    ("optics", &[]),
    ("tensor", &[]),
    ("store", &["base", "tensor"]),
    ("transport", &["base", "optics", "tensor"]),
    ("syntax", &["base", "optics", "transport"]),
    ("import", &["base", "optics", "transport", "syntax"]),
    (
        "scene",
        &["base", "optics", "tensor", "transport", "syntax", "import"],
    ),
    ("polarimetry", &["base", "optics", "tensor"]),
    ("rig", &["base", "optics", "tensor", "store", "polarimetry"]),
    (
        "pbrdf",
        &["base", "optics", "tensor", "transport", "scene", "polarimetry"],
    ),
    ("figure", &["base", "tensor"]),
    ("apply", &["base", "optics", "tensor", "polarimetry"]),
];

/// Lines of the largest file that is not of tests alone.
const LONGEST_FILE: usize = 700;

/// Largest part of the whole that one room may be.
const LARGEST_ROOM: f64 = 0.15;

fn crates() -> Vec<(&'static str, Crate)> {
    let mut all: Vec<(&str, Crate)> = CRATES
        .iter()
        .map(|name| (*name, Crate::read(&root().join(name), "lib", &[])))
        .collect();
    all.push(("sunstone", Crate::read(&root(), "lib", &CRATES)));
    all
}

#[test]
fn crates_use_only_what_they_may() {
    for (name, may) in WALLS {
        let manifest = text(&root().join(name).join("Cargo.toml"));
        let manifest: toml::Table = manifest.parse().expect("a manifest");
        let uses: Vec<&str> = manifest["dependencies"]
            .as_table()
            .expect("a table")
            .keys()
            .map(String::as_str)
            .filter(|d| CRATES.contains(d))
            .collect();
        assert!(uses.iter().all(|u| may.contains(u)), "{name} uses {uses:?}");
        let place = |n: &str| CRATES.iter().position(|c| *c == n).expect("a crate");
        assert!(may.iter().all(|m| place(m) < place(name)), "{name}");
    }
}

/// Rooms of one crate, its first folders and the files beside them, build on each other one way.
#[test]
fn no_rooms_use_each_other_in_a_circle() {
    let (mut found, mut crossings) = (Vec::new(), 0);
    for (name, tree) in crates() {
        let (circles, uses) = tree.circles_of_rooms();
        crossings += uses;
        found.extend(circles.iter().map(|c| format!("{name}: {}", c.join(" – "))));
    }
    assert!(found.is_empty(), "{} circles:\n{}", found.len(), found.join("\n"));
    assert!(
        crossings > 100,
        "only {crossings} uses were found: the scan does not work"
    );
}

#[test]
fn no_files_use_each_other_in_a_circle() {
    let mut found = Vec::new();
    for (name, tree) in crates() {
        let circles = tree.circles();
        found.extend(circles.iter().map(|c| format!("{name}: {}", c.join(" – "))));
    }
    assert!(found.is_empty(), "{} circles:\n{}", found.len(), found.join("\n"));
}

#[test]
fn no_file_is_too_long() {
    let all = sources(&root());
    let tests = test_files(&all);
    let mut found = Vec::new();
    for path in all.iter().filter(|p| !tests.contains(*p)) {
        let lines = text(path).lines().count();
        if lines > LONGEST_FILE {
            found.push(format!("{}: {lines} lines", path.display()));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// A room is a folder of a crate, or the files that lie in its root.
#[test]
fn no_room_is_too_large() {
    let mut lines: BTreeMap<PathBuf, usize> = BTreeMap::new();
    let mut whole = 0;
    for path in sources(&root()) {
        let inside = path.strip_prefix(root()).expect("below src");
        let parts: Vec<_> = inside.parent().expect("a folder").iter().take(2).collect();
        let n = text(&path).lines().count();
        whole += n;
        *lines.entry(parts.iter().collect()).or_default() += n;
    }
    for (room, n) in lines {
        let share = n as f64 / whole as f64;
        assert!(share <= LARGEST_ROOM, "{}: {n} of {whole} lines", room.display());
    }
}

#[test]
fn no_room_is_a_lumber_room() {
    for path in sources(&root()) {
        for part in path.strip_prefix(root()).expect("below src") {
            let name = part.to_str().expect("UTF-8").trim_end_matches(".rs");
            let lumber = ["util", "utils", "common", "helpers", "misc"];
            assert!(
                !lumber.contains(&name),
                "{} says nothing about what is in it",
                path.display()
            );
        }
    }
}

#[test]
fn every_file_says_what_it_is() {
    let silent: Vec<_> = sources(&root())
        .into_iter()
        .filter(|p| !text(p).starts_with("//! "))
        .collect();
    assert!(silent.is_empty(), "no `//!` head in {silent:?}");
}

#[test]
fn code_that_users_run_does_not_unwrap() {
    let all = sources(&root());
    let tests = test_files(&all);
    assert!(tests.iter().any(|t| t.ends_with("zarr/tests.rs")), "{tests:?}");
    let mut found = Vec::new();
    for path in all.iter().filter(|p| !tests.contains(*p)) {
        for (n, line) in code(shipped(&text(path))).lines().enumerate() {
            if line.contains(".unwrap()") {
                found.push(format!("{}:{}: {}", path.display(), n + 1, line.trim()));
            }
        }
    }
    assert!(found.is_empty(), "{} unwraps:\n{}", found.len(), found.join("\n"));
}
