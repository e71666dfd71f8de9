//! Draws figures from a figure file, which lists scenes, views, applications and a layout.
//!
//! [`Source::read`] reads the file. [`prepare`] checks the file against its scenes and applications
//! before any scene is rendered. [`Prepared::draw`] renders and draws the figure. Renders
//! ([`crate::studio`]) and results of applications are cached and reused.

mod application;
mod caption;
mod curves;
pub mod file;
mod kept;
mod source;
mod stage;
mod view;

pub use kept::program;
pub use source::Source;
pub use stage::{FigureFileError, Settings};

use apply::application::Size;
use base::locate::Located;
use figure::composite::{self, Composite, Part};
use figure::{Drawing, FigureError, White};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use transport::render::schedule::Watch;

use crate::cost::Cost;
use crate::studio::Studio;
use application::Applications;
use caption::Value;
use file::{PanelFile, SizeFile, ViewFile};
use stage::Stage;

/// A finished figure, with the number of renders.
#[derive(Clone, Debug)]
pub struct Made {
    /// The figure, or the frames of an animation.
    pub pages: Vec<Drawing>,
    animation: bool,
    /// Number of new renders, excluding cached renders.
    pub rendered: usize,
}

impl Made {
    /// Writes the figure in the format of the path's extension.
    ///
    /// # Errors
    /// Returns the same errors as [`figure::save`] and [`figure::save_animation`].
    pub fn save(&self, path: &Path) -> Result<(), FigureError> {
        match &self.pages[..] {
            [page] if !self.animation => figure::save(page, path),
            pages => figure::save_animation(pages, path),
        }
    }
}

/// A figure file that was checked against its scenes and applications.
pub struct Prepared<'a> {
    source: &'a Source,
    stages: BTreeMap<&'a str, Stage<'a>>,
    applications: Applications<'a>,
}

/// Checks a figure file against its scenes and applications, and renders nothing.
///
/// # Errors
/// Returns [`FigureFileError::Input`] at the location of a name that does not exist in the scenes and
/// applications. Returns [`FigureFileError::Studio`] if a scene itself is invalid.
pub fn prepare<'a>(
    source: &'a Source,
    settings: &'a Settings,
    watch: &'a dyn Watch,
) -> Result<Prepared<'a>, FigureFileError> {
    let mut stages = BTreeMap::new();
    for (name, entry) in &source.file.scenes {
        let path = source.beside(&entry.file);
        if !path.is_file() {
            let message = format!("the file {} does not exist", path.display());
            let help = "set the path of a scene file, relative to the figure file";
            return Err(source.error(&entry.file, message, help).into());
        }
        let of_scene = |p: &&Located<PanelFile>| p.scene.as_ref().is_some_and(|s| **s == *name);
        let panels: Vec<_> = source.file.panels.iter().filter(of_scene).collect();
        let slices: BTreeSet<&str> = panels.iter().filter_map(|p| p.view.as_ref()?.slice()).collect();
        let studio = Studio::open(&path, &settings.renders, watch)?;
        let variant = studio.variant(entry.variant)?;
        for view in panels.iter().filter_map(|p| p.view.as_ref()) {
            let known: Vec<&str> = variant.file.slices.iter().map(|s| s.name.as_str()).collect();
            if let Some(missing) = view.slice().filter(|s| !known.contains(s)) {
                let message = format!("scene `{name}` has no slice `{missing}`");
                let help = format!("use one of: {}", known.join(", "));
                return Err(source.error(view, message, help).into());
            }
        }
        let size = size(if settings.preview { &entry.preview } else { &entry.full });
        let slices: Vec<String> = slices.into_iter().map(str::to_owned).collect();
        let names: Vec<&str> = slices.iter().map(String::as_str).collect();
        let scene = studio.scene(&variant, size.pixels, &names)?;
        for panel in panels {
            view::check(panel, &scene).map_err(|e| match &panel.view {
                Some(at) => source
                    .error(at, e, "correct the view, or use a slice with the axes that the view requires")
                    .into(),
                None => FigureFileError::Figure(FigureError::Encode(e)),
            })?;
        }
        let stage = Stage {
            studio,
            variant,
            number: entry.variant,
            seed: entry.seed,
            denoise: entry.denoise,
            size,
            slices,
            scene,
            store: None,
        };
        stages.insert(name.as_str(), stage);
    }
    for panel in &source.file.panels {
        caption::check(&panel.caption).map_err(source.at(&panel.caption))?;
    }
    let applications = Applications::prepare(source, settings, watch)?;
    Ok(Prepared { source, stages, applications })
}

fn size(of: &SizeFile) -> Size {
    Size { pixels: *of.pixels, spp: *of.spp }
}

