//! Provides Zarr stores as sinks of renders. A sink creates or resumes the store, keeps a journal of tiles,
//! and marks the store as complete at the end.

use crate::denoised::{self, Denoised};
use crate::zarr::progress::Progress;
use crate::zarr::{AccessError, CreateError, OpenError, SampleGrid, StoredSlice, TensorStore};
use base::journal;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use tensor::axes::SliceLayout;
use tensor::part::{self, Part};
use tensor::sink::{Job, JobSlice, Piece, SampleCounts, Sink, Summary, TileRecord};
use tensor::target;

/// The destination of a render, and how the sink treats an existing store at the destination.
#[derive(Clone, Debug, Default)]
pub struct Target {
    pub path: PathBuf,
    /// Whether to resume an unfinished render at `path`.
    pub resume: bool,
    /// Whether to replace a store at `path`.
    pub replace: bool,
}

/// The reason why a store did not accept a render.
#[derive(Debug, thiserror::Error)]
pub enum SinkError {
    #[error(transparent)]
    Create(#[from] CreateError),
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A chunk cannot be written.
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error(
        "cannot write the progress journal in {path}: {cause}; free disk space or check permissions, then run again with --resume"
    )]
    Journal { path: PathBuf, cause: std::io::Error },
    /// The caller passed values before it called `begin`.
    #[error("{path} is not ready to receive values: call `begin` first")]
    NotBegun { path: PathBuf },
    /// The caller passed values for a slice that the render does not have.
    #[error(
        "{path} has {slices} slices, but values were sent for slice {slice}: count the job's slices from 0"
    )]
    NoSlice {
        path: PathBuf,
        slices: usize,
        /// Index of the slice to which the values belong.
        slice: usize,
    },
    /// The store to resume is denoised.
    #[error(transparent)]
    Denoised(#[from] Denoised),
    /// The store to resume contains another render.
    #[error(
        "{path} contains another render: the two renders differ in {what} (the store has {theirs}, this render has {ours}); use the \
         same scene file and options, another -o, or --force to replace the store"
    )]
    Mismatch {
        path: PathBuf,
        /// Name of the attribute that differs.
        what: &'static str,
        /// Value of the attribute in the store.
        theirs: String,
        /// Value of the attribute in the render.
        ours: String,
    },
}

/// A store that a render fills.
#[derive(Debug)]
pub struct ZarrSink {
    target: Target,
    open: Option<Open>,
}

#[derive(Debug)]
struct Open {
    store: TensorStore,
    slices: Vec<StoredSlice>,
    /// Journal of tiles, or `None` if the store already contained the complete render.
    journal: Option<Progress>,
}

impl ZarrSink {
    /// Creates a sink for a destination. The sink does not access the destination before the render begins.
    pub fn new(target: Target) -> Self {
        Self { target, open: None }
    }

    /// Returns the store, or `None` before the render has begun.
    pub fn store(&self) -> Option<&TensorStore> {
        self.open.as_ref().map(|o| &o.store)
    }

    fn opened(&self) -> Result<&Open, SinkError> {
        self.open.as_ref().ok_or_else(|| SinkError::NotBegun { path: self.target.path.clone() })
    }

    fn journal_error(&self) -> impl Fn(std::io::Error) -> SinkError + use<> {
        let path = self.target.path.clone();
        move |cause| SinkError::Journal { path: path.clone(), cause }
    }

    /// Opens the store to resume, after checking that the store contains the same render.
    fn go_on(&self, job: &Job) -> Result<TensorStore, SinkError> {
        let store = TensorStore::open_for_write(&self.target.path)?;
        denoised::refuse(&store)?;
        check_same(&store, job)?;
        Ok(store)
    }

    /// Creates the store, or opens the store to resume after checking that it contains the same render.
    fn make(&self, job: &Job) -> Result<TensorStore, SinkError> {
        let Target { path, resume, replace } = &self.target;
        if *resume && TensorStore::is_there(path)? {
            return self.go_on(job);
        }
        let slices: Vec<_> = job.slices.iter().map(|s| (s.layout.clone(), s.attributes.clone())).collect();
        let grid = SampleGrid { camera: job.camera, tile: job.tile };
        let mut attributes = job.attributes.clone();
        attributes.insert("status".into(), json!("incomplete"));
        match TensorStore::create(path, &slices, &attributes, Some(grid), *replace) {
            // Another process created the store while this process waited for the lock.
            Err(CreateError::Exists { .. }) if *resume => self.go_on(job),
            made => Ok(made?),
        }
    }
}

