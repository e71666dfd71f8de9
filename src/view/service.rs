//! Answers the requests of the page.

use crate::answer::Answer;
use crate::describe::describe;
use crate::error::ViewError;
use crate::frames::frame;
use crate::image::Job;
use crate::jobs::Jobs;
use crate::open::Shown;
use crate::probe::probe;
use crate::progress::progress;
use crate::request::{ImageRequest, ProbeRequest, TrialRequest, parse};
use crate::trial;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use tensor::axes::AxisKind;

/// The stores that the explorer shows, and the images that were requested last.
pub(crate) struct Service {
    pub stores: Vec<Shown>,
    jobs: Jobs,
    /// One image at a time is computed, so that memory does not grow with the number of requests.
    turn: Mutex<()>,
    /// Threads that compute images. Probes have other threads, and do not wait for images.
    images: ThreadPool,
    probes: ThreadPool,
}

impl Service {
    /// Opens stores.
    pub(crate) fn new(paths: &[PathBuf]) -> Result<Self, ViewError> {
        if paths.is_empty() {
            return Err(ViewError::NoStore);
        }
        let stores = paths.iter().map(|path| Shown::new(path)).collect::<Result<_, _>>()?;
        let pool = || ThreadPoolBuilder::new().build().map_err(|e| ViewError::Threads(e.to_string()));
        Ok(Self { stores, jobs: Jobs::default(), turn: Mutex::default(), images: pool()?, probes: pool()? })
    }

    /// Answers `GET` requests. `path` is the path of the URL after `/api/`.
    pub(crate) fn get(&self, path: &str, query: &str) -> Result<Option<Answer>, ViewError> {
        Ok(Some(match path {
            "describe" => Answer::Json(describe(&self.stores, false)?),
            "progress" => progress(self.store(number(query, "store")?)?)?,
            "frame" => {
                let index = value(query, "index").unwrap_or_default();
                let index: Option<Vec<usize>> =
                    index.split(',').filter(|w| !w.is_empty()).map(|w| w.parse().ok()).collect();
                let index =
                    index.ok_or_else(|| ViewError::Request("`index` is not a list of numbers".into()))?;
                let shown = self.store(number(query, "store")?)?;
                if !shown.is_captures {
                    return Err(ViewError::Request("the store has no frames".into()));
                }
                frame(&shown.frames()?, &index)?
            }
            _ => return Ok(None),
        }))
    }

    /// Answers `POST` requests. `path` is the path of the URL after `/api/`.
    pub(crate) fn post(&self, path: &str, body: &[u8]) -> Result<Option<Answer>, ViewError> {
        Ok(Some(match path {
            "probe" => {
                let request: ProbeRequest = parse(body)?;
                let store = self.store(request.store)?.tensor()?;
                let slice = store.slice(&request.slice)?;
                self.probes.install(|| probe(&slice, &request))?
            }
            "image" => self.image(parse(body)?, &String::from_utf8_lossy(body))?,
            // A browser reports answers with other statuses as errors of the page. Here, the user is typing.
            "trial" => match self.trial(&parse(body)?) {
                Err(e) if !e.is_of_system() => Answer::Refused(200, e.to_string()),
                answer => answer?,
            },
            _ => return Ok(None),
        }))
    }

    fn store(&self, id: usize) -> Result<&Shown, ViewError> {
        let found = self.stores.get(id);
        found.ok_or_else(|| ViewError::Request(format!("there is no store {id}")))
    }

    /// Continues the image of a request, whose text is `key`.
    fn image(&self, request: ImageRequest, key: &str) -> Result<Answer, ViewError> {
        let shown = self.store(request.probe.store)?;
        let (manifest, store) = (shown.manifest(), shown.tensor()?);
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        // If the store is finished or replaced, its image is another one.
        let key = format!("{manifest:?} {key}");
        let finished = store.is_finished();
        let job = self.jobs.get(&key, || Job::new(store.slice(&request.probe.slice)?, finished, request))?;
        let mut job = job.lock().unwrap_or_else(PoisonError::into_inner);
        let advanced = job.go_on(&self.images);
        // The image of an unfinished store is outdated at once.
        if advanced.is_err() || (job.is_done() && !finished) {
            self.jobs.forget(&key);
        }
        advanced?;
        Ok(job.answer())
    }

    fn trial(&self, request: &TrialRequest) -> Result<Answer, ViewError> {
        let store = self.store(request.store)?.tensor()?;
        let slice = store.slice(&request.slice)?;
        let wavelengths = slice.layout().find(AxisKind::Wavelength).map(|i| &slice.layout().axes[i].coords);
        let nm = match wavelengths {
            Some(all) => *all
                .get(request.wavelength)
                .ok_or_else(|| ViewError::Request(format!("the slice has {} wavelengths", all.len())))?,
            None => single_wavelength(&store.attributes()),
        };
        let (scheme, matrices) = trial::scheme(&request.scheme)?;
        let one = wavelengths.map(|_| nm);
        let image = ImageRequest::of_matrices(request.store, &request.slice, one, 16 * matrices);
        let key = format!("trial {:?} {image:?}", self.store(request.store)?.manifest());
        let finished = store.is_finished();
        let start = || Job::new(slice.clone(), finished, image);
        let turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let job = self.jobs.get(&key, start)?;
        let mut job = job.lock().unwrap_or_else(PoisonError::into_inner);
        while !job.is_done() {
            job.go_on(&self.images).inspect_err(|_| self.jobs.forget(&key))?;
        }
        drop(turn);
        if !finished {
            self.jobs.forget(&key);
        }
        self.probes.install(|| trial::trial(&job, &scheme, request, nm))
    }
}

/// Returns the wavelength of a slice without an axis of wavelengths.
fn single_wavelength(attributes: &serde_json::Map<String, serde_json::Value>) -> f64 {
    let first = |v: &serde_json::Value| v.as_array()?.first()?.as_f64();
    attributes
        .get("wavelengths_nm")
        .and_then(first)
        .unwrap_or(polarimetry::capture::mueller_image::DEFAULT_NM)
}

/// Returns the value of a key of a query, such as `store=0&index=1,2`. Values have no escapes.
fn value<'a>(query: &'a str, key: &str) -> Option<&'a str> {
    query.split('&').find_map(|part| part.strip_prefix(key)?.strip_prefix('='))
}

fn number(query: &str, key: &str) -> Result<usize, ViewError> {
    let found = value(query, key).and_then(|text| text.parse().ok());
    found.ok_or_else(|| ViewError::Request(format!("`{key}` is not a number")))
}
