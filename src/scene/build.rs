//! From the syntax of a scene file to the flat tables of a [`Scene`], checking meaning on the way.

use super::devices::{emitters, pinhole, projector};
use super::epipolar::Epipolar;
use super::file::{MaterialFile, SceneFile};
use super::locate::{Located, SceneError};
use super::values::{AlbedoFile, SpectrumFile};
use super::{Scene, Settings, shapes, slices};
use crate::geometry::bvh::GeometryBuilder;
use crate::material::{Material, Textures, conductor, dielectric, diffuse, rough_conductor};
use crate::spectrum::{Spectral, Wavelengths};
use crate::tensor::slice::{CameraSelect, ProjectorSelect};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What every step of the build needs: where messages point to, and what has been read.
pub(super) struct Context {
    pub file: PathBuf,
    pub text: Arc<str>,
    pub wavelengths: Wavelengths,
    pub hash: Sha256,
}

impl Context {
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

    /// A spectrum on the scene's wavelengths, every value within `range`.
    pub fn spectrum(
        &self,
        s: &SpectrumFile,
        span: Range<usize>,
        what: &str,
        range: std::ops::RangeInclusive<f64>,
    ) -> Result<Spectral, SceneError> {
        let n = self.wavelengths.count();
        let list = match s {
            SpectrumFile::Scalar(v) => vec![*v; n],
            SpectrumFile::PerWavelength(list) if list.len() == n => list.clone(),
            SpectrumFile::PerWavelength(list) => {
                return Err(self.error(
                    span,
                    format!("{what} has {} values for {n} wavelengths", list.len()),
                    format!("give one number, or {n} (one per entry of wavelengths_nm)"),
                ));
            }
        };
        if let Some(bad) = list.iter().find(|v| !range.contains(*v)) {
            return Err(self.error(
                span,
                format!("{what} is {bad}"),
                format!("it must lie in {}..{}", range.start(), range.end()),
            ));
        }
        let mut lanes = [0.0_f32; 4];
        for (lane, v) in lanes.iter_mut().zip(list) {
            *lane = v as f32;
        }
        Ok(Spectral::new(lanes))
    }

    /// [`Self::spectrum`] of a located value.
    pub fn located(
        &self,
        s: &Located<SpectrumFile>,
        what: &str,
        range: std::ops::RangeInclusive<f64>,
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
        let text = std::fs::read_to_string(path).map_err(|e| SceneError {
            file: path.to_owned(),
            text: "".into(),
            span: None,
            message: format!("cannot read the scene file: {e}"),
            help: Some("give the path of a scene.toml".into()),
        })?;
        Self::from_text(path, &text)
    }

    /// Builds a scene from its text; `path` names it in messages and anchors the files it refers to.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn from_text(path: &Path, text: &str) -> Result<Self, SceneError> {
        let text: Arc<str> = text.into();
        let file: SceneFile = toml::from_str(&text).map_err(|e| SceneError {
            file: path.to_owned(),
            text: text.clone(),
            span: e.span(),
            message: e.message().lines().collect::<Vec<_>>().join("; "),
            help: Some(syntax_help(e.message())),
        })?;
        let wavelengths = Wavelengths::new(file.wavelengths_nm.to_vec()).map_err(|e| {
            let span = file.wavelengths_nm.span();
            SceneError {
                file: path.to_owned(),
                text: text.clone(),
                span: (span != (0..0)).then_some(span),
                message: format!("wavelengths_nm: {e}"),
                help: Some("list 1 to 4 rising vacuum wavelengths in nanometres".into()),
            }
        })?;
        let mut hash = Sha256::new();
        hash.update(text.as_bytes());
        let mut ctx = Context {
            file: path.to_owned(),
            text,
            wavelengths,
            hash,
        };
        build(&mut ctx, &file)
    }
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
    let mut textures = Textures::default();
    let mut materials = Vec::new();
    let mut names = BTreeMap::new();
    for (name, m) in &file.materials {
        names.insert(name.as_str(), materials.len() as u32);
        materials.push(material(ctx, m, &mut textures)?);
    }
    let mut geometry = GeometryBuilder::default();
    for object in &file.objects {
        shapes::add(ctx, object, &names, &mut geometry)?;
    }
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
        geometry: geometry.build(),
        materials,
        textures,
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

