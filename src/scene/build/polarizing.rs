//! Converts polarizing materials of a file to tables: coated mirrors, polarizer and retarder sheets, and
//! crystals.

use super::context::Context;
use super::indices::{complex_index, constants, constants_f64, index};
use base::locate::{InputError, Located};
use glam::{DVec3, Vec3A};
use optics::polarization::thin_film::Film;
use optics::spectrum::{MAX_WAVELENGTHS, Spectral};
use syntax::material::{
    CoatedConductorFile, CrystalFile, FilmFile, MaterialFile, PolarizerFile, RetarderFile, TiltFile,
};
use syntax::values::{IndexFile, SpectrumFile};
use transport::material::coated_conductor::{CoatedConductor, MAX_FILMS};
use transport::material::crystal::Crystal;
use transport::material::dielectric::Dielectric;
use transport::material::polarizer::{Passes, Polarizer};
use transport::material::retarder::{Retarder, Tilt};
use transport::material::sheet::SheetAxis;
use transport::material::varies;

/// Names of the uniaxial crystals in the optical constants. The constants list each crystal twice: with the
/// suffix `_o` for the ordinary and `_e` for the extraordinary index.
const CRYSTALS: [&str; 3] = ["calcite", "quartz", "sapphire"];

pub(super) fn coated(
    ctx: &Context,
    place: &Located<MaterialFile>,
    file: &CoatedConductorFile,
) -> Result<CoatedConductor, InputError> {
    let (n, k) = complex_index(ctx, place, &file.metal, &file.n, &file.k)?;
    if file.films.len() > MAX_FILMS {
        return Err(ctx.error(
            file.films.span(),
            format!("the list has more than {MAX_FILMS} films: got {} films", file.films.len()),
            format!("give at most {MAX_FILMS} films"),
        ));
    }
    let mut films = [Film::NONE; MAX_FILMS];
    for (slot, file) in films.iter_mut().zip(file.films.iter()) {
        *slot = film(ctx, file)?;
    }
    Ok(CoatedConductor { n, k, films, count: file.films.len() })
}

fn film(ctx: &Context, film: &FilmFile) -> Result<Film, InputError> {
    let unused = Spectral::ONE - ctx.wavelengths.ones();
    let (n, k) = match (&*film.ior, &film.k) {
        (IndexFile::Named(name), None) => constants(ctx, name, film.ior.span())?,
        (IndexFile::Named(name), Some(k)) => {
            return Err(ctx.error(
                k.span(),
                format!("k is given twice: the optical constants of `{name}` already contain k"),
                "remove k, or give ior as a number",
            ));
        }
        (IndexFile::Values(n), k) => (
            ctx.spectrum(n, film.ior.span(), "ior", 1e-3..=100.0)?,
            k.as_ref().map_or(Ok(Spectral::ZERO), |k| ctx.located(k, "k", 0.0..=100.0))?,
        ),
    };
    let thickness = ctx.number(&film.thickness_nm, "thickness_nm", 0.0..=100_000.0)?;
    Ok(Film { n: n + unused, k, waves: ctx.wavelengths.map(|nm| (thickness / nm) as f32) })
}

pub(super) fn polarizer(ctx: &Context, file: &PolarizerFile) -> Result<Polarizer, InputError> {
    let axial = file.angle_deg.as_ref().map(Located::span).or(file.axis.as_ref().map(Located::span));
    if let (true, Some(at)) = (file.passes != Passes::Linear, axial) {
        return Err(ctx.error(at, "a circular polarizer has no axis", "remove angle_deg and axis"));
    }
    Ok(Polarizer {
        passes: file.passes,
        axis: sheet_axis(ctx, &file.angle_deg, &file.axis)?,
        transmittance: ctx.located(&file.transmittance, "transmittance", 0.0..=1.0)?,
        extinction: ctx.located(&file.extinction, "extinction", 0.0..=1.0)?,
    })
}

pub(super) fn retarder(
    ctx: &Context,
    place: &Located<MaterialFile>,
    file: &RetarderFile,
) -> Result<Retarder, InputError> {
    let retardance = match (&file.retardance_deg, &file.retardance_nm) {
        (Some(deg), None) => {
            ctx.located(deg, "retardance_deg", 0.0..=36_000.0)? * Spectral::splat(1_f32.to_radians())
        }
        (None, Some(nm)) => {
            let waves_per_nm = ctx.wavelengths.map(|nm| (std::f64::consts::TAU / nm) as f32);
            ctx.located(nm, "retardance_nm", 0.0..=100_000.0)? * waves_per_nm
        }
        (deg, _) => {
            let got = if deg.is_some() { "both" } else { "neither" };
            return Err(ctx.error(
                place.span(),
                format!("expected exactly one of retardance_deg and retardance_nm, got {got}"),
                "give either retardance_deg (90 for a quarter-wave plate) or retardance_nm",
            ));
        }
    };
    let tilt = match (file.tilt, &file.ior) {
        (TiltFile::Plate, ior) => {
            let ior = ior.as_ref().map_or(Ok(1.55), |ior| ctx.number(ior, "ior", 1.0..=10.0))?;
            Tilt::Plate(ior as f32)
        }
        (_, Some(ior)) => {
            return Err(ctx.error(
                ior.span(),
                "ior is used only with tilt = \"plate\"",
                "remove ior, or set tilt = \"plate\"",
            ));
        }
        (TiltFile::Constant, None) => Tilt::Constant,
        (TiltFile::Cosine, None) => Tilt::Cosine,
    };
    Ok(Retarder {
        axis: sheet_axis(ctx, &file.angle_deg, &file.axis)?,
        retardance,
        transmittance: ctx.located(&file.transmittance, "transmittance", 0.0..=1.0)?,
        tilt,
    })
}

