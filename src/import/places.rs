//! Parses files with the transforms of many copies of an object: text, or NumPy's `.npy`.

use base::npy::{Element, Header, SIGNATURE};
use glam::{DAffine3, DMat3, DVec3};

/// Returns the transforms that a file lists. The content determines the format. A `.npy` array ([`is_array`])
/// contains n × 3 × 4 or n × 4 × 4 numbers. Any other file contains one matrix per line.
///
/// # Errors
/// Returns a message with the error's location in the file. The caller adds the file's name before the
/// message.
pub fn parse(bytes: &[u8]) -> Result<Vec<DAffine3>, String> {
    if is_array(bytes) { array(bytes) } else { text(bytes) }
}

/// Returns whether bytes begin with the signature of a `.npy` file.
pub fn is_array(bytes: &[u8]) -> bool {
    bytes.starts_with(SIGNATURE)
}

/// Returns the affine map for the rows of a 3×4 or 4×4 matrix. A fourth row must be 0 0 0 1.
fn affine(rows: &[f64]) -> Result<DAffine3, String> {
    if let Some(v) = rows.iter().find(|v| !v.is_finite()) {
        return Err(format!("{v} is not a finite number"));
    }
    if rows.len() == 16 && rows[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err(format!("the last row of the 4×4 matrix is {:?}, not 0 0 0 1", &rows[12..]));
    }
    let column = |j: usize| DVec3::new(rows[j], rows[4 + j], rows[8 + j]);
    Ok(DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(1), column(2)), column(3)))
}

fn text(bytes: &[u8]) -> Result<Vec<DAffine3>, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| ": expected a text file or a .npy file".to_owned())?;
    let mut out = vec![];
    for (line, number) in text.lines().zip(1..) {
        let line = line.split('#').next().unwrap_or_default();
        let words = line.split([' ', ',', ';', '\t']).filter(|w| !w.is_empty());
        let values =
            words.map(|w| w.parse::<f64>().map_err(|_| format!(", line {number}: `{w}` is not a number")));
        let values = values.collect::<Result<Vec<f64>, String>>()?;
        match values.len() {
            0 => {}
            12 | 16 => out.push(affine(&values).map_err(|e| format!(", line {number}: {e}"))?),
            n => return Err(format!(", line {number}: expected 12 or 16 numbers, got {n}")),
        }
    }
    Ok(out)
}

fn array(bytes: &[u8]) -> Result<Vec<DAffine3>, String> {
    let mut elements = bytes;
    let header = Header::read(&mut elements).map_err(|e| format!(": {e}"))?;
    let [n, rows @ (3 | 4), 4] = header.shape[..] else {
        return Err(format!(": expected the shape [n, 3, 4] or [n, 4, 4], got {:?}", header.shape));
    };
    if !matches!(header.element(), Some((Element::Float4 | Element::Float8, _))) {
        let found = header.kind.as_deref().unwrap_or("records");
        return Err(format!(": expected numbers of type f4 or f8, got {found}"));
    }
    let values = header.numbers(elements).ok_or(": the file is truncated")?;
    let copy = |i: usize| -> Vec<f64> {
        let at = |r: usize, c: usize| {
            if header.column_major { values[i + n * (r + rows * c)] } else { values[(i * rows + r) * 4 + c] }
        };
        (0..4 * rows).map(|k| at(k / 4, k % 4)).collect()
    };
    (0..n).map(|i| affine(&copy(i)).map_err(|e| format!(", matrix {i}: {e}"))).collect()
}
