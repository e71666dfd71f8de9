//! Defines capture configurations for applications. A configuration is one of these:
//! - a chain with each of its beliefs (assumed element parameters)
//! - a sweep of one parameter
//! - a comparison of capture counts

use super::chain::{ChainFailure, Link, exposed, wavelengths};
use apply::application::{Application, Score};
use apply::chain::exposure::Laboratory;
use apply::chain::few::{Choice, Expected, Task, chosen};
use apply::chain::file::{Belief, Chain};
use apply::chain::optics::{Optics, Tolerances};
use apply::chain::readings::Count;
use apply::comparison::{Row, compare};
use apply::error::ApplyError;
use apply::observation::Observation;
use std::ops::RangeInclusive;
use transport::render::schedule::Watch;

/// The reason why an application failed on captured slices.
#[derive(Debug, thiserror::Error)]
pub enum LinksError {
    #[error(transparent)]
    Chain(#[from] ChainFailure),
    /// The application's methods refuse their input.
    #[error(transparent)]
    Apply(#[from] ApplyError),
    /// The application's methods refuse the slices that one configuration captured.
    #[error("with captures simulated for {label}: {cause}")]
    Captured { label: String, cause: ApplyError },
    #[error("stopped; run the same command again to resume")]
    Interrupted,
}

/// A parameter of a chain that can be swept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Number of electrons per reading (or counts of a photon counter) at the chosen exposure.
    Photons,
    Extinction,
    /// Standard deviation of the elements' retardances, in degrees.
    Retardance,
    /// Standard deviation of the angles of the elements' axes, in degrees.
    Axis,
    /// Accuracy of the assumed element parameters.
    Calibration,
}

impl Part {
    pub const ALL: [Self; 5] =
        [Self::Photons, Self::Extinction, Self::Retardance, Self::Axis, Self::Calibration];

    /// Returns the name of the parameter on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Photons => "photons",
            Self::Extinction => "extinction",
            Self::Retardance => "retardance",
            Self::Axis => "axis",
            Self::Calibration => "calibration",
        }
    }

    /// Returns the label of the parameter's axis, with the unit.
    pub fn label(self) -> &'static str {
        match self {
            Self::Photons => "electrons of a reading",
            Self::Extinction => "extinction ratio of the polarizers",
            Self::Retardance => "standard deviation of retardances [°]",
            Self::Axis => "standard deviation of axes [°]",
            Self::Calibration => "calibration",
        }
    }

    /// Returns the default values of a sweep of this parameter.
    pub fn values(self) -> &'static [f64] {
        match self {
            Self::Photons => &[30.0, 100.0, 300.0, 1000.0, 3000.0, 10_000.0],
            Self::Extinction => &[10.0, 100.0, 1000.0, 10_000.0, f64::INFINITY],
            Self::Retardance => &[0.0, 1.0, 3.0, 10.0, 20.0],
            Self::Axis => &[0.0, 0.3, 1.0, 3.0, 10.0],
            Self::Calibration => &[0.0, 1.0, 2.0],
        }
    }

    /// Parses a name and, after `=`, comma-separated values that replace the default values.
    ///
    /// # Errors
    /// Returns a message with the fault and the fix.
    pub fn parse(text: &str) -> Result<(Self, Vec<f64>), String> {
        let (name, values) = text.split_once('=').map_or((text, None), |(name, values)| (name, Some(values)));
        let part = Self::ALL.into_iter().find(|p| p.name() == name).ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            format!("unknown parameter `{name}`; use one of: {known}")
        })?;
        let Some(values) = values else {
            return Ok((part, part.values().to_vec()));
        };
        if part == Self::Calibration {
            return Err(format!("parameter `{name}` takes no values; remove the values"));
        }
        let value = |v: &str| {
            let found = v.trim().parse::<f64>().ok();
            found.filter(|x| part.takes(*x)).ok_or_else(|| {
                format!(
                    "`{v}` is not a valid value of parameter `{name}`; write for example {name}={}",
                    part.values()[1]
                )
            })
        };
        let values = values.split(',').map(value).collect::<Result<Vec<f64>, _>>()?;
        if values.len() > MOST_VALUES {
            return Err(format!("parameter `{name}` has {} values; use at most {MOST_VALUES}", values.len()));
        }
        if let Some((_, v)) = values.iter().enumerate().find(|(i, v)| values[..*i].contains(v)) {
            return Err(format!("parameter `{name}` lists {v} twice; list each value once"));
        }
        Ok((part, values))
    }

    fn takes(self, x: f64) -> bool {
        match self {
            Self::Photons => (1e-3..=1e9).contains(&x),
            Self::Extinction => x >= 1.0,
            Self::Retardance | Self::Axis => (0.0..=90.0).contains(&x),
            Self::Calibration => false,
        }
    }

    /// Sorts values from best to worst.
    pub fn better_first(self, values: &mut [f64]) {
        values.sort_by(f64::total_cmp);
        if !matches!(self, Self::Retardance | Self::Axis) {
            values.reverse();
        }
    }

    /// Formats a value of this parameter.
    pub fn shown(self, value: f64) -> String {
        match self {
            Self::Photons => format!("{value} e⁻"),
            Self::Extinction if value.is_finite() => format!("{value}:1"),
            Self::Extinction => "no leak".into(),
            Self::Retardance | Self::Axis => format!("{value}°"),
            Self::Calibration => BELIEFS[value as usize % 3].name().into(),
        }
    }

    /// Returns a copy of a chain with this value of the parameter. Returns `None` for a tolerance if the
    /// chain reads its elements from a file, because such elements have no tolerances.
    pub fn with(self, chain: &Chain, value: f64) -> Option<Chain> {
        let mut out = chain.clone();
        let Laboratory { optics, exposure, .. } = &mut out.laboratory;
        let tolerances: Option<&mut Tolerances> = match optics {
            Optics::Drawn(t) => Some(t),
            Optics::Known(_) => None,
        };
        match self {
            Self::Photons => (exposure.electrons, exposure.counts) = (value, value),
            Self::Extinction => tolerances?.extinction = 1.0 / value,
            Self::Retardance => tolerances?.retardance_error_deg = value,
            Self::Axis => tolerances?.axis_error_deg = value,
            Self::Calibration => {}
        }
        Some(out)
    }
}

