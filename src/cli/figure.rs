//! `sunstone figure`.

use super::failure::Failure;
use std::path::{Path, PathBuf};
use sunstone::figure::spec::{Figure, FlightView, MapView, MuellerView, PhotoView, ProfileView, View};
use sunstone::figure::{Panel, draw, save_png};
use sunstone::store::zarr::TensorStore;
use sunstone::tensor::field::Field;

/// Draw pictures of a store's slices as PNG.
///
/// Without --view, draws the figures that the scene file lists (all, or those named).
#[derive(clap::Args)]
pub struct Arguments {
    /// Store written by `render` or `merge`.
    store: PathBuf,
    /// Names of the scene's figures to draw [default: all].
    names: Vec<String>,
    /// Draw this instead.
    #[arg(long, requires = "slice")]
    view: Option<Kind>,
    /// Slice to draw.
    #[arg(long)]
    slice: Option<String>,
    /// Wavelength in nanometres (mueller, maps).
    #[arg(long)]
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
    #[arg(long, default_value_t = 12)]
    frames: usize,
    /// Do not divide Mueller elements by M00 (mueller).
    #[arg(long)]
    raw: bool,
    /// Value at the ends of the colour scale (mueller), or shown as white (photo).
    #[arg(long)]
    limit: Option<f32>,
    /// PNG file for --view, folder otherwise [default: <store> with the extension `figures`].
    #[arg(short, long)]
    output: Option<PathBuf>,
}

/// The kinds of picture.
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

type Element = [usize; 2];

fn element(text: &str) -> Result<Element, String> {
    let digit = |i: usize| {
        text.chars()
            .nth(i)
            .and_then(|c| c.to_digit(4))
            .map(|d| d as usize)
    };
    match (digit(0), digit(1), text.len()) {
        (Some(i), Some(j), 2) => Ok([i, j]),
        _ => Err(format!(
            "`{text}` is not a Mueller element; give row and column, such as 00 or 23"
        )),
    }
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let Some(kind) = a.view else {
        return draw_all(&a.store, Some(a));
    };
    let slice = a.slice.clone().unwrap_or_default();
    let map = |slice: String| MapView {
        slice,
        wavelength_nm: a.wavelength,
        row: a.row,
        element: a.element,
    };
    let view = match kind {
        Kind::Photo => View::Photo(PhotoView {
            slice,
            white: a.limit,
        }),
        Kind::Mueller => View::Mueller(MuellerView {
            slice,
            wavelength_nm: a.wavelength,
            normalized: !a.raw,
            limit: a.limit,
        }),
        Kind::SpaceSpace => View::SpaceSpace(map(slice)),
        Kind::SpaceTime => View::SpaceTime(map(slice)),
        Kind::Flight => View::Flight(FlightView {
            slice,
            frames: a.frames,
        }),
        Kind::Profile => View::Profile(ProfileView {
            slice,
            pixel: match a.pixel[..] {
                [x, y] => [x, y],
                _ => return Err(Failure::input("a profile needs --pixel X,Y")),
            },
            element: a.element,
        }),
    };
    let store = TensorStore::open(&a.store).map_err(Failure::input)?;
    let name = a.slice.clone().unwrap_or_default();
    let path = a
        .output
        .clone()
        .unwrap_or_else(|| folder(&a.store).join(format!("{name}.png")));
    one(&store, &Figure { name, view }, &path)?;
    super::print(&path.display().to_string())
}

/// Where the figures of a store go unless the user says otherwise.
fn folder(store: &Path) -> PathBuf {
    store.with_extension("figures")
}

/// Draws the figures that the scene lists, and prints where they are.
pub fn draw_all(path: &Path, a: Option<&Arguments>) -> Result<(), Failure> {
    let store = TensorStore::open(path).map_err(Failure::input)?;
    let listed = store.attributes().get("figures").cloned().unwrap_or_default();
    let figures: Vec<Figure> = serde_json::from_value(listed).unwrap_or_default();
    let names = a.map_or(&[][..], |a| &a.names);
    if let Some(unknown) = names.iter().find(|n| !figures.iter().any(|f| f.name == **n)) {
        let known: Vec<&str> = figures.iter().map(|f| f.name.as_str()).collect();
        return Err(Failure::input(format!(
            "the scene lists no figure `{unknown}`; it lists {}; or use --view",
            known.join(", ")
        )));
    }
    let out = a.and_then(|a| a.output.clone()).unwrap_or_else(|| folder(path));
    for figure in figures
        .iter()
        .filter(|f| names.is_empty() || names.contains(&f.name))
    {
        let file = out.join(format!("{}.png", figure.name));
        one(&store, figure, &file)?;
        super::print(&file.display().to_string())?;
    }
    Ok(())
}

fn one(store: &TensorStore, figure: &Figure, path: &Path) -> Result<(), Failure> {
    let slice = store.slice(figure.view.slice()).map_err(Failure::input)?;
    let read = |field| {
        if slice.has(field) {
            slice.read_all(field).map(Some).map_err(Failure::input)
        } else {
            Ok(None)
        }
    };
    let mean = slice.read_all(Field::Mean).map_err(Failure::input)?;
    // Only profiles draw errors and overflow; other slices may be large.
    let profile = matches!(figure.view, View::Profile(_));
    let std_error = if profile { read(Field::StdError)? } else { None };
    let overflow = if profile { read(Field::Overflow)? } else { None };
    let panel = Panel {
        mean: &mean,
        std_error: std_error.as_ref(),
        overflow: overflow.as_ref(),
    };
    let title = figure.name.replace('_', " ");
    let image = draw(&figure.view, &title, &panel).map_err(Failure::input)?;
    save(&image, path)
}

/// Writes a picture, in a new folder where there is none.
pub fn save(image: &image::RgbImage, path: &Path) -> Result<(), Failure> {
    if let Some(parent) = path.parent() {
        std::fs::create_dir_all(parent).map_err(Failure::failed)?;
    }
    save_png(image, path).map_err(Failure::failed)
}
