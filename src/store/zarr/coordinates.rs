//! Stores the coordinates of sharded stores in the metadata of the coordinate arrays, so that opening a slice
//! needs no request for the coordinates.
//!
//! Most axes are regular (pixels, time bins) or short (wavelengths, elements of a matrix). The coordinate
//! arrays also contain the coordinates as values, for other programs.

use serde_json::{Map, Value, json};

/// Name of the array attribute with the first coordinate and the step.
const REGULAR: &str = "start_and_step";
/// Name of the array attribute with all coordinates.
const ALL: &str = "values";
/// Maximum number of coordinates in the attribute [`ALL`].
const MOST: usize = 16;

/// Returns a short attribute that represents the coordinates exactly, if such an attribute exists. The value
/// of the attribute is a list of numbers, because formats other than Zarr also support lists.
pub(super) fn describe(coords: &[f64]) -> Option<(String, Value)> {
    let regular = match coords {
        [start, next, ..] => Some((REGULAR, json!([start, next - start]))),
        _ => None,
    };
    let list = (coords.len() <= MOST).then(|| (ALL, json!(coords)));
    let same = |(key, value): &(&str, Value)| {
        // Compare the parsed value, because numbers are stored as text.
        let parsed = serde_json::from_str(&value.to_string()).ok();
        let again =
            parsed.and_then(|value| read(&Map::from_iter([((*key).to_owned(), value)]), coords.len()));
        again.is_some_and(|again| {
            let mut pairs = again.iter().zip(coords);
            pairs.all(|(a, b)| a.to_bits() == b.to_bits())
        })
    };
    let found = [regular, list].into_iter().flatten().find(same);
    found.map(|(key, value)| (key.to_owned(), value))
}

/// Returns whether attributes contain coordinates.
pub(super) fn tell(attributes: &Value) -> bool {
    [REGULAR, ALL].iter().any(|key| attributes.get(key).is_some())
}

/// Reads `n` coordinates from attributes. Returns `None` if the attributes contain no coordinates.
pub(super) fn read(attributes: &Map<String, Value>, n: usize) -> Option<Vec<f64>> {
    let list = |key| -> Option<Vec<f64>> {
        let list = attributes.get(key)?.as_array()?;
        list.iter().map(Value::as_f64).collect()
    };
    match list(REGULAR).as_deref() {
        Some([start, step]) => Some((0..n).map(|i| start + i as f64 * step).collect()),
        _ => list(ALL).filter(|coords| coords.len() == n),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn described_coordinates_are_read_back() {
        let bins: Vec<f64> = (0..640).map(|i| 13012.5 + 25.0 * f64::from(i)).collect();
        let thirds: Vec<f64> = (0..9).map(|i| f64::from(i) / 3.0 + 1e-3 * f64::from(i * i)).collect();
        for coords in [&bins[..], &[450.0, 550.0, 660.0], &[7.0], &[0.0, 1.0], &thirds] {
            let message = describe(coords).expect("evenly spaced");
            assert!(message.1.to_string().len() < 400);
            let attributes = Map::from_iter([message]);
            assert_eq!(read(&attributes, coords.len()).expect("is read"), coords);
            assert!(tell(&Value::Object(attributes)));
        }
        let odd: Vec<f64> = (0..40).map(|i| f64::from(i * i)).collect();
        assert_eq!(describe(&odd), None);
        for other in
            [json!({}), json!({"values": [1.0, 2.0]}), json!({"start_and_step": 1.0}), json!({"values": "x"})]
        {
            assert_eq!(read(other.as_object().expect("a table"), 3), None);
        }
    }
}
