//! A scene of a figure, and what goes wrong on the way to the figure.

use apply::application::Size;
use base::locate::InputError;
use figure::FigureError;
use scene::syntax::variant::Variant;
use std::path::PathBuf;
use store::zarr::{AccessError, OpenError, TensorStore};
use transport::scene::Scene;

use super::caption::Value;
use crate::applications::ApplicationError;
use crate::studio::{Studio, StudioError};

/// Where to and how to run.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Folder of renders.
    pub renders: PathBuf,
    /// Folder of the scenes of applications; without one, `scenes` in a folder above the figure file or the current one.
    pub scenes: Option<PathBuf>,
    /// At preview size, else at full size.
    pub preview: bool,
    /// What tells this program from others ([`super::program`]): what applications made of renders is kept beside these for it. Without
    /// one methods are fitted each time.
    pub program: Option<String>,
}

/// Why there is no figure.
#[derive(Debug, thiserror::Error)]
pub enum FigureFileError {
    /// The figure file is wrong.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A scene is wrong, or a render of it stopped.
    #[error(transparent)]
    Studio(#[from] StudioError),
    /// An application was not run.
    #[error(transparent)]
    Application(#[from] ApplicationError),
    /// A slice is not there.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A slice cannot be read.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The figure cannot be drawn.
    #[error(transparent)]
    Figure(#[from] FigureError),
}

/// A scene of the figure.
pub struct Stage<'a> {
    pub studio: Studio<'a>,
    pub variant: Variant,
    pub number: Option<u64>,
    pub seed: u64,
    pub size: Size,
    /// Slices that panels show.
    pub slices: Vec<String>,
    pub scene: Scene,
    pub store: Option<TensorStore>,
}

impl Stage<'_> {
    /// Values that captions may name.
    pub fn values(&self) -> Vec<(String, Value)> {
        let number = |name: &str, v: f64| (name.to_owned(), Value::Number(v));
        let mut out = vec![
            number("seed", self.seed as f64),
            number("pixels", f64::from(self.size.pixels)),
            number("spp", f64::from(self.size.spp)),
        ];
        out.extend(self.number.map(|n| number("variant", n as f64)));
        out.extend(varied(&self.variant));
        out
    }
}

/// Values of a variant's parameters.
pub fn varied(variant: &Variant) -> impl Iterator<Item = (String, Value)> {
    variant.values.iter().map(|(name, v)| {
        let number = v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
        let value = match (number, v.as_str()) {
            (Some(v), _) => Value::Number(v),
            (None, Some(text)) => Value::Text(text.to_owned()),
            (None, None) => Value::Text(v.to_string()),
        };
        (format!("vary {name}"), value)
    })
}
