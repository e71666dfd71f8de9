//! Textures on surfaces, for albedo, roughness, blend weights and normals.

use optics::spectrum::Spectral;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Continuation of an image beyond its edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Wrap {
    /// The image repeats.
    #[default]
    Repeat,
    /// The image repeats, and every second copy is mirrored.
    Mirror,
    /// The texels at the edge extend to infinity.
    Clamp,
}

/// Interpolation of values between the centres of texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Filter {
    /// Bilinear interpolation of the four nearest texels.
    #[default]
    Bilinear,
    /// Value of the nearest texel, without interpolation.
    Nearest,
}

/// Affine map of texture coordinates, by row: u' = a u + b v + c, v' = d u + e v + f.
pub type UvMap = [[f32; 3]; 2];

/// The identity map.
pub const SAME: UvMap = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// One image. Several images may share texels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Image {
    pub width: u32,
    pub height: u32,
    /// Index of the image's first texel.
    pub first: u32,
    pub filter: Filter,
    pub wrap: Wrap,
    /// Map from texture coordinates of the surface to those of the image.
    pub uv: UvMap,
}

impl Image {
    /// Returns an image whose texels begin at `first`, with the default filter, wrap mode and map.
    pub fn new([width, height]: [u32; 2], first: u32) -> Self {
        Self { width, height, first, filter: Filter::default(), wrap: Wrap::default(), uv: SAME }
    }

    /// Returns the continuous column and row at texture coordinates of the surface, up to whole periods.
    #[inline]
    fn place(&self, uv: [f32; 2]) -> (f32, f32) {
        let [u, v] = self.uv.map(|[a, b, c]| a * uv[0] + b * uv[1] + c);
        let (w, h) = (self.width as f32, self.height as f32);
        match self.wrap {
            // Remove whole periods first, because f32 leaves few digits for the fraction far from the origin.
            Wrap::Repeat => (u.rem_euclid(1.0) * w, (1.0 - v.rem_euclid(1.0)) * h),
            Wrap::Mirror => (u.rem_euclid(2.0) * w, (1.0 - v.rem_euclid(2.0)) * h),
            Wrap::Clamp => (u.clamp(-1.0, 2.0) * w, (1.0 - v.clamp(-1.0, 2.0)) * h),
        }
    }

    /// Returns the index of the texel in column `i`, row `j`. `i` and `j` may be beyond the edges of the
    /// image.
    #[inline]
    fn texel(&self, i: i64, j: i64) -> usize {
        let along = |i: i64, n: u32| {
            let n = i64::from(n);
            let i = match self.wrap {
                Wrap::Repeat => i.rem_euclid(n),
                Wrap::Clamp => i.clamp(0, n - 1),
                Wrap::Mirror => {
                    let i = i.rem_euclid(2 * n);
                    i.min(2 * n - 1 - i)
                }
            };
            i as u32
        };
        (self.first + along(j, self.height) * self.width + along(i, self.width)) as usize
    }
}

/// Interpolates the four values around a position. `at` returns the value at integer coordinates.
#[inline(always)]
pub(crate) fn bilinear(x: f32, y: f32, at: impl Fn(f32, f32) -> Spectral) -> Spectral {
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let lerp = |a: Spectral, b: Spectral, t: f32| a + (b - a) * Spectral::splat(t);
    let top = lerp(at(x0, y0), at(x0 + 1.0, y0), fx);
    let bottom = lerp(at(x0, y0 + 1.0), at(x0 + 1.0, y0 + 1.0), fx);
    lerp(top, bottom, fy)
}

/// Image index that selects values at the corners of mesh triangles ([`Textures::corners`]) instead of an
/// image.
pub const ATTRIBUTE: u32 = u32::MAX;
/// Number of triangles in one row of the texture-coordinate grid of [`corner_uv`].
const COLUMNS: u32 = 2048;
/// Maximum number of triangles with corner values. For more triangles, f32 texture coordinates are too
/// coarse.
pub const MOST_CORNERS: usize = 1 << 22;

/// Returns the texture coordinates of corner `k` of the triangle with values `Textures::corners[number]`.
///
/// Each triangle has a cell of 2 × 2 units of texture coordinates, with a margin to the edges.
pub fn corner_uv(number: u32, k: usize) -> [f32; 2] {
    let cell = [number % COLUMNS, number / COLUMNS];
    let [u, v] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]][k];
    [2.0 * cell[0] as f32 + 0.5 + u, 2.0 * cell[1] as f32 + 0.5 + v]
}

