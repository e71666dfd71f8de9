//! Draws figures of a store. A figure is listed in the store's scene, or is any view of a slice of the store.

use std::path::Path;

use figure::spec::{Figure, View};
use figure::{Drawing, FigureError, Panel};
use store::denoised::is_denoised;
use store::zarr::{AccessError, OpenError, TensorStore};
use tensor::array::Tensor;
use tensor::axes::AxisKind;
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
    /// The scene of the store does not list the figure, and the figure is not a default figure.
    #[error("unknown figure `{name}`; {known}; use one of these, or use --view")]
    Unknown {
        name: String,
        /// Text with the names of the listed figures and of the default figures.
        known: String,
    },
}

/// Figures of a store's slices that the scene does not list. The axes of the slices determine the figures.
#[derive(Clone, Debug, Default)]
pub struct Defaults {
    /// The figures, in the order of the slices.
    pub figures: Vec<Figure>,
    /// Slices without figures, each with the reason.
    pub left_out: Vec<(String, String)>,
}

/// Maximum number of values of a slice for which there are default figures. Drawing reads the whole slice into
/// memory: 2²⁸ values are 1 GiB.
const MOST_VALUES: u64 = 1 << 28;

/// Returns the default figures of all slices of a store, as [`figure::defaults::figures`] chooses them. A time
/// profile shows the pixel at the 99th percentile of M00, so that a single outlier is not selected.
///
/// # Errors
/// Returns [`FiguresError::Slice`] or [`FiguresError::Read`] if a slice cannot be read.
pub fn defaults(store: &TensorStore) -> Result<Defaults, FiguresError> {
    let mut all = Defaults::default();
    for name in store.slice_names() {
        let slice = store.slice(name)?;
        let layout = slice.layout();
        let values: u64 = layout.shape().iter().product();
        if values > MOST_VALUES {
            let reason = format!("it has {values} values, and default figures have at most {MOST_VALUES}");
            all.left_out.push((name.clone(), reason));
            continue;
        }
        let has_errors = slice.has(Field::StdError);
        let mut figures = figure::defaults::figures(name, &layout.axes, has_errors, [0.0; 2]);
        for figure in &mut figures {
            if let View::Profile(view) = &mut figure.view {
                view.pixel = bright_pixel(slice.read_all(Field::Mean)?);
            }
        }
        if figures.is_empty() {
            all.left_out.push((name.clone(), "it has no camera columns, or no camera rows".to_owned()));
        }
        all.figures.extend(figures);
    }
    Ok(all)
}

/// Returns the camera pixel [x, y] at the 99th percentile of M00, summed over all other axes. Pixels whose M00
/// is not finite are ignored.
fn bright_pixel(mean: Tensor) -> [f64; 2] {
    let mut image = mean;
    for (kind, select) in [(AxisKind::StokesOut, true), (AxisKind::StokesIn, true)]
        .into_iter()
        .chain(image.axes.clone().into_iter().map(|a| (a.kind, false)))
    {
        let is_pixel = matches!(kind, AxisKind::X | AxisKind::Y);
        if !is_pixel && image.find(kind).is_some() {
            image = if select { image.select(kind, 0) } else { image.sum(kind) };
        }
    }
    let mut order: Vec<usize> = (0..image.data.len()).filter(|&i| image.data[i].is_finite()).collect();
    order.sort_by(|&a, &b| image.data[a].total_cmp(&image.data[b]));
    let rank = (order.len().saturating_sub(1) as f64 * 0.99).round() as usize;
    let mut at = order.get(rank).copied().unwrap_or(0);
    let mut pixel = [0.0; 2];
    for axis in image.axes.iter().rev() {
        let n = axis.coords.len().max(1);
        let place = axis.coords.get(at % n).copied().unwrap_or(0.0);
        pixel[usize::from(axis.kind == AxisKind::Y)] = place;
        at /= n;
    }
    pixel
}

/// Returns the figures named in `names`, in the order in which the store's scene lists them, followed by the
/// named default figures. If `names` is empty, returns all listed figures.
///
/// # Errors
/// Returns [`FiguresError::Unknown`] for the first name that is neither listed nor the name of a default
/// figure. Returns the errors of [`defaults`] if a name is not listed.
pub fn listed(store: &TensorStore, names: &[String]) -> Result<Vec<Figure>, FiguresError> {
    let listed = store.attributes().get("figures").cloned().unwrap_or_default();
    let mut figures: Vec<Figure> = serde_json::from_value(listed).unwrap_or_default();
    if names.iter().any(|n| !figures.iter().any(|f| f.name == **n)) {
        let of_scene = list(&figures);
        let more = defaults(store)?.figures;
        let of_defaults = list(&more);
        for figure in more {
            if !figures.iter().any(|f| f.name == figure.name) {
                figures.push(figure);
            }
        }
        if let Some(unknown) = names.iter().find(|n| !figures.iter().any(|f| f.name == **n)) {
            let known = match (of_scene, of_defaults) {
                (None, None) => "no slice of the store can be drawn by default".to_owned(),
                (Some(scene), None) => format!("the scene lists: {scene}"),
                (None, Some(defaults)) => {
                    format!("the scene lists no figures, and the default figures are: {defaults}")
                }
                (Some(scene), Some(defaults)) => {
                    format!("the scene lists: {scene}; the default figures are: {defaults}")
                }
            };
            return Err(FiguresError::Unknown { name: unknown.clone(), known });
        }
    }
    figures.retain(|f| names.is_empty() || names.contains(&f.name));
    Ok(figures)
}

/// Returns the names of figures, or `None` if there is no figure.
fn list(figures: &[Figure]) -> Option<String> {
    let names: Vec<&str> = figures.iter().map(|f| f.name.as_str()).collect();
    (!names.is_empty()).then(|| names.join(", "))
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
