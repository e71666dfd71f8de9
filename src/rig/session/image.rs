//! Converts the raw frames of a run to intensities per mask, and reads the element angles from the encoders'
//! records.

use crate::instrument::PixelFormat;
use polarimetry::capture::detector::cmos::Cmos;
use polarimetry::capture::detector::estimate::Estimate;
use polarimetry::capture::detector::polarizer_array::{Method, demosaic, demosaic_variance};
use polarimetry::capture::detector::spad::Spad;
use polarimetry::capture::scheme::Scheme;
use polarimetry::capture::scheme_file;
use polarimetry::capture::simulate::Layout;
use rayon::prelude::*;
use serde_json::Value;
use std::path::Path;
use store::zarr::frames::FrameStore;

/// An error while reading the frames of a run.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct ImageError(pub String);

pub(super) fn failed(e: impl ToString) -> ImageError {
    ImageError(e.to_string())
}

/// A finished run, opened for reading.
pub struct Run {
    pub(super) store: FrameStore,
    /// The plan's scheme with the element angles that the encoders reported.
    pub scheme: Scheme,
    /// Wavelength in nanometres.
    pub nm: f64,
    /// Names of the masks. A scan has one mask, `scan`.
    pub masks: Vec<String>,
    /// Horizontal field of view of a scan, in radians.
    pub fov_x: Option<f64>,
    pub(super) work: Value,
    detector: Value,
}

/// Intensities of all captures through one mask.
pub struct Intensities {
    /// Intensities in the unit of the tensor, for each measurement and pixel. The value is NaN for a pixel
    /// that was not read or that has only saturated readings.
    pub values: Vec<f32>,
    /// Variances of the intensities. Infinite for unknown intensities.
    pub variances: Vec<f32>,
    pub layout: Layout,
    /// Start and width of the time bins, in ps.
    pub time: Option<(f64, f64)>,
}

impl Run {
    /// Opens a finished run.
    ///
    /// `scheme` is the calibrated scheme, if there is one. The angles come from the encoders, not from
    /// `scheme`.
    ///
    /// # Errors
    /// Returns [`ImageError`] if the run is missing, unfinished or damaged, or if the elements of `scheme`
    /// differ from those of the run.
    pub fn open(path: &Path, scheme: Option<&Scheme>) -> Result<Self, ImageError> {
        let store = FrameStore::open(path).map_err(failed)?;
        let damaged = |what: &str| {
            ImageError(format!(
                "{}: the attribute `{what}` of the run is damaged; restore the run from a backup",
                path.display()
            ))
        };
        let attribute = |name: &str| store.attributes().get(name).cloned().ok_or_else(|| damaged(name));
        let text = attribute("scheme")?;
        let planned =
            scheme_file::from_toml(path, text.as_str().ok_or_else(|| damaged("scheme"))?).map_err(failed)?;
        let given = scheme.unwrap_or(&planned);
        if !same_elements(given, &planned) {
            return Err(ImageError(format!(
                "the scheme has the elements {:?}, but the run has the elements {:?}; pass a calibration of the scheme of this run",
                elements(given),
                elements(&planned)
            )));
        }
        let scheme =
            stood(&store, given, &planned).map_err(|e| ImageError(format!("{}: {e}", path.display())))?;
        let work = attribute("work")?;
        let masks = match work["masks"].as_array() {
            Some(list) => list.iter().filter_map(|m| Some(m["name"].as_str()?.to_owned())).collect(),
            None => vec!["scan".to_owned()],
        };
        Ok(Self {
            nm: attribute("wavelength_nm")?.as_f64().ok_or_else(|| damaged("wavelength_nm"))?,
            detector: attribute("detector")?,
            fov_x: work["fov_x_deg"].as_f64().map(f64::to_radians),
            work,
            masks,
            scheme,
            store,
        })
    }

    /// Returns the intensities through a mask. If the run has a dark mask, the intensities of the dark
    /// mask are subtracted.
    ///
    /// # Errors
    /// Returns [`ImageError`] if the mask does not exist or frames are damaged.
    pub fn intensities(&self, mask: &str, method: Method) -> Result<Intensities, ImageError> {
        if self.work["kind"] == "scan" {
            return self.scan();
        }
        let mut found = self.camera(mask, method)?;
        if mask != "dark" && self.masks.iter().any(|m| m == "dark") {
            let dark = self.camera("dark", method)?;
            for (v, d) in found.values.iter_mut().zip(&dark.values) {
                *v -= d;
            }
            for (v, d) in found.variances.iter_mut().zip(&dark.variances) {
                *v += d;
            }
        }
        Ok(found)
    }

    pub fn attributes(&self) -> &serde_json::Map<String, Value> {
        self.store.attributes()
    }

    pub(super) fn damaged(&self, what: &str) -> ImageError {
        ImageError(format!(
            "{}: {what} is damaged; restore the run from a backup",
            self.store.path().display()
        ))
    }

