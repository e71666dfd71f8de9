//! Renders scenes into arrays or a store.

use crate::error::{bail, failed, input};
use crate::scene::Scene;
use crate::watch::watched;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde_json::{Map, Value, json};
use std::convert::Infallible;
use std::path::PathBuf;
use sunstone::cautions::{black, black_store, outside_bins};
use sunstone::render::{Choices, is_of_system, most_threads};
use sunstone::store::zarr::TensorStore;
use sunstone::transport::render::schedule;
use sunstone::transport::scene::Settings;
use sunstone::{Arrays, Field, Job, Piece, Render, SampleCounts, Sink, Summary, Target, TileRecord};

/// The scene settings that a render changes. The settings are restored when the render ends.
struct Changed<'a> {
    scene: &'a mut sunstone::Scene,
    settings: Settings,
    slices: Vec<sunstone::tensor::slice::Slice>,
}

impl<'a> Changed<'a> {
    fn new(scene: &'a mut sunstone::Scene, choices: &Choices) -> PyResult<Self> {
        let changed = Self { settings: scene.settings, slices: scene.slices.clone(), scene };
        choices.apply(changed.scene, "").map_err(input)?;
        Ok(changed)
    }
}

impl Drop for Changed<'_> {
    fn drop(&mut self) {
        self.scene.change_settings(|s| *s = self.settings);
        self.scene.change_slices(|s| *s = std::mem::take(&mut self.slices));
    }
}

/// Settings of a render.
#[derive(FromPyObject)]
pub struct Asked {
    spp: Option<u32>,
    replicates: Option<u32>,
    seed: Option<u64>,
    threads: Option<usize>,
    slices: Option<Vec<String>>,
}

impl Asked {
    /// Returns the number of threads. 0 means one thread per core.
    fn threads(&self) -> PyResult<usize> {
        let most = most_threads();
        match self.threads {
            Some(n) if n == 0 || n > most => bail!("threads: expected 1 to {most}, got {n}"),
            given => Ok(given.unwrap_or(0)),
        }
    }

    fn choices(&self) -> Choices {
        Choices { spp: self.spp, replicates: self.replicates, seed: self.seed, slices: self.slices.clone() }
    }
}

/// Rendered arrays and their attributes, for the conversion to Python.
#[derive(Default)]
struct Kept {
    arrays: Arrays,
    attributes: Map<String, Value>,
    of_slices: Vec<Map<String, Value>>,
}

impl Sink for Kept {
    type Error = Infallible;

    fn begin(&mut self, job: &Job) -> Result<Vec<TileRecord>, Infallible> {
        self.attributes.clone_from(&job.attributes);
        let of = |s: &sunstone::tensor::sink::JobSlice| {
            let mut all = s.attributes.clone();
            if let Some((start, bin)) = s.layout.time {
                all.insert("time_start_ps".into(), json!(start));
                all.insert("time_bin_ps".into(), json!(bin));
            }
            all
        };
        self.of_slices = job.slices.iter().map(of).collect();
        self.arrays.begin(job)
    }

    fn put(&self, piece: &Piece) -> Result<(), Infallible> {
        self.arrays.put(piece)
    }

    fn put_samples(&self, samples: &SampleCounts) -> Result<(), Infallible> {
        self.arrays.put_samples(samples)
    }

    fn tile_done(&self, record: &TileRecord) -> Result<(), Infallible> {
        self.arrays.tile_done(record)
    }

    fn end(&mut self, summary: &Summary) -> Result<(), Infallible> {
        self.arrays.end(summary)
    }
}

/// Returns the summary of a render as JSON for Python.
fn describe(summary: &Summary, cautions: &[String]) -> String {
    json!({
        "cautions": cautions,
        "complete": summary.complete,
        "tiles_done": summary.tiles_done,
        "tiles": summary.tiles,
        "samples": summary.samples,
        "discarded_samples": summary.discarded,
        "rays": summary.rays,
        "wall_time_s": summary.wall_s,
    })
    .to_string()
}

