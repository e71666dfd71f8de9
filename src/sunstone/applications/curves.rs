//! Computes the scores of methods as a function of one parameter of a capture chain. Also computes the range
//! in which the first method wins.

use super::Report;
use super::links::{Links, Part, Through, WHOLE};
use apply::application::Metric;
use apply::chain::few::Task;
use apply::comparison::table;
use apply::metrics::paired::{Estimate, difference, estimate};
use figure::chart::{Chart, ChartAxis, Series, SeriesStyle};

/// Number of standard errors by which a difference must exceed zero to count as a win.
const SURE: f64 = 2.0;

/// The score of one method at one value of a series.
#[derive(Clone, Debug)]
pub struct Point {
    /// Name of the series.
    pub series: String,
    /// Value of the parameter, along the axis.
    pub value: f64,
    pub method: String,
    /// Score of the method by the metric.
    pub worth: Estimate,
    /// Score of the first method minus the score of this method, on the same renders. The value is `None` for
    /// the first method.
    pub ours_less_this: Option<Estimate>,
    /// Whether the method is a baseline.
    pub baseline: bool,
}

/// Returns the points of a sweep or of a comparison of capture counts. Returns an empty list for other
/// configurations.
pub fn points(metric: Metric, report: &Report, links: &Links) -> Vec<Point> {
    match links {
        Links::None | Links::Chain(_) => vec![],
        Links::Sweep(..) => of_sweep(metric, report),
        Links::Few(..) => of_captures(metric, report),
    }
}

/// Returns the points of a sweep. There is one point for each method and each capture configuration.
fn of_sweep(metric: Metric, report: &Report) -> Vec<Point> {
    let mut out = vec![];
    for t in &report.through {
        for row in t.rows.iter().filter(|r| r.metric == metric) {
            out.push(Point {
                series: t.place.series.clone(),
                value: t.place.value,
                method: row.method.name.to_owned(),
                worth: row.value,
                ours_less_this: row.ours_less_this,
                baseline: is_baseline(t, row.method.name) && row.ours_less_this.is_some(),
            });
        }
    }
    out
}

fn is_baseline(t: &Through, method: &str) -> bool {
    t.task.as_ref().is_none_or(|task| task.baselines.contains(&method))
}

/// Returns the results and the task of the configuration with all captures.
fn whole(report: &Report) -> Option<(&Through, &Task)> {
    let found = report.through.iter().find(|t| t.place.series == WHOLE)?;
    Some((found, found.task.as_ref()?))
}

/// Returns the points of a comparison of capture counts. Baselines are evaluated only with all captures.
fn of_captures(metric: Metric, report: &Report) -> Vec<Point> {
    let Some((whole, task)) = whole(report) else {
        return vec![];
    };
    let of = |t: &Through, method: &str| table(&t.scores, method, metric.name);
    let baselines = task.baselines.iter().map(|b| (*b, of(whole, b)));
    let mut out: Vec<Point> = baselines
        .map(|(method, theirs)| Point {
            series: WHOLE.into(),
            value: whole.place.value,
            method: method.to_owned(),
            worth: estimate(&theirs),
            ours_less_this: Some(difference(&of(whole, task.method), &theirs)),
            baseline: true,
        })
        .collect();
    out.extend(report.through.iter().map(|t| Point {
        series: t.place.series.clone(),
        value: t.place.value,
        method: task.method.to_owned(),
        worth: estimate(&of(t, task.method)),
        ours_less_this: None,
        baseline: false,
    }));
    out
}

fn better(metric: Metric, difference: f64) -> f64 {
    if metric.more_is_better { difference } else { -difference }
}

/// Returns whether the score difference `d` shows that the first method is significantly better.
fn wins(metric: Metric, d: &Estimate) -> bool {
    better(metric, d.mean) > SURE * d.error
}

/// The range of parameter values or capture counts in which the first method beats a baseline.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verdict {
    pub series: String,
    pub baseline: String,
    /// Description of the range. For a sweep with values from best to worst, the last value at which the
    /// first method wins. If the first method does not win at some better value, the description lists all
    /// values at which it wins. For a comparison of capture counts, the smallest count at which the first
    /// method wins.
    pub words: String,
}

/// Returns all verdicts of a sweep or of a comparison of capture counts, series by series.
pub fn verdicts(metric: Metric, report: &Report, links: &Links) -> Vec<Verdict> {
    match links {
        Links::None | Links::Chain(_) => vec![],
        Links::Sweep(_, part, _) => of_values(metric, *part, &of_sweep(metric, report)),
        Links::Few(..) => least(metric, report),
    }
}

