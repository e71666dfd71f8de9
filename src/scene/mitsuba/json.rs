//! Reads a Python dictionary of Mitsuba (`mi.load_dict`), written as JSON, to a tree of plugins.
//!
//! A dictionary with a `type` is a plugin. Dictionaries of type `rgb`, `spectrum` or `ref` are values, as in
//! XML. A list of three numbers is a vector. A list of four rows of four numbers (three rows of three in
//! `to_uv`) is a transform, as returned by `T.matrix.numpy().tolist()`.

use super::plugins;
use super::source::Source;
use super::tree::{Child, Inside, Node, Property, Value};
use base::locate::InputError;
use glam::{DAffine3, DMat3, DVec3};
use jsonc_parser::ast::{self, Value as Json};
use jsonc_parser::common::Ranged;
use std::ops::Range;

const DEEPEST: usize = 32;

/// Returns the `scene` plugin that a JSON text contains.
///
/// # Errors
/// Returns [`InputError`] with a location if the text contains no scene. Errors inside the scene are
/// recorded in `source`.
pub(super) fn scene(source: &Source, text: &str) -> Result<Node, InputError> {
    let strict = jsonc_parser::ParseOptions {
        allow_comments: true,
        allow_loose_object_property_names: false,
        allow_trailing_commas: true,
        ..Default::default()
    };
    let parsed = jsonc_parser::parse_to_ast(text, &jsonc_parser::CollectOptions::default(), &strict);
    let parsed = parsed.map_err(|e| {
        let at = e.range();
        source.error(
            &(at.start..at.end),
            format!("invalid JSON: {}", e.kind()),
            "write the dictionary with Python's json.dump, with matrices as lists",
        )
    })?;
    let Some(Json::Object(object)) = parsed.value else {
        bail!(source, &(0..0), "the file contains no dictionary", "write a scene dictionary as JSON");
    };
    match plugin(source, &object, None, 0)? {
        node if node.kind == "scene" => Ok(node),
        node => Err(source.error(
            &node.span,
            format!("expected a dictionary of type scene, got {}", node.kind),
            "give the dictionary of a complete scene: {\"type\": \"scene\", …}",
        )),
    }
}

fn place(of: &impl Ranged) -> Range<usize> {
    of.start()..of.end()
}

fn text_of<'j>(object: &'j ast::Object, key: &str) -> Option<&'j str> {
    match &object.get(key)?.value {
        Json::StringLit(text) => Some(&text.value),
        _ => None,
    }
}

fn plugin(
    source: &Source,
    object: &ast::Object,
    name: Option<&str>,
    depth: usize,
) -> Result<Node, InputError> {
    let whole = place(object);
    let Some(kind) = text_of(object, "type") else {
        return Err(source.error(
            &(whole.start..whole.start + 1),
            "the dictionary has no key \"type\"",
            "add \"type\": \"…\" with the name of a Mitsuba plugin",
        ));
    };
    let kind_at = object.get("type").map_or(whole, |p| place(&p.value));
    let Some(tag) = plugins::tag(kind) else {
        return Err(source.error(&kind_at, format!("unknown plugin `{kind}`"), "use a Mitsuba 3 plugin"));
    };
    if depth > DEEPEST {
        return Err(source.error(
            &kind_at,
            "dictionaries are nested too deeply",
            "replace nested dictionaries by references",
        ));
    }
    let mut node = Node {
        tag: tag.to_owned(),
        kind: kind.to_owned(),
        id: text_of(object, "id").or(name.filter(|_| depth == 1)).map(str::to_owned),
        name: name.map(str::to_owned),
        span: kind_at,
        properties: vec![],
        children: vec![],
        broken: false,
    };
    for p in &object.properties {
        let read = source.accept(property(source, p, &mut node, depth));
        node.broken |= read.is_none();
    }
    Ok(node)
}

