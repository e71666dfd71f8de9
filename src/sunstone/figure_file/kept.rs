//! Stores results of applications in a cache next to the renders. Methods are fitted again only after a
//! change of scenes, renders or program.
//!
//! A cache file contains one run of an application at one size and is written atomically. The first line
//! contains the format version and a digest of the rest of the file. The second line contains the key, and
//! the third line is JSON with names and shapes. All numbers follow as little-endian doubles. The key is the
//! digest of the inputs ([`crate::applications::Run::inputs`]) and of the program. If the file is damaged or
//! has another key, the run is repeated and the file is replaced.

use apply::application::Application;
use apply::map::Map;
use apply::metrics::paired::Estimate;
use base::whole_file;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

use crate::applications::Report;
use crate::applications::curves;
use crate::applications::links::Links;

/// First words of a cache file, including the version of the format.
const BEGIN: &str = "sunstone fit 2 ";

/// The results that panels show, from one run of an application.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// Scores of all methods for all seeds.
    pub scores: Vec<Score>,
    /// The table of mean scores.
    pub rows: Vec<Row>,
    /// Images of the first seed.
    pub pictures: Vec<Picture>,
    /// Scores of methods through a capture chain, instead of images.
    pub points: Vec<Point>,
    /// The conditions under which the first method is best.
    pub verdicts: Vec<Verdict>,
}

/// The score of a method at one point of a curve (see [`curves::Point`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    pub metric: String,
    pub series: String,
    pub method: String,
    pub baseline: bool,
    #[serde(skip)]
    pub value: f64,
    /// Score, standard error of the score, score of the first method minus this score, and standard error of
    /// the difference. For the first method, the difference and its standard error are NaN.
    #[serde(skip)]
    pub numbers: [f64; 4],
}

/// A verdict of a metric (see [`curves::Verdict`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    pub metric: String,
    pub series: String,
    pub baseline: String,
    pub words: String,
}

/// The score of a method on one variant at one seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    pub seed: u64,
    pub method: String,
    pub metric: String,
    pub variant: u64,
    #[serde(skip)]
    pub value: f64,
}

/// The mean score of a method, with its standard error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    pub method: String,
    pub metric: String,
    #[serde(skip)]
    pub mean: f64,
    #[serde(skip)]
    pub error: f64,
}

/// An image made by a method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    pub method: String,
    pub name: String,
    pub variant: Option<u64>,
    pub shared: bool,
    /// Columns, rows, channels.
    pub shape: [usize; 3],
    /// Values, row-major. The channel varies fastest.
    #[serde(skip)]
    pub data: Vec<f64>,
}

impl Fit {
    /// Converts a report to the results that the cache stores. Sweeps and comparisons of capture counts have
    /// no images.
    pub fn of(mut report: Report, application: &Application, links: &Links) -> Self {
        let (mut points, mut verdicts) = (vec![], vec![]);
        for metric in application.metrics.iter().copied() {
            let name = || metric.name.to_owned();
            let own = curves::points(metric, &report, links).into_iter();
            points.extend(own.map(|p| {
                let of = |e: Option<Estimate>| e.map_or([f64::NAN; 2], |e| [e.mean, e.error]);
                let ([a, b], [c, d]) = (of(Some(p.worth)), of(p.ours_less_this));
                Point {
                    metric: name(),
                    series: p.series,
                    method: p.method,
                    baseline: p.baseline,
                    value: p.value,
                    numbers: [a, b, c, d],
                }
            }));
            let own = curves::verdicts(metric, &report, links).into_iter();
            verdicts.extend(own.map(|v| Verdict {
                metric: name(),
                series: v.series,
                baseline: v.baseline,
                words: v.words,
            }));
        }
        if *links != Links::None {
            report.first.pictures.clear();
        }
        let scores = report.scores.into_iter().map(|(seed, s)| Score {
            seed,
            method: s.method.to_owned(),
            metric: s.metric.to_owned(),
            variant: s.variant,
            value: s.value,
        });
        let rows = report.rows.into_iter().map(|r| Row {
            method: r.method.name.to_owned(),
            metric: r.metric.name.to_owned(),
            mean: r.value.mean,
            error: r.value.error,
        });
        let pictures = report.first.pictures.into_iter().map(|p| {
            let Map { width, height, channels, data } = p.map;
            Picture {
                method: p.method.to_owned(),
                name: p.name.to_owned(),
                variant: p.variant,
                shared: p.shared,
                shape: [width, height, channels],
                data,
            }
        });
        Self {
            scores: scores.collect(),
            rows: rows.collect(),
            pictures: pictures.collect(),
            points,
            verdicts,
        }
    }

    /// Returns references to all numbers, in the order of the file.
    fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        let scores = self.scores.iter_mut().map(|s| &mut s.value);
        let rows = self.rows.iter_mut().flat_map(|r| [&mut r.mean, &mut r.error]);
        let pictures = self.pictures.iter_mut().flat_map(|p| &mut p.data);
        let points = self.points.iter_mut();
        let points = points.flat_map(|p| std::iter::once(&mut p.value).chain(&mut p.numbers));
        scores.chain(rows).chain(pictures).chain(points)
    }
}

/// Returns the digest of the bytes in hexadecimal digits.
pub fn digest(bytes: &[u8]) -> String {
    let digest = Sha256::digest(bytes);
    digest.iter().map(|b| format!("{b:02x}")).collect()
}

/// Returns a digest of this executable, or `None` if the executable cannot be read. If code is loaded
/// dynamically, for example by Python, the digest does not identify the build.
pub fn program() -> Option<String> {
    // This symbolic link is valid even if another build replaced the executable.
    let own = Path::new("/proc/self/exe");
    let path = if own.exists() { own.to_owned() } else { std::env::current_exe().ok()? };
    Some(digest(&std::fs::read(path).ok()?))
}