/// Formats verdicts as sentences, one per series.
pub fn sentences(metric: Metric, links: &Links, verdicts: &[Verdict]) -> Vec<String> {
    let beats = match links {
        Links::Few(..) => "fewest captures that beat",
        _ => "beats",
    };
    let of_series = verdicts.chunk_by(|a, b| a.series == b.series);
    let sentence = |of: &[Verdict]| {
        let message: Vec<String> = of.iter().map(|v| format!("{} {}", v.baseline, v.words)).collect();
        format!("{}, {}: {beats} {}", metric.name, of[0].series, message.join("; "))
    };
    of_series.map(sentence).collect()
}

fn of_values(metric: Metric, part: Part, points: &[Point]) -> Vec<Verdict> {
    let mut out = vec![];
    for of in points.chunk_by(|a, b| a.series == b.series) {
        let mut baselines: Vec<&str> = vec![];
        for p in of.iter().filter(|p| p.baseline) {
            if !baselines.contains(&&*p.method) {
                baselines.push(&p.method);
            }
        }
        for name in baselines {
            let own = || of.iter().filter(|p| p.method == name);
            let mut values: Vec<f64> = own().map(|p| p.value).collect();
            part.better_first(&mut values);
            let won = |v: &f64| {
                let found = own().find(|p| p.value == *v);
                found.and_then(|p| p.ours_less_this).is_some_and(|d| wins(metric, &d))
            };
            let all: Vec<(f64, bool)> = values.into_iter().map(|v| (v, won(&v))).collect();
            let first = all.iter().take_while(|(_, won)| *won).count();
            let wins = all.iter().filter(|(_, won)| *won).count();
            let words = if wins == 0 {
                "never".to_owned()
            } else if wins == all.len() {
                "always".to_owned()
            } else if wins == first {
                format!("down to {}", part.shown(all[first - 1].0))
            } else {
                // The first method can win at worse values only, because the baselines also degrade.
                let at = all.iter().filter(|(_, won)| *won).map(|(v, _)| part.shown(*v));
                format!("at {} alone", at.collect::<Vec<_>>().join(", "))
            };
            out.push(Verdict { series: of[0].series.clone(), baseline: name.to_owned(), words });
        }
    }
    out
}

/// Returns the smallest number of captures with which the first method wins, for each baseline and for each
/// way of choosing captures. Baselines use all captures.
fn least(metric: Metric, report: &Report) -> Vec<Verdict> {
    let Some((whole, task)) = whole(report) else {
        return vec![];
    };
    let few: Vec<&Through> = report.through.iter().filter(|t| t.place.series != WHOLE).collect();
    let mut out = vec![];
    for of in few.chunk_by(|a, b| a.place.series == b.place.series) {
        for baseline in &task.baselines {
            let theirs = table(&whole.scores, baseline, metric.name);
            let won = |t: &&&Through| {
                wins(metric, &difference(&table(&t.scores, task.method, metric.name), &theirs))
            };
            let all = of.iter().filter(won).map(|t| t.place.value);
            let least = all.reduce(f64::min).map_or("none".to_owned(), |k| k.to_string());
            out.push(Verdict {
                series: of[0].place.series.clone(),
                baseline: (*baseline).to_owned(),
                words: least,
            });
        }
    }
    out
}

/// Quotes a text for a CSV table.
pub(super) fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

/// Formats points as a CSV table.
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
            quoted(&p.method),
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

/// Maximum number of labelled capture counts on an axis.
const MOST_NAMED: usize = 12;

/// Returns the labelled axis of a sweep or of a comparison of capture counts. Returns an empty axis for other
/// configurations.
pub fn axis(links: &Links) -> ChartAxis {
    let (label, log, named) = match links {
        Links::None | Links::Chain(_) => ("", false, vec![]),
        Links::Sweep(_, part, values) => {
            let names = || values.iter().map(|v| (*v, part.shown(*v))).collect();
            let named = if *part == Part::Calibration { names() } else { vec![] };
            let log = matches!(part, Part::Photons | Part::Extinction);
            (part.label(), log, named)
        }
        Links::Few(_, range) => {
            // The axis contains only integers, of which at most MOST_NAMED are labelled.
            let step = range.clone().count().div_ceil(MOST_NAMED).max(1);
            let whole = range.clone().step_by(step).map(|n| (n as f64, n.to_string()));
            ("captures", false, whole.collect())
        }
    };
    ChartAxis { label: label.into(), log, named, ..ChartAxis::default() }
}

