//! Creates panels of a scene. A panel shows a view of a slice, a decomposition, a layer of ground truth, or a
//! scale bar.

use base::locate::{InputError, Located};
use base::spectral_table;
use figure::composite::ScaleBar;
use figure::spec::View;
use figure::tile::{self, Scale, Tile};
use figure::{FigureError, Matrices, Panel, White, element, polarization};
use glam::{DVec2, DVec3};
use polarimetry::decompose::maps::{self, Quantity};
use tensor::field::Field;
use tensor::layers::{LayerValues, Parts};
use tensor::slice::{Polarization, Slice, TimeSelect};
use transport::render::layers;
use transport::render::layers::visible_surface::Viewer;
use transport::scene::Scene;

use super::file::{DecompositionFile, LayerFile, PanelFile, QuantityFile, ScaleBarFile, ViewFile};
use super::source::Fault;
use super::stage::{FigureFileError, Stage};
use crate::figures;

/// Returns the corresponding view of the `figure` crate, or `None` if there is no corresponding view.
fn plain(view: &ViewFile) -> Option<View> {
    Some(match view {
        ViewFile::Photo(v) => View::Photo(v.clone()),
        ViewFile::Mueller(v) => View::Mueller(v.clone()),
        ViewFile::SpaceSpace(v) => View::SpaceSpace(v.clone()),
        ViewFile::SpaceTime(v) => View::SpaceTime(v.clone()),
        ViewFile::Flight(v) => View::Flight(v.clone()),
        ViewFile::Profile(v) => View::Profile(v.clone()),
        _ => return None,
    })
}

/// Checks, before rendering, that a panel can be drawn from its scene.
pub fn check(panel: &PanelFile, scene: &Scene) -> Result<(), String> {
    let Some(view) = &panel.view else { return Ok(()) };
    let slice = view.slice().and_then(|name| scene.slices.iter().find(|s| s.name == name));
    if let (Some(plain), Some(slice)) = (plain(view), slice) {
        return figure::check(&plain, slice, scene.wavelengths.nm()).map_err(|e| e.to_string());
    }
    let mueller = |Slice { name, polarization, .. }: &Slice| match polarization {
        Polarization::Mueller => Ok(()),
        Polarization::Intensity => {
            Err(format!("slice `{name}` has no Stokes axis; use a slice with `polarization = \"mueller\"`"))
        }
    };
    let has_wavelength = |slice: &Slice, wanted: Option<f64>| {
        let all = scene.wavelengths.nm();
        match wanted {
            Some(nm) if spectral_table::entry(all, nm).is_none() => {
                Err(FigureError::wavelength(&slice.name, nm, all).to_string())
            }
            _ => Ok(()),
        }
    };
    match (&**view, slice) {
        (ViewFile::Element(v), Some(slice)) => {
            v.check().map_err(|e| e.to_string())?;
            has_wavelength(slice, v.wavelength_nm)?;
            if v.time_ps.is_some() && matches!(slice.time, TimeSelect::Sum) {
                return Err(format!(
                    "slice `{}` has no travel time axis, but the view sets `time_ps`",
                    slice.name
                ));
            }
            if v.element.at == [0, 0] { Ok(()) } else { mueller(slice) }
        }
        (ViewFile::Decomposition(v), Some(slice)) => {
            scale(v).map(|_| ())?;
            has_wavelength(slice, v.wavelength_nm)?;
            mueller(slice)
        }
        (ViewFile::Polarization(v), Some(slice)) => {
            v.check().map_err(|e| e.to_string())?;
            has_wavelength(slice, v.wavelength_nm)?;
            mueller(slice)
        }
        (ViewFile::Poincare(v), Some(slice)) => {
            polarization::check_stokes(v.stokes).map_err(|e| e.to_string())?;
            has_wavelength(slice, v.wavelength_nm)?;
            mueller(slice)
        }
        (ViewFile::Layer(v), _) => {
            // A scene with one pixel has all layers.
            let options = layers::Options { side: 1, ..layers::Options::default() };
            let known: Vec<&str> = layers::layers(scene, options).layers.iter().map(|l| l.name).collect();
            if known.contains(&v.layer.as_str()) {
                return Ok(());
            }
            Err(format!("unknown layer `{}`; available: {}", v.layer, known.join(", ")))
        }
        _ => Ok(()),
    }
}

