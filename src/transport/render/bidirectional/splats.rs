//! Vertices of light subpaths that the camera sees, sorted by pixel.
//!
//! A tile contains some of the camera pixels, but light subpaths reach arbitrary pixels. All light subpaths
//! are therefore traced once in advance. For each vertex that the camera sees, the vertex index and the
//! connection are stored in the list of the pixel. To render the pixel, the subpaths in the list are traced
//! again up to the vertices. A subpath depends only on its number. Each subpath is thus traced several times,
//! but little memory is needed and tiles are independent.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::ops::Range;

#[derive(Default)]
pub(crate) struct Splats {
    /// Index of each pixel's first vertex, followed by the number of vertices.
    first: Vec<u32>,
    points: Vec<Splat>,
}

/// A vertex of a light subpath that the camera sees. The fields are ordered so that there is no padding
/// between fields. [`super::splat_file`] can omit the last field.
#[derive(Clone, Copy, Debug, Pod, PartialEq, Zeroable)]
#[repr(C)]
pub(crate) struct Splat {
    pub walk: WalkNumber,
    /// Density per perpendicular area with which subpaths reach the first vertex behind the interfaces at the
    /// start of the subpath ([`super::connections::Seen`]). The density is NaN if the path through these
    /// interfaces cannot be found from the vertex.
    pub seen: f32,
    /// Weight of the vertex after roulette ([`crate::render::roulette`]).
    pub factor: f32,
    /// Index of the vertex in its subpath.
    pub point: u16,
    /// Branch of the subpath that contains the vertex ([`crate::render::subpath::splitting`]).
    pub lineage: u8,
    /// Number of interfaces on the connection.
    pub interfaces: u8,
    /// Bit mask of the wavelength lanes that use the connection.
    pub lanes: u8,
    pub unused: [u8; 3],
    /// Direction of a refracted connection from the vertex to the camera, or 0 for a straight connection.
    pub dir: [f32; 3],
}

/// Number of a light subpath, which consists of the sample and the index in the sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct WalkNumber {
    pub sample: u32,
    pub walk: u32,
}

/// The numbers of samples, subpaths and pixels.
#[derive(Clone, Copy)]
pub(crate) struct Counts {
    pub samples: u32,
    pub walks: u32,
    pub pixels: u32,
}

impl Counts {
    /// Returns the total number of subpaths.
    pub fn all(self) -> u64 {
        u64::from(self.samples) * u64::from(self.walks)
    }

    /// Returns the range of subpaths in share `share` (counted from 0) of `of` shares.
    pub fn share(self, share: u32, of: u32) -> Range<u64> {
        let upto = |n: u32| (u128::from(self.all()) * u128::from(n) / u128::from(of)) as u64;
        upto(share)..upto(share + 1)
    }

    /// Returns the number of subpath `i`, which consists of the sample and the index in the sample.
    pub fn number(self, i: u64) -> WalkNumber {
        WalkNumber { sample: (i / u64::from(self.walks)) as u32, walk: (i % u64::from(self.walks)) as u32 }
    }
}

/// Divides subpaths into chunks, which are the units of parallel work.
pub(super) mod chunk {
    use rayon::prelude::*;
    use std::ops::Range;

    const CHUNK: u64 = 1 << 12;

    pub fn of(walks: Range<u64>) -> impl IndexedParallelIterator<Item = Range<u64>> {
        let count = (walks.end - walks.start).div_ceil(CHUNK);
        (0..count as usize).into_par_iter().map(move |k| {
            let first = walks.start + k as u64 * CHUNK;
            first..(first + CHUNK).min(walks.end)
        })
    }
}

impl Splats {
    /// Traces all subpaths of all samples with `trace`. The function `trace` passes each visible vertex and
    /// its pixel to a callback. Keeps only the vertices that `wanted` pixels see.
    pub fn new<T: Send>(
        counts: Counts,
        wanted: impl Fn(u32) -> bool + Sync,
        make: impl Fn() -> T + Sync,
        trace: impl Fn(&mut T, WalkNumber, &mut dyn FnMut(u32, Splat)) + Sync,
    ) -> Self {
        // The order does not depend on the number of threads.
        let found: Vec<Vec<(u32, Splat)>> = chunk::of(0..counts.all())
            .map_init(&make, |state, walks| {
                let mut found = vec![];
                for i in walks {
                    trace(state, counts.number(i), &mut |pixel, splat| {
                        if wanted(pixel) {
                            found.push((pixel, splat));
                        }
                    });
                }
                found
            })
            .collect();
        Self::by_pixel(counts.pixels, &found)
    }

    pub fn by_pixel(pixels: u32, found: &[Vec<(u32, Splat)>]) -> Self {
        let mut first = vec![0_u32; pixels as usize + 1];
        for (pixel, _) in found.iter().flatten() {
            first[*pixel as usize + 1] += 1;
        }
        for i in 0..pixels as usize {
            first[i + 1] += first[i];
        }
        let mut next = first.clone();
        let Some((_, any)) = found.iter().flatten().next() else {
            return Self::default();
        };
        let mut points = vec![*any; found.iter().map(Vec::len).sum()];
        for (pixel, splat) in found.iter().flatten() {
            let at = &mut next[*pixel as usize];
            points[*at as usize] = *splat;
            *at += 1;
        }
        Self { first, points }
    }

    /// Returns the vertices of one sample that a pixel sees, in order.
    #[inline]
    pub fn of(&self, pixel: u32, sample: u32) -> &[Splat] {
        let Some(&[begin, end]) = self.first.get(pixel as usize..pixel as usize + 2) else {
            return &[];
        };
        let points = &self.points[begin as usize..end as usize];
        let from = points.partition_point(|p| p.walk.sample < sample);
        let to = points.partition_point(|p| p.walk.sample <= sample);
        // Vertices from a damaged file may be unordered.
        points.get(from..to).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies that each vertex is stored for its pixel, in order.
    #[test]
    fn points_are_found_by_pixel_and_sample() {
        let (samples, walks, pixels) = (7, 3000, 40);
        let ends = |n: WalkNumber| [(n.walk * 7 + n.sample) % 40, n.walk % 13];
        let splat = |walk: WalkNumber, point: u16| Splat {
            walk,
            seen: walk.walk as f32,
            factor: 2.0,
            dir: [0.0, walk.sample as f32, 1.0],
            point,
            lineage: 5,
            interfaces: 2,
            lanes: 7,
            ..Splat::zeroed()
        };
        let splats = Splats::new(
            Counts { samples, walks, pixels },
            |p| p != 5,
            || (),
            |(), n, found| {
                for (point, pixel) in (1..).zip(ends(n)) {
                    found(pixel, splat(n, point));
                }
            },
        );
        for pixel in 0..pixels {
            for sample in 0..samples {
                let want: Vec<Splat> = (0..walks)
                    .map(|walk| WalkNumber { sample, walk })
                    .flat_map(|n| (1..).zip(ends(n)).map(move |(point, at)| (n, point, at)))
                    .filter(|(_, _, at)| pixel != 5 && *at == pixel)
                    .map(|(n, point, _)| splat(n, point))
                    .collect();
                assert_eq!(splats.of(pixel, sample), want);
            }
        }
    }
}