fn check_same(store: &TensorStore, job: &Job) -> Result<(), SinkError> {
    let theirs = store.attributes();
    let mismatch =
        |what, theirs, ours| Err(SinkError::Mismatch { path: store.path().to_owned(), what, theirs, ours });
    for what in [
        part::ATTRIBUTE,
        target::ROUND,
        "variant",
        "scene_sha256",
        "seeds",
        "samples_per_pixel",
        "replicates_per_pixel",
        "max_depth",
        "integrator",
        "tile",
        "version",
        target::TILE_SAMPLES,
    ] {
        let (a, b) = (theirs.get(what), job.attributes.get(what));
        if a != b {
            let show = |v: Option<&Value>| v.map_or("nothing".into(), Value::to_string);
            return mismatch(what, show(a), show(b));
        }
    }
    // The journal lists tiles that are finished for the slices of the store, so the render must have the same
    // slices.
    let ours: Vec<&str> = job.slices.iter().map(|s| s.layout.name.as_str()).collect();
    if store.slice_names() != ours {
        return mismatch("list of slices", store.slice_names().join(", "), ours.join(", "));
    }
    for JobSlice { layout, .. } in &job.slices {
        let slice = store.slice(&layout.name)?;
        if slice.layout() != layout {
            let show = |l: &SliceLayout| format!("`{}` of shape {:?}", l.name, l.shape());
            return mismatch("layout of a slice", show(slice.layout()), show(layout));
        }
    }
    Ok(())
}

impl Sink for ZarrSink {
    type Error = SinkError;

    fn begin(&mut self, job: &Job) -> Result<Vec<TileRecord>, SinkError> {
        let store = self.make(job)?;
        let status = store.attributes().get("status").cloned();
        let names = job.slices.iter().map(|s| s.layout.name.as_str());
        let slices = names.map(|n| store.slice(n)).collect::<Result<_, _>>()?;
        let all_written = store.is_finished() || store.is_finished_part();
        let finished =
            status == Some(json!(finished_status(store.part()))) && all_written && !Progress::exists(&store);
        let (journal, done) = if self.target.resume && finished {
            let all = (0..job.tiles()).map(|tile| TileRecord {
                tile,
                samples: 0,
                discarded: 0,
                rays: 0,
                seconds: 0.0,
            });
            (None, all.collect())
        } else {
            store.unfinish()?;
            let (journal, done) = Progress::open(&store).map_err(self.journal_error())?;
            (Some(journal), done)
        };
        self.open = Some(Open { store, slices, journal });
        Ok(done)
    }

    fn put(&self, p: &Piece) -> Result<(), SinkError> {
        let slices = &self.opened()?.slices;
        let slice = slices.get(p.slice).ok_or_else(|| SinkError::NoSlice {
            path: self.target.path.clone(),
            slices: slices.len(),
            slice: p.slice,
        })?;
        Ok(slice.write_touched(p.field, p.start, p.shape, p.data, p.touched)?)
    }

    fn put_samples(&self, s: &SampleCounts) -> Result<(), SinkError> {
        Ok(self.opened()?.store.write_samples(s.start, s.shape, s.counts)?)
    }

    fn tile_done(&self, record: &TileRecord) -> Result<(), SinkError> {
        match &self.opened()?.journal {
            Some(journal) => journal.push(record).map_err(self.journal_error()),
            None => Ok(()),
        }
    }

    fn end(&mut self, summary: &Summary) -> Result<(), SinkError> {
        let failed = self.journal_error();
        let Some(open) = &mut self.open else {
            return Ok(());
        };
        let Some(journal) = open.journal.take() else {
            open.store.unlock();
            return Ok(());
        };
        let mut attributes = open.store.attributes();
        let earlier = attributes.get("wall_time_s").and_then(Value::as_f64).unwrap_or(0.0);
        attributes.insert("wall_time_s".into(), json!(earlier + summary.wall_s));
        attributes.insert("discarded_samples".into(), json!(summary.discarded));
        attributes.insert("rays".into(), json!(summary.rays_before + summary.rays));
        let status = if summary.complete { finished_status(open.store.part()) } else { "incomplete" };
        attributes.insert("status".into(), json!(status));
        open.store.set_attributes(attributes)?;
        if summary.complete {
            open.store.finish()?;
            journal.remove().map_err(failed)?;
        }
        open.store.unlock();
        Ok(())
    }
}

/// Returns the status text of a finished render, or of a finished part of a render.
fn finished_status(part: Option<Part>) -> &'static str {
    match part {
        Some(_) => "complete part",
        None => "complete",
    }
}

