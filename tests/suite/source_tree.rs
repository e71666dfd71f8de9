//! The source as a graph: which file uses which, read from the text.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Crates from top to bottom. The package `sunstone` uses all of them.
pub const CRATES: [&str; 13] = [
    "base",
    "optics",
    "tensor",
    "store",
    "transport",
    "syntax",
    "import",
    "scene",
    "polarimetry",
    "rig",
    "pbrdf",
    "figure",
    "apply",
];

/// The folder `src`.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// All source files below a folder, in order of name.
pub fn sources(below: &Path) -> Vec<PathBuf> {
    let mut out = Vec::new();
    for entry in std::fs::read_dir(below).expect("a folder of the source") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            out.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
    out.sort();
    out
}

/// The text of a file.
pub fn text(path: &Path) -> String {
    std::fs::read_to_string(path).expect("a source file")
}

/// Text before the inline test module, which comes last in a file.
pub fn shipped(text: &str) -> &str {
    let marks = [
        "\n#[cfg(test)]\nmod tests {",
        "\n#[cfg(test)]\npub(crate) mod tests {",
    ];
    let end = marks.iter().filter_map(|m| text.find(m)).min();
    &text[..end.unwrap_or(text.len())]
}

/// Code alone: comments and the insides of strings and characters are left out, line ends stay.
pub fn code(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let skip = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            rest.find("*/").map_or(rest.len(), |i| i + 2)
        } else if let Some(hashes) = raw_string(rest) {
            let close = format!("\"{}", "#".repeat(hashes));
            let open = hashes + 2;
            rest[open..]
                .find(&close)
                .map_or(rest.len(), |i| open + i + close.len())
        } else if c == '"' {
            quoted(rest, '"')
        } else if c == '\'' && is_character(rest) {
            quoted(rest, '\'')
        } else {
            out.push(c);
            rest = &rest[c.len_utf8()..];
            continue;
        };
        out.extend(rest[..skip].chars().filter(|c| *c == '\n'));
        out.push(' ');
        rest = &rest[skip..];
    }
    out
}

/// Number of hashes, where a raw string begins.
fn raw_string(rest: &str) -> Option<usize> {
    let after = rest.strip_prefix('r')?;
    let hashes = after.chars().take_while(|c| *c == '#').count();
    after[hashes..].starts_with('"').then_some(hashes)
}

/// True of a character, false of a lifetime.
fn is_character(rest: &str) -> bool {
    let mut chars = rest.chars().skip(1);
    match chars.next() {
        Some('\\') => true,
        Some(_) => chars.next() == Some('\''),
        None => false,
    }
}

/// Length of a quotation with its quotes.
fn quoted(rest: &str, mark: char) -> usize {
    let mut escaped = false;
    for (i, c) in rest.char_indices().skip(1) {
        if !escaped && c == mark {
            return i + 1;
        }
        escaped = !escaped && c == '\\';
    }
    rest.len()
}

/// Paths that code names from `crate`, `super` or `self`: of `use` trees (over any number of lines, nested, renamed) and
/// of expressions; and those that begin with one of `children`, modules that the file itself declares.
pub fn paths(code: &str, children: &[String]) -> BTreeSet<Vec<String>> {
    let mut out = BTreeSet::new();
    let begins =
        |word: &str| ["crate", "super", "self"].contains(&word) || children.iter().any(|c| c == word);
    let bytes = code.as_bytes();
    let mut at = 0;
    while at < code.len() {
        let here = &code[at..];
        let length = here
            .bytes()
            .take_while(|b| b.is_ascii_alphanumeric() || *b == b'_')
            .count();
        if length == 0 {
            at += here.chars().next().map_or(1, char::len_utf8);
            continue;
        }
        let qualified = at >= 2 && &bytes[at - 2..at] == b"::";
        if begins(&here[..length]) && !qualified && here[length..].starts_with("::") {
            at += tree(here, &[], &mut out);
        } else {
            // `use {a::b, c}` as well: its branches are met on the way.
            at += length;
        }
    }
    out
}

