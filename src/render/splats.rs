//! Which walks from the light end in which camera pixel.
//!
//! Tiles own camera pixels, but light falls where it will. So all walks from the light are made once beforehand, and of
//! each that reaches the camera only its number is kept, under its pixel. A pixel then makes its walks again: they depend
//! on their numbers alone. That costs a walk twice, and keeps what is live small and every tile independent of the
//! others.

use rayon::prelude::*;

/// Numbers of the walks that end in each pixel.
#[derive(Default)]
pub(super) struct Splats {
    /// Where each pixel's walks begin; one more than there are pixels.
    first: Vec<u32>,
    walks: Vec<WalkNumber>,
}

/// A walk from the light: the sample that it belongs to, and its number in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct WalkNumber {
    pub sample: u32,
    pub walk: u32,
}

/// Walks that one piece of work makes.
const CHUNK: u64 = 1 << 12;

impl Splats {
    /// Makes `samples` times `walks` walks by `trace`, which calls back with every pixel (below `pixels`) that a walk ends
    /// in, if `wanted`.
    pub fn new<T: Send>(
        (samples, walks, pixels): (u32, u32, u32),
        wanted: impl Fn(u32) -> bool + Sync,
        make: impl Fn() -> T + Sync,
        trace: impl Fn(&mut T, WalkNumber, &mut dyn FnMut(u32)) + Sync,
    ) -> Self {
        let all = u64::from(samples) * u64::from(walks);
        // In order whatever the number of threads.
        let found: Vec<Vec<(u32, WalkNumber)>> = (0..all.div_ceil(CHUNK))
            .into_par_iter()
            .map_init(&make, |state, chunk| {
                let mut found = vec![];
                for i in chunk * CHUNK..((chunk + 1) * CHUNK).min(all) {
                    let number = WalkNumber {
                        sample: (i / u64::from(walks)) as u32,
                        walk: (i % u64::from(walks)) as u32,
                    };
                    let begin = found.len();
                    trace(state, number, &mut |pixel| {
                        // A pixel makes a walk once for all that it brings.
                        if wanted(pixel) && !found[begin..].contains(&(pixel, number)) {
                            found.push((pixel, number));
                        }
                    });
                }
                found
            })
            .collect();
        let mut first = vec![0_u32; pixels as usize + 1];
        for (pixel, _) in found.iter().flatten() {
            first[*pixel as usize + 1] += 1;
        }
        for i in 0..pixels as usize {
            first[i + 1] += first[i];
        }
        let mut next = first.clone();
        let count = found.iter().map(Vec::len).sum();
        let mut walks = vec![WalkNumber { sample: 0, walk: 0 }; count];
        for (pixel, number) in found.into_iter().flatten() {
            let at = &mut next[pixel as usize];
            walks[*at as usize] = number;
            *at += 1;
        }
        Self { first, walks }
    }

    /// The walks of a sample that end in a pixel, in order.
    pub fn of(&self, pixel: u32, sample: u32) -> &[WalkNumber] {
        let Some(&[begin, end]) = self.first.get(pixel as usize..pixel as usize + 2) else {
            return &[];
        };
        let walks = &self.walks[begin as usize..end as usize];
        let from = walks.partition_point(|w| w.sample < sample);
        let to = walks.partition_point(|w| w.sample <= sample);
        &walks[from..to]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every walk is found under its pixels, in order, once.
    #[test]
    fn walks_are_found_by_pixel_and_sample() {
        let (samples, walks, pixels) = (7, 3000, 40);
        let ends = |n: WalkNumber| {
            [
                (n.walk * 7 + n.sample) % 40,
                (n.walk * 7 + n.sample) % 40,
                n.walk % 13,
            ]
        };
        let splats = Splats::new(
            (samples, walks, pixels),
            |p| p != 5,
            || (),
            |(), n, found| ends(n).into_iter().for_each(found),
        );
        for pixel in 0..pixels {
            for sample in 0..samples {
                let want: Vec<WalkNumber> = (0..walks)
                    .map(|walk| WalkNumber { sample, walk })
                    .filter(|n| pixel != 5 && ends(*n).contains(&pixel))
                    .collect();
                assert_eq!(splats.of(pixel, sample), want);
            }
        }
    }
}