/// Returns the tile of a view of a scene.
pub fn tile(
    view: &ViewFile,
    stage: &Stage,
    fault: &dyn Fn(String) -> InputError,
) -> Result<Tile, FigureFileError> {
    let bad = |e: FigureError| FigureFileError::Input(fault(e.to_string()));
    if let ViewFile::Layer(view) = view {
        return layer(view, &stage.scene).map_err(|e| fault(e).into());
    }
    let (Some(store), Some(name)) = (&stage.store, view.slice()) else {
        return Err(fault("this view requires a slice, but the view names none".into()).into());
    };
    let plain = plain(view);
    let masked = match view {
        ViewFile::Polarization(v) => v.mask_sigmas.is_some(),
        ViewFile::Poincare(v) => v.mask_sigmas.is_some(),
        ViewFile::Decomposition(v) => v.mask_sigmas.is_some(),
        _ => false,
    };
    let of_errors: &[Field] = if masked { &[Field::StdError] } else { &[] };
    let further = plain.as_ref().map_or(of_errors, View::further_fields);
    figures::read(store, name, further, |panel| match (&plain, view) {
        (Some(plain), _) => tile::of_view(plain, panel).map_err(bad),
        (None, ViewFile::Element(v)) => element::tile(v, panel).map_err(bad),
        (None, ViewFile::Polarization(v)) => polarization::tile(v, panel).map_err(bad),
        (None, ViewFile::Poincare(v)) => polarization::sphere(v, panel).map_err(bad),
        (None, ViewFile::Decomposition(v)) => decomposition(v, panel).map_err(|e| fault(e).into()),
        _ => Err(fault("this view requires a slice, but the view names none".into()).into()),
    })
}

/// Returns the quantity of a decomposition view, with its name and its colour scale.
fn scale(view: &DecompositionFile) -> Result<(Quantity, &'static str, Scale), String> {
    let (quantity, name, most) = match view.quantity {
        QuantityFile::Polarizance => (Quantity::Polarizance, "polarizance", 1.0),
        QuantityFile::Diattenuation => (Quantity::Diattenuation, "diattenuation", 1.0),
        QuantityFile::Retardance => (Quantity::Retardance, "retardance [°]", 180.0),
        QuantityFile::Depolarization => (Quantity::Depolarization, "depolarization", 1.0),
        QuantityFile::Entropy => (Quantity::Entropy, "entropy", 1.0),
    };
    let [low, high] = view.limits.unwrap_or([0.0, most]);
    if low < high && (high - low).is_finite() {
        Ok((quantity, name, Scale::Linear { low, high }))
    } else {
        Err(format!("`limits` is [{low}, {high}]; expected [low, high], where low is smaller than high"))
    }
}

fn decomposition(view: &DecompositionFile, panel: &Panel) -> Result<Tile, String> {
    let (quantity, name, scale) = scale(view)?;
    let text = |e: FigureError| e.to_string();
    let image = Matrices::read(&view.slice, view.wavelength_nm, view.mask_sigmas, panel).map_err(text)?;
    let (mut all, _) = maps::maps(image.elements.as_flattened(), &[quantity]);
    let mut values = all.pop().unwrap_or_default();
    if quantity == Quantity::Retardance {
        values.iter_mut().for_each(|v| *v = v.to_degrees());
    }
    let least = view.least * tile::common_white(image.elements.iter().map(|m| m[0])).value();
    for (v, m) in values.iter_mut().zip(&image.elements) {
        if m[0] < least {
            *v = f32::NAN;
        }
    }
    if let (Some(sigmas), Some(variances)) = (view.mask_sigmas, &image.variances) {
        for (v, (m, variance)) in values.iter_mut().zip(image.elements.iter().zip(variances)) {
            if is_undetermined(m, variance, sigmas) {
                *v = f32::NAN;
            }
        }
    }
    tile::of_values(name, image.width, &values, scale).map_err(text)
}

/// Returns whether the smallest singular value of the lower right 3 × 3 elements of a Mueller matrix is below a
/// number of standard errors. The retardance is then not determined: the light is depolarized, or was polarized
/// completely in between. 1/‖A⁻¹‖ = |det A|/‖adj A‖ is at most the smallest singular value, and at least 1/√3 of it
/// (Golub & Van Loan 2013, section 2.6). Its standard error is the root mean square of the elements' errors.
fn is_undetermined(m: &[f32; 16], variance: &[f32; 16], sigmas: f32) -> bool {
    let column = |j: usize| DVec3::new(m[4 + j].into(), m[8 + j].into(), m[12 + j].into());
    let [a, b, c] = [1, 2, 3].map(column);
    let cofactors = [b.cross(c), c.cross(a), a.cross(b)];
    let norm = cofactors.iter().map(|v| v.length_squared()).sum::<f64>().sqrt();
    let least = a.dot(cofactors[0]).abs() / norm;
    let mean = [5, 6, 7, 9, 10, 11, 13, 14, 15].map(|i| f64::from(variance[i])).iter().sum::<f64>() / 9.0;
    let needed = f64::from(sigmas) * mean.sqrt();
    // Neither number is finite for a matrix without light.
    !(needed.is_finite() && least >= needed)
}

