//! Converts media of a file to the flat table of [`Media`].

use super::context::{Context, read};
use super::grids;
use base::locate::{InputError, Located};
use optics::spectrum::Wavelengths;
use std::collections::BTreeMap;
use std::ops::{Range, RangeInclusive};
use std::path::Path;
use syntax::Syntax;
use syntax::medium::{
    AmountFile, HomogeneousFile, KindFile, MediumFile, MediumSetFile, MilkFile, ParticlesFile, PhaseFile,
    PolystyreneFile, SizesFile,
};
use syntax::values::IndexFile;
use transport::material::constants;
use transport::material::constants::ConstantsError;
use transport::medium::bulk::{Amount, Bulk, BulkError, Kind, Optics, PhaseOptics};
use transport::medium::henyey_greenstein::{HenyeyGreenstein, LARGEST_G};
use transport::medium::rayleigh::{LARGEST_DEPOLARIZATION, Rayleigh};
use transport::medium::size_distribution::SizeDistribution;
use transport::medium::{Media, presets, water};

pub struct MediumSet {
    /// Wavelengths for which the media were built.
    pub wavelengths: Wavelengths,
    pub media: Media,
    /// Index of each medium by name.
    pub names: BTreeMap<String, u32>,
    /// Bulk optical properties per medium and wavelength, in f64.
    pub bulk: Vec<Vec<Bulk>>,
}

impl MediumSet {
    /// Reads a media file (`wavelengths_nm` and `[media]` as in a scene file) and builds its media.
    ///
    /// With `only`, builds only the medium of the given name, because computing the tables of large particles
    /// takes seconds. With `wavelengths`, builds the media for the given wavelengths, and interpolates lists
    /// between the file's own wavelengths.
    ///
    /// # Errors
    /// Returns [`InputError`] with file, line, column and fix, if the file cannot be read or is invalid.
    pub fn load(
        path: &Path,
        only: Option<&str>,
        wavelengths: Option<Wavelengths>,
    ) -> Result<Self, InputError> {
        Self::at(path, &read_file(path)?, only, wavelengths)
    }

    /// Builds media as [`Self::load`] does, from a file's text. `path` names the file in messages.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::load`].
    pub fn at(
        path: &Path,
        text: &str,
        only: Option<&str>,
        wavelengths: Option<Wavelengths>,
    ) -> Result<Self, InputError> {
        let file = MediumSetFile::read(path, text)?;
        let mut ctx = Context::new(path, text, &file.wavelengths_nm)?;
        if let Some(wavelengths) = wavelengths {
            ctx.wavelengths = wavelengths;
        }
        let mut wanted = file.media;
        wanted.retain(|name, _| only.is_none_or(|only| only == name));
        let (media, names, bulk) = build(&mut ctx, &wanted)?;
        Ok(Self {
            wavelengths: ctx.wavelengths,
            media,
            names: names.into_iter().map(|(n, id)| (n.to_owned(), id)).collect(),
            bulk,
        })
    }
}

/// Returns the names of the media of a file without building the media.
///
/// # Errors
/// Returns the same errors as [`MediumSet::load`].
pub fn names(path: &Path) -> Result<Vec<String>, InputError> {
    names_of_text(path, &read_file(path)?)
}

/// Returns the same names as [`names`], from a file's text.
///
/// # Errors
/// Returns the same errors as [`MediumSet::load`].
pub fn names_of_text(path: &Path, text: &str) -> Result<Vec<String>, InputError> {
    Ok(MediumSetFile::read(path, text)?.media.into_keys().collect())
}

/// Reads a media file and returns its text.
///
/// # Errors
/// Returns [`InputError`] if the file cannot be read.
pub fn read_file(path: &Path) -> Result<String, InputError> {
    read(path, "file of media")
}

type Named = BTreeMap<String, Located<MediumFile>>;

/// Largest accepted coefficient in 1/m.
const LARGEST_COEFFICIENT: f64 = 1e9;

/// The table of media, their indices by name, and the bulk optical properties per medium and wavelength.
type Built<'a> = (Media, BTreeMap<&'a str, u32>, Vec<Vec<Bulk>>);

