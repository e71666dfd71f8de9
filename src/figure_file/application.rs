//! Panels of applications: pictures of methods, with their scores.

use apply::application::{Application, Size};
use apply::catalog;
use base::locate::Located;
use figure::White;
use figure::tile::{self, Scale, Tile};
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use transport::render::schedule::Watch;

use super::caption::Value;
use super::file::{ApplyFile, ViewFile};
use super::kept::{Fit, Picture, Place};
use super::source::Source;
use super::stage::{FigureFileError, Settings, varied};
use crate::applications::{self, find_scenes};
use crate::studio::Studio;

/// Pictures whose method begins so are the truth, which no list of methods names.
const TRUTH: &str = "truth";

/// The applications of a figure.
pub struct Applications<'a> {
    source: &'a Source,
    settings: &'a Settings,
    watch: &'a dyn Watch,
    all: BTreeMap<&'a str, Run>,
}

struct Run {
    application: Box<dyn Application>,
    scenes: PathBuf,
    seeds: u64,
    fit: Option<Fit>,
    /// Renders that were made now.
    rendered: usize,
}

impl Run {
    fn size(&self, preview: bool) -> Size {
        let plan = self.application.plan();
        if preview { plan.preview } else { plan.full }
    }
}

impl<'a> Applications<'a> {
    /// Those that panels name, with all that can be checked of them before they are run.
    pub fn prepare(
        source: &'a Source,
        settings: &'a Settings,
        watch: &'a dyn Watch,
    ) -> Result<Self, FigureFileError> {
        let mut out = Self {
            source,
            settings,
            watch,
            all: BTreeMap::new(),
        };
        for (name, entry) in &source.file.applications {
            if catalog::find(name).is_none() {
                return Err(unknown(source, entry, name).into());
            }
        }
        for at in source.file.panels.iter().filter_map(|p| p.view.as_ref()) {
            let ViewFile::Apply(view) = &**at else { continue };
            out.find(at, view)?;
        }
        Ok(out)
    }

    fn find(&mut self, at: &Located<ViewFile>, view: &'a ApplyFile) -> Result<(), FigureFileError> {
        let source = self.source;
        let application = catalog::find(&view.name).ok_or_else(|| unknown(source, at, &view.name))?;
        let mut names: Vec<&str> = application.methods().iter().map(|m| m.name).collect();
        names.extend(application.drawn());
        if !view.method.starts_with(TRUTH) && !names.contains(&view.method.as_str()) {
            let message = format!("application `{}` has no method `{}`", view.name, view.method);
            let help = format!("name one of: {}", names.join("; "));
            return Err(source.error(at, message, help).into());
        }
        let plan = application.plan();
        if let Some(v) = view.variant.filter(|v| !plan.test.contains(v)) {
            let message = format!("application `{}` is not judged on variant {v}", view.name);
            let help = format!("name one of: {}", list(&plan.test));
            return Err(source.error(at, message, help).into());
        }
        if let Some([low, high]) = view
            .limits
            .filter(|[low, high]| !matches!(low.partial_cmp(high), Some(Ordering::Less)))
        {
            let message = format!("limits = [{low}, {high}] are no range");
            return Err(source
                .error(at, message, "give the smaller first, then the larger")
                .into());
        }
        if self.all.contains_key(view.name.as_str()) {
            return Ok(());
        }
        let folder = source.path.parent().unwrap_or(Path::new("."));
        let scenes = self
            .settings
            .scenes
            .clone()
            .or_else(|| find_scenes(folder, plan.scene))
            .or_else(|| find_scenes(&std::path::absolute(folder).ok()?, plan.scene))
            .or_else(|| find_scenes(&std::env::current_dir().ok()?, plan.scene))
            .filter(|s| s.join(plan.scene).is_file());
        let Some(scenes) = scenes else {
            let message = format!("there is no scenes/{} above the figure file", plan.scene);
            let help = "name the folder of the scenes that came with sunstone by --scenes";
            return Err(source.error(at, message, help).into());
        };
        let entry = source.file.applications.get(&view.name);
        let run = Run {
            application,
            scenes,
            seeds: entry.map_or(1, |e| e.seeds),
            fit: None,
            rendered: 0,
        };
        self.all.insert(&view.name, run);
        Ok(())
    }

