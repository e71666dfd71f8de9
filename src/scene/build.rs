//! From the syntax of a scene file to the flat tables of a [`Scene`], checking meaning on the way.

use super::devices::{emitters, pinhole, projector};
use super::epipolar::Epipolar;
use super::file::{ObjectFile, SceneFile};
use super::locate::{Located, SceneError};
use super::values::{SpectrumFile, interpolate};
use super::{Integrator, Scene, Settings, materials, media, shapes, slices};
use crate::geometry::bvh::GeometryBuilder;
use crate::medium::nesting::Boundary;
use crate::spectrum::{Spectral, Wavelengths};
use crate::tensor::slice::{CameraSelect, ProjectorSelect};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What every step of the build needs: where messages point to, and what has been read.
pub(super) struct Context {
    pub file: PathBuf,
    pub text: Arc<str>,
    /// Wavelengths to build for.
    pub wavelengths: Wavelengths,
    /// Wavelengths that lists of the file belong to; the same but where a file of materials is built for others.
    pub listed: Wavelengths,
    pub hash: Sha256,
}

impl Context {
    /// Of a file with its text and its list of wavelengths.
    pub fn new(path: &Path, text: &str, wavelengths_nm: &Located<Vec<f64>>) -> Result<Self, SceneError> {
        let mut ctx = Self {
            file: path.to_owned(),
            text: text.into(),
            wavelengths: Wavelengths::default(),
            listed: Wavelengths::default(),
            hash: Sha256::new(),
        };
        ctx.hash.update(text.as_bytes());
        ctx.listed = Wavelengths::new(wavelengths_nm.to_vec()).map_err(|e| {
            ctx.error(
                wavelengths_nm.span(),
                format!("wavelengths_nm: {e}"),
                "list 1 to 4 rising vacuum wavelengths in nanometres",
            )
        })?;
        ctx.wavelengths = ctx.listed.clone();
        Ok(ctx)
    }

    /// An error at a place, with its mend.
    pub fn error(
        &self,
        span: Range<usize>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> SceneError {
        SceneError {
            file: self.file.clone(),
            text: self.text.clone(),
            span: (span != (0..0)).then_some(span),
            message: message.into(),
            help: Some(help.into()),
        }
    }

    /// Path of a file that the scene names.
    pub fn path(&self, name: &str) -> PathBuf {
        self.file.parent().unwrap_or(Path::new("")).join(name)
    }

    /// Reads a file that the scene names, and counts it into the scene's hash.
    pub fn read(&mut self, name: &str, span: Range<usize>) -> Result<Vec<u8>, SceneError> {
        let path = self.path(name);
        let bytes = std::fs::read(&path).map_err(|e| {
            self.error(
                span,
                format!("cannot read {}: {e}", path.display()),
                "paths are relative to the scene file; correct the name or put the file there",
            )
        })?;
        self.hash.update((bytes.len() as u64).to_le_bytes());
        self.hash.update(&bytes);
        Ok(bytes)
    }

    /// A value for each of the scene's wavelengths, all within `range`.
    pub fn values(
        &self,
        s: &SpectrumFile,
        span: Range<usize>,
        what: &str,
        range: RangeInclusive<f64>,
    ) -> Result<Vec<f64>, SceneError> {
        let n = self.listed.count();
        let at = |nm: &[f64], values: &[f64]| {
            let wanted = self.wavelengths.nm().iter();
            wanted.map(|w| interpolate(nm, values, *w)).collect()
        };
        let list = match s {
            SpectrumFile::Scalar(v) => vec![*v; self.wavelengths.count()],
            SpectrumFile::PerWavelength(list) if list.len() == n => at(self.listed.nm(), list),
            SpectrumFile::Table(table) if table.is_sound() => at(&table.nm, &table.values),
            SpectrumFile::Table(_) => {
                return Err(self.error(
                    span,
                    format!("the table of {what} is uneven"),
                    "give nm, rising, and as many values",
                ));
            }
            SpectrumFile::PerWavelength(list) => {
                return Err(self.error(
                    span,
                    format!("{what} has {} values for {n} wavelengths", list.len()),
                    format!("give one number, or {n} (one per entry of wavelengths_nm)"),
                ));
            }
        };
        for value in &list {
            self.within(*value, span.clone(), what, &range)?;
        }
        Ok(list)
    }

    /// A number of the file, which lies within `range`.
    pub fn number<T: Copy + PartialOrd + Display>(
        &self,
        value: &Located<T>,
        what: &str,
        range: RangeInclusive<T>,
    ) -> Result<T, SceneError> {
        self.within(**value, value.span(), what, &range)
    }

    /// [`Self::number`] that stands at a place.
    pub fn within<T: Copy + PartialOrd + Display>(
        &self,
        value: T,
        span: Range<usize>,
        what: &str,
        range: &RangeInclusive<T>,
    ) -> Result<T, SceneError> {
        if range.contains(&value) {
            return Ok(value);
        }
        Err(self.error(
            span,
            format!("{what} is {value}"),
            format!("it must lie in {}..{}", range.start(), range.end()),
        ))
    }

    /// [`Self::values`] in their lanes.
    pub fn spectrum(
        &self,
        s: &SpectrumFile,
        span: Range<usize>,
        what: &str,
        range: RangeInclusive<f64>,
    ) -> Result<Spectral, SceneError> {
        let mut lanes = [0.0_f32; 4];
        for (lane, v) in lanes.iter_mut().zip(self.values(s, span, what, range)?) {
            *lane = v as f32;
        }
        Ok(Spectral::new(lanes))
    }

    /// [`Self::spectrum`] of a located value.
    pub fn located(
        &self,
        s: &Located<SpectrumFile>,
        what: &str,
        range: RangeInclusive<f64>,
    ) -> Result<Spectral, SceneError> {
        self.spectrum(s, s.span(), what, range)
    }
}

/// The largest value that makes sense anywhere in a scene file; keeps f32 arithmetic finite.
pub(super) const HUGE: f64 = 1e12;

impl Scene {
    /// Reads and builds a scene file.
    ///
    /// # Errors
    /// [`SceneError`] naming file, line, column and mend.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        Self::from_text(path, &read(path, "scene file")?)
    }