pub(crate) fn build<'a>(ctx: &mut Context, files: &'a Named) -> Result<Built<'a>, InputError> {
    let (mut media, mut names, mut bulk) = (Media::default(), BTreeMap::new(), vec![]);
    for (name, file) in files {
        let optics = optics(ctx, file)?;
        let number = media.push(&optics);
        if let MediumFile::Heterogeneous(h) = &**file {
            let density = grids::grid(ctx, &h.density, f64::INFINITY)?;
            media.list[number as usize].density = media.grids.len() as u32;
            media.grids.push(density);
            if let Some(file) = &h.albedo {
                let albedo = grids::grid(ctx, file, 1.0)?;
                media.list[number as usize].albedo = media.grids.len() as u32;
                media.grids.push(albedo);
            }
        }
        names.insert(name.as_str(), number);
        bulk.push(optics.bulk);
    }
    Ok((media, names, bulk))
}

fn optics(ctx: &Context, m: &Located<MediumFile>) -> Result<Optics, InputError> {
    match &**m {
        MediumFile::Homogeneous(h) => homogeneous(ctx, h),
        MediumFile::Heterogeneous(h) => homogeneous(
            ctx,
            &HomogeneousFile {
                absorption: h.absorption.clone(),
                scattering: h.scattering.clone(),
                index: h.index.clone(),
                phase: h.phase.clone(),
            },
        ),
        MediumFile::Particles(p) => particles(ctx, p),
        MediumFile::Milk(milk) => self::milk(ctx, milk, m.span()),
        MediumFile::Polystyrene(p) => polystyrene(ctx, p, m.span()),
        MediumFile::Marble(t) => Ok(presets::MARBLE.optics(cosine(ctx, &t.g)?, &ctx.wavelengths)),
        MediumFile::Skin(t) => Ok(presets::SKIN.optics(cosine(ctx, &t.g)?, &ctx.wavelengths)),
    }
}

const COSINES: RangeInclusive<f64> = -LARGEST_G..=LARGEST_G;

fn cosine(ctx: &Context, g: &Located<f64>) -> Result<f64, InputError> {
    ctx.number(g, "g", COSINES)
}

/// Converts an error of the scattering computation to an error with a location in the scene file.
fn refused(ctx: &Context, span: Range<usize>, e: &BulkError) -> InputError {
    let fix = match e {
        BulkError::Mie(_) => "change the radii, the refractive index or wavelengths_nm",
        BulkError::Size(_) => "correct the sizes; `sunstone schema` describes them",
        BulkError::Density(_) => "give the mass density of the particle material",
        BulkError::Amount(_) => "give a smaller amount of particles",
        BulkError::Constants(ConstantsError::Unknown { .. }) => "use one of the known names, or give numbers",
        BulkError::Constants(ConstantsError::Range { .. }) => "change wavelengths_nm",
    };
    ctx.error(span, e.to_string(), fix)
}

/// Returns the refractive index n and the extinction coefficient k per wavelength.
fn index(ctx: &Context, index: &Located<IndexFile>, what: &str) -> Result<Vec<[f64; 2]>, InputError> {
    match &**index {
        IndexFile::Values(s) => {
            let n = ctx.values(s, index.span(), what, 0.01..=100.0)?;
            Ok(n.into_iter().map(|n| [n, 0.0]).collect())
        }
        IndexFile::Named(name) => {
            let at = |nm: &f64| constants::lookup(name, *nm).map(|(n, k)| [n, k]);
            let rows: Result<_, ConstantsError> = ctx.wavelengths.nm().iter().map(at).collect();
            rows.map_err(|e| refused(ctx, index.span(), &e.into()))
        }
    }
}

