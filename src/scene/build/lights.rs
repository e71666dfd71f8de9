//! Converts emitters and emissive objects of a scene file to the renderer's lights.

use super::context::{Context, HUGE};
use super::devices::vector;
use super::pose::pose;
use super::shapes::{Solid, transform};
use super::textures;
use crate::ies;
use base::locate::{InputError, Located};
use glam::{Mat3A, Vec2, Vec3A};
use import::picture;
use optics::polarization::elements;
use optics::polarization::mueller::Mueller;
use std::ops::Range;
use syntax::device::{EmitterFile, SlideFile};
use syntax::emitter::{BeamFile, DirectionalFile, EmissionFile, EnvironmentFile, IesFile, Rows, SpotFile};
use syntax::texture::ImageAlbedo;
use transport::device::emitter::{Environment, PointEmitter, Slide};
use transport::light::Lights;
use transport::light::area::AreaLight;
use transport::light::distant::{Across, Distant};
use transport::light::filter::Polarized;
use transport::light::profile::{Frustum, Profile, Table};
use transport::light::sky::Sky;
use transport::material::texture::Spectrum;

/// Lights built from all emitters except the projector and emissive objects.
#[derive(Default)]
pub(crate) struct Emitters {
    pub points: Vec<PointEmitter>,
    pub environment: Option<Environment>,
    /// Lights other than emissive surfaces.
    pub lights: Lights,
}

/// Builds the lights of `[[emitters]]`. [`slides`] adds the images that emitters project.
pub(crate) fn emitters(ctx: &mut Context, list: &[Located<EmitterFile>]) -> Result<Emitters, InputError> {
    let mut all = Emitters::default();
    for e in list {
        let at = e.span();
        match &**e {
            EmitterFile::Point(p) => all.points.push(PointEmitter {
                position: vector(ctx, p.position, at.clone(), "position")?,
                intensity: ctx.located(&p.intensity, "intensity", 0.0..=HUGE)?,
                profile: Profile::Even,
                slide: None,
                axis: direction(ctx, p.horizontal, at, "horizontal")?,
            }),
            EmitterFile::Spot(s) => all.points.push(spot(ctx, s, at)?),
            EmitterFile::Ies(i) => all.points.push(luminaire(ctx, i, at)?),
            EmitterFile::Slide(_) => {}
            EmitterFile::Directional(d) => all.lights.distant.push(directional(ctx, d, at)?),
            EmitterFile::Beam(b) => all.lights.distant.push(beam(ctx, b, at)?),
            EmitterFile::Environment(_) if all.environment.is_some() || all.lights.sky.is_some() => {
                return Err(ctx.error(at, "duplicate environment emitter", "keep one environment"));
            }
            EmitterFile::Environment(v) => match &v.image {
                None => all.environment = Some(environment(ctx, v, at)?),
                Some(image) => all.lights.sky = Some(sky(ctx, v, image, at)?),
            },
        }
    }
    Ok(all)
}

/// Adds the projected images to the spots that [`emitters`] built, and appends image projectors after all
/// other point emitters.
pub(crate) fn slides(
    ctx: &mut Context,
    list: &[Located<EmitterFile>],
    points: &mut Vec<PointEmitter>,
) -> Result<(), InputError> {
    let mut number = 0;
    for e in list {
        match &**e {
            EmitterFile::Spot(s) => {
                points[number].slide = spot_slide(ctx, s, e.span())?;
                number += 1;
            }
            EmitterFile::Point(_) | EmitterFile::Ies(_) => number += 1,
            _ => {}
        }
    }
    for e in list {
        if let EmitterFile::Slide(s) = &**e {
            points.push(slide(ctx, s)?);
        }
    }
    Ok(())
}

fn spot_slide(ctx: &mut Context, s: &SpotFile, at: Range<usize>) -> Result<Option<Slide>, InputError> {
    let Some(image) = &s.image else {
        return match s.up {
            None => Ok(None),
            Some(_) => Err(ctx.error(at, "a spot without an image cannot have `up`", "remove `up`")),
        };
    };
    let cutoff = ctx.number(&s.cutoff_deg, "cutoff_deg of a spot with an image", 0.01..=89.9)?;
    let z = direction(ctx, s.direction, at.clone(), "direction")?;
    let given = s.up.unwrap_or([0.0, 1.0, 0.0]);
    let up = vector(ctx, given, at.clone(), "up")?;
    let Some(x) = z.cross(up).try_normalize() else {
        return Err(ctx.error(
            at,
            format!("the vector `up` is {given:?}, which is parallel to the direction of the emitter"),
            "give an `up` vector that is not parallel to the direction",
        ));
    };
    let half = Vec2::splat(cutoff.to_radians().tan() as f32);
    Ok(Some(Slide {
        frustum: Frustum { to_local: Mat3A::from_cols(x, z.cross(x), z).transpose(), half },
        texture: projected(ctx, image)?,
    }))
}

