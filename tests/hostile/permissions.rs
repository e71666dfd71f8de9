//! Tests that the program reports files and folders without read or write permission. If root runs the tests,
//! the user `nobody` runs the program, if possible.

use super::case::{Case, Expect, Put, is_root};
use super::inputs::READERS;
use super::outputs::{WRITERS, named};
use std::process::{Command, Stdio};

/// Returns whether the program can run as a user without the permissions of root.
fn possible() -> bool {
    let nobody = || {
        Command::new("setpriv")
            .args(["--reuid=65534", "--regid=65534", "--clear-groups"])
            .args([env!("CARGO_BIN_EXE_sunstone"), "--version"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
    };
    !is_root() || nobody().is_ok_and(|s| s.success())
}

pub fn cases() -> Vec<Case> {
    if !possible() {
        println!("nobody cannot run the program: no cases of permissions");
        return vec![];
    }
    let mut cases = vec![];
    // The listed commands open another file before the file without permission.
    let others = [
        "rig status",
        "rig flash",
        "reconstruct {x} -o out.zarr",
        "ptu ",
        "capture {f}/M.npy --scheme {f}/drr36.toml --detector",
    ];
    let is_other = |line: &str| others.iter().any(|other| line.starts_with(other));
    for (line, file, _) in READERS.iter().filter(|r| r.1.contains('.') && !is_other(r.0)) {
        let put = if file.ends_with(".zarr") { Put::Folder } else { Put::Text("x".into()) };
        let name = format!("not to be read: {line}");
        let mut case = Case::new(name, &line.replace("{x}", file)).put(*file, put);
        (case.mode, case.says) = (Some(0), "ermission");
        cases.push(case);
    }
    for (line, extension, input) in WRITERS.iter().filter(|w| !is_other(w.0)) {
        let name = format!("not to be written: {line} .{extension}");
        let line = line.replace("{i}", &format!("{{f}}/{input}"));
        let line = line.replace("{o}", &format!("d/{}", named(extension)));
        let mut case = Case::new(name, &line).put("d", Put::Folder);
        (case.mode, case.says) = (Some(0o555), "ermission denied");
        cases.push(case.expect(Expect::Failed));
    }
    cases
}
