//! The scenery of the simulated bench. The scenery is a rendered tensor in memory, a scan read row by row, or
//! a uniform sample.

use polarimetry::capture::bench::{Bench, Light, times};
use polarimetry::capture::design_matrix::ELEMENTS;
use polarimetry::capture::directions::Directions;
use polarimetry::capture::element::Set;
use rayon::prelude::*;
use std::path::Path;
use store::denoised;
use store::zarr::{StoredSlice, TensorStore};
use tensor::axes::AxisKind;
use tensor::field::Field;

/// Maximum total size of cached images, in bytes. Images are cached because a run repeats its patterns.
const KEPT_BYTES: usize = 512 << 20;
/// Maximum size of the cached rows of a scan, in bytes.
const MOST_ROWS_BYTES: usize = 64 << 20;
/// Maximum size of a slice that is loaded into memory, in bytes.
const MOST_BYTES: u64 = 6 << 30;

/// The object that the simulated bench illuminates.
pub enum Scenery {
    /// A uniform sample such as air, a mirror or a known plate. Every camera pixel has the same Mueller
    /// matrix. With time bins, all light is in the first bin.
    Sample {
        /// Row-major Mueller matrix at full drive of all projector pixels.
        mueller: [f32; ELEMENTS],
        /// Columns and rows of the camera.
        camera: [usize; 2],
        /// Buffer of the sample's image, 16 elements per pixel.
        image: Vec<f32>,
    },
    /// A tensor T(s, s', p, p') in memory.
    Tensor(PlayedTensor),
    /// A scan T(s, s' = s, p, p', t), read by rows of scan points.
    Scan(PlayedScan),
}

/// A tensor T(s, s', p, p') at one wavelength, in memory.
pub struct PlayedTensor {
    /// Columns and rows of the camera.
    pub camera: [usize; 2],
    /// Columns and rows of the projector axis s'.
    pub projector: [usize; 2],
    /// Tensor elements, with the axes camera pixel, projector pixel and Mueller element.
    data: Vec<f32>,
    /// Cached pairs of pattern and image, oldest first.
    kept: Vec<(Vec<f32>, Vec<f32>)>,
    lit: Vec<[f64; 4]>,
}

/// A scan T(s, s, p, p', t) at one wavelength, read row by row.
pub struct PlayedScan {
    slice: StoredSlice,
    /// Columns and rows of the scan.
    pub camera: [usize; 2],
    pub bins: usize,
    pub bin_ps: f64,
    pub start_ps: f64,
    lane: usize,
    lanes: usize,
    /// Index of the first cached row, and the data of the cached rows.
    rows: Option<(usize, Vec<f32>)>,
    /// Number of rows that are read together. This is the number of rows in a chunk if these rows fit into
    /// memory, otherwise 1.
    together: usize,
}

impl Scenery {
    /// Creates a uniform sample in front of a camera.
    pub fn sample(mueller: [f32; ELEMENTS], camera: [usize; 2]) -> Self {
        let image = mueller.repeat(camera[0] * camera[1]);
        Self::Sample { mueller, camera, image }
    }

