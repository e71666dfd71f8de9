//! Evaluates the scattering of a single participating medium.

use crate::error::{input, located};
use crate::lanes::{Lanes, choose};
use crate::off_python::off_python;
use crate::scene::{Scene, toml_of_json};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use sunstone::InputError;
use sunstone::pbrdf::phase::of_set;
use sunstone::scene::media::{self, MediumSet};

/// A medium, built for a list of wavelengths.
#[pyclass(frozen, module = "pysunstone._native")]
pub struct Medium {
    sets: Vec<MediumSet>,
    #[pyo3(get)]
    name: String,
    /// For each wavelength, the index of its set, and the index of the wavelength in that set.
    places: Vec<(usize, usize)>,
}

impl Medium {
    fn of_text(py: Python<'_>, path: &Path, text: &str, name: Option<&str>, nm: &[f64]) -> PyResult<Self> {
        let lanes = Lanes::new(nm)?;
        let names = media::names_of_text(path, text).map_err(located)?;
        let name = choose("medium", "media", &names, name)?;
        let build = |w: &_| MediumSet::at(path, text, Some(&name), Some(Clone::clone(w)));
        // Computing the tables of large particles takes seconds, so the computation lets other Python threads
        // run.
        let sets: Result<Vec<MediumSet>, InputError> =
            off_python(py, 0, || lanes.sets.par_iter().map(build).collect())?;
        Ok(Self { sets: sets.map_err(located)?, name, places: lanes.places })
    }
}

#[pymethods]
impl Medium {
    /// Create a medium from a file of media.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, name: Option<&str>, wavelengths_nm: Vec<f64>) -> PyResult<Self> {
        let text = media::read_file(&path).map_err(located)?;
        Self::of_text(py, &path, &text, name, &wavelengths_nm)
    }

    /// Create a medium from a file's content as JSON. Paths in the content are relative to `folder`.
    #[staticmethod]
    fn from_json(
        py: Python<'_>,
        json: &str,
        folder: PathBuf,
        name: Option<&str>,
        wavelengths_nm: Vec<f64>,
    ) -> PyResult<Self> {
        let text = toml_of_json(json)?;
        Self::of_text(py, &folder.join("media in a dict"), &text, name, &wavelengths_nm)
    }

    /// Create a medium of a scene from the media in the scene's file.
    #[staticmethod]
    fn of_scene(
        py: Python<'_>,
        scene: Py<Scene>,
        name: Option<&str>,
        wavelengths_nm: Vec<f64>,
    ) -> PyResult<Self> {
        let text = py.detach(|| scene.get().lock().text.clone());
        let whole: toml::Table = toml::from_str(&text).map_err(input)?;
        let mut own = toml::Table::new();
        own.insert("media".into(), toml::Table::new().into());
        for key in ["wavelengths_nm", "media"] {
            if let Some(value) = whole.get(key) {
                own.insert(key.into(), value.clone());
            }
        }
        let text = toml::to_string(&own).map_err(input)?;
        Self::of_text(py, Path::new("media of the scene"), &text, name, &wavelengths_nm)
    }

    /// Return the coefficients by name, one value per wavelength.
    fn bulk<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let tables: Vec<_> = self.sets.iter().map(|s| of_set(s, &self.name, &[])).collect();
        let out = PyDict::new(py);
        let column = |f: fn(&sunstone::pbrdf::phase::PhaseTable) -> f64| {
            let of = |(set, lane): &(usize, usize)| f(&tables[*set][*lane]);
            PyArray1::from_vec(py, self.places.iter().map(of).collect())
        };
        out.set_item("index", column(|t| t.index))?;
        out.set_item("scattering", column(|t| t.scattering))?;
        out.set_item("absorption", column(|t| t.absorption))?;
        out.set_item("asymmetry", column(|t| t.asymmetry))?;
        out.set_item("scattering_cross_section", column(|t| t.scattering_cross_section))?;
        out.set_item("absorption_cross_section", column(|t| t.absorption_cross_section))?;
        Ok(out)
    }

    /// Return scattering matrices (n, wavelengths, 4, 4) in 1/sr at scattering angles (n) in degrees.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        degrees: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        const PIECE: usize = 1024;
        let degrees = degrees.as_slice()?;
        let lanes = self.places.len();
        let mut out = vec![0.0_f32; degrees.len() * lanes * 16];
        off_python(py, 0, || {
            out.par_chunks_mut(16 * lanes * PIECE).zip(degrees.par_chunks(PIECE)).for_each(
                |(out, degrees)| {
                    let tables: Vec<_> = self.sets.iter().map(|s| of_set(s, &self.name, degrees)).collect();
                    for (i, out) in out.chunks_exact_mut(16 * lanes).enumerate() {
                        for (m, (set, lane)) in out.as_chunks_mut::<16>().0.iter_mut().zip(&self.places) {
                            let [s11, s12, s22, s33, s34, s44] = tables[*set][*lane].elements[i];
                            *m = [
                                s11, s12, 0.0, 0.0, //
                                s12, s22, 0.0, 0.0, //
                                0.0, 0.0, s33, s34, //
                                0.0, 0.0, -s34, s44,
                            ];
                        }
                    }
                },
            );
        })?;
        PyArray1::from_vec(py, out).reshape(vec![degrees.len(), lanes, 4, 4])
    }
}
