//! What methods are worth against one thing of a chain, and where the first ceases to win.

use super::Report;
use super::links::{Part, Through, WHOLE};
use apply::application::Metric;
use apply::chain::few::Task;
use apply::comparison::table;
use apply::metrics::paired::{Estimate, difference, estimate};
use figure::chart::{Chart, ChartAxis, Series, SeriesStyle};

/// Standard errors that a difference is above zero to be called a win.
const SURE: f64 = 2.0;

/// One method along a series.
#[derive(Clone, Debug)]
pub struct Point {
    /// Series that the link is in.
    pub series: String,
    /// Value along the axis.
    pub value: f64,
    /// Name of the method.
    pub method: &'static str,
    /// What it is worth by the first metric.
    pub worth: Estimate,
    /// Ours less this, on the same renders; `None` of ours.
    pub ours_less_this: Option<Estimate>,
    /// Whether it is one of those that ours is to beat.
    pub baseline: bool,
}

/// Points of a sweep: all methods through every link.
#[must_use]
pub fn of_sweep(metric: Metric, report: &Report) -> Vec<Point> {
    let mut out = vec![];
    for t in &report.through {
        for row in t.rows.iter().filter(|r| r.metric == metric) {
            out.push(Point {
                series: t.place.series.clone(),
                value: t.place.value,
                method: row.method.name,
                worth: row.value,
                ours_less_this: row.ours_less_this,
                baseline: is_baseline(t, row.method.name) && row.ours_less_this.is_some(),
            });
        }
    }
    out
}

fn is_baseline(t: &Through, method: &str) -> bool {
    t.task
        .as_ref()
        .is_none_or(|task| task.baselines.contains(&method))
}

/// The link of all captures.
fn whole(report: &Report) -> Option<(&Through, &Task)> {
    let found = report.through.iter().find(|t| t.place.series == WHOLE)?;
    Some((found, found.task.as_ref()?))
}

/// Points of few captures: ours through every link, and baselines through all captures.
#[must_use]
pub fn of_captures(metric: Metric, report: &Report) -> Vec<Point> {
    let Some((whole, task)) = whole(report) else {
        return vec![];
    };
    let of = |t: &Through, method: &str| table(&t.scores, method, metric.name);
    let baselines = task.baselines.iter().map(|b| (*b, of(whole, b)));
    let mut out: Vec<Point> = baselines
        .map(|(method, theirs)| Point {
            series: WHOLE.into(),
            value: whole.place.value,
            method,
            worth: estimate(&theirs),
            ours_less_this: Some(difference(&of(whole, task.method), &theirs)),
            baseline: true,
        })
        .collect();
    out.extend(report.through.iter().map(|t| Point {
        series: t.place.series.clone(),
        value: t.place.value,
        method: task.method,
        worth: estimate(&of(t, task.method)),
        ours_less_this: None,
        baseline: false,
    }));
    out
}

fn better(metric: Metric, difference: f64) -> f64 {
    if metric.more_is_better {
        difference
    } else {
        -difference
    }
}

/// Whether a difference of ours and another is a win beyond doubt.
fn wins(metric: Metric, d: &Estimate) -> bool {
    better(metric, d.mean) > SURE * d.error
}

/// For each series of a sweep the last value, from good parts to bad, down to which the first method beats each baseline, or all values at
/// which it does; a sentence each.
#[must_use]
pub fn verdicts(metric: Metric, part: Part, points: &[Point]) -> Vec<String> {
    let mut out = vec![];
    for of in points.chunk_by(|a, b| a.series == b.series) {
        let mut baselines: Vec<&str> = vec![];
        for p in of.iter().filter(|p| p.baseline) {
            if !baselines.contains(&p.method) {
                baselines.push(p.method);
            }
        }
        let last = |name: &&str| {
            let own = || of.iter().filter(|p| p.method == *name);
            let mut values: Vec<f64> = own().map(|p| p.value).collect();
            part.better_first(&mut values);
            let won = |v: &f64| {
                let found = own().find(|p| p.value == *v);
                found
                    .and_then(|p| p.ours_less_this)
                    .is_some_and(|d| wins(metric, &d))
            };
            let all: Vec<(f64, bool)> = values.into_iter().map(|v| (v, won(&v))).collect();
            let first = all.iter().take_while(|(_, won)| *won).count();
            let wins = all.iter().filter(|(_, won)| *won).count();
            let verdict = if wins == 0 {
                "never".to_owned()
            } else if wins == all.len() {
                "always".to_owned()
            } else if wins == first {
                format!("down to {}", part.shown(all[first - 1].0))
            } else {
                // Not with the best parts alone: baselines suffer, too.
                let at = all.iter().filter(|(_, won)| *won).map(|(v, _)| part.shown(*v));
                format!("at {} alone", at.collect::<Vec<_>>().join(", "))
            };
            format!("{name} {verdict}")
        };
        let told: Vec<String> = baselines.iter().map(last).collect();
        out.push(format!(
            "{}, {}: beats {}",
            metric.name,
            of[0].series,
            told.join("; ")
        ));
    }
    out
}

