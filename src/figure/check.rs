//! Checks, before rendering, that a view of a slice can be drawn.

use crate::error::FigureError;
use crate::flight::MOST;
use crate::spec::{SignedScale, View};
use base::spectral_table;
use tensor::slice::{CameraSelect, Polarization, ProjectorSelect, Slice, TimeSelect};

/// Checks that an optional number is positive.
fn positive(option: &'static str, value: Option<f32>) -> Result<(), FigureError> {
    match value {
        Some(v) if !(v > 0.0 && v.is_finite()) => Err(FigureError::option(option, v, "a positive number")),
        _ => Ok(()),
    }
}

/// Checks the options of a view. Also checks that the slice resolves the axes that the view needs. `nm` are
/// the scene's wavelengths in nanometres.
///
/// # Errors
/// The same [`FigureError`] as for drawing the view.
pub fn check(view: &View, slice: &Slice, nm: &[f64]) -> Result<(), FigureError> {
    let missing = |axis, fix| Err(FigureError::MissingAxis { slice: slice.name.clone(), axis, fix });
    let wavelength = match view {
        View::Mueller(v) => v.wavelength_nm,
        View::SpaceSpace(v) | View::SpaceTime(v) => v.wavelength_nm,
        _ => None,
    };
    if let Some(wanted) = wavelength
        && spectral_table::entry(nm, wanted).is_none()
    {
        return Err(FigureError::wavelength(&slice.name, wanted, nm));
    }
    let element = match view {
        View::Mueller(_) => [3, 3],
        View::SpaceSpace(v) | View::SpaceTime(v) => v.element,
        View::Profile(v) => v.element,
        _ => [0, 0],
    };
    if let Some(index) = element.into_iter().find(|i| *i > 3) {
        return Err(FigureError::Index { slice: slice.name.clone(), what: "Stokes elements", index, len: 4 });
    }
    if element != [0, 0] && slice.polarization != Polarization::Mueller {
        return missing("Stokes", "polarization = \"mueller\"");
    }
    let timed = match view {
        View::SpaceTime(_) | View::Flight(_) | View::Profile(_) => true,
        View::Mueller(v) => v.time_ps.is_some(),
        View::Photo(_) | View::SpaceSpace(_) => false,
    };
    if timed && matches!(slice.time, TimeSelect::Sum) {
        return missing("travel time", "time = { start_ps = .., bin_ps = .., bins = .. }");
    }
    match view {
        View::Photo(v) => positive("white", v.white),
        View::Mueller(v) => {
            positive("limit", v.limit)?;
            positive("mask_sigmas", v.mask_sigmas)
        }
        View::Flight(v) if !(1..=MOST).contains(&v.frames) => {
            Err(FigureError::option("frames", v.frames, "1 to 400"))
        }
        View::Flight(_) => Ok(()),
        View::Profile(v) if !v.pixel.iter().all(|p| (0.0..1e6).contains(p)) => {
            let value = format!("{:?}", v.pixel);
            Err(FigureError::option("pixel", value, "a column and a row of the camera, counted from 0"))
        }
        View::Profile(_) => Ok(()),
        View::SpaceSpace(v) | View::SpaceTime(v) if v.scale == SignedScale::Arctan && v.element == [0, 0] => {
            let must = "`linear`, or an element other than M00, because M00 has no signed scale";
            Err(FigureError::option("scale", "arctan", must))
        }
        View::SpaceSpace(v) | View::SpaceTime(v) => {
            let resolved = !matches!(
                slice.projector,
                ProjectorSelect::Sum
                    | ProjectorSelect::Mask { .. }
                    | ProjectorSelect::Epipolar { .. }
                    | ProjectorSelect::NonEpipolar { .. }
                    | ProjectorSelect::Coaxial
            );
            if matches!(view, View::SpaceSpace(_)) && !resolved {
                return missing("projector column", "projector = \"all\"");
            }
            match &slice.camera {
                CameraSelect::Rows(rows) if v.row >= rows.len() => Err(FigureError::Index {
                    slice: slice.name.clone(),
                    what: "camera rows",
                    index: v.row,
                    len: rows.len(),
                }),
                _ => Ok(()),
            }
        }
    }
}
