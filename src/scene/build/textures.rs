//! Converts images and checkerboards of a file to the flat tables of [`Context::textures`]. The
//! texels of a file are stored once, even if several materials use the file.

use super::attributes;
use super::context::Context;
use base::locate::{InputError, Located};
use import::picture::{self, Channels, Pixels};
use optics::spectrum::Spectral;
use std::collections::BTreeMap;
use std::ops::{Range, RangeInclusive};
use std::path::PathBuf;
use syntax::material::NormalMapFile;
use syntax::texture::{AlbedoFile, CheckerboardFile, ImageAlbedo, ScalarFile, UvRows};
use syntax::values::SpectrumFile;
use transport::material::texture::{ATTRIBUTE, Filter, Image, SAME, Scalar, Spectrum, UvMap, Wrap};

/// Key of stored texels: the file, the layer, and the meaning of the channels.
type ImageKey = (PathBuf, Option<String>, Channels);

/// Images that have been read, each with its width and height in pixels and the index of its first texel.
#[derive(Default)]
pub(crate) struct Images(BTreeMap<ImageKey, ([u32; 2], u32)>);

/// Largest factor by which an albedo image can be multiplied.
const BRIGHTEST: f64 = 2.0;

/// Creates a copy of an image with texels multiplied by a factor above 1 and clamped to 1.
fn brightened(ctx: &mut Context, texture: u32, factor: Spectral, name: &str) -> u32 {
    let image = ctx.textures.images[texture as usize];
    let first = image.first as usize;
    let mut texels = ctx.textures.texels[first..first + (image.width * image.height) as usize].to_vec();
    let mut limited = 0;
    for texel in &mut texels {
        let bright = Spectral::new(*texel) * factor;
        let most = bright.min(Spectral::ONE);
        limited += usize::from(bright.to_array() != most.to_array());
        *texel = most.to_array();
    }
    if limited > 0 {
        ctx.note(format!("{name}: the albedo is limited to 1 at {limited} of {} texels", texels.len()));
    }
    ctx.textures.images.push(Image { first: ctx.textures.texels.len() as u32, ..image });
    ctx.textures.texels.append(&mut texels);
    ctx.textures.images.len() as u32 - 1
}

/// Returns a spectrum with values 0..1, a colour image or a checkerboard.
pub(super) fn spectrum(ctx: &mut Context, albedo: &Located<AlbedoFile>) -> Result<Spectrum, InputError> {
    let span = albedo.span();
    Ok(match &**albedo {
        AlbedoFile::Spectrum(s) => Spectrum::uniform(ctx.spectrum(s, span, "albedo", 0.0..=1.0)?),
        AlbedoFile::Image(i) => {
            let scale = SpectrumFile::Scalar(i.scale);
            let channels = if i.raw { Channels::LinearColours } else { Channels::Colours };
            let value = ctx.spectrum(&scale, span, "scale", 0.0..=BRIGHTEST)?;
            let texture = image(ctx, i, channels)?;
            let (value, texture) = if i.scale > 1.0 {
                (ctx.wavelengths.ones(), brightened(ctx, texture, value, &i.image))
            } else {
                note_reflectance_above_one(ctx, texture, value, &i.image);
                (value, texture)
            };
            Spectrum { value, texture: Some(texture) }
        }
        AlbedoFile::Attribute(file) => {
            attributes::ask(ctx, file, false)?;
            let scale = SpectrumFile::Scalar(file.scale);
            Spectrum {
                value: ctx.spectrum(&scale, span, "scale", 0.0..=BRIGHTEST)?,
                texture: Some(ATTRIBUTE),
            }
        }
        AlbedoFile::Checkerboard(board) => {
            let mut values = [Spectral::ZERO; 2];
            for (value, file) in values.iter_mut().zip(&board.checkerboard) {
                *value = ctx.spectrum(file, span.clone(), "albedo", 0.0..=1.0)?;
            }
            Spectrum { value: ctx.wavelengths.ones(), texture: Some(checkerboard(ctx, board, values, span)?) }
        }
    })
}

