//! Projector pixels for which separate paths are sampled, if a slice keeps few projector pixels per camera
//! pixel.

use optics::sampling::stream::Stream;
use tensor::axes::Extents;
use tensor::slice::{ProjectorSelect, Slice};

/// Maximum fraction of the projector's pixels that a slice with separate paths may keep per camera pixel.
/// Separate paths can double the render time. For a fraction of 1/16, the longer render time outweighs the
/// variance reduction.
const MOST: f64 = 1.0 / 64.0;

/// Maximum fraction for bands around epipolar lines. Separate paths double the time. Separate paths reduce
/// the variance of indirect light by a factor of 3.5 for a fraction of 1/256, and by a factor of 1.7 for a
/// fraction of 1/85 (`docs/paths.md`).
const MOST_OF_BAND: f64 = 1.0 / 128.0;

/// The projector pixels that a slice keeps for a camera pixel, with their sampling probabilities.
pub enum Selected {
    /// Only the projector pixel with the same row-major index as the camera pixel.
    Own,
    /// Projector pixels that are the same for all camera pixels.
    Listed {
        /// Row-major pixel indices, ascending.
        pixels: Vec<u32>,
        /// Sum of the sampling probabilities up to and including each pixel.
        cumulative: Vec<f32>,
    },
    /// A band around the epipolar line of each camera pixel. The projector pixels of the band are sampled
    /// uniformly.
    Band {
        /// Half width of the band in projector pixels.
        half_width_px: f32,
        /// Maximum number of pixels in a band. No separate paths are sampled for larger bands.
        most: usize,
    },
}

/// Returns the probability of each pixel of a band, or 0 if the band is empty.
#[inline]
pub fn chance_in(band: &[u32]) -> f32 {
    if band.is_empty() { 0.0 } else { 1.0 / band.len() as f32 }
}

impl Selected {
    /// Returns the projector pixels of a slice, or `None` if there are too many pixels to sample separately.
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
            // The noise of direct light at a band's borders dominates, unless epipolar lines are pixel rows.
            // Separate paths are efficient only if the slice separates indirect light (`docs/paths.md`).
            ProjectorSelect::Epipolar { half_width_px } if slice.bounces || slice.split_first_bounce => {
                let most = MOST_OF_BAND * f64::from(w) * f64::from(h);
                // Number of pixels in a band that runs along the shorter side of the image.
                let least = 2.0 * f64::from(*half_width_px) * f64::from(w.min(h));
                return (least <= most)
                    .then_some(Self::Band { half_width_px: *half_width_px, most: most as usize });
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

    /// Samples a projector pixel for a camera pixel. `band` must contain pixels if the slice has a band.
    #[inline]
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

    /// Returns the probability of sampling projector pixel `pixel`. `in_band` is the probability of each
    /// pixel of a band ([`chance_in`]).
    #[inline]
    pub fn chance(&self, pixel: u32, in_band: f32) -> f32 {
        match self {
            Self::Own => 1.0,
            Self::Listed { pixels, cumulative } => pixels
                .binary_search(&pixel)
                .map_or(0.0, |i| cumulative[i] - if i == 0 { 0.0 } else { cumulative[i - 1] }),
            Self::Band { .. } => in_band,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tensor::slice::{CameraSelect, Polarization, TimeSelect};

    fn of(projector: ProjectorSelect) -> Option<Selected> {
        of_bounces(projector, false)
    }

    /// Returns the selected projector pixels of a slice with or without the `bounces` axis.
    fn of_bounces(projector: ProjectorSelect, bounces: bool) -> Option<Selected> {
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

    /// Verifies the sampling frequencies for a mask with weights 1, 3 and 4. In 100,000 samples, the
    /// frequencies must agree with the probabilities within 5 standard deviations.
    #[test]
    fn pixels_are_drawn_with_the_stated_probabilities() {
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
    fn only_few_pixels_are_selected() {
        let coaxial = of(ProjectorSelect::Coaxial).expect("one pixel is few");
        assert_eq!((coaxial.draw(9, &[], &mut Stream::new(1, 2, 3)), coaxial.chance(9, 0.0)), (9, 1.0));
        let band = |half_width_px, bounces| of_bounces(ProjectorSelect::Epipolar { half_width_px }, bounces);
        // The limit of 1/128 of the pixels is two pixels, but an epipolar line crosses 16 pixels.
        assert!(matches!(band(0.0625, true), Some(Selected::Band { most: 2, .. })));
        assert!(band(0.0625, false).is_none() && band(0.07, true).is_none());
        let block = |w, h| ProjectorSelect::Block(tensor::slice::Block { x: 14, y: 2, w, h });
        let four = of(block(2, 2)).expect("four pixels are few");
        assert_eq!([46, 47, 48].map(|p| four.chance(p, 0.0)), [0.25, 0.25, 0.0]);
        for many in [block(2, 3), ProjectorSelect::Rows(vec![3]), ProjectorSelect::All, ProjectorSelect::Sum]
        {
            assert!(of(many).is_none());
        }
    }
}
