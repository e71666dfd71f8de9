//! Reads intrinsics and lens distortion from all forms that scene files allow.

use super::context::{Context, HUGE};
use base::locate::{InputError, Located};
use glam::DVec2;
use std::ops::Range;
use syntax::device::{DistortionFile, PinholeFile};
use transport::device::distortion::Distortion;
use transport::device::distortion::fisheye::Fisheye;
use transport::device::distortion::opencv::Opencv;
use transport::device::distortion::tilt::Tilt;

/// Returns focal lengths and principal point in pixels, in Sunstone's convention: the first pixel covers
/// 0..1.
pub(crate) fn intrinsics(
    ctx: &Context,
    p: &PinholeFile,
    span: Range<usize>,
) -> Result<(DVec2, DVec2), InputError> {
    let [w, h] = p.resolution.map(f64::from);
    let from_fov = |fov: &Located<f64>, size: f64| {
        if fov.is_finite() && **fov > 0.0 && **fov < 179.9 {
            Ok(size / 2.0 / (fov.to_radians() / 2.0).tan())
        } else {
            Err(ctx.error(
                fov.span(),
                format!("the field of view is {}°, outside the supported range", **fov),
                "give an angle above 0° and below 179.9°",
            ))
        }
    };
    let positive = |f: f64, span: Range<usize>| {
        if f.is_finite() && f > 1e-3 && f < 1e9 {
            Ok(f)
        } else {
            Err(ctx.error(
                span,
                format!("the focal length is {f} pixels, outside the supported range"),
                "give a focal length above 0.001 and below 1e9 pixels",
            ))
        }
    };
    let given = |f: &Located<f64>| positive(**f, f.span());
    let across = |width: &Located<f64>| {
        let width = ctx.number(width, "orthographic_width", 1e-6..=HUGE)?;
        Ok(w / width)
    };
    let matrix = p.opencv_matrix.as_ref();
    let parallel = p.orthographic_width.as_ref();
    let focal = match (&p.fov_x_deg, &p.fov_y_deg, &p.fx, &p.fy, matrix, parallel) {
        (Some(fov), None, None, None, None, None) => DVec2::splat(from_fov(fov, w)?),
        (None, Some(fov), None, None, None, None) => DVec2::splat(from_fov(fov, h)?),
        (None, None, Some(fx), None, None, None) => DVec2::splat(given(fx)?),
        (None, None, Some(fx), Some(fy), None, None) => DVec2::new(given(fx)?, given(fy)?),
        (None, None, None, None, None, Some(width)) => DVec2::splat(across(width)?),
        (None, None, None, None, Some(m), None) => {
            let [[fx, ..], [_, fy, _], _] = **m;
            DVec2::new(positive(fx, m.span())?, positive(fy, m.span())?)
        }
        _ => {
            return Err(ctx.error(
                span,
                "expected exactly one specification of the focal length",
                "give exactly one of fov_x_deg, fov_y_deg, opencv_matrix and fx (with fy if pixels are not square), or \
                 orthographic_width for an orthographic camera",
            ));
        }
    };
    let principal = match matrix {
        None => DVec2::new(p.cx.unwrap_or(w / 2.0), p.cy.unwrap_or(h / 2.0)),
        Some(m) if p.cx.is_some() || p.cy.is_some() => {
            return Err(ctx.error(
                m.span(),
                "the principal point is given both by opencv_matrix and by cx or cy",
                "remove cx and cy (relative to the corner of the first pixel; opencv_matrix is relative to the centre of this pixel)",
            ));
        }
        Some(m) => opencv_principal(ctx, m)?,
    };
    if !(principal.x.abs() < 1e9 && principal.y.abs() < 1e9) {
        return Err(ctx.error(
            span,
            format!("the principal point ({}, {}) is outside the supported range", principal.x, principal.y),
            "give the principal point in pixels, with magnitudes below 1e9",
        ));
    }
    Ok((focal, principal))
}

/// Converts a principal point in pixels from OpenCV's convention for pixel centres to Sunstone's convention.
fn opencv_principal(ctx: &Context, m: &Located<[[f64; 3]; 3]>) -> Result<DVec2, InputError> {
    let [[_, skew, cx], [below, _, cy], last] = **m;
    let error = |message: String, help: &str| Err(ctx.error(m.span(), message, help));
    if last != [0.0, 0.0, 1.0] || below != 0.0 {
        return error(
            format!("opencv_matrix is {:?}, which is not a camera matrix", **m),
            "write [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; some programs write the transposed matrix",
        );
    }
    if skew != 0.0 {
        return error(
            format!("opencv_matrix has a skew of {skew}, which is not supported"),
            "calibrate without skew and set the second entry of the first row to 0",
        );
    }
    Ok(DVec2::new(cx + 0.5, cy + 0.5))
}

/// Lens distortion, with the location of its keys in the scene file and the suggested fix for error messages.
pub(crate) struct Lens {
    pub(crate) distortion: Distortion,
    pub(crate) span: Option<Range<usize>>,
    pub(crate) fix: &'static str,
}

pub(crate) fn distortion(ctx: &Context, p: &PinholeFile) -> Result<Lens, InputError> {
    let spans = [
        p.distortion.as_ref().map(Located::span),
        p.opencv.as_ref().map(Located::span),
        p.fisheye.as_ref().map(Located::span),
    ];
    let mut given = spans.into_iter().flatten();
    let span = given.next();
    if let Some(second) = given.next() {
        return Err(ctx.error(
            second,
            "the lens distortion is given more than once",
            "keep one of distortion, opencv and fisheye",
        ));
    }
    let (distortion, coefficients, fix) = match (&p.opencv, &p.fisheye) {
        (None, Some(k)) => (
            Distortion::Fisheye(Fisheye { k: **k }),
            k.to_vec(),
            "check the focal length, the signs and the order of k1, k2, k3, k4, and that the lens was calibrated with a fisheye model",
        ),
        (Some(list), _) => {
            if !matches!(list.len(), 4 | 5 | 8 | 12 | 14) {
                return Err(ctx.error(
                    list.span(),
                    format!("unsupported number of opencv coefficients: {}", list.len()),
                    "give 4, 5, 8, 12 or 14 coefficients in OpenCV's order: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tau_x, tau_y]]]]",
                ));
            }
            let mut all = [0.0; 14];
            all[..list.len()].copy_from_slice(list);
            (opencv(&all), all.to_vec(), "check the signs and the order of k1, k2, p1, p2, k3, ...")
        }
        (None, None) => {
            let all = p.distortion.as_deref().map_or([0.0; 14], in_order);
            (opencv(&all), all.to_vec(), "check the signs and the order of k1, k2, k3, p1, p2")
        }
    };
    let bad = coefficients.iter().find(|c| c.is_nan() || c.abs() >= 1e6);
    if let (Some(bad), Some(at)) = (bad, &span) {
        return Err(ctx.error(
            at.clone(),
            format!("the distortion coefficient {bad} is not a number in -1e6..1e6"),
            "copy the coefficients from the calibration",
        ));
    }
    Ok(Lens { distortion, span, fix })
}

/// Returns all distortion coefficients in OpenCV's order.
fn in_order(f: &DistortionFile) -> [f64; 14] {
    [f.k1, f.k2, f.p1, f.p2, f.k3, f.k4, f.k5, f.k6, f.s1, f.s2, f.s3, f.s4, f.tau_x, f.tau_y]
}

fn opencv(list: &[f64; 14]) -> Distortion {
    Opencv { tilt: Tilt::new(list[12], list[13]), ..Opencv::from_list(list) }.into()
}