fn slide(ctx: &mut Context, s: &SlideFile) -> Result<PointEmitter, InputError> {
    let (position, axes) = pose(ctx, &s.pose)?;
    let texture = projected(ctx, &s.image)?;
    let fov = ctx.number(&s.fov_x_deg, "fov_x_deg", 0.01..=179.0)?;
    let x = (fov.to_radians() / 2.0).tan() as f32;
    let image = &ctx.textures.images[texture as usize];
    let frustum = Frustum {
        to_local: axes.transpose(),
        half: Vec2::new(x, x * image.height as f32 / image.width as f32),
    };
    Ok(PointEmitter {
        position,
        intensity: ctx.located(&s.irradiance, "irradiance", 0.0..=HUGE)?,
        profile: Profile::Frustum(frustum),
        slide: Some(Slide { frustum, texture }),
        axis: axes.x_axis,
    })
}

fn projected(ctx: &mut Context, image: &Located<ImageAlbedo>) -> Result<u32, InputError> {
    ctx.within(image.scale, image.span(), "scale", &(1.0..=1.0))?;
    textures::radiances(ctx, image)
}

fn direction(ctx: &Context, v: [f64; 3], at: Range<usize>, what: &str) -> Result<Vec3A, InputError> {
    vector(ctx, v, at.clone(), what)?
        .try_normalize()
        .ok_or_else(|| ctx.error(at, format!("{what} has zero length"), "give a direction such as [1, 0, 0]"))
}

/// Returns the Stokes reference frame and the polarization filter of an emitter.
fn polarized(
    ctx: &Context,
    stokes: Option<&Located<[f64; 4]>>,
    polarizer: Option<&Located<f64>>,
    horizontal: [f64; 3],
    at: Range<usize>,
) -> Result<Polarized, InputError> {
    let axis = direction(ctx, horizontal, at, "horizontal")?;
    let mut filter = None;
    if let Some(s) = stokes {
        let [s0, s1, s2, s3] = **s;
        let degree2 = s1 * s1 + s2 * s2 + s3 * s3;
        if s0 != 1.0 || !(0.0..=1.0 + 1e-6).contains(&degree2) {
            return Err(ctx.error(
                s.span(),
                format!("invalid normalized Stokes vector {:?}", **s),
                "give [1, s1, s2, s3] with s1² + s2² + s3² at most 1",
            ));
        }
        filter = Some(Mueller::splat(s.map(|v| [v as f32, 0.0, 0.0, 0.0])));
    }
    if let Some(degrees) = polarizer {
        let angle = ctx.number(degrees, "polarizer_deg", -360.0..=360.0)?;
        let plate = elements::polarizer(angle.to_radians() as f32);
        filter = Some(filter.map_or(plate, |light| plate * light));
    }
    Ok(Polarized { axis, filter })
}

fn spot(ctx: &Context, s: &SpotFile, at: Range<usize>) -> Result<PointEmitter, InputError> {
    let cutoff = ctx.number(&s.cutoff_deg, "cutoff_deg", 0.01..=180.0)?;
    let beam = match &s.beam_deg {
        Some(beam) => ctx.number(beam, "beam_deg", 0.0..=cutoff)?,
        None => 0.75 * cutoff,
    };
    Ok(PointEmitter {
        position: vector(ctx, s.position, at.clone(), "position")?,
        intensity: ctx.located(&s.intensity, "intensity", 0.0..=HUGE)?,
        profile: Profile::Spot {
            axis: direction(ctx, s.direction, at.clone(), "direction")?,
            beam: beam.to_radians() as f32,
            cutoff: cutoff.to_radians() as f32,
        },
        slide: None,
        axis: direction(ctx, s.horizontal, at, "horizontal")?,
    })
}

fn luminaire(ctx: &mut Context, i: &IesFile, at: Range<usize>) -> Result<PointEmitter, InputError> {
    let bytes = ctx.read(&i.file, i.file.span())?;
    let profile = ies::parse(&bytes).map_err(|e| {
        ctx.error(
            i.file.span(),
            format!("{}: {e}", ctx.path(&i.file).display()),
            "give an IES LM-63 file of a luminaire",
        )
    })?;
    let z = direction(ctx, i.direction, at.clone(), "direction")?;
    let zero = direction(ctx, i.zero, at.clone(), "zero")?;
    let Some(x) = (zero - z * zero.dot(z)).try_normalize() else {
        return Err(ctx.error(
            at,
            format!("the vector `zero` is {:?}, which is parallel to the direction of the emitter", i.zero),
            "set `zero` (the direction of horizontal angle 0) to a vector that is not parallel to the direction",
        ));
    };
    let to_world = Mat3A::from_cols(x, z.cross(x), z);
    Ok(PointEmitter {
        position: vector(ctx, i.position, at.clone(), "position")?,
        intensity: ctx.located(&i.intensity, "intensity", 0.0..=HUGE)?,
        profile: Profile::Table(Box::new(Table {
            to_local: to_world.transpose(),
            vertical: profile.vertical,
            horizontal: profile.horizontal,
            values: profile.values,
        })),
        slide: None,
        axis: direction(ctx, i.horizontal, at, "horizontal")?,
    })
}

