//! Zarr stores as the sink of renders: made or resumed, journaled tile by tile, and called complete at the end.

use crate::zarr::{AccessError, CreateError, OpenError, SampleGrid, StoredSlice, TensorStore};
use base::journal::{self, Journal};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use tensor::sink::{Job, Piece, SampleCounts, Sink, Summary, TileRecord};

/// Where to and how to write.
#[derive(Clone, Debug, Default)]
pub struct Target {
    /// The store to make.
    pub path: PathBuf,
    /// Go on with an unfinished render at `path`.
    pub resume: bool,
    /// Replace a store at `path`.
    pub replace: bool,
}

/// Why a store did not take a render.
#[derive(Debug, thiserror::Error)]
pub enum SinkError {
    /// The store cannot be made.
    #[error(transparent)]
    Create(#[from] CreateError),
    /// The store cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A chunk cannot be written.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The journal cannot be written.
    #[error(
        "cannot write the progress journal in {path}: {cause}; make room or check permissions, then run again with --resume"
    )]
    Journal {
        /// The store.
        path: PathBuf,
        /// Why not.
        cause: std::io::Error,
    },
    /// What is to be resumed is another render.
    #[error(
        "cannot resume {path}: its {what} differs ({theirs}, now {ours}); use the same scene file and options, or another -o"
    )]
    Mismatch {
        /// The store.
        path: PathBuf,
        /// Name of the attribute that differs.
        what: &'static str,
        /// What the store has.
        theirs: String,
        /// What the render has.
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
    /// None where all was complete already.
    journal: Option<Journal<TileRecord>>,
}

impl ZarrSink {
    /// A sink at a place that is not touched before the render begins.
    #[must_use]
    pub fn new(target: Target) -> Self {
        Self { target, open: None }
    }

    /// The store, once a render has begun.
    #[must_use]
    pub fn store(&self) -> Option<&TensorStore> {
        self.open.as_ref().map(|o| &o.store)
    }

    fn opened(&self) -> Result<&Open, SinkError> {
        self.open.as_ref().ok_or_else(|| {
            SinkError::Open(OpenError::Missing {
                path: self.target.path.clone(),
            })
        })
    }

    fn journal_error(&self) -> impl Fn(std::io::Error) -> SinkError + use<> {
        let path = self.target.path.clone();
        move |cause| SinkError::Journal {
            path: path.clone(),
            cause,
        }
    }

    /// Makes the store, or opens the one to resume after checking that it is the same render.
    fn make(&self, job: &Job) -> Result<TensorStore, SinkError> {
        let Target {
            path,
            resume,
            replace,
        } = &self.target;
        if *resume && path.exists() {
            let store = TensorStore::open_for_write(path)?;
            check_same(&store, job)?;
            return Ok(store);
        }
        let slices: Vec<_> = job
            .slices
            .iter()
            .map(|s| (s.layout.clone(), s.attributes.clone()))
            .collect();
        let grid = SampleGrid {
            camera: job.camera,
            tile: job.tile,
        };
        let mut attributes = job.attributes.clone();
        attributes.insert("status".into(), json!("incomplete"));
        Ok(TensorStore::create(
            path,
            &slices,
            &attributes,
            Some(grid),
            *replace,
        )?)
    }
}

/// Refuses a store of another render.
fn check_same(store: &TensorStore, job: &Job) -> Result<(), SinkError> {
    let theirs = store.attributes();
    let mismatch = |what, theirs, ours| {
        Err(SinkError::Mismatch {
            path: store.path().to_owned(),
            what,
            theirs,
            ours,
        })
    };
    for what in [
        "scene_sha256",
        "seeds",
        "samples_per_pixel",
        "max_depth",
        "tile",
        "version",
    ] {
        let (a, b) = (theirs.get(what), job.attributes.get(what));
        if a != b {
            let show = |v: Option<&Value>| v.map_or("nothing".into(), Value::to_string);
            return mismatch(what, show(a), show(b));
        }
    }
    // Tiles that the journal calls finished are so for these slices alone.
    let ours: Vec<&str> = job.slices.iter().map(|s| s.layout.name.as_str()).collect();
    if store.slice_names() != ours {
        return mismatch("list of slices", store.slice_names().join(", "), ours.join(", "));
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
        let (journal, done) =
            if self.target.resume && status == Some(json!("complete")) && !journal::exists(store.path()) {
                let all = (0..job.tiles()).map(|tile| TileRecord {
                    tile,
                    samples: 0,
                    discarded: 0,
                    rays: 0,
                    seconds: 0.0,
                });
                (None, all.collect())
            } else {
                let (journal, done) = Journal::open(store.path()).map_err(self.journal_error())?;
                (Some(journal), done)
            };
        self.open = Some(Open {
            store,
            slices,
            journal,
        });
        Ok(done)
    }

    fn put(&self, p: &Piece) -> Result<(), SinkError> {
        let slice = &self.opened()?.slices[p.slice];
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
            return Ok(());
        };
        let mut attributes = open.store.attributes();
        let earlier = attributes
            .get("wall_time_s")
            .and_then(Value::as_f64)
            .unwrap_or(0.0);
        attributes.insert("wall_time_s".into(), json!(earlier + summary.wall_s));
        attributes.insert("discarded_samples".into(), json!(summary.discarded));
        attributes.insert("rays".into(), json!(summary.rays_before + summary.rays));
        let status = if summary.complete {
            "complete"
        } else {
            "incomplete"
        };
        attributes.insert("status".into(), json!(status));
        open.store.set_attributes(attributes)?;
        if summary.complete {
            open.store.finish()?;
            journal.remove().map_err(failed)?;
        }
        Ok(())
    }
}

/// True if `path` holds an unfinished render.
#[must_use]
pub fn is_unfinished(path: &Path) -> bool {
    journal::exists(path)
}
