//! The `sunstone project` command, which projects points of a scene onto the devices' pixels.

use crate::{Failure, bail, print};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use sunstone::base::document;
use sunstone::base::locate::InputError;
use sunstone::transport::device::pinhole::Pinhole;

/// Print the pixels of camera and projector onto which points project, as CSV.
///
/// Each line of POINTS.csv is a point x,y,z in metres, in the scene's coordinates. Lines that begin with #
/// and a first line of names are skipped. Prints the points with camera_x, camera_y, projector_x,
/// projector_y: continuous pixel coordinates, where the first pixel covers 0..1, with lens distortion,
/// exactly as in renders. They are empty for points outside the image of a device or behind it. Occlusion is
/// not tested. A lens of finite aperture is treated as a pinhole at its centre.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone project scene.toml corners.csv
  sunstone project scene.toml corners.csv --opencv > pixels.csv")]
pub struct Arguments {
    /// Scene file.
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Points, one x,y,z per line.
    #[arg(value_name = "POINTS.csv")]
    points: PathBuf,
    /// Print OpenCV's pixel coordinates: (0, 0) is the centre of the first pixel.
    #[arg(long)]
    opencv: bool,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let scene = sunstone::scene::load(&a.scene)?;
    let points = points(&a.points)?;
    if points.is_empty() {
        bail!(
            "{}: the file contains no points; write x,y,z in metres, one point per line",
            a.points.display()
        );
    }
    let (all, mut unseen) = (points.len(), [0; 2]);
    let projector = scene.projector.as_ref().map(|p| &p.pinhole);
    let centre = if a.opencv { 0.5 } else { 0.0 };
    let mut out = String::from("x,y,z,camera_x,camera_y,projector_x,projector_y");
    for [x, y, z] in points {
        let _ = write!(out, "\n{x},{y},{z}");
        for (device, unseen) in [Some(&scene.camera), projector].into_iter().zip(&mut unseen) {
            let pixel = device.and_then(|d: &Pinhole| d.project([x, y, z].map(|v| v as f32).into()));
            if let Some((at, _)) = pixel {
                let _ = write!(out, ",{:.6},{:.6}", at.x - centre, at.y - centre);
            } else {
                out.push_str(",,");
                *unseen += usize::from(device.is_some());
            }
        }
    }
    for (n, name) in unseen.into_iter().zip(["camera", "projector"]) {
        if n > 0 {
            eprintln!("note: {n} of {all} points are outside the view of the {name}");
        }
    }
    print(&out)
}

/// Reads a file of points with one x,y,z (metres) per line.
fn points(path: &Path) -> Result<Vec<[f64; 3]>, InputError> {
    let fix = "use a text file with x,y,z in metres, one point per line";
    let text = document::read(path, "points", fix)?;
    let mut points = vec![];
    let mut start = 0;
    let mut first = true;
    for line in text.split_inclusive('\n') {
        let span = start..start + line.trim_end().len();
        start += line.len();
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        let words: Vec<&str> = line.split(',').map(str::trim).collect();
        let numbers: Vec<f64> = words.iter().filter_map(|w| w.parse().ok()).collect();
        match numbers[..] {
            [x, y, z] if words.len() == 3 && numbers.iter().all(|v| v.abs() < 1e30) => points.push([x, y, z]),
            // The first line may contain the names of the columns.
            [] if first => {}
            _ => {
                let message = format!("expected x,y,z, got `{}`", line.trim());
                return Err(InputError::new(path, text.as_str(), Some(span), message, fix));
            }
        }
        first = false;
    }
    Ok(points)
}