/// All images of a scene. The texels of all images are in one table.
#[derive(Clone, Debug, Default)]
pub struct Textures {
    pub images: Vec<Image>,
    /// Texel values per wavelength lane, top row first in each image.
    pub texels: Vec<[f32; 4]>,
    /// Values at the corners of triangles. Meshes refer to these values by texture coordinates
    /// ([`corner_uv`]).
    pub corners: Vec<[[f32; 4]; 3]>,
}

impl Textures {
    /// Returns the value of an image at texture coordinates. The coordinates (0, 0) are the lower left
    /// corner.
    #[inline]
    pub fn eval(&self, texture: u32, uv: [f32; 2]) -> Spectral {
        if texture == ATTRIBUTE {
            return self.at_corners(uv);
        }
        let image = &self.images[texture as usize];
        let (x, y) = image.place(uv);
        let at = |i: f32, j: f32| Spectral::new(self.texels[image.texel(i as i64, j as i64)]);
        if image.filter == Filter::Nearest {
            return at(x.floor(), y.floor());
        }
        bilinear(x - 0.5, y - 0.5, at)
    }

    /// Returns the derivatives of the first channel, interpolated bilinearly, with respect to the texture
    /// coordinates u and v of the surface.
    pub fn gradient(&self, texture: u32, uv: [f32; 2]) -> [f32; 2] {
        let image = &self.images[texture as usize];
        let (w, h) = (image.width as f32, image.height as f32);
        let (x, y) = image.place(uv);
        let (x, y) = (x - 0.5, y - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let at = |i: f32, j: f32| self.texels[image.texel((x0 + i) as i64, (y0 + j) as i64)][0];
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let along = w * lerp(at(1.0, 0.0) - at(0.0, 0.0), at(1.0, 1.0) - at(0.0, 1.0), fy);
        // v increases upward, but rows are counted from the top.
        let up = -h * lerp(at(0.0, 1.0) - at(0.0, 0.0), at(1.0, 1.0) - at(1.0, 0.0), fx);
        let [[a, b, _], [d, e, _]] = image.uv;
        [along * a + up * d, along * b + up * e]
    }

    /// Interpolates the values at a triangle's corners with barycentric weights.
    #[inline(never)]
    fn at_corners(&self, uv: [f32; 2]) -> Spectral {
        let cell = uv.map(|x| (x / 2.0).floor());
        let [b, c] = [0, 1].map(|k| uv[k] - 2.0 * cell[k] - 0.5);
        let number = cell[1] as usize * COLUMNS as usize + cell[0] as usize;
        let values = self.corners[number].map(Spectral::new);
        let mixed = values[0]
            + (values[1] - values[0]) * Spectral::splat(b)
            + (values[2] - values[0]) * Spectral::splat(c);
        // Rounding may place the point slightly outside the triangle.
        mixed.max(Spectral::ZERO)
    }
}

/// A value per wavelength, optionally multiplied by an image.
#[derive(Clone, Copy, Debug)]
pub struct Spectrum {
    /// The value, or the factor by which the image is multiplied.
    pub value: Spectral,
    pub texture: Option<u32>,
}

impl Spectrum {
    pub fn uniform(value: Spectral) -> Self {
        Self { value, texture: None }
    }

    #[inline]
    pub fn at(&self, textures: &Textures, uv: [f32; 2]) -> Spectral {
        match self.texture {
            Some(t) => self.value * textures.eval(t, uv),
            None => self.value,
        }
    }
}

/// A number that is optionally multiplied by the first channel of an image.
#[derive(Clone, Copy, Debug)]
pub struct Scalar {
    /// The value, or the factor by which the image is multiplied.
    pub value: f32,
    pub texture: Option<u32>,
}

impl Scalar {
    pub fn uniform(value: f32) -> Self {
        Self { value, texture: None }
    }

