//! A table of Mueller matrices in a file. The file is checked on opening, and the table is interpolated in
//! place.
//!
//! A file of up to 64 MiB is read completely, so that later changes to the file have no effect. A larger file
//! is mapped copy-on-write and read on demand. If another program truncates a mapped file, access to the
//! missing pages terminates the process (SIGBUS on Unix). To replace a mapped file, rename a new file to the
//! name of the old file. Never overwrite the file in place.
//!
//! Interpolation is multilinear in (φ_d, θ_d, θ_h) and in wavelength. φ_d is periodic. The other angles and
//! the wavelength are clamped to the ends of their axes. Entries are BRDF values (without the cosine) between
//! the s frames of [`super::rusinkiewicz`].
//!
//! NaN entries are holes. Measured data have holes where the light or the viewer is below the horizon. A
//! value is interpolated from valid corners with renormalized weights. If no corner is valid, the value is 0.
//! Matrices are used as measured, including matrices that noise makes slightly unphysical (a degree of
//! polarization above 1). Interpolation is a convex sum and thus adds no other unphysical matrices. If M00 <
//! 0 in a lane, the matrix of this lane is set to zero. No other matrices are corrected.

use super::axes::{ANGLES, Axes, Axis, even_axis};
use super::error::PbsdfError;
use super::importance::{Importance, Mean};
use super::rusinkiewicz::Coordinates;
use super::tensor_file::{Dtype, Field, TensorFile};
use memmap2::{Mmap, MmapOptions};
use optics::polarization::mueller::Mueller;
use optics::spectrum::{MAX_WAVELENGTHS, Spectral, Wavelengths};
use std::io::{self, Read};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Options for opening a table.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// True if evenly spaced angles (ends included) replace an axis that is empty in the file.
    pub even_axes: bool,
    /// The wavelengths of the render, one per lane. If `None`, the first wavelengths of the table are used.
    pub wavelengths: Option<Wavelengths>,
}

/// Elements of at least this magnitude mark a hole. NaN marks a hole too.
const LIMIT: f32 = 1e9;

/// Maximum size of a file that is read completely, in bytes.
const READ_WHOLE: u64 = 64 << 20;

/// Size of one Mueller matrix in bytes.
const CELL: usize = 64;

/// The two wavelength bands of a table between which the value of a lane is interpolated.
#[derive(Clone, Copy, Debug, Default)]
struct Band {
    low: usize,
    high: usize,
    /// Weight of the band `high`.
    weight: f32,
}

/// A measured table. Clones share the bytes of the file.
#[derive(Clone, Debug)]
pub struct Table {
    /// Bytes of the file, as a copy in memory or as a mapping of the file.
    map: Arc<Mmap>,
    /// Offset of the first byte of the field M.
    start: usize,
    /// Byte ranges of the header and the axes.
    heads: [Range<usize>; 5],
    /// Axes phi_d, theta_d and theta_h.
    axes: [Axis; 3],
    wavelengths_nm: Vec<u16>,
    lanes: [Band; 4],
    lane_count: usize,
    importance: Importance,
}

/// Decodes the little-endian f32 values of a field.
fn floats(bytes: &[u8], range: &Range<usize>) -> Vec<f32> {
    let (words, _) = bytes[range.clone()].as_chunks::<4>();
    words.iter().map(|w| f32::from_le_bytes(*w)).collect()
}

/// Decodes the little-endian f32 value at a byte offset.
#[inline]
fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn shape_error(field: &'static str, found: &Field, want: impl Into<String>) -> PbsdfError {
    PbsdfError::Shape { field, found: found.shape_text(), want: want.into() }
}

/// Returns the bands next to a wavelength, and true if the wavelength is outside the table's range.
fn band(bands: &[u16], nm: f64) -> (Band, bool) {
    let (first, last) = (f64::from(bands[0]), f64::from(bands[bands.len() - 1]));
    let inside = nm.clamp(first, last);
    let high = bands.partition_point(|b| f64::from(*b) < inside).min(bands.len() - 1);
    let low = high.saturating_sub(1);
    let (a, b) = (f64::from(bands[low]), f64::from(bands[high]));
    let weight = if high > low { ((inside - a) / (b - a)) as f32 } else { 0.0 };
    let band = match weight {
        // The wavelength equals that of a band, so only this band is read.
        1.0 => Band { low: high, high, weight: 0.0 },
        weight => Band { low, high, weight },
    };
    (band, inside != nm)
}

