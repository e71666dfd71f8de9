//! The TOML syntax of scene files, material files and media files: types that are read from TOML and written
//! as TOML.
//!
//! Equality ignores locations: two values are equal if their contents are equal. Keys that a file
//! omits are also omitted when the file is written again.
//!
//! The syntax is a separate crate because serde's generated code for these types is large and does not need
//! optimization.

mod defaults;
pub mod device;
pub mod emitter;
pub mod instance;
pub mod material;
pub mod medium;
mod path;
pub mod plastic;
pub mod scene;
pub mod shape;
pub mod slice;
pub mod texture;
pub mod transform;
pub mod values;
pub mod variant;
pub mod vary;

use base::document;
use base::locate::InputError;
use std::path::Path;

/// A file type of this crate. This crate implements the trait, so that the deserialization code is compiled
/// only once.
pub trait Syntax: Sized {
    /// Parses the text of a file. `path` names the file in messages.
    ///
    /// # Errors
    /// Returns [`InputError`] with a location if the text is not valid TOML or does not match the syntax.
    fn read(path: &Path, text: &str) -> Result<Self, InputError>;
}

macro_rules! syntax {
    ($($file:ty),*) => {
        $(impl Syntax for $file {
            fn read(path: &Path, text: &str) -> Result<Self, InputError> {
                document::parse(path, text, fix)
            }
        })*
    };
}

syntax!(scene::SceneFile, material::MaterialSetFile, medium::MediumSetFile);

pub(crate) fn fix(message: &str) -> String {
    if message.contains("unknown field") || message.contains("unknown variant") {
        "use one of the listed names; `sunstone schema` prints all names".into()
    } else if message.contains("missing field") {
        "add the missing key; `sunstone schema` describes all keys".into()
    } else {
        "correct the value; `sunstone schema` describes all keys".into()
    }
}
