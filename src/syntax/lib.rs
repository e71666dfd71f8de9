//! The syntax of scene files, files of materials and files of media: values that TOML gives and that become TOML again.
//!
//! Two values are equal if they say the same, wherever in a file they stand. What is left out of a file is left out again.
//!
//! A crate of its own, because reading and writing them makes more machine code than all else in scenes, and needs none of
//! it to be fast.

#![warn(missing_docs)]

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

/// Values that a TOML file gives, read here and not where they are used, so that their code is made once.
pub trait Syntax: Sized {
    /// Reads the text of a file; `path` names it in messages.
    ///
    /// # Errors
    /// [`InputError`] at the place where the text is not TOML, or not of this syntax.
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