    /// Builds a scene from its text; `path` names it in messages and anchors the files it refers to.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn from_text(path: &Path, text: &str) -> Result<Self, SceneError> {
        let file: SceneFile = parse(path, text)?;
        let mut ctx = Context::new(path, text, &file.wavelengths_nm)?;
        build(&mut ctx, &file)
    }
}

/// Reads the text of a file that the user named.
pub(super) fn read(path: &Path, what: &str) -> Result<String, SceneError> {
    std::fs::read_to_string(path).map_err(|e| SceneError {
        file: path.to_owned(),
        text: "".into(),
        span: None,
        message: format!("cannot read the {what}: {e}"),
        help: Some("give the path of a TOML file".into()),
    })
}

/// Reads the syntax of a file.
pub(super) fn parse<T: serde::de::DeserializeOwned>(path: &Path, text: &str) -> Result<T, SceneError> {
    toml::from_str(text).map_err(|e| SceneError {
        file: path.to_owned(),
        text: text.into(),
        span: e.span(),
        message: e.message().lines().collect::<Vec<_>>().join("; "),
        help: Some(syntax_help(e.message())),
    })
}

fn syntax_help(message: &str) -> String {
    if message.contains("unknown field") || message.contains("unknown variant") {
        "use one of the names listed; `sunstone schema` prints all of them".into()
    } else if message.contains("missing field") {
        "add the missing key; `sunstone schema` describes it".into()
    } else {
        "correct the value; `sunstone schema` describes every key".into()
    }
}

