//! Shared code of the tests that render or run the program. The code builds small scenes from text, reads
//! results, and checks error messages.

#![allow(dead_code)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use sunstone::render::{Target, Unwatched, render};
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::array::Tensor;
use sunstone::tensor::field::Field;
use sunstone::transport::material::measured::axes::Axes;
use sunstone::transport::material::measured::write::write;
use sunstone::transport::scene::Scene;
#[allow(unused_imports)]
pub use support::{MIRROR_ROOM, edit, mirror_room, shipped};

/// Returns a folder in memory if the system has one, because disks are slow for many small files.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a folder")
}

/// Builds a scene from text, or panics.
pub fn scene(text: &str) -> Scene {
    sunstone::scene::from_text(Path::new("test.toml"), text).unwrap_or_else(|e| panic!("{e}"))
}

/// Renders a scene into a store at `path`.
pub fn rendered(scene: &Scene, path: PathBuf) -> TensorStore {
    let target = Target { path, ..Target::default() };
    let summary = render(scene, &target, &Unwatched).expect("a render");
    assert!(summary.complete);
    TensorStore::open(&target.path).expect("the store just written")
}

pub fn read(store: &TensorStore, slice: &str, field: Field) -> Tensor {
    store.slice(slice).expect("the slice").read_all(field).expect("its values")
}

/// Returns the bytes of all files below `path`, by relative name.
pub fn files(path: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    fn walk(root: &Path, at: &Path, out: &mut BTreeMap<PathBuf, Vec<u8>>) {
        for entry in std::fs::read_dir(at).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                walk(root, &path, out);
            } else {
                let name = path.strip_prefix(root).expect("below the root").to_owned();
                out.insert(name, std::fs::read(&path).expect("a file"));
            }
        }
    }
    let mut out = BTreeMap::new();
    walk(path, path, &mut out);
    out
}

/// Asserts that two stores have the same files with the same bytes, apart from the render time.
pub fn assert_same_store(a: &Path, b: &Path) {
    let (mut a, mut b) = (files(a), files(b));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    assert!(a.len() > 10, "{} files", a.len());
    for files in [&mut a, &mut b] {
        let root = files.get_mut(Path::new("zarr.json")).expect("zarr.json");
        let mut json: serde_json::Value = serde_json::from_slice(root).expect("JSON");
        let attributes = json["attributes"].as_object_mut().expect("attributes");
        attributes.remove("wall_time_s").expect("a wall time");
        *root = serde_json::to_vec(&json).expect("JSON");
        // The manifest contains a checksum of the file with the render time, and a checksum of the manifest
        // itself.
        let manifest = files.get_mut(Path::new("manifest.txt")).expect("a manifest");
        let text = String::from_utf8(std::mem::take(manifest)).expect("a text");
        let same = text.lines().filter(|l| !l.ends_with(" zarr.json") && !l.ends_with(" lines above"));
        *manifest = same.collect::<Vec<_>>().join("\n").into_bytes();
    }
    for (name, bytes) in &a {
        assert!(bytes == &b[name], "{} differs", name.display());
    }
}

/// Writes small valid files of most kinds to which a scene can refer. Writes white images of the given sizes.
pub fn scene_files(folder: &Path, images: &[(&str, u32)]) {
    let put = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect("a file");
    put(
        "shape.obj",
        b"v 0 0 0\nv .3 0 0\nv .3 .3 0\nv 0 .3 0\nvn 0 0 1\nvt 0 0\nusemtl painted\nf 1/1/1 2/1/1 3/1/1\n\
          usemtl other\nf 1/1/1 3/1/1 4/1/1\n",
    );
    put(
        "shape.ply",
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
          property float color_0\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
          0 0 0 .1\n.3 0 0 .2\n0 .3 0 .3\n3 0 1 2\n",
    );
    let corners = [0.0_f32, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.3, 0.0];
    put("shape.bin", &corners.map(f32::to_le_bytes).concat());
    let gltf = serde_json::json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"uri": "shape.bin", "byteLength": 36}], "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0],
                       "max": [0.3, 0.3, 0]}],
    });
    put("shape.gltf", gltf.to_string().as_bytes());
    for (name, size) in images {
        let image = image::RgbImage::from_pixel(*size, *size, image::Rgb([128, 130, 250]));
        image.save(folder.join(name)).expect("an image");
    }
    write(&folder.join("table.pbsdf"), &Axes::even([4, 3, 3], vec![450, 550, 650]), |_, slab| {
        for (i, x) in slab.iter_mut().enumerate() {
            *x = if i.is_multiple_of(16) { 0.2 } else { 0.01 };
        }
    })
    .expect("a table");
}

