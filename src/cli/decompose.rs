//! The `sunstone decompose` command, which computes the Lu–Chipman decomposition.

use crate::matrices::MatrixSource;
use crate::{Failure, bail, places, print_path};
use std::path::{Path, PathBuf};
use std::time::Instant;
use sunstone::matrices::Matrices;
use sunstone::polarimetry::decompose::maps::{Quantity, Real, WITH_ERRORS, errors, maps};
use sunstone::store::numpy::{NumpyArray, Values, write_npz};
use tracing::info;

/// Decompose Mueller matrices after Lu and Chipman: M = M_Δ M_R M_D.
///
/// Reads an array of shape (..., 4, 4), or a slice of a store that resolves polarization. Writes arrays of
/// the leading shape: polarizance, diattenuation, retardance (radians, 0 to π), depolarization,
/// retardance_axis (..., 3), and the factors m_delta, m_r, m_d (..., 4, 4), whose product is the matrix. For
/// a slice, and with --errors, also writes the standard errors of the four scalars. Unphysical matrices (m00
/// ≤ 0, diattenuation above 1) give NaN.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone decompose M.npy -o props.npz                        numpy.load('props.npz')['retardance']
  sunstone decompose out/mirror_room.zarr polarimetric -o props.npz -k wavelength=550
  sunstone decompose M.npy --only retardance,entropy -o props.npz")]
pub struct Arguments {
    #[command(flatten)]
    from: MatrixSource,
    /// Standard errors of the elements (.npy), of the same shape.
    #[arg(long, value_name = "E.npy", conflicts_with = "slice")]
    errors: Option<PathBuf>,
    /// Write only these arrays (comma-separated; also `entropy`, after Cloude).
    #[arg(long, value_delimiter = ',', value_parser = quantity)]
    only: Vec<Quantity>,
    /// File to write.
    #[arg(short, long, value_name = "X.npz")]
    output: PathBuf,
}

fn quantity(text: &str) -> Result<Quantity, String> {
    Quantity::ALL.into_iter().find(|q| q.name() == text).ok_or_else(|| {
        let names: Vec<&str> = Quantity::ALL.iter().map(|q| q.name()).collect();
        format!("unknown array; choose from {}", names.join(", "))
    })
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    places::files([Some(&a.from.source), a.errors.as_ref()], [Some(&a.output)])?;
    places::extension([&a.output], "arrays are", &["npz"])?;
    let Matrices { shape, values, errors, .. } =
        a.from.read("decompose", &format!("-o {}", a.output.display()))?;
    let errors = match &a.errors {
        Some(path) => Some(sigmas(path, &shape)?),
        None => errors,
    };
    let shape = shape.as_slice();
    let (out, missing, all) = match (&values, &errors) {
        (Values::Single(m), None) => arrays(a, shape, m, None, Values::Single),
        (Values::Single(m), Some(Values::Single(e))) => arrays(a, shape, m, Some(e), Values::Single),
        (Values::Double(m), None) => arrays(a, shape, m, None, Values::Double),
        (Values::Double(m), Some(Values::Double(e))) => arrays(a, shape, m, Some(e), Values::Double),
        (m, Some(e)) => bail!(
            "--errors: the dtype of the errors is {}, but the dtype of the matrices is {}; save both arrays with one dtype",
            e.dtype(),
            m.dtype()
        ),
    };
    if missing == all {
        bail!(
            "{}: none of the {all} matrices is realizable (m00 <= 0, diattenuation above 1, or not finite); no file was written",
            a.from.source.display()
        );
    }
    if missing > 0 {
        eprintln!(
            "note: {missing} of {all} matrices are not realizable (m00 <= 0, diattenuation above 1, or not finite) and are NaN in the output"
        );
    }
    write_npz(&a.output, &out).map_err(Failure::at(&a.output))?;
    print_path(&a.output)
}

/// Returns the arrays to write, the number of matrices without a decomposition, and the number of all
/// matrices.
fn arrays<T: Real>(
    a: &Arguments,
    shape: &[usize],
    elements: &[T],
    sigmas: Option<&[T]>,
    values: fn(Vec<T>) -> Values,
) -> (Vec<(String, NumpyArray)>, usize, usize) {
    let wanted: Vec<Quantity> = if a.only.is_empty() {
        Quantity::ALL.into_iter().filter(|q| *q != Quantity::Entropy).collect()
    } else {
        a.only.clone()
    };
    let start = Instant::now();
    let (found, missing) = maps(elements, &wanted);
    let (count, seconds) = (elements.len() / 16, start.elapsed().as_secs_f64());
    info!("{count} matrices in {seconds:.4} s, {:.2} million per second", 1e-6 * count as f64 / seconds);
    let array = |data, tail: &[u64]| NumpyArray {
        shape: shape.iter().copied().chain(tail.iter().map(|n| *n as usize)).collect(),
        values: values(data),
    };
    let mut out: Vec<(String, NumpyArray)> =
        wanted.iter().zip(found).map(|(q, data)| (q.name().to_owned(), array(data, q.shape()))).collect();
    if let Some(sigmas) = sigmas {
        for (q, data) in WITH_ERRORS.iter().zip(errors(elements, sigmas)) {
            if wanted.contains(q) {
                out.push((format!("{}_error", q.name()), array(data, &[])));
            }
        }
    }
    (out, missing, count)
}

/// Reads the standard errors of an array's elements. The shape must be that of the matrices.
fn sigmas(path: &Path, shape: &[usize]) -> Result<Values, Failure> {
    let Matrices { shape: other, values: sigmas, .. } = Matrices::of_array(path).map_err(Failure::input)?;
    if other != shape {
        bail!(
            "{}: the leading axes of the errors have shape {other:?}, but the leading axes of the matrices have shape {shape:?}; pass \
             one error per matrix element",
            path.display()
        );
    }
    let negative = match &sigmas {
        Values::Single(v) => v.iter().find(|e| **e < 0.0).map(ToString::to_string),
        Values::Double(v) => v.iter().find(|e| **e < 0.0).map(ToString::to_string),
    };
    if let Some(bad) = negative {
        bail!("{}: expected standard errors of 0 or more, got {bad}", path.display());
    }
    Ok(sigmas)
}