/// The cache file of one run of an application.
pub struct Place {
    path: PathBuf,
    key: String,
}

impl Place {
    /// Returns the path and the key of a cache file in a folder. `name` identifies the application and the
    /// size. `program` and `inputs` determine the key.
    pub fn new(folder: &Path, name: &str, program: &str, inputs: &str) -> Self {
        Self {
            path: folder.join(format!("{name}.fit")),
            key: digest(format!("{program}\n{inputs}").as_bytes()),
        }
    }

    /// Returns the cached results if the file is intact and has the same key.
    pub fn read(&self) -> Option<Fit> {
        let bytes = std::fs::read(&self.path).ok()?;
        let (first, rest) = line(&bytes)?;
        if first.strip_prefix(BEGIN)? != digest(rest) {
            return None;
        }
        let (key, rest) = line(rest)?;
        if key != self.key {
            return None;
        }
        let (head, numbers) = line(rest)?;
        let mut fit: Fit = serde_json::from_str(head).ok()?;
        for p in &mut fit.pictures {
            let [w, h, channels] = p.shape;
            let length = w.checked_mul(h)?.checked_mul(channels)?;
            p.data = vec![0.0; (length <= numbers.len() / 8).then_some(length)?];
        }
        let mut values = numbers.chunks_exact(8);
        for n in fit.numbers() {
            *n = f64::from_le_bytes(values.next()?.try_into().ok()?);
        }
        values.next().is_none().then_some(fit)
    }

    /// Writes the results. Errors are only logged. A file that is not a cache file is not
    /// overwritten.
    pub fn write(&self, fit: &mut Fit) {
        let foreign = match std::fs::read(&self.path) {
            Ok(bytes) => !bytes.starts_with(BEGIN.as_bytes()),
            Err(e) => e.kind() != std::io::ErrorKind::NotFound,
        };
        let shown = self.path.display();
        if foreign {
            tracing::warn!("{shown} is not a cache file, so results are not cached; rename this file");
            return;
        }
        let Ok(head) = serde_json::to_string(fit) else {
            return;
        };
        let mut rest = format!("{}\n{head}\n", self.key).into_bytes();
        rest.extend(fit.numbers().flat_map(|n| n.to_le_bytes()));
        let mut bytes = format!("{BEGIN}{}\n", digest(&rest)).into_bytes();
        bytes.extend(rest);
        if let Err(e) = whole_file::write(&self.path, &bytes) {
            tracing::warn!("cannot write {shown}: {e}; the next run will fit the methods again");
        }
    }
}

/// Splits the bytes into the first line and the rest.
fn line(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let end = bytes.iter().position(|b| *b == b'\n')?;
    Some((std::str::from_utf8(&bytes[..end]).ok()?, &bytes[end + 1..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit() -> Fit {
        let words = |s: &str| s.to_owned();
        Fit {
            scores: vec![Score {
                seed: 1,
                method: words("a"),
                metric: words("m"),
                variant: 3,
                value: 0.1 + 0.2,
            }],
            rows: vec![Row { method: words("a"), metric: words("m"), mean: -0.0, error: f64::INFINITY }],
            pictures: vec![Picture {
                method: words("a\nb"),
                name: words("score"),
                variant: Some(u64::MAX),
                shared: true,
                shape: [2, 1, 3],
                data: vec![f64::MIN_POSITIVE, 1e300, -5.0, 0.0, 1.0 / 3.0, 7.0],
            }],
            points: vec![Point {
                metric: words("m"),
                series: words("nominal"),
                method: words("a"),
                baseline: true,
                value: f64::INFINITY,
                numbers: [0.7, 0.1, -0.0, 1e-300],
            }],
            verdicts: vec![Verdict {
                metric: words("m"),
                series: words("nominal"),
                baseline: words("b"),
                words: words("down to 30 e⁻"),
            }],
        }
    }

    #[test]
    fn a_fit_round_trips_only_for_its_own_inputs() {
        let folder = tempfile::tempdir().expect("a folder");
        let place = |program, inputs| Place::new(folder.path(), "x", program, inputs);
        let own = place("p", "i");
        assert_eq!(own.read(), None);
        own.write(&mut fit());
        assert_eq!(own.read(), Some(fit()));
        // The cache does not contain results of another build or of other renders.
        assert_eq!(place("q", "i").read(), None);
        assert_eq!(place("p", "j").read(), None);
        // New results replace the file, because there is one file per run.
        place("q", "i").write(&mut Fit::default());
        assert_eq!(own.read(), None);
        assert_eq!(place("q", "i").read(), Some(Fit::default()));
        assert_eq!(std::fs::read_dir(folder.path()).expect("lists").count(), 1);
    }

    #[test]
    fn damaged_fits_are_ignored_and_other_files_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let place = Place::new(folder.path(), "x", "p", "i");
        place.write(&mut fit());
        let path = folder.path().join("x.fit");
        let whole = std::fs::read(&path).expect("reads");
        for at in 0..whole.len() {
            let mut bad = whole.clone();
            bad[at] ^= 1;
            std::fs::write(&path, &bad).expect("writes");
            assert_eq!(place.read(), None, "byte {at}");
            std::fs::write(&path, &whole[..at]).expect("writes");
            assert_eq!(place.read(), None, "cut at {at}");
        }
        std::fs::write(&path, "my notes").expect("writes");
        place.write(&mut fit());
        assert_eq!(std::fs::read(&path).expect("reads"), b"my notes");
    }
}