impl Table {
    /// Opens a `.pbsdf` file and checks the structure and the axes. At least one entry must be valid.
    ///
    /// Only a small part of a large file is read. Other data remain on disk until needed. The module
    /// documentation describes the risk of changes to the file. For wavelengths outside the table, the
    /// nearest band is used, and a warning is logged once.
    ///
    /// # Errors
    /// Returns a [`PbsdfError`], without the path, if the file cannot be read or its contents are invalid.
    pub fn open(path: &Path, options: &Options) -> Result<Self, PbsdfError> {
        let map = bytes_of(path).map_err(PbsdfError::Read)?;
        Self::of(Arc::new(map), options, path)
    }

    fn of(map: Arc<Mmap>, options: &Options, path: &Path) -> Result<Self, PbsdfError> {
        let bytes: &[u8] = &map;
        let file = TensorFile::new(bytes)?;
        let m = file.field("M", Dtype::F32)?;
        let shape: Vec<u64> = m.shape().take(7).collect();
        let [.., 4, 4] = shape[..] else {
            return Err(shape_error("M", &m, "(phi_d, theta_d, theta_h, wvls, 4, 4)"));
        };
        if shape.len() != 6 || m.range.is_empty() {
            return Err(shape_error("M", &m, "(phi_d, theta_d, theta_h, wvls, 4, 4) with positive lengths"));
        }
        // M is inside the file, so the product of the dimensions of M does not overflow.
        let extent = [0, 1, 2, 3].map(|k| shape[k] as usize);
        let mut heads = [const { 0..0 }; 5];
        heads[0] = 0..file.header_end()?;
        let mut angles = [const { Vec::new() }; 3];
        for (k, (name, ..)) in ANGLES.into_iter().enumerate() {
            let field = file.field(name, Dtype::F32)?;
            let want = format!("(1, {}), as in the shape of M", extent[k]);
            if field.shape().len() != 2 || field.shape().nth(1) != Some(extent[k] as u64) {
                return Err(shape_error(name, &field, want));
            }
            angles[k] = match field.shape().next() {
                Some(1) => floats(bytes, &field.range),
                Some(0) if options.even_axes => even_axis(k, extent[k]),
                Some(0) => return Err(PbsdfError::EmptyAxis(name)),
                _ => return Err(shape_error(name, &field, want)),
            };
            heads[1 + k] = field.range;
        }
        let wvls = file.field("wvls", Dtype::U16)?;
        if !wvls.shape().eq([extent[3] as u64]) {
            return Err(shape_error("wvls", &wvls, format!("({}), as in the shape of M", extent[3])));
        }
        let (pairs, _) = bytes[wvls.range.clone()].as_chunks::<2>();
        let wavelengths_nm: Vec<u16> = pairs.iter().map(|b| u16::from_le_bytes(*b)).collect();
        heads[4] = wvls.range;
        let [phi_d, theta_d, theta_h] = angles;
        let axes = Axes { phi_d, theta_d, theta_h, wavelengths_nm };
        axes.check()?;
        let valid = |cell: usize| float(bytes, cell).abs() < LIMIT;
        if !m.range.clone().step_by(CELL).any(valid) {
            return Err(PbsdfError::Empty);
        }
        let start = m.range.start;
        let own = || {
            let first = axes.wavelengths_nm.iter().take(MAX_WAVELENGTHS);
            Wavelengths::new(first.map(|nm| f64::from(*nm)).collect()).unwrap_or_default()
        };
        let wavelengths = options.wavelengths.clone().unwrap_or_else(own);
        let lanes = lanes(&axes.wavelengths_nm, &wavelengths, path);
        let counts = extent;
        let mut table = Self {
            start,
            heads,
            lanes,
            lane_count: wavelengths.count(),
            axes: [axes.phi_d, axes.theta_d, axes.theta_h].map(Axis::new),
            wavelengths_nm: axes.wavelengths_nm,
            importance: Importance::default(),
            map,
        };
        table.importance = Importance::new([counts[1], counts[2], counts[0]], &table.mean());
        Ok(table)
    }

    /// Returns the angles of the entries (phi_d, theta_d, theta_h) in radians.
    pub fn angles(&self) -> [&[f32]; 3] {
        [0, 1, 2].map(|k| self.axes[k].nodes())
    }

    /// Returns the vacuum wavelengths of the bands, nanometres.
    pub fn wavelengths_nm(&self) -> &[u16] {
        &self.wavelengths_nm
    }

    /// Returns the sampling densities of half vectors.
    #[inline]
    pub(super) fn importance(&self) -> &Importance {
        &self.importance
    }