    /// Runs them all, but for what is kept of the same inputs and the same program.
    pub fn run(&mut self) -> Result<(), FigureFileError> {
        let preview = self.settings.preview;
        for run in self.all.values_mut() {
            let settings = applications::Settings {
                scenes: run.scenes.clone(),
                renders: self.settings.renders.clone(),
                preview,
                seeds: run.seeds,
                links: applications::links::Links::default(),
            };
            let mut now = applications::Run::new(&*run.application, &settings, self.watch)?;
            let inputs = now.inputs()?;
            run.rendered = now.rendered();
            let Size { pixels, spp } = run.size(preview);
            let name = format!(
                "{}_{pixels}px_{spp}spp_{}seeds",
                run.application.name(),
                run.seeds
            );
            let program = self.settings.program.as_ref();
            let place = program.map(|p| Place::new(&settings.renders, &name, p, &inputs));
            if let Some(fit) = place.as_ref().and_then(Place::read) {
                run.fit = Some(fit);
                continue;
            }
            let mut fit = Fit::of(now.report()?);
            if let Some(place) = place {
                place.write(&mut fit);
            }
            run.fit = Some(fit);
        }
        Ok(())
    }

    /// Renders that were made now.
    pub fn rendered(&self) -> usize {
        self.all.values().map(|r| r.rendered).sum()
    }

    /// What a panel shows, and the values that its caption may name.
    pub fn tile(
        &self,
        at: &Located<ViewFile>,
        view: &ApplyFile,
    ) -> Result<(Tile, Vec<(String, Value)>), FigureFileError> {
        let source = self.source;
        let fault = |message: String, help: String| FigureFileError::Input(source.error(at, message, help));
        let Some((run, fit)) = self
            .all
            .get(view.name.as_str())
            .and_then(|r| Some((r, r.fit.as_ref()?)))
        else {
            return Err(fault(
                format!("application `{}` was not run", view.name),
                "run it again".into(),
            ));
        };
        let pictures = &fit.pictures;
        let is =
            |p: &&Picture| p.name == view.picture && p.method == view.method && p.variant == view.variant;
        let Some(picture) = pictures.iter().find(is) else {
            let mut known: Vec<String> = pictures.iter().map(named).collect();
            known.sort();
            known.dedup();
            return Err(fault(
                format!(
                    "application `{}` made no picture `{}` of `{}` for this variant",
                    view.name, view.picture, view.method
                ),
                format!("name one of: {}", known.join("; ")),
            ));
        };
        let tile = drawn(view, picture, &self.shared(view, picture, pictures))
            .map_err(|e| fault(e, "correct the view".into()))?;
        Ok((tile, self.values(view, run, fit)?))
    }

    /// The pictures that are drawn on one scale with this one: those of the figure that are of the same variant, if they have one unit.
    fn shared<'p>(&self, view: &ApplyFile, picture: &'p Picture, all: &'p [Picture]) -> Vec<&'p Picture> {
        if !picture.shared {
            return vec![picture];
        }
        let panels = &self.source.file.panels;
        let shown = |p: &&Picture| {
            panels.iter().filter_map(|p| p.view.as_ref()).any(|v| match &**v {
                ViewFile::Apply(v) => {
                    v.name == view.name
                        && v.picture == view.picture
                        && v.variant == view.variant
                        && (v.picture.as_str(), v.method.as_str(), v.variant)
                            == (&*p.name, &*p.method, p.variant)
                }
                _ => false,
            })
        };
        all.iter().filter(shown).collect()
    }

