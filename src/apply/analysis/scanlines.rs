//! Images of scanlines for named elements (Fig. 3 c and d). One set shows camera column against projector
//! column. A second set shows camera column against travel time.

use crate::application::Picture;
use crate::error::ApplyError;
use crate::isolation::seen::TRANSIENT;
use crate::map::Map;
use crate::observation::Observation;
use tensor::array::Tensor;
use tensor::axes::AxisKind;

/// Name of the slice that resolves camera column and projector column for one camera row.
pub(super) const SPACE: &str = "ss";

/// Row of the time scanline as a fraction of the image's height. [`SPACE`] has the same row in the scene
/// file.
const ROW: f64 = 77.0 / 128.0;

/// Elements to draw. The elements measure intensity, preserved linear polarization, reversed handedness of
/// circular polarization, and polarizance.
const SHOWN: [(&str, usize, usize, f64); 5] = [
    ("(0,0)", 0, 0, 1.0),
    ("(1,1)", 1, 1, 1.0),
    ("-(2,2)", 2, 2, -1.0),
    ("-(3,3)", 3, 3, -1.0),
    ("(1,0)", 1, 0, 1.0),
];

/// Returns the names of the drawn elements.
pub(super) fn elements() -> impl Iterator<Item = &'static str> {
    SHOWN.iter().map(|(name, ..)| *name)
}

/// Draws an element of a camera row. Columns increase from left to right, and the axis `up` increases from
/// bottom to top.
fn scanline(t: &Tensor, row: usize, up: AxisKind, [i, j]: [usize; 2], sign: f64) -> Map {
    let height = t.extent(up);
    Map::from_fn(t.extent(AxisKind::X), height, t.extent(AxisKind::Wavelength), |x, y, out| {
        for (lane, o) in out.iter_mut().enumerate() {
            let place = [
                (AxisKind::Y, row),
                (AxisKind::X, x),
                (up, height - 1 - y),
                (AxisKind::StokesOut, i),
                (AxisKind::StokesIn, j),
                (AxisKind::Wavelength, lane),
            ];
            *o = sign * f64::from(t.at(&place));
        }
    })
}

/// Returns the 98th percentile of the nonzero values of a scanline.
fn brightest(intensity: &Map) -> f64 {
    let mut lit: Vec<f64> = intensity.data.iter().copied().filter(|v| *v > 0.0).collect();
    lit.sort_by(f64::total_cmp);
    lit.get(lit.len() * 98 / 100).copied().unwrap_or(0.0)
}

fn clipped(mut map: Map, bright: f64) -> Map {
    for v in &mut map.data {
        *v = v.max(-bright).min(bright);
    }
    map
}

/// Draws all scanlines of a variant.
///
/// # Errors
/// [`ApplyError::Missing`] if a slice is missing, and [`ApplyError::Axis`] if a slice lacks an axis.
pub(super) fn pictures(o: &Observation) -> Result<Vec<Picture>, ApplyError> {
    let mut out = vec![];
    for (slice, name, up, axis) in [
        (SPACE, "s-s' scanline", AxisKind::U, "projector columns and Mueller matrices"),
        (TRANSIENT, "x-t scanline", AxisKind::T, "travel time and Mueller matrices"),
    ] {
        let t = &o.slice(slice)?.mean;
        let matrices = [AxisKind::StokesOut, AxisKind::StokesIn].map(|k| t.extent(k));
        if t.find(up).is_none() || matrices != [4, 4] {
            return Err(ApplyError::Axis { variant: o.variant, slice: slice.to_owned(), axis });
        }
        let rows = t.extent(AxisKind::Y);
        let row = ((ROW * rows as f64) as usize).min(rows.saturating_sub(1));
        // Highlights are much brighter than everything else, so values are clipped at the 98th percentile.
        let bright = brightest(&scanline(t, row, up, [0, 0], 1.0));
        out.extend(SHOWN.iter().map(|&(method, i, j, sign)| Picture {
            method,
            name,
            variant: Some(o.variant),
            shared: true,
            map: clipped(scanline(t, row, up, [i, j], sign), bright),
        }));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::tests::slice;

    #[test]
    fn time_runs_upward_in_the_row_that_is_drawn() {
        let s = slice([5, 10, 4, 2], 0.0, |p, bin, e, lane| (1000 * p + 100 * bin + 2 * e + lane) as f64);
        let map = scanline(&s.mean, 6, AxisKind::T, [3, 3], -1.0);
        assert_eq!((map.width, map.height, map.channels), (5, 4, 2));
        // Row 6, column 2 is pixel 32. The top row of the map shows the last bin.
        assert_eq!(map.at(2, 0), [-(32_000.0 + 300.0 + 30.0), -(32_000.0 + 300.0 + 31.0)]);
        assert_eq!(map.at(2, 3), [-32_030.0, -32_031.0]);
    }
}
