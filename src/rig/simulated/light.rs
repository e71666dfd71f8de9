//! What the bench's light meets: a rendered tensor in memory, scan points of one that are read row by row, or a plain sample.

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

/// Images of patterns that are kept, bytes: a night shows the same ones again and again.
const KEPT_BYTES: usize = 512 << 20;
/// Rows of a scan that are kept, bytes.
const MOST_ROWS_BYTES: usize = 64 << 20;
/// A tensor's part that is played must fit in memory, bytes.
const MOST_BYTES: u64 = 6 << 30;

/// What the light meets.
pub enum Scenery {
    /// The same matrix at all pixels of a camera: air, a mirror, a known plate. Time-resolved in the first bin alone.
    Sample {
        /// Row-major, at full drive of all pixels.
        mueller: [f32; ELEMENTS],
        /// Columns and rows of the camera.
        camera: [usize; 2],
        /// Images are made of it.
        image: Vec<f32>,
    },
    /// T(s, s') in memory.
    Tensor(PlayedTensor),
    /// T(s, s' = s, t) by rows of scan points.
    Scan(PlayedScan),
}

/// T(s, s', p, p') at one wavelength.
pub struct PlayedTensor {
    /// Columns and rows of the camera.
    pub camera: [usize; 2],
    /// Columns and rows of s'.
    pub projector: [usize; 2],
    /// By camera pixel, projector pixel, element.
    data: Vec<f32>,
    /// Images under patterns that were shown, the last ones last.
    kept: Vec<(Vec<f32>, Vec<f32>)>,
    lit: Vec<[f64; 4]>,
}

/// T(s, s, p, p', t) at one wavelength.
pub struct PlayedScan {
    slice: StoredSlice,
    /// Columns and rows of the scan.
    pub camera: [usize; 2],
    /// Bins and their width, ps, and the begin of the first.
    pub bins: usize,
    /// Width of a bin, ps.
    pub bin_ps: f64,
    /// Begin of the first bin, ps.
    pub start_ps: f64,
    lane: usize,
    lanes: usize,
    /// First of the rows in memory, and they.
    rows: Option<(usize, Vec<f32>)>,
    /// How many: those of a chunk, if they are not too large.
    together: usize,
}

impl Scenery {
    /// A plain sample before a camera.
    #[must_use]
    pub fn sample(mueller: [f32; ELEMENTS], camera: [usize; 2]) -> Self {
        let image = mueller.repeat(camera[0] * camera[1]);
        Self::Sample {
            mueller,
            camera,
            image,
        }
    }

    /// A slice of a finished store at a wavelength: with time bins it is scanned, else shown patterns.
    ///
    /// # Errors
    /// What cannot be played, in words.
    pub fn open(path: &Path, name: &str, nm: f64) -> Result<Self, String> {
        let store = TensorStore::open(path).map_err(|e| e.to_string())?;
        denoised::refuse(&store).map_err(|e| e.to_string())?;
        let slice = store.slice(name).map_err(|e| e.to_string())?;
        let place = format!("{} slice `{name}`", path.display());
        let layout = slice.layout();
        let len = |kind| layout.find(kind).map(|i| layout.axes[i].len() as usize);
        let (Some(height), Some(width)) = (len(AxisKind::Y), len(AxisKind::X)) else {
            return Err(format!(
                "{place}: the slice has no rows and columns of the camera"
            ));
        };
        if len(AxisKind::StokesOut) != Some(4) || len(AxisKind::StokesIn) != Some(4) {
            return Err(format!(
                "{place}: the slice has no Mueller matrices; render it with polarization = \"mueller\""
            ));
        }
        let parts = [AxisKind::Bounces, AxisKind::Component, AxisKind::Label];
        if parts.into_iter().any(|kind| len(kind).is_some()) {
            return Err(format!(
                "{place}: the slice is split into parts, but a sensor measures their sum; use a slice without parts"
            ));
        }
        let axis = layout.find(AxisKind::Wavelength).map(|i| &layout.axes[i]);
        let (lane, lanes) = match axis {
            None => (0, 1),
            Some(axis) => {
                let lane = axis.nearest(nm);
                if (axis.coords[lane] - nm).abs() > 1.0 {
                    return Err(format!(
                        "{place}: the bench's light is {nm} nm, but the slice has {:?} nm",
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
                "{place}: {:.1} GB exceed the memory limit; bin the camera or the projector",
                bytes as f64 / 1e9
            ));
        }
        let mut data = Vec::with_capacity(width * height * projector[0] * projector[1] * ELEMENTS);
        // Rows of a chunk together: each is decompressed once.
        let rows = layout.axes[0].chunk.max(1);
        for y in (0..height as u64).step_by(rows as usize) {
            let mut shape = layout.shape();
            let mut start = vec![0; shape.len()];
            (start[0], shape[0]) = (y, rows.min(height as u64 - y));
            let block = slice
                .read(Field::Mean, &start, &shape)
                .map_err(|e| e.to_string())?;
            data.extend(block.into_iter().skip(lane).step_by(lanes));
        }
        Ok(Self::Tensor(PlayedTensor {
            camera,
            projector,
            data,
            kept: vec![],
            lit: vec![],
        }))
    }

    /// Columns and rows of the camera, or of scan points.
    #[must_use]
    pub fn camera(&self) -> [usize; 2] {
        match self {
            Self::Sample { camera, .. } => *camera,
            Self::Tensor(t) => t.camera,
            Self::Scan(s) => s.camera,
        }
    }

    /// What comes back under a pattern (drives of s', a whole number of projector pixels a box); none in the dark.
    ///
    /// # Errors
    /// If the pattern does not fit the tensor, in words.
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
            Self::Scan(_) => Err("a scan by a galvo has no patterns".into()),
            Self::Tensor(tensor) => tensor.light(pattern, bench, generator).map(Some),
        }
    }
}

