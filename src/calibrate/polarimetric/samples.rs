//! Fits the imperfections of the elements, with covariances, to captures of known samples.

use super::super::least_squares::{Fit, FitError, fit};
use super::parameters::Parameter;
use polarimetry::capture::design_matrix::DesignMatrix;
use polarimetry::capture::element::Ray;
use polarimetry::capture::scheme::Scheme;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

/// Captures of a known sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Name of the sample, e.g. `air`.
    pub name: String,
    /// Row-major Mueller matrix of the sample, up to a brightness factor.
    pub mueller: [f64; 16],
    /// The scheme with the measured stage angles and the assumed imperfections of the elements.
    pub scheme: Scheme,
    pub ray: Ray,
    /// Mean intensities, one per measurement.
    pub intensities: Vec<f64>,
    /// Standard deviations of `intensities`.
    pub sigmas: Vec<f64>,
    /// Number of readings, summed over all measurements.
    pub readings: usize,
    /// Number of readings that are saturated or unknown and therefore excluded from the means.
    pub left_out: usize,
}

/// The reason why a calibration fails.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CalibrationError {
    #[error("there are no samples; capture air, a mirror or a known plate")]
    NoSample,
    #[error(
        "sample `{name}` has {found} intensities, but the scheme has {want} measurements; pass one intensity per measurement"
    )]
    Lengths { name: String, found: usize, want: usize },
    #[error(
        "sample `{name}`: the sum of the intensities or a standard deviation is not positive; use more light, and exclude saturated \
         captures"
    )]
    Dark { name: String },
    #[error(
        "samples `{first}` and `{other}` were captured with different polarizing elements; use one scheme for all samples"
    )]
    Elements { first: String, other: String },
    #[error(transparent)]
    Fit(#[from] FitError),
}

/// A fitted imperfection of one element.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    pub parameter: Parameter,
    /// Wavelength in nanometres, if the parameter is fitted per wavelength.
    pub nm: Option<f64>,
    /// Name of the parameter, which includes the name of the element.
    pub name: String,
    /// Value in the parameter's unit.
    pub value: f64,
    /// Standard deviation, or `None` if the samples determine the parameter only in combination with others.
    pub sigma: Option<f64>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Calibrated {
    /// The first sample's scheme with the fitted imperfections.
    pub scheme: Scheme,
    /// Values of all free parameters.
    pub found: Vec<Found>,
    /// Descriptions of the undetermined parameters.
    pub undetermined: Vec<String>,
    /// The fit, with parameters in the order of `found`, then one brightness per sample.
    pub fit: Fit,
}

/// One fitted number, which is an imperfection at one wavelength or at all wavelengths.
#[derive(Clone, Copy)]
struct Unknown {
    parameter: Parameter,
    nm: Option<f64>,
}

/// Cached predictions of a sample's intensities, for the fitted numbers on which these intensities depend.
///
/// Numerical derivatives change one number at a time, and most numbers do not affect this sample. The most
/// recent predictions are therefore cached.
struct Predictions {
    own: Vec<usize>,
    kept: RefCell<VecDeque<Kept>>,
}

/// Fitted numbers, and the intensities that they predict.
type Kept = (Vec<f64>, Rc<Vec<f64>>);

const KEPT: usize = 4;

impl Predictions {
    fn new(own: Vec<usize>) -> Self {
        Self { own, kept: RefCell::default() }
    }

    fn of(&self, p: &[f64], make: impl FnOnce(&[f64]) -> Vec<f64>) -> Rc<Vec<f64>> {
        let numbers: Vec<f64> = self.own.iter().map(|i| p[*i]).collect();
        let mut kept = self.kept.borrow_mut();
        if let Some((_, known)) = kept.iter().find(|(n, _)| *n == numbers) {
            return known.clone();
        }
        let new = Rc::new(make(&numbers));
        kept.push_back((numbers, new.clone()));
        if kept.len() > KEPT {
            kept.pop_front();
        }
        new
    }
}

/// Returns the wavelengths of the samples in ascending order.
fn wavelengths(samples: &[Sample]) -> Vec<f64> {
    let mut wavelengths: Vec<f64> = samples.iter().map(|s| s.ray.nm).collect();
    wavelengths.sort_by(f64::total_cmp);
    wavelengths.dedup();
    wavelengths
}

/// Returns the numbers to fit. Each spectral parameter occurs once per wavelength of the samples.
fn unknowns(samples: &[Sample], free: &[Parameter]) -> Vec<Unknown> {
    let wavelengths = wavelengths(samples);
    let several = wavelengths.len() > 1;
    let each = |parameter: &Parameter| -> Vec<Unknown> {
        let of = |nm| Unknown { parameter: *parameter, nm };
        if several && parameter.is_spectral() {
            wavelengths.iter().map(|nm| of(Some(*nm))).collect()
        } else {
            vec![of(None)]
        }
    };
    free.iter().flat_map(each).collect()
}