/// Maximum number of values in a sweep.
const MOST_VALUES: usize = 100;

/// Maximum number of captures in a comparison of capture counts.
const MOST_CAPTURES: usize = 64;

/// Parses a range of capture counts, such as `1-8`.
///
/// # Errors
/// Returns a message with the fault and the fix.
pub fn captures(text: &str) -> Result<RangeInclusive<usize>, String> {
    let (a, b) = text.split_once('-').unwrap_or((text, text));
    let pair = a.trim().parse().ok().zip(b.trim().parse().ok());
    pair.filter(|(a, b)| 1 <= *a && a <= b && *b <= MOST_CAPTURES).map(|(a, b)| a..=b).ok_or_else(|| {
        format!("expected a range of capture counts within 1-{MOST_CAPTURES}, such as 1-16; got `{text}`")
    })
}

const BELIEFS: [Belief; 3] = [Belief::Nominal, Belief::Calibrated, Belief::Exact];

/// The capture configurations of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Links {
    /// No capture. Methods receive only the rendered slices.
    #[default]
    None,
    /// A capture chain with each of its beliefs (assumed element parameters).
    Chain(Chain),
    /// A capture chain with several values of one parameter.
    Sweep(Chain, Part, Vec<f64>),
    /// A comparison of capture counts, which uses a capture chain with each number of captures in the range.
    Few(Chain, RangeInclusive<usize>),
}

/// The position of a capture configuration in a sweep or a comparison of capture counts.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// Name of the series.
    pub series: String,
    /// Value of the parameter, along the axis.
    pub value: f64,
}

/// The results on slices that one configuration captured.
#[derive(Clone, Debug)]
pub struct Through {
    pub label: String,
    pub place: Place,
    /// Rows of the table, in the order of [`super::Report::rows`].
    pub rows: Vec<Row>,
    /// All scores, each with the seed of its render.
    pub scores: Vec<(u64, Score)>,
    /// Numbers of captured and of clipped pixels.
    pub count: Count,
    /// The task for which the captures were chosen, in a comparison of capture counts.
    pub task: Option<Task>,
}

/// A capture configuration with the results of the seeds that are complete.
pub(super) struct Running {
    link: Link,
    place: Place,
    task: Option<Task>,
    scores: Vec<(u64, Score)>,
    count: Count,
}

impl Running {
    fn new(label: String, chain: Chain, belief: Belief, place: Place) -> Self {
        Self {
            link: Link { label, chain, belief, prior: None, only: None },
            place,
            task: None,
            scores: vec![],
            count: Count::default(),
        }
    }

    /// Computes the table and returns the complete results.
    pub(super) fn compared(self, application: &Application) -> Through {
        Through {
            label: self.link.label,
            place: self.place,
            rows: compare(application, &self.scores),
            scores: self.scores,
            count: self.count,
            task: self.task,
        }
    }
}