    /// Opens a slice of a finished store at a wavelength. A slice with time bins becomes a scan. Any other
    /// slice becomes a tensor that patterns illuminate.
    ///
    /// # Errors
    /// Returns a message if the store cannot be read or a simulated sensor cannot read the slice.
    pub fn open(path: &Path, name: &str, nm: f64) -> Result<Self, String> {
        let store = TensorStore::open(path).map_err(|e| e.to_string())?;
        denoised::refuse(&store).map_err(|e| e.to_string())?;
        let slice = store.slice(name).map_err(|e| e.to_string())?;
        let place = format!("{} slice `{name}`", path.display());
        let layout = slice.layout();
        let len = |kind| layout.find(kind).map(|i| layout.axes[i].len() as usize);
        let (Some(height), Some(width)) = (len(AxisKind::Y), len(AxisKind::X)) else {
            return Err(format!(
                "{place}: the slice has no rows and columns of the camera; use a slice with camera = \"all\""
            ));
        };
        if len(AxisKind::StokesOut) != Some(4) || len(AxisKind::StokesIn) != Some(4) {
            return Err(format!(
                "{place}: the slice has no Mueller matrices; render the slice with polarization = \"mueller\""
            ));
        }
        let parts = [AxisKind::Bounces, AxisKind::Component, AxisKind::Label];
        if parts.into_iter().any(|kind| len(kind).is_some()) {
            return Err(format!(
                "{place}: the slice is split into parts, but a sensor measures the sum of all parts; use a slice without parts"
            ));
        }
        let axis = layout.find(AxisKind::Wavelength).map(|i| &layout.axes[i]);
        let (lane, lanes) = match axis {
            None => (0, 1),
            Some(axis) => {
                let lane = axis.nearest(nm);
                if (axis.coords[lane] - nm).abs() > 1.0 {
                    return Err(format!(
                        "{place}: the bench's light has a wavelength of {nm} nm, but the slice has only {:?} nm; render the slice at \
                         the wavelength of the light",
                        axis.coords
                    ));
                }
                (lane, axis.coords.len())
            }
        };
        let camera = [width, height];
        if let Some(bins) = len(AxisKind::T) {
            if len(AxisKind::V).is_some() {
                return Err(format!(
                    "{place}: a scan needs a slice with projector = \"coaxial\" and time bins"
                ));
            }
            let (start_ps, bin_ps) = layout.time.unwrap_or((0.0, 1.0));
            return Ok(Self::Scan(PlayedScan {
                camera,
                bins,
                bin_ps,
                start_ps,
                lane,
                lanes,
                rows: None,
                together: {
                    let rows = layout.axes[0].chunk.max(1) as usize;
                    let fits = rows * width * bins * ELEMENTS * lanes * 4 <= MOST_ROWS_BYTES;
                    if fits { rows } else { 1 }
                },
                slice,
            }));
        }
        let projector = [len(AxisKind::U).unwrap_or(1), len(AxisKind::V).unwrap_or(1)];
        let bytes = layout.shape().iter().product::<u64>().saturating_mul(4);
        if bytes > MOST_BYTES {
            return Err(format!(
                "{place}: the slice needs {:.1} GB of memory, but the limit is {:.1} GB; bin the camera or the projector",
                bytes as f64 / 1e9,
                MOST_BYTES as f64 / 1e9
            ));
        }
        let mut data = Vec::with_capacity(width * height * projector[0] * projector[1] * ELEMENTS);
        // Read the rows of a chunk together, so that each chunk is decompressed once.
        let rows = layout.axes[0].chunk.max(1);
        for y in (0..height as u64).step_by(rows as usize) {
            let mut shape = layout.shape();
            let mut start = vec![0; shape.len()];
            (start[0], shape[0]) = (y, rows.min(height as u64 - y));
            let block = slice.read(Field::Mean, &start, &shape).map_err(|e| e.to_string())?;
            data.extend(block.into_iter().skip(lane).step_by(lanes));
        }
        Ok(Self::Tensor(PlayedTensor { camera, projector, data, kept: vec![], lit: vec![] }))
    }

    /// Returns the columns and rows of the camera or of the scan.
    pub fn camera(&self) -> [usize; 2] {
        match self {
            Self::Sample { camera, .. } => *camera,
            Self::Tensor(t) => t.camera,
            Self::Scan(s) => s.camera,
        }
    }

    /// Returns the light from the scenery under a pattern, or `None` without a pattern.
    ///
    /// The pattern contains the drive of each projector pixel. Each entry of s' covers a whole number of
    /// projector pixels.
    ///
    /// # Errors
    /// Returns a message if the pattern does not fit the tensor, or if the scenery is a scan.
    pub fn light(
        &mut self,
        pattern: Option<&Vec<f32>>,
        bench: &Bench,
        generator: &[Set],
    ) -> Result<Option<Light<'_>>, String> {
        let Some(pattern) = pattern else {
            return Ok(None);
        };
        match self {
            Self::Sample { image, mueller, .. } => {
                let drive = pattern.iter().sum::<f32>() / pattern.len().max(1) as f32;
                for m in image.chunks_exact_mut(ELEMENTS) {
                    m.iter_mut().zip(mueller.iter()).for_each(|(o, v)| *o = v * drive);
                }
                Ok(Some(Light::Mueller(image)))
            }
            Self::Scan(_) => Err("a galvo scan has no patterns; use a slice with projector pixels".into()),
            Self::Tensor(tensor) => tensor.light(pattern, bench, generator).map(Some),
        }
    }
}