fn note_reflectance_above_one(ctx: &mut Context, number: u32, scale: Spectral, name: &Located<String>) {
    let image = ctx.textures.images[number as usize];
    let (first, count) = (image.first as usize, (image.width * image.height) as usize);
    let scale = scale.to_array();
    let above = |t: &&[f32; 4]| t.iter().zip(scale).any(|(v, s)| v * s > 1.0);
    let bright = ctx.textures.texels[first..first + count].iter().filter(above).count();
    if bright > 0 {
        let note = format!(
            "{}: {bright} texels are above 1, so the surface reflects more light than it receives",
            **name
        );
        ctx.note(note);
    }
}

/// Returns a number within `range`, an image whose values are scaled to `range`, or a checkerboard.
pub(super) fn scalar(
    ctx: &mut Context,
    s: &Located<ScalarFile>,
    what: &str,
    range: RangeInclusive<f64>,
) -> Result<Scalar, InputError> {
    let span = s.span();
    let (value, texture) = match &**s {
        ScalarFile::Number(v) => (ctx.within(*v, span, what, &range)?, None),
        ScalarFile::Image(i) => {
            let scale = ctx.within(i.scale, span, what, &range)?;
            (scale, Some(image(ctx, i, numbers(i))?))
        }
        ScalarFile::Attribute(file) => {
            attributes::ask(ctx, file, true)?;
            (ctx.within(file.scale, span, what, &range)?, Some(ATTRIBUTE))
        }
        ScalarFile::Checkerboard(board) => {
            let mut values = [Spectral::ZERO; 2];
            for (value, file) in values.iter_mut().zip(&board.checkerboard) {
                let SpectrumFile::Scalar(v) = file else {
                    return Err(ctx.error(
                        span,
                        format!("{what}: a checkerboard of numbers contains a spectrum"),
                        "give two numbers for the checkerboard",
                    ));
                };
                *value = Spectral::splat(ctx.within(*v, span.clone(), what, &range)? as f32);
            }
            (1.0, Some(checkerboard(ctx, board, values, span)?))
        }
    };
    Ok(Scalar { value: value as f32, texture })
}

/// Reads an image of the radiance emitted by a surface. sRGB values are decoded unless the image is declared
/// as linear (`raw`).
pub(super) fn radiances(ctx: &mut Context, file: &ImageAlbedo) -> Result<u32, InputError> {
    let channels = if file.raw { Channels::LinearColours } else { Channels::Colours };
    image(ctx, file, channels)
}

/// Returns width and height (pixels) of an environment image, and the texels per wavelength, top row first.
pub(super) fn sky(
    ctx: &mut Context,
    name: &Located<String>,
    layer: Option<&str>,
) -> Result<([u32; 2], Vec<[f32; 4]>), InputError> {
    let (size, first) = read(ctx, name, layer, Channels::Colours)?;
    Ok((size, ctx.textures.texels.split_off(first as usize)))
}

pub(super) fn heights(ctx: &mut Context, file: &Located<ImageAlbedo>) -> Result<u32, InputError> {
    ctx.within(file.scale, file.span(), "scale", &(1.0..=1.0))?;
    if file.filter == Filter::Nearest {
        bail!(
            ctx,
            file.span(),
            "a bump map requires slopes, but filter = \"nearest\" gives no slopes",
            "remove filter"
        );
    }
    image(ctx, file, numbers(file))
}

/// Returns the meaning of the channels of an image of numbers.
fn numbers(file: &ImageAlbedo) -> Channels {
    match (file.luminance, file.raw) {
        (false, _) => Channels::Numbers,
        (true, false) => Channels::Luminance,
        (true, true) => Channels::LinearLuminance,
    }
}

pub(super) fn normals(ctx: &mut Context, n: &NormalMapFile) -> Result<u32, InputError> {
    let file = ImageAlbedo {
        uv: n.uv,
        wrap: n.wrap,
        filter: n.filter,
        layer: n.layer.clone(),
        ..ImageAlbedo::new("")
    };
    let file = ImageAlbedo { image: n.image.clone(), ..file };
    image(ctx, &file, Channels::Numbers)
}