/// Reads one path or tree of paths; returns how much of the text it is.
fn tree(text: &str, prefix: &[String], out: &mut BTreeSet<Vec<String>>) -> usize {
    let space = |at: usize| text[at..].len() - text[at..].trim_start().len();
    let mut at = space(0);
    if text[at..].starts_with('{') {
        at += 1;
        loop {
            at += space(at);
            match text[at..].chars().next() {
                Some(',') => at += 1,
                Some('}') => return at + 1,
                Some(c) if c.is_alphanumeric() || c == '_' || c == '*' || c == '{' => {
                    at += tree(&text[at..], prefix, out);
                    at += space(at);
                    if let Some(rest) = text[at..].strip_prefix("as ") {
                        at += 3;
                        at += rest
                            .bytes()
                            .take_while(|b| b.is_ascii_alphanumeric() || *b == b'_')
                            .count();
                    }
                }
                _ => return at,
            }
        }
    }
    let word: String = text[at..]
        .chars()
        .take_while(|c| c.is_alphanumeric() || *c == '_')
        .collect();
    at += word.len().max(usize::from(text[at..].starts_with('*')));
    let mut path = prefix.to_vec();
    if !word.is_empty() {
        path.push(word);
    }
    let more = text[at..].starts_with("::")
        && text[at + 2..].starts_with(|c: char| c.is_alphanumeric() || c == '_' || c == '{' || c == '*');
    if more {
        return at + 2 + tree(&text[at + 2..], &path, out);
    }
    out.insert(path);
    at
}

/// Names of the modules that a file declares in files of their own.
pub fn declared(code: &str) -> Vec<String> {
    code.lines()
        .filter_map(|l| {
            let l = l.trim();
            let l = l.strip_prefix("pub(crate) ").unwrap_or(l);
            let l = l.strip_prefix("pub(super) ").unwrap_or(l);
            let l = l.strip_prefix("pub ").unwrap_or(l);
            Some(l.strip_prefix("mod ")?.strip_suffix(';')?.trim().to_owned())
        })
        .collect()
}

/// The modules of one crate, and which uses which.
pub struct Crate {
    /// Modules that each module's shipped code uses, itself left out.
    pub uses: Uses,
}

/// Files that hold tests alone: those below a module declared `#[cfg(test)] mod NAME;`.
pub fn test_files(all: &[PathBuf]) -> BTreeSet<PathBuf> {
    let mut out = BTreeSet::new();
    for path in all {
        let folder = match path.file_stem().and_then(|s| s.to_str()) {
            Some("mod" | "lib" | "main") => path.parent().expect("a folder").to_owned(),
            _ => path.with_extension(""),
        };
        let text = text(path);
        for pair in text.lines().collect::<Vec<_>>().windows(2) {
            if pair[0].trim() == "#[cfg(test)]"
                && let [name] = &declared(pair[1])[..]
            {
                out.insert(folder.join(format!("{name}.rs")));
                out.extend(all.iter().filter(|p| p.starts_with(folder.join(name))).cloned());
            }
        }
    }
    out
}

impl Crate {
    /// Reads the crate whose root module is `lib` in `folder`; folders in `without` are other crates'.
    pub fn read(folder: &Path, lib: &str, without: &[&str]) -> Self {
        let all: Vec<PathBuf> = sources(folder)
            .into_iter()
            .filter(|p| !without.iter().any(|w| p.starts_with(folder.join(w))))
            .collect();
        let tests = test_files(&all);
        let mut modules = BTreeMap::new();
        for path in all.into_iter().filter(|p| !tests.contains(p)) {
            let inside = path.strip_prefix(folder).expect("below").with_extension("");
            let mut name: Vec<String> = inside
                .iter()
                .map(|p| p.to_str().expect("UTF-8").to_owned())
                .collect();
            if name.last().is_some_and(|n| n == "mod") || name == [lib] {
                name.pop();
            }
            modules.insert(name, path);
        }
        let mut uses = BTreeMap::new();
        for (module, path) in &modules {
            let code = code(shipped(&text(path)));
            let children = declared(&code);
            let mut used = BTreeSet::new();
            for path in paths(&code, &children) {
                let Some(mut whole) = absolute(module, &path) else {
                    continue;
                };
                while !modules.contains_key(&whole) && whole.pop().is_some() {}
                if whole != *module {
                    used.insert(whole);
                }
            }
            uses.insert(module.clone(), used);
        }
        Self { uses }
    }

    /// Groups of two or more modules each of which uses, in the end, every other.
    pub fn circles(&self) -> Vec<Vec<String>> {
        circles(&self.uses)
    }

