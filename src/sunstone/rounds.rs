//! Renders until a target error is reached, instead of with a fixed number of samples. Each round adds
//! samples to the tiles that need more samples, until a slice reaches the target error.
//!
//! Each round is a separate store next to the result and is rendered with its own seed. A round can be
//! rendered in parts on many machines. A round depends only on the previous rounds. The result is therefore
//! independent of threads and interruptions. Finally all rounds are pooled into one store.

use crate::render::{Part, Render, RenderError, SinkError, Target, Watch};
use optics::sampling::mix::mix;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use store::merge::{MergeError, rounds};
use store::place::is_address;
use store::sink::is_finished;
use store::zarr::{CreateError, PlaceLock, RemoveError, TensorStore};
use tensor::sink::Summary;
pub use tensor::target::Goal;
use tensor::target::{ATTRIBUTE, Next, ROUND};
use transport::scene::Scene;

/// The reason why a render to a target error stopped.
#[derive(Debug, thiserror::Error)]
pub enum RoundsError {
    /// The target error or its limits are invalid.
    #[error("{0}")]
    Goal(String),
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Rounds cannot be read or pooled.
    #[error(transparent)]
    Merge(#[from] MergeError),
    /// Rounds of an earlier, unfinished render exist.
    #[error(
        "{path} contains rounds of an unfinished render: resume with --resume, or start again with --force"
    )]
    Rounds { path: PathBuf },
    /// The folder of rounds contains other files, so it is not removed.
    #[error("{path} contains a file that is not a round: {found}; move this file, or choose another name")]
    Other {
        path: PathBuf,
        /// Name of one of these other files.
        found: String,
    },
    /// A store of a round cannot be removed.
    #[error(transparent)]
    Store(#[from] RemoveError),
    #[error("cannot remove {path}: {cause}; check the permissions of the folder")]
    Remove { path: PathBuf, cause: std::io::Error },
}

impl RoundsError {
    /// Returns whether the cause is a system error rather than the request.
    pub fn is_of_system(&self) -> bool {
        match self {
            Self::Render(e) => crate::render::is_of_system(e),
            Self::Merge(e) => e.is_of_system(),
            Self::Store(e) => e.is_of_system(),
            Self::Remove { .. } => true,
            Self::Goal(_) | Self::Rounds { .. } | Self::Other { .. } => false,
        }
    }
}

/// The state of a render in rounds.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// Number of the next round, from 0. This number equals the number of finished rounds.
    pub round: u32,
    /// Smallest relative error that the required share of lit pixels does not exceed. `None` before the first
    /// round.
    pub error: Option<f64>,
    /// Total number of samples up to now, over all pixels.
    pub samples: u64,
    /// Mean number of samples per pixel up to now.
    pub mean: f64,
    /// Estimated number of samples per pixel that gives the same error if all pixels have this number of
    /// samples.
    pub uniform: f64,
    /// The next step.
    pub next: Next,
}

impl Standing {
    /// Returns the state as JSON, without the sample counts of the next round. `next` is `round`, `reached`
    /// or `exhausted`.
    pub fn to_json(&self) -> Value {
        let next = match &self.next {
            Next::Round(_) => "round",
            Next::Reached => "reached",
            Next::Exhausted => "exhausted",
        };
        json!({
            "round": self.round, "error": self.error, "samples": self.samples, "mean_samples_per_pixel": self.mean,
            "uniform_samples_per_pixel": self.uniform, "next": next,
        })
    }
}

/// A render to a target error, with its options.
pub struct ToError<'a> {
    pub goal: Goal,
    /// Watch that receives every finished tile and can stop the render.
    pub watch: &'a dyn Watch,
    /// Function that is called with the state before each round and at the end.
    pub begins: &'a dyn Fn(&Standing),
    /// Additional attributes of the store.
    pub attributes: Vec<(&'a str, Value)>,
    /// Number of threads, or 0 for all cores.
    pub threads: usize,
}