    /// Returns the lengths of the frames' axes.
    pub(super) fn shape<const N: usize>(&self) -> Result<[usize; N], ImageError> {
        let shape: Vec<usize> = self.store.layout().shape().into_iter().map(|n| n as usize).collect();
        shape.try_into().map_err(|_| self.damaged("the frames' shape"))
    }

    /// Returns the bits per pixel of the camera's format.
    pub fn bits(&self) -> u32 {
        let format = PixelFormat::ALL.into_iter().find(|f| self.work["format"] == f.name());
        format.map_or(16, PixelFormat::bits)
    }

    /// Returns the camera's gain relative to 0 dB.
    pub fn gain(&self) -> f64 {
        10_f64.powf(self.work["gain_db"].as_f64().unwrap_or(0.0) / 20.0)
    }

    fn camera(&self, mask: &str, method: Method) -> Result<Intensities, ImageError> {
        let layout = self.store.layout();
        let [captures, shots, exposures, height, width] = self.shape()?;
        let list = self.work["masks"].as_array().ok_or_else(|| self.damaged("`masks`"))?;
        let entry = list.iter().find(|m| m["name"] == mask).ok_or_else(|| {
            ImageError(format!("unknown mask `{mask}`; the run has the masks {}", self.masks.join(", ")))
        })?;
        let first = entry["first"].as_u64().unwrap_or(u64::MAX) as usize;
        let count = entry["shots"].as_u64().unwrap_or(0) as usize;
        let map = self
            .store
            .read_map(&format!("shot_of_{mask}"))
            .map_err(failed)?
            .ok_or_else(|| self.damaged("the mask's map"))?;
        let shot_of: Vec<Option<usize>> =
            map.iter().map(|s| (*s >= 0.0 && (*s as usize) < count).then_some(*s as usize)).collect();
        if first.saturating_add(count) > shots || shot_of.len() != height * width {
            return Err(self.damaged("`masks`"));
        }
        let mut cmos: Cmos = serde_json::from_value(self.detector["cmos"].clone())
            .map_err(|e| ImageError(format!("{}: {e}", self.store.path().display())))?;
        let times = &layout.axes[2].coords;
        if times.iter().any(|t| !(*t > 0.0 && t.is_finite())) {
            return Err(self.damaged("`exposure`"));
        }
        cmos.bit_depth = cmos.bit_depth.min(self.bits());
        let full = ((1_u64 << cmos.bit_depth) - 1) as f64;
        let gain = self.gain();
        cmos.gain_e_per_dn = Some(cmos.gain_e_per_dn.unwrap_or(cmos.full_well_e / full) / gain);
        cmos.exposure_s = times[0];
        cmos.bracket = times.iter().map(|t| t / times[0]).collect();
        cmos.binning = 1;
        cmos.check().map_err(failed)?;
        let pixels = height * width;
        let channels = self.scheme.sensor.channels();
        let one = |k: usize| -> Result<Vec<[Vec<f64>; 2]>, ImageError> {
            let mut frames: Vec<Vec<u32>> = vec![];
            for shot in first..first + count {
                for e in 0..exposures {
                    let n = (k * shots + shot) * exposures + e;
                    frames.push(self.store.read_chunk(n).map_err(failed)?);
                }
            }
            let estimate = |p: usize| {
                let Some(shot) = shot_of[p] else {
                    return Estimate::UNKNOWN;
                };
                let of = |e: usize| cmos.estimate(frames[shot * exposures + e][p], self.nm, cmos.bracket[e]);
                if exposures == 1 {
                    of(0)
                } else {
                    cmos.combine(&(0..exposures).map(of).collect::<Vec<_>>(), self.nm)
                }
            };
            let all: Vec<Estimate> = (0..pixels).map(estimate).collect();
            let known = |e: &Estimate| !e.saturated && e.radiance.is_finite();
            let values = all.iter().map(|e| if known(e) { e.radiance } else { f64::NAN }).collect();
            let variances = all.iter().map(|e| if known(e) { e.variance } else { f64::INFINITY }).collect();
            if channels == 1 {
                return Ok(vec![[values, variances]]);
            }
            let images = demosaic(&values, width, height, method).map_err(failed)?;
            let spread = demosaic_variance(&variances, width, height, method).map_err(failed)?;
            let pairs = images.images.into_iter().zip(spread.images);
            Ok(pairs.map(|(v, s)| [v, s]).collect())
        };
        let captured: Vec<Vec<[Vec<f64>; 2]>> =
            (0..captures).into_par_iter().map(one).collect::<Result<_, _>>()?;
        let halved = channels == 4 && method == Method::Superpixel;
        let side = if halved { 2 } else { 1 };
        let mut out = Intensities {
            values: vec![],
            variances: vec![],
            layout: Layout { height: height / side, width: width / side, times: 1, lanes: 1 },
            time: None,
        };
        for [values, variances] in captured.into_iter().flatten() {
            out.values.extend(values.into_iter().map(|v| v as f32));
            out.variances
                .extend(variances.into_iter().map(|v| if v.is_nan() { f32::INFINITY } else { v as f32 }));
        }
        Ok(out)
    }

