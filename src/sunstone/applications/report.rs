//! Writes the tables and images of a [`Report`] to files.

use super::curves::{self, Point, quoted};
use super::links::Links;
use super::{Report, Settings};
use apply::application::{Application, Picture};
use apply::comparison::Row;
use apply::metrics::paired::Estimate;
use base::whole_file;
use figure::FigureError;
use figure::chart;
use figure::maps::{self, Quantity};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The reason why a file was not written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error("cannot write {}: {cause}; check that the folder is writable and the disk is not full", path.display())]
    Write { path: PathBuf, cause: std::io::Error },
    #[error(transparent)]
    Figure(#[from] FigureError),
}

/// Number of maps per row of a page.
const COLUMNS: usize = 4;

/// Writes `table.csv`, `scores.csv`, `report.json`, the images, and the tables and charts of a sweep or a
/// comparison of capture counts. Creates the folder. Each file is written atomically.
///
/// # Errors
/// Returns [`ReportError`] if a file cannot be drawn or written.
pub fn write(
    application: &Application,
    report: &Report,
    settings: &Settings,
    folder: &Path,
) -> Result<(), ReportError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |cause| ReportError::Write { path, cause }
    };
    std::fs::create_dir_all(folder).map_err(failed(folder))?;
    let text = serde_json::to_string_pretty(&document(application, report)).unwrap_or_default();
    for (name, text) in
        [("table.csv", table_csv(report)), ("scores.csv", scores_csv(report)), ("report.json", text + "\n")]
    {
        let path = folder.join(name);
        whole_file::write(&path, text.as_bytes()).map_err(failed(&path))?;
    }
    for (name, title, page) in pages(&report.first.pictures) {
        draw(&folder.join(format!("{name}.png")), &title, &page)?;
    }
    curve(application, report, &settings.links, folder)
}

/// Returns the verdicts of a sweep, or of a comparison of capture counts, as sentences.
pub fn verdicts(application: &Application, report: &Report, links: &Links) -> Vec<String> {
    let of = |metric| curves::sentences(metric, links, &curves::verdicts(metric, report, links));
    application.metrics.iter().copied().flat_map(of).collect()
}

/// Writes the table and the charts of a sweep, or of a comparison of capture counts.
fn curve(
    application: &Application,
    report: &Report,
    links: &Links,
    folder: &Path,
) -> Result<(), ReportError> {
    let name = match links {
        Links::None | Links::Chain(_) => return Ok(()),
        Links::Sweep(_, part, _) => format!("sweep_{}", part.name()),
        Links::Few(..) => "captures".to_owned(),
    };
    let Some(metric) = application.metrics.first().copied() else {
        return Ok(());
    };
    let points = curves::points(metric, report, links);
    let axis = curves::axis(links);
    let path = folder.join(format!("{name}.csv"));
    whole_file::write(&path, curves::csv(metric, &axis.label, &points).as_bytes())
        .map_err(|cause| ReportError::Write { path, cause })?;
    let mut charts: Vec<(String, String, Vec<Point>)> = vec![];
    if let Links::Few(..) = links {
        charts.push((name, format!("{}: few captures", application.name), points));
    } else {
        for of in points.chunk_by(|a, b| a.series == b.series) {
            let series = &of[0].series;
            let title = format!("{}: {}, {series}", application.name, axis.label);
            charts.push((format!("{name}_{series}"), title, of.to_vec()));
        }
    }
    for (name, title, points) in charts {
        let points = curves::named(points, links);
        let drawing = chart::draw(&curves::chart(&title, metric, axis.clone(), &points))?;
        figure::save(&drawing, &folder.join(format!("{name}.png")))?;
    }
    Ok(())
}

/// Formats a number for a table. Unknown values become empty cells.
fn cell(v: f64) -> String {
    if v.is_finite() { format!("{v}") } else { String::new() }
}

/// Returns the table rows of the rendered slices, followed by the table rows of every capture configuration.
fn tables(report: &Report) -> impl Iterator<Item = (&str, &[Row])> {
    let through = report.through.iter().map(|t| (t.label.as_str(), &t.rows[..]));
    [("", &report.rows[..])].into_iter().chain(through)
}

fn table_csv(report: &Report) -> String {
    let mut out = String::from(
        "metric,unit,method,source,mean,standard_error,variants,seeds,ours_less_this,standard_error_of_difference,captured\n",
    );
    for (label, row) in tables(report).flat_map(|(label, rows)| rows.iter().map(move |row| (label, row))) {
        let difference = row.ours_less_this;
        let of = |f: fn(&Estimate) -> f64| difference.as_ref().map_or(String::new(), |d| cell(f(d)));
        let cells = [
            quoted(row.metric.name),
            quoted(row.metric.unit),
            quoted(row.method.name),
            quoted(row.method.source),
            cell(row.value.mean),
            cell(row.value.error),
            row.value.counts[0].to_string(),
            row.value.counts[1].to_string(),
            of(|d| d.mean),
            of(|d| d.error),
            quoted(label),
        ];
        out += &(cells.join(",") + "\n");
    }
    out
}

