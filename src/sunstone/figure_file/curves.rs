//! Creates panels with curves of applications. The curves are scores of methods over a sweep of a capture
//! chain, or over the number of captures.

use apply::application::{Application, Metric};
use apply::chain::file;
use apply::metrics::paired::Estimate;
use figure::chart::{BLACK, Series, SeriesStyle};
use figure::tile::{self, Tile};
use std::path::Path;

use super::caption::Value;
use super::file::CurvesFile;
use super::kept::{Fit, Point};
use super::source::Fault;
use crate::applications::curves;
use crate::applications::links::{self, Links, Part, WHOLE};

/// Distance between the points of two curves for the same number of captures.
const STEP: f64 = 0.025;

/// Returns a description that is unique for each capture chain of a view.
pub fn words(view: &CurvesFile) -> String {
    let of = |text: &Option<String>| text.clone().unwrap_or_default();
    format!("{}, {}, {}", view.chain, of(&view.sweep), of(&view.captures))
}

/// Returns the capture chain of a view, and checks the view without running the application.
pub fn links(view: &CurvesFile, chain: &Path, application: &Application) -> Result<Links, Fault> {
    let name = application.name;
    let fault = |message: String, help: &str| Err((message, help.to_owned()));
    if application.plan.slices.is_empty() {
        let message = format!(
            "application `{name}` captures its own input, so a view of curves does not apply to this application"
        );
        return fault(message, "remove the view");
    }
    metric(view, application)?;
    let known: Vec<&str> = application.methods.iter().map(|m| m.name).collect();
    if let Some(m) = view.methods.iter().find(|m| !known.contains(&m.as_str())) {
        let message = format!("application `{name}` has no method `{m}`");
        return Err((message, format!("use some of: {}", known.join("; "))));
    }
    if let Some([low, high]) = view.limits
        && !(low < high && (high - low).is_finite())
    {
        let message = format!(
            "limits = [{low}, {high}] is not a valid range, because the first limit is not smaller than the second"
        );
        return fault(message, "write the smaller limit first");
    }
    let chain = file::load(chain)
        .map_err(|e| (e.to_string(), "correct the chain file at the stated position".to_owned()))?;
    let beliefs: Vec<&str> = chain.beliefs.iter().map(|b| b.name()).collect();
    if let Some(belief) = view.belief.as_ref().filter(|b| !beliefs.contains(&b.as_str())) {
        let message = format!("the chain has no belief `{belief}`");
        return Err((message, format!("use one of: {}", beliefs.join(", "))));
    }
    match (&view.sweep, &view.captures) {
        (Some(text), None) => {
            let help = "use the syntax of sunstone apply --sweep";
            let (part, values) = Part::parse(text).map_err(|e| (e, help.to_owned()))?;
            if values.iter().any(|v| part.with(&chain, *v).is_none()) {
                let message =
                    format!("the optics of the chain come from a file, so `{}` cannot be swept", part.name());
                return fault(
                    message,
                    "set optics = { axis_error_deg, retardance_error_deg, extinction } in the chain",
                );
            }
            Ok(Links::Sweep(chain, part, values))
        }
        (None, Some(_)) if view.difference => {
            fault("`difference` cannot be combined with `captures`".into(), "remove `difference`")
        }
        (None, Some(text)) => {
            let help = "use the syntax of sunstone apply --captures";
            let range = links::captures(text).map_err(|e| (e, help.to_owned()))?;
            Ok(Links::Few(chain, range))
        }
        (sweep, _) => fault(
            format!(
                "a view of curves needs exactly one of `sweep` and `captures`, got {}",
                if sweep.is_some() { "both" } else { "neither" }
            ),
            "set sweep = \"photons=30,300,3000\" or captures = \"1-8\"",
        ),
    }
}

fn metric(view: &CurvesFile, application: &Application) -> Result<Metric, Fault> {
    let all = &application.metrics;
    let found = match &view.metric {
        None => all.first(),
        Some(name) => all.iter().find(|m| m.name == name),
    };
    found.copied().ok_or_else(|| {
        let name = view.metric.as_deref().unwrap_or_default();
        let known: Vec<&str> = all.iter().map(|m| m.name).collect();
        (
            format!("application `{}` has no metric `{name}`", application.name),
            format!("use one of: {}", known.join("; ")),
        )
    })
}