pub(super) fn crystal(
    ctx: &Context,
    place: &Located<MaterialFile>,
    file: &CrystalFile,
) -> Result<Crystal, InputError> {
    let (n_o, n_e) = crystal_indices(ctx, place, file)?;
    let exterior = index(ctx, &file.exterior_ior, "exterior_ior")? + Spectral::ONE - ctx.wavelengths.ones();
    let mut interior = [1.0; MAX_WAVELENGTHS];
    let (mut waves_per_m, mut bandwidth) = ([0.0; MAX_WAVELENGTHS], [0.0; MAX_WAVELENGTHS]);
    let width = ctx.number(&file.bandwidth_nm, "bandwidth_nm", 0.0..=1000.0)?;
    for (i, nm) in ctx.wavelengths.nm().iter().enumerate() {
        interior[i] = f64::midpoint(n_o[i], n_e[i]) as f32;
        waves_per_m[i] = 1e9 / nm;
        bandwidth[i] = width / nm;
    }
    if *file.split && width > 0.0 {
        return Err(ctx.error(
            file.bandwidth_nm.span(),
            "bandwidth_nm has no effect with split = true, because the split rays are incoherent",
            "remove one of the two keys",
        ));
    }
    if let (true, Some(roughness)) = (*file.split, &file.roughness) {
        return Err(ctx.error(
            roughness.span(),
            "split = true requires smooth faces: rough facets do not split ordinary and extraordinary rays",
            "remove either `roughness` or `split`",
        ));
    }
    let interior = Spectral::new(interior);
    let count = ctx.wavelengths.count();
    Ok(Crystal {
        faces: Dielectric {
            interior,
            exterior,
            dispersive: varies(interior, count) || varies(exterior, count),
        },
        axis: direction(ctx, &file.axis)?,
        n_o,
        n_e,
        waves_per_m,
        bandwidth,
        split: *file.split,
    })
}

/// Returns the ordinary and extraordinary refractive indices n_o and n_e per wavelength. Unused lanes are 1.
fn crystal_indices(
    ctx: &Context,
    place: &Located<MaterialFile>,
    file: &CrystalFile,
) -> Result<([f64; MAX_WAVELENGTHS], [f64; MAX_WAVELENGTHS]), InputError> {
    let count = ctx.wavelengths.count();
    let used = |column: [f64; MAX_WAVELENGTHS]| {
        std::array::from_fn(|lane| if lane < count { column[lane] } else { 1.0 })
    };
    match (&file.name, &file.n_o, &file.n_e) {
        (Some(name), None, None) => {
            let plain = name.trim().to_lowercase();
            if !CRYSTALS.contains(&plain.as_str()) {
                return Err(ctx.error(
                    name.span(),
                    format!("unknown crystal `{}`", **name),
                    format!("use one of: {}; or give n_o and n_e", CRYSTALS.join(", ")),
                ));
            }
            let n = |ray: &str| {
                let rows = constants_f64(ctx, &format!("{plain}_{ray}"), name.span())?;
                Ok(used(rows.map(|[n, _]| n)))
            };
            Ok((n("o")?, n("e")?))
        }
        (None, Some(n_o), Some(n_e)) => {
            let n = |s: &Located<SpectrumFile>, what| {
                // Keep f64, because a retardance is an index difference times thousands of waves.
                let list = ctx.values(s, s.span(), what, 1.0..=10.0)?;
                Ok(std::array::from_fn(|i| list.get(i).copied().unwrap_or(1.0)))
            };
            Ok((n(n_o, "n_o")?, n(n_e, "n_e")?))
        }
        _ => Err(ctx.error(
            place.span(),
            "expected either the name of a crystal or both n_o and n_e",
            "give name = \"calcite\", or both n_o and n_e",
        )),
    }
}

/// Returns the axis of a polarizer or retarder sheet: an angle or a direction. The default is 0°.
fn sheet_axis(
    ctx: &Context,
    angle_deg: &Option<Located<f64>>,
    axis: &Option<Located<[f64; 3]>>,
) -> Result<SheetAxis, InputError> {
    match (angle_deg, axis) {
        (None, None) => Ok(SheetAxis::Angle(0.0)),
        (Some(angle), None) => {
            let angle = ctx.number(angle, "angle_deg", -36_000.0..=36_000.0)?;
            Ok(SheetAxis::Angle(angle.to_radians() as f32))
        }
        (None, Some(axis)) => Ok(SheetAxis::World(direction(ctx, axis)?)),
        (Some(_), Some(axis)) => Err(ctx.error(
            axis.span(),
            "the axis is given both by angle_deg and by axis",
            "remove one of the two keys",
        )),
    }
}

fn direction(ctx: &Context, axis: &Located<[f64; 3]>) -> Result<Vec3A, InputError> {
    DVec3::from_array(**axis).try_normalize().map(glam::DVec3::as_vec3a).ok_or_else(|| {
        ctx.error(
            axis.span(),
            format!("axis is {:?}, which has no direction", **axis),
            "give three numbers that are not all zero",
        )
    })
}
