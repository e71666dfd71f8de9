//! Resolves paths in a TOML document. A path consists of dotted keys. List elements are addressed by name,
//! or by index from 0.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Splits a path in TOML notation into keys. Returns `None` if the text is not a valid path.
pub(crate) fn keys(path: &str) -> Option<Vec<String>> {
    let line = format!("{path} = 0");
    let table = DeTable::parse(&line).ok()?.into_inner();
    let mut keys = vec![];
    let mut here = DeValue::Table(table);
    let mut end = 0;
    while let DeValue::Table(table) = here {
        let mut entries = table.into_iter();
        let (key, value) = entries.next()?;
        if entries.next().is_some() {
            return None;
        }
        end = key.span().end;
        keys.push(key.into_inner().into_owned());
        here = value.into_inner();
    }
    // Refuse a path that contains anything other than keys, such as a comment or a value.
    (here.as_integer().is_some_and(|n| n.as_str() == "0") && end == path.trim_end().len()).then_some(keys)
}

/// Returns the value at a path. If the path does not exist, returns an error that lists the existing keys at
/// the last valid part of the path.
pub(crate) fn find<'t, 'i>(
    document: &'t mut DeTable<'i>,
    keys: &[String],
) -> Result<&'t mut Spanned<DeValue<'i>>, String> {
    let (first, rest) = keys
        .split_first()
        .ok_or_else(|| "the path is empty; give a path with at least one key".to_owned())?;
    let known = known(document.keys().map(|k| k.get_ref().as_ref()));
    let mut here = document.get_mut(first.as_str()).ok_or(known)?;
    for key in rest {
        let known = known_in(here.get_ref());
        here = match here.get_mut() {
            DeValue::Table(table) => table.get_mut(key.as_str()),
            DeValue::Array(list) => position(list, key).and_then(|i| list.get_mut(i)),
            _ => None,
        }
        .ok_or(known)?;
    }
    Ok(here)
}

/// Returns the same value as [`find`], without mutable access to the document.
pub(crate) fn find_in<'t, 'i>(
    document: &'t DeTable<'i>,
    keys: &[String],
) -> Option<&'t Spanned<DeValue<'i>>> {
    let (first, rest) = keys.split_first()?;
    rest.iter().try_fold(document.get(first.as_str())?, |here, key| match here.get_ref() {
        DeValue::Table(table) => table.get(key.as_str()),
        DeValue::Array(list) => list.get(position(list, key)?),
        _ => None,
    })
}

/// Returns the index of the list element whose name is `key`. If no element has this name, parses `key` as an
/// index.
fn position(list: &[Spanned<DeValue>], key: &str) -> Option<usize> {
    let named = |v: &Spanned<DeValue>| {
        let name = v.get_ref().as_table().and_then(|t| t.get("name"));
        name.and_then(|n| n.get_ref().as_str()) == Some(key)
    };
    list.iter().position(named).or_else(|| key.parse().ok().filter(|i| *i < list.len()))
}

/// Lists the existing keys, at most 12, as a fix for an error message.
fn known<'k>(keys: impl Iterator<Item = &'k str>) -> String {
    let mut all: Vec<&str> = keys.collect();
    let more = all.len().saturating_sub(12);
    all.truncate(12);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("known keys: {}{more}", all.join(", "))
}

fn known_in(value: &DeValue) -> String {
    match value {
        DeValue::Table(table) => known(table.keys().map(|k| k.get_ref().as_ref())),
        DeValue::Array(list) => {
            let names = list.iter().filter_map(|v| v.get_ref().as_table()?.get("name")?.get_ref().as_str());
            let names: Vec<&str> = names.collect();
            if names.is_empty() {
                format!("expected the index of a list of length {} (indices start at 0)", list.len())
            } else {
                known(names.into_iter())
            }
        }
        other => format!("the path ends at {}, which has no keys", article(other.type_str())),
    }
}

pub(crate) fn article(kind: &str) -> String {
    let vowel = kind.starts_with(['a', 'e', 'i', 'o', 'u']);
    format!("{} {kind}", if vowel { "an" } else { "a" })
}
