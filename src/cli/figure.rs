//! The `sunstone figure` command, which draws slices of a store.

use crate::figure_file::Extension;
use crate::{Failure, bail, figure_file, places, print_path, source};
use std::path::{Path, PathBuf};
use sunstone::figure::spec::{
    Figure, FlightView, MapView, MuellerView, PhotoView, ProfileView, SignedScale, View,
};
use sunstone::figure::{FigureError, Format};
use sunstone::figures::{self, FiguresError};
use sunstone::store::place::is_address;

/// Draw slices of a store, or figures from figure files, as PNG, SVG or PDF; the text and lines of SVG and
/// PDF are vectors.
///
/// For a store without --view, draws the figures that its scene lists (all, or those named). If the scene
/// lists no figures, draws default figures of every slice. For a figure file (.toml), renders the scenes, runs
/// the applications that the file lists, and draws the figure: at full size, or fast with --preview. Renders
/// are kept: a finished render is not repeated.
#[derive(clap::Args)]
pub struct Arguments {
    /// Store written by `render` or `merge`, or a figure file (.toml).
    #[arg(required_unless_present = "all")]
    store: Option<PathBuf>,
    /// Names of the scene's figures or of default figures to draw [default: all figures of the scene]; or
    /// further figure files.
    names: Vec<String>,
    #[command(flatten)]
    of_files: figure_file::Options,
    /// Draw this view of a slice instead of the scene's figures.
    #[arg(long, requires = "slice")]
    view: Option<Kind>,
    /// Slice to draw.
    #[arg(long)]
    slice: Option<String>,
    /// Wavelength of the slice in nanometres (mueller, maps).
    #[arg(long, value_parser = places::wavelength)]
    wavelength: Option<f64>,
    /// Mueller element, such as 01 (maps, profile).
    #[arg(long, default_value = "00", value_parser = element)]
    element: Element,
    /// Index into the slice's camera rows (maps).
    #[arg(long, default_value_t = 0)]
    row: usize,
    /// Camera pixel x,y (profile).
    #[arg(long, value_delimiter = ',', num_args = 1..=2)]
    pixel: Vec<f64>,
    /// Number of frames (flight).
    #[arg(long, default_value_t = FRAMES)]
    frames: usize,
    /// Do not divide Mueller elements by M00 (mueller).
    #[arg(long)]
    raw: bool,
    /// Scale of signed elements (mueller, maps).
    #[arg(long, default_value = "linear")]
    scale: Scale,
    /// Draw signed elements below this number of standard errors in grey (mueller).
    #[arg(long, value_name = "SIGMAS")]
    mask: Option<f32>,
    /// Value at the ends of the colour scale (mueller), or value shown as white (photo).
    #[arg(long)]
    limit: Option<f32>,
    /// Format of the scene's figures and of several figure files; for one output file, its extension sets the
    /// format.
    #[arg(long, default_value = "png", conflicts_with = "view")]
    format: Extension,
    /// File to write with --view (.png, .svg, .pdf; flight also .gif, .apng) and for one figure file;
    /// otherwise a folder [default: <store> with the extension `figures`; out/figures for figure files].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Also read an unfinished render: values that are not rendered yet are NaN.
    #[arg(long)]
    partial: bool,
}

/// Default number of frames of a light-in-flight view.
const FRAMES: usize = 12;

#[derive(Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// Colour photograph of M00.
    Photo,
    /// 4×4 grid of Mueller images.
    Mueller,
    /// Camera scanline against projector column.
    SpaceSpace,
    /// Camera scanline against travel time.
    SpaceTime,
    /// Light in flight.
    Flight,
    /// Time profile of one pixel.
    Profile,
}

/// Scale of signed elements.
#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Scale {
    Linear,
    /// Shows small values.
    Arctan,
}

type Element = [usize; 2];