fn layer(view: &LayerFile, scene: &Scene) -> Result<Tile, String> {
    let options = layers::Options { through: view.through, ..layers::Options::default() };
    let set = layers::layers(scene, options);
    let layer = set.get(&view.layer).ok_or_else(|| format!("unknown layer `{}`", view.layer))?;
    let width = set.size[0] as usize;
    let name = match layer.units {
        "1" | "" => view.layer.replace('_', " "),
        unit => format!("{} [{unit}]", view.layer.replace('_', " ")),
    };
    let colours = |colours: Vec<[f32; 3]>| tile::of_colours(&name, width, colours, White::Value(1.0));
    let drawn = match (&layer.values, layer.parts) {
        (LayerValues::Number(all), _) => {
            let values: Vec<f32> = all.iter().map(|v| *v as f32).collect();
            tile::of_values(&name, width, &values, Scale::Things)
        }
        (LayerValues::Real(all), Parts::One) => {
            let finite = || all.iter().copied().filter(|v| v.is_finite());
            let [low, high] = view
                .limits
                .unwrap_or_else(|| [finite().fold(f32::MAX, f32::min), finite().fold(f32::MIN, f32::max)]);
            let high = if high > low { high } else { low + 1.0 };
            tile::of_values(&name, width, all, Scale::Linear { low, high })
        }
        // Normals n are drawn in the usual colours (1 + n) / 2, from 0 to 1.
        (LayerValues::Real(all), Parts::Vector) if layer.name.contains("normal") => {
            colours(all.chunks_exact(3).map(|n| [n[0], n[1], n[2]].map(|v| 0.5 + 0.5 * v)).collect())
        }
        (LayerValues::Real(all), Parts::Wavelengths) if set.channels(layer) == 3 => {
            colours(all.chunks_exact(3).map(|c| [c[2], c[1], c[0]]).collect())
        }
        _ => {
            return Err(format!(
                "layer `{}` has several values per pixel, and these values are not a colour; choose another layer",
                view.layer
            ));
        }
    };
    drawn.map_err(|e| e.to_string())
}

/// Returns the scale bar for a length at the depth of an image point, or an error with its fix.
pub fn scale_bar(bar: &Located<ScaleBarFile>, scene: &Scene) -> Result<ScaleBar, Fault> {
    let camera = &scene.camera;
    let [w, h] = camera.resolution.map(f64::from);
    let at = DVec2::new(bar.of[0] * w, bar.of[1] * h);
    let sight = Viewer::new(scene).look(at, true).ok_or_else(|| {
        (
            "no surface is visible at the point of the scale bar, so the depth is unknown".to_owned(),
            "choose another position with of = [x, y], fractions of the image".to_owned(),
        )
    })?;
    let depth = (sight.at - camera.origin.as_dvec3()).dot(camera.axes.z_axis.as_dvec3());
    let share = bar.length_mm / 1000.0 / depth * camera.focal.x / w;
    if !(0.001..=0.9).contains(&share) {
        return Err((
            format!(
                "the scale bar of {} mm at this depth covers {share:.3e} of the image's width, expected 0.001 to 0.9",
                bar.length_mm
            ),
            format!("use a {} length_mm", if share > 0.9 { "shorter" } else { "longer" }),
        ));
    }
    let label = if bar.length_mm >= 1000.0 {
        format!("{} m", bar.length_mm / 1000.0)
    } else if bar.length_mm >= 10.0 && bar.length_mm % 10.0 == 0.0 {
        format!("{} cm", bar.length_mm / 10.0)
    } else {
        format!("{} mm", bar.length_mm)
    };
    Ok(ScaleBar { share, label })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test uses a retarder, an almost complete depolarizer, and a polarizer before and behind a depolarizer. The
    /// estimate of the smallest singular value of a multiple of a rotation is 1/√3 of this multiple.
    #[test]
    fn depolarized_and_polarized_light_has_no_retardance() {
        let with = |part: [[f32; 3]; 3]| -> [f32; 16] {
            let element = |i: usize, j: usize| if i > 0 && j > 0 { part[i - 1][j - 1] } else { 1.0 };
            std::array::from_fn(|k| element(k / 4, k % 4))
        };
        let variance: [f32; 16] = std::array::from_fn(|k| if k % 4 == 0 || k < 4 { 100.0 } else { 1e-4 });
        let retarder = with([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.0, -0.8, 0.6]].map(|r| r.map(|v| 0.5 * v)));
        let least = 0.5 / 3_f32.sqrt() / 0.01;
        assert!(!is_undetermined(&retarder, &variance, 0.99 * least));
        assert!(is_undetermined(&retarder, &variance, 1.01 * least));
        assert!(is_undetermined(
            &with([[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]]),
            &variance,
            2.0
        ));
        assert!(is_undetermined(&with([[0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 0.0]]), &variance, 1.0));
        assert!(is_undetermined(&[0.0; 16], &variance, 1.0));
        assert!(is_undetermined(&retarder, &[f32::NAN; 16], 1.0));
    }
}
