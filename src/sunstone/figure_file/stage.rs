//! Defines the scenes of a figure, the settings of a run, and the errors of figure files.

use apply::application::Size;
use base::locate::InputError;
use figure::FigureError;
use scene::syntax::variant::Variant;
use serde_json::Value as Json;
use std::path::PathBuf;
use store::denoised::ATTRIBUTE;
use store::zarr::{AccessError, OpenError, TensorStore};
use transport::scene::Scene;

use super::caption::Value;
use crate::applications::ApplicationError;
use crate::studio::{Studio, StudioError};

/// Folders and settings of a run.
#[derive(Clone, Debug)]
pub struct Settings {
    pub renders: PathBuf,
    /// Folder of the applications' scenes. Default: `scenes` in a parent folder of the figure file or of the
    /// current folder.
    pub scenes: Option<PathBuf>,
    /// Whether to render at preview size instead of full size.
    pub preview: bool,
    /// Digest of this program ([`super::program`]) for the cache of application results. If `None`,
    /// methods are fitted in every run.
    pub program: Option<String>,
}

#[derive(Debug, thiserror::Error)]
pub enum FigureFileError {
    /// The figure file is invalid.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A scene is invalid, or its render stopped.
    #[error(transparent)]
    Studio(#[from] StudioError),
    #[error(transparent)]
    Application(#[from] ApplicationError),
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error(transparent)]
    Figure(#[from] FigureError),
}

pub struct Stage<'a> {
    pub studio: Studio<'a>,
    pub variant: Variant,
    pub number: Option<u64>,
    pub seed: u64,
    pub denoise: bool,
    pub size: Size,
    pub slices: Vec<String>,
    pub scene: Scene,
    pub store: Option<TensorStore>,
}

impl Stage<'_> {
    /// Renders the slices, and denoises the renders if requested. Does nothing without slices, because layers
    /// do not need a render.
    ///
    /// # Errors
    /// Returns the errors of [`Studio::render`] and [`Studio::denoised`].
    pub fn render(&mut self) -> Result<(), StudioError> {
        let names: Vec<&str> = self.slices.iter().map(String::as_str).collect();
        if names.is_empty() {
            return Ok(());
        }
        let make = if self.denoise { Studio::denoised } else { Studio::render };
        self.store = Some(make(&mut self.studio, self.number, &self.variant, self.seed, self.size, &names)?);
        Ok(())
    }

    /// Returns whether a slice of the stage's store was denoised, and not only copied.
    pub fn is_denoised(&self, slice: &str) -> bool {
        let mark = self.store.as_ref().and_then(|store| store.attributes().remove(ATTRIBUTE));
        let copied = |mark: &Json| {
            let list = mark.get("copied").and_then(Json::as_array);
            list.is_some_and(|all| all.iter().any(|name| name.as_str() == Some(slice)))
        };
        mark.is_some_and(|mark| !copied(&mark))
    }

    /// Returns the values for captions.
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

/// Returns the values of a variant's parameters.
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