    /// The same of rooms, the first parts of modules' paths, and how many uses cross from one to another. The crate's root
    /// gathers rooms; what rooms use of it counts as a circle of files.
    pub fn circles_of_rooms(&self) -> (Vec<Vec<String>>, usize) {
        let (mut rooms, mut crossings) = (Uses::new(), 0);
        for (module, used) in self.uses.iter().filter(|(m, _)| !m.is_empty()) {
            let room = &module[..1];
            let others = used.iter().filter(|u| !u.is_empty() && u[..1] != *room);
            let entry = rooms.entry(room.to_vec()).or_default();
            for other in others {
                crossings += 1;
                entry.insert(other[..1].to_vec());
            }
        }
        (circles(&rooms), crossings)
    }
}

/// Which module uses which.
type Uses = BTreeMap<Vec<String>, BTreeSet<Vec<String>>>;

fn circles(uses: &Uses) -> Vec<Vec<String>> {
    let reach = |from: &Vec<String>| {
        let mut seen = BTreeSet::new();
        let mut next: Vec<&Vec<String>> = uses[from].iter().collect();
        while let Some(module) = next.pop() {
            if seen.insert(module.clone()) {
                next.extend(&uses[module]);
            }
        }
        seen
    };
    let reached: BTreeMap<_, _> = uses.keys().map(|m| (m.clone(), reach(m))).collect();
    let mut out = BTreeSet::new();
    for (module, from) in reached.iter().filter(|(m, from)| from.contains(*m)) {
        let circle: Vec<String> = from
            .iter()
            .filter(|other| reached[*other].contains(module))
            .map(|m| {
                if m.is_empty() {
                    "the root".to_owned()
                } else {
                    m.join("::")
                }
            })
            .collect();
        out.insert(circle);
    }
    out.into_iter().collect()
}

/// A path from the crate's root, as `module` means it.
fn absolute(module: &[String], path: &[String]) -> Option<Vec<String>> {
    let mut at = module.to_vec();
    let mut rest = path;
    match rest.first()?.as_str() {
        "crate" => {
            at.clear();
            rest = &rest[1..];
        }
        "self" => rest = &rest[1..],
        _ => {
            while rest.first().is_some_and(|s| s == "super") {
                at.pop()?;
                rest = &rest[1..];
            }
        }
    }
    at.extend(rest.iter().filter(|s| *s != "self").cloned());
    Some(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, children: &[&str]) -> Vec<String> {
        let children: Vec<String> = children.iter().map(|c| (*c).to_owned()).collect();
        paths(&code(text), &children)
            .iter()
            .map(|p| p.join("::"))
            .collect()
    }

    #[test]
    fn paths_are_read_in_all_forms() {
        assert_eq!(read("use crate::axes::Axis;", &[]), ["crate::axes::Axis"]);
        let nested = "use crate::{\n    a::{B, c::D as E},\n    // crate::not::me\n    f,\n};\nuse super::super::g::H;";
        let found = ["crate::a::B", "crate::a::c::D", "crate::f", "super::super::g::H"];
        assert_eq!(read(nested, &[]), found);
        let code = "let x = crate::units::f(super::G) + child::h(\"crate::text\", 'c', r#\"super::raw\"#);";
        assert_eq!(
            read(code, &["child"]),
            ["child::h", "crate::units::f", "super::G"]
        );
        assert_eq!(
            read("use other::crate_like::X; fn f<'a>(x: &'a str) {}", &[]),
            [""; 0]
        );
        assert_eq!(
            read("use self::plan::{self, *};", &[]),
            ["self::plan", "self::plan::self"]
        );
    }

    #[test]
    fn circles_are_found() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("writes");
        write("lib.rs", "mod a;\nmod b;\nmod c;\npub use c::C;\n");
        write("a.rs", "use super::{\n    b::B,\n};\npub struct A;\n");
        write(
            "b.rs",
            "pub struct B;\n#[cfg(test)]\nmod tests {\n    use crate::a::A;\n}\n",
        );
        write("c.rs", "use crate::a::A;\npub struct C;\n");
        let circles = |(): ()| Crate::read(folder.path(), "lib", &[]).circles();
        assert_eq!(circles(()), Vec::<Vec<String>>::new());
        write("b.rs", "pub struct B(super::super::x::Y, crate::c::C);\n");
        assert_eq!(circles(()), [["a", "b", "c"]]);
        write("b.rs", "use super::C;\n");
        assert_eq!(circles(()), [["the root", "a", "b", "c"]]);
    }
}
