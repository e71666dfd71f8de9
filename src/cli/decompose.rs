//! `sunstone decompose`.

use super::failure::Failure;
use std::path::{Path, PathBuf};
use std::time::Instant;
use sunstone::decompose::maps::{Quantity, Real, WITH_ERRORS, errors, maps};
use sunstone::tensor::array::Tensor;
use sunstone::tensor::axes::AxisKind;
use sunstone::tensor::numpy::{NumpyArray, Values, write_npz};
use sunstone::tensor::probe::{Probe, Selection};
use tracing::info;

/// Decompose Mueller matrices after Lu and Chipman: M = M_Δ M_R M_D.
///
/// Reads an array of shape (..., 4, 4), or a slice of a store that resolves polarization, and writes arrays of the leading
/// shape: polarizance, diattenuation, retardance (radians, 0 to π), depolarization, retardance_axis (..., 3), and the factors
/// m_delta, m_r, m_d (..., 4, 4), whose product is the matrix. Of a slice, and with --errors, also the standard errors of the
/// four scalars. Matrices that cannot exist (m00 ≤ 0, diattenuation above 1) give NaN.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone decompose M.npy -o props.npz                        numpy.load('props.npz')['retardance']
  sunstone decompose out/mirror_room.zarr polarimetric -o props.npz -k wavelength=550
  sunstone decompose M.npy --only retardance,entropy -o props.npz")]
pub struct Arguments {
    /// Array (.npy) of shape (..., 4, 4), or a store written by `render` or `merge`.
    #[arg(value_name = "M.npy|STORE")]
    source: PathBuf,
    /// Slice of the store.
    slice: Option<String>,
    /// Keep part of the slice's axis: AXIS=VALUE (nearest entry) or AXIS=FROM:TO, in the axis' unit. Repeatable.
    #[arg(short = 'k', long = "select", requires = "slice")]
    select: Vec<Selection>,
    /// Standard errors of the elements (.npy), of the same shape.
    #[arg(long, value_name = "E.npy", conflicts_with = "slice")]
    errors: Option<PathBuf>,
    /// Write these arrays alone (comma-separated; also `entropy`, after Cloude).
    #[arg(long, value_delimiter = ',', value_parser = quantity)]
    only: Vec<Quantity>,
    /// File to write.
    #[arg(short, long, value_name = "X.npz")]
    output: PathBuf,
}

fn quantity(text: &str) -> Result<Quantity, String> {
    Quantity::ALL
        .into_iter()
        .find(|q| q.name() == text)
        .ok_or_else(|| {
            let names: Vec<&str> = Quantity::ALL.iter().map(|q| q.name()).collect();
            format!("there is no such array; choose of {}", names.join(", "))
        })
}

/// Matrices, their leading shape, and the errors of their elements.
struct Input {
    shape: Vec<usize>,
    values: Values,
    errors: Option<Values>,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    if a.output.extension().is_none_or(|e| e != "npz") {
        return Err(Failure::input(format!(
            "{}: arrays are written as .npz; name the file so",
            a.output.display()
        )));
    }
    let input = match &a.slice {
        Some(slice) => stored(a, slice)?,
        None => array(a)?,
    };
    let Input {
        shape,
        values,
        errors,
    } = &input;
    let (out, missing, all) = match (values, errors) {
        (Values::Single(m), None) => arrays(a, shape, m, None, Values::Single),
        (Values::Single(m), Some(Values::Single(e))) => arrays(a, shape, m, Some(e), Values::Single),
        (Values::Double(m), None) => arrays(a, shape, m, None, Values::Double),
        (Values::Double(m), Some(Values::Double(e))) => arrays(a, shape, m, Some(e), Values::Double),
        _ => {
            return Err(Failure::input(
                "--errors: its numbers are of another precision than the matrices; save both as one dtype",
            ));
        }
    };
    if missing > 0 {
        eprintln!(
            "note: {missing} of {all} matrices cannot exist (m00 <= 0, diattenuation above 1, or not finite): NaN"
        );
    }
    write_npz(&a.output, &out).map_err(|e| Failure::failed(format!("{}: {e}", a.output.display())))?;
    super::print(&a.output.display().to_string())
}

/// The arrays to write, the number of matrices that have no decomposition, and that of all.
fn arrays<T: Real>(
    a: &Arguments,
    shape: &[usize],
    elements: &[T],
    sigmas: Option<&[T]>,
    values: fn(Vec<T>) -> Values,
) -> (Vec<(String, NumpyArray)>, usize, usize) {
    let wanted: Vec<Quantity> = if a.only.is_empty() {
        Quantity::ALL
            .into_iter()
            .filter(|q| *q != Quantity::Entropy)
            .collect()
    } else {
        a.only.clone()
    };
    let start = Instant::now();
    let (found, missing) = maps(elements, &wanted);
    let (count, seconds) = (elements.len() / 16, start.elapsed().as_secs_f64());
    info!(
        "{count} matrices in {seconds:.4} s, {:.2} million a second",
        1e-6 * count as f64 / seconds
    );
    let array = |data, tail: &[u64]| NumpyArray {
        shape: shape
            .iter()
            .copied()
            .chain(tail.iter().map(|n| *n as usize))
            .collect(),
        values: values(data),
    };
    let mut out: Vec<(String, NumpyArray)> = wanted
        .iter()
        .zip(found)
        .map(|(q, data)| (q.name().to_owned(), array(data, q.shape())))
        .collect();
    if let Some(sigmas) = sigmas {
        for (q, data) in WITH_ERRORS.iter().zip(errors(elements, sigmas)) {
            if wanted.contains(q) {
                out.push((format!("{}_error", q.name()), array(data, &[])));
            }
        }
    }
    (out, missing, count)
}

/// An array of matrices; its leading shape.
fn matrices(path: &Path) -> Result<(Vec<usize>, Values), Failure> {
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

fn array(a: &Arguments) -> Result<Input, Failure> {
    if a.source.is_dir() {
        return Err(Failure::input(format!(
            "{}: it is a store; name the slice, as in: sunstone decompose {0} polarimetric -o {}",
            a.source.display(),
            a.output.display()
        )));
    }
    let (shape, values) = matrices(&a.source)?;
    let mut errors = None;
    if let Some(path) = &a.errors {
        let (other, sigmas) = matrices(path)?;
        if other != shape {
            return Err(Failure::input(format!(
                "{}: its shape is {other:?} before the 4 x 4, that of the matrices {shape:?}; give one error per element",
                path.display()
            )));
        }
        errors = Some(sigmas);
    }
    Ok(Input {
        shape,
        values,
        errors,
    })
}

/// Matrices of a stored slice, row-major over the axes that it has besides.
fn stored(a: &Arguments, slice: &str) -> Result<Input, Failure> {
    let source = super::Source {
        store: a.source.clone(),
        slice: slice.to_owned(),
        select: a.select.clone(),
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
            "slice {slice} of {} does not hold whole Mueller matrices; choose one with polarization = \"mueller\", and select \
             along other axes",
            a.source.display()
        )));
    }
    let axes = result.mean.axes.iter().filter(|axis| !kinds.contains(&axis.kind));
    Ok(Input {
        shape: axes.map(|axis| axis.coords.len()).collect(),
        values: Values::Single(together(&result.mean)),
        errors: Some(Values::Single(together(&result.std_error))),
    })
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
