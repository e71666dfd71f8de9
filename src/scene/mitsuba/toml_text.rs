//! Values and paths as a scene file writes them.

use super::tree::{number, numbers};
use super::xml::number as digits;
use glam::DAffine3;
use std::path::{Component, Path, PathBuf};

/// A map as rows of a 4×4 matrix.
pub(super) fn matrix(map: &DAffine3) -> String {
    let m = map.matrix3;
    let row = |i: usize| list(&[m.x_axis[i], m.y_axis[i], m.z_axis[i], map.translation[i]]);
    format!("[{}, {}, {}, [0, 0, 0, 1]]", row(0), row(1), row(2))
}

pub(super) fn list(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(|v| digits(*v)).collect();
    format!("[{}]", values.join(", "))
}

/// A TOML string.
pub(super) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// A spectrum in TOML, each value multiplied.
pub(super) fn scaled(spectrum: &str, factor: f64) -> String {
    // Irradiances are f32 in the end: rounding there takes the factor's own rounding away.
    let times = |v: f64| digits(f64::from((v * factor) as f32));
    if let Some(v) = number(spectrum) {
        return times(v);
    }
    let (head, values) = match spectrum.split_once("values = ") {
        Some((head, values)) => (format!("{head}values = "), values.trim_end_matches([' ', '}'])),
        None => (String::new(), spectrum),
    };
    let values = numbers(values.trim_matches(['[', ']'])).unwrap_or_default();
    let values: Vec<String> = values.into_iter().map(times).collect();
    let tail = if head.is_empty() { "" } else { " }" };
    format!("{head}[{}]{tail}", values.join(", "))
}

/// How to reach `path` from `folder`, both absolute.
pub(super) fn relative(folder: &Path, path: &Path) -> PathBuf {
    let path = normal(path);
    let folder = normal(folder);
    let (a, b): (Vec<Component>, Vec<Component>) =
        (folder.components().collect(), path.components().collect());
    let shared = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    if shared == 0 {
        return path;
    }
    let up = a[shared..].iter().map(|_| Component::ParentDir);
    up.chain(b[shared..].iter().copied()).collect()
}

/// A path without `.` and, where that cannot go wrong, without `..`.
fn normal(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if out.file_name().is_some() => {
                out.pop();
            }
            other => out.push(other),
        }
    }
    out
}
