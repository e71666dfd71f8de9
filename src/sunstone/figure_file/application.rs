//! Creates panels of applications, which are images of methods with scores. [`super::curves`] draws charts of
//! scores.

use apply::application::{Application, Size};
use apply::catalog;
use base::locate::Located;
use figure::White;
use figure::spec::SignedScale;
use figure::tile::{self, Scale, Tile};
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use transport::render::schedule::Watch;

use super::caption::Value;
use super::curves;
use super::file::{ApplyFile, CurvesFile, ScaleFile, ViewFile};
use super::kept::{self, Fit, Picture, Place};
use super::source::Source;
use super::stage::{FigureFileError, Settings, varied};
use crate::applications::links::{Links, LinksError};
use crate::applications::{self, ApplicationError, find_scenes};
use crate::studio::Studio;

/// Prefix of the method name of ground-truth images. Lists of methods do not include ground truth.
const TRUTH: &str = "truth";

pub struct Applications<'a> {
    source: &'a Source,
    settings: &'a Settings,
    watch: &'a dyn Watch,
    all: BTreeMap<(&'a str, String), Run<'a>>,
}

struct Run<'a> {
    /// The first panel that shows the application.
    at: &'a Located<ViewFile>,
    application: Application,
    scenes: PathBuf,
    seeds: u64,
    links: Links,
    fit: Option<Fit>,
    /// Number of new renders up to now.
    rendered: usize,
}

impl Run<'_> {
    fn size(&self, preview: bool) -> Size {
        let plan = &self.application.plan;
        if preview { plan.preview } else { plan.full }
    }
}

impl<'a> Applications<'a> {
    /// Collects the applications that panels name, and checks them without running them.
    pub fn prepare(
        source: &'a Source,
        settings: &'a Settings,
        watch: &'a dyn Watch,
    ) -> Result<Self, FigureFileError> {
        let mut out = Self { source, settings, watch, all: BTreeMap::new() };
        for (name, entry) in &source.file.applications {
            if catalog::find(name).is_none() {
                return Err(unknown(source, entry, name).into());
            }
        }
        for at in source.file.panels.iter().filter_map(|p| p.view.as_ref()) {
            match &**at {
                ViewFile::Apply(view) => out.picture(at, view)?,
                ViewFile::Curves(view) => out.curves(at, view)?,
                _ => {}
            }
        }
        Ok(out)
    }

    fn curves(&mut self, at: &'a Located<ViewFile>, view: &'a CurvesFile) -> Result<(), FigureFileError> {
        let source = self.source;
        let application = catalog::find(&view.name).ok_or_else(|| unknown(source, at, &view.name))?;
        let chain = source.beside(&view.chain);
        let links = curves::links(view, &chain, &application).map_err(source.at(at))?;
        let key = (view.name.as_str(), curves::words(view));
        self.add(at, key, application, links)
    }

    fn picture(&mut self, at: &'a Located<ViewFile>, view: &'a ApplyFile) -> Result<(), FigureFileError> {
        let source = self.source;
        let application = catalog::find(&view.name).ok_or_else(|| unknown(source, at, &view.name))?;
        let mut names: Vec<&str> = application.methods.iter().map(|m| m.name).collect();
        names.extend(&application.drawn);
        if !view.method.starts_with(TRUTH) && !names.contains(&view.method.as_str()) {
            let message = format!("application `{}` has no method `{}`", view.name, view.method);
            let help = format!("use one of: {}", names.join("; "));
            return Err(source.error(at, message, help).into());
        }
        let plan = &application.plan;
        if let Some(v) = view.variant.filter(|v| !plan.test.contains(v)) {
            let message = format!("variant {v} is not a test variant of application `{}`", view.name);
            let help = format!("use one of: {}", list(&plan.test));
            return Err(source.error(at, message, help).into());
        }
        if view.scale == ScaleFile::Log && view.limits.is_none_or(|[low, _]| low <= 0.0) {
            let message = "a logarithmic scale has no positive limits".to_owned();
            return Err(source.error(at, message, "set limits = [low, high], both above 0").into());
        }
        if let Some([low, high]) =
            view.limits.filter(|[low, high]| !matches!(low.partial_cmp(high), Some(Ordering::Less)))
        {
            let message = format!(
                "limits = [{low}, {high}] is not a valid range, because the first limit is not smaller than the second"
            );
            return Err(source.error(at, message, "write the smaller limit first").into());
        }
        self.add(at, (&view.name, String::new()), application, Links::None)
    }

