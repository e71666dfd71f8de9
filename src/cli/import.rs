//! The `sunstone import` command, which converts Mitsuba scenes and camera calibrations.

use crate::{Failure, bail, places, print, print_path};
use clap::ValueEnum;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use sunstone::base::length::Length;
use sunstone::base::whole_file;
use sunstone::scene::calibration::{self, Options};
use sunstone::scene::mitsuba::WriteError;
use sunstone::scene::mitsuba::import::Import;

/// Convert a Mitsuba 3 scene to a scene file, or a calibration to the camera of one.
///
/// Reads SCENE.xml, or .json of a dictionary, of Mitsuba 3 or of version 0.x, with include, alias, path and
/// default. Supports these plugins:
///
/// - materials: diffuse, conductor, roughconductor, dielectric, thindielectric, roughdielectric, plastic,
///   roughplastic, pplastic, principled, measured_polarized, polarizer, circular, retarder, blendbsdf,
///   twosided, mask, normalmap, null;
/// - textures: bitmap and checkerboard; media: homogeneous;
/// - shapes: sphere, disk, cylinder, rectangle, cube, obj, ply, serialized, bsplinecurve, linearcurve,
///   sdfgrid, merge, shapegroup, instance; curves and grids become meshes in PLY files next to the scene
///   file;
/// - sensors: perspective, thinlens; films: hdrfilm, specfilm, and mitransient's transient_hdr_film;
/// - emitters: projector, point, spot, directional, constant, envmap, area.
///
/// Everything else is refused; all unsupported items are reported together, each with its place. A note
/// states each difference between the models of the two programs. Colours given as RGB become values at the
/// scene's wavelengths (red above 590 nm, green from 500 nm, blue below).
///
/// CALIBRATION.yaml, .yml, .json or .npz: reads files of OpenCV (cv::FileStorage, JSON, numpy.savez), ROS
/// (camera_info), Kalibr (camchain) and MATLAB (jsonencode of cameraParameters). Prints the [camera] or
/// [projector] table of a scene file, or writes it with -o. Comments above the table list what the file does
/// not specify. Pixel centres, the order of coefficients, row vectors and transposed matrices are interpreted
/// as in the program that wrote the file.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone import scene.xml -o scene.toml
  sunstone import calibration.yaml >> scene.toml
  sunstone import camchain.yaml --camera cam1
  sunstone import stereo.yml --camera 2 --as projector --metres-per-unit 0.001
  sunstone import cameraParams.json --view 0 --resolution 1280x960 -o camera.toml")]
pub struct Arguments {
    /// Scene of Mitsuba 3 (.xml, .json), or a calibration.
    #[arg(value_name = "SCENE|CALIBRATION")]
    scene: PathBuf,
    /// File to write [default: for a scene, its name with .toml; for a calibration, none].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// For a scene: value of a `$NAME` in the file, like Mitsuba's -D. `wavelengths_nm=450,550` sets the
    /// scene's wavelengths. Repeatable.
    #[arg(short = 'D', long = "define", value_name = "NAME=VALUE", value_parser = definition)]
    define: Vec<(String, String)>,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    calibration: CalibrationArguments,
}

#[derive(clap::Args)]
#[command(next_help_heading = "Of a calibration")]
struct CalibrationArguments {
    /// Device to write.
    #[arg(long = "as", value_name = "DEVICE", default_value = "camera")]
    device: Device,
    /// Camera to read if the file has several: the name of a table (cam1), or the prefix or suffix of the
    /// names of its matrices (2 for K2 and D2, proj for proj_K).
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// View of the target that gives the pose, from 0, if the file has several.
    #[arg(long, value_name = "N")]
    view: Option<usize>,
    /// Resolution of the image, if the file has none, or to override it.
    #[arg(long, value_name = "WxH", value_parser = resolution)]
    resolution: Option<[u32; 2]>,
    /// Length of the file's unit in metres, or its name: 0.001 or mm for millimetres. Required if the file
    /// does not specify the unit and the device is more than 10 units from the origin.
    #[arg(long, value_name = "M|UNIT", value_parser = unit)]
    metres_per_unit: Option<f64>,
    /// Interpret four coefficients as those of OpenCV's fisheye model.
    #[arg(long)]
    fisheye: bool,
    /// For Kalibr: use the IMU's frame as the world, not the first camera's.
    #[arg(long)]
    imu: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Device {
    Camera,
    Projector,
}

fn resolution(text: &str) -> Result<[u32; 2], String> {
    let sizes = text.split_once(['x', 'X', '×']).map(|(w, h)| (w.trim().parse(), h.trim().parse()));
    match sizes {
        Some((Ok(w), Ok(h))) if w > 0 && h > 0 => Ok([w, h]),
        _ => Err("expected WIDTHxHEIGHT, such as 640x480".into()),
    }
}

fn unit(text: &str) -> Result<f64, String> {
    // A unit without a number, such as `mm`, means one of that unit.
    let one = if text.starts_with(|c: char| c.is_alphabetic()) { "1" } else { "" };
    match format!("{one}{text}").parse::<Length>() {
        Ok(v) if (1e-12..=1e12).contains(&v.metres) => Ok(v.metres),
        _ => Err("expected metres, such as 0.001, or a unit, such as mm".into()),
    }
}

fn definition(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.to_owned(), value.to_owned())),
        _ => Err("expected NAME=VALUE".into()),
    }
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    if let Some(output) = &a.output {
        places::files([Some(&a.scene)], [Some(output)])?;
        places::extension([output], "scenes are", &["toml"])?;
    }
    if calibration::is_calibration(&a.scene) {
        return calibrated(a);
    }
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
    print_path(&output)
}

fn calibrated(a: &Arguments) -> Result<(), Failure> {
    let c = &a.calibration;
    if !a.define.is_empty() {
        bail!("-D applies only to Mitsuba scenes, because a calibration has no parameters; remove -D");
    }
    let options = Options {
        camera: c.camera.clone(),
        view: c.view,
        resolution: c.resolution,
        metres_per_unit: c.metres_per_unit,
        fisheye: c.fisheye,
        imu: c.imu,
    };
    let found = calibration::load(&a.scene, &options)?;
    let text = found.to_toml(c.device == Device::Projector).map_err(Failure::failed)?;
    let Some(output) = &a.output else {
        return print(text.trim_end());
    };
    write(&a.scene, output, &text, a.force)?;
    print_path(output)
}

/// Writes a text to a file other than the input. Replaces an existing file only with `force`.
fn write(input: &Path, output: &Path, text: &str, force: bool) -> Result<(), Failure> {
    let shown = output.display();
    if whole_file::is_same(input, output) {
        bail!("{shown} is both the input and the output; choose another output");
    }
    if output.exists() && !force {
        bail!("{shown} exists; choose another output, or pass --force to replace the existing file");
    }
    whole_file::write(output, text.as_bytes()).map_err(|e| {
        Failure::failed(format!(
            "cannot write {shown}: {e}; check that the folder is writable and the disk is not full"
        ))
    })
}
