//! Views: which picture to draw of which slice. Plain data shared by scene files, stores and the command line.

use crate::check::check;
use base::document;
use base::locate::{InputError, Located};
use schemars::{JsonSchema, Schema};
use serde::{Deserialize, Serialize};
use std::path::Path;
use tensor::slice::Slice;

/// A named picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Figure {
    /// File stem of the picture.
    pub name: String,
    /// What to draw.
    pub view: View,
}

/// The `[[figures]]` of a scene file, all else left aside.
#[derive(Deserialize)]
struct Figures {
    #[serde(default)]
    figures: Vec<Located<Figure>>,
}

/// Reads the figures of a scene file from its text; `path` names it in messages, `slices` are those of the scene,
/// `nm` its wavelengths.
///
/// # Errors
/// [`InputError`] at the place of a figure that is no figure, cannot be drawn of the scene's slices, cannot name a file, or
/// has the name of another.
pub fn from_text(path: &Path, text: &str, slices: &[Slice], nm: &[f64]) -> Result<Vec<Figure>, InputError> {
    let file: Figures = document::parse(path, text, |_| {
        "`sunstone schema` describes figures under [[figures]]".to_owned()
    })?;
    let error = |figure: &Located<Figure>, message: String, help: String| InputError {
        file: path.to_owned(),
        text: text.into(),
        span: Some(figure.span()),
        message,
        help: Some(help),
    };
    for (i, figure) in file.figures.iter().enumerate() {
        let (name, slice) = (&figure.name, figure.view.slice());
        let Some(drawn) = slices.iter().find(|s| s.name == slice) else {
            let known: Vec<&str> = slices.iter().map(|s| s.name.as_str()).collect();
            return Err(error(
                figure,
                format!("figure `{name}` draws slice `{slice}`, which is not in the scene"),
                format!("name one of: {}", known.join(", ")),
            ));
        };
        if name.is_empty() || name.contains(['/', '\\']) {
            return Err(error(
                figure,
                format!("`{name}` cannot be a file name"),
                "use letters, digits, _ and -".to_owned(),
            ));
        }
        if file.figures[..i].iter().any(|f| f.name == *name) {
            return Err(error(
                figure,
                format!("a second figure `{name}`"),
                "rename one of them: figures are files".to_owned(),
            ));
        }
        check(&figure.view, drawn, nm).map_err(|e| {
            error(
                figure,
                format!("figure `{name}` cannot be drawn: {e}"),
                "correct the view, or what its slice keeps".to_owned(),
            )
        })?;
    }
    Ok(file.figures.iter().map(|f| (**f).clone()).collect())
}

/// Puts the syntax of figures into the schema of scene files, which leaves it open.
pub fn describe_in(scene: &mut Schema) {
    let mut figure = schemars::schema_for!(Figure).to_value();
    let Some(figure) = figure.as_object_mut() else {
        return;
    };
    figure.remove("$schema");
    let shared = figure.remove("$defs");
    let Some(scene) = scene.as_object_mut() else {
        return;
    };
    if let Some(items) = scene
        .get_mut("properties")
        .and_then(|p| p.get_mut("figures"))
        .and_then(|f| f.get_mut("items"))
    {
        *items = serde_json::json!({ "$ref": "#/$defs/Figure" });
    }
    if let Some(all) = scene.get_mut("$defs").and_then(serde_json::Value::as_object_mut) {
        all.insert("Figure".to_owned(), serde_json::Value::Object(figure.clone()));
        if let Some(serde_json::Value::Object(shared)) = shared {
            all.extend(shared);
        }
    }
}

/// What to draw of a slice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum View {
    /// Colour photograph of M00 (time, bounces and components summed).
    Photo(PhotoView),
    /// 4×4 grid of signed images of the Mueller elements at one wavelength.
    Mueller(MuellerView),
    /// s–s' map: camera scanline against projector column (or row).
    SpaceSpace(MapView),
    /// x–t map: camera scanline against travel time.
    SpaceTime(MapView),
    /// Light in flight: a contact sheet of frames of a time-resolved image.
    Flight(FlightView),
    /// Time profile of one camera pixel with its error band.
    Profile(ProfileView),
}

impl View {
    /// Name of the slice that is drawn.
    #[must_use]
    pub fn slice(&self) -> &str {
        match self {
            Self::Photo(v) => &v.slice,
            Self::Mueller(v) => &v.slice,
            Self::SpaceSpace(v) | Self::SpaceTime(v) => &v.slice,
            Self::Flight(v) => &v.slice,
            Self::Profile(v) => &v.slice,
        }
    }
}

/// See [`View::Photo`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhotoView {
    /// Slice to draw.
    pub slice: String,
    /// Camera value shown as white; absent: the 99th percentile.
    pub white: Option<f32>,
}

/// See [`View::Mueller`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MuellerView {
    /// Slice to draw (polarization `mueller`).
    pub slice: String,
    /// Wavelength to draw (nearest); absent: the middle one.
    pub wavelength_nm: Option<f64>,
    /// Divide every element by M00 of its pixel (M00 itself is shown as it is, scaled to its 99th percentile).
    #[serde(default = "yes")]
    pub normalized: bool,
    /// Value at the ends of the symmetric colour scale; absent: 1 if normalized, else the 99th percentile of |M|.
    pub limit: Option<f32>,
}

/// See [`View::SpaceSpace`] and [`View::SpaceTime`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MapView {
    /// Slice to draw.
    pub slice: String,
    /// Wavelength to draw (nearest); absent: colour from all wavelengths for M00, the middle one for other elements.
    pub wavelength_nm: Option<f64>,
    /// Index into the slice's camera rows (0: its first row); drawn along x.
    #[serde(default)]
    pub row: usize,
    /// Mueller element [out, in] to draw; other than [0, 0] it is drawn signed and normalized by M00.
    #[serde(default)]
    pub element: [usize; 2],
}

/// See [`View::Flight`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlightView {
    /// Slice to draw (camera pixels and time bins resolved).
    pub slice: String,
    /// Number of frames, spread evenly over the bins that hold light.
    #[serde(default = "twelve")]
    pub frames: usize,
}

/// See [`View::Profile`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProfileView {
    /// Slice to draw (time bins resolved).
    pub slice: String,
    /// Camera pixel [x, y] in full-resolution pixels (nearest kept pixel).
    pub pixel: [f64; 2],
    /// Mueller element [out, in].
    #[serde(default)]
    pub element: [usize; 2],
}

fn yes() -> bool {
    true
}

fn twelve() -> usize {
    12
}
