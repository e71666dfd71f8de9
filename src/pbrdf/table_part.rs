//! Subsets of a measured table. A subset contains the entries nearest to given angles and bands. This module
//! also computes statistics per band.

use transport::material::measured::table::Table;

/// Approximate number of entries used for statistics. Larger tables are subsampled evenly.
const LOOKED_AT: usize = 200_000;

/// Returns the index of the node nearest to an angle. Nodes are in radians, and the angle is in degrees.
/// Returns 0 if there are no nodes.
pub fn nearest_angle(nodes: &[f32], degrees: f32) -> usize {
    let distance = |i: &usize| (nodes[*i] - degrees.to_radians()).abs();
    (0..nodes.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
}

/// Returns the index of the band nearest to a wavelength in nanometres, or `None` if there are no bands.
pub fn nearest_band(bands_nm: &[u16], nm: f64) -> Option<usize> {
    let distance = |i: &usize| (f64::from(bands_nm[*i]) - nm).abs();
    (0..bands_nm.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Statistics of a band of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BandStatistics {
    /// Vacuum wavelength of the band, in nanometres.
    pub nm: u16,
    /// Fraction of the entries that are known, from 0 to 1.
    pub known: f64,
    /// Smallest M00 (BRDF in 1/sr), or infinity if all entries are unknown.
    pub low: f32,
    /// Largest M00 (BRDF in 1/sr).
    pub high: f32,
    /// Mean depolarization index of Gil & Bernabéu (1985). The index is 1 if the matrices do not depolarize,
    /// and 0 if the matrices depolarize completely.
    pub depolarization_index: f64,
}

/// Returns the stride with which [`band_statistics`] subsamples entries. The stride is 1 for small tables.
pub fn statistics_step(table: &Table) -> usize {
    let [p, d, h] = table.angles().map(<[f32]>::len);
    (p * d * h / LOOKED_AT).max(1)
}

/// Returns the statistics of each band, in the order of the bands.
pub fn band_statistics(table: &Table) -> Vec<BandStatistics> {
    let [p, d, h] = table.angles().map(<[f32]>::len);
    let step = statistics_step(table);
    let of = |(band, nm): (usize, &u16)| {
        let (mut seen, mut known, mut low, mut high, mut index) =
            (0_usize, 0_usize, f32::INFINITY, 0.0_f32, 0.0_f64);
        for i in (0..p * d * h).step_by(step) {
            seen += 1;
            let Some(m) = table.entry([i / (d * h), i / h % d, i % h], band) else {
                continue;
            };
            known += 1;
            (low, high) = (low.min(m[0]), high.max(m[0]));
            let square: f64 = m.iter().map(|e| f64::from(*e).powi(2)).sum();
            let m00 = f64::from(m[0]).powi(2);
            index += ((square - m00).max(0.0) / (3.0 * m00.max(1e-30))).sqrt();
        }
        BandStatistics {
            nm: *nm,
            known: known as f64 / seen.max(1) as f64,
            low,
            high,
            depolarization_index: index / known.max(1) as f64,
        }
    };
    table.wavelengths_nm().iter().enumerate().map(of).collect()
}

/// A subset of a table. The subset contains the selected entries along φ_d, θ_d, θ_h and the bands, in this
/// order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TablePart {
    /// Kept indices along each axis.
    pub kept: [Vec<usize>; 4],
    /// Lengths of the axes that are not fixed, in the order of the axes.
    pub shape: Vec<usize>,
}

impl TablePart {
    /// Creates a part of the table. The given angles (φ_d, θ_d, θ_h, in degrees) and the given wavelength (in
    /// nanometres) are fixed at the nearest entries. Axes without a given value are kept.
    pub fn new(table: &Table, angles_deg: [Option<f32>; 3], nm: Option<f32>) -> Self {
        let all = |n: usize| (0..n).collect::<Vec<_>>();
        let angles = table.angles();
        let along = |axis: usize| match angles_deg[axis] {
            Some(degrees) => vec![nearest_angle(angles[axis], degrees)],
            None => all(angles[axis].len()),
        };
        let bands = table.wavelengths_nm();
        let of_bands = match nm {
            Some(nm) => nearest_band(bands, f64::from(nm)).into_iter().collect(),
            None => all(bands.len()),
        };
        let kept = [along(0), along(1), along(2), of_bands];
        let fixed = [angles_deg[0], angles_deg[1], angles_deg[2], nm];
        let stays = kept.iter().zip(fixed).filter(|(_, at)| at.is_none());
        let shape = stays.map(|(list, _)| list.len()).collect();
        Self { kept, shape }
    }

    /// Iterates over the kept entries. The last axis varies fastest. Each item has four indices and the
    /// row-major matrix, which is NaN if unknown.
    pub fn entries<'a>(&'a self, table: &'a Table) -> impl Iterator<Item = ([usize; 4], [f32; 16])> + 'a {
        let count: usize = self.kept.iter().map(Vec::len).product();
        (0..count).map(move |mut i| {
            let mut at = [0; 4];
            for (place, list) in at.iter_mut().zip(&self.kept).rev() {
                *place = list[i % list.len()];
                i /= list.len();
            }
            let m = table.entry([at[0], at[1], at[2]], at[3]).unwrap_or([f32::NAN; 16]);
            (at, m)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use transport::material::measured::axes::Axes;
    use transport::material::measured::table::Options;
    use transport::material::measured::write::write;

    fn made() -> (tempfile::TempDir, Table) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("t.pbsdf");
        let axes = Axes::even([5, 3, 4], vec![450, 650]);
        write(&path, &axes, |i, values| {
            for (k, m) in values.as_chunks_mut::<16>().0.iter_mut().enumerate() {
                *m = [0.0; 16];
                m[0] = (i * 24 + k + 1) as f32;
            }
            if i == 0 {
                values[0] = f32::NAN;
            }
        })
        .expect("is written");
        let table = Table::open(&path, &Options::default()).expect("is sound");
        (folder, table)
    }

    #[test]
    fn parts_keep_the_axes_that_are_not_fixed() {
        let (_folder, table) = made();
        let part = TablePart::new(&table, [Some(0.0), None, Some(91.0)], Some(600.0));
        assert_eq!(part.shape, [3]);
        assert_eq!(part.kept, [vec![2], vec![0, 1, 2], vec![3], vec![1]]);
        let entries: Vec<_> = part.entries(&table).collect();
        assert_eq!(entries.len(), 3);
        assert_eq!(entries[1].0, [2, 1, 3, 1]);
        assert_eq!(entries[1].1[0], (2 * 24 + 8 + 3 * 2 + 1 + 1) as f32);
        assert_eq!(nearest_band(&[], 550.0), None);
    }

    /// Verifies the statistics of a table in which one of 60 entries of the first band is unknown. Matrices
    /// of ideal depolarizers have the depolarization index 0.
    #[test]
    fn band_statistics_of_a_known_table() {
        let (_folder, table) = made();
        assert_eq!(statistics_step(&table), 1);
        let [a, b] = band_statistics(&table)[..] else { panic!("two bands") };
        assert!((a.known - 59.0 / 60.0).abs() < 1e-12 && b.known == 1.0);
        assert_eq!((a.nm, a.low, b.low, b.high), (450, 3.0, 2.0, 120.0));
        assert_eq!((a.depolarization_index, b.depolarization_index), (0.0, 0.0));
    }
}