/// Fits imperfections to samples. `free` lists the parameters to fit. Other parameters keep their assumed
/// values.
///
/// Axis offsets are shared by all samples. Spectral parameters are fitted at each wavelength that has
/// samples. All numbers are fitted jointly.
///
/// # Errors
/// Returns [`CalibrationError`] if the samples are invalid or the fit fails.
pub fn calibrate(samples: &[Sample], free: &[Parameter]) -> Result<Calibrated, CalibrationError> {
    let Some(first) = samples.first() else {
        return Err(CalibrationError::NoSample);
    };
    let names = |s: &Scheme| -> Vec<String> {
        s.generator().iter().chain(s.analyzer()).map(|e| e.name.clone()).collect()
    };
    for s in samples {
        let want = s.scheme.measurements();
        if s.intensities.len() != want || s.sigmas.len() != want {
            return Err(CalibrationError::Lengths { name: s.name.clone(), found: s.intensities.len(), want });
        }
        let lit = s.intensities.iter().sum::<f64>() > 0.0;
        if !lit || !s.sigmas.iter().all(|v| *v > 0.0) || s.mueller.iter().any(|v| !v.is_finite()) {
            return Err(CalibrationError::Dark { name: s.name.clone() });
        }
        if names(&s.scheme) != names(&first.scheme) {
            return Err(CalibrationError::Elements { first: first.name.clone(), other: s.name.clone() });
        }
    }
    let free = unknowns(samples, free);
    let own = |s: &Sample| -> Vec<usize> {
        let of = |u: &Unknown| u.nm.is_none_or(|nm| nm == s.ray.nm);
        (0..free.len()).filter(|i| of(&free[*i])).collect()
    };
    let predictions: Vec<Predictions> = samples.iter().map(|s| Predictions::new(own(s))).collect();
    let predicted = |k: usize, p: &[f64]| {
        let s = &samples[k];
        predictions[k].of(p, |numbers| {
            let mut scheme = s.scheme.clone();
            for (i, value) in predictions[k].own.iter().zip(numbers) {
                let parameter = free[*i].parameter;
                parameter.set(&mut scheme, parameter.from_fit(*value)[0]);
            }
            DesignMatrix::new(&scheme, &s.ray).intensities(&s.mueller).as_slice().to_vec()
        })
    };
    let believed =
        |u: &Unknown| u.parameter.to_fit(u.parameter.get(&first.scheme, u.nm.unwrap_or(first.ray.nm)));
    let mut start: Vec<f64> = free.iter().map(believed).collect();
    let mut steps: Vec<f64> = free.iter().map(|u| u.parameter.step()).collect();
    let believed = start.clone();
    for (k, s) in samples.iter().enumerate() {
        let dark = predicted(k, &believed);
        let (mut of, mut squares) = (0.0, 0.0);
        for ((i, d), sigma) in s.intensities.iter().zip(dark.iter()).zip(&s.sigmas) {
            of += i * d / sigma.powi(2);
            squares += d * d / sigma.powi(2);
        }
        let brightness = of / squares;
        start.push(brightness);
        steps.push(1e-4 * brightness.abs().max(1e-30));
    }
    let residuals = |p: &[f64]| -> Vec<f64> {
        let mut out = vec![];
        for (k, s) in samples.iter().enumerate() {
            let scale = p[free.len() + k];
            let clean = predicted(k, p);
            let all = s.intensities.iter().zip(clean.iter()).zip(&s.sigmas);
            out.extend(all.map(|((i, d), sigma)| (i - scale * d) / sigma));
        }
        out
    };
    let mut fit = fit(&start, &steps, &residuals)?;
    for (i, unknown) in free.iter().enumerate() {
        let [value, slope] = unknown.parameter.from_fit(fit.values[i]);
        fit.values[i] = value;
        fit.covariance.row_mut(i).scale_mut(slope);
        fit.covariance.column_mut(i).scale_mut(slope);
    }
    let named = |u: &Unknown| {
        let name = u.parameter.name(&first.scheme);
        u.nm.map_or(name.clone(), |nm| format!("{name} at {nm} nm"))
    };
    let mut names: Vec<String> = free.iter().map(named).collect();
    names.extend(samples.iter().map(|s| format!("brightness of {}", s.name)));
    let mut scheme = first.scheme.clone();
    let mut found: Vec<Found> = vec![];
    for (i, unknown) in free.iter().enumerate() {
        found.push(Found {
            parameter: unknown.parameter,
            nm: unknown.nm,
            name: names[i].clone(),
            value: fit.values[i],
            sigma: fit.sigma(i),
        });
    }
    for of in found.chunk_by(|a, b| a.parameter == b.parameter) {
        let nm = |f: &Found| f.nm.unwrap_or(first.ray.nm);
        let rows: Vec<[f64; 2]> = of.iter().map(|f| [nm(f), f.parameter.possible(f.value)]).collect();
        of[0].parameter.set_table(&mut scheme, &rows);
    }
    if let (Some(now), Some(before)) = (&mut scheme.coaxial, &first.scheme.coaxial) {
        // The brightness of each sample is fitted, so the fit does not change the brightness of the optics.
        now.keep_brightness(before, &wavelengths(samples));
    }
    Ok(Calibrated { scheme, found, undetermined: fit.describe_undetermined(&names), fit })
}
