//! Draws figures of a store. A figure is listed in the store's scene, or is any view of a slice of the store.

use std::path::Path;

use figure::spec::{Figure, View};
use figure::{Drawing, FigureError, Panel};
use store::denoised::is_denoised;
use store::zarr::{AccessError, OpenError, TensorStore};
use tensor::field::Field;

#[derive(Debug, thiserror::Error)]
pub enum FiguresError {
    #[error(transparent)]
    Slice(#[from] OpenError),
    #[error(transparent)]
    Read(#[from] AccessError),
    /// The slice cannot be drawn with this view, or the file cannot be written.
    #[error(transparent)]
    Figure(#[from] FigureError),
    /// The scene of the store does not list the figure.
    #[error("unknown figure `{name}`; the scene lists: {known}; use one of these, or use --view")]
    Unknown {
        name: String,
        /// Names of the listed figures.
        known: String,
    },
}

/// Returns the figures named in `names`, in the order in which the store's scene lists them. If `names` is
/// empty, returns all listed figures.
///
/// # Errors
/// Returns [`FiguresError::Unknown`] for the first name that is not listed.
pub fn listed(store: &TensorStore, names: &[String]) -> Result<Vec<Figure>, FiguresError> {
    let listed = store.attributes().get("figures").cloned().unwrap_or_default();
    let mut figures: Vec<Figure> = serde_json::from_value(listed).unwrap_or_default();
    if let Some(unknown) = names.iter().find(|n| !figures.iter().any(|f| f.name == **n)) {
        let known: Vec<&str> = figures.iter().map(|f| f.name.as_str()).collect();
        return Err(FiguresError::Unknown { name: unknown.clone(), known: known.join(", ") });
    }
    figures.retain(|f| names.is_empty() || names.contains(&f.name));
    Ok(figures)
}

/// Draws a figure of a store's slice. The title is the figure's name.
///
/// # Errors
/// Returns [`FiguresError::Slice`] or [`FiguresError::Read`] if the slice cannot be read. Returns
/// [`FiguresError::Figure`] if the slice cannot be drawn with this view.
pub fn draw(store: &TensorStore, figure: &Figure) -> Result<Drawing, FiguresError> {
    with_panel(store, figure, |title, panel| figure::draw(&figure.view, title, panel))
}

/// Draws a figure of a store's slice to a file in the format of its extension: `.png`, `.svg` or `.pdf`. A
/// view of light in flight can also be a `.gif` or `.apng` file. Creates missing folders.
///
/// # Errors
/// Returns the same errors as [`draw`], and [`FigureError::Extension`], [`FigureError::Encode`] or
/// [`FigureError::Write`] if the file cannot be written.
pub fn draw_to(store: &TensorStore, figure: &Figure, path: &Path) -> Result<(), FiguresError> {
    if let View::Flight(view) = &figure.view
        && figure::is_animation(path)
    {
        let frames = with_panel(store, figure, |title, panel| figure::animate(view, title, panel))?;
        return Ok(figure::save_animation(&frames, path)?);
    }
    // Check the extension before reading and drawing.
    figure::Format::of(path)?;
    Ok(figure::save(&draw(store, figure)?, path)?)
}

/// Reads the data that a figure draws, and passes it to a function.
fn with_panel<T>(
    store: &TensorStore,
    figure: &Figure,
    draw: impl FnOnce(&str, &Panel) -> Result<T, FigureError>,
) -> Result<T, FiguresError> {
    let mut title = figure.name.replace('_', " ");
    if is_denoised(store) {
        title += " (denoised)";
    }
    read(store, figure.view.slice(), figure.view.further_fields(), |panel| Ok(draw(&title, panel)?))
}

/// Reads the data of a slice: the mean, and those arrays in `further` that the slice has. The arrays can be
/// large.
pub(crate) fn read<T, E: From<OpenError> + From<AccessError>>(
    store: &TensorStore,
    slice: &str,
    further: &[Field],
    draw: impl FnOnce(&Panel) -> Result<T, E>,
) -> Result<T, E> {
    let slice = store.slice(slice)?;
    let mean = slice.read_all(Field::Mean)?;
    let of =
        |field| (further.contains(&field) && slice.has(field)).then(|| slice.read_all(field)).transpose();
    let (std_error, overflow) = (of(Field::StdError)?, of(Field::Overflow)?);
    draw(&Panel { mean: &mean, std_error: std_error.as_ref(), overflow: overflow.as_ref() })
}
