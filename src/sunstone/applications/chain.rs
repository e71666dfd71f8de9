//! Applies a capture chain to observations. Creates the rig of each seed, calibrates the rig, and captures
//! all slices of a variant.

use apply::chain::error::ChainError;
use apply::chain::exposure::{Detectors, Laboratory, mean_reading};
use apply::chain::file::{Belief, Chain, Sample};
use apply::chain::light::Light;
use apply::chain::optics::with_elements;
use apply::chain::readings::{Count, Readings};
use apply::observation::Observation;
use optics::sampling::mix::mix;
use polarimetry::capture::detector::error::DetectorError;
use polarimetry::capture::element::Ray;
use polarimetry::capture::mueller_image::DEFAULT_NM;
use polarimetry::capture::scheme::Scheme;
use polarimetry::capture::simulate::{Layout, Noise, simulate};
use polarimetry::reconstruct::second_moment::Moment;
use rig::calibrate::polarimetric::parameters::Parameter;
use rig::calibrate::polarimetric::samples::{self, CalibrationError};
use rig::session::rig_file::sample_of;
use tensor::axes::AxisKind;

/// Width and height, in pixels, of the block that calibration averages.
const SIDE: usize = 16;

/// Number of captures of a calibration sample. All elements rotate between captures.
const CAPTURES: usize = 36;

