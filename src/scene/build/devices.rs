//! Converts cameras and projectors of a scene file to calibrated devices.

use super::context::{Context, HUGE};
use super::lens::{distortion, intrinsics};
use super::pose::pose;
pub(crate) use super::pose::vector;
use base::locate::{InputError, Located};
use std::ops::Range;
use syntax::device::{ApertureFile, PinholeFile, ProjectorFile};
use transport::device::pinhole::{Lens, Pinhole};
use transport::device::projector::Projector;

pub(crate) fn pinhole(ctx: &Context, p: &PinholeFile, span: Range<usize>) -> Result<Pinhole, InputError> {
    if *p.resolution == [0, 0] && p.resolution.span() == (0..0) {
        return Err(ctx.error(
            span,
            "missing key `resolution`",
            "give resolution = [width, height], or calibration = \"calibration.toml\"",
        ));
    }
    if !p.has_pose() {
        return Err(ctx.error(
            span,
            "missing key `pose`",
            "give pose.look_at, pose.matrix or pose.extrinsics, or calibration = \"calibration.toml\"",
        ));
    }
    let [w, h] = *p.resolution;
    if !(1..=32768).contains(&w) || !(1..=32768).contains(&h) {
        bail!(ctx, p.resolution.span(), "resolution is {w} × {h}", "give a width and height in 1..32768");
    }
    let (focal, principal) = intrinsics(ctx, p, span.clone())?;
    let lens = distortion(ctx, p)?;
    let (origin, axes) = pose(ctx, &p.pose)?;
    if let (Some(width), Some(at)) =
        (&p.orthographic_width, lens.span.clone().or(p.aperture.as_ref().map(Located::span)))
    {
        return Err(ctx.error(
            at,
            format!("an orthographic camera (orthographic_width = {} m) cannot have a lens", **width),
            "remove `distortion` and `aperture`, or remove `orthographic_width`",
        ));
    }
    let at = lens.span.unwrap_or(span);
    let mut device = Pinhole::new([w, h], focal, principal, lens.distortion, origin, axes)
        .map_err(|e| ctx.error(at, e, lens.fix))?;
    device.parallel = p.orthographic_width.is_some();
    if let Some(aperture) = &p.aperture {
        let ApertureFile { radius, focus } = **aperture;
        ctx.within(radius, aperture.span(), "the aperture radius in metres", &(0.0..=1e3))?;
        ctx.within(focus, aperture.span(), "the focus distance in metres", &(1e-6..=HUGE))?;
        device.lens = Lens { radius, focus };
    }
    Ok(device)
}

pub(crate) fn projector(
    ctx: &Context,
    p: &ProjectorFile,
    span: Range<usize>,
    camera: &Pinhole,
) -> Result<Projector, InputError> {
    let irradiance = ctx.located(&p.irradiance, "irradiance", 0.0..=HUGE)?;
    if p.coaxial && camera.parallel {
        return Err(ctx.error(
            span,
            "a coaxial projector requires the camera's pinhole, but an orthographic camera has no pinhole",
            "give the projector its own pose and resolution, or give the camera a field of view",
        ));
    }
    if p.coaxial {
        if *p != (ProjectorFile { irradiance: p.irradiance.clone(), ..ProjectorFile::coaxial() }) {
            return Err(ctx.error(
                span,
                "a coaxial projector can have only `coaxial` and `irradiance`: the camera defines the pose, the resolution and the lens",
                "remove the other keys, or remove `coaxial = true`",
            ));
        }
        return Ok(Projector { pinhole: *camera, irradiance, coaxial: true });
    }
    for (key, given) in [("resolution", p.resolution.is_some()), ("pose", p.pose.is_some())] {
        if !given {
            return Err(ctx.error(
                span,
                format!("the projector has no {key}"),
                format!("give {key}, or set coaxial = true or calibration = \"calibration.toml\""),
            ));
        }
    }
    let file = pinhole_of(p);
    Ok(Projector { pinhole: pinhole(ctx, &file, span)?, irradiance, coaxial: false })
}

/// Converts the keys of a projector to those of a camera.
pub(crate) fn pinhole_of(p: &ProjectorFile) -> PinholeFile {
    PinholeFile {
        calibration: p.calibration.clone(),
        resolution: p.resolution.clone().unwrap_or_default(),
        fov_x_deg: p.fov_x_deg.clone(),
        fov_y_deg: p.fov_y_deg.clone(),
        fx: p.fx.clone(),
        fy: p.fy.clone(),
        cx: p.cx,
        cy: p.cy,
        opencv_matrix: p.opencv_matrix.clone(),
        distortion: p.distortion.clone(),
        opencv: p.opencv.clone(),
        fisheye: p.fisheye.clone(),
        aperture: p.aperture.clone(),
        orthographic_width: None,
        pose: p.pose.clone().unwrap_or_default(),
    }
}
