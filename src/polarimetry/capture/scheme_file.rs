//! Scheme files. Complete schemes are TOML files, and tables of angles are CSV files.
//!
//! ```toml
//! name = "L-QRPR 16"
//! sensor = { kind = "intensity" }             # or "polarizer_array", with extinction and axis_offsets_deg
//! [[generator]]                               # in the order in which light passes them
//! name = "polarizer_1"
//! kind = "polarizer"
//! angle_deg = [0.0, 12.5, …]                  # one number for all captures, or one for each
//! extinction = 1e-4                           # a number, or rows of [nm, value]
//! [[generator]]
//! name = "retarder_2"
//! kind = "retarder"
//! angle_deg = [0.0, 5.0, …]
//! retardance_deg = 90                         # a list where a liquid crystal changes it
//! retardance_error_deg = [[450, 6.1], [550, 0.0], [660, -5.2]]
//! [[analyzer]]
//! …
//! ```
//!
//! A calibration file ([`base::calibration_file`]) is also a scheme file. All tables of a calibration file
//! except the scheme are ignored.
//!
//! A CSV table has the columns `polarizer_1,retarder_2,retarder_3,polarizer_4` in degrees. The columns
//! `retardance_2,retardance_3` are optional. A table without `polarizer_4` describes a polarizer array.

mod format;
mod table;
mod write;

pub use table::from_csv;
pub use write::to_toml;

use super::element::Element;
use super::scheme::Scheme;
use base::document;
use base::locate::{InputError, Located};
use format::{ElementFile, SchemeFile, Text, stem};
use std::path::Path;

/// Reads a scheme from a CSV file if the extension is `csv`, or else from a TOML file.
///
/// # Errors
/// Returns [`InputError`] if the file cannot be read or is not a valid scheme. The error states the file, the
/// line, the column and the fix.
pub fn load(path: &Path) -> Result<Scheme, InputError> {
    let fix = "create a scheme file: sunstone scheme drr -k 36 -o scheme.toml";
    let text = document::read(path, "scheme", fix)?;
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) {
        from_csv(path, &text)
    } else {
        from_toml(path, &text)
    }
}

/// Parses a scheme from TOML text. `path` is used in messages.
///
/// # Errors
/// Returns the same errors as [`load`].
pub fn from_toml(path: &Path, text: &str) -> Result<Scheme, InputError> {
    let place = Text { path, text: text.into() };
    let file: SchemeFile = document::parse(path, text, |message| {
        let missing = message.contains("missing field `sensor`");
        let calibration =
            if missing { "; `sunstone rig calibrate` adds a scheme to a calibration file" } else { "" };
        format!("`sunstone scheme drr -k 36 -o scheme.toml` writes an example{calibration}")
    })?;
    let side = |elements: &[Located<ElementFile>], name: &str| -> Result<Vec<Element>, InputError> {
        let all = elements.iter().enumerate();
        all.map(|(i, e)| place.element(e, name, i)).collect()
    };
    let (generator, analyzer) = (side(&file.generator, "generator")?, side(&file.analyzer, "analyzer")?);
    let name = file.name.clone().unwrap_or_else(|| stem(path));
    let mut scheme = Scheme::new(&name, generator, analyzer, place.sensor(&file.sensor)?)
        .map_err(|e| place.error(None, e.to_string(), "use lists of settings with equal lengths"))?;
    if let Some(source) = &file.source {
        let [s0, s1, s2, s3] = **source;
        let polarized = (s1 * s1 + s2 * s2 + s3 * s3).sqrt();
        if !(s0 > 0.0 && polarized <= s0 * (1.0 + 1e-9) && s0 <= 1e12) {
            return Err(place.error(
                Some(source.span()),
                format!("`source` is {:?}, not a physical Stokes vector", **source),
                "set [s0, s1, s2, s3] with 0 < s0 ≤ 1e12 and s1² + s2² + s3² ≤ s0²",
            ));
        }
        scheme.source = **source;
    }
    if let Some(coaxial) = &file.coaxial {
        for (arm, name) in [(&coaxial.transmission, "transmission"), (&coaxial.reflection, "reflection")] {
            let checks = [
                (arm.efficiency.check(0.0, 1.0), "efficiency"),
                (arm.diattenuation.check(-1.0, 1.0), "diattenuation"),
                (arm.retardance_deg.check(-1e6, 1e6), "retardance_deg"),
            ];
            for (result, field) in checks {
                result.map_err(|must| {
                    place.error(None, format!("`coaxial.{name}.{field}` {must}"), "correct the value")
                })?;
            }
        }
        if let Some(galvo) = &coaxial.galvo {
            for (value, field) in [(&galvo.n, "n"), (&galvo.k, "k")] {
                value.check(0.0, 1e6).map_err(|must| {
                    place.error(None, format!("`coaxial.galvo.{field}` {must}"), "correct the value")
                })?;
            }
        }
        scheme.coaxial = Some(coaxial.clone());
    }
    Ok(scheme)
}

#[cfg(test)]
mod tests;