/// The reason why a chain failed.
#[derive(Debug, thiserror::Error)]
pub enum ChainFailure {
    #[error("variant {variant}: {cause}")]
    Slice { variant: u64, cause: ChainError },
    /// The polarizing elements cannot be calibrated.
    #[error("calibration: {0}; set `samples` to air, mirror and polarizer")]
    Calibration(#[from] CalibrationError),
    /// The detector refuses the light of a sample.
    #[error("calibration: {0}")]
    Detector(#[from] DetectorError),
}

/// A configuration of the capture chain. Each configuration has a table in the report.
#[derive(Clone, Debug)]
pub struct Link {
    /// Name of the configuration in the report.
    pub label: String,
    /// The chain that captures slices.
    pub chain: Chain,
    /// The element parameters that the reconstruction assumes.
    pub belief: Belief,
    /// Prior of the Mueller matrices, for captures that do not determine the matrices.
    pub prior: Option<Moment>,
    /// Name of the slice to capture, or `None` to capture all slices.
    pub only: Option<String>,
}

/// The real and the assumed capture scheme for one seed.
#[derive(Clone, Debug)]
pub struct Rig {
    real: Scheme,
    believed: Scheme,
}

/// Mixes a seed, numbers and a name into a distinct seed with SplitMix64. The increment is the odd
/// number closest to 2⁶⁴ divided by the golden ratio.
fn mixed(seed: u64, numbers: &[u64], name: &str) -> u64 {
    let bytes = name.bytes().map(u64::from);
    numbers
        .iter()
        .copied()
        .chain(bytes)
        .fold(seed, |state, n| mix((state ^ n).wrapping_add(0x9e37_79b9_7f4a_7c15)))
}

impl Link {
    /// Returns the scheme `settings` with the true optical elements of a seed's rig.
    fn real(&self, settings: &Scheme, seed: u64) -> Scheme {
        let rig = mixed(self.chain.seed, &[seed], "rig");
        self.chain.laboratory.optics.of(settings, rig)
    }

    /// Returns the rig of a seed, calibrated at the wavelengths `nm` (nanometres) if the reconstruction
    /// assumes calibrated elements.
    ///
    /// # Errors
    /// Returns [`ChainFailure`] if the elements cannot be calibrated.
    pub fn rig(&self, seed: u64, nm: &[f64]) -> Result<Rig, ChainFailure> {
        let nominal = &self.chain.nominal;
        let real = self.real(nominal, seed);
        let believed = match self.belief {
            Belief::Nominal => nominal.clone(),
            Belief::Exact => real.clone(),
            Belief::Calibrated => {
                let array = nominal.sensor.channels() == 4;
                let quad = Scheme::quad(CAPTURES, array).map(|quad| with_elements(&quad, nominal));
                let quad = quad.ok().filter(|q| same_elements(q, nominal));
                let plan = quad.as_ref().unwrap_or(nominal);
                let optics = self.real(plan, seed);
                let noise = self.sample_noise(&optics);
                let key = mixed(self.chain.seed, &[seed], "calibration");
                let found = calibrated(plan, &optics, &self.chain.samples, &noise, nm, key)?;
                with_elements(nominal, &found)
            }
        };
        Ok(Rig { real, believed })
    }

    /// Returns the noise of the camera, at the exposure for which a sample with T00 = 1 has the requested
    /// mean reading.
    fn sample_noise(&self, real: &Scheme) -> Noise {
        let Some(mut camera) = self.chain.laboratory.camera.clone() else {
            return Noise::None;
        };
        let per = camera.quantum_efficiency.at(550.0) * camera.exposure_s * mean_reading(real);
        camera.photons_per_unit = self.chain.laboratory.exposure.electrons / per.max(1e-300);
        Noise::Cmos { camera, demosaic: None }
    }

    /// Returns an observation with captured slices. If [`Self::only`] names a slice, only this slice is
    /// captured. Otherwise, all slices in `slices` are captured. Ground truth is unchanged.
    ///
    /// # Errors
    /// Returns [`ChainFailure`] if a slice cannot be captured.
    pub fn observe(
        &self,
        rig: &Rig,
        o: &Observation,
        slices: &[&str],
        count: &mut Count,
    ) -> Result<Observation, ChainFailure> {
        let failed = |cause| ChainFailure::Slice { variant: o.variant, cause };
        let detectors = exposed(&self.chain.laboratory, o, slices, &rig.real)?;
        let mut out = o.clone();
        let passes = |name: &&&str| self.only.as_ref().is_none_or(|only| only == **name);
        for name in slices.iter().filter(passes) {
            let Some(slice) = o.slices.get(*name) else {
                continue;
            };
            let seed = mixed(self.chain.seed, &[o.seed, o.variant], name);
            let readings = Readings::of(slice, &rig.real, &detectors, seed).map_err(failed)?;
            let (found, seen) = readings.reconstructed(&rig.believed, self.prior.as_ref()).map_err(failed)?;
            count.pixels += seen.pixels;
            count.clipped += seen.clipped;
            out.slices.insert((*name).to_owned(), found);
        }
        Ok(out)
    }
}

/// Returns the detectors of a laboratory. The exposures are computed for the slices `slices` of an
/// observation, captured through the scheme `through`.
///
/// # Errors
/// Returns [`ChainFailure::Slice`] if a slice cannot be captured.
pub fn exposed(
    laboratory: &Laboratory,
    o: &Observation,
    slices: &[&str],
    through: &Scheme,
) -> Result<Detectors, ChainFailure> {
    let lights = slices.iter().filter_map(|name| o.slices.get(*name)).map(Light::of);
    let exposed = |lights: Vec<Light>| laboratory.exposed(&lights.iter().collect::<Vec<_>>(), through);
    let lights: Result<Vec<_>, _> = lights.collect();
    lights.and_then(exposed).map_err(|cause| ChainFailure::Slice { variant: o.variant, cause })
}

/// Returns the wavelengths, in nanometres, of the first slice with a wavelength axis.
pub fn wavelengths(all: &[Observation]) -> Vec<f64> {
    let slices = all.iter().flat_map(|o| o.slices.values());
    let mut known = slices.filter_map(|s| {
        let axis = s.mean.find(AxisKind::Wavelength)?;
        Some(s.mean.axes[axis].coords.clone())
    });
    known.next().unwrap_or_else(|| vec![DEFAULT_NM])
}

/// Returns whether the elements of both schemes have the same names.
fn same_elements(a: &Scheme, b: &Scheme) -> bool {
    let names = |s: &Scheme| -> Vec<String> {
        let all = s.generator().iter().chain(s.analyzer());
        all.map(|e| e.name.clone()).collect()
    };
    names(a) == names(b)
}

/// Minimum standard deviation of a sample's readings. The minimum accounts for rounding errors in captures
/// without noise.
const ROUNDING: f64 = 1e-6;

/// Calibrates the elements from simulated captures of known samples, with the algorithm of
/// `sunstone rig calibrate`.
///
/// # Errors
/// Returns [`ChainFailure`] if the elements cannot be calibrated.
pub fn calibrated(
    plan: &Scheme,
    real: &Scheme,
    things: &[Sample],
    noise: &Noise,
    nm: &[f64],
    seed: u64,
) -> Result<Scheme, ChainFailure> {
    let places = SIDE * SIDE;
    let mut all = vec![];
    for thing in things {
        let Some(mueller) = sample_of(thing.name()) else {
            continue;
        };
        let mueller = mueller.map(f64::from);
        for (k, nm) in nm.iter().enumerate() {
            let ray = Ray::axial(*nm);
            let layout = Layout { height: SIDE, width: SIDE, times: 1, lanes: 1 };
            let seed = mixed(seed, &[k as u64], thing.name());
            let seen = simulate(&mueller.repeat(places), layout, real, &[ray], noise, seed)?;
            let (mut intensities, mut sigmas) = (vec![], vec![]);
            for (m, readings) in seen.intensities.chunks_exact(places).enumerate() {
                let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
                for (p, v) in readings.iter().enumerate().filter(|(_, v)| v.is_finite()) {
                    n += 1.0;
                    sum += f64::from(*v);
                    squares += seen.variances.as_ref().map_or(0.0, |s| f64::from(s[m * places + p]));
                }
                intensities.push(sum / n);
                sigmas.push(f64::max(squares.sqrt() / n, ROUNDING));
            }
            all.push(samples::Sample {
                name: format!("{} at {nm} nm", thing.name()),
                mueller,
                scheme: plan.clone(),
                ray,
                readings: intensities.len(),
                left_out: 0,
                intensities,
                sigmas,
            });
        }
    }
    Ok(samples::calibrate(&all, &Parameter::all(plan))?.scheme)
}