impl PlayedTensor {
    fn light(&mut self, pattern: &[f32], bench: &Bench, generator: &[Set]) -> Result<Light<'_>, String> {
        let boxes = self.projector[0] * self.projector[1];
        if pattern.len() != boxes {
            return Err(format!(
                "the pattern has {} pixels, but the tensor has {} x {} projector pixels; use patterns of this size",
                pattern.len(),
                self.projector[0],
                self.projector[1]
            ));
        }
        if bench.projector == Directions::Axial {
            let at = match self.kept.iter().position(|(p, _)| p == pattern) {
                Some(at) => at,
                None => self.keep(pattern),
            };
            return Ok(Light::Mueller(&self.kept[at].1));
        }
        let lit: Vec<(usize, nalgebra::Vector4<f64>)> = lit_pixels(pattern)
            .map(|(i, drive)| {
                let place = [i % self.projector[0], i / self.projector[0]];
                let state = bench.lighting(generator, place, self.projector);
                (i, state * f64::from(drive))
            })
            .collect();
        let pixel = |data: &[f32]| -> [f64; 4] {
            let all = lit.iter().map(|(i, state)| times(&data[i * ELEMENTS..][..ELEMENTS], state));
            all.sum::<nalgebra::Vector4<f64>>().into()
        };
        self.lit = self.data.par_chunks_exact(boxes * ELEMENTS).map(pixel).collect();
        Ok(Light::Stokes(&self.lit))
    }

    /// Contracts the tensor with a pattern and caches the image. Evicts the oldest images if necessary.
    fn keep(&mut self, pattern: &[f32]) -> usize {
        let boxes = self.projector[0] * self.projector[1];
        let size = self.camera[0] * self.camera[1] * ELEMENTS;
        while !self.kept.is_empty() && (self.kept.len() + 1) * size * 4 > KEPT_BYTES {
            self.kept.remove(0);
        }
        let lit: Vec<(usize, f32)> = lit_pixels(pattern).collect();
        let mut image = vec![0.0_f32; size];
        let pixels = image.par_chunks_exact_mut(ELEMENTS);
        pixels.zip(self.data.par_chunks_exact(boxes * ELEMENTS)).for_each(|(out, data)| {
            for (i, drive) in &lit {
                let m = &data[i * ELEMENTS..][..ELEMENTS];
                out.iter_mut().zip(m).for_each(|(o, v)| *o += drive * v);
            }
        });
        self.kept.push((pattern.to_vec(), image));
        self.kept.len() - 1
    }
}

fn lit_pixels(pattern: &[f32]) -> impl Iterator<Item = (usize, f32)> {
    let all = pattern.iter().copied().enumerate();
    all.filter(|(_, drive)| *drive > 0.0)
}

impl PlayedScan {
    /// Returns 16 elements per bin of a scan point. The most recently read rows stay in memory.
    ///
    /// # Errors
    /// Returns a message if the store is damaged or the point does not exist.
    pub fn point(&mut self, x: usize, y: usize) -> Result<&[f32], String> {
        let [width, height] = self.camera;
        if x >= width || y >= height {
            return Err(format!(
                "the beam points to {x}, {y}, which is outside the {width} x {height} points of the scan"
            ));
        }
        let first = y / self.together * self.together;
        let at = match self.rows.take() {
            Some((found, data)) if found == first => (found, data),
            _ => {
                let mut shape = self.slice.layout().shape();
                let mut start = vec![0; shape.len()];
                (start[0], shape[0]) = (first as u64, self.together.min(height - first) as u64);
                let all = self.slice.read(Field::Mean, &start, &shape).map_err(|e| e.to_string())?;
                (first, all.into_iter().skip(self.lane).step_by(self.lanes).collect())
            }
        };
        let (_, data) = self.rows.insert(at);
        let n = self.bins * ELEMENTS;
        Ok(&data[((y - first) * width + x) * n..][..n])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Map, json};
    use tensor::axes::{Axis, SliceLayout};

    #[test]
    fn denoised_slices_are_refused() {
        let axis = |kind, n: u32| Axis { kind, coords: (0..n).map(f64::from).collect(), chunk: n.into() };
        let layout = SliceLayout {
            name: "m".into(),
            axes: vec![
                axis(AxisKind::Y, 2),
                axis(AxisKind::X, 2),
                axis(AxisKind::V, 2),
                axis(AxisKind::U, 2),
                axis(AxisKind::StokesOut, 4),
                axis(AxisKind::StokesIn, 4),
            ],
            time: None,
            totals: false,
        };
        let folder = tempfile::tempdir().expect("a folder");
        for denoised in [false, true] {
            let path = folder.path().join(denoised.to_string());
            let mut attributes = Map::new();
            if denoised {
                attributes.insert(denoised::ATTRIBUTE.into(), json!({"of": [{"path": "a.zarr"}]}));
            }
            let slices = [(layout.clone(), Map::new())];
            let store = TensorStore::create(&path, &slices, &attributes, None, false).expect("a store");
            store.finish().expect("a manifest");
            let message = Scenery::open(&path, "m", 550.0).err().unwrap_or_default();
            assert_eq!(message.contains("is denoised") && message.contains("a.zarr"), denoised, "{message}");
        }
    }
}