fn directional(ctx: &Context, d: &DirectionalFile, at: Range<usize>) -> Result<Distant, InputError> {
    let irradiance = ctx.located(&d.irradiance, "irradiance", 0.0..=HUGE)?;
    Ok(Distant {
        dir: direction(ctx, d.direction, at.clone(), "direction")?,
        origin: d.origin.map(|o| vector(ctx, o, at.clone(), "origin")).transpose()?,
        spread: 0.0,
        across: Across::Even(irradiance),
        polarized: polarized(ctx, d.stokes.as_ref(), d.polarizer_deg.as_ref(), d.horizontal, at)?,
    })
}

fn beam(ctx: &Context, b: &BeamFile, at: Range<usize>) -> Result<Distant, InputError> {
    let power = ctx.located(&b.power, "power", 0.0..=HUGE)?;
    let radius = ctx.number(&b.radius, "radius", 1e-6..=1e6)? as f32;
    let half = match &b.divergence_mrad {
        Some(full) => ctx.number(full, "divergence_mrad", 0.0..=1000.0)? * 0.5e-3,
        None => 0.0,
    };
    Ok(Distant {
        dir: direction(ctx, b.direction, at.clone(), "direction")?,
        origin: Some(vector(ctx, b.origin, at.clone(), "origin")?),
        spread: half.tan() as f32 / radius,
        across: if b.gaussian { Across::Gaussian { power, radius } } else { Across::Disk { power, radius } },
        polarized: polarized(ctx, b.stokes.as_ref(), b.polarizer_deg.as_ref(), b.horizontal, at)?,
    })
}

/// Builds an environment of constant radiance.
fn environment(ctx: &Context, v: &EnvironmentFile, at: Range<usize>) -> Result<Environment, InputError> {
    let keys = [
        ("transform", v.transform.as_ref().map(Located::span)),
        ("stokes", v.stokes.as_ref().map(Located::span)),
        ("polarizer_deg", v.polarizer_deg.as_ref().map(Located::span)),
    ];
    if let Some((key, Some(at))) = keys.into_iter().find(|(_, span)| span.is_some()) {
        let message = format!("an environment without an image cannot have the key {key}");
        return Err(ctx.error(at, message, "give an image, or remove this key"));
    }
    Ok(Environment {
        radiance: ctx.located(&v.radiance, "radiance", 0.0..=HUGE)?,
        axis: direction(ctx, v.horizontal, at, "horizontal")?,
    })
}

fn sky(
    ctx: &mut Context,
    v: &EnvironmentFile,
    image: &Located<String>,
    at: Range<usize>,
) -> Result<Sky, InputError> {
    let map = transform(ctx, v.transform.as_ref())?.matrix3;
    let off = map.transpose() * map - glam::DMat3::IDENTITY;
    if !off.to_cols_array().iter().all(|x| x.abs() < 1e-4) {
        return Err(ctx.error(
            v.transform.as_ref().map_or(at, Located::span),
            "the transform of the environment map contains scale or shear",
            "give rotate_deg, or a matrix of a rotation or reflection",
        ));
    }
    let to_world: Mat3A = map.as_mat3().into();
    let scale = ctx.located(&v.radiance, "radiance", 0.0..=HUGE)?;
    let polarized = polarized(ctx, v.stokes.as_ref(), v.polarizer_deg.as_ref(), v.horizontal, at)?;
    let ([width, mut height], mut texels) = textures::sky(ctx, image, v.layer.as_deref())?;
    if v.rows == Rows::Poles && height == 2 {
        texels.extend_from_within(width as usize..);
        height = 3;
    }
    if !picture::scale(&mut texels, scale) {
        return Err(ctx.error(
            image.span(),
            format!("{} has texels that are negative, above 1e30 or not finite", ctx.path(image).display()),
            "correct the image: radiance values must be from 0 to 1e30",
        ));
    }
    Sky::new([width as usize, height as usize], texels, v.rows, to_world, polarized).ok_or_else(|| {
        ctx.error(
            image.span(),
            format!("the environment map {} is black", ctx.path(image).display()),
            "give an image with values above 0, or remove the environment",
        )
    })
}

/// Builds the area light of an emissive object's shape.
pub(crate) fn area(
    ctx: &mut Context,
    file: &Located<EmissionFile>,
    solid: &Solid,
) -> Result<AreaLight, InputError> {
    let value = ctx.located(&file.radiance, "radiance", 0.0..=HUGE)?;
    let texture = match &file.image {
        Some(image) => Some(projected(ctx, image)?),
        None => None,
    };
    let polarized =
        polarized(ctx, file.stokes.as_ref(), file.polarizer_deg.as_ref(), file.horizontal, file.span())?;
    let radiance = Spectrum { value, texture };
    Ok(match solid {
        Solid::Mesh(mesh) => AreaLight::mesh(mesh, radiance, file.two_sided, polarized),
        Solid::Quadric(quadric) => AreaLight::quadric(*quadric, radiance, file.two_sided, polarized),
    })
}
