//! Builds the flat tables of a [`Scene`] from the syntax of a scene file, with semantic checks.

use super::context::{self, Context};
use super::devices::{pinhole, projector};
use super::surfaces::Surfaces;
use super::{calibrated, file_materials, lights, materials, media, slices, textured, touching};
use base::locate::{InputError, Located};
use sha2::Digest;
use std::collections::BTreeMap;
use std::path::Path;
use syntax::Syntax;
use syntax::device::EmitterFile;
use syntax::scene::{GapsFile, RenderFile, SceneFile};
use syntax::variant;
use tensor::slice::ProjectorSelect;
use transport::device::epipolar::Epipolar;
use transport::render::gaps::{Gap, narrow};
use transport::scene::{Integrator, Scene, SceneTables, Settings, Variant};
use transport::strategy::Strategies;

/// Reads a scene file and returns its text.
///
/// # Errors
/// Returns [`InputError`] if the file cannot be read.
pub fn read(path: &Path) -> Result<String, InputError> {
    context::read(path, "scene file")
}

/// Reads a scene file and builds its scene.
///
/// # Errors
/// Returns [`InputError`] with file, line, column and fix, if the file cannot be read or is invalid.
pub fn load(path: &Path) -> Result<Scene, InputError> {
    from_text(path, &read(path)?)
}

/// Builds a scene from text. `path` is the file's path in messages, and its folder is the base of relative
/// paths.
///
/// # Errors
/// Returns the same errors as [`load`].
pub fn from_text(path: &Path, text: &str) -> Result<Scene, InputError> {
    let file = SceneFile::read(path, text)?;
    variant::count(path, text, &file)?;
    from_file(path, text, &file)
}

/// Builds a variant of a scene from the text of its file ([`syntax::variant`]), or the scene itself for `None`.
/// See [`from_text`] for `path`.
///
/// # Errors
/// Returns the same errors as [`load`], or an error if the variant does not exist. Errors in varied values
/// are located in `[vary]`.
pub fn variant_from_text(path: &Path, text: &str, number: Option<u64>) -> Result<Scene, InputError> {
    match number {
        Some(number) => from_variant(path, text, &variant::read(path, text, number)?, number),
        None => from_text(path, text),
    }
}

/// Builds a variant of a scene and records the variant's number. `path` and `text` are as in [`from_file`].
///
/// # Errors
/// Returns the same errors as [`load`].
pub fn from_variant(
    path: &Path,
    text: &str,
    variant: &variant::Variant,
    number: u64,
) -> Result<Scene, InputError> {
    let mut scene = from_file(path, text, &variant.file)?;
    scene.set_variant(recorded(variant, number));
    Ok(scene)
}

/// Returns what a scene records of its variant: the number, and the values as texts.
pub fn recorded(variant: &variant::Variant, number: u64) -> Variant {
    Variant { number, values: variant.values.iter().map(|(name, v)| (name.clone(), v.to_string())).collect() }
}

/// Builds a scene from a parsed file whose locations refer to `text`. See [`from_text`] for `path`.
///
/// # Errors
/// Returns the same errors as [`load`].
pub fn from_file(path: &Path, text: &str, file: &SceneFile) -> Result<Scene, InputError> {
    let mut ctx = Context::new(path, text, &file.wavelengths_nm)?;
    build(&mut ctx, file)
}

pub(crate) fn build(ctx: &mut Context, file: &SceneFile) -> Result<Scene, InputError> {
    match with_gaps(ctx, file)? {
        (_, Some(fault)) if file.render.gaps == GapsFile::Refuse => Err(fault),
        (mut scene, Some(fault)) => {
            scene.add_notes([fault.message]);
            Ok(scene)
        }
        (scene, None) => Ok(scene),
    }
}

/// Maximum number of rounds in which touching objects are moved.
const MOST_ROUNDS: usize = 4;
/// Maximum number of contacts that are separated per round.
const MOST_CONTACTS: usize = 16;

/// Builds a scene and returns an error for the first gap in which light would be lost. Objects that touch are
/// moved by the smallest distance that single precision resolves, unless both objects refract.
///
/// # Errors
/// Returns the same errors as [`load`], except the error for a gap, which is part of the result.
pub(crate) fn with_gaps(
    ctx: &mut Context,
    file: &SceneFile,
) -> Result<(Scene, Option<InputError>), InputError> {
    let file = file_materials::expand(ctx, file)?;
    let mut file = calibrated::expand(ctx, file)?;
    ctx.hash.update(meaning(&file));
    let (hash, notes) = (ctx.hash.clone(), ctx.notes.clone());
    let mut scene = tables(ctx, &file)?;
    let mut moved = vec![];
    for _ in 0..MOST_ROUNDS {
        let gaps = narrow(&scene);
        let mut is_moved = false;
        for gap in gaps.iter().take(MOST_CONTACTS) {
            if let Some(note) = touching::separate(ctx, &mut file, gap) {
                if !moved.contains(&note) {
                    moved.push(note);
                }
                is_moved = true;
            }
        }
        if !is_moved {
            break;
        }
        (ctx.hash, ctx.notes) = (hash.clone(), notes.clone());
        scene = tables(ctx, &file)?;
    }
    scene.add_notes(moved);
    let fault = narrow(&scene).first().map(|gap| too_narrow(ctx, &file, gap));
    Ok((scene, fault))
}