    /// Returns the byte offset of an entry's matrix for the first band.
    #[inline]
    fn cell(&self, phi_d: usize, theta_d: usize, theta_h: usize) -> usize {
        let [_, d, h] = &self.axes;
        let entry = (phi_d * d.nodes().len() + theta_d) * h.nodes().len() + theta_h;
        self.start + entry * self.wavelengths_nm.len() * CELL
    }

    /// Returns one stored matrix, row-major with rows for the outgoing Stokes vector, or `None` if the entry
    /// is a hole or out of range. `at` contains the indices along phi_d, theta_d and theta_h.
    pub fn entry(&self, at: [usize; 3], band: usize) -> Option<[f32; 16]> {
        let inside = at.iter().zip(&self.axes).all(|(i, axis)| *i < axis.nodes().len());
        if !inside || band >= self.wavelengths_nm.len() {
            return None;
        }
        let first = self.cell(at[0], at[1], at[2]) + band * CELL;
        let m: [f32; 16] = std::array::from_fn(|i| float(&self.map, first + 4 * i));
        m.iter().all(|e| e.abs() < LIMIT).then_some(m)
    }

    /// Returns the Mueller matrix of the BRDF between s frames, 1/sr. The elements are 0 in unused lanes.
    #[inline]
    #[allow(clippy::needless_range_loop)]
    pub fn eval(&self, at: Coordinates) -> Mueller {
        let bytes: &[u8] = &self.map;
        let corners = |(i, j, t): (usize, usize, f32)| [(i, 1.0 - t), (j, t)];
        let phi_d = corners(self.axes[0].place_around(at.phi_d));
        let theta_d = corners(self.axes[1].place(at.theta_d));
        let theta_h = corners(self.axes[2].place(at.theta_h));
        let mut lanes = [Sum::default(); 4];
        for (p, wp) in phi_d {
            for (d, wd) in theta_d {
                for (h, wh) in theta_h {
                    let w = wp * wd * wh;
                    if w == 0.0 {
                        continue;
                    }
                    let cell = self.cell(p, d, h);
                    for lane in 0..self.lane_count {
                        let (sum, band) = (&mut lanes[lane], self.lanes[lane]);
                        sum.add(bytes, cell + band.low * CELL, w * (1.0 - band.weight));
                        if band.weight > 0.0 {
                            sum.add(bytes, cell + band.high * CELL, w * band.weight);
                        }
                    }
                }
            }
        }
        let mut out = Mueller::ZERO;
        let [a, b, c, d] = &lanes;
        let scale = Spectral::new([a.scale(), b.scale(), c.scale(), d.scale()]);
        for e in 0..16 {
            let lanes = [a.elements[e], b.elements[e], c.elements[e], d.elements[e]];
            out.m[e / 4][e % 4] = scale * Spectral::new(lanes);
        }
        out
    }

    /// Returns M00 averaged over the render's lanes and up to 16 values of φ_d. The result contains each θ_h
    /// and up to about 48 values of θ_d. The required part of the file is small enough to be read while a
    /// scene loads.
    fn mean(&self) -> Mean {
        let bytes: &[u8] = &self.map;
        let [phi_d, theta_d, theta_h] = &self.axes;
        let phi_step = phi_d.nodes().len().div_ceil(16);
        let last = theta_d.nodes().len() - 1;
        let stride = last.div_ceil(47);
        let rows: Vec<usize> = (0..last).step_by(stride).chain([last]).collect();
        let mut values = Vec::with_capacity(rows.len() * theta_h.nodes().len());
        for &d in &rows {
            for h in 0..theta_h.nodes().len() {
                let (mut sum, mut count) = (0.0, 0);
                for p in (0..phi_d.nodes().len()).step_by(phi_step) {
                    for lane in &self.lanes[..self.lane_count] {
                        let m00 = float(bytes, self.cell(p, d, h) + lane.low * CELL);
                        if m00.abs() < LIMIT {
                            sum += m00.max(0.0);
                            count += 1;
                        }
                    }
                }
                values.push(sum / count.max(1) as f32);
            }
        }
        Mean {
            theta_d: Axis::new(rows.iter().map(|d| theta_d.nodes()[*d]).collect()),
            theta_h: theta_h.clone(),
            values,
        }
    }

