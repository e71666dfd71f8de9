//! `sunstone import`.

use super::failure::Failure;
use std::collections::BTreeMap;
use std::path::PathBuf;
use sunstone::scene::mitsuba::WriteError;
use sunstone::scene::mitsuba::import::Import;

/// Make a scene file of a scene of Mitsuba 3.
///
/// Reads what `export --mitsuba` writes, by hand or by Mitsuba: diffuse, conductor, roughconductor, dielectric,
/// roughdielectric, pplastic, measured_polarized, polarizer, retarder, blendbsdf, twosided, normalmap; sphere, disk,
/// cylinder, rectangle, cube, obj, ply; perspective; projector, point, constant. Anything else is an error with its place.
/// Colours given as RGB become values at the scene's wavelengths (red above 590 nm, green from 500 nm, blue below).
#[derive(clap::Args)]
pub struct Arguments {
    /// Scene of Mitsuba 3.
    #[arg(value_name = "SCENE.xml")]
    scene: PathBuf,
    /// Scene file to write; absent: the same name with .toml.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Value of a `$NAME` in the file, as of Mitsuba's -D; `wavelengths_nm=450,550` sets the scene's wavelengths.
    /// Repeatable.
    #[arg(short = 'D', long = "define", value_name = "NAME=VALUE", value_parser = definition)]
    define: Vec<(String, String)>,
    /// Replace the scene file if it is there.
    #[arg(long)]
    force: bool,
}

fn definition(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.to_owned(), value.to_owned())),
        _ => Err("give NAME=VALUE".into()),
    }
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let output = a.output.clone().unwrap_or_else(|| a.scene.with_extension("toml"));
    let parameters: BTreeMap<String, String> = a.define.iter().cloned().collect();
    let import = Import::load(&a.scene, &output, &parameters)?;
    import.write(&output, a.force).map_err(|e| match e {
        WriteError::Io(..) => Failure::failed(e),
        _ => Failure::input(e),
    })?;
    for note in &import.notes {
        eprintln!("note: {note}");
    }
    super::output::print(&output.display().to_string())
}
