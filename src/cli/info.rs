//! The `sunstone info` command, which describes a store, or a scene before the scene is rendered.

use crate::{Failure, print};
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use sunstone::optics::spectrum::Spectral;
use sunstone::scene::syntax::scene::SceneFile;
use sunstone::scene::syntax::{Syntax, variant};
use sunstone::store::denoised::ATTRIBUTE;
use sunstone::store::doubt;
use sunstone::store::zarr::{DATA_SET, StoredSlice, TensorStore};
use sunstone::tensor::axes::AxisKind;
use sunstone::tensor::field::Field;
use sunstone::tensor::part;
use sunstone::tensor::target;
use sunstone::transport::device::pinhole::Pinhole;
use sunstone::transport::light::distant::Across;
use sunstone::transport::light::profile::Profile;
use sunstone::transport::render::coverage::missing;
use sunstone::transport::render::strategies::strategies;
use sunstone::transport::scene::Scene;

/// Print the contents of a store (provenance, slices with their axes, light, errors, and overflow), or the
/// contents of a scene file and the light that its integrator would not find.
#[derive(clap::Args)]
pub struct Arguments {
    /// Store written by `render` or `merge`, or a scene file.
    store: PathBuf,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    if a.store.is_file() {
        let text = sunstone::scene::read(&a.store)?;
        let built = sunstone::scene::from_text(&a.store, &text)?;
        let described = scene(&built) + &variants(&a.store, &text)?;
        return print(described.trim_end());
    }
    if a.store.join(DATA_SET).is_file() {
        return print(data_set(&a.store)?.trim_end());
    }
    let store = TensorStore::open(&a.store).map_err(Failure::input)?;
    let attributes = store.attributes();
    let mut text = String::new();
    let mut line = |s: String| {
        text.push_str(&s);
        text.push('\n');
    };
    line(a.store.display().to_string());
    for key in [
        "title",
        "status",
        "variant",
        ATTRIBUTE,
        "scene_sha256",
        "seeds",
        "samples_per_pixel",
        "discarded_samples",
        "max_depth",
        "wavelengths_nm",
        "version",
        "wall_time_s",
    ] {
        if let Some(v) = attributes.get(key) {
            let shown = v.as_str().map_or_else(|| v.to_string(), str::to_owned);
            line(format!("  {key:18} {shown}"));
        }
    }
    if let Some(message) = attributes.get(target::ATTRIBUTE).and_then(reached) {
        line(format!("  {:18} {message}", target::ATTRIBUTE));
    }
    if let Some(part) = store.part() {
        line(format!("  {:18} {part} of a render; combine all parts with `sunstone merge`", part::ATTRIBUTE));
    }
    if store.is_sharded().map_err(Failure::input)? {
        line(format!("  {:18} sharded", "files"));
    }
    for name in store.slice_names() {
        let slice = store.slice(name).map_err(Failure::input)?;
        // A part lacks the light of the other parts, so its totals are not printed.
        line(if store.part().is_some() { axes(&slice) } else { describe(&slice)? });
    }
    print(text.trim_end())
}

/// Describes a data set: its settings, and the parameters of its samples.
fn data_set(path: &Path) -> Result<String, Failure> {
    let file = path.join(DATA_SET);
    let fault = |e: &dyn std::fmt::Display| Failure::input(format!("{}: {e}", file.display()));
    let text = sunstone::base::input::read_text(&file).map_err(|e| fault(&e))?;
    let manifest: Value = serde_json::from_str(&text).map_err(|e| fault(&e))?;
    let samples = manifest["samples"].as_array().map_or(&[][..], Vec::as_slice);
    let state = if manifest["finished"] == true { "finished" } else { "unfinished" };
    let mut out =
        format!("{}\n  {:18} data set, {state}, {} samples\n", path.display(), "kind", samples.len());
    for (key, value) in manifest["settings"].as_object().into_iter().flatten().filter(|(_, v)| !v.is_null()) {
        let shown = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let _ = writeln!(out, "  {key:18} {shown}");
    }
    for (name, first) in samples.first().and_then(|s| s["values"].as_object()).into_iter().flatten() {
        let key = &manifest["places"][name];
        let key = key.as_str().map_or(String::new(), |key| format!(" ({key})"));
        let _ = writeln!(out, "  {:18} {first} in the first sample{key}", format!("parameter {name}"));
    }
    Ok(out)
}

