//! Formats the results of a trial as a text table, as the same table in CSV, and as a chart.

use sunstone::figure::chart::{Chart, ChartAxis, Series, add_point};
use sunstone::polarimetry::trial::SchemeResult;

/// Formats a number with four decimals, or as `1.234e-3` if four decimals are too few.
pub fn short(v: f64) -> String {
    match v {
        v if !v.is_finite() => "-".to_owned(),
        v if v == 0.0 || (0.01..1000.0).contains(&v) => format!("{v:.4}"),
        v => format!("{v:.3e}"),
    }
}

/// Formats the results of a trial as a text table.
pub fn table(rows: &[SchemeResult]) -> String {
    let mut out = format!(
        "{:<20}  {:>8}  {:>4}  {:>9}  {:<13}  {:>10}  {:>10}  {:>10}  {:>10}  {:>7}\n",
        "scheme",
        "captures",
        "rank",
        "condition",
        "estimate",
        "predicted",
        "RMSE",
        "± (s.e.)",
        "ΔTij/T00",
        "lost %"
    );
    for r in rows {
        out.push_str(&format!(
            "{:<20}  {:>8}  {:>4}  {:>9}  {:<13}  {:>10}  {:>10}  {:>10}  {:>10}  {:>7.3}\n",
            r.name,
            r.captures,
            r.rank,
            short(r.condition),
            r.estimate.name(),
            r.predicted.map_or_else(|| "-".to_owned(), short),
            short(r.rmse),
            short(r.rmse_error),
            short(r.normalized),
            100.0 * r.lost
        ));
    }
    out
}

/// Column names of the CSV table.
const COLUMNS: &str = "scheme,captures,rank,condition,estimate,predicted_rmse,rmse,rmse_std_error,\
                       normalized_error,lost_share";

/// Formats the table as CSV. Unknown values become empty cells.
pub fn csv(rows: &[SchemeResult]) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(vec![]);
    writer.write_record(COLUMNS.split(','))?;
    for r in rows {
        let number = |v: f64| {
            if v.is_finite() { format!("{v:e}") } else { String::new() }
        };
        writer.write_record([
            r.name.clone(),
            r.captures.to_string(),
            r.rank.to_string(),
            number(r.condition),
            r.estimate.name().to_owned(),
            r.predicted.map_or_else(String::new, number),
            number(r.rmse),
            number(r.rmse_error),
            number(r.normalized),
            number(r.lost),
        ])?;
    }
    writer.into_inner().map_err(|e| e.into_error().into())
}

/// Draws the errors against the number of captures, with one line for each kind of scheme. The kind is the
/// scheme's name up to the last space.
pub fn curve(rows: &[SchemeResult]) -> Chart {
    let mut series: Vec<Series> = vec![];
    let mut order: Vec<&SchemeResult> = rows.iter().collect();
    order.sort_by_key(|r| r.captures);
    for row in order {
        let kind = row.name.rsplit_once(' ').map_or(row.name.as_str(), |(kind, _)| kind);
        add_point(&mut series, kind, (row.captures as f64, row.rmse), row.rmse_error);
    }
    Chart {
        title: "Reconstruction error against number of captures".to_owned(),
        x: ChartAxis { label: "captures".to_owned(), ..ChartAxis::default() },
        y: ChartAxis { label: "RMSE / mean T00".to_owned(), log: true, ..ChartAxis::default() },
        series,
        notes: vec![],
    }
}
