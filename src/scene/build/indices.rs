//! Reads refractive indices per wavelength, from values in the scene file or from names in the optical
//! constants.

use super::context::Context;
use base::locate::{InputError, Located};
use optics::spectrum::{MAX_WAVELENGTHS, Spectral, max_lane};
use std::ops::Range;
use syntax::material::MaterialFile;
use syntax::values::{IndexFile, SpectrumFile};
use transport::material;
use transport::material::constants::ConstantsError;

/// Name of the ideal mirror among the metals.
const MIRROR: &str = "mirror";

/// Extinction coefficient k of the ideal mirror, dimensionless. With n = 0, this value of k reflects all
/// light and gives both polarizations the same phase shift.
const MIRROR_K: f32 = 1e6;

/// Returns the refractive index of a transparent substance per wavelength. Unused lanes are 0.
pub(super) fn index(ctx: &Context, index: &Located<IndexFile>, what: &str) -> Result<Spectral, InputError> {
    let name = match &**index {
        IndexFile::Values(s) => return ctx.spectrum(s, index.span(), what, 1.0..=10.0),
        IndexFile::Named(name) => name,
    };
    let (n, k) = constants(ctx, name, index.span())?;
    if max_lane(k) > 1e-3 {
        return Err(ctx.error(
            index.span(),
            format!(
                "the material `{name}` is not transparent: the extinction coefficient k is up to {}",
                max_lane(k)
            ),
            "use a conductor, or give the refractive index as a number",
        ));
    }
    Ok(n)
}

/// Returns the refractive index n and the extinction coefficient k of an absorbing substance per wavelength.
/// The substance is given by name or by values. In unused lanes, n is 1.
pub(super) fn complex_index(
    ctx: &Context,
    place: &Located<MaterialFile>,
    metal: &Option<Located<String>>,
    n: &Option<Located<SpectrumFile>>,
    k: &Option<Located<SpectrumFile>>,
) -> Result<(Spectral, Spectral), InputError> {
    let unused = Spectral::ONE - ctx.wavelengths.ones();
    match (metal, n, k) {
        (None, Some(n), Some(k)) => {
            Ok((ctx.located(n, "n", 1e-6..=100.0)? + unused, ctx.located(k, "k", 0.0..=100.0)?))
        }
        (Some(name), None, None) if name.as_str() == MIRROR => Ok((unused, Spectral::splat(MIRROR_K))),
        (Some(name), None, None) => {
            let (n, k) = constants(ctx, name, name.span())?;
            Ok((n + unused, k))
        }
        (metal, n, k) => {
            let given = [("metal", metal.is_some()), ("n", n.is_some()), ("k", k.is_some())];
            let given: Vec<&str> =
                given.iter().filter(|(_, is_given)| *is_given).map(|(key, _)| *key).collect();
            let found = if given.is_empty() { "neither".to_owned() } else { given.join(" and ") };
            Err(ctx.error(
                place.span(),
                format!("expected either `metal` or both `n` and `k`, got {found}"),
                "give metal = \"NAME\" (or \"mirror\"), or both n and k",
            ))
        }
    }
}

/// Returns the refractive index n and the extinction coefficient k of a named substance per wavelength of the
/// scene in f64. Unused rows are zero.
pub(super) fn constants_f64(
    ctx: &Context,
    name: &str,
    span: Range<usize>,
) -> Result<[[f64; 2]; MAX_WAVELENGTHS], InputError> {
    let mut rows = [[0.0; 2]; MAX_WAVELENGTHS];
    for (row, nm) in rows.iter_mut().zip(ctx.wavelengths.nm()) {
        let (n, k) = material::constants::lookup(name, *nm).map_err(|e| {
            ctx.error(
                span.clone(),
                e.to_string(),
                match e {
                    ConstantsError::Unknown { .. } => "use one of the known names, or give numbers",
                    ConstantsError::Range { .. } => "give numbers, or change wavelengths_nm",
                },
            )
        })?;
        *row = [n, k];
    }
    Ok(rows)
}

/// Returns the refractive index n and the extinction coefficient k of a named substance per wavelength in
/// f32. Unused lanes are 0.
pub(super) fn constants(
    ctx: &Context,
    name: &str,
    span: Range<usize>,
) -> Result<(Spectral, Spectral), InputError> {
    let rows = constants_f64(ctx, name, span)?;
    let column = |i: usize| Spectral::new(rows.map(|row| row[i] as f32));
    Ok((column(0), column(1)))
}
