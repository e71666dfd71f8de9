//! Detects parameters that the views do not determine, and parameters that are too uncertain.

use super::bundle::State;
use super::covariance::Root;
use super::device::Model;
use super::fault::Fault;
use nalgebra::DMatrix;

/// Singular values of the scaled information root below this value are rounding errors.
const ROUNDING: f64 = 1e-12;
/// Maximum relative standard error of a focal length.
const WORST_FOCAL: f64 = 0.05;
/// Maximum standard error of the principal point relative to the image width.
const WORST_CENTRE: f64 = 0.1;
/// Maximum standard error of the angles between camera and projector, in radians.
const WORST_ANGLE: f64 = 0.05;

const TILT: &str = "tilt the board by 20 to 45 degrees in different directions, and cover the complete image";

/// Returns the names of the free parameters that all views share.
fn names(state: &State) -> Vec<String> {
    let mut names = vec![String::new(); state.free];
    for (d, (device, ties)) in state.devices.iter().zip(&state.ties).enumerate() {
        for (name, tie) in device.names().iter().zip(ties) {
            if let Some((i, _)) = tie {
                let who = title(d);
                let more = format!("{who} {name}");
                let old = &mut names[*i];
                *old = if old.is_empty() { more } else { format!("{old} and {name}") };
            }
        }
    }
    if state.devices.len() > 1 {
        let pose = ["rotation about x", "rotation about y", "rotation about z", "x", "y", "z"];
        names.extend(pose.map(|p| format!("the projector's {p} relative to the camera")));
    }
    names
}

fn title(device: usize) -> &'static str {
    if device == 0 { "the camera's" } else { "the projector's" }
}

/// Returns the fault for a singular system of equations.
pub(super) fn singular() -> Fault {
    Fault::NotDetermined {
        what: "all parameters independently".into(),
        fix: format!("{TILT}, or exclude parameters from the fit"),
    }
}

/// Returns a fault if a combination of parameters does not affect the measurements.
pub(super) fn refuse_undetermined(state: &State, root: &Root) -> Result<(), Fault> {
    if state.shared() == 0 {
        return Ok(());
    }
    let (least, vector) = root.least_known().ok_or_else(singular)?;
    if least > ROUNDING {
        return Ok(());
    }
    let names = names(state);
    let most = vector.amax();
    let those: Vec<&str> =
        (0..names.len()).filter(|i| vector[*i].abs() > 0.3 * most).map(|i| names[i].as_str()).collect();
    let lens = those.iter().all(|n| n.contains(" k") || n.contains(" p") || n.contains(" s"));
    Err(Fault::NotDetermined {
        what: if those.len() == 1 {
            format!("{} independently of the board poses", those[0])
        } else {
            format!("{} independently of each other and of the board poses", those.join(", "))
        },
        fix: if lens {
            "use fewer distortion coefficients, or views that reach the corners of the image".into()
        } else {
            format!("{TILT}, or exclude parameters from the fit")
        },
    })
}

/// Returns a fault if a parameter's standard error is too large.
pub(super) fn refuse_uncertain(state: &State, covariance: &DMatrix<f64>) -> Result<(), Fault> {
    let mut first = 0;
    for (d, device) in state.devices.iter().enumerate() {
        let error = |i: usize| covariance[(first + i, first + i)].sqrt();
        for (i, name) in device.names().iter().enumerate().take(4) {
            let parameters = device.parameters();
            let (bad, size) = if i < 2 {
                (error(i) > WORST_FOCAL * parameters[i].abs(), parameters[i])
            } else {
                (error(i) > WORST_CENTRE * f64::from(device.size[0]), parameters[i])
            };
            if bad || !error(i).is_finite() {
                return Err(Fault::NotDetermined {
                    what: format!("{} {name} ({size:.0} ± {:.0} pixels)", title(d), error(i)),
                    fix: match device.model {
                        Model::Eight | Model::Twelve => format!("use 5 coefficients, or {TILT}"),
                        _ => format!("{TILT}, or exclude this parameter from the fit"),
                    },
                });
            }
        }
        first += device.parameters().len();
    }
    if state.devices.len() > 1 {
        let worst = (0..3).map(|i| covariance[(first + i, first + i)].sqrt()).fold(0.0, f64::max);
        if worst > WORST_ANGLE {
            return Err(Fault::NotDetermined {
                what: format!(
                    "the rotation between projector and camera (standard error {:.1} degrees)",
                    worst.to_degrees()
                ),
                fix: TILT.into(),
            });
        }
    }
    Ok(())
}

/// Returns notes on insignificant lens coefficients, and on lens models that are not invertible in
/// regions without views.
pub(super) fn notes(state: &State, covariance: &DMatrix<f64>) -> Vec<String> {
    let mut first = 0;
    let mut notes = vec![];
    for (d, device) in state.devices.iter().enumerate() {
        let names = device.names();
        let weak: Vec<String> = (4..names.len())
            .filter_map(|i| {
                let error = covariance[(first + i, first + i)].sqrt();
                let value = device.parameters()[i];
                (error > 0.0 && error > value.abs())
                    .then(|| format!("{} = {value:.2e} ± {error:.1e}", names[i]))
            })
            .collect();
        if !weak.is_empty() {
            notes.push(format!(
                "{} lens has coefficients that are not significant: {}; try a model with fewer coefficients",
                title(d),
                weak.join(", ")
            ));
        }
        let [w, h] = device.size.map(f64::from);
        let corners = [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]];
        if corners.iter().any(|c| device.normalized((*c).into()).is_none()) {
            notes.push(format!(
                "{} lens model folds over in an image corner that no view covers, and scenes refuse such lenses; add views of the \
                 corners, or fix k3",
                title(d)
            ));
        }
        first += names.len();
    }
    notes
}
