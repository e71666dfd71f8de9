//! Reads the figures of a scene file, and checks the figures against the slices of the scene.

use crate::check::check;
use crate::spec::Figure;
use base::document;
use base::locate::{InputError, Located};
use serde::Deserialize;
use std::path::Path;
use tensor::slice::Slice;

/// The table `[[figures]]` of a scene file. Other tables are ignored.
#[derive(Deserialize)]
struct Figures {
    #[serde(default)]
    figures: Vec<Located<Figure>>,
}

/// Reads the figures of a scene file from the file's text. `path` names the file in messages. `slices` and
/// `nm` are the scene's slices and wavelengths, in nanometres.
///
/// # Errors
/// [`InputError`] at the location of a figure in the following cases:
/// - The figure is malformed or does not fit the scene's slices.
/// - The name of the figure is a duplicate or not a valid file name.
pub fn from_text(path: &Path, text: &str, slices: &[Slice], nm: &[f64]) -> Result<Vec<Figure>, InputError> {
    let file: Figures =
        document::parse(path, text, |_| "`sunstone schema` describes figures under [[figures]]".to_owned())?;
    let error = |figure: &Located<Figure>, message: String, help: String| {
        InputError::new(path, text, Some(figure.span()), message, help)
    };
    for (i, figure) in file.figures.iter().enumerate() {
        let (name, slice) = (&figure.name, figure.view.slice());
        let Some(drawn) = slices.iter().find(|s| s.name == slice) else {
            let known: Vec<&str> = slices.iter().map(|s| s.name.as_str()).collect();
            return Err(error(
                figure,
                format!("figure `{name}` draws slice `{slice}`, which the scene does not have"),
                format!("use one of: {}", known.join(", ")),
            ));
        };
        if name.is_empty() || name.contains(['/', '\\']) {
            return Err(error(
                figure,
                format!("`{name}` is not a valid file name"),
                "use letters, digits, _ and -".to_owned(),
            ));
        }
        if file.figures[..i].iter().any(|f| f.name == *name) {
            return Err(error(
                figure,
                format!("duplicate figure `{name}`"),
                "rename one of the figures: each figure is a file".to_owned(),
            ));
        }
        check(&figure.view, drawn, nm).map_err(|e| {
            error(
                figure,
                format!("cannot draw figure `{name}`: {e}"),
                "correct the view, or use a slice with the axes that the view requires".to_owned(),
            )
        })?;
    }
    Ok(file.figures.iter().map(|f| (**f).clone()).collect())
}