    fn values(
        &self,
        view: &ApplyFile,
        run: &Run,
        fit: &Fit,
    ) -> Result<Vec<(String, Value)>, FigureFileError> {
        let number = |name: String, v: f64| (name, Value::Number(v));
        let size = run.size(self.settings.preview);
        let mut out = vec![
            ("method".to_owned(), Value::Text(view.method.clone())),
            number("seed".into(), 1.0),
            number("seeds".into(), run.seeds as f64),
            number("pixels".into(), f64::from(size.pixels)),
            number("spp".into(), f64::from(size.spp)),
        ];
        for s in &fit.scores {
            if s.seed == 1 && s.method == view.method && Some(s.variant) == view.variant {
                out.push(number(s.metric.clone(), s.value));
            }
        }
        for row in fit.rows.iter().filter(|r| r.method == view.method) {
            out.push(number(format!("mean {}", row.metric), row.mean));
            out.push(number(format!("error {}", row.metric), row.error));
        }
        if let Some(v) = view.variant {
            out.push(number("variant".into(), v as f64));
            let path = run.scenes.join(run.application.plan().scene);
            let studio = Studio::open(&path, &self.settings.renders, self.watch)?;
            out.extend(varied(&studio.variant(Some(v))?));
        }
        Ok(out)
    }
}

fn unknown<T>(source: &Source, at: &Located<T>, name: &str) -> base::locate::InputError {
    let all = catalog::all();
    let known: Vec<&str> = all.iter().map(|a| a.name()).collect();
    let help = format!("name one of: {}", known.join(", "));
    source.error(at, format!("there is no application `{name}`"), help)
}

fn list(numbers: &[u64]) -> String {
    let all: Vec<String> = numbers.iter().map(u64::to_string).collect();
    all.join(", ")
}

fn named(p: &Picture) -> String {
    let variant = p.variant.map_or(String::new(), |v| format!(", variant {v}"));
    format!("{} of {}{variant}", p.name, p.method)
}

/// The channels of a picture that are shown: red, green and blue, or one.
enum Shown {
    Colour,
    One(usize),
}

fn drawn(view: &ApplyFile, picture: &Picture, shared: &[&Picture]) -> Result<Tile, String> {
    let [width, _, channels] = picture.shape;
    let channels = channels.max(1);
    let shown = match (view.channel, channels) {
        (Some(c), _) if c < channels => Shown::One(c),
        (Some(c), _) => {
            return Err(format!(
                "the picture has {channels} channels, from 0; there is no {c}"
            ));
        }
        (None, 1) => Shown::One(0),
        // Wavelengths rise: blue comes first.
        (None, 3) => Shown::Colour,
        (None, n) => return Err(format!("the picture has {n} channels; name one by `channel`")),
    };
    let title = named(picture);
    match shown {
        Shown::Colour => {
            let colours = |p: &Picture| -> Vec<[f32; 3]> {
                let pixels = p.data.chunks_exact(3);
                pixels.map(|c| [c[2], c[1], c[0]].map(|v| v as f32)).collect()
            };
            let all: Vec<f32> = shared.iter().flat_map(|p| colours(p)).flatten().collect();
            let white = match view.limits {
                Some([_, white]) => White::Value(white),
                None => tile::common_white(all.iter().copied()),
            };
            tile::of_colours(&title, width, colours(picture), white)
        }
        Shown::One(channel) => {
            let values = |p: &Picture| -> Vec<f32> {
                let pixels = p.data.chunks_exact(p.shape[2].max(1));
                pixels
                    .map(|c| c.get(channel).map_or(f32::NAN, |v| *v as f32))
                    .collect()
            };
            let all: Vec<f32> = shared.iter().flat_map(|p| values(p)).collect();
            let negative = all.iter().any(|v| *v < 0.0);
            let white = match view.limits {
                Some([_, high]) => White::Value(high),
                None => tile::common_white(all.iter().map(|v| v.abs())),
            };
            let most = white.value();
            let scale = match view.limits {
                Some([low, high]) if low == -high => Scale::Signed { limit: high },
                Some([low, high]) => Scale::Linear { low, high },
                None if negative => Scale::Signed { limit: most },
                None => Scale::Linear { low: 0.0, high: most },
            };
            let label = if view.label.is_empty() {
                &picture.name
            } else {
                &view.label
            };
            tile::of_values(label, width, &values(picture), scale).map(|t| t.with_white(white))
        }
    }
    .map_err(|e| e.to_string())
}
