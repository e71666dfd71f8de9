//! Schemes as CSV tables of angles.

use super::super::element::{Element, Setting};
use super::super::scheme::{Scheme, Sensor};
use super::format::{Text, stem};
use base::locate::InputError;
use std::path::Path;

const COLUMNS: [&str; 6] =
    ["polarizer_1", "retarder_2", "retarder_3", "polarizer_4", "retardance_2", "retardance_3"];

/// Parses a scheme from a CSV table of angles.
///
/// # Errors
/// Returns the same errors as [`load`](super::load).
pub fn from_csv(path: &Path, text: &str) -> Result<Scheme, InputError> {
    let place = Text { path, text: text.into() };
    let help = "use the columns polarizer_1,retarder_2,retarder_3,polarizer_4 in degrees; for retardances other than 90 degrees, add \
                retardance_2 and retardance_3";
    let wrong = |e: csv::Error| {
        let at = e.position().map(|p| p.byte() as usize);
        place.error(at.map(|b| b..b), e.to_string(), help)
    };
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
    let headers = reader.headers().map_err(wrong)?.clone();
    let mut columns: [Option<Vec<f64>>; 6] = [const { None }; 6];
    let mut order = vec![];
    for name in &headers {
        let Some(i) = COLUMNS.iter().position(|c| *c == name) else {
            return Err(place.error(Some(0..0), format!("unknown column `{name}`"), help));
        };
        if columns[i].replace(vec![]).is_some() {
            return Err(place.error(Some(0..0), format!("duplicate column `{name}`"), help));
        }
        order.push(i);
    }
    for record in reader.records() {
        let record = record.map_err(wrong)?;
        let at = record.position().map(|p| p.byte() as usize).map(|b| b..b);
        for (field, i) in record.iter().zip(&order) {
            let value: f64 = field.parse().map_err(|_| {
                place.error(
                    at.clone(),
                    format!("`{field}` in column `{}` is not a number", COLUMNS[*i]),
                    help,
                )
            })?;
            if let Some(column) = &mut columns[*i] {
                column.push(value.to_radians());
            }
        }
    }
    let missing = columns.iter().position(Option::is_none).map_or("", |i| COLUMNS[i]);
    let [p1, r2, r3, p4, d2, d3] = columns;
    let (Some(p1), Some(r2), Some(r3)) = (p1, r2, r3) else {
        return Err(place.error(
            Some(0..0),
            format!("column `{missing}` is missing: polarizer_1, retarder_2 and retarder_3 are required"),
            help,
        ));
    };
    let quarter = || Setting::Fixed(std::f64::consts::FRAC_PI_2);
    let generator = vec![
        Element::polarizer("polarizer_1", Setting::Each(p1)),
        Element::retarder("retarder_2", Setting::Each(r2), d2.map_or_else(quarter, Setting::Each)),
    ];
    let mut analyzer =
        vec![Element::retarder("retarder_3", Setting::Each(r3), d3.map_or_else(quarter, Setting::Each))];
    let sensor = match p4 {
        Some(p4) => {
            analyzer.push(Element::polarizer("polarizer_4", Setting::Each(p4)));
            Sensor::Intensity
        }
        None => Sensor::array(),
    };
    Scheme::new(&stem(path), generator, analyzer, sensor).map_err(|e| place.error(None, e.to_string(), help))
}
