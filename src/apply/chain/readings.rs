//! Captures a slice, and reconstructs the slice from the captures.

use super::error::ChainError;
use super::exposure::Detectors;
use super::light::Light;
use crate::observation::Slice;
use polarimetry::capture::element::{Element, ElementKind, Setting};
use polarimetry::capture::scheme::{Scheme, Sensor};
use polarimetry::capture::simulate::{Captured, Noise};
use polarimetry::capture::spectral_value::SpectralValue;
use polarimetry::reconstruct::along_rays::{Places, reconstruct};
use polarimetry::reconstruct::pixels::Options;
use polarimetry::reconstruct::predicted::of_counts;
use polarimetry::reconstruct::second_moment::Moment;
use tensor::array::Tensor;

#[derive(Clone, Debug)]
pub struct Readings<'a> {
    slice: &'a Slice,
    light: Light,
    noise: Noise,
    captured: Captured,
}

/// Numbers of pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    /// Number of all combinations of pixel, time and wavelength.
    pub pixels: usize,
    /// Number of pixels with too few unsaturated readings. The reconstruction of these pixels includes
    /// saturated readings.
    pub clipped: usize,
}

/// Returns the scheme of a camera that captures intensities without polarizing elements.
fn open() -> Result<Scheme, ChainError> {
    let mut glass = Element::polarizer("glass", Setting::Fixed(0.0));
    glass.kind = ElementKind::Polarizer { extinction: SpectralValue::Same(1.0) };
    Scheme::new("photograph", vec![glass], vec![], Sensor::Intensity)
        .map_err(|e| ChainError::Axes { slice: e.to_string(), what: "the scheme of the camera is invalid" })
}

impl<'a> Readings<'a> {
    /// Captures a slice through the true elements. Only the values of the slice are captured. The standard
    /// errors of the slice are kept unchanged.
    ///
    /// # Errors
    /// [`ChainError`] if the detector refuses its settings or the light.
    pub fn of(slice: &'a Slice, real: &Scheme, detectors: &Detectors, seed: u64) -> Result<Self, ChainError> {
        let light = Light::of(slice)?;
        let noise = detectors.noise(&light)?;
        let captured = if light.polarized {
            light.image.capture(real, &noise, seed)?
        } else {
            light.image.capture(&open()?, &noise, seed)?
        };
        Ok(Self { slice, light, noise, captured })
    }

    /// Reconstructs the slice with `believed` elements. If the captures do not determine a matrix, the
    /// reconstruction uses a prior. Standard errors combine the standard errors of the slice and of the
    /// captures. Assumed and true elements have the same settings.
    ///
    /// # Errors
    /// [`ChainError::Rank`] if the captures do not determine a matrix and there is no prior.
    pub fn reconstructed(
        &self,
        believed: &Scheme,
        prior: Option<&Moment>,
    ) -> Result<(Slice, Count), ChainError> {
        let captured = &self.captured;
        let pixels = captured.layout.pixels();
        let (mut out, mut errors) = (vec![0.0_f32; pixels * 16], vec![0.0_f32; pixels * 16]);
        let mut count = Count { pixels, clipped: 0 };
        if self.light.polarized {
            count.clipped = self.matrices(believed, prior, &mut out, &mut errors)?;
        } else {
            let brim = self.brim();
            for (p, v) in captured.intensities.iter().enumerate() {
                let known = v.is_finite();
                let nm = self.light.image.rays[p % captured.layout.lanes].nm;
                count.clipped += usize::from(!known);
                let value = if known { f64::from(*v) } else { brim[0] };
                out[16 * p] = value as f32;
                errors[16 * p] = match &self.noise {
                    Noise::Spad(diode) => diode.variance(value, nm),
                    _ => self.variance(0, p).filter(|_| known).unwrap_or(brim[1]),
                }
                .sqrt() as f32;
            }
        }
        let mean = Light::tensor(&self.slice.mean, &out);
        let own = Light::tensor(&self.slice.mean, &errors);
        let error = Tensor {
            data: own.data.iter().zip(&self.slice.error.data).map(|(a, b)| a.hypot(*b)).collect(),
            ..self.slice.error.clone()
        };
        Ok((Slice { mean, error }, count))
    }

    /// Reconstructs complete matrices and the errors of the matrices. Returns the number of pixels for which
    /// saturated readings were used.
    fn matrices(
        &self,
        believed: &Scheme,
        prior: Option<&Moment>,
        out: &mut [f32],
        errors: &mut [f32],
    ) -> Result<usize, ChainError> {
        let layout = self.captured.layout;
        let rays = &self.light.image.rays;
        let places = Places { rays, times: layout.times, lanes: layout.lanes };
        let clean = matches!(self.noise, Noise::None);
        let mut variances = self.captured.variances.clone();
        if let Noise::Spad(diode) = &self.noise {
            let plain = Options { noise: None, prior: prior.copied(), ..Options::default() };
            let readings = &self.captured.intensities;
            let of = |radiance: f64, nm: f64| diode.variance(radiance, nm);
            variances = Some(of_counts(believed, rays, layout, &plain, readings, out, &of)?);
        }
        let options = Options {
            noise: self.captured.typical_noise(&self.noise).filter(|s| *s > 0.0),
            prior: prior.copied(),
            ..Options::default()
        };
        let mut readings = self.captured.intensities.clone();
        let tally = reconstruct(
            believed,
            places,
            &options,
            &readings,
            variances.as_deref(),
            out,
            (!clean).then_some(&mut *errors),
        )?;
        if tally.lost == 0 {
            return Ok(0);
        }
        // The true value of a saturated reading is at least the maximum reading. Pixels with too few
        // unsaturated readings use the maximum reading.
        let [most, spread] = self.brim();
        for (i, v) in readings.iter_mut().enumerate().filter(|(_, v)| !v.is_finite()) {
            *v = most as f32;
            if let Some(variances) = &mut variances {
                variances[i] = spread as f32;
            }
        }
        let (mut all, mut all_errors) = (vec![0.0; out.len()], vec![0.0; out.len()]);
        reconstruct(
            believed,
            places,
            &options,
            &readings,
            variances.as_deref(),
            &mut all,
            Some(&mut all_errors),
        )?;
        for (p, matrix) in out.chunks_exact_mut(16).enumerate() {
            if matrix.iter().any(|v| !v.is_finite()) {
                matrix.copy_from_slice(&all[16 * p..][..16]);
                errors[16 * p..][..16].copy_from_slice(&all_errors[16 * p..][..16]);
            }
        }
        Ok(tally.lost)
    }

    fn variance(&self, m: usize, p: usize) -> Option<f64> {
        let all = self.captured.variances.as_ref()?;
        Some(f64::from(all[m * self.captured.layout.pixels() + p]))
    }

    /// Returns the maximum radiance that the camera can measure, and the variance of this reading.
    fn brim(&self) -> [f64; 2] {
        let Noise::Cmos { camera, .. } = &self.noise else {
            return [0.0; 2];
        };
        let nm = self.light.image.rays.first().map_or(550.0, |r| r.nm);
        let dn = camera.saturation_dn().saturating_sub(1);
        let of = |factor: &f64| camera.estimate(dn, nm, *factor);
        let brightest = camera.bracket.iter().map(of).max_by(|a, b| a.radiance.total_cmp(&b.radiance));
        brightest.map_or([0.0; 2], |e| [e.radiance, e.variance])
    }
}