    /// Returns byte ranges of the file that identify its contents. For a small file, the only range is the
    /// whole file. For a large file, the ranges are the header, the axes and 64 evenly spaced pieces of 4 KiB
    /// of the data. Changes between the pieces are not detected.
    ///
    /// Read these ranges from the file and not through the mapping, because accessed pages would count as
    /// memory of the process.
    pub fn pieces(&self) -> impl Iterator<Item = Range<usize>> {
        const PIECES: usize = 64;
        const PIECE: usize = 4096;
        let (size, start) = (self.map.len(), self.start);
        let small = size <= 2 * PIECES * PIECE;
        let heads = self.heads.clone().into_iter().filter(move |_| !small);
        let spread = (size - start).saturating_sub(PIECE);
        let data = (0..PIECES).filter(move |_| !small).map(move |i| {
            // The product does not overflow, because file sizes are far below 2^64 / 64 bytes.
            let at = start + (spread as u64 * i as u64 / (PIECES as u64 - 1)) as usize;
            at..(at + PIECE).min(size)
        });
        heads.chain(data).chain(small.then_some(0..size))
    }

    pub fn file_len(&self) -> usize {
        self.map.len()
    }
}

/// Returns the bytes of a file. Small files are copied to memory, and large files are mapped.
fn bytes_of(path: &Path) -> io::Result<Mmap> {
    let mut file = base::input::open(path)?;
    let size = file.metadata()?.len();
    if size <= READ_WHOLE {
        let mut memory = MmapOptions::new().len(size as usize).map_anon()?;
        file.read_exact(&mut memory)?;
        return memory.make_read_only();
    }
    // SAFETY: a map is unsound if its file changes while the map exists. The map `map` is private
    // (copy-on-write) and read-only. References into the map are plain bytes, which have no invalid values,
    // and all bounds come from the length of the map. The remaining risk is that truncation of the file
    // during a render terminates the process.
    let map = unsafe { MmapOptions::new().map_copy_read_only(&file) }?;
    if file.metadata()?.len() != map.len() as u64 {
        return Err(io::Error::other("the file changed while it was opened"));
    }
    Ok(map)
}

/// Returns the bands of each lane. Logs a warning about wavelengths outside the table.
fn lanes(bands: &[u16], wavelengths: &Wavelengths, path: &Path) -> [Band; 4] {
    let mut lanes = [Band::default(); 4];
    let mut outside = Vec::new();
    for (lane, &nm) in lanes.iter_mut().zip(wavelengths.nm()) {
        let (band, beyond) = band(bands, nm);
        *lane = band;
        if beyond {
            outside.push(format!("{nm} nm uses the band at {} nm", bands[band.low]));
        }
    }
    if !outside.is_empty() {
        let (first, last) = (bands[0], bands[bands.len() - 1]);
        tracing::warn!(
            "{}: the table covers only {first} to {last} nm: {}; extend the table, or change wavelengths_nm",
            path.display(),
            outside.join(", ")
        );
    }
    lanes
}

/// A weighted sum of valid matrices. The code loops over indices, because zipped iterators are not inlined.
#[derive(Clone, Copy, Default)]
struct Sum {
    elements: [f32; 16],
    weight: f32,
}

impl Sum {
    /// Adds the matrix at a byte offset, unless the matrix is a hole.
    #[inline]
    #[allow(clippy::needless_range_loop)]
    fn add(&mut self, bytes: &[u8], at: usize, weight: f32) {
        let (words, _) = bytes[at..at + CELL].as_chunks::<4>();
        let words = &words[..16];
        let mut matrix = [0.0; 16];
        let mut there = true;
        for i in 0..16 {
            matrix[i] = f32::from_le_bytes(words[i]);
            // The comparison with `LIMIT` is false for NaN.
            there &= matrix[i].abs() < LIMIT;
        }
        if there {
            for i in 0..16 {
                self.elements[i] += weight * matrix[i];
            }
            self.weight += weight;
        }
    }

    /// Returns the factor that converts the sum to the weighted mean.
    #[inline]
    fn scale(&self) -> f32 {
        // Return 0 if the total weight is negligible or M00 ≤ 0.
        if self.weight < 1e-12 || self.elements[0] <= 0.0 { 0.0 } else { self.weight.recip() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wavelengths_lie_between_bands_or_at_the_nearest() {
        let bands = [450, 500, 550, 600, 650];
        for (nm, low, high, weight, beyond) in [
            (450.0, 0, 0, 0.0, false),
            (500.0, 1, 1, 0.0, false),
            (512.5, 1, 2, 0.25, false),
            (650.0, 4, 4, 0.0, false),
            (660.0, 4, 4, 0.0, true),
            (400.0, 0, 0, 0.0, true),
        ] {
            let (b, out) = band(&bands, nm);
            assert!(out == beyond && b.low == low && b.weight == weight, "{nm}: {b:?}");
            assert!(weight == 0.0 || b.high == high, "{nm}: {b:?}");
        }
        assert_eq!(band(&[550], 600.0).0.low, 0);
    }
}