/// Returns a command that runs the program in a folder.
pub fn sunstone(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sunstone"));
    command.args(arguments).current_dir(folder).env_remove("SUNSTONE_LOG");
    command
}

/// Runs the program and asserts its exit code.
pub fn run(folder: &Path, arguments: &[&str], code: i32) -> Output {
    let out = sunstone(folder, arguments).output().expect("the program runs");
    assert_eq!(out.status.code(), Some(code), "{arguments:?}: {}", String::from_utf8_lossy(&out.stderr));
    out
}

/// Returns the standard error of a run.
pub fn stderr(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// Returns the standard output of a run.
pub fn stdout(out: &Output) -> String {
    String::from_utf8_lossy(&out.stdout).into_owned()
}

/// Runs commands and asserts that the program refuses each, prints a message that contains the given words,
/// and writes no files.
pub fn refusals(folder: &Path, cases: &[(&str, &str)]) {
    let before = files(folder);
    for (line, words) in cases {
        let shown = stderr(&run(folder, &line.split_whitespace().collect::<Vec<_>>(), 2));
        assert!(shown.starts_with("error: ") && shown.contains(words), "{line}: {shown}");
        assert!(files(folder) == before, "{line} wrote something");
    }
}

/// A fault in a valid file. The entries of the tuple are:
/// - the name of the fault
/// - the passage to replace
/// - the replacement
/// - the mark, a text whose first occurrence in the file is the position of the fault (a leading `^` adds the
///   column)
/// - the words that the message must contain
pub type Case = (&'static str, &'static str, &'static str, &'static str, &'static str);

/// Returns the line and column of a fault. The function computes the position from `text` and the mark of a
/// [`Case`], without the program's output.
fn place(text: &str, mark: &str) -> (usize, Option<usize>) {
    let wanted = mark.strip_prefix('^');
    let at = text.find(wanted.unwrap_or(mark)).unwrap_or_else(|| panic!("`{mark}` is not in the file"));
    let line = text[..at].matches('\n').count() + 1;
    let column = text[..at].chars().rev().take_while(|c| *c != '\n').count() + 1;
    (line, wanted.map(|_| column))
}

/// Applies a case to the valid file `text` and writes the result as `name` into an empty folder. Runs the
/// program, which must refuse the file. Returns the fault in the program's message, if any.
pub fn fault(folder: &Path, name: &str, text: &str, case: &Case, arguments: &[&str]) -> Option<String> {
    let &(what, from, to, mark, expected) = case;
    let text = edit(text, from, to);
    std::fs::write(folder.join(name), &text).expect("a file");
    let shown = stderr(&run(folder, arguments, 2));
    let left: Vec<_> = files(folder).into_keys().collect();
    let complain = |why: String| Some(format!("{what}: {why}\n{shown}"));
    if left != [Path::new(name)] || std::fs::read_dir(folder).expect("a folder").count() != 1 {
        return complain(format!("left {left:?}"));
    }
    let first = shown.lines().next().unwrap_or("");
    let Some(rest) = first.strip_prefix(&format!("error: {name}:")) else {
        return complain("the first line names no place".into());
    };
    let mut parts = rest.splitn(3, ':');
    let mut number = || parts.next().and_then(|p| p.parse::<usize>().ok());
    let (Some(line), Some(column)) = (number(), number()) else {
        return complain("no line and column".into());
    };
    let (want_line, want_column) = place(&text, mark);
    if line != want_line || want_column.is_some_and(|c| c != column) {
        return complain(format!("at {line}:{column}, not {want_line}:{want_column:?}"));
    }
    if !shown.contains(expected) {
        return complain(format!("does not say `{expected}`"));
    }
    let fix = shown.lines().find_map(|l| l.trim().strip_prefix("fix: "));
    if fix.is_none_or(|m| m.len() < 8) {
        return complain("no fix".into());
    }
    None
}
