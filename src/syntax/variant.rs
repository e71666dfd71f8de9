//! Variants of a scene: the scene file with values of `[vary]` substituted.
//!
//! Values are substituted in the parsed document and keep their location in the file. An error in a
//! substituted value is therefore reported at its location in `[vary]`.
//!
//! A number drawn from a range is min + u (max - min). The factor u in [0, 1) is a 53-bit hash of the
//! parameter's name, ⌊k / every⌋ and the number's index in the list. The hash is SplitMix64's finalizer
//! (Steele, Lea & Flood 2014). Adding a parameter therefore does not change the values of other parameters.

use crate::path::{article, find, find_in, keys};
use crate::scene::SceneFile;
use crate::vary::{AnyValue, ParameterFile, RangeFile};
use crate::{Syntax, fix};
use base::document;
use base::locate::{InputError, Located};
use optics::sampling::mix::mix;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Keys that do not affect the rendered light, and therefore cannot be varied.
const FIXED: [&str; 3] = ["name", "figures", "vary"];

/// The odd number closest to 2⁶⁴ divided by the golden ratio.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// A variant of a scene.
#[derive(Clone, Debug)]
pub struct Variant {
    /// The scene file with the variant's values.
    pub file: SceneFile,
    /// Values of the variant, by parameter name.
    pub values: BTreeMap<String, toml::Value>,
}

/// Parses a scene file and returns one of its variants. `path` names the file in messages.
///
/// # Errors
/// Returns [`InputError`] if the scene file is invalid or the variant does not exist. Errors in substituted
/// values have locations in `[vary]`.
pub fn read(path: &Path, text: &str, number: u64) -> Result<Variant, InputError> {
    let file = SceneFile::read(path, text)?;
    let vary = Vary::new(path, text, &file)?;
    let fault = |message: String, help: &str| InputError::new(path, text, None, message, help);
    if file.vary.is_empty() {
        return Err(fault(
            format!("variant {number} does not exist: the scene has no [vary] table"),
            "add a [vary] table, or omit --variant",
        ));
    }
    if let Some(count) = vary.count.filter(|n| number >= *n) {
        return Err(fault(
            format!("variant {number} does not exist: the scene has {count} variants, numbered from 0"),
            "give a smaller number, or add values to [vary]",
        ));
    }
    vary.variant(number)
}

/// Checks `[vary]` and returns the number of variants, or `None` if the number is unlimited.
///
/// # Errors
/// Returns [`InputError`] with a location in `[vary]` if the table is invalid.
pub fn count(path: &Path, text: &str, file: &SceneFile) -> Result<Option<u64>, InputError> {
    if file.vary.is_empty() {
        return Ok(Some(0));
    }
    Vary::new(path, text, file).map(|v| v.count)
}

/// The table `[vary]` of a scene file, after checks.
struct Vary<'a> {
    path: &'a Path,
    text: &'a str,
    file: &'a SceneFile,
    /// Keys of all paths, by parameter name.
    keys: BTreeMap<&'a str, Vec<Vec<String>>>,
    count: Option<u64>,
}

impl<'a> Vary<'a> {
    fn new(path: &'a Path, text: &'a str, file: &'a SceneFile) -> Result<Self, InputError> {
        let mut vary = Self { path, text, file, keys: BTreeMap::new(), count: None };
        let mut document = vary.document()?;
        for (name, parameter) in &file.vary {
            let all = vary.check(name, parameter, &mut document)?;
            for (keys, written) in all.into_iter().zip(&parameter.path.0) {
                vary.alone(&keys, written, parameter)?;
                vary.keys.entry(name).or_default().push(keys);
            }
        }
        vary.count = vary.counted()?;
        Ok(vary)
    }

    fn error(&self, span: Range<usize>, message: String, help: impl Into<String>) -> InputError {
        InputError::new(self.path, self.text, Some(span), message, help)
    }