    /// Adds a run under the name of the application and the description of its links, unless this run exists.
    fn add(
        &mut self,
        at: &'a Located<ViewFile>,
        key: (&'a str, String),
        application: Application,
        links: Links,
    ) -> Result<(), FigureFileError> {
        if self.all.contains_key(&key) {
            return Ok(());
        }
        let (source, plan) = (self.source, &application.plan);
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
            let message = format!("scenes/{} not found in the parent folders of the figure file", plan.scene);
            let help = "set --scenes to the folder of the scenes shipped with Sunstone";
            return Err(source.error(at, message, help).into());
        };
        let entry = source.file.applications.get(key.0);
        let run = Run {
            at,
            application,
            scenes,
            seeds: entry.map_or(1, |e| e.seeds),
            links,
            fit: None,
            rendered: 0,
        };
        self.all.insert(key, run);
        Ok(())
    }

    /// Runs all applications, except those with cached results for the same inputs and program.
    pub fn run(&mut self) -> Result<(), FigureFileError> {
        let (source, preview) = (self.source, self.settings.preview);
        for run in self.all.values_mut() {
            let settings = applications::Settings {
                scenes: run.scenes.clone(),
                renders: self.settings.renders.clone(),
                preview,
                seeds: run.seeds,
                links: run.links.clone(),
            };
            let mut now = applications::Run::new(&run.application, &settings, self.watch)?;
            let mut inputs = now.inputs()?;
            run.rendered = now.rendered();
            let Size { pixels, spp } = run.size(preview);
            let mut name = format!("{}_{pixels}px_{spp}spp_{}seeds", run.application.name, run.seeds);
            if run.links != Links::None {
                // The text contains all parameters of the capture configuration.
                let links = format!("{:?}", run.links);
                name += &format!("_{:.8}", kept::digest(links.as_bytes()));
                inputs += &links;
            }
            let program = self.settings.program.as_ref();
            let place = program.map(|p| Place::new(&settings.renders, &name, p, &inputs));
            if let Some(fit) = place.as_ref().and_then(Place::read) {
                run.fit = Some(fit);
                continue;
            }
            let report = now.report().map_err(|e| match e {
                // If captures are impossible, the chain or the view must be changed.
                ApplicationError::Captured(e) if !matches!(e, LinksError::Interrupted) => {
                    let help = "correct the chain so that the captures are possible, or remove the view";
                    FigureFileError::Input(source.error(run.at, e.to_string(), help))
                }
                e => e.into(),
            })?;
            let mut fit = Fit::of(report, &run.application, &run.links);
            if let Some(place) = place {
                place.write(&mut fit);
            }
            run.fit = Some(fit);
        }
        Ok(())
    }

    /// Returns the number of new renders.
    pub fn rendered(&self) -> usize {
        self.all.values().map(|r| r.rendered).sum()
    }

    /// Returns the run of a panel and its results.
    fn found(
        &self,
        at: &Located<ViewFile>,
        key: (&'a str, String),
    ) -> Result<(&Run<'a>, &Fit), FigureFileError> {
        let name = key.0;
        let found = self.all.get(&key).and_then(|r| Some((r, r.fit.as_ref()?)));
        found.ok_or_else(|| {
            let message = format!("application `{name}` has no results");
            self.source.error(at, message, "run the application again").into()
        })
    }

    /// Returns the chart of a panel, and the values for its caption.
    pub fn chart(
        &self,
        at: &'a Located<ViewFile>,
        view: &'a CurvesFile,
    ) -> Result<(Tile, Vec<(String, Value)>), FigureFileError> {
        let (run, fit) = self.found(at, (&view.name, curves::words(view)))?;
        let (tile, mut values) =
            curves::tile(view, &run.application, &run.links, fit).map_err(self.source.at(at))?;
        values.extend(self.sizes(run));
        Ok((tile, values))
    }

    /// Returns the image of a panel, and the values for its caption.
    pub fn tile(
        &self,
        at: &'a Located<ViewFile>,
        view: &'a ApplyFile,
    ) -> Result<(Tile, Vec<(String, Value)>), FigureFileError> {
        let fault = self.source.at(at);
        let (run, fit) = self.found(at, (&view.name, String::new()))?;
        let pictures = &fit.pictures;
        let is =
            |p: &&Picture| p.name == view.picture && p.method == view.method && p.variant == view.variant;
        let Some(picture) = pictures.iter().find(is) else {
            let mut known: Vec<String> = pictures.iter().map(named).collect();
            known.sort();
            known.dedup();
            let ApplyFile { name, picture, method, .. } = view;
            let message =
                format!("application `{name}` has no picture `{picture}` of `{method}` for this variant");
            return Err(fault((message, format!("use one of: {}", known.join("; ")))).into());
        };
        let tile = drawn(view, picture, &self.shared(view, picture, pictures))
            .map_err(|e| fault((e, "correct the view".into())))?;
        Ok((tile, self.values(view, run, fit)?))
    }

    /// Returns the images that have the same colour scale as `picture`. The result contains all images of the
    /// same variant in the figure, if the units of these images are equal.
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

    /// Returns size and samples of the renders, as values for captions.
    fn sizes(&self, run: &Run) -> [(String, Value); 3] {
        let Size { pixels, spp } = run.size(self.settings.preview);
        [("seeds", run.seeds as f64), ("pixels", f64::from(pixels)), ("spp", f64::from(spp))]
            .map(|(name, v)| (name.to_owned(), Value::Number(v)))
    }

    fn values(
        &self,
        view: &ApplyFile,
        run: &Run,
        fit: &Fit,
    ) -> Result<Vec<(String, Value)>, FigureFileError> {
        let number = |name: String, v: f64| (name, Value::Number(v));
        let mut out =
            vec![("method".to_owned(), Value::Text(view.method.clone())), number("seed".into(), 1.0)];
        out.extend(self.sizes(run));
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
            let path = run.scenes.join(run.application.plan.scene);
            let studio = Studio::open(&path, &self.settings.renders, self.watch)?;
            out.extend(varied(&studio.variant(Some(v))?));
        }
        Ok(out)
    }
}