fn build(ctx: &mut Context, file: &SceneFile) -> Result<Scene, SceneError> {
    let settings = settings(ctx, file)?;
    let camera = pinhole(ctx, &file.camera, file.camera.span())?;
    let projector = file
        .projector
        .as_ref()
        .map(|p| projector(ctx, p, p.span(), &camera))
        .transpose()?;
    let (points, environment) = emitters(ctx, file)?;
    if projector.is_none() && points.is_empty() && environment.is_none() {
        return Err(ctx.error(
            file.camera.span(),
            "the scene has no light",
            "add a [projector], or [[emitters]] with a point or an environment",
        ));
    }
    let (mut materials, names) = materials::build(ctx, &file.materials)?;
    let (media, media_names, _) = media::build(ctx, &file.media)?;
    let mut boundaries = vec![Boundary::NONE; materials.list.len()];
    let mut geometry = GeometryBuilder::default();
    for object in &file.objects {
        let filling = filling(ctx, object, &media_names)?;
        for mut placed in shapes::place(ctx, object, &names)? {
            if let Some(filling) = filling {
                // A number of its own tells this object's surfaces from others of the same material.
                materials.list.push(materials.list[placed.material as usize]);
                boundaries.push(filling);
                placed.material = boundaries.len() as u32 - 1;
            }
            shapes::add(ctx, object, placed, &mut geometry)?;
        }
    }
    let mut geometry = geometry.build();
    geometry.textured = !materials.textures.images.is_empty();
    let slices = slices::build(ctx, file, &camera, projector.as_ref())?;
    let uses_epipolar = |s: &crate::tensor::slice::Slice| {
        matches!(
            s.projector,
            ProjectorSelect::Epipolar { .. } | ProjectorSelect::NonEpipolar { .. }
        )
    };
    if let (Some(at), Some(p)) = (slices.iter().position(uses_epipolar), &projector)
        && Epipolar::new(&camera, &p.pinhole).is_none()
    {
        return Err(ctx.error(
            file.slices[at].span(),
            "camera and projector share their centre, so there are no epipolar lines",
            "move the projector, or use projector = \"coaxial\"",
        ));
    }
    for figure in &file.figures {
        if !slices.iter().any(|s| s.name == figure.view.slice()) {
            return Err(ctx.error(
                figure.span(),
                format!(
                    "figure `{}` draws slice `{}`, which is not in the scene",
                    figure.name,
                    figure.view.slice()
                ),
                format!(
                    "name one of: {}",
                    slices
                        .iter()
                        .map(|s| s.name.as_str())
                        .collect::<Vec<_>>()
                        .join(", ")
                ),
            ));
        }
        if figure.name.is_empty() || figure.name.contains(['/', '\\']) {
            return Err(ctx.error(
                figure.span(),
                format!("`{}` cannot be a file name", figure.name),
                "use letters, digits, _ and -",
            ));
        }
    }
    let name = file.name.clone().unwrap_or_else(|| default_name(&ctx.file));
    Ok(Scene {
        name,
        wavelengths: ctx.wavelengths.clone(),
        geometry,
        sheets: materials.any_straight(),
        filled: boundaries.iter().any(|b| *b != Boundary::NONE) || materials.any_null(),
        materials,
        media,
        boundaries,
        camera,
        projector,
        points,
        environment,
        slices,
        figures: file.figures.iter().map(|f| (**f).clone()).collect(),
        settings,
        sha256: std::mem::take(&mut ctx.hash)
            .finalize()
            .iter()
            .map(|b| format!("{b:02x}"))
            .collect(),
    })
}

/// What fills an object.
fn filling(
    ctx: &Context,
    object: &ObjectFile,
    media: &BTreeMap<&str, u32>,
) -> Result<Option<Boundary>, SceneError> {
    let Some(name) = &object.interior else {
        return Ok(None);
    };
    let Some(medium) = media.get(name.as_str()) else {
        let known = media.keys().copied().collect::<Vec<_>>().join(", ");
        return Err(ctx.error(
            name.span(),
            format!("there is no medium `{}`", **name),
            if known.is_empty() {
                format!("add [media.{}]", **name)
            } else {
                format!("add [media.{}], or use one of: {known}", **name)
            },
        ));
    };
    Ok(Some(Boundary {
        medium: *medium,
        priority: object.priority,
    }))
}

/// The folder's name for `…/NAME/scene.toml`, the file's stem otherwise.
fn default_name(path: &Path) -> String {
    let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or("scene");
    let folder = std::path::absolute(path)
        .ok()
        .and_then(|p| Some(p.parent()?.file_name()?.to_str()?.to_owned()));
    match folder {
        Some(folder) if stem == "scene" => folder,
        _ => stem.to_owned(),
    }
}

pub(super) fn settings(ctx: &Context, file: &SceneFile) -> Result<Settings, SceneError> {
    let r = &file.render;
    Ok(Settings {
        spp: ctx.number(&r.spp, "spp", 1..=1 << 30)?,
        max_depth: ctx.number(&r.max_depth, "max_depth", 1..=1024)?,
        rr_depth: r.rr_depth,
        integrator: r.integrator,
        manifold: r.manifold.unwrap_or(r.integrator == Integrator::Bidirectional),
        strategy: None,
        seed: r.seed,
        tile: ctx.number(&r.tile, "tile", 1..=512)?,
    })
}

/// The camera bins' least common multiple: tiles must be a multiple of it.
pub(super) fn bin_multiple(slices: &[crate::tensor::slice::Slice]) -> u64 {
    let gcd = |mut a: u64, mut b: u64| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    slices.iter().fold(1, |m, s| match s.camera {
        CameraSelect::Binned { nx, ny } => {
            let m = m / gcd(m, u64::from(nx)) * u64::from(nx);
            m / gcd(m, u64::from(ny)) * u64::from(ny)
        }
        _ => m,
    })
}
