//! Images and checkerboards of a file → the flat table of [`Textures`]. Texels of a file that is named twice are kept once.

use super::context::Context;
use base::locate::{InputError, Located};
use import::picture::{self, Channels};
use optics::spectrum::Spectral;
use std::collections::BTreeMap;
use std::ops::{Range, RangeInclusive};
use std::path::PathBuf;
use syntax::material::NormalMapFile;
use syntax::texture::{AlbedoFile, CheckerboardFile, ImageAlbedo, ScalarFile, UvRows};
use syntax::values::SpectrumFile;
use transport::material::texture::{Filter, Image, SAME, Scalar, Spectrum, Textures, UvMap, Wrap};

/// The images that have been read: size and first texel.
#[derive(Default)]
pub(crate) struct Images(BTreeMap<(PathBuf, Channels), ([u32; 2], u32)>);

/// Most that an image of albedos may be multiplied by.
const BRIGHTEST: f64 = 2.0;

/// The same image with texels times a factor above 1, none brighter than 1.
fn brightened(ctx: &mut Context, textures: &mut Textures, texture: u32, factor: Spectral, name: &str) -> u32 {
    let image = textures.images[texture as usize];
    let first = image.first as usize;
    let mut texels = textures.texels[first..first + (image.width * image.height) as usize].to_vec();
    let mut limited = 0;
    for texel in &mut texels {
        let bright = Spectral::new(*texel) * factor;
        let most = bright.min(Spectral::ONE);
        limited += usize::from(bright.to_array() != most.to_array());
        *texel = most.to_array();
    }
    if limited > 0 {
        ctx.notes.push(format!(
            "{name}: {limited} of {} texels are limited to an albedo of 1",
            texels.len()
        ));
    }
    textures.images.push(Image {
        first: textures.texels.len() as u32,
        ..image
    });
    textures.texels.append(&mut texels);
    textures.images.len() as u32 - 1
}

/// A spectrum of 0..1, an image of colours or a checkerboard.
pub(super) fn spectrum(
    ctx: &mut Context,
    images: &mut Images,
    textures: &mut Textures,
    albedo: &Located<AlbedoFile>,
) -> Result<Spectrum, InputError> {
    let span = albedo.span();
    Ok(match &**albedo {
        AlbedoFile::Spectrum(s) => Spectrum::uniform(ctx.spectrum(s, span, "albedo", 0.0..=1.0)?),
        AlbedoFile::Image(i) => {
            let scale = SpectrumFile::Scalar(i.scale);
            let channels = if i.raw {
                Channels::LinearColours
            } else {
                Channels::Colours
            };
            let value = ctx.spectrum(&scale, span, "scale", 0.0..=BRIGHTEST)?;
            let texture = image(ctx, images, textures, i, channels)?;
            let (value, texture) = if i.scale > 1.0 {
                (
                    ctx.wavelengths.ones(),
                    brightened(ctx, textures, texture, value, &i.image),
                )
            } else {
                (value, texture)
            };
            Spectrum {
                value,
                texture: Some(texture),
            }
        }
        AlbedoFile::Checkerboard(board) => {
            let mut values = [Spectral::ZERO; 2];
            for (value, file) in values.iter_mut().zip(&board.checkerboard) {
                *value = ctx.spectrum(file, span.clone(), "albedo", 0.0..=1.0)?;
            }
            Spectrum {
                value: ctx.wavelengths.ones(),
                texture: Some(checkerboard(ctx, textures, board, values, span)?),
            }
        }
    })
}

/// A number within `range`, an image scaled to it or a checkerboard.
pub(super) fn scalar(
    ctx: &mut Context,
    images: &mut Images,
    textures: &mut Textures,
    s: &Located<ScalarFile>,
    what: &str,
    range: RangeInclusive<f64>,
) -> Result<Scalar, InputError> {
    let span = s.span();
    let (value, texture) = match &**s {
        ScalarFile::Number(v) => (ctx.within(*v, span, what, &range)?, None),
        ScalarFile::Image(i) => {
            let scale = ctx.within(i.scale, span, what, &range)?;
            (scale, Some(image(ctx, images, textures, i, Channels::Numbers)?))
        }
        ScalarFile::Checkerboard(board) => {
            let mut values = [Spectral::ZERO; 2];
            for (value, file) in values.iter_mut().zip(&board.checkerboard) {
                let SpectrumFile::Scalar(v) = file else {
                    return Err(ctx.error(
                        span,
                        format!("{what} has a spectrum in its squares"),
                        "give two numbers",
                    ));
                };
                *value = Spectral::splat(ctx.within(*v, span.clone(), what, &range)? as f32);
            }
            (1.0, Some(checkerboard(ctx, textures, board, values, span)?))
        }
    };
    Ok(Scalar {
        value: value as f32,
        texture,
    })
}

