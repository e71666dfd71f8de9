//! Evaluates single materials: BRDFs, and specular reflection and transmission.

use crate::error::{bail, input, located};
use crate::lanes::{Lanes, choose};
use crate::off_python::{detached, off_python};
use crate::scene::{Scene, toml_of_json};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use sunstone::InputError;
use sunstone::pbrdf::evaluate::{Direction, Specimen};
use sunstone::scene::materials::MaterialSet;
use sunstone::transport::material::Lobe;

/// A material, built for a list of wavelengths.
#[pyclass(frozen, module = "pysunstone._native")]
pub struct Material {
    of: Of,
    #[pyo3(get)]
    name: String,
    /// For each wavelength, the index of its specimen, and the index of the wavelength in that specimen.
    places: Vec<(usize, usize)>,
}

/// The owner of the material data.
enum Of {
    /// Material sets for a few wavelengths each.
    Sets(Vec<MaterialSet>),
    Scene(Py<Scene>),
}

/// An array of directions, (n, 3).
type Rows<'py> = PyReadonlyArray2<'py, f64>;

/// Matrices (n, wavelengths, 4, 4) and directions (n, wavelengths, 3).
type Specular<'py> = (Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyArrayDyn<f64>>);

fn directions(what: &str, rows: &Rows<'_>) -> PyResult<Vec<Direction>> {
    let view = rows.as_array();
    if view.ncols() != 3 {
        bail!("{what}: the shape is {:?}; expected (..., 3)", view.shape());
    }
    Ok(view.rows().into_iter().map(|r| Direction::of([r[0], r[1], r[2]])).collect())
}

impl Material {
    fn of_text(py: Python<'_>, path: &Path, text: &str, name: Option<&str>, nm: &[f64]) -> PyResult<Self> {
        let lanes = Lanes::new(nm)?;
        let build = |w: &_| MaterialSet::at(path, text, Clone::clone(w));
        let sets: Result<Vec<MaterialSet>, InputError> =
            detached(py, || lanes.sets.iter().map(build).collect())?;
        let sets = sets.map_err(located)?;
        let names: Vec<String> = sets.iter().take(1).flat_map(|s| s.names.keys().cloned()).collect();
        Ok(Self {
            name: choose("material", "materials", &names, name)?,
            of: Of::Sets(sets),
            places: lanes.places,
        })
    }

    /// Calls `then` with a list of the material's specimens. The list is empty if the material does not
    /// exist.
    fn with<T>(&self, uv: [f32; 2], then: impl FnOnce(&[Specimen]) -> T) -> T {
        match &self.of {
            Of::Sets(sets) => {
                let all: Vec<Specimen> =
                    sets.iter().filter_map(|set| Specimen::new(set, &self.name, uv)).collect();
                then(&all)
            }
            Of::Scene(scene) => {
                let scene = scene.get().lock();
                let own: Vec<Specimen> = Specimen::in_scene(&scene, &self.name, uv).into_iter().collect();
                then(&own)
            }
        }
    }
}

