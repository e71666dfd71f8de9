//! Parses Mitsuba's volume grids (`.vol`, version 3, 32-bit floats).

use super::error::{ImportError, ImportProblem};

const FIX: &str = "write the grid again with Mitsuba's VolumeGrid";
const HEAD: usize = 48;

#[derive(Clone, Debug, PartialEq)]
pub struct Vol {
    /// Number of points along x, y and z.
    pub size: [usize; 3],
    pub channels: usize,
    /// Bounding box: lowest and highest x, y, z in the volume's coordinates.
    pub bbox: [[f32; 3]; 2],
    /// Finite values, for which the channel index varies fastest, then x, y and z.
    pub values: Vec<f32>,
}

/// Parses a volume grid.
///
/// # Errors
/// Returns [`ImportError`] if the file has another format, is truncated, or has no points or a value that
/// is not finite.
pub fn parse_vol(bytes: &[u8]) -> Result<Vol, ImportError> {
    let refuse = |what: String| Err(ImportError::new(what, FIX));
    if bytes.is_empty() {
        return Err(ImportProblem::EmptyFile.into());
    }
    let (Some(head), true) = (bytes.get(..HEAD), bytes.starts_with(b"VOL")) else {
        return refuse("the file does not start with the header of a Mitsuba volume grid".into());
    };
    let word = |i: usize| head[4 + 4 * i..8 + 4 * i].try_into().unwrap_or_default();
    let whole = |i: usize| i32::from_le_bytes(word(i));
    let number = |i: usize| f32::from_le_bytes(word(i));
    if head[3] != 3 || whole(0) != 1 {
        let what =
            format!("expected a grid of version 3 and type 1, got version {} and type {}", head[3], whole(0));
        return Err(ImportError::new(what, "write 32-bit floats (version 3, type 1)"));
    }
    let counts = [1, 2, 3, 4].map(|i| usize::try_from(whole(i)).unwrap_or(0));
    let total = counts.iter().try_fold(1_usize, |n, c| n.checked_mul(*c));
    let [x, y, z, channels] = counts;
    let numbers = bytes[HEAD..].as_chunks::<4>().0;
    match total {
        Some(0) => {
            return refuse(format!("the grid is empty: {x} x {y} x {z} points with {channels} channels"));
        }
        Some(n) if n <= numbers.len() => {}
        _ => {
            let found = numbers.len();
            return refuse(format!(
                "a grid of {x} x {y} x {z} points with {channels} channels requires more than the {found} values in the file"
            ));
        }
    }
    let values: Vec<f32> = numbers[..total.unwrap_or(0)].iter().map(|b| f32::from_le_bytes(*b)).collect();
    let bbox = [[5, 6, 7], [8, 9, 10]].map(|corner| corner.map(number));
    if let Some(i) = values.iter().position(|v| !v.is_finite()) {
        return refuse(format!("value {i} of the grid is {}, not a finite number", values[i]));
    }
    Ok(Vol { size: [x, y, z], channels, bbox, values })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub fn written(size: [i32; 3], channels: i32, values: &[f32]) -> Vec<u8> {
        let mut out = b"VOL\x03".to_vec();
        for v in [1, size[0], size[1], size[2], channels] {
            out.extend(v.to_le_bytes());
        }
        for v in [0.0, 0.0, 0.0, 1.0, 2.0, 3.0].iter().chain(values) {
            out.extend(v.to_le_bytes());
        }
        out
    }

    #[test]
    fn a_grid_is_read_and_broken_ones_are_refused() {
        let values: Vec<f32> = (0..12).map(|i| i as f32).collect();
        let good = written([3, 2, 1], 2, &values);
        let vol = parse_vol(&good).unwrap();
        assert_eq!((vol.size, vol.channels, &vol.values), ([3, 2, 1], 2, &values));
        assert_eq!(vol.bbox, [[0.0; 3], [1.0, 2.0, 3.0]]);
        for n in 0..good.len() {
            parse_vol(&good[..n]).unwrap_err();
        }
        for (bad, expected) in [
            (written([3, 2, 0], 2, &values), "0 points"),
            (written([3, -2, 1], 2, &values), "0 x 1"),
            (written([i32::MAX; 3], i32::MAX, &values), "the 12 values"),
            (written([3, 2, 1], 2, &[f32::NAN; 12]), "NaN"),
        ] {
            let e = parse_vol(&bad).unwrap_err().to_string();
            assert!(e.contains(expected), "{e}");
        }
    }
}
