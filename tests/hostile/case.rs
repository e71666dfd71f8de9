//! Runs hostile cases and collects the faults of the program's responses.

use super::fixtures::Fixtures;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Maximum allowed duration of a call on a machine that runs other programs at the same time.
const PATIENCE: Duration = Duration::from_secs(30);
/// Largest allowed message in bytes.
const FLOOD: u64 = 64 << 10;

/// A file to create in the folder before a case runs.
#[derive(Clone, Debug)]
pub enum Put {
    Text(String),
    Bytes(Vec<u8>),
    /// A copy of a fixture file or folder.
    Copy(&'static str),
    /// The first half of a fixture file.
    Half(&'static str),
    /// No file. The case removes a file that an earlier entry created.
    Gone,
    Folder,
    Fifo,
    /// A symbolic link to a path.
    Link(&'static str),
    /// A sparse file of the given size in bytes.
    Sparse(u64),
}

/// Required exit code of a case.
#[derive(Clone, Copy, Debug)]
pub enum Expect {
    /// Exit code 0, for valid input.
    Accepted,
    /// Exit code 1, for a failure of the system.
    Failed,
    /// Exit code 2, for invalid input.
    Refused,
}

/// A call of the program. In arguments and texts, `{f}` is the folder of fixtures.
#[derive(Clone, Debug)]
pub struct Case {
    pub name: String,
    pub files: Vec<(String, Put)>,
    pub arguments: Vec<String>,
    pub expect: Expect,
    /// Words that the message must contain.
    pub says: &'static str,
    /// Size of the largest file that the child process can write, in blocks of 512 bytes. The limit simulates
    /// a full disk.
    pub limit: Option<u32>,
    /// Store that the program must not report as finished after the call.
    pub verify: Option<&'static str>,
    /// Permission mode of the created files. If root runs the tests, the user `nobody` runs the program.
    pub mode: Option<u32>,
    /// Outputs that can exist after a failure, because the program finished them before the failure.
    pub may_leave: &'static [&'static str],
}

impl Case {
    /// Returns a case for a call that the program must refuse. Blanks separate the arguments in `line`.
    pub fn new(name: impl Into<String>, line: &str) -> Self {
        Self {
            name: name.into(),
            files: vec![],
            arguments: line.split_whitespace().map(str::to_owned).collect(),
            expect: Expect::Refused,
            says: "",
            limit: None,
            verify: None,
            mode: None,
            may_leave: &[],
        }
    }

    pub fn put(mut self, name: impl Into<String>, put: Put) -> Self {
        self.files.push((name.into(), put));
        self
    }

    pub fn expect(self, expect: Expect) -> Self {
        Self { expect, ..self }
    }

    pub fn says(self, says: &'static str) -> Self {
        Self { says, ..self }
    }
}

/// Runs cases in parallel. Returns one line for each wrong response.
pub fn run_all(cases: &[Case], fixtures: &Fixtures) -> Vec<String> {
    cases.par_iter().filter_map(|case| run(case, fixtures)).collect()
}

/// Runs a case. Returns the case's name with the faults of the program's response, if any.
fn run(case: &Case, fixtures: &Fixtures) -> Option<String> {
    let folder = fixtures.empty();
    let root = fixtures.path().display().to_string();
    let at = folder.path().join("at");
    fs::create_dir(&at).expect("a folder");
    for (name, put) in &case.files {
        place(&at.join(name), put, fixtures.path(), &root);
    }
    let before = contents(&at);
    if let Some(mode) = case.mode {
        let set = |path: &Path, mode| {
            fs::set_permissions(path, fs::Permissions::from_mode(mode)).expect("the owner");
        };
        case.files.iter().for_each(|(name, _)| set(&at.join(name), mode));
    }
    let [out, err] = ["out", "err"].map(|name| folder.path().join(name));
    let file = |path: &Path| Stdio::from(File::create(path).expect("a file"));
    let arguments: Vec<String> = case.arguments.iter().map(|a| a.replace("{f}", &root)).collect();
    let mut command = Command::new(env!("CARGO_BIN_EXE_sunstone"));
    if let Some(blocks) = case.limit {
        // The shell ignores the signal for writes beyond the limit, so that such a write fails as on a full
        // disk.
        command = Command::new("sh");
        let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
        command.arg("-c").arg(script).arg(env!("CARGO_BIN_EXE_sunstone"));
    }
    if case.mode.is_some() && is_root() {
        command = Command::new("setpriv");
        command.args(["--reuid=65534", "--regid=65534", "--clear-groups", env!("CARGO_BIN_EXE_sunstone")]);
    }
    let mut child = command
        .args(&arguments)
        .current_dir(&at)
        .env_remove("SUNSTONE_LOG")
        .stdin(Stdio::null())
        .stdout(file(&out))
        .stderr(file(&err))
        .spawn()
        .expect("the program");
    let begun = Instant::now();
    let mut hung = false;
    let code = loop {
        if let Some(status) = child.try_wait().expect("a status") {
            break status.code();
        }
        if begun.elapsed() > PATIENCE {
            hung = true;
            let _ = child.kill();
            let _ = child.wait();
            break None;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let length = fs::metadata(&err).map_or(0, |m| m.len());
    let bytes = if length <= FLOOD * 4 { fs::read(&err).unwrap_or_default() } else { vec![] };
    let stderr = String::from_utf8_lossy(&bytes).into_owned();
    if case.mode.is_some() {
        for (name, _) in &case.files {
            fs::set_permissions(at.join(name), fs::Permissions::from_mode(0o755)).expect("the owner");
        }
    }
    let after = contents(&at);
    let finished = |name: &Path| case.may_leave.iter().any(|n| name.to_string_lossy().starts_with(n));
    let new = after.iter().filter(|(name, what)| before.get(*name) != Some(*what) && !finished(name));
    let gone = before.keys().filter(|name| !after.contains_key(*name));
    let left: Vec<&PathBuf> = new.map(|(name, _)| name).chain(gone).collect();
    let is_reported_finished = |store: &str| {
        let verify =
            Command::new(env!("CARGO_BIN_EXE_sunstone")).args(["verify", store]).current_dir(&at).output();
        verify.expect("the program").status.code() != Some(2)
    };
    let failed = code != Some(0);
    let unreported = !stderr.contains(case.says) || failed && stderr.trim().is_empty();
    let faults = [
        (hung, "hung".to_owned()),
        (stderr.contains("panicked at") || code == Some(101) || code.is_none() && !hung, "panicked".into()),
        (length > FLOOD, "flooded".into()),
        (failed && !left.is_empty(), format!("left {left:?}")),
        (failed && case.verify.is_some_and(is_reported_finished), "left a finished store".into()),
        (
            code != Some(case.expect as i32) || unreported,
            format!("code {code:?}, expected {:?}", case.expect),
        ),
    ];
    let faults: Vec<String> = faults.into_iter().filter(|f| f.0).map(|f| f.1).collect();
    let excerpt = stderr.lines().take(3).collect::<Vec<_>>().join(" | ");
    (!faults.is_empty()).then(|| format!("{}: {}: {excerpt:.300}", case.name, faults.join(", ")))
}

/// Returns whether the user of this process is root.
pub fn is_root() -> bool {
    fs::metadata("/proc/self").is_ok_and(|m| m.uid() == 0)
}

fn place(path: &Path, put: &Put, fixtures: &Path, root: &str) {
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent).expect("a folder");
    }
    match put {
        Put::Text(text) => fs::write(path, text.replace("{f}", root)).expect("a file"),
        Put::Bytes(bytes) => fs::write(path, bytes).expect("a file"),
        Put::Copy(name) => copy(&fixtures.join(name), path),
        Put::Half(name) => {
            let bytes = fs::read(fixtures.join(name)).expect("a file");
            fs::write(path, &bytes[..bytes.len() / 2]).expect("a file");
        }
        Put::Gone => drop(fs::remove_file(path)),
        Put::Folder => fs::create_dir(path).expect("a folder"),
        Put::Fifo => {
            let made = Command::new("mkfifo").arg(path).status().expect("mkfifo");
            assert!(made.success(), "no pipe");
        }
        Put::Link(to) => std::os::unix::fs::symlink(to.replace("{f}", root), path).expect("a link"),
        Put::Sparse(length) => File::create(path).and_then(|f| f.set_len(*length)).expect("a file"),
    }
}

/// Copies a file, or a folder with its content.
pub fn copy(from: &Path, to: &Path) {
    if !from.is_dir() {
        fs::copy(from, to).expect("a copy");
        return;
    }
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder") {
        let name = entry.expect("an entry").file_name();
        copy(&from.join(&name), &to.join(&name));
    }
}

/// Returns the contents of a folder. The map contains the bytes of small files, the lengths of large files,
/// and the kinds of all other entries.
pub fn contents(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    fn walk(root: &Path, at: &Path, out: &mut BTreeMap<PathBuf, Vec<u8>>) {
        for entry in fs::read_dir(at).expect("a folder") {
            let path = entry.expect("an entry").path();
            let meta = fs::symlink_metadata(&path).expect("it is there");
            let name = path.strip_prefix(root).expect("below").to_owned();
            let kind = meta.file_type();
            let what = if kind.is_dir() {
                walk(root, &path, out);
                b"folder".to_vec()
            } else if kind.is_symlink() {
                b"link".to_vec()
            } else if kind.is_fifo() {
                b"pipe".to_vec()
            } else if meta.len() > 64 << 20 {
                meta.len().to_le_bytes().to_vec()
            } else {
                fs::read(&path).expect("a file")
            };
            out.insert(name, what);
        }
    }
    let mut out = BTreeMap::new();
    walk(root, root, &mut out);
    out
}