/// For each choice of captures the least number that beats each baseline, a sentence each. Baselines are seen through all captures.
#[must_use]
pub fn least(metric: Metric, report: &Report) -> Vec<String> {
    let Some((whole, task)) = whole(report) else {
        return vec![];
    };
    let few: Vec<&Through> = report
        .through
        .iter()
        .filter(|t| t.place.series != WHOLE)
        .collect();
    let mut out = vec![];
    for of in few.chunk_by(|a, b| a.place.series == b.place.series) {
        let least = |baseline: &&'static str| {
            let theirs = table(&whole.scores, baseline, metric.name);
            let won = |t: &&&Through| {
                wins(
                    metric,
                    &difference(&table(&t.scores, task.method, metric.name), &theirs),
                )
            };
            let all = of.iter().filter(won).map(|t| t.place.value);
            let least = all.reduce(f64::min).map_or("none".to_owned(), |k| k.to_string());
            format!("{baseline} {least}")
        };
        let told: Vec<String> = task.baselines.iter().map(least).collect();
        out.push(format!(
            "{}, {}: least captures that beat {}",
            metric.name,
            of[0].place.series,
            told.join("; ")
        ));
    }
    out
}

/// A text for a table.
pub(super) fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

/// A table of points.
#[must_use]
pub fn csv(metric: Metric, axis: &str, points: &[Point]) -> String {
    let number = |v: f64| if v.is_nan() { String::new() } else { v.to_string() };
    let mut out = format!(
        "series,{},method,baseline,{},standard_error,ours_less_this,standard_error_of_difference\n",
        quoted(axis),
        quoted(metric.name)
    );
    for p in points {
        let of = |f: fn(&Estimate) -> f64| p.ours_less_this.as_ref().map_or(String::new(), |d| number(f(d)));
        let cells = [
            quoted(&p.series),
            number(p.value),
            quoted(p.method),
            p.baseline.to_string(),
            number(p.worth.mean),
            number(p.worth.error),
            of(|d| d.mean),
            of(|d| d.error),
        ];
        out += &(cells.join(",") + "\n");
    }
    out
}

/// The chart of points: a band of one and two standard errors around each line; of a single place a dashed line across.
#[must_use]
pub fn chart(title: &str, metric: Metric, x: ChartAxis, points: &[(String, Point)]) -> Chart {
    let mut series: Vec<Series> = vec![];
    let finite = || points.iter().filter(|(_, p)| p.value.is_finite());
    let ends = finite()
        .map(|(_, p)| p.value)
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| {
            [a.min(v), b.max(v)]
        });
    let mut names: Vec<&String> = vec![];
    for (name, _) in finite() {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    for (colour, name) in names.into_iter().enumerate() {
        let mut own: Vec<&Point> = finite().filter(|(n, _)| n == name).map(|(_, p)| p).collect();
        own.sort_by(|a, b| a.value.total_cmp(&b.value));
        let of = |p: &Point, at: f64| ((at, p.worth.mean), p.worth.error);
        let (all, style): (Vec<_>, _) = match own[..] {
            [only] => (ends.iter().map(|x| of(only, *x)).collect(), SeriesStyle::Dashed),
            _ => (own.iter().map(|p| of(p, p.value)).collect(), SeriesStyle::Band),
        };
        let (points, errors) = all.into_iter().unzip();
        series.push(Series {
            name: name.clone(),
            points,
            errors: Some(errors),
            style,
            colour,
        });
    }
    let unit = if metric.unit.is_empty() {
        String::new()
    } else {
        format!(" [{}]", metric.unit)
    };
    let left_out = points.iter().any(|(_, p)| p.value.is_infinite());
    Chart {
        title: title.into(),
        x,
        y: ChartAxis {
            label: format!("{}{unit}", metric.name),
            ..ChartAxis::default()
        },
        series,
        notes: left_out
            .then(|| "parts without a fault, at infinity, are in the table alone".into())
            .into_iter()
            .collect(),
    }
}
