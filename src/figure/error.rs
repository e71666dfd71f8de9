//! Defines the errors of drawing and saving figures.

#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// The slice does not resolve an axis of the view.
    #[error("slice `{slice}` has no {axis} axis; draw a slice that is defined with `{fix}`")]
    MissingAxis {
        slice: String,
        /// Name of the missing axis.
        axis: &'static str,
        /// The line of a slice definition that adds the missing axis.
        fix: &'static str,
    },
    #[error(
        "slice `{slice}` has no values, because axis `{axis}` is empty; keep at least one entry of this axis"
    )]
    Empty {
        slice: String,
        /// Name of the empty axis.
        axis: &'static str,
    },
    /// The values do not fill the axes, or an axis occurs twice.
    #[error(
        "slice `{slice}` is damaged: the slice has {found} values for axes {axes}; render the scene again"
    )]
    Damaged {
        slice: String,
        found: usize,
        /// Axes and their lengths.
        axes: String,
    },
    /// The index of a row or an element does not exist in the slice.
    #[error("slice `{slice}` has {len} {what}, so index {index} does not exist; use 0 to {}", len.saturating_sub(1))]
    Index {
        slice: String,
        /// Name of the indexed items.
        what: &'static str,
        index: usize,
        len: usize,
    },
    /// The slice does not have the wavelength of the view.
    #[error("slice `{slice}` has no wavelength {nm} nm; use a wavelength of the slice: {known} nm")]
    Wavelength {
        slice: String,
        nm: f64,
        /// Wavelengths of the slice.
        known: String,
    },
    #[error("slice `{slice}` has no standard errors, which the mask requires; draw the view without a mask")]
    NoErrors { slice: String },
    #[error("option `{option}` is {value}; the value must be {must}")]
    Option {
        option: &'static str,
        value: String,
        /// Description of valid values.
        must: &'static str,
    },
    /// The file extension does not name a known format.
    #[error("{path}: expected the extension {known}; change the extension")]
    Extension { path: String, known: &'static str },
    #[error("cannot encode the image: {0}; draw fewer or smaller panels")]
    Encode(String),
    #[error(
        "cannot write image {path}: {source}; check that the folder is writable and the disk is not full"
    )]
    Write { path: String, source: std::io::Error },
}

impl FigureError {
    pub(crate) fn option(option: &'static str, value: impl ToString, must: &'static str) -> Self {
        let value = value.to_string();
        Self::Option { option, value, must }
    }

    /// Returns the error for a wavelength that is not one of a slice's wavelengths, all in nanometres.
    pub fn wavelength(slice: &str, nm: f64, all: &[f64]) -> Self {
        // Two decimals distinguish wavelengths that differ by more than the tolerance.
        let known: Vec<String> = all.iter().map(|v| format!("{}", (v * 100.0).round() / 100.0)).collect();
        Self::Wavelength { slice: slice.to_owned(), nm, known: known.join(", ") }
    }

    /// Returns the error for an empty `axis` of a slice, or for an empty list of a figure's items. `title` is
    /// the name of the slice or the title of the figure.
    pub(crate) fn nothing(title: &str, axis: &'static str) -> Self {
        let slice = title.to_owned();
        Self::Empty { slice, axis }
    }
}
