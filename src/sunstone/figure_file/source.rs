//! Parses a figure file, and makes the checks that need neither scenes nor applications.

use base::document;
use base::locate::{InputError, Located};
use figure::composite::{
    Arrow, COLUMN_MM, Circle, Corner, Ink, Inset, MOST_COLUMNS, MOST_PANELS, WIDTHS_MM, check_crop,
};
use figure::{FigureError, Format};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::file::{ArrowFile, CircleFile, FigureFile, InsetFile, PanelFile, ViewFile};

/// Maximum length of an image's longer side in pixels.
const MOST_PIXELS: u32 = 8192;
/// Maximum number of samples per pixel.
const MOST_SAMPLES: u32 = 1 << 24;

/// An error message without a location, and the fix.
pub type Fault = (String, String);

/// A figure file with its text.
#[derive(Clone, Debug)]
pub struct Source {
    pub path: PathBuf,
    pub text: Arc<str>,
    /// Parsed contents of the file.
    pub file: FigureFile,
}

impl Source {
    /// Reads a figure file.
    ///
    /// # Errors
    /// Returns [`InputError`] at the location of an error, if the file cannot be read or is invalid.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let text = document::read(path, "figure file", "pass a figure file, or the store of a render")?;
        Self::of_text(path, &text)
    }

    /// Parses the text of a figure file. `path` names the file in messages.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::read`].
    pub fn of_text(path: &Path, text: &str) -> Result<Self, InputError> {
        let file: FigureFile = document::parse(path, text, |message| {
            if message.contains("unknown field") || message.contains("unknown variant") {
                "use one of the names listed; docs/figures.md describes figure files".to_owned()
            } else {
                "docs/figures.md describes figure files".to_owned()
            }
        })?;
        let source = Self { path: path.to_owned(), text: text.into(), file };
        source.check()?;
        Ok(source)
    }

    /// Checks that a path has the extension of a format for the figure.
    ///
    /// # Errors
    /// Returns [`FigureError::Extension`] if the extension is not that of a format, or that of a page for an
    /// animation, or that of an animation for a page.
    pub fn check_output(&self, path: &Path) -> Result<(), FigureError> {
        if self.file.animation { figure::check_animation(path) } else { Format::of(path).map(|_| ()) }
    }

    /// Returns an error at a location.
    pub fn error<T>(
        &self,
        at: &Located<T>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> InputError {
        InputError::new(&self.path, Arc::clone(&self.text), Some(at.span()), message, help)
    }

    /// Returns a function that adds a location to an error.
    pub(super) fn at<T>(&self, at: &Located<T>) -> impl Fn(Fault) -> InputError {
        move |(message, help)| self.error(at, message, help)
    }

    /// Returns the path of a file whose name is relative to the figure file.
    pub fn beside(&self, name: &str) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(name)
    }

    /// Returns the width of the figure in millimetres, or `None` if the width is invalid.
    pub fn width_mm(&self) -> Option<f64> {
        match self.file.width.as_str() {
            "single" => Some(COLUMN_MM[0]),
            "double" => Some(COLUMN_MM[1]),
            text => {
                let number = text.strip_suffix("mm")?.trim().parse().ok()?;
                (WIDTHS_MM[0]..=WIDTHS_MM[1]).contains(&number).then_some(number)
            }
        }
    }

    fn check(&self) -> Result<(), InputError> {
        let file = &self.file;
        if self.width_mm().is_none() {
            return Err(self.error(
                &file.width,
                format!("`{}` is not a valid figure width", *file.width),
                "set \"single\" (84 mm), \"double\" (178 mm), or a width from 30 to 400 mm, such as \"120 mm\"",
            ));
        }
        let columns = *file.columns;
        if !(1..=MOST_COLUMNS).contains(&columns) {
            let message = format!("`columns` is {columns}, outside the supported range");
            return Err(self.error(&file.columns, message, "set a value from 1 to 16"));
        }
        if file.column_headings.len() > columns {
            return Err(self.error(
                &file.columns,
                format!(
                    "`column_headings` has {} entries, but the figure has only {columns} columns",
                    file.column_headings.len()
                ),
                "set at most one heading per column",
            ));
        }
        if file.animation && file.panels.len() != 1 {
            let message =
                format!("an animation has one panel, but the figure file has {}", file.panels.len());
            let help = "keep one panel with `view.flight`, or remove `animation`";
            return Err(self.error(&file.columns, message, help));
        }
        for panel in &file.panels {
            if let (true, Some(at)) = (file.animation, &panel.view)
                && !matches!(**at, ViewFile::Flight(_))
            {
                let help = "use `view.flight`, or remove `animation`";
                return Err(self.error(at, "an animation shows light in flight", help));
            }
            if let Some(crop) = &panel.crop {
                check_crop(**crop).map_err(|e| self.error(crop, e.to_string(), "correct the crop"))?;
            }
        }
        for scene in file.scenes.values() {
            for size in [&scene.preview, &scene.full] {
                let bad = |at, message: String, most: u32| {
                    self.error(at, message, format!("set a value from 1 to {most}"))
                };
                if !(1..=MOST_PIXELS).contains(&*size.pixels) {
                    let message = format!(
                        "the camera has a width of {} pixels, which is outside the supported range",
                        *size.pixels
                    );
                    return Err(bad(&size.pixels, message, MOST_PIXELS));
                }
                if !(1..=MOST_SAMPLES).contains(&*size.spp) {
                    let message = format!(
                        "the number of samples per pixel is {}, which is outside the supported range",
                        *size.spp
                    );
                    return Err(bad(&size.spp, message, MOST_SAMPLES));
                }
            }
        }
        for entry in file.applications.values() {
            if !(1..=1000).contains(&entry.seeds) {
                return Err(self.error(entry, format!("{} seeds", entry.seeds), "set 1 to 1000"));
            }
        }
        let shown = file.panels.iter().filter(|p| p.view.is_some()).count();
        if shown == 0 || file.panels.len() > MOST_PANELS {
            let message =
                format!("the figure has {} panels, of which {shown} have a view", file.panels.len());
            let help = "add 1 to 200 [[panels]], and give at least one of them a view";
            return Err(InputError::new(&self.path, Arc::clone(&self.text), None, message, help));
        }
        file.panels.iter().try_for_each(|p| self.check_panel(p))
    }

    fn check_panel(&self, panel: &Located<PanelFile>) -> Result<(), InputError> {
        let columns = *self.file.columns;
        if let Some(span) = panel.span.as_ref().filter(|s| !(1..=columns).contains(&***s)) {
            return Err(self.error(
                span,
                format!("the panel spans {} columns, but the figure has {columns} columns", **span),
                "set `span` to a value from 1 to the number of columns",
            ));
        }
        if let Some(aspect) = panel.aspect.as_ref().filter(|a| !(0.05..=20.0).contains(&***a)) {
            return Err(self.error(
                aspect,
                format!("the aspect ratio is {}, outside the supported range", **aspect),
                "set a value from 0.05 to 20",
            ));
        }
        for inset in &panel.insets {
            self.inset(inset)?;
        }
        for arrow in &panel.arrows {
            self.arrow(arrow)?;
        }
        for circle in &panel.circles {
            self.circle(circle)?;
        }
        let Some(view) = &panel.view else { return Ok(()) };
        if let Some(bar) = &panel.scale_bar {
            if !(bar.length_mm > 0.0 && bar.length_mm.is_finite()) {
                let message = format!("the length of the scale bar is {} mm", bar.length_mm);
                return Err(self.error(bar, message, "set length_mm to a finite value above 0"));
            }
            if !bar.of.iter().all(|v| (0.0..=1.0).contains(v)) {
                let message =
                    format!("the point of the scale bar is {:?}, which is outside the image", bar.of);
                return Err(self.error(bar, message, "set of = [x, y] to fractions from 0 to 1"));
            }
            if view.application().is_some() {
                let help = "remove the scale bar: only views of a scene have a scale bar";
                return Err(self.error(
                    bar,
                    "a scale bar cannot be drawn, because the panel shows the image of an application",
                    help,
                ));
            }
        }
        match (view.application(), &panel.scene) {
            (Some(_), Some(scene)) => {
                let help = "remove `scene`: the application has its own scene";
                Err(self.error(scene, "`scene` is set, but the view shows an application", help))
            }
            (Some(_), None) => Ok(()),
            (None, None) => {
                let help = format!("add scene = \"…\", with one of: {}", self.scenes());
                Err(self.error(view, "this view draws a slice of a scene, but the panel has no scene", help))
            }
            (None, Some(scene)) if !self.file.scenes.contains_key(&**scene) => {
                let help = format!("use one of: {}", self.scenes());
                Err(self.error(scene, format!("unknown scene [scenes.{}]", **scene), help))
            }
            _ => Ok(()),
        }
    }

    fn scenes(&self) -> String {
        let names: Vec<&str> = self.file.scenes.keys().map(String::as_str).collect();
        names.join(", ")
    }

    fn ink<T>(&self, at: &Located<T>, name: &str) -> Result<Ink, InputError> {
        Ink::named(name).ok_or_else(|| {
            let help = format!("use one of: {}", Ink::names().join(", "));
            self.error(at, format!("unknown colour `{name}`"), help)
        })
    }

    /// Checks and converts an inset.
    ///
    /// # Errors
    /// Returns [`InputError`] at the location of the inset if it is invalid.
    pub fn inset(&self, at: &Located<InsetFile>) -> Result<Inset, InputError> {
        let corner = Corner::named(&at.at).ok_or_else(|| {
            let help = "use upper left, upper right, lower left or lower right";
            self.error(at, format!("unknown corner `{}`", at.at), help)
        })?;
        let inset = Inset { crop: at.crop, magnify: at.magnify, corner, ink: self.ink(at, &at.colour)? };
        inset.check().map_err(|e| self.error(at, e.to_string(), "correct the inset"))?;
        Ok(inset)
    }

    /// Checks and converts an arrow.
    ///
    /// # Errors
    /// Returns [`InputError`] at the location of the arrow if it is invalid.
    pub fn arrow(&self, at: &Located<ArrowFile>) -> Result<Arrow, InputError> {
        let arrow = Arrow { from: at.from, to: at.to, ink: self.ink(at, &at.colour)? };
        let near = |p: [f64; 2]| p.iter().all(|v| (-0.5..=1.5).contains(v));
        let refuse = |message: String| {
            let help = "set `from` and `to` to different points [x, y], in fractions of the image, 0 to 1";
            Err(self.error(at, message, help))
        };
        if !near(arrow.from) || !near(arrow.to) {
            let (from, to) = (arrow.from, arrow.to);
            return refuse(format!("an end of the arrow is far outside the image: from {from:?} to {to:?}"));
        }
        if arrow.from == arrow.to {
            return refuse(format!("the arrow has no length, because both ends are {:?}", arrow.to));
        }
        Ok(arrow)
    }

    /// Checks and converts a circle.
    ///
    /// # Errors
    /// Returns [`InputError`] at the location of the circle if it is invalid.
    pub fn circle(&self, at: &Located<CircleFile>) -> Result<Circle, InputError> {
        let circle = Circle { at: at.at, radius: at.radius, ink: self.ink(at, &at.colour)? };
        if !(0.0..=1.0).contains(&circle.at[0]) || !(0.0..=1.0).contains(&circle.at[1]) {
            let message = format!("the centre of the circle is outside the image: {:?}", circle.at);
            return Err(self.error(at, message, "set at = [x, y] to fractions of the image, 0 to 1"));
        }
        if !(circle.radius > 0.0 && circle.radius <= 1.0) {
            let message = format!("the radius of the circle is {}", circle.radius);
            return Err(self.error(at, message, "set radius to a fraction of the image's width, above 0"));
        }
        Ok(circle)
    }
}
