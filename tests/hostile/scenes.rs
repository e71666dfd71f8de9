//! A scene with every key; every value is replaced by invalid ones, one at a time.

use crate::case::{Case, Expect, Put};
use std::collections::BTreeSet;
use toml::{Table, Value};

/// A scene with every key of the syntax.
const SCENE: &str = include_str!("scene.toml");
/// Cases that are valid after all: one `key = value` per line.
const ACCEPTED: &str = include_str!("accepted.txt");

/// A step into a document.
#[derive(Clone, Debug)]
enum Step {
    Key(String),
    Index(usize),
}

fn shown(path: &[Step]) -> String {
    let word = |s: &Step| match s {
        Step::Key(k) => k.clone(),
        Step::Index(i) => i.to_string(),
    };
    path.iter().map(word).collect::<Vec<_>>().join(".")
}

/// All paths of a document; of a list of plain values only the first entry.
fn places(value: &Value, at: &mut Vec<Step>, out: &mut Vec<Vec<Step>>) {
    if !at.is_empty() {
        out.push(at.clone());
    }
    match value {
        Value::Table(table) => {
            for (key, child) in table {
                at.push(Step::Key(key.clone()));
                places(child, at, out);
                at.pop();
            }
        }
        Value::Array(list) => {
            let plain = list.iter().all(|v| !v.is_table() && !v.is_array());
            for (i, child) in list.iter().enumerate().take(if plain { 1 } else { list.len() }) {
                at.push(Step::Index(i));
                places(child, at, out);
                at.pop();
            }
        }
        _ => {}
    }
}

/// Whether the value at a path is three numbers.
fn is_vector(scene: &Value, path: &[Step]) -> bool {
    let mut value = scene;
    for step in path {
        let next = match step {
            Step::Key(k) => value.get(k),
            Step::Index(i) => value.get(i),
        };
        value = next.expect("a place");
    }
    let number = |v: &Value| v.is_float() || v.is_integer();
    value.as_array().is_some_and(|l| l.len() == 3 && l.iter().all(number))
}

/// Sets the value at a path, or removes it.
fn set(value: &mut Value, path: &[Step], new: Option<Value>) {
    let (last, way) = path.split_last().expect("a place");
    let mut parent = value;
    for step in way {
        parent = match (step, parent) {
            (Step::Key(k), Value::Table(t)) => t.get_mut(k).expect("a key"),
            (Step::Index(i), Value::Array(l)) => &mut l[*i],
            _ => panic!("no such place"),
        };
    }
    match (last, parent, new) {
        (Step::Key(k), Value::Table(t), Some(v)) => drop(t.insert(k.clone(), v)),
        (Step::Key(k), Value::Table(t), None) => drop(t.remove(k)),
        (Step::Index(i), Value::Array(l), Some(v)) => l[*i] = v,
        (Step::Index(i), Value::Array(l), None) => drop(l.remove(*i)),
        _ => panic!("no such place"),
    }
}

/// Replacement values, by name.
fn spoilt() -> Vec<(&'static str, Option<Value>)> {
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

/// The document, once for every path and every replacement value, with `path = value`.
pub fn spoil(document: &Value) -> Vec<(String, Value)> {
    let mut all = vec![];
    places(document, &mut vec![], &mut all);
    let mut out = vec![];
    for place in all {
        for (name, value) in spoilt() {
            // A zero direction only replaces directions.
            if name == "zeros" && !is_vector(document, &place) {
                continue;
            }
            let mut text = document.clone();
            set(&mut text, &place, value);
            out.push((format!("{} = {name}", shown(&place)), text));
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
        // Figures are parsed by the command that draws them.
        let command =
            if key.starts_with("figures") { "render scene.toml -o s.zarr" } else { "info scene.toml" };
        let case = Case::new(format!("scene {key}"), command);
        cases.push(case.put("scene.toml", Put::Text(text)).expect(expect));
    }
    cases
}