fn uv_map(ctx: &Context, uv: Option<&UvRows>, span: Range<usize>) -> Result<UvMap, InputError> {
    let Some(rows) = uv else {
        return Ok(SAME);
    };
    let map = rows.map(|row| row.map(|v| v as f32));
    if map.iter().flatten().all(|v| v.is_finite()) {
        return Ok(map);
    }
    Err(ctx.error(
        span,
        format!("uv is {rows:?}, which contains numbers that are not finite"),
        "give [[a, b, c], [d, e, f]]: u' = a u + b v + c, v' = d u + e v + f",
    ))
}

/// Creates a checkerboard as an image of 2 × 2 texels.
fn checkerboard(
    ctx: &mut Context,
    board: &CheckerboardFile,
    [a, b]: [Spectral; 2],
    span: Range<usize>,
) -> Result<u32, InputError> {
    ctx.attributes.has_image();
    let uv = uv_map(ctx, board.uv.as_ref(), span)?;
    let first = ctx.textures.texels.len() as u32;
    ctx.textures.texels.extend([b, a, a, b].map(Spectral::to_array));
    ctx.textures.images.push(Image {
        filter: Filter::Nearest,
        wrap: Wrap::Repeat,
        uv,
        ..Image::new([2, 2], first)
    });
    Ok(ctx.textures.images.len() as u32 - 1)
}

fn image(ctx: &mut Context, file: &ImageAlbedo, channels: Channels) -> Result<u32, InputError> {
    let name = &file.image;
    if file.luminance && matches!(channels, Channels::Colours | Channels::LinearColours) {
        return Err(ctx.error(
            name.span(),
            "`luminance` requires an image of numbers, but this image is used for colours",
            "remove `luminance`",
        ));
    }
    ctx.attributes.has_image();
    let uv = uv_map(ctx, file.uv.as_ref(), name.span())?;
    let layer = file.layer.as_deref();
    let key = (ctx.path(name), file.layer.clone(), channels);
    let (size, first) = if let Some(known) = ctx.images.0.get(&key) {
        *known
    } else {
        let known = read(ctx, name, layer, channels)?;
        ctx.images.0.insert(key, known);
        known
    };
    ctx.textures.images.push(Image { filter: file.filter, wrap: file.wrap, uv, ..Image::new(size, first) });
    Ok(ctx.textures.images.len() as u32 - 1)
}

/// Reads the texels of an image. For a colour image, each wavelength receives the red, green or blue value.
/// The values of an image of numbers are unchanged.
fn read(
    ctx: &mut Context,
    name: &Located<String>,
    layer: Option<&str>,
    channels: Channels,
) -> Result<([u32; 2], u32), InputError> {
    let image = decoded(ctx, name, layer)?;
    let first = ctx.textures.texels.len();
    picture::texels(&image, channels, &ctx.wavelengths, &mut ctx.textures.texels);
    let lanes = match channels {
        Channels::Numbers | Channels::Luminance | Channels::LinearLuminance => 3,
        _ => ctx.wavelengths.count(),
    };
    let least = match channels {
        Channels::Numbers => f32::MIN,
        _ => 0.0,
    };
    let values = ctx.textures.texels[first..].iter().flat_map(|t| &t[..lanes]);
    let wrong: Vec<f32> = values.copied().filter(|v| !(least..=1e30).contains(v)).collect();
    if let Some(first) = wrong.first() {
        return Err(ctx.error(
            name.span(),
            format!(
                "{}: {} values are outside {least:e}..1e30, and the first of them is {first:e}",
                ctx.path(name).display(),
                wrong.len()
            ),
            "correct the values in the image",
        ));
    }
    Ok(([image.width as u32, image.height as u32], first as u32))
}

/// Reads and decodes an image, and adds the decoder's notes to the scene's notes.
pub(super) fn decoded(
    ctx: &mut Context,
    name: &Located<String>,
    layer: Option<&str>,
) -> Result<Pixels, InputError> {
    let bytes = ctx.read(name, name.span())?;
    let image = picture::decode(name, &bytes, layer).map_err(|e| {
        ctx.error(name.span(), format!("cannot decode {}: {}", ctx.path(name).display(), e.message), e.help)
    })?;
    let notes = image.notes.iter().map(|note| format!("{}: {note}", **name));
    ctx.notes.extend(notes);
    Ok(image)
}
