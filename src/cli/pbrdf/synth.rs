//! `sunstone pbrdf synth`: tables in the KAIST format from analytic materials.

use super::stand_ins::{Resolution, Sets};
use crate::cli::failure::Failure;
use indicatif::{ProgressBar, ProgressStyle};
use std::path::{Path, PathBuf};
use sunstone::base::whole_file;
use sunstone::transport::material::measured::axes::Axes;
use sunstone::transport::material::measured::write::tabulate;

/// Tabulate analytic materials as .pbsdf files.
///
/// Without a file of materials, makes the stand-ins for the 25 materials of the KAIST set (like_gold, like_pom, …).
/// Every table holds the BRDF over Rusinkiewicz angles; entries with light or viewer below the horizon are NaN. Beside
/// the tables goes materials.toml, which lists them for scenes and for `sunstone pbrdf sheet`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone pbrdf synth -o pbrdf_tables                          all 25, 37 MB each
  sunstone pbrdf synth -o t --name like_gold --resolution 361x91x91
  sunstone pbrdf synth my_paints.toml -o t")]
pub struct Arguments {
    /// File of materials.
    material: Option<PathBuf>,
    /// Make these alone. Repeatable.
    #[arg(long)]
    name: Vec<String>,
    /// Folder to write to.
    #[arg(short, long)]
    output: PathBuf,
    /// Entries of phi_d (-180° to 180°), theta_d and theta_h (0° to 90°).
    #[arg(long, value_name = "PHI_DxTHETA_DxTHETA_H", default_value = "41x31x91")]
    resolution: Resolution,
    /// Bands, nanometres.
    #[arg(long, value_delimiter = ',', default_values_t = [450, 500, 550, 600, 650])]
    bands: Vec<u16>,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let axes = Axes::even(a.resolution.0, a.bands.clone());
    let sets = Sets::load(a.material.as_deref(), &a.bands)?;
    let names = names(a, &sets)?;
    std::fs::create_dir_all(&a.output)
        .map_err(|e| Failure::failed(format!("cannot make {}: {e}", a.output.display())))?;
    let bar = ProgressBar::new(names.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
        bar.set_style(style);
    }
    for name in &names {
        bar.set_message(name.clone());
        let file = a.output.join(format!("{name}.pbsdf"));
        tabulate(&file, &axes, &sets.sources(name))
            .map_err(|e| Failure::input(format!("{}: {e}", file.display())))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    list(&a.output, &a.bands)
}

/// The materials to make: those asked for, or all that light from a point can show.
fn names(a: &Arguments, sets: &Sets) -> Result<Vec<String>, Failure> {
    for name in &a.name {
        match sets.has_extended_lobe(name) {
            Some(true) => {}
            Some(false) => {
                return Err(Failure::input(format!(
                    "`{name}` reflects in single directions only, which a table cannot hold"
                )));
            }
            None => {
                let known = sets.known().cloned().collect::<Vec<_>>().join(", ");
                return Err(Failure::input(format!(
                    "there is no material `{name}`; there are: {known}"
                )));
            }
        }
    }
    if !a.name.is_empty() {
        return Ok(a.name.clone());
    }
    if a.material.is_none() {
        return Ok(sets.stand_ins());
    }
    let lit = |name: &&String| sets.has_extended_lobe(name) == Some(true);
    Ok(sets.known().filter(lit).cloned().collect())
}

/// Writes materials.toml: every table of the folder as a material.
fn list(folder: &Path, bands: &[u16]) -> Result<(), Failure> {
    let failed = |e: std::io::Error| Failure::failed(format!("{}: {e}", folder.display()));
    let mut tables: Vec<String> = std::fs::read_dir(folder)
        .map_err(failed)?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.ends_with(".pbsdf") && !name.starts_with('.'))
        .collect();
    tables.sort();
    let nearest = |nm: u16| bands.iter().copied().min_by_key(|b| b.abs_diff(nm)).unwrap_or(nm);
    let mut shown = [450, 550, 650].map(nearest).to_vec();
    shown.dedup();
    let path = folder.join("materials.toml");
    whole_file::write_with(&path, |file| {
        use std::io::Write;
        writeln!(file, "wavelengths_nm = {shown:?}\n\n[materials]")?;
        for table in &tables {
            let stem = table.trim_end_matches(".pbsdf");
            writeln!(file, "{stem:?}.measured = {{ file = {table:?} }}")?;
        }
        Ok(())
    })
    .map_err(failed)?;
    crate::cli::print(&path.display().to_string())
}
