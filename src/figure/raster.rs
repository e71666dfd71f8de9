//! Defines images of numeric values that are not yet mapped to colours. Also defines scaling by integer
//! factors.

use image::{Rgb, RgbImage};

use super::drawing::{Drawing, Point};
use super::error::FigureError;
use super::reduce::Reduced;

/// An image of `w` × `h` pixels with `C` values each, row-major from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster<const C: usize> {
    /// Number of columns, at least 1.
    pub w: usize,
    /// Number of rows, at least 1.
    pub h: usize,
    pub data: Vec<[f32; C]>,
}

/// Integer factors from data pixels to image pixels along one direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Factor {
    /// Number of data pixels that are averaged into one pixel. The value 1 means no averaging.
    pub down: usize,
    /// Number of image pixels per data pixel, after averaging.
    pub up: usize,
}

impl Factor {
    /// Returns the factor for `n` data pixels. With repetition, the length is as large as possible, up to
    /// `target`. With averaging, the length is at most `most`.
    pub fn new(n: usize, target: usize, most: usize) -> Self {
        let n = n.max(1);
        if n > most {
            Self { down: n.div_ceil(most), up: 1 }
        } else {
            Self { down: 1, up: (target / n).max(1) }
        }
    }

    /// Returns the number of image pixels for `n` data pixels.
    pub fn length(self, n: usize) -> f64 {
        (n.div_ceil(self.down) * self.up) as f64
    }

    /// Returns a factor with more repetition, so that `n` data pixels give at least `least` image pixels.
    pub fn at_least(self, least: usize, n: usize) -> Self {
        let length = n.div_ceil(self.down) * self.up;
        Self { up: self.up * least.div_ceil(length.max(1)), ..self }
    }

    /// Returns factors that keep pixels square. The longer side is close to `target`. If one side would be
    /// shorter than `least`, the image is stretched in that direction and remains visible.
    pub fn square(w: usize, h: usize, target: usize, most: usize, least: usize) -> (Self, Self) {
        let f = Self::new(w.max(h), target, most);
        let widen = |n: usize| {
            if f.length(n) >= least as f64 { f } else { Self { down: 1, up: 1 }.at_least(least, n) }
        };
        (widen(w), widen(h))
    }
}

impl Raster<3> {
    /// Returns red, green and blue from values whose last axis is the wavelength.
    pub fn colour(w: usize, h: usize, values: &Reduced, weights: &[Vec<f32>; 3]) -> Self {
        let lanes = weights[0].len().max(1);
        let mix = |lane: &[f32], row: &[f32]| match row {
            [] => lane[0],
            _ => lane.iter().zip(row).filter(|(_, w)| **w > 0.0).map(|(v, w)| v * w).sum(),
        };
        let pixels = values.data.chunks_exact(lanes);
        let data = pixels.map(|lane| weights.each_ref().map(|row| mix(lane, row))).collect();
        Self { w, h, data }
    }
}

impl<const C: usize> Raster<C> {
    /// Builds a raster of `w` columns. `name` is the slice's name for messages.
    ///
    /// # Errors
    /// [`FigureError::Damaged`] with the slice's name if there is no value, or if the values do not fill the
    /// rows.
    pub fn new(name: &str, w: usize, data: Vec<[f32; C]>) -> Result<Self, FigureError> {
        let h = data.len() / w.max(1);
        if h == 0 || h * w != data.len() {
            return Err(FigureError::Damaged {
                slice: name.to_owned(),
                found: data.len(),
                axes: format!("{w} columns"),
            });
        }
        Ok(Self { w, h, data })
    }

    /// Averages the raster over boxes. The average of a box that contains a non-finite value is undefined.
    pub fn shrink(self, (fx, fy): (Factor, Factor)) -> Self {
        if fx.down == 1 && fy.down == 1 {
            return self;
        }
        let (w, h) = (self.w.div_ceil(fx.down), self.h.div_ceil(fy.down));
        let mut data = Vec::with_capacity(w * h);
        for y in 0..h {
            for x in 0..w {
                let (y1, x1) = (((y + 1) * fy.down).min(self.h), ((x + 1) * fx.down).min(self.w));
                let mut sum = [0.0_f64; C];
                for row in y * fy.down..y1 {
                    for pixel in &self.data[row * self.w + x * fx.down..row * self.w + x1] {
                        sum.iter_mut().zip(pixel).for_each(|(s, v)| *s += f64::from(*v));
                    }
                }
                let n = (y1 - y * fy.down) * (x1 - x * fx.down);
                data.push(sum.map(|s| (s / n as f64) as f32));
            }
        }
        Self { w, h, data }
    }

    /// Returns the raster flipped vertically, so that rows run upward.
    pub fn flipped(mut self) -> Self {
        self.data = self.data.chunks_exact(self.w).rev().flatten().copied().collect();
        self
    }

    /// Draws the raster as an image, after reduction. The image's upper left corner is at `from`, relative to
    /// the data rectangle of the page.
    pub fn paint(
        &self,
        page: &mut Drawing,
        from: Point,
        (fx, fy): (Factor, Factor),
        colour: impl Fn([f32; C]) -> Rgb<u8>,
    ) {
        let size = ((self.w * fx.up) as f64, (self.h * fy.up) as f64);
        page.image(page.data.within(from, size), &self.image(colour));
    }

    /// Returns the raster as an image with one pixel per raster pixel.
    pub fn image(&self, colour: impl Fn([f32; C]) -> Rgb<u8>) -> RgbImage {
        let pixel = |x: u32, y: u32| colour(self.data[y as usize * self.w + x as usize]);
        RgbImage::from_fn(self.w as u32, self.h as u32, pixel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_whole_and_bounded() {
        assert_eq!(Factor::new(320, 900, 1600), Factor { down: 1, up: 2 });
        assert_eq!(Factor::new(1000, 900, 1600), Factor { down: 1, up: 1 });
        assert_eq!(Factor::new(4000, 900, 1600), Factor { down: 3, up: 1 });
        assert_eq!(Factor::new(4000, 900, 1600).length(4000), 1334.0);
        let (fx, fy) = Factor::square(300, 1, 900, 1600, 40);
        assert_eq!((fx.length(300), fy.length(1)), (900.0, 40.0));
    }

    #[test]
    fn shrinking_averages_and_keeps_undefined_pixels() {
        let data = [1.0, 3.0, f32::NAN, 5.0, 7.0, 1.0].map(|v| [v]);
        let f = Factor { down: 2, up: 1 };
        let s = Raster::new("", 3, data.to_vec()).unwrap().shrink((f, f));
        assert_eq!((s.w, s.h, s.data[0]), (2, 1, [4.0]));
        assert!(s.data[1][0].is_nan());
    }

    #[test]
    fn flipping_reverses_the_rows() {
        let r = Raster::new("", 2, vec![[1.0], [2.0], [3.0], [4.0]]).unwrap();
        assert_eq!(r.flipped().data, [[3.0], [4.0], [1.0], [2.0]]);
    }
}
