//! The calibration file of a rig: one TOML document, in which each calibration writes only its own tables.
//!
//! | part | keys | readers |
//! |---|---|---|
//! | elements | `name`, `source`, `sensor`, `coaxial`, `generator`, `analyzer`, `polarimetric` | schemes |
//! | devices | `camera`, `projector`, `quality`, `covariance` | scenes, rig files |
//! | sensor | `radiometric`, `detector.cmos` | rig files, captures |
//! | counter | `temporal`, `detector.spad` | rig files, captures |

use crate::document;
use crate::locate::InputError;
use crate::lock::{Lock, LockError};
use crate::whole_file;
use serde::Deserialize;
use serde::de::{DeserializeOwned, IgnoredAny};
use std::io;
use std::path::Path;
use toml::{Table, Value};

/// The part of a calibration file that one kind of calibration writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Polarizers, retarders, beamsplitter and mirrors, as a capture scheme.
    Elements,
    /// Calibration of camera and projector.
    Devices,
    /// Calibration of a camera's sensor.
    Sensor,
    /// Calibration of a photon counter.
    Counter,
}

impl Part {
    /// All parts, in the order of the file. In a TOML file, keys without a table header come first.
    pub const ALL: [Self; 4] = [Self::Elements, Self::Devices, Self::Sensor, Self::Counter];

    /// Returns the keys of the part. In a pair, the first key names a table, and the second is a key in
    /// this table.
    fn keys(self) -> &'static [(&'static str, Option<&'static str>)] {
        match self {
            Self::Elements => &[
                ("name", None),
                ("source", None),
                ("sensor", None),
                ("coaxial", None),
                ("generator", None),
                ("analyzer", None),
                ("polarimetric", None),
            ],
            Self::Devices => {
                &[("camera", None), ("projector", None), ("quality", None), ("covariance", None)]
            }
            Self::Sensor => &[("radiometric", None), ("detector", Some("cmos"))],
            Self::Counter => &[("temporal", None), ("detector", Some("spad"))],
        }
    }

    /// Returns the tables and keys of a document that belong to the part.
    fn of(self, all: &Table) -> Table {
        let mut out = Table::new();
        for (key, inner) in self.keys() {
            let found = match (all.get(*key), inner) {
                (Some(Value::Table(t)), Some(inner)) => t.get(*inner).map(|v| {
                    let mut one = Table::new();
                    one.insert((*inner).to_owned(), v.clone());
                    Value::Table(one)
                }),
                (found, None) => found.cloned(),
                _ => None,
            };
            if let Some(value) = found {
                out.insert((*key).to_owned(), value);
            }
        }
        out
    }
}

/// Error of [`put`]. The file is unchanged after an error.
#[derive(Debug)]
pub enum PutError {
    /// The existing file is not a calibration.
    Input(InputError),
    /// Another calibration is writing to the file. Contains the name of the process that holds the lock.
    Held(String),
    Io(io::Error),
}

impl std::fmt::Display for PutError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Input(e) => e.fmt(f),
            Self::Held(who) => write!(
                f,
                "the calibration file is locked by {who}; wait until that process ends, then run the command again"
            ),
            Self::Io(e) => e.fmt(f),
        }
    }
}

impl std::error::Error for PutError {}

const HEAD: &str = "# Calibration written by `sunstone calibrate` and `sunstone rig calibrate`. Each command replaces only its own tables.\n\
                    # [camera] and [projector] use the keys of scene files (world = camera frame, in metres; opencv_matrix uses OpenCV's pixel\n\
                    # coordinates: (0, 0) is the centre of the first pixel), [detector] those of rig files, and all other tables those of schemes.\n\n";

/// All keys that a calibration file may contain. Any other key is reported with its location.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(dead_code)] // only the structure is checked
struct Document {
    name: IgnoredAny,
    source: IgnoredAny,
    sensor: IgnoredAny,
    coaxial: IgnoredAny,
    generator: IgnoredAny,
    analyzer: IgnoredAny,
    polarimetric: IgnoredAny,
    camera: IgnoredAny,
    projector: IgnoredAny,
    quality: IgnoredAny,
    covariance: IgnoredAny,
    radiometric: IgnoredAny,
    temporal: IgnoredAny,
    detector: Detectors,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(dead_code)] // only the structure is checked
struct Detectors {
    cmos: IgnoredAny,
    spad: IgnoredAny,
}

/// Parses the part of a calibration file that a reader needs. Ignores keys of other parts, and refuses
/// unknown keys.
///
/// # Errors
/// Returns [`InputError`] with the location of the fault.
pub fn parse<T: DeserializeOwned>(path: &Path, text: &str, fix: &str) -> Result<T, InputError> {
    document::parse::<Document>(path, text, |_| fix.to_owned())?;
    document::parse(path, text, |_| fix.to_owned())
}

/// Returns the text of a calibration file in which `text` replaces one part. `text` is TOML with the keys of
/// the replaced part only. All other parts are copied from `old`, the current text of the file at `path`.
///
/// # Errors
/// If `old` is not a calibration, returns [`InputError`] at the unknown key or at the invalid TOML.
pub fn merged(path: &Path, old: &str, part: Part, text: &str) -> Result<String, InputError> {
    let fix = "the existing file is not a calibration and was not changed; choose another file name, or move the file";
    let known: Table = parse(path, old, fix)?;
    let mut out = HEAD.to_owned();
    for of in Part::ALL {
        let section = if of == part {
            text.to_owned()
        } else {
            let kept = of.of(&known);
            if kept.is_empty() {
                continue;
            }
            toml::to_string(&kept).map_err(|e| InputError::new(path, old, None, e.to_string(), fix))?
        };
        out.push_str(section.trim_end());
        out.push_str("\n\n");
    }
    out.truncate(out.trim_end().len() + 1);
    Ok(out)
}

