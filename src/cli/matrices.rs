//! Mueller matrices that commands read: an array of them, or a slice of a store.

use super::failure::Failure;
use std::path::{Path, PathBuf};
use sunstone::polarimetry::capture::element::Ray;
use sunstone::polarimetry::capture::simulate::Layout;
use sunstone::store::numpy::{NumpyArray, Values};
use sunstone::store::probe::{CoordRange, Probe, Selection};
use sunstone::tensor::array::Tensor;
use sunstone::tensor::axes::{Axis, AxisKind};

/// Where matrices are.
#[derive(clap::Args)]
pub struct MatrixSource {
    /// Array (.npy) of shape (..., 4, 4), or a store written by `render` or `merge`.
    #[arg(value_name = "M.npy|STORE")]
    pub source: PathBuf,
    /// Slice of the store.
    slice: Option<String>,
    /// Keep part of the slice's axis: AXIS=VALUE (nearest entry) or AXIS=FROM:TO, in the axis' unit. Repeatable.
    #[arg(short = 'k', long = "select", requires = "slice")]
    select: Vec<Selection>,
}

/// Matrices, their leading shape, and what is known of it.
pub struct Matrices {
    /// Lengths of the axes before the two of Stokes elements; of a slice, wavelengths are the last of them.
    pub shape: Vec<usize>,
    /// 16 elements a matrix, row-major.
    pub values: Values,
    /// Standard errors of the elements, of a slice.
    pub errors: Option<Values>,
    /// Of a slice: its axes and what else it says.
    pub known: Option<Known>,
}

/// What a slice says of its matrices.
pub struct Known {
    /// Axes of the leading shape.
    pub axes: Vec<Axis>,
    /// Wavelengths, nanometres: those of its axis, or the one that was selected.
    pub nm: Vec<f64>,
    /// Width of its time bins, ps.
    pub bin_ps: Option<f64>,
}

impl MatrixSource {
    /// Reads all matrices. `rest` is what an example of the command ends with.
    pub fn read(&self, command: &str, rest: &str) -> Result<Matrices, Failure> {
        if let Some(slice) = &self.slice {
            return self.stored(slice);
        }
        if self.source.is_dir() {
            return Err(Failure::input(format!(
                "{}: it is a store; name the slice, as in: sunstone {command} {0} polarimetric {rest}",
                self.source.display(),
            )));
        }
        let (shape, values) = array(&self.source)?;
        Ok(Matrices {
            shape,
            values,
            errors: None,
            known: None,
        })
    }

    /// Matrices of a stored slice, row-major over the axes that it has besides.
    fn stored(&self, slice: &str) -> Result<Matrices, Failure> {
        let source = super::Source {
            store: self.source.clone(),
            slice: slice.to_owned(),
            select: self.select.clone(),
        };
        let (_, stored) = source.open()?;
        let probe = Probe {
            select: source.select,
            ..Probe::default()
        };
        let result = probe.run(&stored).map_err(Failure::input)?;
        let kinds = [AxisKind::StokesOut, AxisKind::StokesIn];
        if kinds.iter().any(|k| result.mean.extent(*k) != 4) {
            return Err(Failure::input(format!(
                "slice {slice} of {} does not hold whole Mueller matrices; choose one with polarization = \"mueller\", and \
                 select along other axes",
                self.source.display()
            )));
        }
        let axes: Vec<Axis> = result
            .mean
            .axes
            .iter()
            .filter(|a| !kinds.contains(&a.kind))
            .cloned()
            .collect();
        let left = axes.iter().find(|a| a.kind == AxisKind::Wavelength);
        let nm = match left {
            Some(axis) => axis.coords.clone(),
            None => self.selected_nm(&stored.layout().axes),
        };
        Ok(Matrices {
            shape: axes.iter().map(|axis| axis.coords.len()).collect(),
            values: Values::Single(together(&result.mean)),
            errors: Some(Values::Single(together(&result.std_error))),
            known: Some(Known {
                axes,
                nm,
                bin_ps: result.time.map(|(_, bin)| bin),
            }),
        })
    }

    /// The stored wavelength that was selected: the probe took its axis away.
    fn selected_nm(&self, axes: &[Axis]) -> Vec<f64> {
        let stored = axes.iter().filter(|a| a.kind == AxisKind::Wavelength);
        let coords = stored.flat_map(|a| &a.coords).copied();
        let wanted = self.select.iter().find_map(|s| match (s.axis, s.range) {
            (AxisKind::Wavelength, CoordRange::Nearest(nm)) => Some(nm),
            _ => None,
        });
        let wanted = wanted.unwrap_or(550.0);
        let nearest = coords.min_by(|a, b| (a - wanted).abs().total_cmp(&(b - wanted).abs()));
        vec![nearest.unwrap_or(wanted)]
    }
}

/// An array of matrices; its leading shape.
pub fn array(path: &Path) -> Result<(Vec<usize>, Values), Failure> {
    let NumpyArray { mut shape, values } = NumpyArray::read(path).map_err(Failure::input)?;
    if !shape.ends_with(&[4, 4]) {
        return Err(Failure::input(format!(
            "{}: its shape is {shape:?}; Mueller matrices have the shape (..., 4, 4), rows the Stokes elements that leave",
            path.display()
        )));
    }
    shape.truncate(shape.len() - 2);
    Ok((shape, values))
}