/// Renders a scene with the requested settings. Reports progress and reacts to signals.
fn run<T: Send>(
    py: Python<'_>,
    scene: &Scene,
    asked: &Asked,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(Render) -> PyResult<T> + Send,
) -> PyResult<T> {
    let (threads, choices) = (asked.threads()?, asked.choices());
    watched(py, progress, |watch| {
        let mut scene_now = scene.lock();
        let changed = Changed::new(&mut scene_now, &choices)?;
        let kept = |name: &str| changed.scene.slices.iter().any(|s| s.name == name);
        let figures: Vec<_> = scene.figures.iter().filter(|f| kept(f.view.slice())).collect();
        let render =
            Render::new(changed.scene).watch(watch).attribute("figures", json!(figures)).threads(threads);
        work(render)
    })?
}

/// Render into a store; return the summary as JSON.
#[pyfunction]
pub fn render_store(
    py: Python<'_>,
    scene: &Scene,
    asked: Asked,
    output: PathBuf,
    resume: bool,
    force: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let target = Target { path: output, replace: force, resume };
    let (summary, cautions) = run(py, scene, &asked, progress, |render| {
        let now = render.scene();
        let mut notes = outside_bins(now);
        let summary =
            render.to_target(&target).map_err(|e| if is_of_system(&e) { failed(e) } else { input(e) })?;
        if summary.complete {
            let store = TensorStore::open(&target.path).map_err(failed)?;
            notes.extend(black_store(now, &store).map_err(failed)?);
        }
        Ok((summary, notes))
    })?;
    Ok(describe(&summary, &cautions))
}

/// Render into arrays. Return the name, attributes and fields of each slice, the sample counts, the
/// attributes of the render, and the summary.
#[pyfunction]
pub fn render_arrays<'py>(
    py: Python<'py>,
    scene: &Scene,
    asked: Asked,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let (summary, mut kept, cautions) = run(py, scene, &asked, progress, |render| {
        let mut kept = Kept::default();
        let now = render.scene();
        let mut notes = outside_bins(now);
        let summary = render.into_sink(&mut kept).map_err(|e| match e {
            schedule::RenderError::NoSlices | schedule::RenderError::Part(_) => input(e),
            schedule::RenderError::Threads(_) | schedule::RenderError::Sink(_) => failed(e),
        })?;
        let has_light = |name: &String| {
            let mut fields = [Field::Mean, Field::Overflow].iter().filter_map(|f| kept.arrays.get(name, *f));
            fields.any(|t| t.data.iter().any(|v| *v != 0.0))
        };
        if summary.complete && !kept.arrays.names().iter().any(has_light) {
            notes.push(black(now));
        }
        Ok((summary, kept, notes))
    })?;
    let slices = PyList::empty(py);
    for (name, attributes) in kept.arrays.names().to_vec().iter().zip(&kept.of_slices) {
        let fields = PyDict::new(py);
        for field in Field::ALL {
            let Some(tensor) = kept.arrays.take(name, field) else {
                continue;
            };
            let axes = PyList::empty(py);
            for axis in &tensor.axes {
                let kind = axis.kind;
                let coords = PyArray1::from_slice(py, &axis.coords);
                axes.append((kind.name(), kind.units(), kind.long_name(), coords))?;
            }
            let shape = tensor.shape();
            let values = PyArray1::from_vec(py, tensor.data).reshape(shape)?;
            fields.set_item(field.name(), (axes, values, field.long_name()))?;
        }
        slices.append((name, Value::Object(attributes.clone()).to_string(), fields))?;
    }
    let all = PyDict::new(py);
    all.set_item("slices", slices)?;
    all.set_item("samples", PyArray1::from_vec(py, kept.arrays.samples()))?;
    all.set_item("attributes", Value::Object(kept.attributes).to_string())?;
    all.set_item("summary", describe(&summary, &cautions))?;
    Ok(all)
}