/// Writes a part to the calibration file at `path`. If the file does not exist, it is created. `text` is TOML
/// with the keys of the written part only. All other parts are kept, without comments. Readers see either the
/// old or the new file.
///
/// # Errors
/// If writing fails, returns [`PutError`] and leaves the file unchanged.
pub fn put(path: &Path, part: Part, text: &str) -> Result<(), PutError> {
    // Without the lock, two writers could read the same fileand overwrite each other's results.
    let _lock = Lock::take(path).map_err(|e| match e {
        LockError::Held(who) => PutError::Held(who),
        LockError::Io(e) => PutError::Io(e),
    })?;
    let old = if path.exists() {
        document::read(path, "calibration", "choose another file name").map_err(PutError::Input)?
    } else {
        String::new()
    };
    let text = merged(path, &old, part, text).map_err(PutError::Input)?;
    whole_file::write(path, text.as_bytes()).map_err(PutError::Io)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TEXTS: [(Part, &str); 4] = [
        (
            Part::Elements,
            "name = \"a\"\n[sensor]\nkind = \"intensity\"\n[[generator]]\nkind = \"polarizer\"\nangle_deg = 0.1\n",
        ),
        (
            Part::Devices,
            "[camera]\nresolution = [4, 3]\n[quality]\nviews = 2\n[covariance]\nrows = [[1.0]]\n",
        ),
        (Part::Sensor, "[radiometric]\nx = 1\n[detector.cmos]\ngain_e_per_dn = 2.5\n"),
        (Part::Counter, "[temporal]\nz = \"AAAA\"\n[detector.spad]\nirf_fwhm_ps = 61.0\n"),
    ];

    fn table(text: &str) -> Table {
        text.parse().expect("TOML")
    }

    fn put_all(path: &Path, order: &[usize]) -> String {
        for k in order {
            put(path, TEXTS[*k].0, TEXTS[*k].1).expect("writes");
        }
        std::fs::read_to_string(path).expect("reads")
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Writes parts in any order and with repetitions. Verifies that the file contains the last text
        /// written for each part and no other parts.
        #[test]
        fn the_last_written_parts_are_read_back(order in prop::collection::vec(0_usize..4, 1..7)) {
            let folder = tempfile::tempdir().expect("a folder");
            let all = table(&put_all(&folder.path().join("c.toml"), &order));
            for (k, (part, text)) in TEXTS.iter().enumerate() {
                let want = if order.contains(&k) { table(text) } else { Table::new() };
                prop_assert_eq!(part.of(&all), want);
            }
            prop_assert_eq!(std::fs::read_dir(folder.path()).expect("lists").count(), 1);
        }

        /// Verifies that any damaged text gives a calibration or an error, and never a panic.
        #[test]
        fn damaged_text_never_panics(text in "[ -~\n]{0,60}", at in 0_usize..200) {
            let folder = tempfile::tempdir().expect("a folder");
            let mut whole = put_all(&folder.path().join("c.toml"), &[0, 1, 2, 3]);
            let at = (0..=at.min(whole.len())).rev().find(|i| whole.is_char_boundary(*i)).unwrap_or(0);
            whole.insert_str(at, &text);
            let _ = merged(Path::new("c.toml"), &whole, Part::Sensor, TEXTS[2].1);
        }
    }

    /// Verifies that a new result for a part replaces all keys of this part.
    #[test]
    fn a_new_part_replaces_all_keys_of_the_old_one() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("c.toml");
        put_all(&path, &[0, 1, 2, 3]);
        put(&path, Part::Devices, "[camera]\nresolution = [8, 6]\n").expect("writes");
        let all = table(&std::fs::read_to_string(&path).expect("reads"));
        assert!(!all.contains_key("quality") && all["camera"]["resolution"][0].as_integer() == Some(8));
        assert!(all.contains_key("temporal") && all["detector"]["cmos"]["gain_e_per_dn"].is_float());
    }

    /// Verifies that a file that is not a calibration is reported with a location and left unchanged.
    #[test]
    fn other_files_are_reported_and_left_unchanged() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("c.toml");
        for (text, words) in [
            ("[camera]\n[objects]\n", "c.toml:2:2: unknown key `objects`"),
            ("[detector.emccd]\n", "unknown key `emccd`"),
            ("[camera]\n[camera]\n", "c.toml:2:"),
            ("[camera\n", "c.toml:1:"),
        ] {
            std::fs::write(&path, text).expect("writes");
            let answer = put(&path, Part::Sensor, TEXTS[2].1).expect_err("a fault").to_string();
            assert!(answer.contains(words) && answer.contains("another file name"), "{text}: {answer}");
            assert_eq!(std::fs::read_to_string(&path).expect("reads"), text);
        }
        let held = Lock::take(&path).expect("free");
        assert!(matches!(put(&path, Part::Sensor, ""), Err(PutError::Held(_))));
        drop(held);
    }
}