    fn document(&self) -> Result<DeTable<'a>, InputError> {
        let read = DeTable::parse(self.text);
        read.map(Spanned::into_inner).map_err(|e| {
            let span = e.span().unwrap_or(0..0);
            self.error(span, document::plain(e.message()), fix(e.message()))
        })
    }

    /// Checks one parameter and returns the keys of its paths.
    fn check(
        &self,
        name: &str,
        parameter: &Located<ParameterFile>,
        document: &mut DeTable,
    ) -> Result<Vec<Vec<String>>, InputError> {
        if *parameter.every == 0 {
            let help = "give the number of consecutive variants with the same value, at least 1";
            return Err(self.error(
                parameter.every.span(),
                format!("vary.{name}: expected `every` of at least 1, got 0"),
                help,
            ));
        }
        let at = parameter.path.span();
        let paths = &parameter.path.0;
        if paths.is_empty() {
            let help = "give the path of the value to vary, such as path = \"media.milk.milk.concentration\"";
            return Err(self.error(at, format!("vary.{name}: `path` is empty"), help));
        }
        let mut all = vec![];
        for written in paths {
            let keys = keys(written).ok_or_else(|| {
                let help = "write keys separated by dots; quote keys with characters other than letters, digits, _ and -";
                self.error(at.clone(), format!("`{written}` is not a valid path"), help)
            })?;
            if FIXED.contains(&keys[0].as_str()) {
                let message = format!("`{written}`: the key `{}` cannot be varied", keys[0]);
                return Err(self.error(at.clone(), message, "choose a path that affects the rendered scene"));
            }
            let slot = find(document, &keys).map_err(|known| {
                let help = format!(
                    "{known}; add the value to the scene file (a varied value must be present even if it equals the default)"
                );
                self.error(at.clone(), format!("the scene file has no value at `{written}`"), help)
            })?;
            self.kind(name, parameter, slot.get_ref())?;
            all.push(keys);
        }
        Ok(all)
    }

    /// Checks the values or the range of a parameter. The bounds of a range must have the shape of the value
    /// `present`.
    fn kind(&self, name: &str, p: &Located<ParameterFile>, present: &DeValue) -> Result<(), InputError> {
        match (&p.values, &p.range) {
            (Some(values), None) => self.listed(name, values),
            (None, Some(range)) => self.ranged(name, range, present),
            (values, _) => Err(self.error(
                p.span(),
                format!(
                    "vary.{name}: expected exactly one of `values` and `range`, got {}",
                    if values.is_some() { "both" } else { "neither" }
                ),
                "give values = [..], or range = { min = .., max = .. }",
            )),
        }
    }

    fn listed(&self, name: &str, values: &Located<Vec<AnyValue>>) -> Result<(), InputError> {
        if values.is_empty() {
            let message = format!("vary.{name}: `values` is empty");
            return Err(self.error(values.span(), message, "list at least one value"));
        }
        if let Some(i) = values.iter().position(|v| !is_finite(&v.0)) {
            let message = format!("vary.{name}: value {i} is not finite");
            return Err(self.error(values.span(), message, "remove nan and inf"));
        }
        Ok(())
    }

    fn ranged(&self, name: &str, range: &Located<RangeFile>, present: &DeValue) -> Result<(), InputError> {
        let refuse = |message: String, help: &str| Err(self.error(range.span(), message, help));
        let (Some(min), Some(max)) = (numbers(&range.min.0), numbers(&range.max.0)) else {
            return refuse(
                format!("vary.{name}: the limits of the range are not numbers"),
                "give min and max as numbers or as lists of numbers; for other types, use `values`",
            );
        };
        let shape = |v: &AnyValue| v.0.as_array().map(Vec::len);
        let wanted = match present {
            DeValue::Integer(_) | DeValue::Float(_) => None,
            DeValue::Array(list)
                if list.iter().all(|v| v.get_ref().is_integer() || v.get_ref().is_float()) =>
            {
                Some(list.len())
            }
            other => {
                return refuse(
                    format!(
                        "vary.{name}: a range requires a number or a list of numbers at the path, got {}",
                        article(other.type_str())
                    ),
                    "give a path to a number or to a list of numbers, or use `values`",
                );
            }
        };
        if shape(&range.min) != wanted || shape(&range.max) != wanted {
            let expected = wanted.map_or("one number".to_owned(), |n| format!("a list of {n} numbers"));
            return refuse(
                format!(
                    "vary.{name}: the shape of the range does not match the value at the path, which is {expected}"
                ),
                "give min and max with the same shape as the value at the path",
            );
        }
        for (a, b) in min.iter().zip(&max) {
            if !(a.is_finite() && b.is_finite() && a <= b && (b - a).is_finite()) {
                return refuse(
                    format!("vary.{name}: invalid range from {a} to {b}"),
                    "give finite numbers with min <= max",
                );
            }
        }
        Ok(())
    }

    /// Checks that no earlier path sets the same value, a part of this value, or a value that contains this
    /// value.
    fn alone(
        &self,
        keys: &[String],
        written: &str,
        parameter: &Located<ParameterFile>,
    ) -> Result<(), InputError> {
        for (other, paths) in &self.keys {
            if paths.iter().any(|p| p.iter().zip(keys).all(|(a, b)| a == b)) {
                let message = format!("`{written}` overlaps a path of vary.{other}");
                return Err(self.error(parameter.path.span(), message, "remove one of the two paths"));
            }
        }
        Ok(())
    }

    /// Returns the number of different variants, or `None` if any parameter has a range. The number is the
    /// largest product of list length and `every`.
    fn counted(&self) -> Result<Option<u64>, InputError> {
        let mut longest: Option<(&str, u64)> = None;
        let mut endless = false;
        let period = |p: &ParameterFile| p.values.as_ref().map(|v| (v.len() as u64).saturating_mul(*p.every));
        for (name, parameter) in &self.file.vary {
            match period(parameter) {
                None => endless = true,
                Some(n) if longest.is_none_or(|(_, most)| n > most) => longest = Some((name, n)),
                Some(_) => {}
            }
        }
        let Some((name, most)) = longest else {
            return Ok(None);
        };
        for (other, parameter) in &self.file.vary {
            if let Some(n) = period(parameter).filter(|n| !most.is_multiple_of(*n)) {
                let values = parameter.values.as_ref().map_or(0..0, Located::span);
                let message = format!(
                    "vary.{other} covers {n} variants and vary.{name} covers {most} variants, but {most} is not a multiple of {n}"
                );
                let help = "give lists of equal length, or choose `every` so that the larger number of variants is a multiple of the smaller";
                return Err(self.error(values, message, help));
            }
        }
        Ok((!endless).then_some(most))
    }

    fn variant(&self, number: u64) -> Result<Variant, InputError> {
        let index = |p: &ParameterFile| number / *p.every;
        // The TOML texts of the drawn values, from which the parsed document borrows.
        let mut drawn = BTreeMap::new();
        for (name, p) in &self.file.vary {
            if let Some(range) = &p.range {
                drawn.insert(name.as_str(), (draw(name, index(p), range).to_string(), range.span()));
            }
        }
        let mut document = self.document()?;
        let original = document.clone();
        let mut values = BTreeMap::new();
        for (name, p) in &self.file.vary {
            let value = match (drawn.get(name.as_str()), &p.values) {
                (Some((text, span)), _) => {
                    let parsed = DeValue::parse(text).map_err(|e| {
                        self.error(span.clone(), e.message().to_owned(), "give finite numbers")
                    })?;
                    values.insert(name.clone(), text.parse().unwrap_or(toml::Value::String(text.clone())));
                    moved(parsed.into_inner(), span)
                }
                (None, Some(list)) => {
                    let i = (index(p) % list.len() as u64) as usize;
                    values.insert(name.clone(), list[i].0.clone());
                    let own = ["vary".to_owned(), name.clone(), "values".to_owned(), i.to_string()];
                    let found = find_in(&original, &own);
                    found.cloned().ok_or_else(|| {
                        self.error(
                            list.span(),
                            format!("vary.{name}: value {i} is missing from `values`"),
                            "add the value to `values`",
                        )
                    })?
                }
                (None, None) => continue,
            };
            for keys in &self.keys[name.as_str()] {
                if let Ok(slot) = find(&mut document, keys) {
                    *slot = value.clone();
                }
            }
        }
        let table = Spanned::new(0..self.text.len(), document);
        let file = document::parse_table(self.path, self.text, table, fix)?;
        Ok(Variant { file, values })
    }
}

