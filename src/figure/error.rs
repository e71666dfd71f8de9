//! Why a picture was not drawn, and the fix.

/// What a wavelength to draw must be.
pub(crate) const WAVELENGTH: &str = "within the slice's wavelengths, in nanometres";

/// Why a picture was not drawn.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// The slice does not resolve what the picture shows.
    #[error("slice `{slice}` has no {axis} axis; draw a slice with `{fix}`")]
    MissingAxis {
        /// Name of the slice.
        slice: String,
        /// The missing axis in words.
        axis: &'static str,
        /// The line of a slice that adds the axis.
        fix: &'static str,
    },
    /// An axis of the slice has no entries.
    #[error("slice `{slice}` has no values: its axis `{axis}` is empty; keep at least one entry")]
    Empty {
        /// Name of the slice.
        slice: String,
        /// Name of the empty axis.
        axis: &'static str,
    },
    /// The values do not fill the axes, or an axis is there twice.
    #[error("slice `{slice}` is damaged: {found} values for axes {axes}; render it again")]
    Damaged {
        /// Name of the slice.
        slice: String,
        /// Number of values.
        found: usize,
        /// Axes and their lengths.
        axes: String,
    },
    /// A row or element that the slice does not have.
    #[error("slice `{slice}` has {len} {what}, so index {index} does not exist; use 0 to {}", len.saturating_sub(1))]
    Index {
        /// Name of the slice.
        slice: String,
        /// What is counted.
        what: &'static str,
        /// The index asked for.
        index: usize,
        /// How many there are.
        len: usize,
    },
    /// An option of the view that cannot be drawn.
    #[error("option `{option}` of the view is {value}; it must be {must}")]
    Option {
        /// Name of the option.
        option: &'static str,
        /// Its value.
        value: String,
        /// What it must be.
        must: &'static str,
    },
    /// The path does not say how to write the picture.
    #[error("{path}: expected the extension {known}; change the extension")]
    Extension {
        /// Where it should have gone.
        path: String,
        /// Extensions that name a format.
        known: &'static str,
    },
    /// The picture could not be encoded.
    #[error("cannot encode the picture: {0}; draw fewer or smaller panels")]
    Encode(String),
    /// The picture could not be written.
    #[error("cannot write picture {path}: {source}")]
    Write {
        /// Where it should have gone.
        path: String,
        /// Why not.
        source: std::io::Error,
    },
}

impl FigureError {
    pub(crate) fn option(option: &'static str, value: impl ToString, must: &'static str) -> Self {
        let value = value.to_string();
        Self::Option { option, value, must }
    }

    /// There is nothing to draw under a title.
    pub(crate) fn nothing(title: &str, axis: &'static str) -> Self {
        let slice = title.to_owned();
        Self::Empty { slice, axis }
    }
}