/// Formats the target error of a render and the error that was reached. Returns `None` for a render without a
/// target.
fn reached(target: &Value) -> Option<String> {
    let number = |key: &str| target.get(key)?.as_f64();
    let (mean, uniform) = (number("mean_samples_per_pixel")?, number("uniform_samples_per_pixel")?);
    Some(format!(
        "{:.0} % of the lit pixels of slice {} have a relative error of at most {:.2} % (target {:.2} %); {} rounds, {mean:.0} \
         samples per pixel on average; this is {:.0} % of the estimated {uniform:.0} samples per pixel that uniform \
         sampling would need",
        100.0 * number("share")?,
        target.get("slice")?.as_str()?,
        100.0 * number("reached")?,
        100.0 * number("error")?,
        target.get("rounds")?,
        100.0 * mean / uniform.max(1e-9),
    ))
}

/// Describes the contents of a scene file, as lines of a key and a value.
pub fn scene(scene: &Scene) -> String {
    let mut out = format!("{}\n", scene.name);
    let mut line = |key: &str, value: String| {
        let _ = writeln!(out, "  {key:18} {value}");
    };
    let device = |p: &Pinhole| {
        let [w, h] = p.resolution;
        let lens = if p.lens.radius > 0.0 {
            format!(", lens of radius {} m focused at {} m", p.lens.radius, p.lens.focus)
        } else {
            String::new()
        };
        let parallel = if p.parallel {
            format!(", orthographic, {} m wide", f64::from(w) / p.focal.x)
        } else {
            String::new()
        };
        format!("{w} x {h} pixels at {}{lens}{parallel}", p.origin)
    };
    line("wavelengths_nm", format!("{:?}", scene.wavelengths.nm()));
    line("camera", device(&scene.camera));
    if let Some(p) = &scene.projector {
        let what = if p.coaxial { "coaxial, " } else { "" };
        line("projector", format!("{what}{}", device(&p.pinhole)));
    }
    for emitter in emitters(scene) {
        line("emitter", emitter);
    }
    let (triangles, quadrics) = scene.geometry.counts();
    line("geometry", format!("{triangles} triangles, {quadrics} quadrics"));
    let (instances, groups) = scene.geometry.copies();
    if instances > 0 {
        line("instances", format!("{instances} of {groups} groups"));
    }
    line("media", scene.media.list.len().to_string());
    let s = &scene.settings;
    let why = scene.why_integrator().map_or(String::new(), |why| format!(" ({why})"));
    line("integrator", format!("{}{why}", s.integrator.name()));
    line("strategies", strategies(scene).to_string());
    line("manifold", s.manifold.to_string());
    line("max_depth", s.max_depth.to_string());
    line("samples_per_pixel", s.spp.to_string());
    let slices: Vec<&str> = scene.slices.iter().map(|s| s.name.as_str()).collect();
    line("slices", slices.join(", "));
    for note in &scene.notes {
        let _ = writeln!(out, "note: {note}");
    }
    for warning in missing(scene) {
        let _ = writeln!(out, "warning: {warning}");
    }
    out
}

/// Describes the values that differ between the variants of a scene file. Returns an empty text if the file
/// has no variants.
fn variants(path: &Path, text: &str) -> Result<String, Failure> {
    let file = SceneFile::read(path, text)?;
    if file.vary.is_empty() {
        return Ok(String::new());
    }
    let count = variant::count(path, text, &file)?;
    let count = count.map_or("unlimited".to_owned(), |n| n.to_string());
    let mut out =
        format!("  {:18} {count} (render one: sunstone render {} --variant 0)\n", "variants", path.display());
    for (name, parameter) in &file.vary {
        let drawn = parameter.range.as_ref().map(|r| format!("{} .. {}", r.min.0, r.max.0));
        let listed = || {
            let values = parameter.values.iter().flat_map(|v| v.iter());
            values.map(|v| v.0.to_string().trim().to_owned()).collect::<Vec<_>>().join(", ")
        };
        let every = match *parameter.every {
            1 => String::new(),
            n => format!(", every {n}"),
        };
        let what = format!("{}: {}{every}", parameter.path.0.join(", "), drawn.unwrap_or_else(listed));
        let _ = writeln!(out, "  {:18} {what}", format!("vary {name}"));
    }
    Ok(out)
}