fn element(text: &str) -> Result<Element, String> {
    let digit = |i: usize| text.chars().nth(i).and_then(|c| c.to_digit(4)).map(|d| d as usize);
    match (digit(0), digit(1), text.len()) {
        (Some(i), Some(j), 2) => Ok([i, j]),
        _ => Err(format!("`{text}` is not a Mueller element; expected a row and a column, such as 00 or 23")),
    }
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    if a.of_files.is_meant(a.store.as_deref()) {
        let of_view =
            a.slice.is_some() || a.wavelength.is_some() || a.limit.is_some() || a.raw || !a.pixel.is_empty();
        let moved = a.element != [0, 0] || a.row != 0 || a.frames != FRAMES;
        let of_grid = a.scale != Scale::Linear || a.mask.is_some();
        if a.view.is_some() || a.partial || of_view || moved || of_grid {
            bail!(
                "--view, --slice, --wavelength, --element, --row, --pixel, --frames, --raw, --scale, --mask, --limit and --partial apply only to stores; \
                 set the view in the figure file"
            );
        }
        let further = a.names.iter().map(PathBuf::from);
        let files: Vec<PathBuf> = a.store.iter().cloned().chain(further).collect();
        return figure_file::run(&a.of_files, &files, a.output.as_deref(), a.format);
    }
    a.of_files.refuse()?;
    let store = a.store.clone().unwrap_or_default();
    let Some(kind) = a.view else {
        return draw_all(&store, Some(a));
    };
    let slice = a.slice.clone().unwrap_or_default();
    let scale = match a.scale {
        Scale::Linear => SignedScale::Linear,
        Scale::Arctan => SignedScale::Arctan,
    };
    let map =
        |slice: String| MapView { slice, wavelength_nm: a.wavelength, row: a.row, element: a.element, scale };
    let view = match kind {
        Kind::Photo => View::Photo(PhotoView { slice, white: a.limit }),
        Kind::Mueller => View::Mueller(MuellerView {
            slice,
            wavelength_nm: a.wavelength,
            time_ps: None,
            normalized: !a.raw,
            limit: a.limit,
            scale,
            mask_sigmas: a.mask,
        }),
        Kind::SpaceSpace => View::SpaceSpace(map(slice)),
        Kind::SpaceTime => View::SpaceTime(map(slice)),
        Kind::Flight => View::Flight(FlightView { slice, frames: a.frames }),
        Kind::Profile => View::Profile(ProfileView {
            slice,
            pixel: match a.pixel[..] {
                [x, y] => [x, y],
                _ => bail!("--view profile requires the option --pixel; pass --pixel X,Y"),
            },
            element: a.element,
        }),
    };
    let name = a.slice.clone().unwrap_or_default();
    let path = a.output.clone().unwrap_or_else(|| folder(&store).join(format!("{name}.png")));
    places::files([Some(&store)], [Some(&path)])?;
    let store = source::store(&store, a.partial)?;
    figures::draw_to(&store, &Figure { name, view }, &path)?;
    print_path(&path)
}

/// Returns the default folder for a store's figures. The folder is next to the store. For the URL of a store,
/// the folder is the current folder.
fn folder(store: &Path) -> PathBuf {
    let beside = store.with_extension("figures");
    match beside.file_name() {
        Some(name) if is_address(store) => PathBuf::from(name),
        _ => beside,
    }
}

/// Draws the figures that the scene of a store lists, and prints their paths. If the scene lists no figures,
/// draws default figures for the arguments of `sunstone figure`, and nothing for `None`.
pub fn draw_all(path: &Path, a: Option<&Arguments>) -> Result<(), Failure> {
    let out = a.and_then(|a| a.output.clone()).unwrap_or_else(|| folder(path));
    places::folders([Some(&path.to_owned())], [Some(&out)])?;
    places::outside_stores([&out])?;
    let store = source::store(path, a.is_some_and(|a| a.partial))?;
    let format = a.map_or("png", |a| a.format.name());
    let mut listed = figures::listed(&store, a.map_or(&[], |a| &a.names))?;
    if listed.is_empty() && a.is_some() {
        let defaults = figures::defaults(&store)?;
        for (slice, reason) in &defaults.left_out {
            eprintln!("note: slice `{slice}` has no default figure: {reason}; draw this slice with --view");
        }
        if defaults.figures.is_empty() {
            bail!(
                "{}: the scene lists no figures, and no slice has a default figure; draw a slice with --view",
                path.display()
            );
        }
        eprintln!("note: the scene lists no figures; these are default figures");
        listed = defaults.figures;
    }
    for figure in listed {
        let file = out.join(format!("{}.{format}", figure.name));
        figures::draw_to(&store, &figure, &file)?;
        print_path(&file)?;
    }
    Ok(())
}

/// Parses the path of a picture. The extension must be that of a known format.
pub fn picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    Format::of(&path).map_err(|e| e.to_string())?;
    Ok(path)
}

impl From<FigureError> for Failure {
    /// Converts a figure error. Errors of writing and encoding are failures, and all other errors are invalid
    /// input.
    fn from(e: FigureError) -> Self {
        match e {
            FigureError::Write { .. } | FigureError::Encode(_) => Self::failed(e),
            _ => Self::input(e),
        }
    }
}

impl From<FiguresError> for Failure {
    fn from(e: FiguresError) -> Self {
        match e {
            FiguresError::Figure(e) => e.into(),
            e => Self::input(e),
        }
    }
}