fn unknown<T>(source: &Source, at: &Located<T>, name: &str) -> base::locate::InputError {
    let all = catalog::all();
    let known: Vec<&str> = all.iter().map(|a| a.name).collect();
    let help = format!("use one of: {}", known.join(", "));
    source.error(at, format!("unknown application `{name}`"), help)
}

fn list(numbers: &[u64]) -> String {
    let all: Vec<String> = numbers.iter().map(u64::to_string).collect();
    all.join(", ")
}

fn named(p: &Picture) -> String {
    let variant = p.variant.map_or(String::new(), |v| format!(", variant {v}"));
    format!("{} of {}{variant}", p.name, p.method)
}

fn drawn(view: &ApplyFile, picture: &Picture, shared: &[&Picture]) -> Result<Tile, String> {
    let [width, _, channels] = picture.shape;
    let channels = channels.max(1);
    match (view.channel, channels) {
        (Some(c), _) if c >= channels => {
            return Err(format!(
                "channel {c} does not exist: the image has {channels} channels, numbered from 0"
            ));
        }
        // Channels are in order of ascending wavelength, so blue is first.
        (None, 3) => {
            let colours = |p: &Picture| -> Vec<[f32; 3]> {
                let pixels = p.data.chunks_exact(3);
                pixels.map(|c| [c[2], c[1], c[0]].map(|v| v as f32)).collect()
            };
            let all: Vec<f32> = shared.iter().flat_map(|p| colours(p)).flatten().collect();
            let white = match view.limits {
                Some([_, white]) => White::Value(white),
                None => tile::common_white(all.iter().copied()),
            };
            tile::of_colours(&named(picture), width, colours(picture), white)
        }
        (None, n) if n > 1 => return Err(format!("the image has {n} channels; choose one with `channel`")),
        (channel, _) => {
            let channel = channel.unwrap_or(0);
            let values = |p: &Picture| -> Vec<f32> {
                let pixels = p.data.chunks_exact(p.shape[2].max(1));
                pixels.map(|c| c.get(channel).map_or(f32::NAN, |v| *v as f32)).collect()
            };
            let all: Vec<f32> = shared.iter().flat_map(|p| values(p)).collect();
            let negative = all.iter().any(|v| *v < 0.0);
            let white = match view.limits {
                Some([_, high]) => White::Value(high),
                None => tile::common_white(all.iter().map(|v| v.abs())),
            };
            let most = white.value();
            let signed = match view.scale {
                ScaleFile::Arctan => SignedScale::Arctan,
                ScaleFile::Linear | ScaleFile::Log => SignedScale::Linear,
            };
            let scale = match view.limits {
                Some([low, high]) if view.scale == ScaleFile::Log => Scale::Log { low, high },
                Some([low, high]) if low == -high => Scale::Signed { limit: high, scale: signed },
                Some([low, high]) => Scale::Linear { low, high },
                None if negative => Scale::Signed { limit: most, scale: signed },
                None => Scale::Linear { low: 0.0, high: most },
            };
            let label = if view.label.is_empty() { &picture.name } else { &view.label };
            tile::of_values(label, width, &values(picture), scale).map(|mut tile| {
                tile.white = Some(white);
                tile
            })
        }
    }
    .map_err(|e| e.to_string())
}
