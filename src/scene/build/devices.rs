//! Cameras, projectors and other emitters of a scene file → calibrated devices.

use super::context::{Context, HUGE};
use base::locate::{InputError, Located};
use glam::{DVec2, DVec3, Mat3A, Vec3A};
use std::ops::Range;
use syntax::device::{ApertureFile, DistortionFile, EmitterFile, PinholeFile, PoseFile, ProjectorFile};
use syntax::scene::SceneFile;
use transport::device::distortion::Distortion;
use transport::device::emitter::{Environment, PointEmitter};
use transport::device::pinhole::{Lens, Pinhole};
use transport::device::projector::Projector;

/// Three finite numbers of sane size.
pub(crate) fn vector(
    ctx: &Context,
    v: [f64; 3],
    span: Range<usize>,
    what: &str,
) -> Result<Vec3A, InputError> {
    if v.iter().all(|x| x.abs() <= HUGE) {
        return Ok(DVec3::from_array(v).as_vec3a());
    }
    Err(ctx.error(
        span,
        format!("{what} is not a finite point"),
        "give three numbers in metres",
    ))
}

pub(crate) fn pinhole(ctx: &Context, p: &PinholeFile, span: Range<usize>) -> Result<Pinhole, InputError> {
    let [w, h] = *p.resolution;
    if !(1..=32768).contains(&w) || !(1..=32768).contains(&h) {
        return Err(ctx.error(
            p.resolution.span(),
            format!("resolution is {w} × {h}"),
            "width and height must lie in 1..32768",
        ));
    }
    let (wf, hf) = (f64::from(w), f64::from(h));
    let from_fov = |fov: &Located<f64>, size: f64| {
        if fov.is_finite() && **fov > 0.0 && **fov < 179.9 {
            Ok(size / 2.0 / (fov.to_radians() / 2.0).tan())
        } else {
            Err(ctx.error(
                fov.span(),
                format!("the field of view is {}°", **fov),
                "it must lie above 0 and below 179.9 degrees",
            ))
        }
    };
    let positive = |f: &Located<f64>| {
        if f.is_finite() && **f > 1e-3 && **f < 1e9 {
            Ok(**f)
        } else {
            Err(ctx.error(
                f.span(),
                format!("the focal length is {} pixels", **f),
                "give it in pixels, above 0.001",
            ))
        }
    };
    let focal = match (&p.fov_x_deg, &p.fov_y_deg, &p.fx, &p.fy) {
        (Some(fov), None, None, None) => DVec2::splat(from_fov(fov, wf)?),
        (None, Some(fov), None, None) => DVec2::splat(from_fov(fov, hf)?),
        (None, None, Some(fx), None) => DVec2::splat(positive(fx)?),
        (None, None, Some(fx), Some(fy)) => DVec2::new(positive(fx)?, positive(fy)?),
        _ => {
            return Err(ctx.error(
                span,
                "the focal length is given in no way, or in more than one",
                "give exactly one of fov_x_deg, fov_y_deg, or fx (with fy if pixels are not square)",
            ));
        }
    };
    let principal = DVec2::new(p.cx.unwrap_or(wf / 2.0), p.cy.unwrap_or(hf / 2.0));
    if !(principal.x.abs() < 1e9 && principal.y.abs() < 1e9) {
        return Err(ctx.error(
            span,
            "cx or cy is not finite",
            "give the principal point in pixels",
        ));
    }
    let DistortionFile { k1, k2, k3, p1, p2 } = p.distortion.as_deref().cloned().unwrap_or_default();
    let distortion = Distortion { k1, k2, k3, p1, p2 };
    let (origin, axes) = pose(ctx, &p.pose)?;
    let at = p.distortion.as_ref().map_or(span, Located::span);
    let mut device = Pinhole::new([w, h], focal, principal, distortion, origin, axes)
        .map_err(|e| ctx.error(at, e, "check the signs and the order of k1, k2, k3, p1, p2"))?;
    if let Some(aperture) = &p.aperture {
        let ApertureFile { radius, focus } = **aperture;
        if !(0.0..1e3).contains(&radius) || !(1e-6..HUGE).contains(&focus) {
            return Err(ctx.error(
                aperture.span(),
                format!("an aperture of radius {radius} m, in focus at {focus} m, is none"),
                "give radius, 0 or more, and focus, above 0, in metres",
            ));
        }
        device.lens = Lens { radius, focus };
    }
    Ok(device)
}