impl PlayedTensor {
    fn light(&mut self, pattern: &[f32], bench: &Bench, generator: &[Set]) -> Result<Light<'_>, String> {
        let boxes = self.projector[0] * self.projector[1];
        if pattern.len() != boxes {
            return Err(format!(
                "the pattern has {} pixels, but the tensor has {} x {} projector pixels",
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
            let all = lit
                .iter()
                .map(|(i, state)| times(&data[i * ELEMENTS..][..ELEMENTS], state));
            all.sum::<nalgebra::Vector4<f64>>().into()
        };
        self.lit = self.data.par_chunks_exact(boxes * ELEMENTS).map(pixel).collect();
        Ok(Light::Stokes(&self.lit))
    }

    /// Contracts the tensor with a pattern, and forgets old images where they are too many.
    fn keep(&mut self, pattern: &[f32]) -> usize {
        let boxes = self.projector[0] * self.projector[1];
        let size = self.camera[0] * self.camera[1] * ELEMENTS;
        while !self.kept.is_empty() && (self.kept.len() + 1) * size * 4 > KEPT_BYTES {
            self.kept.remove(0);
        }
        let lit: Vec<(usize, f32)> = lit_pixels(pattern).collect();
        let mut image = vec![0.0_f32; size];
        let pixels = image.par_chunks_exact_mut(ELEMENTS);
        pixels
            .zip(self.data.par_chunks_exact(boxes * ELEMENTS))
            .for_each(|(out, data)| {
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
    /// 16 elements a bin of a scan point. The rows that were read last stay in memory.
    ///
    /// # Errors
    /// If the store is damaged, or there is no such point; in words.
    pub fn point(&mut self, x: usize, y: usize) -> Result<&[f32], String> {
        let [width, height] = self.camera;
        if x >= width || y >= height {
            return Err(format!(
                "the beam points to {x}, {y}, outside {width} x {height} points"
            ));
        }
        let first = y / self.together * self.together;
        let at = match self.rows.take() {
            Some((found, data)) if found == first => (found, data),
            _ => {
                let mut shape = self.slice.layout().shape();
                let mut start = vec![0; shape.len()];
                (start[0], shape[0]) = (first as u64, self.together.min(height - first) as u64);
                let all = self
                    .slice
                    .read(Field::Mean, &start, &shape)
                    .map_err(|e| e.to_string())?;
                (
                    first,
                    all.into_iter().skip(self.lane).step_by(self.lanes).collect(),
                )
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
    fn denoised_light_is_not_played() {
        let axis = |kind, n: u32| Axis {
            kind,
            coords: (0..n).map(f64::from).collect(),
            chunk: n.into(),
        };
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
            let told = Scenery::open(&path, "m", 550.0).err().unwrap_or_default();
            assert_eq!(
                told.contains("is denoised") && told.contains("a.zarr"),
                denoised,
                "{told}"
            );
        }
    }
}