/// Sets the location of a drawn value to the location of the value's range in the file.
fn moved<'i>(value: DeValue<'i>, span: &Range<usize>) -> Spanned<DeValue<'i>> {
    let value = match value {
        DeValue::Array(list) => {
            DeValue::Array(list.iter().map(|v| moved(v.get_ref().clone(), span)).collect())
        }
        other => other,
    };
    Spanned::new(span.clone(), value)
}

/// Returns the numbers of a TOML number or list of numbers, or `None` for other values.
fn numbers(value: &toml::Value) -> Option<Vec<f64>> {
    let one = |v: &toml::Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
    match value {
        toml::Value::Array(list) => list.iter().map(one).collect(),
        single => one(single).map(|v| vec![v]),
    }
}

fn is_finite(value: &toml::Value) -> bool {
    match value {
        toml::Value::Float(v) => v.is_finite(),
        toml::Value::Array(list) => list.iter().all(is_finite),
        toml::Value::Table(table) => table.values().all(is_finite),
        _ => true,
    }
}

/// Draws a value from a range.
fn draw(name: &str, index: u64, range: &RangeFile) -> toml::Value {
    let key = name.bytes().fold(0, |key, byte| mix(key ^ u64::from(byte)).wrapping_add(GOLDEN));
    let number = |place: usize, min: f64, max: f64| {
        let bits =
            mix(mix(key ^ mix(index.wrapping_add(GOLDEN))).wrapping_add((place as u64).wrapping_mul(GOLDEN)));
        let u = (bits >> 11) as f64 / (1_u64 << 53) as f64;
        (min + u * (max - min)).clamp(min, max)
    };
    let ends = numbers(&range.min.0).zip(numbers(&range.max.0)).unwrap_or_default();
    let drawn =
        ends.0.iter().zip(&ends.1).enumerate().map(|(i, (a, b))| toml::Value::Float(number(i, *a, *b)));
    let drawn: Vec<toml::Value> = drawn.collect();
    match (range.min.0.is_array(), &drawn[..]) {
        (false, [one]) => one.clone(),
        _ => toml::Value::Array(drawn),
    }
}

#[cfg(test)]
mod tests;
