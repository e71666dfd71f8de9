//! Reads NumPy archives (`.npz`) to a JSON tree with one array per key.

use base::npy::Header;
use serde_json::{Map, Value};
use std::io::{Cursor, Read};
use zip::ZipArchive;

/// Maximum number of elements of an array. Larger arrays are not part of a calibration and are ignored.
const MOST: u64 = 1 << 16;

/// Reads a NumPy archive.
///
/// # Errors
/// Returns a message that states why the archive cannot be read.
pub(super) fn read(bytes: Vec<u8>) -> Result<Value, String> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| format!("invalid .npz file: {e}"))?;
    let mut out = Map::new();
    for i in 0..archive.len().min(1024) {
        let entry = archive.by_index(i).map_err(|e| format!("invalid .npz file: {e}"))?;
        let name = entry.name().map_err(|e| format!("invalid .npz file: {e}"))?.into_owned();
        let Some(key) = name.strip_suffix(".npy") else {
            continue;
        };
        // Read more bytes than the largest accepted array has.
        let mut bytes = vec![];
        entry.take(16 * MOST).read_to_end(&mut bytes).map_err(|e| format!("cannot read {name}: {e}"))?;
        if let Some(value) = array(&bytes) {
            out.insert(key.to_owned(), value);
        }
    }
    Ok(Value::Object(out))
}

/// Converts an array of an archive to JSON if the array is small and numeric, or a string. Returns `None` for
/// any other content.
fn array(bytes: &[u8]) -> Option<Value> {
    let mut elements = bytes;
    let header = Header::read(&mut elements).ok()?;
    let count = header.shape.iter().try_fold(1_u64, |n, len| n.checked_mul(*len as u64))?;
    if count == 0 || count > MOST {
        return None;
    }
    let values = header.numbers(elements)?;
    if values.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let mut shape = header.shape;
    let mut strides: Vec<usize> = vec![1; shape.len()];
    if header.column_major {
        for k in 1..shape.len() {
            strides[k] = strides[k - 1] * shape[k - 1];
        }
    } else {
        for k in (1..shape.len()).rev() {
            strides[k - 1] = strides[k] * shape[k];
        }
    }
    // Limit the depth of nested lists, since arrays can have many axes of length 1.
    if shape.len() > 8 {
        shape = vec![values.len()];
        strides = vec![1];
    }
    Some(nested(&values, 0, &shape, &strides))
}

fn nested(values: &[f64], start: usize, shape: &[usize], strides: &[usize]) -> Value {
    match (shape, strides) {
        ([n, shape @ ..], [step, strides @ ..]) => {
            (0..*n).map(|i| nested(values, start + i * step, shape, strides)).collect()
        }
        _ => values.get(start).copied().into(),
    }
}