fn property(source: &Source, p: &ast::ObjectProp, node: &mut Node, depth: usize) -> Result<(), InputError> {
    let (name, span) = (p.name.as_str(), place(p));
    if matches!(name, "type" | "id") {
        return Ok(());
    }
    let value = match &p.value {
        Json::Object(object) => match text_of(object, "type") {
            Some("rgb") => rgb(source, object)?,
            Some("spectrum") => spectrum(source, object)?,
            Some("ref") => {
                let Some(id) = text_of(object, "id") else {
                    return Err(source.error(&span, "the reference has no `id`", "add the id"));
                };
                let reference = Inside::Reference { id: id.to_owned(), name: Some(name.to_owned()), span };
                node.children.push(Child::new(reference));
                return Ok(());
            }
            _ => {
                let inner = plugin(source, object, Some(name), depth + 1)?;
                node.broken |= inner.broken;
                node.children.push(Child::new(Inside::Node(inner)));
                return Ok(());
            }
        },
        Json::BooleanLit(v) => Value::Boolean(v.value),
        Json::StringLit(v) => Value::Text(v.value.to_string()),
        Json::NumberLit(v) => match (v.value.parse::<i64>(), v.value.parse::<f64>()) {
            (Ok(v), _) => Value::Integer(v),
            (_, Ok(v)) if v.is_finite() => Value::Float(v),
            _ => {
                bail!(source, &span, format!("`{}` is not a number", v.value), "give a finite number");
            }
        },
        Json::Array(list) => {
            let Some(value) = vector(list).or_else(|| matrix(list)) else {
                return Err(source.error(
                    &span,
                    format!("`{name}` is a list that is neither a vector nor a matrix"),
                    "give three numbers, or the rows of a matrix with the last row 0 … 0 1",
                ));
            };
            value
        }
        Json::NullKeyword(_) => {
            return Err(source.error(
                &span,
                format!("the value of `{name}` is null"),
                "give a value, or remove the key",
            ));
        }
    };
    node.properties.push(Property::new(name.to_owned(), value, span));
    Ok(())
}

fn number(value: &Json) -> Option<f64> {
    match value {
        Json::NumberLit(v) => v.value.parse().ok().filter(|v: &f64| v.is_finite()),
        _ => None,
    }
}

fn numbers(list: &ast::Array) -> Option<Vec<f64>> {
    list.elements.iter().map(number).collect()
}

fn vector(list: &ast::Array) -> Option<Value> {
    let v: [f64; 3] = numbers(list)?.try_into().ok()?;
    Some(Value::Vector(DVec3::from_array(v)))
}

fn matrix(list: &ast::Array) -> Option<Value> {
    let row = |r: &Json| match r {
        Json::Array(row) => numbers(row),
        _ => None,
    };
    let rows: Vec<Vec<f64>> = list.elements.iter().map(row).collect::<Option<_>>()?;
    let map = match rows.iter().map(Vec::as_slice).collect::<Vec<_>>()[..] {
        [&[a, b, c, x], &[d, e, f, y], &[g, h, i, z], &[l0, l1, l2, l3]]
            if [l0, l1, l2, l3] == [0.0, 0.0, 0.0, 1.0] =>
        {
            DAffine3::from_mat3_translation(
                DMat3::from_cols_array(&[a, b, c, d, e, f, g, h, i]).transpose(),
                DVec3::new(x, y, z),
            )
        }
        [&[a, b, x], &[d, e, y], &[l0, l1, l2]] if [l0, l1, l2] == [0.0, 0.0, 1.0] => {
            DAffine3::from_mat3_translation(
                DMat3::from_cols_array(&[a, b, 0.0, d, e, 0.0, 0.0, 0.0, 1.0]).transpose(),
                DVec3::new(x, y, 0.0),
            )
        }
        _ => return None,
    };
    Some(Value::Transform(map))
}

fn rgb(source: &Source, object: &ast::Object) -> Result<Value, InputError> {
    let rgb = match object.get("value").map(|p| &p.value) {
        Some(Json::Array(list)) => numbers(list).and_then(|v| <[f64; 3]>::try_from(v).ok()),
        Some(value) => number(value).map(|v| [v; 3]),
        None => None,
    };
    rgb.map(Value::Rgb).ok_or_else(|| {
        source.error(&place(object), "the colour has no value", "add \"value\": [red, green, blue]")
    })
}

fn spectrum(source: &Source, object: &ast::Object) -> Result<Value, InputError> {
    let pairs = match object.get("value").map(|p| &p.value) {
        Some(Json::Array(list)) => {
            let pair = |v: &Json| match v {
                Json::Array(pair) => numbers(pair).and_then(|v| <[f64; 2]>::try_from(v).ok()),
                _ => None,
            };
            let pairs: Option<Vec<[f64; 2]>> = list.elements.iter().map(pair).collect();
            pairs.filter(|p| !p.is_empty() && p.is_sorted_by(|a, b| a[0] < b[0])).map(Value::Pairs)
        }
        Some(value) => number(value).map(Value::Float),
        None => None,
    };
    pairs.ok_or_else(|| {
        source.error(
            &place(object),
            "the spectrum has no values",
            "add \"value\": [[nm, value], …] with increasing wavelengths, or a single number",
        )
    })
}