/// A tensor's values with the two Stokes axes last; only wavelengths stand behind them.
fn together(t: &Tensor) -> Vec<f32> {
    let lanes = t.extent(AxisKind::Wavelength);
    let mut out = Vec::with_capacity(t.data.len());
    for matrices in t.data.chunks_exact(16 * lanes) {
        for lane in 0..lanes {
            out.extend(matrices[lane..].iter().step_by(lanes));
        }
    }
    out
}

/// Matrices as captures see them.
pub struct Target {
    /// 16 elements a pixel.
    pub matrices: Vec<f64>,
    /// The order of the pixels.
    pub layout: Layout,
    /// One a wavelength.
    pub rays: Vec<Ray>,
    /// Axes of the pixels: their lengths, and which are rows and columns.
    shape: Vec<usize>,
    y: Option<usize>,
    x: Option<usize>,
    /// Width of the time bins, ps, where the slice has nothing but these besides rows, columns and wavelengths.
    pub bin_ps: Option<f64>,
}

impl Target {
    /// Lays matrices out for [`sunstone::polarimetry::capture::simulate`]. `wavelengths` are those of an array's last axis (none: 550 nm
    /// everywhere).
    pub fn new(m: Matrices, wavelengths: &[f64]) -> Result<Self, Failure> {
        let shape = m.shape;
        let nm = match &m.known {
            Some(_) if !wavelengths.is_empty() => {
                return Err(Failure::input(
                    "--wavelengths: a slice knows its own; leave them out, or choose with -k wavelength=550",
                ));
            }
            Some(known) => known.nm.clone(),
            None if wavelengths.is_empty() => vec![550.0],
            None => wavelengths.to_vec(),
        };
        if let Some(bad) = nm.iter().find(|nm| !(**nm > 0.0 && nm.is_finite())) {
            return Err(Failure::input(format!(
                "--wavelengths: {bad}; give nanometres, as in 450,550,660"
            )));
        }
        let has_lanes = match &m.known {
            Some(known) => known.axes.iter().any(|a| a.kind == AxisKind::Wavelength),
            None => !wavelengths.is_empty() && (nm.len() > 1 || shape.last() == Some(&1)),
        };
        if has_lanes && shape.last() != Some(&nm.len()) {
            return Err(Failure::input(format!(
                "--wavelengths: the last axis before the matrices, of shape {shape:?}, is not as long as the {} wavelengths",
                nm.len()
            )));
        }
        let places = shape.len() - usize::from(has_lanes);
        let (mut y, mut x, mut bin_ps) = (None, None, None);
        match &m.known {
            Some(known) => {
                for (i, axis) in known.axes.iter().enumerate() {
                    match axis.kind {
                        AxisKind::Y => y = Some(i),
                        AxisKind::X => x = Some(i),
                        AxisKind::Bounces | AxisKind::Component if axis.len() > 1 => {
                            return Err(parts(axis.kind));
                        }
                        _ => {}
                    }
                }
                let plain = known
                    .axes
                    .iter()
                    .all(|a| !matches!(a.kind, AxisKind::V | AxisKind::U) || a.len() == 1);
                bin_ps = known.bin_ps.filter(|_| plain);
            }
            None if places >= 2 => (y, x) = (Some(0), Some(1)),
            None if places == 1 => x = Some(0),
            None => {}
        }
        let of = |axis: Option<usize>| axis.map_or(1, |i| shape[i]);
        let besides = (0..places).filter(|i| Some(*i) != y && Some(*i) != x);
        let layout = Layout {
            height: of(y),
            width: of(x),
            times: besides.map(|i| shape[i]).product(),
            lanes: nm.len(),
        };
        if layout.pixels() == 0 {
            return Err(Failure::input(
                "there are no matrices; keep at least one of each axis",
            ));
        }
        let matrices = match m.values {
            Values::Single(v) => v.into_iter().map(f64::from).collect(),
            Values::Double(v) => v,
        };
        Ok(Self {
            matrices,
            layout,
            rays: nm.into_iter().map(Ray::axial).collect(),
            shape,
            y,
            x,
            bin_ps,
        })
    }

    /// The shape of the pixels of what was captured.
    pub fn shape(&self, captured: Layout) -> Vec<usize> {
        let mut shape = self.shape.clone();
        for (axis, len) in [(self.y, captured.height), (self.x, captured.width)] {
            if let Some(i) = axis {
                shape[i] = len;
            }
        }
        shape
    }

    /// Mean of T00, in the unit of the matrices.
    pub fn mean(&self) -> f64 {
        let lit = self.matrices.iter().step_by(16).filter(|v| v.is_finite());
        let (n, sum) = lit.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
        sum / n
    }
}

/// Light that the slice keeps in parts, which no sensor sees apart.
fn parts(kind: AxisKind) -> Failure {
    let name = kind.name();
    Failure::input(format!(
        "the slice has an axis {name}, along which no sensor tells light apart; choose an entry with -k {name}=0, or a slice \
         that is summed over it"
    ))
}