/// Builds the tables of a scene after calibration files and materials of mesh files have been substituted.
fn tables(ctx: &mut Context, file: &SceneFile) -> Result<Scene, InputError> {
    let settings = settings(ctx, file)?;
    let camera = pinhole(ctx, &file.camera, file.camera.span())?;
    let projector = file.projector.as_ref().map(|p| projector(ctx, p, p.span(), &camera)).transpose()?;
    let lights::Emitters { mut points, environment, mut lights } = lights::emitters(ctx, &file.emitters)?;
    if let (true, Integrator::Caustics | Integrator::Bidirectional) = (camera.parallel, settings.integrator) {
        return Err(ctx.error(
            file.camera.span(),
            "an orthographic camera has no pinhole, so paths from light sources cannot be connected to the camera",
            "use integrator = \"path\", or give the camera a field of view",
        ));
    }
    let shines = file.objects.iter().any(|o| o.emission.is_some());
    // Only surfaces and the environment are directly visible.
    let seen = |e: &Located<EmitterFile>| matches!(**e, EmitterFile::Environment(_));
    if settings.max_depth == 1 && !shines && !file.emitters.iter().any(seen) {
        return Err(ctx.error(
            file.render.max_depth.span(),
            "with max_depth = 1 only visible emitters are rendered, but no emitter is visible",
            "set max_depth to at least 2 (2 renders direct light)",
        ));
    }
    named(ctx, file)?;
    if projector.is_none() && file.emitters.is_empty() && !shines {
        return Err(ctx.error(
            file.camera.span(),
            "the scene has no light",
            "add a [projector], [[emitters]], or an object with emission",
        ));
    }
    let materials::Built { table: mut materials, names } = materials::build(ctx, &file.materials)?;
    lights::slides(ctx, &file.emitters, &mut points)?;
    let (media, media_names, _) = media::build(ctx, &file.media)?;
    let textured = textured::with_images(&file.materials);
    let mut surfaces = Surfaces::new(&mut materials, &names, textured, &media_names);
    surfaces.objects(ctx, &file.objects, None)?;
    surfaces.instances(ctx, &file.groups, &file.instances)?;
    surfaces.materials.textures = std::mem::take(&mut ctx.textures);
    let (geometry, boundaries, called) = (surfaces.geometry.build(), surfaces.boundaries, surfaces.called);
    (lights.areas, lights.of_material) = surfaces.shining;
    let slices = slices::build(ctx, file, &camera, projector.as_ref())?;
    let uses_epipolar = |s: &tensor::slice::Slice| {
        matches!(
            s.projector,
            ProjectorSelect::Epipolar { .. }
                | ProjectorSelect::EpipolarAlong { .. }
                | ProjectorSelect::NonEpipolar { .. }
        )
    };
    if let (Some(at), Some(p)) = (slices.iter().position(uses_epipolar), &projector)
        && (camera.parallel || Epipolar::new(&camera, &p.pinhole).is_none())
    {
        let (what, fix) = if camera.parallel {
            (
                "an orthographic camera has no centre of projection, so there are no epipolar lines",
                "give the camera a field of view, or remove the slice",
            )
        } else {
            (
                "the camera and the projector have the same centre of projection, so there are no epipolar lines",
                "move the projector, or use projector = \"coaxial\"",
            )
        };
        return Err(ctx.error(file.slices[at].span(), what, fix));
    }
    let name = file.name.clone().unwrap_or_else(|| default_name(&ctx.file));
    let scene = Scene::new(SceneTables {
        name,
        wavelengths: ctx.wavelengths.clone(),
        geometry,
        materials,
        media,
        boundaries,
        names: called,
        camera,
        projector,
        points,
        environment,
        lights,
        slices,
        settings,
        sha256: std::mem::take(&mut ctx.hash).finalize().iter().map(|b| format!("{b:02x}")).collect(),
        text: ctx.text.to_string(),
        variant: None,
        notes: std::mem::take(&mut ctx.notes),
        files: ctx.used(),
    });
    Ok(scene)
}

