//! Computes shape from arrays: structured-light codes, triangulation and normals.

use crate::analysis::slice;
use crate::error::{bail, input};
use crate::off_python::{detached, off_python};
use crate::scene::Scene;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use sunstone::applications::truth;
use sunstone::apply::map::Map;
use sunstone::apply::pinhole::{Pinhole, Rig};
use sunstone::apply::shape::column_light::{CodeError, Decoded, Patterns};
use sunstone::apply::shape::logical_codes::Base;
use sunstone::apply::shape::polarization::{self, Cues, Reflection};
use sunstone::apply::shape::surface_normals::{self, Window};
use sunstone::apply::shape::{gray_code, logical_codes, micro_phase_shift, phase_shift, triangulation};

/// A calibrated camera and projector. Without a projector, the camera's values are used for the projector.
#[pyclass(frozen, module = "pysunstone._native")]
pub struct Devices(Rig);

/// Resolution, focal lengths and principal point of a device in pixels, its origin in metres, and its three
/// axes. The axes are image right, image down and forward, in world coordinates.
type Numbers = ([usize; 2], [f64; 2], [f64; 2], [f64; 3], [[f64; 3]; 3]);

fn pinhole((resolution, focal, principal, origin, axes): Numbers) -> PyResult<Pinhole> {
    let all = [
        ("focal", &focal[..]),
        ("principal", &principal[..]),
        ("origin", &origin[..]),
        ("axes", axes.as_flattened()),
    ];
    if let Some((name, found)) = all.into_iter().find(|(_, list)| !list.iter().all(|v| v.is_finite())) {
        bail!("{name}: expected finite numbers, got {found:?}");
    }
    if focal.contains(&0.0) {
        bail!("focal: expected nonzero focal lengths, in pixels, got {focal:?}");
    }
    Ok(Pinhole::new(resolution, focal, principal, origin, axes))
}

fn numbers(p: &Pinhole) -> Numbers {
    let axis = |i: usize| [p.axes[(0, i)], p.axes[(1, i)], p.axes[(2, i)]];
    (p.resolution, p.focal, p.principal, p.origin.into(), [axis(0), axis(1), axis(2)])
}

#[pymethods]
impl Devices {
    #[new]
    fn new(camera: Numbers, projector: Option<Numbers>) -> PyResult<Self> {
        let camera = pinhole(camera)?;
        let projector = projector.map_or_else(|| Ok(camera.clone()), pinhole)?;
        Ok(Self(Rig { camera, projector }))
    }

    /// Return the devices of a scene without calibration error; None if the scene has no projector.
    #[staticmethod]
    fn of_scene(py: Python<'_>, scene: Py<Scene>) -> Option<Self> {
        py.detach(|| truth::rig(&scene.get().lock())).map(Self)
    }

    #[getter]
    fn camera(&self) -> Numbers {
        numbers(&self.0.camera)
    }

    #[getter]
    fn projector(&self) -> Numbers {
        numbers(&self.0.projector)
    }
}

type Image<'py> = PyReadonlyArrayDyn<'py, f64>;

type Found<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Converts a C-contiguous array (rows, columns, channels) to a map.
fn map(what: &str, image: &Image<'_>) -> PyResult<Map> {
    let [height, width, channels] = *image.shape() else {
        bail!("{what}: the shape is {:?}; expected (rows, columns, channels)", image.shape());
    };
    Ok(Map { width, height, channels, data: slice(what, image)?.to_vec() })
}

/// Checks that a map has the camera's resolution, which all methods require.
fn of_camera(what: &str, map: &Map, camera: &Pinhole) -> PyResult<()> {
    if [map.width, map.height] == camera.resolution {
        return Ok(());
    }
    let [w, h] = camera.resolution;
    Err(input(format!(
        "{what}: the map has {} rows of {} pixels, but the camera has {h} rows of {w} pixels; pass maps with the resolution of the \
         camera",
        map.height, map.width
    )))
}