/// Returns the real refractive index of a host per wavelength, and its absorption coefficient in 1/m if the
/// host is a named substance.
fn host(ctx: &Context, host: &Located<IndexFile>, what: &str) -> Result<[Vec<f64>; 2], InputError> {
    let rows = index(ctx, host, what)?;
    if let Some([n, k]) = rows.iter().find(|[n, k]| !(1.0..=10.0).contains(n) || *k > 1e-3) {
        return Err(ctx.error(
            host.span(),
            format!("{what} is {n} + {k} i"),
            "give a transparent host with an index in 1..10 and k of at most 0.001",
        ));
    }
    let is_water =
        matches!(&**host, IndexFile::Named(name) if constants::find(name).is_ok_and(|c| c.name == "water"));
    let absorption = rows
        .iter()
        .zip(ctx.wavelengths.nm())
        .map(|([_, k], nm)| if is_water { water::absorption(*nm) } else { water::of_extinction(*k, *nm) });
    Ok([rows.iter().map(|[n, _]| *n).collect(), absorption.collect()])
}

fn homogeneous(ctx: &Context, h: &HomogeneousFile) -> Result<Optics, InputError> {
    let coefficient = |s, what| {
        let s: &Located<_> = s;
        ctx.values(s, s.span(), what, 0.0..=LARGEST_COEFFICIENT)
    };
    let absorption = coefficient(&h.absorption, "absorption")?;
    let scattering = coefficient(&h.scattering, "scattering")?;
    let [index, _] = host(ctx, &h.index, "index")?;
    let mut bulk: Vec<Bulk> = (index.iter().zip(&scattering).zip(&absorption))
        .map(|((index, scattering), absorption)| Bulk {
            index: *index,
            scattering: *scattering,
            absorption: *absorption,
            ..Bulk::default()
        })
        .collect();
    let phase = match &h.phase {
        PhaseFile::Isotropic => PhaseOptics::Isotropic,
        PhaseFile::Rayleigh(r) => {
            let largest = f64::from(LARGEST_DEPOLARIZATION);
            let rho = ctx.number(&r.depolarization, "depolarization", 0.0..=largest)?;
            PhaseOptics::Rayleigh(Rayleigh::new(rho as f32))
        }
        PhaseFile::HenyeyGreenstein(f) => {
            let g = ctx.values(&f.g, f.g.span(), "g", COSINES)?;
            let circular = ctx.number(&f.circular, "circular", 0.0..=1.0)?;
            let linear = ctx.number(&f.linear, "linear", 0.0..=0.5 * (1.0 + circular))?;
            for (b, g) in bulk.iter_mut().zip(g) {
                b.asymmetry = g;
            }
            let g = ctx.located(&f.g, "g", COSINES)?;
            PhaseOptics::HenyeyGreenstein(HenyeyGreenstein::new(g, linear as f32, circular as f32))
        }
        PhaseFile::Mie(f) => {
            let particles = mixture(ctx, &f.kinds, &index, &vec![0.0; index.len()])?;
            for (b, p) in bulk.iter_mut().zip(&particles.bulk) {
                *b = Bulk { index: b.index, scattering: b.scattering, absorption: b.absorption, ..*p };
            }
            particles.phase
        }
    };
    Ok(Optics { bulk, phase })
}

fn particles(ctx: &Context, p: &ParticlesFile) -> Result<Optics, InputError> {
    let [index, own] = host(ctx, &p.host, "host")?;
    let absorption = match &p.host_absorption {
        Some(s) => ctx.values(s, s.span(), "host_absorption", 0.0..=LARGEST_COEFFICIENT)?,
        None => own,
    };
    mixture(ctx, &p.kinds, &index, &absorption)
}

/// Computes the optical properties of a mixture of particles in a host substance.
fn mixture(
    ctx: &Context,
    kinds: &Located<Vec<Located<KindFile>>>,
    host: &[f64],
    absorption: &[f64],
) -> Result<Optics, InputError> {
    if kinds.is_empty() {
        return Err(ctx.error(
            kinds.span(),
            "the list of particle kinds is empty",
            "list at least one kind: { index = 1.5, sizes.single = { radius_nm = 100 }, amount.volume_fraction = 0.01 }",
        ));
    }
    let mut list = vec![];
    for file in kinds.iter() {
        let mut rows = index(ctx, &file.index, "index")?;
        if let Some(k) = &file.k {
            for (row, k) in rows.iter_mut().zip(ctx.values(k, k.span(), "k", 0.0..=100.0)?) {
                row[1] = k;
            }
        }
        let kind = Kind { sizes: sizes(ctx, &file.sizes)?, index: rows, amount: amount(&file.amount) };
        kind.amount.number_density(&kind.sizes).map_err(|e| refused(ctx, file.amount.span(), &e))?;
        list.push(kind);
    }
    Optics::particles(ctx.wavelengths.nm(), host, absorption, &list)
        .map_err(|e| refused(ctx, kinds[e.kind].span(), &e.error))
}

