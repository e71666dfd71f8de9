//! Reads Mueller matrices from an array file or from a slice of a store.

use polarimetry::capture::mueller_image::{DEFAULT_NM, ImageError, MuellerImage};
use std::path::{Path, PathBuf};
use store::numpy::{NumpyArray, NumpyError, Values};
use store::probe::{CoordRange, Probe, ProbeError, Selection};
use store::zarr::StoredSlice;
use tensor::array::Tensor;
use tensor::axes::{Axis, AxisKind};

/// The reason why matrices cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum MatricesError {
    #[error(transparent)]
    Read(#[from] NumpyError),
    /// The last two axes of the array do not have the lengths 4 and 4.
    #[error(
        "{} has shape {shape:?}; expected (..., 4, 4), with the outgoing Stokes elements in rows",
        path.display()
    )]
    Shape { path: PathBuf, shape: Vec<usize> },
    /// The selected part of the slice cannot be read.
    #[error(transparent)]
    Probe(#[from] ProbeError),
    /// The slice does not resolve polarization.
    #[error(
        "does not contain complete Mueller matrices; use a slice with polarization = \"mueller\", and select only along other axes"
    )]
    NotMueller,
}

/// Mueller matrices with their leading shape.
#[derive(Clone, Debug)]
pub struct Matrices {
    /// Lengths of the axes before the two Stokes axes. For a slice, the last of these axes is the wavelength.
    pub shape: Vec<usize>,
    /// Elements of the matrices, 16 per matrix, row-major.
    pub values: Values,
    /// Standard errors of the elements. Available only for a slice.
    pub errors: Option<Values>,
    /// Axes, wavelengths and bin width. Available only for a slice.
    pub facts: Option<SliceFacts>,
}

/// Axes, wavelengths and bin width of a slice.
#[derive(Clone, Debug)]
pub struct SliceFacts {
    /// Axes of the leading shape.
    pub axes: Vec<Axis>,
    /// All wavelengths of the wavelength axis, or the selected wavelength, in nanometres.
    pub nm: Vec<f64>,
    /// Width of the time bins in picoseconds.
    pub bin_ps: Option<f64>,
}

impl Matrices {
    /// Reads an array (.npy) of shape (..., 4, 4).
    ///
    /// # Errors
    /// Returns [`MatricesError::Read`] if the file cannot be read. Returns [`MatricesError::Shape`] if the
    /// array has another shape.
    pub fn of_array(path: &Path) -> Result<Self, MatricesError> {
        let NumpyArray { mut shape, values } = NumpyArray::read(path)?;
        if !shape.ends_with(&[4, 4]) {
            let path = path.to_owned();
            return Err(MatricesError::Shape { path, shape });
        }
        shape.truncate(shape.len() - 2);
        Ok(Self { shape, values, errors: None, facts: None })
    }

    /// Reads the matrices of a part of a stored slice, row-major over all axes except the Stokes axes.
    ///
    /// # Errors
    /// Returns [`MatricesError::Probe`] if the slice cannot be read. Returns [`MatricesError::NotMueller`] if
    /// the slice does not contain Mueller matrices.
    pub fn of_slice(slice: &StoredSlice, select: &[Selection]) -> Result<Self, MatricesError> {
        let probe = Probe { select: select.to_vec(), ..Probe::default() };
        let result = probe.run(slice)?;
        let stokes = [AxisKind::StokesOut, AxisKind::StokesIn];
        if stokes.iter().any(|k| result.mean.extent(*k) != 4) {
            return Err(MatricesError::NotMueller);
        }
        let axes: Vec<Axis> =
            result.mean.axes.iter().filter(|a| !stokes.contains(&a.kind)).cloned().collect();
        let left = axes.iter().find(|a| a.kind == AxisKind::Wavelength);
        let nm = match left {
            Some(axis) => axis.coords.clone(),
            None => vec![selected_nm(&slice.layout().axes, select)],
        };
        Ok(Self {
            shape: axes.iter().map(|axis| axis.coords.len()).collect(),
            values: Values::Single(stokes_last(&result.mean)),
            errors: Some(Values::Single(stokes_last(&result.std_error))),
            facts: Some(SliceFacts { axes, nm, bin_ps: result.time.map(|(_, bin)| bin) }),
        })
    }

    /// Converts the matrices to the input of a rig. `wavelengths_nm` contains the wavelengths of an array's
    /// last axis. If `wavelengths_nm` is empty, the array has no wavelength axis. For a slice,
    /// `wavelengths_nm` must be empty, because a slice has its own wavelengths.
    ///
    /// # Errors
    /// Returns the errors of [`MuellerImage::of_array`] and [`MuellerImage::of_slice`].
    pub fn image(self, wavelengths_nm: &[f64]) -> Result<MuellerImage, ImageError> {
        let elements = match self.values {
            Values::Single(v) => v.into_iter().map(f64::from).collect(),
            Values::Double(v) => v,
        };
        match self.facts {
            Some(facts) => MuellerImage::of_slice(elements, &facts.axes, facts.nm, facts.bin_ps),
            None => MuellerImage::of_array(elements, self.shape, wavelengths_nm),
        }
    }
}

/// Returns the selected wavelength, in nanometres, of a stored slice. A selected wavelength is not an axis of
/// the probe's result.
fn selected_nm(stored: &[Axis], select: &[Selection]) -> f64 {
    let axis = stored.iter().find(|a| a.kind == AxisKind::Wavelength);
    let wanted = select.iter().find_map(|s| match (s.axis, s.range) {
        (AxisKind::Wavelength, CoordRange::Nearest(nm)) => Some(nm),
        _ => None,
    });
    let wanted = wanted.unwrap_or(DEFAULT_NM);
    let nearest = axis.and_then(|a| a.coords.get(a.nearest(wanted)));
    nearest.copied().unwrap_or(wanted)
}

/// Reorders a tensor's values so that the two Stokes axes are last. In the tensor, only wavelength
/// can follow the Stokes axes.
fn stokes_last(t: &Tensor) -> Vec<f32> {
    let lanes = t.extent(AxisKind::Wavelength);
    let mut out = Vec::with_capacity(t.data.len());
    for matrices in t.data.chunks_exact(16 * lanes) {
        for lane in 0..lanes {
            out.extend(matrices[lane..].iter().step_by(lanes));
        }
    }
    out
}