    #[inline]
    pub fn at(&self, textures: &Textures, uv: [f32; 2]) -> f32 {
        match self.texture {
            Some(t) => self.value * textures.eval(t, uv).to_array()[0],
            None => self.value,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a texture of 3 × 2 texels with the values 1 to 6, top row first.
    fn textures(filter: Filter, wrap: Wrap, uv: UvMap) -> Textures {
        Textures {
            images: vec![Image { filter, wrap, uv, ..Image::new([3, 2], 0) }],
            texels: (1..=6).map(|i| [i as f32; 4]).collect(),
            corners: vec![],
        }
    }

    fn value(t: &Textures, u: f32, v: f32) -> f32 {
        t.eval(0, [u, v]).to_array()[0]
    }

    #[test]
    fn texel_centres_have_their_values() {
        for filter in [Filter::Bilinear, Filter::Nearest] {
            for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
                let t = textures(filter, wrap, SAME);
                for (i, expected) in [4.0, 5.0, 6.0, 1.0, 2.0, 3.0].into_iter().enumerate() {
                    let (column, row) = ((i % 3) as f32, (i / 3) as f32);
                    let found = value(&t, (column + 0.5) / 3.0, (row + 0.5) / 2.0);
                    assert!((found - expected).abs() < 1e-5, "{filter:?} {wrap:?}: {found}");
                }
            }
        }
    }

    #[test]
    fn images_continue_by_wrap_mode() {
        // The lower left texel has the value 4, and the lower right texel has the value 6.
        let at = |wrap, u| value(&textures(Filter::Nearest, wrap, SAME), u, 0.25);
        for (wrap, expected) in [
            (Wrap::Repeat, [4.0, 6.0, 6.0, 4.0]),
            (Wrap::Mirror, [6.0, 4.0, 4.0, 6.0]),
            (Wrap::Clamp, [6.0, 4.0, 6.0, 4.0]),
        ] {
            let found = [1.1, -0.1, 1.9, -0.9].map(|u| at(wrap, u));
            assert_eq!(found, expected, "{wrap:?}");
        }
        // On the border between two adjacent copies, the value is the mean of both edge texels.
        let mixed = |wrap| value(&textures(Filter::Bilinear, wrap, SAME), 1.0, 0.25);
        assert!((mixed(Wrap::Repeat) - 5.0).abs() < 1e-5);
        assert!((mixed(Wrap::Mirror) - 6.0).abs() < 1e-5);
        assert!((mixed(Wrap::Clamp) - 6.0).abs() < 1e-5);
    }

    /// Compares gradients with finite differences of the image, for every wrap mode and an affine map.
    #[test]
    fn gradients_match_finite_differences() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            let t = textures(Filter::Bilinear, wrap, [[2.0, 0.5, 0.1], [0.25, -1.0, 1.0]]);
            for (u, v) in [(0.21, 0.33), (0.71, 0.93), (-0.43, 1.61), (1.37, 0.48)] {
                let step = 1e-3;
                let by =
                    |du: f32, dv: f32| (value(&t, u + du, v + dv) - value(&t, u - du, v - dv)) / (2.0 * step);
                let want = [by(step, 0.0), by(0.0, step)];
                let found = t.gradient(0, [u, v]);
                let near = found.iter().zip(want).all(|(a, b)| (a - b).abs() < 0.02);
                assert!(near, "{wrap:?} at {u}, {v}: {found:?}, {want:?}");
            }
        }
    }

    /// Verifies interpolated corner values. The test includes high triangle indices, which have coarse
    /// coordinates.
    #[test]
    fn corner_values_are_interpolated() {
        let mut t = Textures::default();
        for number in 0..70_000_u32 {
            let base = (number % 97) as f32;
            t.corners.push([base, base + 1.0, base + 5.0].map(|v| [v; 4]));
        }
        for number in [0, 1, 2047, 2048, 69_999] {
            let uv = [0, 1, 2].map(|k| corner_uv(number, k));
            for weights in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.2, 0.3, 0.5_f32]] {
                let at = [0, 1].map(|x| (0..3).map(|k| weights[k] * uv[k][x]).sum::<f32>());
                let want = (number % 97) as f32 + weights[1] + 5.0 * weights[2];
                let found = t.eval(ATTRIBUTE, at).to_array()[0];
                assert!((found - want).abs() < 5e-3, "{number}, {weights:?}: {found}, {want}");
            }
        }
    }

    #[test]
    fn coordinates_are_mapped_before_the_image_is_read() {
        let plain = textures(Filter::Bilinear, Wrap::Repeat, SAME);
        let turned = textures(Filter::Bilinear, Wrap::Repeat, [[2.0, 0.5, 0.1], [0.25, -1.0, 1.0]]);
        for (u, v) in [(0.2, 0.3), (0.7, 0.9), (-0.4, 1.6)] {
            let (a, b) = (2.0 * u + 0.5 * v + 0.1, 0.25 * u - v + 1.0);
            assert!((value(&turned, u, v) - value(&plain, a, b)).abs() < 1e-5);
        }
    }
}
