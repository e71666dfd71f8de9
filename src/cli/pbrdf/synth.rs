//! The `sunstone pbrdf synth` command, which writes tables of analytic materials in the KAIST format.

use super::data::{Resolution, banded_failure};
use crate::progress::bar;
use crate::{Failure, places, print_path};
use std::path::PathBuf;
use sunstone::pbrdf::stand_ins::BandedMaterials;
use sunstone::pbrdf::synth;
use sunstone::transport::material::measured::axes::Axes;
use sunstone::transport::material::measured::error::PbsdfError;
use sunstone::transport::material::measured::write::tabulate;

/// Tabulate analytic materials as .pbsdf files.
///
/// Without a file of materials, makes the stand-ins for the 25 materials of the KAIST set (like_gold,
/// like_pom, …). Every table contains the BRDF over Rusinkiewicz angles; entries with light or viewer below
/// the horizon are NaN. Also writes materials.toml, which lists the tables for scenes and for `sunstone pbrdf
/// sheet`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone pbrdf synth -o pbrdf_tables                          all 25, 37 MB each
  sunstone pbrdf synth -o t --name like_gold --resolution 361x91x91
  sunstone pbrdf synth my_paints.toml -o t")]
pub struct Arguments {
    /// File of materials.
    material: Option<PathBuf>,
    /// Make only the material of this name. Repeatable.
    #[arg(long)]
    name: Vec<String>,
    /// Folder to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Number of entries of phi_d (-180° to 180°), theta_d and theta_h (0° to 90°).
    #[arg(long, value_name = "PHI_DxTHETA_DxTHETA_H", default_value = "41x31x91")]
    resolution: Resolution,
    /// Bands, nanometres.
    #[arg(long, value_delimiter = ',', default_values_t = [450, 500, 550, 600, 650], value_parser = clap::value_parser!(u16).range(100..))]
    bands: Vec<u16>,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let axes = Axes::even(a.resolution.0, a.bands.clone());
    let materials = BandedMaterials::load(a.material.as_deref(), &a.bands).map_err(banded_failure)?;
    let names = names(a, &materials)?;
    let written: Vec<PathBuf> = (names.iter().map(|name| format!("{name}.pbsdf")))
        .chain(["materials.toml".to_owned()])
        .map(|name| a.output.join(name))
        .collect();
    places::folders([], [Some(&a.output)])?;
    places::files([a.material.as_ref()], written.iter().map(Some))?;
    let there = a.output.exists();
    std::fs::create_dir_all(&a.output)
        .map_err(|e| Failure::failed(format!("cannot create {}: {e}", a.output.display())))?;
    let bar = bar("{bar:30} {pos}/{len} {msg}", names.len() as u64);
    for name in &names {
        bar.set_message(name.clone());
        let file = a.output.join(format!("{name}.pbsdf"));
        tabulate(&file, &axes, &materials.sources(name)).map_err(|e| {
            if !there {
                // This call removes only an empty folder.
                let _ = std::fs::remove_dir(&a.output);
            }
            let of_system = matches!(e, PbsdfError::Write(_));
            Failure::of_system(of_system, format!("{}: {e}", file.display()))
        })?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let list = synth::list(&a.output, &a.bands).map_err(Failure::at(&a.output))?;
    print_path(&list)
}

/// Returns the names of the materials to tabulate. These are the given names, or the names of all materials
/// that scatter light from a point emitter.
fn names(a: &Arguments, materials: &BandedMaterials) -> Result<Vec<String>, Failure> {
    synth::check(materials, &a.name).map_err(Failure::input)?;
    Ok(if !a.name.is_empty() {
        a.name.clone()
    } else if a.material.is_none() {
        materials.stand_ins()
    } else {
        materials.tabulable()
    })
}
