//! Coordinates that the description of their array tells: of stores in shards, so that opening a slice takes no request for them.
//!
//! Most axes are regular (pixels, bins of time) or short (wavelengths, elements of a matrix). Their arrays have them all the same,
//! for other programs.

use serde_json::{Value, json};

/// Attribute of the array: first coordinate and step, or a list.
pub(super) const VALUES: &str = "values";
/// Longest list.
const LIST: usize = 16;

/// What tells these coordinates, if anything short does, to the bit.
pub(super) fn told(coords: &[f64]) -> Option<Value> {
    let regular = match coords {
        [start, next, ..] => Some(json!({"start": start, "step": next - start})),
        _ => None,
    };
    let list = (coords.len() <= LIST).then(|| json!(coords));
    let same = |value: &Value| {
        // As it will be read: numbers go through a text.
        let read = serde_json::from_str(&value.to_string()).ok();
        let read = read.and_then(|value| read_values(&value, coords.len()));
        read.is_some_and(|read| read.iter().zip(coords).all(|(a, b)| a.to_bits() == b.to_bits()))
    };
    [regular, list].into_iter().flatten().find(same)
}

/// `n` coordinates that are told; `None` if they are not.
pub(super) fn read_values(value: &Value, n: usize) -> Option<Vec<f64>> {
    if let Some(list) = value.as_array() {
        let coords: Vec<f64> = list.iter().map(Value::as_f64).collect::<Option<_>>()?;
        return (coords.len() == n).then_some(coords);
    }
    let [start, step] = ["start", "step"].map(|key| value[key].as_f64());
    let (start, step) = start.zip(step)?;
    Some((0..n).map(|i| start + i as f64 * step).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_is_read() {
        let bins: Vec<f64> = (0..640).map(|i| 13012.5 + 25.0 * f64::from(i)).collect();
        let thirds: Vec<f64> = (0..9)
            .map(|i| f64::from(i) / 3.0 + 1e-3 * f64::from(i * i))
            .collect();
        for coords in [&bins[..], &[450.0, 550.0, 660.0], &[7.0], &[0.0, 1.0], &thirds] {
            let value = told(coords).expect("is told");
            assert!(value.to_string().len() < 400);
            assert_eq!(read_values(&value, coords.len()).expect("is read"), coords);
        }
        let odd: Vec<f64> = (0..40).map(|i| f64::from(i * i)).collect();
        assert_eq!(told(&odd), None);
        assert_eq!(read_values(&json!([1.0, 2.0]), 3), None);
        assert_eq!(read_values(&json!({"start": 1.0}), 3), None);
        assert_eq!(read_values(&json!("x"), 3), None);
    }
}
