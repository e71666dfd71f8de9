//! Represents drive images of the projector, and finds the projector pixels that each entry of the axes v and
//! u contains.

use tensor::axes::boxes;

/// A drive image: the drive of every projector pixel, 0..1.
#[derive(Clone, Debug, PartialEq)]
pub struct Pattern {
    pub width: u32,
    pub height: u32,
    /// Drives in 0..1, row-major, `width * height` values.
    pub values: Vec<f32>,
}

impl Pattern {
    /// Returns a pattern with the same drive everywhere.
    pub fn uniform(width: u32, height: u32, drive: f32) -> Self {
        Self { width, height, values: vec![drive; width as usize * height as usize] }
    }

    /// Returns whether the drive of every pixel is 1.
    pub fn is_full_on(&self) -> bool {
        self.values.iter().all(|v| *v == 1.0)
    }

    /// Returns the mean drive of a box of pixels. `columns` and `rows` are the first and last column and row,
    /// both included.
    pub(super) fn mean(&self, columns: (u32, u32), rows: (u32, u32)) -> f64 {
        let mut sum = 0.0;
        for y in rows.0..=rows.1 {
            let row = y as usize * self.width as usize;
            let line = &self.values[row + columns.0 as usize..=row + columns.1 as usize];
            sum += line.iter().map(|v| f64::from(*v)).sum::<f64>();
        }
        sum / (f64::from(columns.1 - columns.0 + 1) * f64::from(rows.1 - rows.0 + 1))
    }
}

/// Returns the first and last pixel of each entry of a projector axis. `coords` are the centres of the
/// entries. `bin` is the number of pixels per bin if known (attribute `projector_bin`). `total` is the number
/// of pixels along the axis.
///
/// If `bin` is unknown, consecutive integer coordinates represent single pixels. Fractional coordinates
/// represent bins that cover the axis without gaps from pixel 0. Integer coordinates with gaps are ambiguous
/// and are refused.
pub(super) fn pixels(coords: &[f64], bin: Option<u32>, total: u32) -> Result<Vec<(u32, u32)>, String> {
    let whole = coords.iter().all(|c| c.fract() == 0.0);
    let consecutive = coords.windows(2).all(|w| w[1] - w[0] == 1.0);
    let single = match bin {
        Some(n) => n <= 1,
        None if whole && consecutive => true,
        None if whole => {
            return Err(
                "the attribute `projector_bin` is missing, so it is unknown whether projector pixels are binned; render the slice again"
                    .into(),
            );
        }
        None => false,
    };
    let centre = |c: f64| {
        format!(
            "projector coordinate {c} is not the centre of a block of whole pixels; render the slice again"
        )
    };
    let all = if single {
        if let Some(&bad) = coords.iter().find(|c| !(**c >= 0.0 && c.fract() == 0.0)) {
            return Err(centre(bad));
        }
        coords.iter().map(|&c| (c as u32, c as u32)).collect()
    } else {
        boxes(coords).map_err(centre)?
    };
    if let Some((_, last)) = all.iter().find(|(_, last)| *last >= total) {
        return Err(format!(
            "the slice contains projector pixel {last}: use a pattern of the projector's resolution"
        ));
    }
    let next = all.last().map_or(0, |(_, last)| last + 1);
    if !single && next < total {
        return Err(format!(
            "the slice's bins end at projector pixel {next}: use a pattern of the projector's resolution"
        ));
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_map_to_ranges_of_pixels() {
        assert_eq!(pixels(&[0.0, 1.0, 2.0], None, 3).unwrap(), [(0, 0), (1, 1), (2, 2)]);
        assert_eq!(pixels(&[1.5, 5.5, 8.5], None, 10).unwrap(), [(0, 3), (4, 7), (8, 9)]);
        assert_eq!(pixels(&[1.0, 4.0, 6.5], Some(3), 8).unwrap(), [(0, 2), (3, 5), (6, 7)]);
        assert_eq!(pixels(&[1.0, 4.0], Some(1), 8).unwrap(), [(1, 1), (4, 4)]);
        assert!(pixels(&[1.0, 4.0], None, 8).is_err());
        assert!(pixels(&[1.0, 2.0], None, 2).is_err());
        assert!(pixels(&[1.5, 5.5], None, 16).is_err());
        assert!(pixels(&[f64::NAN], None, 16).is_err());
    }

    #[test]
    fn boxes_give_the_mean_of_their_pixels() {
        let pattern = Pattern { width: 3, height: 2, values: vec![1., 2., 3., 4., 5., 6.] };
        assert_eq!(pattern.mean((1, 2), (0, 1)), 4.0);
    }
}
