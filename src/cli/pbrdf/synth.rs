//! `sunstone pbrdf synth`: tables in the KAIST format from analytic materials.

use crate::cli::failure::Failure;
use indicatif::{ProgressBar, ProgressStyle};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use sunstone::material::measured::axes::Axes;
use sunstone::material::measured::write::tabulate;
use sunstone::scene::materials::MaterialSet;
use sunstone::spectrum::{MAX_WAVELENGTHS, Wavelengths};
use sunstone::tensor::store::write_file_with;

/// The stand-ins that come with the program.
const STAND_INS: &str = include_str!("../../../pbrdf/stand_ins.toml");
/// What the names of materials to tabulate begin with, in that file.
const PREFIX: &str = "like_";

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

#[derive(Clone, Copy, Debug)]
struct Resolution([usize; 3]);

impl FromStr for Resolution {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Option<Vec<usize>> = text.split('x').map(|n| n.trim().parse().ok()).collect();
        match parts.as_deref() {
            Some(&[a, b, c]) if [a, b, c].iter().all(|n| (2..=4096).contains(n)) => Ok(Self([a, b, c])),
            _ => Err("give three numbers from 2 to 4096, such as 361x91x91".into()),
        }
    }
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let (path, text) = match &a.material {
        Some(path) => (
            path.clone(),
            std::fs::read_to_string(path).map_err(Failure::input)?,
        ),
        None => (PathBuf::from("stand_ins.toml"), STAND_INS.to_owned()),
    };
    let axes = Axes::even(a.resolution.0, a.bands.clone());
    // A material set carries up to four wavelengths; more bands take more sets of the same materials.
    let mut sets = vec![];
    for bands in a.bands.chunks(MAX_WAVELENGTHS) {
        let nm = bands.iter().copied().map(f64::from).collect();
        let wavelengths = Wavelengths::new(nm).map_err(Failure::input)?;
        sets.push(MaterialSet::at(&path, &text, wavelengths)?);
    }
    let names = names(a, &sets)?;
    std::fs::create_dir_all(&a.output)
        .map_err(|e| Failure::failed(format!("cannot make {}: {e}", a.output.display())))?;
    let bar = ProgressBar::new(names.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
        bar.set_style(style);
    }
    for name in &names {
        bar.set_message(name.clone());
        let sources: Vec<_> = sets.iter().map(|set| (&set.materials, set.names[name])).collect();
        let file = a.output.join(format!("{name}.pbsdf"));
        tabulate(&file, &axes, &sources).map_err(|e| Failure::input(format!("{}: {e}", file.display())))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    list(&a.output, &a.bands)
}

/// The materials to make: those asked for, or all that light from a point can show.
fn names(a: &Arguments, sets: &[MaterialSet]) -> Result<Vec<String>, Failure> {
    let Some(set) = sets.first() else {
        return Err(Failure::input("give at least one band"));
    };
    let smooth = |name: &str| set.names.get(name).map(|id| set.materials.is_smooth(*id));
    for name in &a.name {
        match smooth(name) {
            Some(true) => {}
            Some(false) => {
                return Err(Failure::input(format!(
                    "`{name}` reflects in single directions only, which a table cannot hold"
                )));
            }
            None => {
                let known = set.names.keys().cloned().collect::<Vec<_>>().join(", ");
                return Err(Failure::input(format!(
                    "there is no material `{name}`; there are: {known}"
                )));
            }
        }
    }
    if !a.name.is_empty() {
        return Ok(a.name.clone());
    }
    let wanted = |name: &&String| {
        let prefixed = a.material.is_some() || name.starts_with(PREFIX);
        prefixed && smooth(name) == Some(true)
    };
    Ok(set.names.keys().filter(wanted).cloned().collect())
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
    write_file_with(&path, |file| {
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