/// Returns points with the names of their curves. For a sweep, the name of a curve is the name of the method.
/// For a comparison of capture counts, the name is the way of choosing captures. The score of a method with
/// all captures becomes a horizontal line.
pub fn named(points: Vec<Point>, links: &Links) -> Vec<(String, Point)> {
    if !matches!(links, Links::Few(..)) {
        return points.into_iter().map(|p| (p.method.clone(), p)).collect();
    }
    let few = points.iter().filter(|p| p.series != WHOLE).map(|p| p.value);
    let start = few.reduce(f64::min);
    let name = |p: Point| {
        if p.series == WHOLE {
            let value = start.unwrap_or(p.value);
            (format!("{}, {WHOLE}", p.method), Point { value, ..p })
        } else {
            (p.series.clone(), p)
        }
    };
    points.into_iter().map(name).collect()
}

/// Draws points with bands of one and two standard errors around each line. A curve with a single point
/// becomes a dashed horizontal line.
pub fn chart(title: &str, metric: Metric, x: ChartAxis, points: &[(String, Point)]) -> Chart {
    let mut series: Vec<Series> = vec![];
    let finite = || points.iter().filter(|(_, p)| p.value.is_finite());
    let ends = finite()
        .map(|(_, p)| p.value)
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
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
        series.push(Series { name: name.clone(), points, errors: Some(errors), style, colour });
    }
    let unit = if metric.unit.is_empty() { String::new() } else { format!(" [{}]", metric.unit) };
    let left_out = points.iter().any(|(_, p)| p.value.is_infinite());
    Chart {
        title: title.into(),
        x,
        y: ChartAxis { label: format!("{}{unit}", metric.name), ..ChartAxis::default() },
        series,
        notes: left_out
            .then(|| "errors of 0 have infinite parts and appear only in the table".into())
            .into_iter()
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const METRIC: Metric = Metric::new("m", "", true);

    fn point(value: f64, method: &str, less: Option<[f64; 2]>) -> Point {
        let estimate = |[mean, error]: [f64; 2]| Estimate { mean, error, counts: [3, 2] };
        Point {
            series: "nominal".into(),
            value,
            method: method.into(),
            worth: estimate([0.5, 0.1]),
            ours_less_this: less.map(estimate),
            baseline: less.is_some(),
        }
    }

    /// Tests that a difference of two standard errors is not a win, and that a slightly larger difference is
    /// a win.
    #[test]
    fn a_win_needs_more_than_two_standard_errors() {
        let mut all = vec![];
        for (value, a, b, c, d) in
            [(10.0, 0.2, 0.3, 0.1, -0.3), (100.0, 0.2, 0.21, 0.3, -0.3), (1000.0, 0.21, 0.3, 0.1, -0.3)]
        {
            all.push(point(value, "ours", None));
            for (name, less) in [("a", a), ("b", b), ("c", c), ("d", d)] {
                all.push(point(value, name, Some([less, 0.1])));
            }
        }
        let message = |metric, part, want: [&str; 4]| {
            let all = of_values(metric, part, &all);
            let words: Vec<&str> = all.iter().map(|v| v.words.as_str()).collect();
            assert_eq!(words, want);
        };
        let photons = ["down to 1000 e⁻", "always", "at 100 e⁻ alone", "never"];
        message(METRIC, Part::Photons, photons);
        // The smallest standard deviation of the axis angles is the best.
        message(METRIC, Part::Axis, ["at 1000° alone", "always", "at 100° alone", "never"]);
        let less = Metric::new("m", "", false);
        message(less, Part::Photons, ["never", "never", "never", "always"]);
    }

    #[test]
    fn the_line_of_all_captures_spans_the_axis() {
        let mut all = vec![point(36.0, "theirs", Some([0.1, 0.1])), point(2.0, "ours", None)];
        all[0].series = WHOLE.into();
        all.push(point(1.0, "ours", None));
        let chain = apply::chain::file::load(
            &std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rigs/chains/sweep.toml"),
        )
        .expect("a chain");
        let links = Links::Few(chain, 1..=2);
        let drawn = named(all, &links);
        let message: Vec<(&str, f64)> = drawn.iter().map(|(name, p)| (name.as_str(), p.value)).collect();
        assert_eq!(message, [("theirs, all captures", 1.0), ("nominal", 2.0), ("nominal", 1.0)]);
        assert_eq!(axis(&links).named, [(1.0, "1".to_owned()), (2.0, "2".to_owned())]);
        let chart = chart("", METRIC, axis(&links), &drawn);
        let [across, ours] = &chart.series[..] else {
            panic!("{} lines", chart.series.len());
        };
        assert_eq!(across.style, SeriesStyle::Dashed);
        assert_eq!(across.points, [(1.0, 0.5), (2.0, 0.5)]);
        assert_eq!(ours.points, [(1.0, 0.5), (2.0, 0.5)]);
    }
}
