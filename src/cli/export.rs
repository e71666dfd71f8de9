//! The `sunstone export` command, which writes OpenEXR images and Mitsuba 3 scenes.

use crate::{Failure, bail, places, print, print_path, source};
use std::path::PathBuf;
use sunstone::scene::mitsuba::export::Export;
use sunstone::store::exr::{ExrError, ExrOptions, export};
use sunstone::store::probe::{Selection, parse_axes};

/// Export an image slice as OpenEXR, or a scene for Mitsuba 3.
///
/// STORE SLICE -o X.exr writes an image with the channels stokes.S0.R … stokes.S3.B, and R, G, B (S0 again).
/// Column 0 of the Mueller matrix is the Stokes image under unpolarized light. Frames are Sunstone's, not
/// those of Mitsuba's stokes integrator: CONVENTIONS.md gives the angle between them. Axes other than y and x
/// are summed unless they are selected or expanded into channels.
///
/// SCENE.toml --mitsuba DIR writes DIR/scene.xml with its meshes, images and tables, for mitsuba.load_file.
/// Several wavelengths need a spectral polarized variant; for a mono variant, select one with --wavelength.
#[derive(clap::Args)]
pub struct Arguments {
    /// Store written by `render` or `merge`; or, with --mitsuba, a scene file.
    #[arg(value_name = "STORE|SCENE.toml")]
    source: PathBuf,
    /// Slice to read.
    #[arg(required_unless_present = "mitsuba", conflicts_with = "mitsuba")]
    slice: Option<String>,
    /// Keep part of an axis: AXIS=VALUE (nearest entry) or AXIS=FROM:TO, in the axis' unit. Repeatable.
    #[arg(short = 'k', long = "select", conflicts_with = "mitsuba")]
    select: Vec<Selection>,
    /// Axes to write as separate channels (comma-separated names).
    #[arg(long, default_value = "", conflicts_with = "mitsuba")]
    expand: String,
    /// Write all 16 Mueller elements (mueller.M00.R … mueller.M33.B).
    #[arg(long, conflicts_with = "mitsuba")]
    mueller: bool,
    /// EXR file to write.
    #[arg(short, long, required_unless_present = "mitsuba", conflicts_with = "mitsuba")]
    output: Option<PathBuf>,
    /// Write the scene for Mitsuba 3 into this folder.
    #[arg(long, value_name = "DIR")]
    mitsuba: Option<PathBuf>,
    /// Export the scene at this wavelength only, nanometres.
    #[arg(long, value_name = "NM", requires = "mitsuba", value_parser = places::wavelength)]
    wavelength: Option<f64>,
    /// Write into a folder that contains files, and replace files of the same names.
    #[arg(long, requires = "mitsuba")]
    force: bool,
    /// Also read an unfinished render: values that are not rendered yet are NaN.
    #[arg(long, requires = "slice")]
    partial: bool,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    match (&a.mitsuba, &a.slice, &a.output) {
        (Some(folder), ..) => scene(a, folder),
        (None, Some(slice), Some(output)) => image(a, slice, output),
        _ => bail!("expected STORE SLICE -o X.exr, or SCENE.toml --mitsuba DIR"),
    }
}

fn image(a: &Arguments, slice: &str, output: &PathBuf) -> Result<(), Failure> {
    places::files([Some(&a.source)], [Some(output)])?;
    places::extension([output], "images are", &["exr"])?;
    let (_, slice) = source::slice(&a.source, slice, a.partial)?;
    let options = ExrOptions {
        select: a.select.clone(),
        expand: if a.expand.is_empty() { vec![] } else { parse_axes(&a.expand).map_err(Failure::input)? },
        mueller: a.mueller,
    };
    export(&slice, &options, output).map_err(|e| match e {
        ExrError::Write { .. } => Failure::failed(e),
        _ => Failure::input(e),
    })?;
    print_path(output)
}

fn scene(a: &Arguments, folder: &PathBuf) -> Result<(), Failure> {
    places::folders([Some(&a.source)], [Some(folder)])?;
    let export = Export::load(&a.source, a.wavelength)?;
    export.write(folder, a.force).map_err(|e| match e {
        sunstone::scene::mitsuba::WriteError::Occupied(_) => Failure::input(e),
        _ => Failure::failed(e),
    })?;
    for note in &export.notes {
        eprintln!("note: {note}");
    }
    print(&folder.join("scene.xml").display().to_string())
}
