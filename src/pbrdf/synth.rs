//! Tables of analytic materials in the KAIST format. This module checks which materials can be tabulated, and
//! writes the list of tables.

use crate::stand_ins::BandedMaterials;
use crate::table_part::nearest_band;
use base::whole_file;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Preferred bands of the list of tables, in nanometres. The nearest available bands are used.
const SHOWN_NM: [u16; 3] = [450, 550, 650];

/// Reason why a material cannot be tabulated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SynthError {
    /// The material has only specular lobes.
    #[error(
        "material `{0}` is purely specular and cannot be tabulated; choose a material with a rough or diffuse lobe"
    )]
    Specular(String),
    /// No material has this name.
    #[error("unknown material `{name}`; known materials: {known}")]
    Unknown {
        name: String,
        /// Names of all materials, separated by commas.
        known: String,
    },
}

/// Checks that materials can be tabulated.
///
/// # Errors
/// Returns [`SynthError`] for the first material that cannot be tabulated.
pub fn check(materials: &BandedMaterials, names: &[String]) -> Result<(), SynthError> {
    for name in names {
        match materials.has_extended_lobe(name) {
            Some(true) => {}
            Some(false) => return Err(SynthError::Specular(name.clone())),
            None => {
                return Err(SynthError::Unknown {
                    name: name.clone(),
                    known: materials.names().cloned().collect::<Vec<_>>().join(", "),
                });
            }
        }
    }
    Ok(())
}

/// Writes `materials.toml` into a folder, and returns the path of the file. The file defines every table in
/// the folder as a material at three of `bands`, in nanometres. Scenes and `sunstone pbrdf sheet` use this
/// file.
///
/// # Errors
/// Returns the file system's error if the file cannot be written.
pub fn list(folder: &Path, bands: &[u16]) -> std::io::Result<PathBuf> {
    let mut tables: Vec<String> = std::fs::read_dir(folder)?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.ends_with(".pbsdf") && !name.starts_with('.'))
        .collect();
    tables.sort();
    let nearest = |nm: u16| nearest_band(bands, f64::from(nm)).map_or(nm, |i| bands[i]);
    let mut shown = SHOWN_NM.map(nearest).to_vec();
    shown.dedup();
    let path = folder.join("materials.toml");
    whole_file::write_with(&path, |file| {
        writeln!(file, "wavelengths_nm = {shown:?}\n\n[materials]")?;
        for table in &tables {
            let stem = table.trim_end_matches(".pbsdf");
            writeln!(file, "{stem:?}.measured = {{ file = {table:?} }}")?;
        }
        Ok(())
    })?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_materials_are_refused() {
        let materials = BandedMaterials::load(None, &[550]).expect("are sound");
        let of = |name: &str| check(&materials, &[name.to_owned()]);
        assert_eq!(of("like_gold"), Ok(()));
        assert!(matches!(of("nothing"), Err(SynthError::Unknown { .. })));
    }

    #[test]
    fn lists_contain_the_tables_of_the_folder() {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["b.pbsdf", "a.pbsdf", ".c.pbsdf", "note.txt"] {
            std::fs::write(folder.path().join(name), "").expect("is written");
        }
        let path = list(folder.path(), &[500, 600]).expect("is written");
        let text = std::fs::read_to_string(path).expect("is there");
        assert_eq!(
            text,
            "wavelengths_nm = [500, 600]\n\n[materials]\n\"a\".measured = { file = \"a.pbsdf\" }\n\"b\".measured = \
             { file = \"b.pbsdf\" }\n"
        );
    }
}
