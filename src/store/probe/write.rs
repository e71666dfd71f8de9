//! Writes probe results as `.npy` (NumPy), `.csv` (one row per element) or `.zarr` (a store).

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::error::ProbeError;
use super::run::ProbeResult;
use crate::numpy;
use crate::zarr::TensorStore;
use base::whole_file;
use tensor::array::Tensor;
use tensor::axes::{AxisKind, SliceLayout};
use tensor::field::Field;

fn failed(path: &Path, cause: impl ToString) -> ProbeError {
    ProbeError::Write { path: path.to_owned(), cause: cause.to_string() }
}

/// Returns the path `NAME.std_error.npy`, to which the standard errors of `NAME.npy` are written.
pub fn std_error_path(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}.std_error.npy"))
}

impl ProbeResult {
    /// Writes the result to `path`, in the format that the extension selects: `.npy`, `.csv` or `.zarr`.
    ///
    /// # Errors
    /// Returns an error if the extension is unknown, writing fails, or a `.zarr` store exists and `replace`
    /// is false.
    pub fn write(
        &self,
        path: &Path,
        attributes: &Map<String, Value>,
        replace: bool,
    ) -> Result<(), ProbeError> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("npy") => self.write_npy(path),
            Some("csv") => self.write_csv(path),
            Some("zarr") => self.write_zarr(path, &Map::new(), attributes, replace),
            _ => Err(failed(path, "the extension must be .npy, .csv or .zarr")),
        }
    }

    /// Writes the values as an f32 `.npy` file, row-major, and the standard errors to [`std_error_path`].
    ///
    /// # Errors
    /// Returns an error if a file cannot be written.
    pub fn write_npy(&self, path: &Path) -> Result<(), ProbeError> {
        write_npy(&self.mean, path)?;
        write_npy(&self.std_error, &std_error_path(path))
    }

    /// Writes a CSV file with one row per element: coordinates (in axis units), value and standard error.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn write_csv(&self, path: &Path) -> Result<(), ProbeError> {
        whole_file::write_with(path, |file| self.csv(file)).map_err(|e| failed(path, e))
    }

    fn csv(&self, file: &mut BufWriter<std::fs::File>) -> io::Result<()> {
        for axis in &self.mean.axes {
            write!(file, "{},", axis.kind.name())?;
        }
        writeln!(file, "mean,std_error")?;
        let mut index = vec![0; self.mean.axes.len()];
        for (mean, error) in self.mean.data.iter().zip(&self.std_error.data) {
            for (axis, &i) in self.mean.axes.iter().zip(&index) {
                write!(file, "{},", axis.coords[i])?;
            }
            writeln!(file, "{mean},{error}")?;
            for (axis, i) in self.mean.axes.iter().zip(&mut index).rev() {
                *i += 1;
                if *i < axis.coords.len() {
                    break;
                }
                *i = 0;
            }
        }
        Ok(())
    }

    /// Returns the layout of the result as a slice of a store.
    pub fn layout(&self) -> SliceLayout {
        let time = self.time.filter(|_| self.mean.find(AxisKind::T).is_some());
        SliceLayout { name: self.mean.name.clone(), axes: self.mean.axes.clone(), time, totals: false }
    }

    /// Writes a store with one slice, which has the name of the probed slice. Writes `slice_attributes` to
    /// the slice's group and `root_attributes` to the root group. If time is resolved, light outside the time
    /// bins becomes the overflow of the slice, without a standard error.
    ///
    /// # Errors
    /// Returns an error if the store cannot be created (see [`TensorStore::create`]) or written.
    pub fn write_zarr(
        &self,
        path: &Path,
        slice_attributes: &Map<String, Value>,
        root_attributes: &Map<String, Value>,
        replace: bool,
    ) -> Result<(), ProbeError> {
        let layout = self.layout();
        let shape = layout.shape();
        let fill = |store: &TensorStore| {
            let slice = store.slice(&self.mean.name).map_err(|e| failed(path, e))?;
            let start = vec![0; shape.len()];
            slice.write(Field::Mean, &start, &shape, &self.mean.data)?;
            slice.write(Field::StdError, &start, &shape, &self.std_error.data)?;
            if let Some(overflow) = self.overflow.as_ref().filter(|_| slice.has(Field::Overflow)) {
                let shape: Vec<u64> = overflow.shape().iter().map(|&n| n as u64).collect();
                slice.write(Field::Overflow, &vec![0; shape.len()], &shape, &overflow.data)?;
            }
            store.finish().map_err(|e| failed(path, e))
        };
        let slices = [(layout, slice_attributes.clone())];
        TensorStore::create_filled(path, &slices, root_attributes, None, replace, fill).map(drop)
    }
}

/// Writes a tensor as an f32 `.npy` file, row-major.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn write_npy(tensor: &Tensor, path: &Path) -> Result<(), ProbeError> {
    whole_file::write_with(path, |file| numpy::write(file, &tensor.shape(), tensor.data.iter().copied()))
        .map_err(|e| failed(path, e))
}
