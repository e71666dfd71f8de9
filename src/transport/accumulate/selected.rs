//! Slices that keep few projector pixels for a camera pixel: which these are, so that paths can be sent to where they light.

use optics::sampling::stream::Stream;
use tensor::axes::Extents;
use tensor::slice::{ProjectorSelect, Slice};

/// A slice is worth paths of its own if it keeps at most this share of the projector's pixels for a camera pixel: they take a
/// render up to twice the time, and of a sixteenth of the pixels chance finds about as much meanwhile.
const MOST: f64 = 1.0 / 64.0;

/// The same for bands about epipolar lines: in twice the time, indirect light of a 256th of the pixels has 3.5 times less variance,
/// of an 85th 1.7 times (`docs/paths.md`).
const MOST_OF_BAND: f64 = 1.0 / 128.0;

/// The projector pixels that a slice keeps for a camera pixel, with the chance of each to be drawn.
pub enum Selected {
    /// That of the camera pixel's own number alone.
    Own,
    /// The same for all camera pixels.
    Listed {
        /// Their numbers, rising.
        pixels: Vec<u32>,
        /// The chances of each and those before it.
        cumulative: Vec<f32>,
    },
    /// A band about its epipolar line, which is listed camera pixel by camera pixel; all in it are as likely.
    Band {
        /// Half width of the band, projector pixels.
        half_width_px: f32,
        /// Bands of more pixels are left to chance.
        most: usize,
    },
}

/// Chance of each pixel of a band, 0 if it has none.
#[inline]
#[must_use]
pub fn chance_in(band: &[u32]) -> f32 {
    if band.is_empty() {
        0.0
    } else {
        1.0 / band.len() as f32
    }
}

impl Selected {
    /// Those of a slice, if they are few.
    pub(super) fn of(slice: &Slice, extents: &Extents) -> Option<Self> {
        let [w, h] = extents.projector?;
        let all = 0..w * h;
        let few = |n: usize| n > 0 && n as f64 <= MOST * f64::from(w) * f64::from(h);
        let pixels: Vec<(u32, f32)> = match &slice.projector {
            ProjectorSelect::Coaxial => {
                return few(1).then_some(Self::Own);
            }
            ProjectorSelect::Mask { weights, .. } => {
                let lit = all.zip(weights).filter(|(_, weight)| **weight > 0.0);
                lit.map(|(pixel, weight)| (pixel, *weight)).collect()
            }
            ProjectorSelect::Rows(rows) => {
                let kept = all.filter(|p| rows.contains(&(p / w)));
                kept.map(|p| (p, 1.0)).collect()
            }
            ProjectorSelect::Columns(columns) => {
                let kept = all.filter(|p| columns.contains(&(p % w)));
                kept.map(|p| (p, 1.0)).collect()
            }
            ProjectorSelect::Block(b) => {
                let inside =
                    |p: &u32| (b.x..b.x + b.w).contains(&(p % w)) && (b.y..b.y + b.h).contains(&(p / w));
                all.filter(inside).map(|p| (p, 1.0)).collect()
            }
            // Bands hold direct light, whose noise at their edges is most of the sum's unless lines are rows of pixels: paths of
            // their own pay where indirect light is told apart (`docs/paths.md`).
            ProjectorSelect::Epipolar { half_width_px } if slice.bounces || slice.split_first_bounce => {
                let most = MOST_OF_BAND * f64::from(w) * f64::from(h);
                // So many has a line that crosses the shorter side.
                let least = 2.0 * f64::from(*half_width_px) * f64::from(w.min(h));
                return (least <= most).then_some(Self::Band {
                    half_width_px: *half_width_px,
                    most: most as usize,
                });
            }
            _ => return None,
        };
        if !few(pixels.len()) {
            return None;
        }
        let total: f64 = pixels.iter().map(|(_, weight)| f64::from(*weight)).sum();
        let mut sum = 0.0;
        let cumulative = pixels.iter().map(|(_, weight)| {
            sum += f64::from(*weight);
            (sum / total) as f32
        });
        let cumulative = cumulative.collect();
        let pixels = pixels.into_iter().map(|(pixel, _)| pixel).collect();
        Some(Self::Listed { pixels, cumulative })
    }

