//! The `sunstone render` command, which renders a scene file into a store.

mod arguments;
mod progress;
mod to_error;

pub use arguments::Arguments;

use crate::progress::{INTERRUPTED, stop_on_interrupt};
use crate::view::ViewOfRender;
use crate::{Failure, bail, figure, places, print};
use arguments::{again, named};
use progress::Progress;
use serde_json::json;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use sunstone::cautions;
use sunstone::figure::listed;
use sunstone::render::{Choices, Render, Target, cores, is_of_system, most_threads};
use sunstone::store::doubt;
use sunstone::store::place::is_address;
use sunstone::store::sink::{is_finished, is_finished_part};
use sunstone::store::zarr::TensorStore;
use sunstone::transport::render::coverage::missing;
use sunstone::transport::scene::Scene;

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let begun = Instant::now();
    let text = sunstone::scene::read(&a.scene)?;
    let mut scene = sunstone::scene::variant_from_text(&a.scene, &text, a.variant)?;
    let mut figures = listed::from_text(&a.scene, &text, &scene.slices, scene.wavelengths.nm())?;
    if let Some(integrator) = a.integrator {
        scene.set_integrator(integrator);
    }
    let goal = a.target.goal(a.spp, &scene);
    let choices = Choices {
        spp: a.spp.filter(|_| goal.is_none()),
        replicates: a.replicates,
        seed: a.seed,
        slices: (!a.slices.is_empty()).then(|| a.slices.clone()),
    };
    choices.apply(&mut scene, "--").map_err(Failure::input)?;
    figures.retain(|f| scene.slices.iter().any(|s| s.name == f.view.slice()));
    let (triangles, quadrics) = scene.geometry.counts();
    tracing::info!(
        "scene {}: {triangles} triangles, {quadrics} quadrics, read in {:.2?}",
        scene.name,
        begun.elapsed()
    );
    check_threads(a.threads)?;
    if let Some(light) = a.light.as_ref().filter(|light| is_address(light)) {
        bail!(
            "--light: the address {} is not a local folder, but light paths are stored in a local folder; set a folder that all parts \
             share, or remove --light",
            light.display()
        );
    }
    let variant = a.variant.map_or(String::new(), |k| format!("_variant{k}"));
    let part = a.part.or(a.tiles);
    let of_part = part.map_or(String::new(), |part| format!("_{}", named(part)[1]));
    let default = PathBuf::from("out").join(format!("{}{variant}{of_part}.zarr", scene.name));
    let path = a.output.clone().unwrap_or(default);
    places::store([&a.scene], &path)?;
    let target = Target {
        replace: a.force,
        // A complete store at the default path is kept if it is the same render.
        resume: a.resume
            || (a.output.is_none() && !a.force && (is_finished(&path) || is_finished_part(&path))),
        path,
    };
    stop_on_interrupt("running tiles");
    for note in &scene.notes {
        eprintln!("note: {note}");
    }
    for note in cautions::outside_bins(&scene) {
        eprintln!("note: {note}");
    }
    if a.view && is_address(&target.path) {
        bail!("--view: shows stores in local folders only; remove --view, or render into a folder with -o");
    }
    if a.view && goal.is_some() {
        bail!(
            "--view: a render with --target-error has no store before it is finished; remove --view, and open the finished store with \
             `sunstone view`"
        );
    }
    let view = a.view.then(|| ViewOfRender::new(&target.path));
    let progress = Progress::new(missing(&scene), view);
    if let Some(goal) = goal {
        return to_error::run(a, &mut scene, goal, json!(figures), &target, &progress);
    }
    let mut render = Render::new(&scene)
        .watch(&progress)
        .attribute("figures", json!(&figures))
        .threads(a.threads.unwrap_or(0));
    if let Some(part) = part {
        render = render.part(part);
    }
    if let Some(folder) = &a.light {
        render = render.shared_light(folder);
    }
    let summary = render.to_target(&target).map_err(|e| Failure::of_system(is_of_system(&e), e))?;
    progress.clear();
    let store = target.path.display();
    if !summary.complete {
        return Err(Failure::Interrupted(format!(
            "stopped after {} of {} tiles; to resume:\n  {}",
            summary.tiles_done,
            summary.tiles,
            again(a, &target)
        )));
    }
    if summary.samples == 0 && summary.tiles > 0 {
        print(&format!("{store}: already complete"))?;
    } else {
        print(&format!(
            "{store}: {}{} slices, {} spp, {:.1} s, {:.2} Msamples/s, {:.1} Mrays/s, {} samples discarded{}",
            part.map_or(String::new(), |part| format!(
                "{part}, {} tiles, {} samples, ",
                summary.tiles, summary.samples
            )),
            scene.slices.len(),
            scene.settings.spp,
            summary.wall_s,
            summary.samples as f64 / summary.wall_s / 1e6,
            summary.rays as f64 / summary.wall_s / 1e6,
            summary.discarded,
            if part.is_none() { in_doubt(&target.path)? } else { String::new() },
        ))?;
    }
    if part.is_none()
        && let Some(note) = black(&scene, &target.path)?
    {
        eprintln!("note: {note}");
    }
    if !a.no_figures && part.is_none() {
        figure::draw_all(&target.path, None)?;
        if !figures.is_empty() && std::io::stderr().is_terminal() {
            let denoised = target.path.with_extension("denoised.zarr");
            eprintln!(
                "figures with less noise: sunstone denoise {store} -o {0} && sunstone figure {0}",
                denoised.display()
            );
        }
    }
    if progress.view.as_ref().is_some_and(ViewOfRender::open) {
        eprintln!("the view stays open; press Ctrl-C to stop");
        while !INTERRUPTED.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(100));
        }
    }
    Ok(())
}

/// Returns a note if all slices of a store are black.
fn black(scene: &Scene, path: &Path) -> Result<Option<String>, Failure> {
    let store = TensorStore::open(path).map_err(Failure::failed)?;
    cautions::black_store(scene, &store).map_err(Failure::failed)
}

/// Refuses more threads than [`most_threads`].
fn check_threads(threads: Option<usize>) -> Result<(), Failure> {
    let (cores, most) = (cores(), most_threads());
    match threads {
        Some(0) => bail!("--threads: expected at least 1 thread, got 0"),
        Some(n) if n > most => bail!(
            "--threads: got {n} threads, but this machine has {cores} cores and the limit is {} threads per core, {most} in total; \
             pass a smaller number",
            most / cores
        ),
        _ => Ok(()),
    }
}

/// Returns a note about the slice with the largest share of lit pixels whose error estimates are
/// unreliable. The note is empty if the share is at most 0.1 %.
fn in_doubt(path: &Path) -> Result<String, Failure> {
    let store = TensorStore::open(path).map_err(Failure::failed)?;
    let mut most = (0.001, String::new());
    for name in store.slice_names() {
        let slice = store.slice(name).map_err(Failure::failed)?;
        if let Some(doubt) = doubt::of(&slice).map_err(Failure::failed)?
            && doubt.share() > most.0
        {
            let percent = 100.0 * doubt.share();
            let message = format!(
                ", {percent:.1} % unreliable error estimates (too few samples) in slice {name} (see sunstone info)"
            );
            most = (doubt.share(), message);
        }
    }
    Ok(most.1)
}
