//! Simulates the captures of a scheme, reconstructs them, and compares the result with the stored matrices.

use crate::answer::Answer;
use crate::error::ViewError;
use crate::image::Job;
use crate::request::{DetectorChoice, SchemeChoice, TrialRequest};
use polarimetry::capture::detector::file;
use polarimetry::capture::mueller_image::MuellerImage;
use polarimetry::capture::scheme::{Scheme, SchemeError};
use polarimetry::capture::scheme_file;
use polarimetry::capture::simulate::Noise;
use polarimetry::trial::{Trial, brightness};
use serde_json::json;
use std::path::Path;
use std::sync::Arc;
use tensor::axes::AxisKind;

/// Maximum number of matrices, and of readings, of a trial. Larger images are averaged over blocks, so that
/// an answer takes a fraction of a second.
const MOST_MATRICES: usize = 1 << 16;
const MOST_READINGS: usize = 1 << 23;

/// Maximum number of captures of a scheme.
const MOST_CAPTURES: usize = 4096;

/// Returns the scheme of a request, and the number of matrices for its trial.
pub(crate) fn scheme(choice: &SchemeChoice) -> Result<(Scheme, usize), ViewError> {
    let many = |found| {
        let reason = format!("the scheme has {found} captures; at most {MOST_CAPTURES} are simulated");
        ViewError::Request(reason)
    };
    let scheme = match choice {
        SchemeChoice::Named { captures, .. } if *captures > MOST_CAPTURES => return Err(many(*captures)),
        SchemeChoice::Named { name, captures, array } => named(name, *captures, *array)?,
        SchemeChoice::File { toml } => scheme_file::from_toml(Path::new("scheme"), toml)
            .map_err(|e| ViewError::Request(e.to_string()))?,
    };
    if scheme.captures() > MOST_CAPTURES {
        return Err(many(scheme.captures()));
    }
    let matrices = (MOST_READINGS / scheme.measurements().max(1)).min(MOST_MATRICES);
    Ok((scheme, matrices))
}

/// Runs the trial of a request on an image with the axes `y, x, stokes_out, stokes_in`.
/// `nm` is the wavelength.
pub(crate) fn trial(
    job: &Job,
    scheme: &Scheme,
    request: &TrialRequest,
    nm: f64,
) -> Result<Answer, ViewError> {
    let refused = |message: String| ViewError::Request(message);
    let (axes, values) = job.matrices();
    let is_matrix = |kind| axes.iter().any(|a| a.kind == kind);
    if !(is_matrix(AxisKind::StokesOut) && is_matrix(AxisKind::StokesIn)) {
        return Err(refused("captures need a slice with polarization `mueller`".into()));
    }
    let matrices = values.iter().map(|v| f64::from(*v)).collect();
    let image = MuellerImage::of_slice(matrices, &axes[..2], vec![nm], None)?;
    let noise = match &request.detector {
        DetectorChoice::Sigma { sigma } => Noise::Gaussian { sigma: sigma.max(0.0) * brightness(&image)? },
        DetectorChoice::File { toml } => {
            let detector =
                file::from_toml(Path::new("detector"), toml, false).map_err(|e| refused(e.to_string()))?;
            image.noise_of(detector)?
        }
    };
    let trial = Trial { image: &image, noise: &noise, prior: None, repeat: 1, seed: request.seed };
    let result = trial.run(scheme)?;
    let captured = image.capture(scheme, &noise, request.seed).map_err(|e| refused(e.to_string()))?;
    let measurements = scheme.measurements();
    let shown = request.capture.min(measurements.saturating_sub(1));
    let pixels = captured.layout.pixels();
    let frame = captured.intensities[shown * pixels..(shown + 1) * pixels].to_vec();
    let mut notes = vec![];
    if job.bin() > 1 {
        let bin = job.bin();
        notes.push(format!(
            "the matrices are means over blocks of {bin} x {bin} pixels, so that the answer is fast"
        ));
    }
    let number = |v: f64| v.is_finite().then_some(v);
    let header = json!({
        "captures": measurements, "rank": result.rank, "condition": number(result.condition),
        "estimator": result.estimate.name(), "predicted": result.predicted, "rmse": number(result.rmse),
        "normalized": number(result.normalized), "lost": number(result.lost),
        "height": captured.layout.height, "width": captured.layout.width,
        "errorWidth": result.errors.width,
        "errorHeight": result.errors.values.len() / result.errors.width.max(1), "notes": notes, "fields": ["image", "errors"],
    });
    Ok(Answer::Arrays(header, vec![Arc::new(frame), Arc::new(result.errors.values)]))
}

/// Returns a scheme of the command `sunstone scheme`.
fn named(name: &str, captures: usize, array: bool) -> Result<Scheme, ViewError> {
    type Make = fn(usize, bool) -> Result<Scheme, SchemeError>;
    let known: [(&str, Make); 4] = [
        ("drr", Scheme::drr),
        ("qrpr", Scheme::qrpr),
        ("quad", Scheme::quad),
        ("liquid-crystal", Scheme::liquid_crystal),
    ];
    let Some((_, make)) = known.iter().find(|(known, _)| *known == name) else {
        let all = known.map(|(known, _)| known).join(", ");
        return Err(ViewError::Request(format!("there is no scheme `{name}`; available: {all}")));
    };
    make(captures, array).map_err(|e| ViewError::Request(e.to_string()))
}
