//! Converts the YAML text of calibration programs to a JSON tree.

use saphyr_parser::{Event, Parser, ScalarStyle};
use serde_json::{Map, Number, Value};

const DEEPEST: usize = 32;

/// A YAML list or table that is being parsed.
enum Open {
    List(Vec<Value>),
    Table(Map<String, Value>, Option<String>),
}

/// Parses the first document of a text.
///
/// # Errors
/// If the text is not valid YAML, returns the byte offset of the fault and a message.
pub(super) fn read(text: &str) -> Result<Value, (usize, String)> {
    // Replace OpenCV's `%YAML:1.0`, which is not a valid YAML directive, by a comment of the same length.
    let plain = match text.strip_prefix("%YAML:") {
        Some(rest) => format!("#YAML:{rest}"),
        None => text.to_owned(),
    };
    let mut open: Vec<Open> = vec![];
    for event in Parser::new_from_str(&plain) {
        let (event, span) = event.map_err(|e| (bytes(&plain, e.marker().index()), e.info().to_owned()))?;
        let at = || bytes(&plain, span.start.index());
        let value = match event {
            Event::SequenceStart(..) => {
                open.push(Open::List(vec![]));
                None
            }
            Event::MappingStart(..) => {
                open.push(Open::Table(Map::new(), None));
                None
            }
            Event::SequenceEnd | Event::MappingEnd => match open.pop() {
                Some(Open::List(list)) => Some(Value::Array(list)),
                Some(Open::Table(map, _)) => Some(Value::Object(map)),
                None => None,
            },
            Event::Scalar(text, style, ..) => Some(scalar(&text, style)),
            Event::Alias(_) => {
                return Err((at(), "YAML aliases are not supported; write the value instead".into()));
            }
            Event::DocumentEnd => break,
            _ => None,
        };
        if open.len() > DEEPEST {
            return Err((at(), format!("lists and tables are nested more than {DEEPEST} levels deep")));
        }
        let Some(value) = value else { continue };
        match open.last_mut() {
            None => return Ok(value),
            Some(Open::List(list)) => list.push(value),
            Some(Open::Table(map, key @ Some(_))) => {
                let key = key.take().unwrap_or_default();
                if map.insert(key.clone(), value).is_some() {
                    return Err((at(), format!("duplicate key `{key}`")));
                }
            }
            Some(Open::Table(_, key)) => {
                *key = Some(match value {
                    Value::String(s) => s,
                    other => other.to_string(),
                });
            }
        }
    }
    Ok(Value::Null)
}

fn scalar(text: &str, style: ScalarStyle) -> Value {
    if style != ScalarStyle::Plain {
        return Value::String(text.to_owned());
    }
    if let Ok(whole) = text.parse::<i64>() {
        return whole.into();
    }
    match text {
        "" | "~" | "null" => Value::Null,
        "true" => true.into(),
        "false" => false.into(),
        _ => match text.parse::<f64>().ok().and_then(Number::from_f64) {
            Some(number) => Value::Number(number),
            None => Value::String(text.to_owned()),
        },
    }
}

/// Converts a character index in a text to a byte offset.
fn bytes(text: &str, characters: usize) -> usize {
    text.char_indices().nth(characters).map_or(text.len(), |(i, _)| i)
}