/// An image of radiances over a surface: as it is if its file holds linear values, decoded otherwise.
pub(super) fn radiances(
    ctx: &mut Context,
    images: &mut Images,
    textures: &mut Textures,
    file: &ImageAlbedo,
) -> Result<u32, InputError> {
    let channels = if file.raw || holds_light(&file.image) {
        Channels::LinearColours
    } else {
        Channels::Colours
    };
    image(ctx, images, textures, file, channels)
}

/// The texels of an image of the sky, for each wavelength, top row first, and its width and height.
pub(super) fn sky(
    ctx: &mut Context,
    name: &Located<String>,
) -> Result<([u32; 2], Vec<[f32; 4]>), InputError> {
    let channels = if holds_light(name) {
        Channels::LinearColours
    } else {
        Channels::Colours
    };
    let mut textures = Textures::default();
    let (size, _) = read(ctx, &mut textures, name, channels)?;
    Ok((size, textures.texels))
}

/// True of formats whose values are proportional to light.
pub(crate) fn holds_light(name: &str) -> bool {
    let extension = std::path::Path::new(name).extension().and_then(|e| e.to_str());
    matches!(
        extension.unwrap_or("").to_ascii_lowercase().as_str(),
        "exr" | "hdr" | "pic" | "rgbe"
    )
}

/// The image of a normal map.
pub(super) fn normals(
    ctx: &mut Context,
    images: &mut Images,
    textures: &mut Textures,
    n: &NormalMapFile,
) -> Result<u32, InputError> {
    let file = ImageAlbedo {
        uv: n.uv,
        wrap: n.wrap,
        filter: n.filter,
        ..ImageAlbedo::new("")
    };
    let file = ImageAlbedo {
        image: n.image.clone(),
        ..file
    };
    image(ctx, images, textures, &file, Channels::Numbers)
}

/// The map of texture coordinates.
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
        "uv holds numbers that are not finite",
        "give [[a, b, c], [d, e, f]]: u' = a u + b v + c, v' = d u + e v + f",
    ))
}

/// Two by two texels.
fn checkerboard(
    ctx: &Context,
    textures: &mut Textures,
    board: &CheckerboardFile,
    [a, b]: [Spectral; 2],
    span: Range<usize>,
) -> Result<u32, InputError> {
    let uv = uv_map(ctx, board.uv.as_ref(), span)?;
    let first = textures.texels.len() as u32;
    textures.texels.extend([b, a, a, b].map(Spectral::to_array));
    textures.images.push(Image {
        filter: Filter::Nearest,
        wrap: Wrap::Repeat,
        uv,
        ..Image::new([2, 2], first)
    });
    Ok(textures.images.len() as u32 - 1)
}

fn image(
    ctx: &mut Context,
    images: &mut Images,
    textures: &mut Textures,
    file: &ImageAlbedo,
    channels: Channels,
) -> Result<u32, InputError> {
    let name = &file.image;
    let uv = uv_map(ctx, file.uv.as_ref(), name.span())?;
    let key = (ctx.path(name), channels);
    let (size, first) = if let Some(known) = images.0.get(&key) {
        *known
    } else {
        let known = read(ctx, textures, name, channels)?;
        images.0.insert(key, known);
        known
    };
    textures.images.push(Image {
        filter: file.filter,
        wrap: file.wrap,
        uv,
        ..Image::new(size, first)
    });
    Ok(textures.images.len() as u32 - 1)
}

/// Reads the texels of an image: colours as red, green or blue for each wavelength, numbers as they are.
fn read(
    ctx: &mut Context,
    textures: &mut Textures,
    name: &Located<String>,
    channels: Channels,
) -> Result<([u32; 2], u32), InputError> {
    let bytes = ctx.read(name, name.span())?;
    let image = image::load_from_memory(&bytes).map_err(|e| {
        ctx.error(
            name.span(),
            format!("cannot decode {}: {e}", ctx.path(name).display()),
            "use a PNG, JPEG, OpenEXR or Radiance HDR file",
        )
    })?;
    let first = textures.texels.len() as u32;
    picture::texels(&image, channels, &ctx.wavelengths, &mut textures.texels);
    Ok(([image.width(), image.height()], first))
}
