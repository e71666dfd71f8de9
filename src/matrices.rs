//! Mueller matrices from files: an array of them, or a slice of a store.

use polarimetry::capture::mueller_image::{DEFAULT_NM, ImageError, MuellerImage};
use std::path::{Path, PathBuf};
use store::numpy::{NumpyArray, NumpyError, Values};
use store::probe::{CoordRange, Probe, ProbeError, Selection};
use store::zarr::StoredSlice;
use tensor::array::Tensor;
use tensor::axes::{Axis, AxisKind};

/// Why there are no matrices.
#[derive(Debug, thiserror::Error)]
pub enum MatricesError {
    /// The array cannot be read.
    #[error(transparent)]
    Read(#[from] NumpyError),
    /// The array holds something else.
    #[error(
        "{}: its shape is {shape:?}; expected (..., 4, 4), with the outgoing Stokes elements in rows",
        path.display()
    )]
    Shape {
        /// File of the array.
        path: PathBuf,
        /// Its shape.
        shape: Vec<usize>,
    },
    /// The slice cannot be read so.
    #[error(transparent)]
    Probe(#[from] ProbeError),
    /// The slice does not resolve polarization.
    #[error(
        "does not contain complete Mueller matrices; use a slice with polarization = \"mueller\", and select only along other axes"
    )]
    NotMueller,
}

/// Matrices, their leading shape, and what is known of it.
#[derive(Clone, Debug)]
pub struct Matrices {
    /// Lengths of the axes before the two of Stokes elements; of a slice, wavelengths are the last of them.
    pub shape: Vec<usize>,
    /// 16 elements a matrix, row-major.
    pub values: Values,
    /// Standard errors of the elements, of a slice.
    pub errors: Option<Values>,
    /// Of a slice: its axes and what else it says.
    pub facts: Option<SliceFacts>,
}

/// What a slice says of its matrices.
#[derive(Clone, Debug)]
pub struct SliceFacts {
    /// Axes of the leading shape.
    pub axes: Vec<Axis>,
    /// Wavelengths, nanometres: those of its axis, or the one that was selected.
    pub nm: Vec<f64>,
    /// Width of its time bins, ps.
    pub bin_ps: Option<f64>,
}

impl Matrices {
    /// An array (.npy) of matrices, of shape (..., 4, 4).
    ///
    /// # Errors
    /// [`MatricesError::Read`], [`MatricesError::Shape`].
    pub fn of_array(path: &Path) -> Result<Self, MatricesError> {
        let NumpyArray { mut shape, values } = NumpyArray::read(path)?;
        if !shape.ends_with(&[4, 4]) {
            let path = path.to_owned();
            return Err(MatricesError::Shape { path, shape });
        }
        shape.truncate(shape.len() - 2);
        Ok(Self {
            shape,
            values,
            errors: None,
            facts: None,
        })
    }

    /// Matrices of a part of a stored slice, row-major over the axes that it has besides those of Stokes elements.
    ///
    /// # Errors
    /// [`MatricesError::Probe`], [`MatricesError::NotMueller`].
    pub fn of_slice(slice: &StoredSlice, select: &[Selection]) -> Result<Self, MatricesError> {
        let probe = Probe {
            select: select.to_vec(),
            ..Probe::default()
        };
        let result = probe.run(slice)?;
        let stokes = [AxisKind::StokesOut, AxisKind::StokesIn];
        if stokes.iter().any(|k| result.mean.extent(*k) != 4) {
            return Err(MatricesError::NotMueller);
        }
        let axes: Vec<Axis> = result
            .mean
            .axes
            .iter()
            .filter(|a| !stokes.contains(&a.kind))
            .cloned()
            .collect();
        let left = axes.iter().find(|a| a.kind == AxisKind::Wavelength);
        let nm = match left {
            Some(axis) => axis.coords.clone(),
            None => vec![selected_nm(&slice.layout().axes, select)],
        };
        Ok(Self {
            shape: axes.iter().map(|axis| axis.coords.len()).collect(),
            values: Values::Single(stokes_last(&result.mean)),
            errors: Some(Values::Single(stokes_last(&result.std_error))),
            facts: Some(SliceFacts {
                axes,
                nm,
                bin_ps: result.time.map(|(_, bin)| bin),
            }),
        })
    }

    /// The matrices as a rig sees them. `wavelengths_nm` are those of the last axis of an array (none: there is no such
    /// axis); a slice knows its own, and takes no others.
    ///
    /// # Errors
    /// Those of [`MuellerImage::of_array`] and [`MuellerImage::of_slice`].
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

/// The stored wavelength that was selected: the probe took its axis away.
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

/// A tensor's values with the two Stokes axes last; only wavelengths stand behind them.
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