/// Returns one phrase for each emitter except the projector.
fn emitters(scene: &Scene) -> Vec<String> {
    let lanes = scene.wavelengths.count();
    let values = |s: &Spectral| format!("{:?}", &s.to_array()[..lanes]);
    let mut out: Vec<String> = scene
        .points
        .iter()
        .map(|p| {
            let what = match &p.profile {
                Profile::Even => "point".to_owned(),
                Profile::Spot { cutoff, .. } => format!("spot of {:.1}° half angle", cutoff.to_degrees()),
                Profile::Table(_) => "luminaire".to_owned(),
                Profile::Frustum(_) => "image projector".to_owned(),
            };
            let what = match &p.slide {
                Some(_) if matches!(p.profile, Profile::Spot { .. }) => format!("{what} with an image"),
                _ => what,
            };
            format!("{what} at {}, up to {} W/(sr nm)", p.position, values(&p.intensity))
        })
        .collect();
    for d in &scene.lights.distant {
        out.push(match d.across {
            Across::Even(e) => format!("directional, along {}, {} W/(m² nm)", d.dir, values(&e)),
            Across::Disk { power, radius } => {
                format!("beam along {}, {} W/nm, radius {radius} m", d.dir, values(&power))
            }
            Across::Gaussian { power, radius } => {
                format!("Gaussian beam along {}, {} W/nm, radius {radius} m", d.dir, values(&power))
            }
        });
    }
    for area in &scene.lights.areas {
        let image = if area.radiance.texture.is_some() { " times an image" } else { "" };
        let sides = if area.two_sided { ", two-sided" } else { "" };
        let radiance = values(&area.radiance.value);
        out.push(format!("surface of {:.4} m², {radiance} W/(m² sr nm){image}{sides}", area.area()));
    }
    if let Some(environment) = &scene.environment {
        out.push(format!("environment, {} W/(m² sr nm)", values(&environment.radiance)));
    }
    if let Some(sky) = &scene.lights.sky {
        let [w, h] = sky.size();
        out.push(format!("environment image, {w} x {h} texels"));
    }
    out
}

/// Formats a slice's name and axes.
fn axes(slice: &StoredSlice) -> String {
    let layout = slice.layout();
    let axes: Vec<String> = layout.axes.iter().map(|x| format!("{} {}", x.kind.name(), x.len())).collect();
    let selection = slice.attributes().get("projector_selection").and_then(Value::as_str);
    format!("\n{}  ({})  s': {}", slice.name(), axes.join(" × "), selection.unwrap_or("?"))
}

fn describe(slice: &StoredSlice) -> Result<String, Failure> {
    let layout = slice.layout();
    let mut out = axes(slice);
    let total = m00_total(slice, Field::Mean)?;
    let _ = write!(
        out,
        "\n  Σ M00 {:.6e} W/(m² sr nm), per wavelength {}",
        total.iter().sum::<f64>(),
        list(&total)
    );
    if let Some((start, bin)) = layout.time {
        let t = &layout.axes[layout.find(AxisKind::T).unwrap_or(0)];
        let end = start + bin * t.len() as f64;
        let outside = m00_total(slice, Field::Overflow)?;
        let all: f64 = total.iter().chain(&outside).sum();
        let share = if all > 0.0 { 100.0 * outside.iter().sum::<f64>() / all } else { 0.0 };
        let _ = write!(
            out,
            "\n  time {start}..{end} ps in bins of {bin} ps; overflow Σ M00 {:.6e} ({share:.3} % of all light)",
            outside.iter().sum::<f64>()
        );
    }
    if let Some(doubt) = doubt::of(slice).map_err(Failure::input)? {
        let _ = write!(
            out,
            "\n  unreliable error estimates (too few samples): {} of {} lit pixels ({:.1} %)",
            doubt.doubtful,
            doubt.lit,
            100.0 * doubt.share()
        );
    }
    Ok(out)
}

fn list(v: &[f64]) -> String {
    v.iter().map(|x| format!("{x:.4e}")).collect::<Vec<_>>().join(", ")
}

/// Sums M00 over all axes except wavelength, chunk by chunk.
fn m00_total(slice: &StoredSlice, field: Field) -> Result<Vec<f64>, Failure> {
    let layout = slice.field_layout(field).map_err(Failure::input)?.clone();
    let lanes = |shape: &[u64]| layout.find(AxisKind::Wavelength).map_or(1, |i| shape[i] as usize);
    let mut total = vec![0.0; lanes(&layout.shape())];
    let chunks: Vec<_> = slice.chunks(field).map_err(Failure::input)?.collect();
    let mut ahead = 0;
    for (k, (start, mut shape)) in chunks.iter().cloned().enumerate() {
        if k == ahead {
            ahead += slice.fetch_ahead(&[field], &chunks[k..]).map_err(Failure::input)?;
        }
        // Only element M00 of each matrix is summed, so chunks that do not contain M00 are skipped.
        let stokes = [AxisKind::StokesOut, AxisKind::StokesIn];
        let stokes: Vec<usize> = stokes.iter().filter_map(|k| layout.find(*k)).collect();
        if stokes.iter().any(|&i| start[i] > 0) {
            continue;
        }
        stokes.iter().for_each(|&i| shape[i] = 1);
        let data = slice.read(field, &start, &shape).map_err(Failure::input)?;
        let lanes = lanes(&shape);
        let first = layout.find(AxisKind::Wavelength).map_or(0, |i| start[i] as usize);
        for element in data.chunks_exact(lanes) {
            for (t, v) in total[first..].iter_mut().zip(element) {
                *t += f64::from(*v);
            }
        }
    }
    Ok(total)
}
