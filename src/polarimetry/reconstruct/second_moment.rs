//! Second moments of Mueller matrices as files: what a prior knows of a class of materials.
//!
//! E[t tᵀ] of matrices with T00 = 1, vectors row-major. Made from pBRDFs (`sunstone pbrdf pca --prior`, see [`super::pca`]);
//! TOML, so that others can make them too.

use super::loss::Moment;
use base::locate::{InputError, Located};
use base::{document, whole_file};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: Option<String>,
    second_moment: Located<Vec<Vec<f64>>>,
}

#[derive(Serialize)]
struct Out<'a> {
    name: &'a str,
    second_moment: Vec<Vec<f64>>,
}

const MEND: &str = "make one: sunstone pbrdf pca --prior prior.toml -o components.png";

/// Reads a second moment.
///
/// # Errors
/// [`InputError`] naming file, place and mend: if it is not 16 × 16, symmetric and without negative eigenvalues.
pub fn load(path: &Path) -> Result<Moment, InputError> {
    let text = document::read(path, "prior", MEND)?;
    let whole: std::sync::Arc<str> = text.as_str().into();
    let error = |span, message: String| InputError {
        file: path.to_owned(),
        text: whole.clone(),
        span,
        message,
        help: Some(MEND.to_owned()),
    };
    let file: File = document::parse(path, &text, |_| MEND.to_owned())?;
    // Its name is for people.
    let _ = file.name;
    let rows = &file.second_moment;
    let wrong = |message: &str| Err(error(Some(rows.span()), message.to_owned()));
    if rows.len() != 16 || rows.iter().any(|row| row.len() != 16) {
        return wrong("`second_moment` is not 16 rows of 16 numbers");
    }
    let s = Moment::from_fn(|i, j| rows[i][j]);
    if !s.iter().all(|v| v.is_finite()) {
        return wrong("`second_moment` has an element that is no finite number");
    }
    let most = s.amax();
    if (s - s.transpose()).amax() > 1e-9 * most {
        return wrong("`second_moment` is not symmetric");
    }
    if most <= 0.0 || s.symmetric_eigenvalues().min() < -1e-9 * most {
        return wrong("`second_moment` has negative eigenvalues, or is zero");
    }
    Ok(s)
}

/// Writes a second moment.
///
/// # Errors
/// If the file system refuses.
pub fn save(path: &Path, name: &str, s: &Moment) -> std::io::Result<()> {
    let rows = (0..16).map(|i| (0..16).map(|j| s[(i, j)]).collect());
    let out = Out {
        name,
        second_moment: rows.collect(),
    };
    let text = toml::to_string(&out).map_err(std::io::Error::other)?;
    whole_file::write_with(path, |file| file.write_all(text.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_faults_are_named() {
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
        assert!(fault("second_moment = [[1.0]]").contains("prior.toml:1:17: `second_moment` is not 16 rows"));
        let of = |f: &dyn Fn(usize, usize) -> f64| {
            let rows: Vec<Vec<f64>> = (0..16).map(|i| (0..16).map(|j| f(i, j)).collect()).collect();
            format!("second_moment = {rows:?}")
        };
        assert!(fault(&of(&|i, j| (i * 2 + j) as f64)).contains("not symmetric"));
        assert!(fault(&of(&|i, j| if i == j { -1.0 } else { 0.0 })).contains("negative"));
        assert!(fault(&of(&|_, _| f64::NAN).replace("NaN", "nan")).contains("finite"));
        assert!(fault("prior = 3").contains("pbrdf pca"));
        assert!(
            load(Path::new("/nowhere/p.toml"))
                .expect_err("no file")
                .to_string()
                .contains("cannot read")
        );
    }
}