fn array(py: Python<'_>, map: Map) -> PyResult<Found<'_>> {
    PyArray1::from_vec(py, map.data).reshape(vec![map.height, map.width, map.channels])
}

/// A structured-light code.
enum Code {
    Gray,
    Xor(Base),
    PhaseShift(Vec<f64>),
    MicroPhaseShift(Vec<f64>),
}

impl Code {
    fn of(name: &str, columns: usize, periods: Option<Vec<f64>>) -> PyResult<Self> {
        if !(1..=65_536).contains(&columns) {
            bail!("columns: expected a number from 1 to 65536, got {columns}");
        }
        let unused = || match &periods {
            None => Ok(()),
            Some(_) => bail!("periods: the code `{name}` has no periods; remove the argument `periods`"),
        };
        match name {
            "gray" => unused().map(|()| Self::Gray),
            "xor-02" => unused().map(|()| Self::Xor(Base::Xor02)),
            "xor-04" => unused().map(|()| Self::Xor(Base::Xor04)),
            "phase-shift" => Ok(Self::PhaseShift(periods.unwrap_or_else(|| phase_shift::periods(columns)))),
            "micro-phase-shift" => match periods {
                Some(periods) => Ok(Self::MicroPhaseShift(periods)),
                None => bail!(
                    "periods: the code `micro-phase-shift` requires a list of periods, in projector columns; pass, for example, seven \
                     periods of about 16 columns (Gupta & Nayar 2012)"
                ),
            },
            other => bail!(
                "unknown code `{other}`; choose from gray, xor-02, xor-04, phase-shift, micro-phase-shift"
            ),
        }
    }

    fn patterns(&self, columns: usize) -> Patterns {
        match self {
            Self::Gray => gray_code::patterns(columns),
            Self::Xor(base) => logical_codes::patterns(columns, *base),
            Self::PhaseShift(p) => phase_shift::patterns(columns, p),
            Self::MicroPhaseShift(p) => micro_phase_shift::patterns(columns, p),
        }
    }

    fn decode(&self, captures: &Map, columns: usize, least: f64) -> Result<Decoded, CodeError> {
        match self {
            Self::Gray => gray_code::decode(captures, columns, least),
            Self::Xor(base) => logical_codes::decode(captures, columns, *base, least),
            Self::PhaseShift(p) => phase_shift::decode(captures, columns, p, least),
            Self::MicroPhaseShift(p) => micro_phase_shift::decode(captures, columns, p, least),
        }
    }
}

/// Return the patterns of a code as drives in 0..1, of shape (captures, columns).
#[pyfunction]
pub fn code_patterns<'py>(
    py: Python<'py>,
    code: &str,
    columns: usize,
    periods: Option<Vec<f64>>,
) -> PyResult<Found<'py>> {
    let patterns = Code::of(code, columns, periods)?.patterns(columns);
    let captures = patterns.drives.len();
    PyArray1::from_vec(py, patterns.drives.concat()).reshape(vec![captures, columns])
}

/// Decode captures (rows, columns, captures) to projector columns and confidences, each (rows, columns, 1).
#[pyfunction]
pub fn decode_columns<'py>(
    py: Python<'py>,
    code: &str,
    captures: Image<'py>,
    columns: usize,
    periods: Option<Vec<f64>>,
    least_contrast: f64,
) -> PyResult<(Found<'py>, Found<'py>)> {
    let code = Code::of(code, columns, periods)?;
    let captures = map("captures", &captures)?;
    let found = detached(py, || code.decode(&captures, columns, least_contrast))?;
    let Decoded { column, confidence } = found.map_err(input)?;
    Ok((array(py, column)?, array(py, confidence)?))
}

/// Triangulate projector columns to depths (rows, columns, 1) in metres.
#[pyfunction]
pub fn triangulate<'py>(py: Python<'py>, devices: &Devices, columns: Image<'py>) -> PyResult<Found<'py>> {
    let columns = map("columns", &columns)?;
    of_camera("columns", &columns, &devices.0.camera)?;
    array(py, detached(py, || triangulation::depth(&devices.0, &columns))?)
}

/// Compute normals (rows, columns, 3) from depths.
#[pyfunction]
pub fn normals_of_depth<'py>(
    py: Python<'py>,
    devices: &Devices,
    depth: Image<'py>,
    radius: usize,
    robust: bool,
) -> PyResult<Found<'py>> {
    let depth = map("depth", &depth)?;
    let camera = &devices.0.camera;
    of_camera("depth", &depth, camera)?;
    array(py, detached(py, || surface_normals::normals(camera, &depth, Window { radius, robust }))?)
}

/// Compute an array (rows, columns, 3) from matrices (rows, columns, 16). The three values of a pixel are the
/// degree of polarization, and the zenith angle and azimuth of the normal.
#[pyfunction]
pub fn polarization_cues<'py>(
    py: Python<'py>,
    matrices: Image<'py>,
    index: f64,
    mirrored: bool,
    mirrored_off: bool,
) -> PyResult<Found<'py>> {
    if !(index > 1.0 && index <= 10.0) {
        bail!("index: expected a refractive index above 1 and at most 10, got {index}");
    }
    let matrices = map("matrices", &matrices)?;
    let how = if mirrored { Reflection::Specular } else { Reflection::Diffuse };
    let cues =
        off_python(py, 1, || polarization::cues(&polarization::stokes(&matrices, mirrored_off), index, how))?;
    array(py, cues.angles)
}

/// Compute normals (rows, columns, 3) from polarization cues. Of the two normals that the cues allow, the
/// normal closer to `guess` is returned.
#[pyfunction]
pub fn normals_of_cues<'py>(
    py: Python<'py>,
    devices: &Devices,
    cues: Image<'py>,
    guess: Image<'py>,
) -> PyResult<Found<'py>> {
    let (angles, guess) = (map("cues", &cues)?, map("guess", &guess)?);
    let camera = &devices.0.camera;
    of_camera("cues", &angles, camera)?;
    of_camera("guess", &guess, camera)?;
    if [angles.channels, guess.channels] != [3, 3] {
        bail!(
            "cues and guess: expected three numbers per pixel, got {} and {}",
            angles.channels,
            guess.channels
        );
    }
    let cues = Cues { angles };
    array(py, detached(py, || polarization::nearest(camera, &cues, &guess))?)
}