/// Returns the point to draw. The value is the difference of scores if `difference` is true, otherwise the
/// score.
fn drawn(p: &Point, difference: bool) -> curves::Point {
    let [mean, error, less, less_error] = p.numbers;
    let estimate = |mean, error| Estimate { mean, error, counts: [0; 2] };
    let less = estimate(less, less_error);
    curves::Point {
        series: p.series.clone(),
        value: p.value,
        method: p.method.clone(),
        worth: if difference { less } else { estimate(mean, error) },
        ours_less_this: None,
        baseline: p.baseline,
    }
}

/// Returns the chart of a view, and the values for its caption.
pub fn tile(
    view: &CurvesFile,
    application: &Application,
    links: &Links,
    fit: &Fit,
) -> Result<(Tile, Vec<(String, Value)>), Fault> {
    let metric = metric(view, application)?;
    let few = matches!(links, Links::Few(..));
    let ours = application.methods.first().map_or("", |m| m.name);
    let own = || fit.points.iter().filter(|p| p.metric == metric.name);
    let belief = view.belief.clone().or_else(|| Some(own().next()?.series.clone()));
    let shown = |p: &&Point| {
        let of_series = few || Some(&p.series) == belief.as_ref();
        let listed =
            view.methods.is_empty() || view.methods.contains(&p.method) || (few && p.series != WHOLE);
        of_series && listed && !(view.difference && p.method == ours)
    };
    let points: Vec<curves::Point> = own().filter(shown).map(|p| drawn(p, view.difference)).collect();
    let mut axis = curves::axis(links);
    axis.named.retain(|(v, _)| v.is_finite());
    let mut chart = curves::chart("", metric, axis, &curves::named(points, links));
    // The index in the list determines a method's colour, for scores and for differences.
    let listed: Vec<&str> = match &view.methods[..] {
        [] => application.methods.iter().map(|m| m.name).collect(),
        some => some.iter().map(String::as_str).collect(),
    };
    for (i, s) in chart.series.iter_mut().enumerate() {
        let place = listed.iter().position(|m| *m == s.name && !few);
        s.colour = skipping_black(place.unwrap_or(i));
        if s.style == SeriesStyle::Band {
            s.style = SeriesStyle::LineMarkers;
        }
        if few {
            apart(s, i);
        }
    }
    chart.series.sort_by_key(|s| s.colour);
    chart.y.range = view.limits.map(|[low, high]| (low, high));
    if view.difference {
        chart.y.label = format!("{} of {ours}, minus others", chart.y.label);
        let values = chart.series.iter().flat_map(|s| &s.points).map(|p| p.0);
        let [low, high] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
        let level = Series {
            points: vec![(low, 0.0), (high, 0.0)],
            style: SeriesStyle::Dashed,
            colour: BLACK,
            ..Series::default()
        };
        chart.series.insert(0, level);
    }
    let tile = tile::of_chart(chart, view.legend)
        .map_err(|e| (e.to_string(), "correct the view, or sweep other values".to_owned()))?;
    let mut values = vec![("metric".to_owned(), Value::Text(metric.name.to_owned()))];
    let answer = || fit.verdicts.iter().filter(|v| v.metric == metric.name);
    let first = answer().next().map(|v| v.series.clone());
    let of_first = if few { first } else { belief };
    for v in answer() {
        let words = || Value::Text(v.words.clone());
        if Some(&v.series) == of_first.as_ref() {
            values.push((format!("beats {}", v.baseline), words()));
        }
        values.push((format!("beats {}, {}", v.baseline, v.series), words()));
    }
    Ok((tile, values))
}

/// Moves the points of curve `i` over the number of captures to the right, so that error bars of curves do not
/// overlap. A baseline is the same for all numbers of captures, and has an error bar at the first number alone.
fn apart(s: &mut Series, i: usize) {
    s.points.iter_mut().for_each(|p| p.0 += STEP * i as f64);
    if s.style == SeriesStyle::Dashed
        && let Some(errors) = &mut s.errors
    {
        errors.iter_mut().skip(1).for_each(|e| *e = 0.0);
    }
}

/// Returns the colour index of curve `i`. Skips black, which is the colour of reference lines.
fn skipping_black(i: usize) -> usize {
    i + i / BLACK
}