#[pymethods]
impl Material {
    /// Create a material from a file of materials.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, name: Option<&str>, wavelengths_nm: Vec<f64>) -> PyResult<Self> {
        let text = py
            .detach(|| sunstone::base::input::read_text(&path))
            .map_err(|e| input(format!("cannot read {}: {e}", path.display())))?;
        Self::of_text(py, &path, &text, name, &wavelengths_nm)
    }

    /// Create a material from a file's content as JSON. Paths in the content are relative to `folder`.
    #[staticmethod]
    fn from_json(
        py: Python<'_>,
        json: &str,
        folder: PathBuf,
        name: Option<&str>,
        wavelengths_nm: Vec<f64>,
    ) -> PyResult<Self> {
        let text = toml_of_json(json)?;
        Self::of_text(py, &folder.join("materials in a dict"), &text, name, &wavelengths_nm)
    }

    /// Create a material of a scene, for some of the scene's wavelengths.
    #[staticmethod]
    fn of_scene(
        py: Python<'_>,
        scene: Py<Scene>,
        name: Option<&str>,
        wavelengths_nm: Vec<f64>,
    ) -> PyResult<Self> {
        let (known, nm) = py.detach(|| {
            let s = scene.get().lock();
            (s.names.materials.clone(), s.wavelengths.nm().to_vec())
        });
        let name = choose("material", "materials", &known, name)?;
        let place = |asked: &f64| match nm.iter().position(|own| (own - asked).abs() < 1e-6) {
            Some(lane) => Ok((0, lane)),
            None => bail!(
                "wavelengths_nm: the scene has the wavelengths {nm:?} nm, but {asked} nm is requested; pass wavelengths of the scene"
            ),
        };
        Ok(Self {
            places: wavelengths_nm.iter().map(place).collect::<PyResult<_>>()?,
            of: Of::Scene(scene),
            name,
        })
    }

    /// Return BRDFs (n, wavelengths, 4, 4) in 1/sr for incoming and outgoing directions, each (n, 3).
    fn brdf<'py>(
        &self,
        py: Python<'py>,
        incoming: Rows<'py>,
        outgoing: Rows<'py>,
        uv: [f32; 2],
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let incoming = directions("incoming", &incoming)?;
        let outgoing = directions("outgoing", &outgoing)?;
        if incoming.len() != outgoing.len() {
            bail!(
                "got {} incoming directions, but {} outgoing directions; pass arrays of equal length",
                incoming.len(),
                outgoing.len()
            );
        }
        let lanes = self.places.len();
        let mut out = vec![0.0_f32; incoming.len() * lanes * 16];
        off_python(py, 0, || {
            self.with(uv, |specimens| {
                out.par_chunks_mut(16 * lanes)
                    .zip(incoming.par_iter().zip(&outgoing))
                    .with_min_len(64)
                    .for_each(|(out, (wi, wo))| {
                        let all: Vec<_> = specimens.iter().map(|s| s.mueller(*wi, *wo)).collect();
                        for (out, (set, lane)) in out.as_chunks_mut::<16>().0.iter_mut().zip(&self.places) {
                            out.copy_from_slice(all[*set].lane(*lane).as_flattened());
                        }
                    });
            });
        })?;
        PyArray1::from_vec(py, out).reshape(vec![incoming.len(), lanes, 4, 4])
    }

    /// Return matrices (n, wavelengths, 4, 4) and outgoing directions (n, wavelengths, 3). The matrices
    /// describe the power that a smooth surface reflects or transmits for light from directions (n, 3).
    /// Outgoing directions are NaN under total reflection.
    fn specular<'py>(
        &self,
        py: Python<'py>,
        incoming: Rows<'py>,
        transmitted: bool,
        uv: [f32; 2],
    ) -> PyResult<Specular<'py>> {
        let incoming = directions("incoming", &incoming)?;
        let lobe = if transmitted { Lobe::Transmitted } else { Lobe::Reflected };
        let (n, lanes) = (incoming.len(), self.places.len());
        let mut matrices = vec![0.0_f32; n * lanes * 16];
        let mut leaving = vec![f64::NAN; n * lanes * 3];
        let found = off_python(py, 0, || {
            self.with(uv, |specimens| {
                matrices
                    .par_chunks_mut(16 * lanes)
                    .zip(leaving.par_chunks_mut(3 * lanes))
                    .zip(incoming.par_iter().enumerate())
                    .try_for_each(|((matrices, leaving), (i, wi))| {
                        let all: Result<Vec<_>, _> =
                            specimens.iter().map(|s| s.specular(*wi, lobe)).collect();
                        let all = all.map_err(|e| format!("incoming direction {i}: {e}"))?;
                        for (k, (set, lane)) in self.places.iter().enumerate() {
                            let value = &all[*set][*lane];
                            matrices[16 * k..16 * k + 16].copy_from_slice(value.mueller.as_flattened());
                            if let Some(out) = value.outgoing {
                                leaving[3 * k..3 * k + 3].copy_from_slice(&out.vector());
                            }
                        }
                        Ok::<(), String>(())
                    })
            })
        })?;
        found.map_err(|e| input(format!("material `{}`: {e}", self.name)))?;
        Ok((
            PyArray1::from_vec(py, matrices).reshape(vec![n, lanes, 4, 4])?,
            PyArray1::from_vec(py, leaving).reshape(vec![n, lanes, 3])?,
        ))
    }
}