fn scores_csv(report: &Report) -> String {
    let mut out = String::from("metric,method,variant,seed,value,captured\n");
    let own = report.scores.iter().map(|s| ("", s));
    let through = report.through.iter();
    let others = through.flat_map(|t| t.scores.iter().map(|s| (t.label.as_str(), s)));
    for (label, (seed, s)) in own.chain(others) {
        let [metric, method, label] = [quoted(s.metric), quoted(s.method), quoted(label)];
        out += &format!("{metric},{method},{},{seed},{},{label}\n", s.variant, cell(s.value));
    }
    out
}

/// Returns the content of `report.json`.
pub fn document(application: &Application, report: &Report) -> Value {
    let estimate = |e: &Estimate| json!({"mean": e.mean, "standard_error": e.error, "variants": e.counts[0], "seeds": e.counts[1]});
    let rows = |rows: &[Row]| -> Vec<Value> {
        rows.iter()
            .map(|r| {
                json!({
                    "metric": r.metric.name, "unit": r.metric.unit, "more_is_better": r.metric.more_is_better,
                    "method": r.method.name, "source": r.method.source,
                    "value": estimate(&r.value), "ours_less_this": r.ours_less_this.as_ref().map(estimate),
                })
            })
            .collect()
    };
    let through: Vec<Value> = report
        .through
        .iter()
        .map(|t| {
            json!({
                "captured": t.label, "pixels": t.count.pixels, "clipped": t.count.clipped, "rows": rows(&t.rows),
            })
        })
        .collect();
    let plan = &application.plan;
    json!({
        "application": application.name, "shows": application.shows,
        "by": format!("sunstone {}", env!("CARGO_PKG_VERSION")),
        "scene": plan.scene, "train": plan.train, "test": plan.test,
        "pixels": report.size.pixels, "spp": report.size.spp, "seeds": report.seeds,
        "rows": rows(&report.rows), "through": through, "notes": report.first.notes,
    })
}

/// A page of images: the file name, the title, and the images with labels.
type Page<'a> = (String, String, Vec<(String, &'a Picture)>);

/// Groups images into pages. Images that share a unit are grouped by variant, and all other images by method.
fn pages(pictures: &[Picture]) -> Vec<Page<'_>> {
    let mut all: BTreeMap<(String, String), Vec<(String, &Picture)>> = BTreeMap::new();
    for p in pictures {
        let variant = p.variant.map(|v| format!("variant {v}"));
        let (page, label) = match (&variant, p.shared) {
            (Some(v), true) => (v.clone(), p.method.to_owned()),
            (v, _) => (p.method.to_owned(), v.clone().unwrap_or_default()),
        };
        all.entry((p.name.to_owned(), page)).or_default().push((label, p));
    }
    all.into_iter()
        .map(|((name, page), list)| {
            let plain = |c: char| {
                if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' }
            };
            let file = format!("{name}_{page}").chars().map(plain).collect();
            (file, format!("{name}: {page}"), list)
        })
        .collect()
}

fn draw(path: &Path, title: &str, page: &[(String, &Picture)]) -> Result<(), ReportError> {
    let mut drawn = vec![];
    for (label, picture) in page {
        let map = &picture.map;
        let channels = map.channels.max(1);
        // Images of learned quantities are drawn for each wavelength. Other images are averaged over
        // wavelengths.
        let apart = picture.variant.is_none() && channels > 1;
        for channel in 0..if apart { channels } else { 1 } {
            let value = |pixel: &[f64]| {
                let v = if apart { pixel[channel] } else { pixel.iter().sum::<f64>() / channels as f64 };
                v as f32
            };
            drawn.push(maps::Map {
                label: if apart { format!("wavelength {}", channel + 1) } else { label.clone() },
                caption: String::new(),
                width: map.width,
                data: map.data.chunks_exact(channels).map(value).collect(),
            });
        }
    }
    let values = || drawn.iter().flat_map(|m| m.data.iter().copied()).filter(|v| v.is_finite());
    let most = values().fold(0.0, |m: f32, v| m.max(v.abs()));
    let quantity = if values().any(|v| v < 0.0) && most > 0.0 {
        Quantity::Signed { limit: most }
    } else {
        Quantity::Size
    };
    let drawing = maps::draw(title, &drawn, COLUMNS.min(drawn.len()), "value", quantity, &[])?;
    Ok(figure::save(&drawing, path)?)
}