fn sizes(ctx: &Context, file: &Located<SizesFile>) -> Result<SizeDistribution, InputError> {
    const NM: f64 = 1e-9;
    let sizes = match &**file {
        SizesFile::Single(s) => SizeDistribution::Single { radius: s.radius_nm * NM },
        SizesFile::LogNormal(s) => SizeDistribution::LogNormal { median: s.median_nm * NM, sigma: s.sigma },
        SizesFile::Gamma(s) => SizeDistribution::Gamma {
            effective_radius: s.effective_radius_nm * NM,
            effective_variance: s.effective_variance,
        },
        SizesFile::List(s) if s.radius_nm.len() != s.weight.len() => {
            return Err(ctx.error(
                file.span(),
                format!(
                    "the list of sizes has {} radii and {} weights, but one weight per radius is expected",
                    s.radius_nm.len(),
                    s.weight.len()
                ),
                "give radius_nm and weight as lists of equal length",
            ));
        }
        SizesFile::List(s) if s.weight.iter().any(|w| *w > super::context::HUGE) => {
            return Err(ctx.error(
                file.span(),
                "a weight is above 1e12",
                "give smaller weights; only their ratios matter",
            ));
        }
        SizesFile::List(s) => {
            let pairs = s.radius_nm.iter().zip(&s.weight);
            SizeDistribution::List(pairs.map(|(r, w)| [r * NM, *w]).collect())
        }
    };
    sizes.check().map_err(|e| refused(ctx, file.span(), &e.into()))?;
    Ok(sizes)
}

fn amount(file: &AmountFile) -> Amount {
    match file {
        AmountFile::VolumeFraction(f) => Amount::VolumeFraction(*f),
        AmountFile::PerM3(n) => Amount::NumberDensity(*n),
        AmountFile::Mass(m) => Amount::Mass { concentration: m.grams_per_litre, density: m.density },
    }
}

fn milk(ctx: &Context, m: &MilkFile, span: Range<usize>) -> Result<Optics, InputError> {
    let milk = presets::Milk {
        fat_percent: ctx.number(&m.fat_percent, "fat_percent", 0.0..=20.0)?,
        protein_percent: ctx.number(&m.protein_percent, "protein_percent", 0.0..=20.0)?,
        homogenization_mpa: ctx.number(&m.homogenization_mpa, "homogenization_mpa", 0.0..=100.0)?,
        concentration: ctx.number(&m.concentration, "concentration", 0.0..=1.0)?,
    };
    milk.optics(&ctx.wavelengths).map_err(|e| refused(ctx, span, &e))
}

fn polystyrene(ctx: &Context, p: &PolystyreneFile, span: Range<usize>) -> Result<Optics, InputError> {
    let mean = 0.5e-9 * ctx.number(&p.diameter_nm, "diameter_nm", 1.0..=1e5)?;
    let spread = ctx.number(&p.spread, "spread", 0.0..=1.0)?;
    let sizes = if spread < 1e-3 {
        SizeDistribution::Single { radius: mean }
    } else {
        // Compute the parameters of the log-normal distribution with the given mean and standard deviation.
        let variance = (spread * spread).ln_1p();
        SizeDistribution::LogNormal { median: mean * (-0.5 * variance).exp(), sigma: variance.sqrt() }
    };
    let amount = amount(&p.amount);
    amount.number_density(&sizes).map_err(|e| refused(ctx, p.amount.span(), &e))?;
    presets::polystyrene(sizes, amount, &ctx.wavelengths).map_err(|e| refused(ctx, span, &e))
}
