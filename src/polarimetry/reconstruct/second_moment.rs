//! Second moments of Mueller matrices, and files of second moments. A second moment is the prior of a class
//! of materials.
//!
//! The second moment is E[t tᵀ] over matrices with T00 = 1, as row-major vectors t. `sunstone pbrdf pca
//! --prior` computes the second moment from pBRDFs (see [`super::pca`]). Files are TOML, so that other
//! programs can write them.

use crate::capture::element::rotator;
use base::locate::{InputError, Located};
use base::{document, whole_file};
use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

/// A 16 × 16 matrix over the elements of Mueller matrices, as row-major vectors (Stokes out first).
pub type Moment = SMatrix<f64, 16, 16>;

/// A second moment E[t tᵀ] with its cached root. The computation of the root is slower than the evaluation of
/// the loss with a prior.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondMoment {
    matrix: Moment,
    root: Moment,
}

impl SecondMoment {
    /// Builds the moment from a positive semidefinite matrix. Eigenvalues that are negative because of
    /// rounding are treated as 0.
    pub fn new(matrix: Moment) -> Self {
        Self { root: root(&matrix), matrix }
    }

    /// Returns E[t tᵀ].
    pub fn matrix(&self) -> &Moment {
        &self.matrix
    }

    /// Returns L with L Lᵀ = E[t tᵀ], as computed by [`root`].
    pub fn root(&self) -> &Moment {
        &self.root
    }
}

/// Returns the root L of a second moment S, with L Lᵀ = S. S may be singular.
pub fn root(s: &Moment) -> Moment {
    let eigen = s.symmetric_eigen();
    let mut l = eigen.eigenvectors;
    for (i, value) in eigen.eigenvalues.iter().enumerate() {
        l.column_mut(i).scale_mut(value.max(0.0).sqrt());
    }
    l
}

/// Returns the second moment of the same matrices in frames that are rotated at random, E[(R(α) ⊗ R(β)) t tᵀ
/// (R(α) ⊗ R(β))ᵀ]. The rotations before and after the scene are independent.
///
/// Tables of materials contain matrices in frames of the plane of scattering. In an image, the frames of
/// camera and projector are at any angle to that plane.
pub fn in_any_frames(second_moment: &Moment) -> Moment {
    // The rotated moment is a polynomial of degree 4 in the sines and cosines of 2α, and in those of 2β. For
    // each of α and β, eight angles give the exact average.
    const ANGLES: usize = 8;
    let turns: Vec<_> =
        (0..ANGLES).map(|i| rotator(std::f64::consts::PI * i as f64 / ANGLES as f64)).collect();
    let mut sum = Moment::zeros();
    for a in &turns {
        for b in &turns {
            let both = a.kronecker(b);
            sum += both * second_moment * both.transpose();
        }
    }
    sum / (ANGLES * ANGLES) as f64
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SecondMomentFile {
    name: Option<String>,
    second_moment: Located<Vec<Vec<f64>>>,
}

#[derive(Serialize)]
struct SecondMomentOut<'a> {
    name: &'a str,
    second_moment: Vec<Vec<f64>>,
}

const FIX: &str = "create a prior: sunstone pbrdf pca --prior prior.toml -o components.png";

/// Reads a second moment.
///
/// # Errors
/// Returns [`InputError`] unless the matrix is 16 × 16, symmetric and positive semidefinite. The error states
/// the file, the location and the fix.
pub fn load(path: &Path) -> Result<Moment, InputError> {
    let text = document::read(path, "prior", FIX)?;
    let file: SecondMomentFile = document::parse(path, &text, |_| FIX.to_owned())?;
    // The name is informative and has no effect.
    let _ = file.name;
    let rows = &file.second_moment;
    let wrong = |message: &str| Err(InputError::new(path, text.as_str(), Some(rows.span()), message, FIX));
    if rows.len() != 16 || rows.iter().any(|row| row.len() != 16) {
        let (count, total) = (rows.len(), rows.iter().map(Vec::len).sum::<usize>());
        return wrong(&format!(
            "expected 16 rows of 16 numbers in `second_moment`, got {count} rows with {total} numbers in total"
        ));
    }
    let s = Moment::from_fn(|i, j| rows[i][j]);
    match fault(&s) {
        Some(fault) => wrong(&format!("`second_moment` {fault}")),
        None => Ok(s),
    }
}

