//! Slices that keep few projector pixels for a camera pixel: which these are, so that paths can be sent to where they light.

use optics::sampling::stream::Stream;
use tensor::axes::Extents;
use tensor::slice::{ProjectorSelect, Slice};

/// A slice is worth paths of its own if it keeps at most this share of the projector's pixels for a camera pixel: they take a
/// render up to twice the time, and of a sixteenth of the pixels chance finds about as much meanwhile.
const MOST: f64 = 1.0 / 64.0;

/// The projector pixels that a slice keeps for a camera pixel, with the chance of each to be drawn.
pub struct Selected {
    /// Pixels, and the chances of each and those before it; `None` for that of the camera pixel's own number alone.
    listed: Option<(Vec<u32>, Vec<f32>)>,
}

impl Selected {
    /// Those of a slice, if they are few.
    pub(super) fn of(slice: &Slice, extents: &Extents) -> Option<Self> {
        let [w, h] = extents.projector?;
        let all = 0..w * h;
        let few = |n: usize| n > 0 && n as f64 <= MOST * f64::from(w) * f64::from(h);
        let pixels: Vec<(u32, f32)> = match &slice.projector {
            ProjectorSelect::Coaxial => {
                return few(1).then_some(Self { listed: None });
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
        Some(Self {
            listed: Some((pixels, cumulative)),
        })
    }

    /// Draws a pixel for a camera pixel.
    #[inline]
    #[must_use]
    pub fn draw(&self, camera_pixel: u32, stream: &mut Stream) -> u32 {
        match &self.listed {
            None => camera_pixel,
            Some((pixels, cumulative)) => {
                let u = stream.uniform();
                pixels[cumulative.partition_point(|c| *c <= u).min(pixels.len() - 1)]
            }
        }
    }

    /// Chance of a pixel that the slice keeps to be drawn.
    #[inline]
    #[must_use]
    pub fn chance(&self, pixel: u32) -> f32 {
        match &self.listed {
            None => 1.0,
            Some((pixels, cumulative)) => pixels.binary_search(&pixel).map_or(0.0, |i| {
                cumulative[i] - if i == 0 { 0.0 } else { cumulative[i - 1] }
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tensor::slice::{CameraSelect, Polarization, TimeSelect};

    fn of(projector: ProjectorSelect) -> Option<Selected> {
        let slice = Slice {
            name: "s".into(),
            camera: CameraSelect::All,
            projector,
            time: TimeSelect::Sum,
            polarization: Polarization::Intensity,
            bounces: false,
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
            counts[selected.draw(9, &mut stream) as usize] += 1.0 / f64::from(n);
        }
        for (pixel, want) in [(3, 0.125), (77, 0.375), (255, 0.5), (4, 0.0)] {
            assert!((f64::from(selected.chance(pixel)) - want).abs() < 1e-6);
            let error = (want * (1.0 - want) / f64::from(n)).sqrt();
            assert!((counts[pixel as usize] - want).abs() <= 5.0 * error, "{pixel}");
        }
    }

    #[test]
    fn few_are_chosen_and_many_are_not() {
        let coaxial = of(ProjectorSelect::Coaxial).expect("one pixel is few");
        assert_eq!(
            (coaxial.draw(9, &mut Stream::new(1, 2, 3)), coaxial.chance(9)),
            (9, 1.0)
        );
        let block = |w, h| ProjectorSelect::Block(tensor::slice::Block { x: 14, y: 2, w, h });
        let four = of(block(2, 2)).expect("four pixels are few");
        assert_eq!([46, 47, 48].map(|p| four.chance(p)), [0.25, 0.25, 0.0]);
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
