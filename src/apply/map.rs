//! The type of the images that all methods use.

/// An image of `height × width` camera pixels with `channels` values per pixel, row-major. The values of a
/// pixel are colours, or the components of a vector. Unknown pixels are NaN.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    pub width: usize,
    /// Number of rows. The first row is the top row.
    pub height: usize,
    /// Number of values per pixel.
    pub channels: usize,
    /// Values of all pixels. The channel index varies fastest.
    pub data: Vec<f64>,
}

impl Map {
    /// Creates a map with a function that fills the channels of the pixel at a column and row.
    pub fn from_fn(
        width: usize,
        height: usize,
        channels: usize,
        mut fill: impl FnMut(usize, usize, &mut [f64]),
    ) -> Self {
        let mut data = vec![0.0; width * height * channels];
        if channels > 0 {
            for (i, pixel) in data.chunks_exact_mut(channels).enumerate() {
                fill(i % width, i / width, pixel);
            }
        }
        Self { width, height, channels, data }
    }

    /// Returns the channels of a pixel.
    ///
    /// # Panics
    /// Panics if the pixel is outside the map.
    pub fn at(&self, x: usize, y: usize) -> &[f64] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) is outside");
        let first = (y * self.width + x) * self.channels;
        &self.data[first..first + self.channels]
    }
}

/// Returns the pixels of the square window around a pixel that are inside an image of the given width and height,
/// row by row. `radius` is the number of pixels from the centre of the window to its edge.
pub fn window([w, h]: [usize; 2], [x, y]: [usize; 2], radius: usize) -> impl Iterator<Item = [usize; 2]> {
    let columns = x.saturating_sub(radius)..(x + radius + 1).min(w);
    (y.saturating_sub(radius)..(y + radius + 1).min(h))
        .flat_map(move |j| columns.clone().map(move |i| [i, j]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_end_at_the_edges_of_the_image() {
        let pixels: Vec<_> = window([3, 4], [2, 0], 1).collect();
        assert_eq!(pixels, [[1, 0], [2, 0], [1, 1], [2, 1]]);
        assert_eq!(window([5, 5], [2, 2], 1).count(), 9);
    }

    #[test]
    fn from_fn_sets_each_pixel() {
        let map = Map::from_fn(3, 2, 2, |x, y, out| out.copy_from_slice(&[x as f64, y as f64]));
        for (x, y) in [(0, 0), (2, 0), (0, 1), (2, 1)] {
            assert_eq!(map.at(x, y), [x as f64, y as f64]);
        }
    }
}