/// Returns the reason why a matrix is not a second moment. The text follows the matrix's name in a message.
/// Returns `None` if the matrix is a second moment.
pub fn fault(s: &Moment) -> Option<&'static str> {
    let most = s.amax();
    if !s.iter().all(|v| v.is_finite()) {
        return Some("has an element that is not finite");
    }
    if (s - s.transpose()).amax() > 1e-9 * most {
        return Some("is not symmetric");
    }
    if most <= 0.0 {
        return Some("is zero");
    }
    (s.symmetric_eigenvalues().min() < -1e-9 * most).then_some("has negative eigenvalues")
}

/// Writes a second moment.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn save(path: &Path, name: &str, s: &Moment) -> std::io::Result<()> {
    let rows = (0..16).map(|i| (0..16).map(|j| s[(i, j)]).collect());
    let out = SecondMomentOut { name, second_moment: rows.collect() };
    let text = toml::to_string(&out).map_err(std::io::Error::other)?;
    whole_file::write_with(path, |file| file.write_all(text.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use optics::sampling::stream::Stream;

    #[test]
    fn written_moments_are_read_back_and_errors_name_the_fault() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("prior.toml");
        let root = Moment::from_fn(|i, j| ((i * 3 + j) as f64).cos());
        let s = root * root.transpose();
        save(&path, "cosines", &s).expect("space");
        assert!((load(&path).expect("a prior") - s).amax() < 1e-12);
        let fault = |text: &str| {
            std::fs::write(&path, text).expect("space");
            load(&path).expect_err("a fault").to_string()
        };
        assert!(fault("second_moment = [[1.0]]").contains("prior.toml:1:17: expected 16 rows"));
        let of = |f: &dyn Fn(usize, usize) -> f64| {
            let rows: Vec<Vec<f64>> = (0..16).map(|i| (0..16).map(|j| f(i, j)).collect()).collect();
            format!("second_moment = {rows:?}")
        };
        assert!(fault(&of(&|i, j| (i * 2 + j) as f64)).contains("not symmetric"));
        assert!(fault(&of(&|i, j| if i == j { -1.0 } else { 0.0 })).contains("negative"));
        assert!(fault(&of(&|_, _| f64::NAN).replace("NaN", "nan")).contains("finite"));
        assert!(fault("prior = 3").contains("pbrdf pca"));
        assert!(load(Path::new("/nowhere/p.toml")).expect_err("no file").to_string().contains("cannot read"));
    }

    /// Verifies that the rotated moment agrees with the moment of 20 000 rotated matrices within 5 standard
    /// errors. A second rotation does not change the moment.
    #[test]
    fn rotated_moments_match_rotated_matrices() {
        let t = nalgebra::SVector::<f64, 16>::from_fn(|e, _| (e as f64 * 1.3).cos());
        let turned = in_any_frames(&(t * t.transpose()));
        assert!((in_any_frames(&turned) - turned).amax() < 1e-12);
        assert!((turned.trace() - t.norm_squared()).abs() < 1e-12);
        let n = 20_000;
        let (mut sum, mut squares) = (Moment::zeros(), Moment::zeros());
        let m = nalgebra::Matrix4::from_fn(|i, j| t[4 * i + j]);
        let mut stream = Stream::new(2, 0, 0);
        for _ in 0..n {
            let [a, b] = stream.uniform2().map(|u| std::f64::consts::PI * f64::from(u));
            let seen = rotator(a) * m * rotator(b).transpose();
            let v = nalgebra::SVector::<f64, 16>::from_fn(|e, _| seen[(e / 4, e % 4)]);
            let product = v * v.transpose();
            sum += product;
            squares += product.component_mul(&product);
        }
        let n = f64::from(n);
        for (mean, (square, want)) in sum.iter().zip(squares.iter().zip(turned.iter())) {
            let deviation = ((square / n - (mean / n).powi(2)).max(0.0) / n).sqrt();
            assert!((mean / n - want).abs() <= 5.0 * deviation + 1e-9);
        }
    }
}
