//! Finds values of a calibration by name, and converts them to numbers.

use super::document::Document;
use base::locate::InputError;
use serde_json::{Map, Value};

/// A value of a document with its key path.
#[derive(Clone)]
pub(super) struct Node<'a> {
    pub(super) document: &'a Document,
    pub(super) value: &'a Value,
    pub(super) keys: Vec<String>,
}

/// Numbers with their shape, row-major.
pub(super) struct Array {
    pub(super) shape: Vec<usize>,
    pub(super) values: Vec<f64>,
}

/// Normalizes a name to its letters and digits, in lower case.
fn plain(name: &str) -> String {
    let letters = name.chars().filter(char::is_ascii_alphanumeric);
    letters.map(|c| c.to_ascii_lowercase()).collect()
}

impl<'a> Node<'a> {
    pub(super) fn root(document: &'a Document) -> Self {
        Self { document, value: &document.root, keys: vec![] }
    }

    pub(super) fn error(&self, message: &str, help: &str) -> InputError {
        self.document.error(&self.keys, message, help)
    }

    /// Returns the entries of the table, or no entries if the value is not a table.
    pub(super) fn table(&self) -> impl Iterator<Item = (&'a String, &'a Value)> + use<'a> {
        self.value.as_object().into_iter().flat_map(Map::iter)
    }

    fn child(&self, key: &str, value: &'a Value) -> Self {
        Self {
            document: self.document,
            value,
            keys: self.keys.iter().cloned().chain([key.to_owned()]).collect(),
        }
    }

    /// Returns the value of a key with exactly the given name.
    pub(super) fn get(&self, key: &str) -> Option<Self> {
        let value = self.value.as_object()?.get(key).filter(|v| !v.is_null())?;
        Some(self.child(key, value))
    }

    /// Returns the value of the first of `names` that exists. The comparison ignores case and all characters
    /// except letters and digits.
    pub(super) fn any(&self, names: &[&str]) -> Option<Self> {
        names.iter().find_map(|name| {
            let mut of = self.table().filter(|(k, v)| plain(k) == plain(name) && !v.is_null());
            of.next().map(|(k, v)| self.child(k, v))
        })
    }

    pub(super) fn item(&self, i: usize) -> Option<Self> {
        Some(Self { document: self.document, value: self.value.as_array()?.get(i)?, keys: self.keys.clone() })
    }

    pub(super) fn text(&self) -> Option<&'a str> {
        self.value.as_str()
    }

    pub(super) fn number(&self) -> Result<f64, InputError> {
        match self.array()?.values[..] {
            [one] => Ok(one),
            _ => Err(self.error("expected a single number", "write a number")),
        }
    }

    /// Returns an array of numbers from a list, nested lists of equal shape, or a matrix in OpenCV's or ROS's
    /// notation.
    pub(super) fn array(&self) -> Result<Array, InputError> {
        let bad = || self.error("expected an array of finite numbers", "write numbers as lists of rows");
        if let Some(table) = self.value.as_object() {
            let size = |key: &str| table.get(key).and_then(Value::as_u64).map(|n| n as usize);
            let (Some(rows), Some(columns), Some(data)) = (size("rows"), size("cols"), self.get("data"))
            else {
                return Err(bad());
            };
            let values = data.array()?.values;
            if rows.checked_mul(columns).is_none_or(|n| n == 0 || !values.len().is_multiple_of(n)) {
                return Err(self.error(
                    &format!("{rows} rows and {columns} columns do not match {} numbers", values.len()),
                    "write rows × cols numbers",
                ));
            }
            return Ok(Array { shape: vec![rows, columns], values });
        }
        let mut array = Array { shape: vec![], values: vec![] };
        let mut at = self.value;
        while let Value::Array(list) = at {
            array.shape.push(list.len());
            match list.first() {
                Some(first) => at = first,
                None => break,
            }
        }
        fill(self.value, &array.shape, &mut array.values).ok_or_else(bad)?;
        Ok(array)
    }

    /// Returns the `N` numbers of an array of any shape.
    pub(super) fn vector<const N: usize>(&self) -> Result<[f64; N], InputError> {
        let values = self.array()?.values;
        let found = values.len();
        values.try_into().map_err(|_| {
            self.error(
                &format!("expected {N} numbers, got {found} numbers"),
                "choose one of several views, for example with --view 0, or correct the file",
            )
        })
    }

    pub(super) fn matrix<const N: usize>(&self) -> Result<[[f64; N]; N], InputError> {
        let array = self.array()?;
        let square = array.shape == [N, N] || array.values.len() == N * N && array.shape.len() <= 1;
        if !square {
            return Err(self.error(
                &format!("expected shape {N} × {N}, got {:?}", array.shape),
                "write the matrix as a list of rows",
            ));
        }
        Ok(std::array::from_fn(|i| std::array::from_fn(|j| array.values[i * N + j])))
    }

    /// Returns width and height in pixels from a list of two integers.
    pub(super) fn size(&self) -> Result<[u32; 2], InputError> {
        let [w, h] = self.vector::<2>()?;
        self.pixels(w, h)
    }

    /// Checks that width and height in pixels are valid.
    pub(super) fn pixels(&self, w: f64, h: f64) -> Result<[u32; 2], InputError> {
        let whole = |n: f64| n.fract() == 0.0 && (1.0..=32768.0).contains(&n);
        if whole(w) && whole(h) {
            Ok([w as u32, h as u32])
        } else {
            Err(self.error(
                &format!("invalid image size {w} × {h} pixels"),
                "pass a width and height in 1..32768, such as --resolution 640x480",
            ))
        }
    }
}

fn fill(value: &Value, shape: &[usize], out: &mut Vec<f64>) -> Option<()> {
    match (value, shape) {
        (Value::Array(list), [n, shape @ ..]) if list.len() == *n => {
            list.iter().try_for_each(|v| fill(v, shape, out))
        }
        (Value::Number(n), []) => {
            out.push(n.as_f64().filter(|v| v.is_finite())?);
            Some(())
        }
        _ => None,
    }
}