/// Returns the error for a gap that single precision cannot resolve. The message names the objects
/// on both sides of the gap if they are known.
fn too_narrow(ctx: &Context, file: &SceneFile, gap: &Gap) -> InputError {
    let objects = gap.objects.iter().flatten();
    let mut both: Vec<_> = objects.filter_map(|i| file.objects.get(*i as usize)).collect();
    both.dedup_by_key(|o| o.span());
    let lines: String = both.iter().map(|o| ctx.line(o.span())).collect::<Vec<_>>().join(" and");
    let [x, y, z] = gap.at.to_array();
    ctx.error(
        both.first().map_or(0..0, |o| o.span()),
        format!(
            "the surfaces{lines} are {:.1e} m apart at ({x:.4}, {y:.4}, {z:.4}), but single precision resolves only gaps of at least \
             {:.1e} m there, so light would be lost",
            gap.width, gap.least
        ),
        "increase the distance between the surfaces (or let objects with an interior overlap), or move the scene closer to the \
         origin; to accept the loss of light, set `gaps = \"warn\"` in [render]",
    )
}

/// Checks the scene's name, which becomes a folder name, and the names of objects.
fn named(ctx: &Context, file: &SceneFile) -> Result<(), InputError> {
    let names_no_file = |n: &str| n.is_empty() || n == "." || n == ".." || n.contains(['/', '\\', '\0']);
    if let Some(name) = file.name.as_deref().filter(|n| names_no_file(n)) {
        let at = ctx.text.find("name").map_or(0..0, |at| at..at + "name".len());
        return Err(ctx.error(
            at,
            format!("`{name}` is not a valid name of a scene"),
            "use letters, digits, _ and -: the name is also the name of the store",
        ));
    }
    for (i, object) in file.objects.iter().enumerate() {
        let Some(name) = &object.name else {
            continue;
        };
        if name.is_empty() {
            bail!(ctx, object.span(), "the object's name is empty", "set a name, or remove the key");
        }
        if file.objects[..i].iter().any(|o| o.name.as_ref() == Some(name)) {
            bail!(ctx, object.span(), "duplicate object name `{name}`", "rename one of the objects");
        }
    }
    Ok(())
}

/// Returns the content of the scene as canonical text, for the scene hash. The text does not depend on
/// comments, table order, number formats, explicit defaults, the tables `figures` and `vary`, or names
/// without effect. The text excludes the samples per pixel, the replicates, the seed and the tile size.
fn meaning(file: &SceneFile) -> String {
    let defaults = RenderFile::default();
    let meaning = SceneFile {
        name: None,
        figures: vec![],
        vary: BTreeMap::new(),
        render: RenderFile {
            spp: defaults.spp,
            replicates: defaults.replicates,
            seed: defaults.seed,
            tile: defaults.tile,
            ..file.render.clone()
        },
        ..file.clone()
    };
    let mut meaning = serde_json::to_value(&meaning).expect("keys are strings");
    without_nulls(&mut meaning);
    meaning.to_string()
}

/// Removes null values, so that keys added in later versions do not change the hash of older scenes.
fn without_nulls(value: &mut serde_json::Value) {
    match value {
        serde_json::Value::Object(map) => {
            map.retain(|_, v| !v.is_null());
            map.values_mut().for_each(without_nulls);
        }
        serde_json::Value::Array(list) => list.iter_mut().for_each(without_nulls),
        _ => {}
    }
}

/// Returns the default name of a scene: the folder's name for `…/NAME/scene.toml`, otherwise the file's stem.
fn default_name(path: &Path) -> String {
    let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or("scene");
    let folder =
        std::path::absolute(path).ok().and_then(|p| Some(p.parent()?.file_name()?.to_str()?.to_owned()));
    match folder {
        Some(folder) if stem == "scene" => folder,
        _ => stem.to_owned(),
    }
}

pub(crate) fn settings(ctx: &Context, file: &SceneFile) -> Result<Settings, InputError> {
    let r = &file.render;
    Ok(Settings {
        spp: ctx.number(&r.spp, "spp", 1..=1 << 30)?,
        replicates: ctx.number(&r.replicates, "replicates", 1..=1 << 30)?,
        max_depth: ctx.number(&r.max_depth, "max_depth", 1..=1024)?,
        rr_depth: r.rr_depth,
        integrator: r.integrator,
        manifold: r.manifold.unwrap_or(r.integrator != Integrator::Path),
        strategy: None,
        strategies: Strategies::ALL,
        seed: r.seed,
        tile: ctx.number(&r.tile, "tile", 1..=512)?,
    })
}