fn pose(ctx: &Context, pose: &Located<PoseFile>) -> Result<(Vec3A, Mat3A), InputError> {
    let span = pose.span();
    match &**pose {
        PoseFile::LookAt(l) => {
            let origin = DVec3::from_array(l.origin);
            let forward = (DVec3::from_array(l.target) - origin).try_normalize();
            let right = forward.and_then(|f| f.cross(DVec3::from_array(l.up)).try_normalize());
            let (Some(forward), Some(right)) = (forward, right) else {
                return Err(ctx.error(
                    span,
                    "look_at does not define a pose",
                    "target must differ from origin, and up must not be parallel to the view",
                ));
            };
            vector(ctx, l.origin, span, "look_at.origin")?;
            let axes = [right, forward.cross(right), forward].map(DVec3::as_vec3a);
            Ok((origin.as_vec3a(), Mat3A::from_cols(axes[0], axes[1], axes[2])))
        }
        PoseFile::Matrix(m) => {
            let column = |j: usize| DVec3::new(m[0][j], m[1][j], m[2][j]);
            let (x, y, z) = (column(0), column(1), column(2));
            let rigid = (x.length() - 1.0).abs() < 1e-4
                && (y.length() - 1.0).abs() < 1e-4
                && (x.cross(y) - z).length() < 1e-3
                && m[3] == [0.0, 0.0, 0.0, 1.0];
            if !rigid {
                return Err(ctx.error(
                    span,
                    "the pose matrix is not a rotation and a translation",
                    "columns must be the right-handed unit vectors right, down, forward, then the position; last row 0 0 0 1",
                ));
            }
            let origin = vector(ctx, column(3).to_array(), span, "the position in the pose matrix")?;
            // Orthonormalize, so that calibration rounding does not scale directions.
            let x = x.normalize();
            let y = (y - x * x.dot(y)).normalize();
            Ok((
                origin,
                Mat3A::from_cols(x.as_vec3a(), y.as_vec3a(), x.cross(y).as_vec3a()),
            ))
        }
    }
}

pub(crate) fn projector(
    ctx: &Context,
    p: &ProjectorFile,
    span: Range<usize>,
    camera: &Pinhole,
) -> Result<Projector, InputError> {
    let irradiance = ctx.located(&p.irradiance, "irradiance", 0.0..=HUGE)?;
    if p.coaxial {
        let own = p.resolution.is_some()
            || p.pose.is_some()
            || p.fov_x_deg.is_some()
            || p.fov_y_deg.is_some()
            || p.fx.is_some()
            || p.fy.is_some()
            || p.cx.is_some()
            || p.cy.is_some()
            || p.aperture.is_some()
            || p.distortion.is_some();
        if own {
            return Err(ctx.error(
                span,
                "a coaxial projector takes pose, pixels and lens from the camera",
                "remove coaxial = true, or every key but irradiance",
            ));
        }
        return Ok(Projector {
            pinhole: *camera,
            irradiance,
            coaxial: true,
        });
    }
    let (Some(resolution), Some(pose)) = (p.resolution.clone(), p.pose.clone()) else {
        return Err(ctx.error(
            span,
            "the projector lacks resolution or pose",
            "give both, or coaxial = true",
        ));
    };
    let file = PinholeFile {
        resolution,
        fov_x_deg: p.fov_x_deg.clone(),
        fov_y_deg: p.fov_y_deg.clone(),
        fx: p.fx.clone(),
        fy: p.fy.clone(),
        cx: p.cx,
        cy: p.cy,
        distortion: p.distortion.clone(),
        aperture: p.aperture.clone(),
        pose,
    };
    Ok(Projector {
        pinhole: pinhole(ctx, &file, span)?,
        irradiance,
        coaxial: false,
    })
}

type Emitters = (Vec<PointEmitter>, Option<Environment>);

pub(crate) fn emitters(ctx: &Context, file: &SceneFile) -> Result<Emitters, InputError> {
    let (mut points, mut environment) = (Vec::new(), None);
    for e in &file.emitters {
        let axis = |a: [f64; 3]| {
            vector(ctx, a, e.span(), "horizontal")?
                .try_normalize()
                .ok_or_else(|| {
                    ctx.error(
                        e.span(),
                        "horizontal has no length",
                        "give a direction such as [1, 0, 0]",
                    )
                })
        };
        match &**e {
            EmitterFile::Point(p) => points.push(PointEmitter {
                position: vector(ctx, p.position, e.span(), "position")?,
                intensity: ctx.located(&p.intensity, "intensity", 0.0..=HUGE)?,
                axis: axis(p.horizontal)?,
            }),
            EmitterFile::Environment(_) if environment.is_some() => {
                return Err(ctx.error(e.span(), "a second environment", "keep one"));
            }
            EmitterFile::Environment(v) => {
                environment = Some(Environment {
                    radiance: ctx.located(&v.radiance, "radiance", 0.0..=HUGE)?,
                    axis: axis(v.horizontal)?,
                });
            }
        }
    }
    Ok((points, environment))
}
