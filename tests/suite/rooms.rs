//! The order of the rooms: a module uses only those above it, and every file introduces itself.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Top to bottom, as in the design; `cli` is the program and may use everything through the library's name.
const ORDER: [&str; 16] = [
    "spectrum",
    "units",
    "polarization",
    "sampling",
    "geometry",
    "material",
    "medium",
    "tensor",
    "scene",
    "render",
    "decompose",
    "capture",
    "reconstruct",
    "rig",
    "apply",
    "figure",
];

fn sources() -> Vec<PathBuf> {
    fn walk(at: &Path, out: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(at).expect("src") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                walk(&path, out);
            } else if path.extension().is_some_and(|e| e == "rs") {
                out.push(path);
            }
        }
    }
    let mut out = Vec::new();
    walk(&root(), &mut out);
    out.sort();
    assert!(out.len() > 50, "{} files", out.len());
    out
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// The room of a file: its first folder (or its own name) below `src`.
fn room(path: &Path) -> String {
    let inside = path.strip_prefix(root()).expect("below src");
    let first = inside.iter().next().expect("a name").to_str().expect("UTF-8");
    first.strip_suffix(".rs").unwrap_or(first).to_owned()
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).expect("a source file")
}

/// Lines that are code, not comments.
fn code(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .filter(|(_, l)| !l.trim_start().starts_with("//"))
}

/// Rooms that a line of code names: `crate::ROOM`, and those of `crate::{A, B::…}`.
fn named(line: &str) -> Vec<String> {
    let word = |s: &str| {
        s.chars()
            .take_while(|c| c.is_alphanumeric() || *c == '_')
            .collect::<String>()
    };
    let mut out = Vec::new();
    for at in line.match_indices("crate::").map(|(i, m)| &line[i + m.len()..]) {
        match at.strip_prefix('{') {
            None => out.push(word(at)),
            Some(list) => {
                let mut depth = 0;
                let mut start = true;
                for (i, c) in list.char_indices() {
                    if start && depth == 0 && c.is_alphabetic() {
                        out.push(word(&list[i..]));
                        start = false;
                    }
                    match c {
                        '{' => depth += 1,
                        '}' if depth == 0 => break,
                        '}' => depth -= 1,
                        ',' if depth == 0 => start = true,
                        _ => {}
                    }
                }
            }
        }
    }
    out
}

#[test]
fn the_reader_of_uses_reads_all_forms() {
    assert_eq!(named("use crate::tensor::axes::Axis;"), ["tensor"]);
    assert_eq!(
        named("let x = crate::units::f(crate::scene::G);"),
        ["units", "scene"]
    );
    assert_eq!(
        named("use crate::{material::{Lanes, Material}, spectrum};"),
        ["material", "spectrum"]
    );
}

#[test]
fn rooms_use_only_rooms_above_them() {
    let mut faults = Vec::new();
    let mut uses = 0;
    for path in sources() {
        let room = room(&path);
        if ["lib", "main", "cli"].contains(&room.as_str()) {
            continue;
        }
        let Some(own) = ORDER.iter().position(|r| *r == room) else {
            faults.push(format!("{}: room `{room}` is not in the design", path.display()));
            continue;
        };
        for (n, line) in code(&text(&path)) {
            for name in named(line) {
                uses += usize::from(name != room);
                match ORDER.iter().position(|r| *r == name) {
                    Some(other) if other <= own => {}
                    _ => faults.push(format!("{}:{}: `{room}` uses `{name}`", path.display(), n + 1)),
                }
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(uses > 50, "only {uses} uses were found: the scan does not work");
}

/// Walls that the order alone does not build.
#[test]
fn some_rooms_know_less() {
    let allowed: [(&str, &[&str]); 2] = [
        ("figure", &["figure", "tensor"]),
        ("tensor", &["tensor", "polarization", "spectrum", "units"]),
    ];
    for (room_name, may) in allowed {
        let mut seen = BTreeSet::new();
        for path in sources().into_iter().filter(|p| room(p) == room_name) {
            seen.extend(code(&text(&path)).flat_map(|(_, l)| named(l)));
        }
        assert!(seen.contains(room_name), "the scan found nothing in {room_name}");
        assert!(
            seen.iter().all(|s| may.contains(&s.as_str())),
            "{room_name} uses {seen:?}"
        );
    }
}

/// The library lists its rooms in the order in which they build on each other.
#[test]
fn the_library_declares_rooms_in_order() {
    let lib = text(&root().join("lib.rs"));
    let declared: Vec<&str> = lib
        .lines()
        .filter_map(|l| l.strip_prefix("pub mod ")?.strip_suffix(';'))
        .collect();
    let places: Vec<usize> = declared
        .iter()
        .map(|d| ORDER.iter().position(|r| r == d).expect("a room of the design"))
        .collect();
    assert!(
        places.len() >= 8 && places.windows(2).all(|w| w[0] < w[1]),
        "{declared:?}"
    );
}

#[test]
fn no_room_is_a_lumber_room() {
    for path in sources() {
        for part in path.strip_prefix(root()).expect("below src").iter() {
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
    let silent: Vec<_> = sources()
        .into_iter()
        .filter(|p| !text(p).starts_with("//! "))
        .collect();
    assert!(silent.is_empty(), "no `//!` head in {silent:?}");
}

/// Files that hold tests alone: those under a module declared `#[cfg(test)] mod NAME;`.
fn test_files() -> BTreeSet<PathBuf> {
    let mut out = BTreeSet::new();
    for path in sources() {
        let folder = match path.file_stem().and_then(|s| s.to_str()) {
            Some("mod" | "lib" | "main") => path.parent().expect("a folder").to_owned(),
            _ => path.with_extension(""),
        };
        let text = text(&path);
        for pair in text.lines().collect::<Vec<_>>().windows(2) {
            if pair[0].trim() == "#[cfg(test)]"
                && let Some(name) = pair[1]
                    .trim()
                    .strip_prefix("mod ")
                    .and_then(|n| n.strip_suffix(';'))
            {
                out.insert(folder.join(format!("{name}.rs")));
                out.extend(sources().into_iter().filter(|p| p.starts_with(folder.join(name))));
            }
        }
    }
    out
}

/// Text before the inline test module, which comes last in a file.
fn shipped(text: &str) -> &str {
    let end = [
        "\n#[cfg(test)]\nmod tests {",
        "\n#[cfg(test)]\npub(crate) mod tests {",
    ]
    .iter()
    .filter_map(|m| text.find(m))
    .min();
    &text[..end.unwrap_or(text.len())]
}

#[test]
fn code_that_users_run_does_not_unwrap() {
    let tests = test_files();
    assert!(tests.iter().any(|t| t.ends_with("store/tests.rs")), "{tests:?}");
    let mut found = Vec::new();
    for path in sources().into_iter().filter(|p| !tests.contains(p)) {
        for (n, line) in code(shipped(&text(&path))) {
            if line.contains(".unwrap()") {
                found.push(format!("{}:{}: {}", path.display(), n + 1, line.trim()));
            }
        }
    }
    assert!(found.is_empty(), "{} unwraps:\n{}", found.len(), found.join("\n"));
}