    /// Draws a pixel for a camera pixel, whose `band` (of a slice that has one) is not empty.
    #[inline]
    #[must_use]
    pub fn draw(&self, camera_pixel: u32, band: &[u32], stream: &mut Stream) -> u32 {
        match self {
            Self::Own => camera_pixel,
            Self::Listed { pixels, cumulative } => {
                let u = stream.uniform();
                pixels[cumulative.partition_point(|c| *c <= u).min(pixels.len() - 1)]
            }
            Self::Band { .. } => {
                let place = (stream.uniform() * band.len() as f32) as usize;
                band[place.min(band.len() - 1)]
            }
        }
    }

    /// Chance of a pixel that the slice keeps to be drawn; `in_band` is that of a band's ([`chance_in`]).
    #[inline]
    #[must_use]
    pub fn chance(&self, pixel: u32, in_band: f32) -> f32 {
        match self {
            Self::Own => 1.0,
            Self::Listed { pixels, cumulative } => pixels.binary_search(&pixel).map_or(0.0, |i| {
                cumulative[i] - if i == 0 { 0.0 } else { cumulative[i - 1] }
            }),
            Self::Band { .. } => in_band,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tensor::slice::{CameraSelect, Polarization, TimeSelect};

    fn of(projector: ProjectorSelect) -> Option<Selected> {
        told_apart(projector, false)
    }

    /// Of a slice that tells direct from indirect light, or does not.
    fn told_apart(projector: ProjectorSelect, bounces: bool) -> Option<Selected> {
        let slice = Slice {
            name: "s".into(),
            camera: CameraSelect::All,
            projector,
            time: TimeSelect::Sum,
            polarization: Polarization::Intensity,
            bounces,
            split_first_bounce: false,
            labels: false,
        };
        let extents = Extents {
            camera: [16, 16],
            projector: Some([16, 16]),
            wavelengths_nm: vec![550.0],
            max_depth: 3,
            tile: 8,
        };
        Selected::of(&slice, &extents)
    }

    /// 100,000 draws of a mask of weights 1, 3 and 4: their numbers are within five standard errors of the chances.
    #[test]
    fn pixels_are_drawn_with_their_chances() {
        let mut weights = vec![0.0; 256];
        for (pixel, weight) in [(3, 1.0), (77, 3.0), (255, 4.0)] {
            weights[pixel] = weight;
        }
        let name = "m".into();
        let selected = of(ProjectorSelect::Mask { name, weights }).expect("three pixels are few");
        let mut stream = Stream::new(1, 2, 3);
        let mut counts = [0.0; 256];
        let n = 100_000;
        for _ in 0..n {
            counts[selected.draw(9, &[], &mut stream) as usize] += 1.0 / f64::from(n);
        }
        for (pixel, want) in [(3, 0.125), (77, 0.375), (255, 0.5), (4, 0.0)] {
            assert!((f64::from(selected.chance(pixel, 0.0)) - want).abs() < 1e-6);
            let error = (want * (1.0 - want) / f64::from(n)).sqrt();
            assert!((counts[pixel as usize] - want).abs() <= 5.0 * error, "{pixel}");
        }
    }

    #[test]
    fn few_are_chosen_and_many_are_not() {
        let coaxial = of(ProjectorSelect::Coaxial).expect("one pixel is few");
        assert_eq!(
            (
                coaxial.draw(9, &[], &mut Stream::new(1, 2, 3)),
                coaxial.chance(9, 0.0)
            ),
            (9, 1.0)
        );
        let band = |half_width_px, bounces| told_apart(ProjectorSelect::Epipolar { half_width_px }, bounces);
        // A 128th are two pixels, and a line crosses 16.
        assert!(matches!(band(0.0625, true), Some(Selected::Band { most: 2, .. })));
        assert!(band(0.0625, false).is_none() && band(0.07, true).is_none());
        let block = |w, h| ProjectorSelect::Block(tensor::slice::Block { x: 14, y: 2, w, h });
        let four = of(block(2, 2)).expect("four pixels are few");
        assert_eq!([46, 47, 48].map(|p| four.chance(p, 0.0)), [0.25, 0.25, 0.0]);
        for many in [
            block(2, 3),
            ProjectorSelect::Rows(vec![3]),
            ProjectorSelect::All,
            ProjectorSelect::Sum,
        ] {
            assert!(of(many).is_none());
        }
    }
}