/// Returns whether `path` is a finished part of a render.
pub fn is_finished_part(path: &Path) -> bool {
    TensorStore::open(path).is_ok_and(|store| store.is_finished_part() && !journal::exists(path))
}

/// Returns whether `path` is a finished store.
pub fn is_finished(path: &Path) -> bool {
    TensorStore::open(path).is_ok_and(|store| store.is_finished() && !journal::exists(path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Map;
    use tensor::axes::{Axis, AxisKind};
    use tensor::field::Field;

    fn job(seed: u64, columns: u32) -> Job {
        let axis = |kind, n: u32| Axis { kind, coords: (0..n).map(f64::from).collect(), chunk: 2 };
        let attributes = json!({"scene_sha256": "a", "seeds": [seed], "samples_per_pixel": 4});
        Job {
            slices: vec![JobSlice {
                layout: SliceLayout {
                    name: "image".into(),
                    axes: vec![axis(AxisKind::Y, 2), axis(AxisKind::X, columns)],
                    time: None,
                    totals: false,
                },
                attributes: Map::new(),
            }],
            attributes: attributes.as_object().unwrap().clone(),
            camera: [4, 2],
            tile: 2,
        }
    }

    fn sink(path: &Path, resume: bool, replace: bool) -> ZarrSink {
        ZarrSink::new(Target { path: path.to_owned(), resume, replace })
    }

    fn piece(slice: usize, data: &[f32]) -> Piece<'_> {
        Piece { slice, field: Field::Mean, start: &[0, 0], shape: &[2, 2], data, touched: &[1] }
    }

    fn done(complete: bool) -> Summary {
        Summary { complete, ..Summary::default() }
    }

    #[test]
    fn renders_begin_resume_and_finish() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s");
        let record = |tile| TileRecord { tile, ..TileRecord::default() };
        let mut first = sink(&path, false, false);
        assert_eq!(first.begin(&job(1, 4)).unwrap(), []);
        first.put(&piece(0, &[1.0, 2.0, 3.0, 4.0])).unwrap();
        first.tile_done(&record(0)).unwrap();
        first.end(&done(false)).unwrap();
        assert!(!is_finished(&path));
        let mut second = sink(&path, true, false);
        assert_eq!(second.begin(&job(1, 4)).unwrap(), [record(0)]);
        second.end(&done(true)).unwrap();
        assert!(is_finished(&path));
        // The render is complete, so all tiles are known and no values are written.
        let mut third = sink(&path, true, false);
        assert_eq!(third.begin(&job(1, 4)).unwrap().len(), 2);
        third.tile_done(&record(1)).unwrap();
        third.end(&done(true)).unwrap();
        let store = third.store().unwrap();
        assert_eq!(store.attributes()["status"], "complete");
        let image = store.slice("image").unwrap().read_all(Field::Mean).unwrap();
        assert_eq!(image.data, [1.0, 2.0, 0.0, 0.0, 3.0, 4.0, 0.0, 0.0]);
    }

    #[test]
    fn invalid_calls_are_refused_with_a_fix() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s");
        let mut sound = sink(&path, false, false);
        let message = |r: Result<(), SinkError>| r.unwrap_err().to_string();
        let counts = SampleCounts { start: [0, 0], shape: [1, 1], counts: &[1] };
        for text in [
            message(sound.put(&piece(0, &[0.0; 4]))),
            message(sound.put_samples(&counts)),
            message(sound.tile_done(&TileRecord::default())),
        ] {
            assert!(text.contains("call `begin` first"), "{text}");
        }
        assert!(!path.exists());
        sound.begin(&job(1, 4)).unwrap();
        let again = message(sound.begin(&job(1, 4)).map(drop));
        assert!(again.contains("--resume") && again.contains("--force"), "{again}");
        let other = message(sound.put(&piece(3, &[0.0; 4])));
        assert!(other.contains("slice 3") && other.contains("from 0"), "{other}");
        let short = message(sound.put(&piece(0, &[0.0; 3])));
        assert!(short.contains("one value per element"), "{short}");
        // A list of touched elements is ignored if it is too short.
        let unsure = Piece { touched: &[], ..piece(0, &[1.0, 0.0, 0.0, 0.0]) };
        sound.put(&unsure).unwrap();
        drop(sound);
        for (job, what) in [(job(2, 4), "seeds"), (job(1, 3), "layout of a slice")] {
            let text = message(sink(&path, true, false).begin(&job).map(drop));
            assert!(text.contains(what) && text.contains("another -o"), "{text}");
        }
        sink(&path, false, true).begin(&job(2, 3)).unwrap();
    }
}
