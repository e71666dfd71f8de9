//! The `sunstone calibrate` command, which calibrates cameras, projectors and detectors.

use crate::{Failure, bail, calibrate_detector, output, places, print, print_path};
use clap::{Args, ValueEnum};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use sunstone::base::calibration_file::Part;
use sunstone::base::length::Length;
use sunstone::base::whole_file;
use sunstone::rig::calibrate::geometric::board::Board;
use sunstone::rig::calibrate::geometric::bundle::Corner;
use sunstone::rig::calibrate::geometric::calibration::Calibration;
use sunstone::rig::calibrate::geometric::corners::{self, Found};
use sunstone::rig::calibrate::geometric::device::{Free, Model};
use sunstone::rig::calibrate::geometric::fit::{Fit, Setup, fit};
use sunstone::rig::calibrate::geometric::image::{Image, Loaded, is_image, png_bytes};
use sunstone::rig::calibrate::geometric::light::{Sequence, at_corners, decode};
use tracing::info;

/// Calibrate cameras and projectors from images, and detectors from runs.
#[derive(Args)]
#[command(after_help = "\
Examples:
  sunstone calibrate board shots/*.png --columns 9 --rows 6 --square 25mm -o calib.toml
  sunstone calibrate patterns --projector 912x1140 -o patterns
  sunstone calibrate projector view1 view2 view3 view4 --columns 9 --rows 6 --square 25mm --projector 912x1140 -o calib.toml")]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

commands! {
    Board(BoardArguments) => board,
    Patterns(PatternArguments) => patterns,
    Projector(ProjectorArguments) => projector,
    Counter(calibrate_detector::Counter) => calibrate_detector::counter,
    Sensor(calibrate_detector::Sensor) => calibrate_detector::sensor,
}

/// Longest side of a square, in metres, for which the unit can be omitted.
const LONGEST_SQUARE: f64 = 0.5;
/// Longest side of a board, in metres, for which the unit can be omitted.
const LONGEST_BOARD: f64 = 2.0;

/// The calibration target and the options of the fit.
#[derive(Args)]
#[allow(clippy::struct_excessive_bools)] // each is one flag
struct Target {
    /// Number of inner corners along a row of the board: one less than the number of squares.
    #[arg(long)]
    columns: usize,
    /// Number of inner corners along a column of the board.
    #[arg(long)]
    rows: usize,
    /// Side of a square, such as 25mm, 2.5cm or 0.025m. The unit is required above 0.5 m and for boards
    /// longer than 2 m.
    #[arg(long, value_name = "LENGTH")]
    square: Length,
    /// Lens model of the camera: its distortion coefficients in OpenCV's order.
    #[arg(long, value_enum, default_value_t = Lens::Five)]
    lens: Lens,
    /// Fix fy = fx.
    #[arg(long)]
    fix_aspect: bool,
    /// Fix the principal point at the centre of the image.
    #[arg(long)]
    fix_centre: bool,
    /// Fix k3 = 0.
    #[arg(long)]
    fix_k3: bool,
    /// Fix p1 = p2 = 0.
    #[arg(long)]
    zero_tangential: bool,
    /// Detect outlier corners and exclude them from the fit.
    #[arg(long)]
    robust: bool,
    /// File to write: .toml keeps the other calibrations in the file; .json is OpenCV's format.
    #[arg(short, long, value_name = "CALIB.toml")]
    output: PathBuf,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Lens {
    #[value(name = "none")]
    None,
    #[value(name = "5")]
    Five,
    #[value(name = "8")]
    Eight,
    #[value(name = "12")]
    Twelve,
    #[value(name = "fisheye")]
    Fisheye,
}

impl From<Lens> for Model {
    fn from(lens: Lens) -> Self {
        match lens {
            Lens::None => Self::Pinhole,
            Lens::Five => Self::Five,
            Lens::Eight => Self::Eight,
            Lens::Twelve => Self::Twelve,
            Lens::Fisheye => Self::Fisheye,
        }
    }
}

/// Calibrate a camera from images of a chessboard.
///
/// Images are .png of 8 or 16 bits, .jpg, or .npy, and must show the whole board. Images in which the board
/// is not found are skipped and listed. Writes the `[camera]` table of a scene file, standard errors and
/// covariances.
#[derive(Args)]
struct BoardArguments {
    /// Images of the board in different poses.
    #[arg(required = true, value_name = "IMAGES")]
    images: Vec<PathBuf>,
    #[command(flatten)]
    target: Target,
    /// Also write the detected corners as CSV: image, number, board x and y in metres, pixel x and y (the
    /// first pixel covers 0..1).
    #[arg(long, value_name = "CORNERS.csv")]
    corners: Option<PathBuf>,
}

/// Options of the structured-light patterns.
#[derive(Args)]
struct Light {
    /// Resolution of the projector in pixels, such as 912x1140.
    #[arg(long, value_name = "WxH", value_parser = size)]
    projector: [u32; 2],
    /// Number of phase-shifted waves to add for subpixel positions: 3 to 64, or 0 for none.
    #[arg(long, default_value_t = 0)]
    shifts: u32,
    /// Period of the waves in pixels.
    #[arg(long, default_value_t = 16)]
    period: u32,
}

impl Light {
    fn sequence(&self) -> Result<Sequence, Failure> {
        Sequence::with_waves(self.projector, self.shifts, self.period).map_err(Failure::input)
    }
}

/// Write the patterns for `calibrate projector`: white, black, and Gray codes of columns and rows with their
/// inverses.
#[derive(Args)]
struct PatternArguments {
    #[command(flatten)]
    light: Light,
    /// Folder to write; its images are named 000.png, 001.png and so on.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
}

/// Calibrate a projector together with a camera that captures its patterns on a chessboard.
///
/// Each folder is one pose of the board. It contains the images of all patterns of `calibrate patterns`; the
/// order of the names is the order of the patterns. Writes the `[camera]` and `[projector]` tables of a scene
/// file in the camera's frame, standard errors and covariances.
#[derive(Args)]
struct ProjectorArguments {
    /// Folders of images, one for each pose of the board.
    #[arg(required = true, value_name = "FOLDERS")]
    views: Vec<PathBuf>,
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    light: Light,
    /// Lens model of the projector.
    #[arg(long, value_enum, default_value_t = Lens::Five)]
    projector_lens: Lens,
    /// Radius, in pixels, of the neighbourhood of a corner that locates it on the projector [default: half of
    /// the smallest square].
    #[arg(long, value_name = "PIXELS")]
    reach: Option<f64>,
}

/// Parses width and height in pixels, such as `912x1140`.
fn size(text: &str) -> Result<[u32; 2], String> {
    let parts = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    parts.ok_or_else(|| "expected width and height in pixels, such as 912x1140".into())
}

impl Target {
    fn board(&self) -> Result<Board, Failure> {
        places::extension([&self.output], "calibrations are", &["toml", "json"])?;
        let square = self.square.within(LONGEST_SQUARE, "--square").map_err(Failure::input)?;
        let board = Board::new(self.columns, self.rows, square).map_err(Failure::input)?;
        let extent = square * (self.columns.max(self.rows) + 1) as f64;
        if !self.square.has_unit && extent > LONGEST_BOARD {
            bail!(
                "--square {square}: a number without a unit is in metres, so the board would be {extent:.1} m long; write {square}mm or \
                 {square}m"
            );
        }
        Ok(board)
    }

    fn setup(&self, size: [u32; 2], lens: Lens) -> Setup {
        Setup {
            free: Free {
                aspect: !self.fix_aspect,
                centre: !self.fix_centre,
                k3: !self.fix_k3,
                tangential: !self.zero_tangential,
                ..Free::default()
            },
            ..Setup::new(size, lens.into())
        }
    }

    /// Writes the calibration and prints the quality of the fit.
    fn write(&self, fit: &Fit, files: Vec<String>) -> Result<(), Failure> {
        let calibration = Calibration::new(fit, files);
        if self.output.extension().is_some_and(|e| e == "json") {
            whole_file::write(&self.output, calibration.to_opencv_json().as_bytes())
                .map_err(Failure::at(&self.output))?;
        } else {
            let text = toml::to_string(&calibration).map_err(Failure::failed)?;
            output::calibration(&self.output, Part::Devices, &text)?;
        }
        for note in &fit.notes {
            eprintln!("note: {note}");
        }
        for (v, c) in fit.outliers.iter().take(10) {
            eprintln!(
                "note: view {}: corner {} is excluded, because the residual is an outlier",
                v + 1,
                c + 1
            );
        }
        if fit.outliers.len() > 10 {
            eprintln!("note: {} corners are excluded in total", fit.outliers.len());
        }
        for (title, d) in ["camera", "projector"].iter().zip(0..fit.devices.len()) {
            let (device, errors) = (&fit.devices[d], fit.errors(d));
            eprintln!(
                "{title}: {:.4} pixels RMS; fx {:.2} ± {:.2}, fy {:.2} ± {:.2}, cx {:.2} ± {:.2}, cy {:.2} ± {:.2}",
                fit.rms[d],
                device.focal.x,
                errors[0],
                device.focal.y,
                errors[1],
                device.centre.x,
                errors[2],
                device.centre.y,
                errors[3]
            );
        }
        print_path(&self.output)
    }
}

/// Finds the board in each image. For images without a board, prints a note and returns `None`.
fn search(images: &[(String, Image)], board: &Board) -> Vec<Option<Found>> {
    let found: Vec<_> = images.par_iter().map(|(_, image)| corners::find(image, board)).collect();
    let message = found
        .into_iter()
        .zip(images)
        .map(|(found, (name, _))| found.map_err(|why| eprintln!("note: {name} is excluded: {why}")).ok());
    message.collect()
}

/// Loads the images of one camera. All images must have the same size and orientation.
fn load(paths: &[PathBuf]) -> Result<Vec<(String, Image)>, Failure> {
    let load = |p: &PathBuf| Ok((p.display().to_string(), Image::load(p).map_err(Failure::input)?));
    let loaded: Vec<(String, Loaded)> = paths.par_iter().map(load).collect::<Result<_, Failure>>()?;
    let Some((first, one)) = loaded.first() else {
        return Ok(vec![]);
    };
    for (name, other) in &loaded {
        if other.image.size() != one.image.size() {
            let [w, h] = other.image.size();
            bail!(
                "{name} has {w} × {h} pixels, but {first} has {} × {} pixels; use images of one size from one camera",
                one.image.width,
                one.image.height
            );
        }
        if other.orientation != one.orientation {
            bail!(
                "{name} has the EXIF orientation {}, but {first} has the EXIF orientation {}; use images with one orientation",
                other.orientation,
                one.orientation
            );
        }
    }
    if one.orientation != 1 {
        eprintln!(
            "note: the images are rotated according to their EXIF orientation {}, as in OpenCV; the rotated images have {} × {} pixels",
            one.orientation, one.image.width, one.image.height
        );
    }
    Ok(loaded.into_iter().map(|(name, l)| (name, l.image)).collect())
}

fn board(a: &BoardArguments) -> Result<(), Failure> {
    places::files(a.images.iter().map(Some), [Some(&a.target.output), a.corners.as_ref()])?;
    let board = a.target.board()?;
    let images = load(&a.images)?;
    let size = images[0].1.size();
    let found = search(&images, &board);
    let points = board.points();
    let (mut views, mut files) = (vec![], vec![]);
    let mut table = String::from("image,corner,x_m,y_m,x_px,y_px\n");
    for ((name, _), found) in images.iter().zip(&found) {
        let Some(found) = found else { continue };
        let corner = |(x, at): (&_, &_)| Corner { board: *x, camera: *at, projector: None };
        let corners: Vec<Corner> = points.iter().zip(&found.corners).map(corner).collect();
        for (i, c) in corners.iter().enumerate() {
            let file = name.replace(',', "_");
            table += &format!("{file},{i},{},{},{:.5},{:.5}\n", c.board.x, c.board.y, c.camera.x, c.camera.y);
        }
        views.push(corners);
        files.push(name.clone());
    }
    if views.len() < images.len() {
        eprintln!("note: using {} of {} images", views.len(), images.len());
    }
    if views.is_empty() {
        bail!(
            "none of the {} images shows a complete board of {} × {} inner corners; capture the whole board, or correct --columns and --rows",
            images.len(),
            board.columns,
            board.rows
        );
    }
    let fitted =
        fit(&[a.target.setup(size, a.target.lens)], &views, a.target.robust).map_err(Failure::input)?;
    if let Some(path) = &a.corners {
        whole_file::write(path, table.as_bytes()).map_err(Failure::at(path))?;
    }
    a.target.write(&fitted, files)
}

fn patterns(a: &PatternArguments) -> Result<(), Failure> {
    places::folders([], [Some(&a.output)])?;
    let sequence = a.light.sequence()?;
    let [w, h] = sequence.size;
    let all = sequence.patterns();
    for (i, pattern) in all.iter().enumerate() {
        let path = a.output.join(format!("{i:03}.png"));
        let bytes = png_bytes(w, h, &sequence.bytes(*pattern));
        let bytes = bytes.ok_or_else(|| Failure::failed("internal error: cannot encode a pattern as PNG"))?;
        whole_file::write(&path, &bytes).map_err(Failure::at(&path))?;
    }
    print(&format!("{}: {} patterns", a.output.display(), all.len()))
}

/// Returns the images of a folder, sorted by name. Skips other files and prints their number.
fn frames(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let bad =
        |e: std::io::Error| Failure::input(format!("{}: {e}; pass a folder of images", folder.display()));
    let (mut all, mut others) = (vec![], 0);
    for entry in std::fs::read_dir(folder).map_err(bad)? {
        let path = entry.map_err(bad)?.path();
        let hidden = path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
        if !hidden && is_image(&path) {
            all.push(path);
        } else {
            others += u32::from(!hidden);
        }
    }
    if others > 0 {
        eprintln!(
            "note: {}: {others} files are ignored, because they are not .png, .jpg or .npy images",
            folder.display()
        );
    }
    all.sort();
    Ok(all)
}

fn projector(a: &ProjectorArguments) -> Result<(), Failure> {
    places::files([], [Some(&a.target.output)])?;
    let board = a.target.board()?;
    let sequence = a.light.sequence()?;
    if let Some(r) = a.reach.filter(|r| !(2.0..=1000.0).contains(r)) {
        bail!("--reach: expected 2 to 1000 pixels, got {r}");
    }
    let points = board.points();
    let (mut views, mut files, mut size) = (vec![], vec![], None);
    for folder in &a.views {
        let images = load(&frames(folder)?)?;
        let images: Vec<Image> = images.into_iter().map(|(_, image)| image).collect();
        let name = folder.display().to_string();
        let decoded = decode(&sequence, &images).map_err(|e| {
            Failure::input(format!(
                "{name}: {e}; capture one image of each pattern that `sunstone calibrate patterns` writes, in the same order"
            ))
        })?;
        let here = images[0].size();
        if *size.get_or_insert(here) != here {
            bail!(
                "{name}: the images differ in size from the images of the first folder; use images of one size"
            );
        }
        let white = [(
            format!("{name}, white"),
            images.into_iter().next().unwrap_or_else(|| unreachable!("decoded")),
        )];
        let Some(found) = search(&white, &board).pop().flatten() else {
            continue;
        };
        let reach = a.reach.unwrap_or((0.5 * found.smallest).clamp(6.0, 40.0));
        let thrown = at_corners(&decoded, &found.corners, reach);
        let lit = thrown.iter().flatten().count();
        info!(
            "{name}: projector pixels are decoded at {} camera pixels, and at {lit} of {} corners",
            decoded.count(),
            board.len()
        );
        if lit < board.len() && lit >= 8 {
            eprintln!("note: {name}: projector pixels are decoded at only {lit} of {} corners", board.len());
        }
        if lit < 8 {
            eprintln!(
                "note: {name} is excluded: projector pixels are decoded at only {lit} of its corners, but at least 8 are needed"
            );
            continue;
        }
        let corner = |((x, at), projector): ((&_, &_), _)| Corner { board: *x, camera: *at, projector };
        views.push(points.iter().zip(&found.corners).zip(thrown).map(corner).collect::<Vec<_>>());
        files.push(name);
    }
    if views.len() < a.views.len() {
        eprintln!("note: using {} of {} folders", views.len(), a.views.len());
    }
    let Some(size) = size.filter(|_| !views.is_empty()) else {
        bail!(
            "none of the folders shows the complete board lit by the projector; capture images of the complete, fully lit board"
        );
    };
    let setups = [a.target.setup(size, a.target.lens), a.target.setup(sequence.size, a.projector_lens)];
    let fitted = fit(&setups, &views, a.target.robust).map_err(Failure::input)?;
    a.target.write(&fitted, files)
}