/// A part of a round, which one of several machines renders.
#[derive(Clone, Copy, Debug)]
pub struct RoundPart<'a> {
    pub part: Part,
    /// Folder of shared light paths ([`Render::shared_light`]), or `None` if light paths are not shared.
    pub light: Option<&'a Path>,
}

/// Returns the folder for the rounds of a store, next to the store.
pub fn folder_of(store: &Path) -> PathBuf {
    let mut name = store.file_name().unwrap_or_default().to_owned();
    name.push(".rounds");
    store.with_file_name(name)
}

/// Returns the seed of a round. The first round has the seed of the scene.
fn seed_of(seed: u64, round: u32) -> u64 {
    match round {
        0 => seed,
        // 53 bits, which every JSON parser preserves.
        n => mix(seed ^ mix(0x5eed_0f20_0d5e_ed00 + u64::from(n))) >> 11,
    }
}

fn round_store(folder: &Path, round: u32) -> PathBuf {
    folder.join(format!("{round}.zarr"))
}

fn round_attribute(goal: &Goal, round: u32) -> Value {
    json!({"number": round, "target": goal.to_json()})
}

impl ToError<'_> {
    /// Renders rounds until the goal is reached, and pools the rounds. Returns the summary of the work that
    /// this call did.
    ///
    /// # Errors
    /// Returns [`RoundsError`] if the render stopped. Finished rounds stay next to the target, and the render
    /// can be resumed.
    pub fn render(&self, scene: &mut Scene, target: &Target) -> Result<Summary, RoundsError> {
        self.check_goal(scene)?;
        let folder = folder_of(&target.path);
        // The lock covers all rounds, so that no other process replaces them during the render.
        let lock = PlaceLock::take(&folder);
        let _lock = lock.map_err(|e| RenderError::Sink(SinkError::Create(e)))?;
        if target.resume && is_finished(&target.path) {
            self.check_result(scene, &target.path)?;
            remove(&folder)?;
            return Ok(Summary { complete: true, ..Summary::default() });
        }
        if target.replace {
            remove(&folder)?;
        } else if TensorStore::is_taken(&target.path).map_err(|e| RenderError::Sink(e.into()))? {
            let path = target.path.clone();
            return Err(RenderError::Sink(SinkError::Create(CreateError::Exists { path })).into());
        } else if !target.resume && has_rounds(&folder) {
            return Err(RoundsError::Rounds { path: folder });
        }
        let mut done = Summary::default();
        loop {
            let standing = self.standing(scene, &folder, None)?;
            (self.begins)(&standing);
            let Next::Round(counts) = &standing.next else {
                self.finish(&folder, &standing, target)?;
                done.complete = true;
                return Ok(done);
            };
            let of_round =
                Target { path: round_store(&folder, standing.round), resume: true, replace: false };
            let summary = self.round(scene, standing.round, counts, None, &of_round)?;
            let before = done;
            done = Summary {
                discarded: before.discarded + summary.discarded,
                samples: before.samples + summary.samples,
                rays: before.rays + summary.rays,
                rays_before: before.rays_before + summary.rays_before,
                wall_s: before.wall_s + summary.wall_s,
                ..summary
            };
            if !summary.complete {
                return Ok(done);
            }
            done.complete = false;
        }
    }

    /// Returns the state of the rounds in a folder. If `round` is given, returns the state before that round.
    ///
    /// # Errors
    /// Returns [`RoundsError`] if the rounds cannot be read or belong to another render.
    pub fn standing(
        &self,
        scene: &Scene,
        folder: &Path,
        round: Option<u32>,
    ) -> Result<Standing, RoundsError> {
        self.check_goal(scene)?;
        let mut stores = vec![];
        loop {
            let (n, store) = (stores.len() as u32, round_store(folder, stores.len() as u32));
            if round.map_or_else(|| !is_finished(&store), |round| n == round) {
                break;
            }
            let expected = [
                (ROUND, round_attribute(&self.goal, n)),
                ("seeds", json!([seed_of(scene.settings.seed, n)])),
            ];
            check_same(scene, &store, &expected)?;
            stores.push(store);
        }
        let survey = rounds::survey(&stores, &self.goal.slice)?;
        let (error, next) = if stores.is_empty() {
            let tiles = scene.camera.resolution.map(|n| n.div_ceil(scene.settings.tile));
            let counts = vec![self.goal.first; (tiles[0] * tiles[1]) as usize];
            (None, Next::Round(counts))
        } else {
            (Some(survey.reached(self.goal.share)), survey.next(&self.goal))
        };
        Ok(Standing {
            round: stores.len() as u32,
            error,
            samples: survey.samples(),
            mean: survey.mean_samples(),
            uniform: survey.uniform(self.goal.share),
            next,
        })
    }

    /// Renders a part of a round. The previous rounds in the folder determine the round.
    ///
    /// # Errors
    /// Returns [`RoundsError`] if the round does not exist or the render stopped.
    pub fn part_of_round(
        &self,
        scene: &mut Scene,
        folder: &Path,
        round: u32,
        part: RoundPart,
        target: &Target,
    ) -> Result<Summary, RoundsError> {
        let standing = self.standing(scene, folder, Some(round))?;
        match &standing.next {
            Next::Round(counts) => self.round(scene, round, counts, Some(part), target),
            _ => Err(RoundsError::Goal(format!(
                "round {round} is not needed, because the render ends after {} rounds; skip this round",
                standing.round
            ))),
        }
    }

    fn round(
        &self,
        scene: &mut Scene,
        round: u32,
        counts: &[u32],
        part: Option<RoundPart>,
        target: &Target,
    ) -> Result<Summary, RoundsError> {
        let settings = scene.settings;
        let spp = counts.iter().copied().max().unwrap_or(0);
        scene.change_settings(|s| (s.seed, s.spp) = (seed_of(settings.seed, round), spp));
        let attribute = round_attribute(&self.goal, round);
        let mut render = Render::new(scene)
            .watch(self.watch)
            .samples(counts)
            .attribute(ROUND, attribute)
            .threads(self.threads);
        for (name, value) in &self.attributes {
            render = render.attribute(name, value.clone());
        }
        if let Some(part) = part {
            render = render.part(part.part);
            if let Some(folder) = part.light {
                render = render.shared_light(folder);
            }
        }
        let summary = render.to_target(target);
        scene.change_settings(|s| *s = settings);
        Ok(summary?)
    }

    /// Pools the rounds into the target store, and removes the rounds.
    fn finish(&self, folder: &Path, standing: &Standing, target: &Target) -> Result<(), RoundsError> {
        let stores: Vec<PathBuf> = (0..standing.round).map(|n| round_store(folder, n)).collect();
        let mut message = standing.to_json();
        if let (Some(message), Value::Object(goal)) = (message.as_object_mut(), self.goal.to_json()) {
            let reached = message.remove("error").unwrap_or_default();
            let rounds = message.remove("round").unwrap_or_default();
            message.remove("next");
            message.insert("reached".into(), reached);
            message.insert("rounds".into(), rounds);
            message.extend(goal);
        }
        let extra = Map::from_iter([(ATTRIBUTE.to_owned(), message)]);
        rounds::pool(&stores, &target.path, &extra, target.replace)?;
        remove(folder)
    }

    fn check_goal(&self, scene: &Scene) -> Result<(), RoundsError> {
        if let Some(fault) = self.goal.fault("--") {
            return Err(RoundsError::Goal(fault));
        }
        let names: Vec<&str> = scene.slices.iter().map(|s| s.name.as_str()).collect();
        if !names.contains(&self.goal.slice.as_str()) {
            return Err(RoundsError::Goal(format!(
                "--target-slice: unknown slice `{}`; available: {}",
                self.goal.slice,
                names.join(", ")
            )));
        }
        Ok(())
    }

    /// Refuses a finished store of another render.
    fn check_result(&self, scene: &Scene, path: &Path) -> Result<(), RoundsError> {
        let target = TensorStore::open(path).ok().and_then(|store| store.attributes().remove(ATTRIBUTE));
        let ours = self.goal.to_json();
        // The attribute contains the goal and the result.
        let same = |theirs: &Value| {
            ours.as_object().is_some_and(|g| g.iter().all(|(k, v)| theirs.get(k) == Some(v)))
        };
        if !target.as_ref().is_some_and(same) {
            return Err(mismatch(path, ATTRIBUTE, target.as_ref(), Some(&ours)));
        }
        check_same(scene, path, &[("seeds", json!([scene.settings.seed]))])
    }
}