impl Prepared<'_> {
    /// Computes the renders and the results of applications that are not in the cache, and draws the figure.
    ///
    /// # Errors
    /// Returns [`FigureFileError`] if a render, an application or the drawing fails.
    pub fn draw(&mut self) -> Result<Made, FigureFileError> {
        let source = self.source;
        for stage in self.stages.values_mut() {
            stage.render()?;
        }
        self.applications.run()?;
        let parts: Result<Vec<_>, _> = source.file.panels.iter().map(|p| self.part(p)).collect();
        let figure = |parts| Composite {
            title: source.file.title.clone(),
            width_mm: source.width_mm().unwrap_or(composite::COLUMN_MM[1]),
            columns: *source.file.columns,
            column_headings: source.file.column_headings.clone(),
            row_headings: source.file.row_headings.clone(),
            letters: source.file.letters,
            parts,
        };
        let parts = parts?;
        let pages = match (&parts[..], source.file.animation) {
            ([Some(part)], true) => {
                let frame = |tile| composite::draw(&figure(vec![Some(Part { tile, ..part.clone() })]));
                part.tile.frames().into_iter().map(frame).collect::<Result<_, _>>()?
            }
            _ => vec![composite::draw(&figure(parts))?],
        };
        let rendered = self.stages.values().map(|s| s.studio.rendered()).sum::<usize>();
        let animation = source.file.animation;
        Ok(Made { pages, animation, rendered: rendered + self.applications.rendered() })
    }

    /// Returns the name and the cost of every new render of the file's scenes, and of every newly denoised
    /// store. Renders of applications are not included.
    pub fn costs(&self) -> Vec<(String, Cost)> {
        self.stages.values().flat_map(|s| s.studio.costs().iter().cloned()).collect()
    }

    fn part(&self, panel: &Located<PanelFile>) -> Result<Option<Part>, FigureFileError> {
        let source = self.source;
        let Some(at) = &panel.view else {
            return Ok(None);
        };
        let fault = |e: String| source.error(at, e, "correct the view, or use another slice");
        let stage = panel.scene.as_ref().and_then(|s| self.stages.get(s.as_str()));
        let (mut tile, mut values) = match (&**at, stage) {
            (ViewFile::Apply(view), _) => self.applications.tile(at, view)?,
            (ViewFile::Curves(view), _) => self.applications.chart(at, view)?,
            (view, Some(stage)) => (view::tile(view, stage, &fault)?, stage.values()),
            (_, None) => {
                return Err(
                    fault("this view draws a slice of a scene, but the panel has no scene".into()).into()
                );
            }
        };
        if let Some(white) = tile.white {
            let shown = match white {
                White::Value(v) => Value::Number(v.into()),
                White::Nothing => Value::Text("– (no positive values)".into()),
            };
            values.push(("white".into(), shown));
        }
        let caption = caption::fill(&panel.caption, &values).map_err(source.at(&panel.caption))?;
        if let (Some(aspect), Some(own)) = (&panel.aspect, &mut tile.aspect) {
            *own = **aspect;
        }
        tile.bar.take_if(|_| !panel.colour_bar);
        if let Some(inset) = panel.insets.first().filter(|_| tile.size().is_none()) {
            let help = "remove the inset, or use a view with one image, such as one Mueller element";
            let message = "an inset needs a view with one image, but this view has several or none";
            return Err(source.error(inset, message, help).into());
        }
        let insets: Result<_, _> = panel.insets.iter().map(|i| source.inset(i)).collect();
        let arrows: Result<_, _> = panel.arrows.iter().map(|a| source.arrow(a)).collect();
        let circles: Result<_, _> = panel.circles.iter().map(|c| source.circle(c)).collect();
        let mut scale_bar = match (&panel.scale_bar, stage) {
            (Some(bar), Some(stage)) => Some(view::scale_bar(bar, &stage.scene).map_err(source.at(bar))?),
            _ => None,
        };
        if let Some(crop) = &panel.crop {
            if !tile.crop(**crop) {
                let help = "remove the crop, or use a view of a camera image";
                return Err(source.error(crop, "a map, chart or sphere cannot be cropped", help).into());
            }
            if let Some(bar) = &mut scale_bar {
                bar.share /= crop[2];
            }
        }
        Ok(Some(Part {
            tile,
            span: panel.span.as_ref().map_or(1, |s| **s),
            caption,
            denoised: at.slice().zip(stage).is_some_and(|(slice, stage)| stage.is_denoised(slice)),
            insets: insets?,
            arrows: arrows?,
            circles: circles?,
            scale_bar,
        }))
    }
}