    pub(super) fn pulses(&self) -> Result<Vec<f64>, ImageError> {
        let read = self.store.read_column("pulses").map_err(failed)?;
        read.ok_or_else(|| self.damaged("`pulses`"))
    }

    /// Returns the diode of a scan, with the bins and the mean number of pulses of the counter, or `None` for
    /// a camera run.
    ///
    /// # Errors
    /// Returns [`ImageError`] if the stored parameters of the diode are damaged.
    pub fn diode(&self) -> Result<Option<Spad>, ImageError> {
        if self.work["kind"] != "scan" {
            return Ok(None);
        }
        let mut spad: Spad = serde_json::from_value(self.detector["spad"].clone())
            .map_err(|e| ImageError(format!("{}: {e}", self.store.path().display())))?;
        let bins = self.store.layout().frame_len();
        let bin_ps = self.work["bin_ps"].as_f64().ok_or_else(|| self.damaged("`bin_ps`"))?;
        spad.bin_ps = bin_ps;
        spad.bins = bins;
        spad.period_ps = (spad.period_ps / bin_ps).round().max(bins as f64) * bin_ps;
        let pulses = self.pulses()?;
        spad.pulses = (pulses.iter().sum::<f64>() / pulses.len().max(1) as f64).max(1.0) as u64;
        spad.check().map_err(failed)?;
        Ok(Some(spad))
    }

    fn scan(&self) -> Result<Intensities, ImageError> {
        let [captures, height, width, bins] = self.shape()?;
        let spad = self.diode()?.ok_or_else(|| self.damaged("`detector`"))?;
        let offset_ps = self.work["offset_ps"].as_f64().ok_or_else(|| self.damaged("`offset_ps`"))?;
        let bin_ps = spad.bin_ps;
        let pulses = self.pulses()?;
        let row = |n: usize| -> Result<Vec<[f32; 2]>, ImageError> {
            let counts = self.store.read_chunk(n).map_err(failed)?;
            let mut out = Vec::with_capacity(width * bins);
            for (x, counts) in counts.chunks_exact(bins).enumerate() {
                let mut diode = spad.clone();
                diode.pulses = pulses[n * width + x].max(1.0) as u64;
                // Bins beyond the counter's window were not read. These bins do not affect earlier bins.
                let mut period: Vec<u64> = counts.iter().map(|c| u64::from(*c)).collect();
                period.resize(diode.period_bins(), 0);
                let found = diode.estimate(&period, self.nm).map_err(failed)?;
                out.extend(found.iter().map(|e| {
                    let v = if e.saturated { f64::NAN } else { e.radiance };
                    [v as f32, e.variance as f32]
                }));
            }
            Ok(out)
        };
        let rows: Vec<Vec<[f32; 2]>> =
            (0..captures * height).into_par_iter().map(row).collect::<Result<_, _>>()?;
        let all = || rows.iter().flatten();
        Ok(Intensities {
            values: all().map(|p| p[0]).collect(),
            variances: all().map(|p| p[1]).collect(),
            layout: Layout { height, width, times: bins, lanes: 1 },
            time: Some((offset_ps, bin_ps)),
        })
    }
}

/// Returns the names of a scheme's elements in the order in which light passes them.
pub(super) fn elements(scheme: &Scheme) -> Vec<String> {
    scheme.generator().iter().chain(scheme.analyzer()).map(|e| e.name.clone()).collect()
}

pub(super) fn same_elements(a: &Scheme, b: &Scheme) -> bool {
    elements(a) == elements(b) && a.sensor.channels() == b.sensor.channels()
}

/// Returns the scheme `given` with the encoders' angles, averaged over the frames of each capture.
fn stood(store: &FrameStore, given: &Scheme, planned: &Scheme) -> Result<Scheme, String> {
    let captures = planned.captures();
    let frames = store.layout().frames();
    let per = frames / captures.max(1);
    if per * captures != frames {
        return Err(format!(
            "the run has {frames} frames; expected a multiple of {captures}, the number of captures of the scheme"
        ));
    }
    let mut out = given.clone();
    for name in elements(given) {
        let read = store.read_column(&format!("angle_{name}")).map_err(|e| e.to_string())?;
        let element = planned.generator().iter().chain(planned.analyzer()).find(|e| e.name == name);
        let angles: Vec<f64> = match (read, element) {
            (Some(angles), _) => {
                angles.chunks_exact(per).map(|a| (a.iter().sum::<f64>() / per as f64).to_radians()).collect()
            }
            (None, Some(element)) => (0..captures).map(|k| element.set_at(k).angle).collect(),
            (None, None) => continue,
        };
        if let Some(k) = angles.iter().position(|a| !a.is_finite()) {
            return Err(format!(
                "the angle of `{name}` at capture {k} (counted from 0) is not a finite number"
            ));
        }
        out = out.turned(&name, &angles).map_err(|e| e.to_string())?;
    }
    Ok(out)
}