fn mismatch(path: &Path, what: &'static str, theirs: Option<&Value>, ours: Option<&Value>) -> RoundsError {
    let show = |v: Option<&Value>| v.map_or("nothing".into(), Value::to_string);
    RenderError::Sink(SinkError::Mismatch {
        path: path.to_owned(),
        what,
        theirs: show(theirs),
        ours: show(ours),
    })
    .into()
}

/// Refuses a store whose scene or choices differ, or whose attributes differ from `expected`.
fn check_same(scene: &Scene, path: &Path, expected: &[(&'static str, Value)]) -> Result<(), RoundsError> {
    let store = TensorStore::open(path).map_err(|e| RenderError::Sink(SinkError::Open(e)))?;
    let theirs = store.attributes();
    let of_scene = [
        ("scene_sha256", Some(json!(scene.sha256))),
        ("variant", scene.variant.as_ref().map(|v| json!(v))),
        ("integrator", Some(json!(scene.settings.integrator.name()))),
        ("max_depth", Some(json!(scene.settings.max_depth))),
        ("tile", Some(json!(scene.settings.tile))),
        ("version", Some(json!(env!("CARGO_PKG_VERSION")))),
    ];
    let expected = expected.iter().map(|(key, value)| (*key, Some(value.clone())));
    for (key, ours) in expected.chain(of_scene) {
        if theirs.get(key) != ours.as_ref() {
            return Err(mismatch(path, key, theirs.get(key), ours.as_ref()));
        }
    }
    let names: Vec<&str> = scene.slices.iter().map(|s| s.name.as_str()).collect();
    if store.slice_names() != names {
        let [theirs, ours] = [json!(store.slice_names()), json!(names)];
        return Err(mismatch(path, "list of slices", Some(&theirs), Some(&ours)));
    }
    Ok(())
}

/// Returns whether a file name is the name of a round's store, or of a temporary file next to such a store.
fn is_of_rounds(name: &str) -> bool {
    let name = name.trim_start_matches('.');
    let rest = name.trim_start_matches(|c: char| c.is_ascii_digit());
    rest.len() < name.len() && rest.starts_with(".zarr")
}

/// Returns whether a store exists at a path.
fn is_there(path: &Path) -> bool {
    if is_address(path) { TensorStore::open(path).is_ok() } else { path.exists() }
}

fn has_rounds(folder: &Path) -> bool {
    if is_address(folder) { is_there(&round_store(folder, 0)) } else { folder.exists() }
}

/// Removes the folder of rounds if it exists. The folder must not contain other files.
fn remove(folder: &Path) -> Result<(), RoundsError> {
    if is_address(folder) {
        // Remove the last round first. After an interrupted removal, the first rounds are left, and the next
        // call finds these rounds.
        let mut count = 0;
        while is_there(&round_store(folder, count)) {
            count += 1;
        }
        for n in (0..=count).rev() {
            store::zarr::remove(&round_store(folder, n))?;
        }
        return Ok(());
    }
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if !is_of_rounds(&name) {
            return Err(RoundsError::Other { path: folder.to_owned(), found: name });
        }
    }
    match std::fs::remove_dir_all(folder) {
        Err(cause) if cause.kind() != std::io::ErrorKind::NotFound => {
            Err(RoundsError::Remove { path: folder.to_owned(), cause })
        }
        _ => Ok(()),
    }
}