/// Captures one seed's observations with all configurations, and runs the application on the captures of each
/// configuration. The first seed determines the configurations.
pub(super) fn capture(
    application: &Application,
    links: &Links,
    train: &[Observation],
    test: &[Observation],
    watch: &dyn Watch,
    all: &mut Vec<Running>,
) -> Result<(), LinksError> {
    if all.is_empty() {
        *all = links.settled(application, train)?;
    }
    let slices = &application.plan.slices;
    let seed = train.first().map_or(0, |o| o.seed);
    let nm = wavelengths(train);
    for running in all {
        let rig = running.link.rig(seed, &nm)?;
        let mut captured = |observations: &[Observation]| -> Result<Vec<Observation>, LinksError> {
            let each = observations.iter();
            each.map(|o| {
                if watch.interrupted() {
                    return Err(LinksError::Interrupted);
                }
                Ok(running.link.observe(&rig, o, slices, &mut running.count)?)
            })
            .collect()
        };
        let (train, test) = (captured(train)?, captured(test)?);
        let outcome = (application.run)(&train, &test)
            .map_err(|cause| LinksError::Captured { label: running.link.label.clone(), cause })?;
        running.scores.extend(outcome.scores.into_iter().map(|s| (seed, s)));
    }
    Ok(())
}

impl Links {
    fn settled(&self, application: &Application, train: &[Observation]) -> Result<Vec<Running>, LinksError> {
        match self {
            Self::None => Ok(vec![]),
            Self::Chain(chain) => Ok(chain
                .beliefs
                .iter()
                .map(|b| {
                    let place = Place { series: "belief".into(), value: f64::NAN };
                    Running::new(b.name().into(), chain.clone(), *b, place)
                })
                .collect()),
            Self::Sweep(chain, part, values) => {
                let task = application.task.map(|task| task(train)).transpose()?;
                let mut all = sweep(chain, *part, values);
                all.iter_mut().for_each(|r| r.task.clone_from(&task));
                Ok(all)
            }
            Self::Few(chain, range) => few(chain, range.clone(), application, train),
        }
    }
}

/// Returns a configuration for each value and each of the chain's beliefs. Each belief has its own series.
fn sweep(chain: &Chain, part: Part, values: &[f64]) -> Vec<Running> {
    let mut out = vec![];
    if part == Part::Calibration {
        for (i, belief) in BELIEFS.into_iter().enumerate() {
            let place = Place { series: part.label().into(), value: i as f64 };
            out.push(Running::new(belief.name().into(), chain.clone(), belief, place));
        }
        return out;
    }
    for belief in &chain.beliefs {
        for value in values {
            let Some(with) = part.with(chain, *value) else {
                continue;
            };
            let place = Place { series: belief.name().into(), value: *value };
            let label = format!("{}, {}", belief.name(), part.shown(*value));
            out.push(Running::new(label, with, *belief, place));
        }
    }
    out
}

/// Name of the series with all captures, which baselines use.
pub const WHOLE: &str = "all captures";

/// Returns the unchanged chain, then one configuration for each capture count and each way of choosing
/// captures.
fn few(
    chain: &Chain,
    range: RangeInclusive<usize>,
    application: &Application,
    train: &[Observation],
) -> Result<Vec<Running>, LinksError> {
    let task = application.task.ok_or_else(|| {
        ApplyError::Empty(format!(
            "the result of `{}` is not linear in the Mueller matrices, so captures cannot be optimized for this application; \
             use the application metamerism or scattering",
            application.name
        ))
    })?;
    let task = task(train)?;
    let expected = Expected::of(train, task.slice)?;
    let calibrated = chain.beliefs.contains(&Belief::Calibrated);
    let belief = calibrated.then_some(Belief::Calibrated);
    let belief = belief.or(chain.beliefs.first().copied()).unwrap_or(Belief::Exact);
    let place = |series: &str, value| Place { series: series.into(), value };
    let own = chain.nominal.captures();
    let mut whole = Running::new(
        format!("{} ({belief})", chain.nominal.name, belief = belief.name()),
        chain.clone(),
        belief,
        place(WHOLE, own as f64),
    );
    whole.task = Some(task.clone());
    let mut out = vec![whole];
    let plan = &application.plan;
    let noise = |scheme: &polarimetry::capture::scheme::Scheme| -> Result<f64, LinksError> {
        let Some(o) = train.first() else {
            return Ok(0.0);
        };
        let detectors = exposed(&chain.laboratory, o, &plan.slices, scheme)?;
        Ok(detectors.relative_noise(expected.brightness))
    };
    let sigma = noise(&chain.nominal)?;
    for choice in Choice::EVERY {
        for k in range.clone() {
            let scheme = chosen(choice, k, &task, &expected, sigma, chain.seed);
            let scheme = scheme.map_err(|e| ApplyError::Empty(e.to_string()))?;
            let chain = Chain { nominal: scheme, ..chain.clone() };
            let mut running = Running::new(
                format!("{k} captures, {}", choice.name()),
                chain,
                belief,
                place(choice.name(), k as f64),
            );
            running.link.prior = Some(expected.moment);
            running.link.only = Some(task.slice.into());
            running.task = Some(task.clone());
            out.push(running);
        }
    }
    Ok(out)
}
