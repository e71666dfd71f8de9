//! `sunstone import`.

use super::failure::Failure;
use super::places;
use clap::ValueEnum;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use sunstone::base::length::Length;
use sunstone::base::whole_file;
use sunstone::scene::calibration::{self, Options};
use sunstone::scene::mitsuba::WriteError;
use sunstone::scene::mitsuba::import::Import;

/// Make a scene file of a scene of Mitsuba 3, or the camera of one of a calibration.
///
/// SCENE.xml, or .json of a dictionary, of Mitsuba 3 or of version 0.x, with include, alias, path and default. Reads these plugins:
///
/// - materials: diffuse, conductor, roughconductor, dielectric, thindielectric, roughdielectric, plastic, roughplastic, pplastic,
///   principled, measured_polarized, polarizer, circular, retarder, blendbsdf, twosided, mask, normalmap, null;
/// - textures: bitmap and checkerboard; media: homogeneous;
/// - shapes: sphere, disk, cylinder, rectangle, cube, obj, ply, serialized, bsplinecurve, linearcurve, sdfgrid, merge, shapegroup,
///   instance; curves and grids become meshes in PLY files beside the scene file;
/// - sensors: perspective, thinlens; films: hdrfilm, specfilm, and mitransient's transient_hdr_film;
/// - emitters: projector, point, spot, directional, constant, envmap, area.
///
/// Everything else is refused at once, each item with its place. Where the models of the two programs differ, a note states how.
/// Colours given as RGB become values at the scene's wavelengths (red above 590 nm, green from 500 nm, blue below).
///
/// CALIBRATION.yaml, .yml, .json or .npz: reads what OpenCV (cv::FileStorage, JSON, numpy.savez), ROS (camera_info), Kalibr
/// (camchain) and MATLAB (jsonencode of cameraParameters) write, and prints the [camera] or [projector] of a scene file,
/// or writes it with -o; what the file does not say stands above it in comments. Pixel centres, the order of coefficients,
/// row vectors and transposed matrices are those of the program that wrote the file.
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
    /// File to write; absent: of a scene the same name with .toml, of a calibration none.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Of a scene: value of a `$NAME` in the file, as of Mitsuba's -D; `wavelengths_nm=450,550` sets the scene's
    /// wavelengths. Repeatable.
    #[arg(short = 'D', long = "define", value_name = "NAME=VALUE", value_parser = definition)]
    define: Vec<(String, String)>,
    /// Replace the file if it is there.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    calibration: CalibrationArguments,
}

#[derive(clap::Args)]
#[command(next_help_heading = "Of a calibration")]
struct CalibrationArguments {
    /// Device to make of it.
    #[arg(long = "as", value_name = "DEVICE", default_value = "camera")]
    device: Device,
    /// Which of several cameras: a table's name (cam1), or what stands before or behind the names of its matrices (2 for K2
    /// and D2, proj for proj_K).
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Which of several views of a target gives the pose, from 0.
    #[arg(long, value_name = "N")]
    view: Option<usize>,
    /// Size of the image, where the file has none or another is meant.
    #[arg(long, value_name = "WxH", value_parser = resolution)]
    resolution: Option<[u32; 2]>,
    /// Metres that the file's unit of length has: 0.001, or mm, for millimetres. Needed where the file does not say and is more than
    /// 10 of its units from the origin.
    #[arg(long, value_name = "M|UNIT", value_parser = unit)]
    metres_per_unit: Option<f64>,
    /// Four coefficients are those of OpenCV's fisheye.
    #[arg(long)]
    fisheye: bool,
    /// Of Kalibr: the world is the IMU's frame, not the first camera's.
    #[arg(long)]
    imu: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Device {
    Camera,
    Projector,
}

fn resolution(text: &str) -> Result<[u32; 2], String> {
    let sizes = text
        .split_once(['x', 'X', '×'])
        .map(|(w, h)| (w.trim().parse(), h.trim().parse()));
    match sizes {
        Some((Ok(w), Ok(h))) if w > 0 && h > 0 => Ok([w, h]),
        _ => Err("expected WIDTHxHEIGHT, such as 640x480".into()),
    }
}

fn unit(text: &str) -> Result<f64, String> {
    // `mm` alone is one millimetre.
    let one = if text.starts_with(|c: char| c.is_alphabetic()) {
        "1"
    } else {
        ""
    };
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
        places::extension(output, "scenes are", &["toml"])?;
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
    super::output::print(&output.display().to_string())
}

fn calibrated(a: &Arguments) -> Result<(), Failure> {
    let c = &a.calibration;
    if !a.define.is_empty() {
        return Err(Failure::input(
            "-D applies only to Mitsuba scenes; a calibration has no parameters",
        ));
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
    let text = found
        .to_toml(c.device == Device::Projector)
        .map_err(Failure::failed)?;
    let Some(output) = &a.output else {
        return super::output::print(text.trim_end());
    };
    write(&a.scene, output, &text, a.force)?;
    super::output::print(&output.display().to_string())
}

/// Writes a text to a file that is not what was read, and with `force` alone one that is there.
fn write(input: &Path, output: &Path, text: &str, force: bool) -> Result<(), Failure> {
    let shown = output.display();
    if whole_file::is_same(input, output) {
        return Err(Failure::input(format!(
            "{shown} is both the input and the output; choose another output"
        )));
    }
    if output.exists() && !force {
        return Err(Failure::input(format!(
            "{shown} exists; choose another name, or pass --force to replace it"
        )));
    }
    whole_file::write(output, text.as_bytes())
        .map_err(|e| Failure::failed(format!("cannot write {shown}: {e}")))
}
