//! Which points of walks from the light the camera sees, and in which pixel.
//!
//! Tiles own camera pixels, but light falls where it will. So all walks from the light are made once beforehand, and of
//! each point that the camera sees only its number is kept, under the pixel, with the way there. A pixel then makes its
//! walks again, up to these points: they depend on their numbers alone. That costs a walk more than once, and keeps what
//! is live small and every tile independent of the others.

use rayon::prelude::*;
use std::ops::Range;

/// The points that each pixel sees.
#[derive(Default)]
pub(super) struct Splats {
    /// Where each pixel's points begin; one more than there are pixels.
    first: Vec<u32>,
    points: Vec<Splat>,
}

/// A point of a walk from the light that the camera sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Splat {
    pub walk: WalkNumber,
    /// Density with which light comes through interfaces that the walk begins with, if the way would be found from behind
    /// them (see [`super::join::Seen`]); not a number if not.
    pub seen: f32,
    /// What it counts, after [`super::roulette`].
    pub factor: f32,
    /// Direction in which the way to the camera leaves the point, where it is bent.
    pub dir: [f32; 3],
    /// Number of the point in its walk.
    pub point: u16,
    /// The branch of the walk that it is on ([`super::parting`]).
    pub lineage: u8,
    /// Interfaces on the way.
    pub interfaces: u8,
    /// Bits of the wavelengths that take this way.
    pub lanes: u8,
}

/// A walk from the light: the sample that it belongs to, and its number in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct WalkNumber {
    pub sample: u32,
    pub walk: u32,
}

/// How many there are.
#[derive(Clone, Copy)]
pub(super) struct Counts {
    pub samples: u32,
    /// Walks per sample.
    pub walks: u32,
    pub pixels: u32,
}

impl Counts {
    /// Number of walks.
    pub fn all(self) -> u64 {
        u64::from(self.samples) * u64::from(self.walks)
    }

    /// The walks of one of so many shares, counted from 0.
    pub fn share(self, share: u32, of: u32) -> Range<u64> {
        let upto = |n: u32| (u128::from(self.all()) * u128::from(n) / u128::from(of)) as u64;
        upto(share)..upto(share + 1)
    }

    /// The i-th walk.
    pub fn number(self, i: u64) -> WalkNumber {
        WalkNumber {
            sample: (i / u64::from(self.walks)) as u32,
            walk: (i % u64::from(self.walks)) as u32,
        }
    }
}

/// Walks that one piece of work makes.
pub(super) mod chunk {
    use rayon::prelude::*;
    use std::ops::Range;

    const CHUNK: u64 = 1 << 12;

    /// Walks in pieces.
    pub fn of(walks: Range<u64>) -> impl IndexedParallelIterator<Item = Range<u64>> {
        let count = (walks.end - walks.start).div_ceil(CHUNK);
        (0..count as usize).into_par_iter().map(move |k| {
            let first = walks.start + k as u64 * CHUNK;
            first..(first + CHUNK).min(walks.end)
        })
    }
}

impl Splats {
    /// Makes all walks of all samples by `trace`, which calls back with every point that is seen and its pixel; points are
    /// kept of the pixels that are `wanted`.
    pub fn new<T: Send>(
        counts: Counts,
        wanted: impl Fn(u32) -> bool + Sync,
        make: impl Fn() -> T + Sync,
        trace: impl Fn(&mut T, WalkNumber, &mut dyn FnMut(u32, Splat)) + Sync,
    ) -> Self {
        // In order whatever the number of threads.
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

    /// Points with their pixels, put in order by these.
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

    /// The points of a sample that a pixel sees, in order.
    #[inline]
    pub fn of(&self, pixel: u32, sample: u32) -> &[Splat] {
        let Some(&[begin, end]) = self.first.get(pixel as usize..pixel as usize + 2) else {
            return &[];
        };
        let points = &self.points[begin as usize..end as usize];
        let from = points.partition_point(|p| p.walk.sample < sample);
        let to = points.partition_point(|p| p.walk.sample <= sample);
        // Those of a file of another make may be in no order.
        points.get(from..to).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every point is found under its pixel, in order.
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
        };
        let splats = Splats::new(
            Counts {
                samples,
                walks,
                pixels,
            },
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
