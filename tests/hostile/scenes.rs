//! Tests that the program reports invalid values. The scene contains every key, and the tests replace its
//! values, one at a time.

use super::case::{Case, Expect, Put};
use std::collections::BTreeSet;
use toml::{Table, Value};

/// A scene with every key of the syntax.
const SCENE: &str = include_str!("scene.toml");
/// Valid replacements, with one `key = value` per line.
const ACCEPTED: &str = include_str!("accepted.txt");

/// Returns the value at a key or index.
fn child<'a>(value: &'a mut Value, step: &str) -> &'a mut Value {
    match value {
        Value::Table(table) => &mut table[step],
        Value::Array(list) => &mut list[step.parse::<usize>().expect("an index")],
        _ => unreachable!("paths lead through tables and lists"),
    }
}

/// Collects all paths of a document. For a list of plain values, the function collects only the path of the
/// first entry.
fn places(value: &Value, at: &[String], out: &mut Vec<Vec<String>>) {
    let children: Vec<(String, &Value)> = match value {
        Value::Table(table) => table.iter().map(|(key, child)| (key.clone(), child)).collect(),
        Value::Array(list) => {
            let plain = list.iter().all(|v| !v.is_table() && !v.is_array());
            let some = list.iter().take(if plain { 1 } else { list.len() });
            some.enumerate().map(|(i, child)| (i.to_string(), child)).collect()
        }
        _ => vec![],
    };
    for (step, child) in children {
        let path = [at, &[step]].concat();
        out.push(path.clone());
        places(child, &path, out);
    }
}

fn is_vector(value: &Value) -> bool {
    let number = |v: &Value| v.is_float() || v.is_integer();
    value.as_array().is_some_and(|l| l.len() == 3 && l.iter().all(number))
}

/// Sets the value at a path, or removes the value.
fn set(document: &mut Value, path: &[String], new: Option<Value>) {
    let (last, way) = path.split_last().expect("a place");
    let parent = way.iter().fold(document, |value, step| child(value, step));
    match (parent, new) {
        (parent, Some(new)) => *child(parent, last) = new,
        (Value::Table(table), None) => drop(table.remove(last)),
        (Value::Array(list), None) => drop(list.remove(last.parse().expect("an index"))),
        _ => unreachable!("paths lead through tables and lists"),
    }
}

/// Returns named replacement values.
fn damaged() -> Vec<(&'static str, Option<Value>)> {
    vec![
        ("nan", Some(Value::Float(f64::NAN))),
        ("inf", Some(Value::Float(f64::INFINITY))),
        ("-1", Some(Value::Integer(-1))),
        ("0", Some(Value::Integer(0))),
        ("1e308", Some(Value::Float(1e308))),
        ("text", Some(Value::String("no such thing".into()))),
        ("empty", Some(Value::String(String::new()))),
        ("list", Some(Value::Array(vec![]))),
        ("table", Some(Value::Table(Table::new()))),
        ("missing", None),
        ("zeros", Some(Value::Array(vec![Value::Float(0.0); 3]))),
    ]
}

/// Returns one document for every path and every replacement value. The name of each document is `path =
/// value`.
pub fn spoil(document: &Value) -> Vec<(String, Value)> {
    let mut all = vec![];
    places(document, &[], &mut all);
    let mut out = vec![];
    for place in all {
        for (name, value) in damaged() {
            let mut text = document.clone();
            // The replacement `zeros` applies to vectors only.
            let old = place.iter().fold(&mut text, |value, step| child(value, step));
            if name == "zeros" && !is_vector(old) {
                continue;
            }
            set(&mut text, &place, value);
            out.push((format!("{} = {name}", place.join(".")), text));
        }
    }
    out
}

pub fn cases() -> Vec<Case> {
    let accepted: BTreeSet<&str> = ACCEPTED.lines().filter(|l| !l.starts_with('#')).collect();
    let mut cases = vec![
        Case::new("scene as it is", "info scene.toml")
            .put("scene.toml", Put::Text(SCENE.into()))
            .expect(Expect::Accepted),
    ];
    for (key, value) in spoil(&Value::Table(SCENE.parse().expect("TOML"))) {
        let expect = if accepted.contains(key.as_str()) { Expect::Accepted } else { Expect::Refused };
        let text = toml::to_string(&value).expect("TOML");
        // The command that draws the figures parses the figure keys.
        let command =
            if key.starts_with("figures") { "render scene.toml -o s.zarr" } else { "info scene.toml" };
        let case = Case::new(format!("scene {key}"), command);
        cases.push(case.put("scene.toml", Put::Text(text)).expect(expect));
    }
    cases
}
