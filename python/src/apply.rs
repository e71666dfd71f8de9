//! Runs applications from Python.

use crate::error::{bail, failed, input, located};
use crate::watch::watched;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde_json::json;
use std::path::{Path, PathBuf};
use sunstone::applications::links::Links;
use sunstone::applications::{self, ApplicationError, Report, Settings, report};
use sunstone::apply::application::Application;
use sunstone::apply::catalog;
use sunstone::apply::chain::file;
use sunstone::render::is_of_system;
use sunstone::studio::StudioError;

/// Return the descriptions of all applications as JSON: a list in the paper's order.
#[pyfunction]
pub fn applications_json() -> String {
    let of = |a: Application| {
        let plan = &a.plan;
        let methods = a.methods.iter().map(|m| json!({"name": m.name, "source": m.source}));
        let metrics = a
            .metrics
            .iter()
            .map(|m| json!({"name": m.name, "unit": m.unit, "more_is_better": m.more_is_better}));
        json!({
            "name": a.name, "shows": a.shows, "scene": plan.scene, "train": plan.train, "test": plan.test,
            "methods": methods.collect::<Vec<_>>(), "metrics": metrics.collect::<Vec<_>>(),
            "preview": {"pixels": plan.preview.pixels, "spp": plan.preview.spp},
            "full": {"pixels": plan.full.pixels, "spp": plan.full.spp},
        })
    };
    serde_json::Value::from(catalog::all().into_iter().map(of).collect::<Vec<_>>()).to_string()
}

/// Arguments of a run of an application.
#[derive(FromPyObject)]
pub struct Asked {
    name: String,
    scenes: Option<PathBuf>,
    renders: PathBuf,
    preview: bool,
    seeds: u64,
    chain: Option<PathBuf>,
    output: Option<PathBuf>,
}

fn failure(e: ApplicationError) -> PyErr {
    match e {
        ApplicationError::Studio(StudioError::Scene(e)) => located(e),
        ApplicationError::Studio(StudioError::Render(ref cause)) if is_of_system(cause) => failed(e),
        ApplicationError::Access(ref cause) if cause.is_of_system() => failed(e),
        e => input(e),
    }
}

/// Run an application. Return its report as JSON, and the images of the first seed.
#[pyfunction]
pub fn run_application<'py>(
    py: Python<'py>,
    asked: Asked,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(String, Bound<'py, PyList>)> {
    let application = catalog::find(&asked.name).ok_or_else(|| {
        let known: Vec<&str> = catalog::all().iter().map(|a| a.name).collect();
        input(format!("name: unknown application `{}`; available: {}", asked.name, known.join(", ")))
    })?;
    let plan = &application.plan;
    if asked.chain.is_some() && plan.slices.is_empty() {
        bail!(
            "capture: the application `{}` captures its own input; remove the argument `capture`",
            asked.name
        );
    }
    let scenes = match asked.scenes {
        Some(folder) => folder,
        None => std::env::current_dir()
            .ok()
            .and_then(|here| applications::find_scenes(&here, plan.scene))
            .ok_or_else(|| {
                input(format!(
                    "scenes: scenes/{} not found in the current folder or its parents; pass the folder of the scenes shipped with Sunstone",
                    plan.scene
                ))
            })?,
    };
    let links = match &asked.chain {
        None => Links::None,
        Some(path) => Links::Chain(file::load(path).map_err(located)?),
    };
    let settings =
        Settings { scenes, renders: asked.renders, preview: asked.preview, seeds: asked.seeds, links };
    let output = asked.output.as_deref();
    let report = watched(py, progress, |watch| run(&application, &settings, output, watch))??;
    let text = report::document(&application, &report).to_string();
    let pictures = PyList::empty(py);
    for picture in report.first.pictures {
        let map = picture.map;
        let shape = [map.height, map.width, map.channels];
        let about = PyDict::new(py);
        about.set_item("method", picture.method)?;
        about.set_item("name", picture.name)?;
        about.set_item("variant", picture.variant)?;
        about.set_item("values", PyArray1::from_vec(py, map.data).reshape(shape)?)?;
        pictures.append(about)?;
    }
    Ok((text, pictures))
}

fn run(
    application: &Application,
    settings: &Settings,
    output: Option<&Path>,
    watch: &dyn sunstone::Watch,
) -> PyResult<Report> {
    std::fs::create_dir_all(&settings.renders)
        .map_err(|e| failed(format!("cannot create {}: {e}", settings.renders.display())))?;
    let report = applications::run(application, settings, watch).map_err(failure)?;
    if let Some(folder) = output {
        report::write(application, &report, settings, folder).map_err(failed)?;
    }
    Ok(report)
}