fn settings(ctx: &Context, file: &SceneFile) -> Result<Settings, SceneError> {
    let r = &file.render;
    let check = |v: &Located<u32>, what: &str, range: std::ops::RangeInclusive<u32>| {
        if range.contains(v) {
            return Ok(**v);
        }
        Err(ctx.error(
            v.span(),
            format!("{what} is {}", **v),
            format!("it must lie in {}..{}", range.start(), range.end()),
        ))
    };
    Ok(Settings {
        spp: check(&r.spp, "spp", 1..=1 << 30)?,
        max_depth: check(&r.max_depth, "max_depth", 1..=1024)?,
        rr_depth: r.rr_depth,
        seed: r.seed,
        tile: check(&r.tile, "tile", 1..=512)?,
    })
}

fn material(
    ctx: &mut Context,
    m: &Located<MaterialFile>,
    textures: &mut Textures,
) -> Result<Material, SceneError> {
    // Unused lanes get index 1, so that nothing divides by zero there.
    let unused = Spectral::ONE - ctx.wavelengths.ones();
    Ok(match &**m {
        MaterialFile::Diffuse(d) => {
            let span = d.albedo.span();
            match &*d.albedo {
                AlbedoFile::Spectrum(s) => Material::Diffuse(diffuse::Diffuse {
                    albedo: ctx.spectrum(s, span, "albedo", 0.0..=1.0)?,
                    texture: None,
                }),
                AlbedoFile::Image(i) => {
                    let scale = SpectrumFile::Scalar(i.scale);
                    Material::Diffuse(diffuse::Diffuse {
                        albedo: ctx.spectrum(&scale, span, "scale", 0.0..=1.0)?,
                        texture: Some(texture(ctx, &i.image, textures)?),
                    })
                }
            }
        }
        MaterialFile::Conductor(c) => Material::Conductor(conductor::Conductor {
            n: ctx.located(&c.n, "n", 1e-3..=100.0)? + unused,
            k: ctx.located(&c.k, "k", 0.0..=100.0)?,
        }),
        MaterialFile::RoughConductor(c) => {
            if !(0.001..=1.0).contains(&*c.alpha) {
                return Err(ctx.error(
                    c.alpha.span(),
                    format!("alpha is {}", *c.alpha),
                    "it must lie in 0.001..1; for a mirror use `conductor`",
                ));
            }
            Material::RoughConductor(rough_conductor::RoughConductor {
                n: ctx.located(&c.n, "n", 1e-3..=100.0)? + unused,
                k: ctx.located(&c.k, "k", 0.0..=100.0)?,
                alpha: *c.alpha as f32,
            })
        }
        MaterialFile::Dielectric(d) => {
            let interior = ctx.located(&d.ior, "ior", 1.0..=10.0)? + unused;
            let exterior = ctx.located(&d.exterior_ior, "exterior_ior", 1.0..=10.0)? + unused;
            let varies = |s: Spectral| {
                let lanes = s.to_array();
                lanes[1..ctx.wavelengths.count()].iter().any(|l| *l != lanes[0])
            };
            Material::Dielectric(dielectric::Dielectric {
                interior,
                exterior,
                dispersive: varies(interior) || varies(exterior),
            })
        }
    })
}

/// Reads an albedo image: sRGB to linear, red, green or blue for each wavelength.
fn texture(ctx: &mut Context, name: &Located<String>, textures: &mut Textures) -> Result<u32, SceneError> {
    let bytes = ctx.read(name, name.span())?;
    let image = image::load_from_memory(&bytes).map_err(|e| {
        ctx.error(
            name.span(),
            format!("cannot decode {}: {e}", ctx.path(name).display()),
            "use a PNG or JPEG file",
        )
    })?;
    let image = image.to_rgb32f();
    let linear = |c: f32| {
        if c <= 0.04045 {
            c / 12.92
        } else {
            ((c + 0.055) / 1.055).powf(2.4)
        }
    };
    let channel = |nm: f64| match nm {
        nm if nm < 500.0 => 2,
        nm if nm < 590.0 => 1,
        _ => 0,
    };
    textures
        .images
        .push((image.width(), image.height(), textures.texels.len() as u32));
    let wavelengths = ctx.wavelengths.clone();
    textures.texels.extend(
        image
            .pixels()
            .map(|p| wavelengths.map(|nm| linear(p.0[channel(nm)])).to_array()),
    );
    Ok(textures.images.len() as u32 - 1)
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
