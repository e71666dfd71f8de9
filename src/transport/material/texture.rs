//! Images on surfaces: albedo, roughness, blend weight, normals.

use optics::spectrum::Spectral;

/// Images: spectral texels of all textures in one table.
#[derive(Clone, Debug, Default)]
pub struct Textures {
    /// Width, height and first texel of every texture.
    pub images: Vec<(u32, u32, u32)>,
    /// Texels, top row first.
    pub texels: Vec<[f32; 4]>,
}

impl Textures {
    /// Bilinear, repeating; uv (0, 0) is the lower left corner of the image.
    #[inline]
    #[must_use]
    pub fn eval(&self, texture: u32, uv: [f32; 2]) -> Spectral {
        let (w, h, first) = self.images[texture as usize];
        let x = uv[0].rem_euclid(1.0) * w as f32 - 0.5;
        let y = (1.0 - uv[1].rem_euclid(1.0)) * h as f32 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let at = |i: f32, j: f32| {
            let i = (i as i64).rem_euclid(i64::from(w)) as u32;
            let j = (j as i64).rem_euclid(i64::from(h)) as u32;
            Spectral::new(self.texels[(first + j * w + i) as usize])
        };
        let lerp = |a: Spectral, b: Spectral, t: f32| a + (b - a) * Spectral::splat(t);
        let top = lerp(at(x0, y0), at(x0 + 1.0, y0), fx);
        let bottom = lerp(at(x0, y0 + 1.0), at(x0 + 1.0, y0 + 1.0), fx);
        lerp(top, bottom, fy)
    }
}

/// A value per wavelength, times an image where there is one.
#[derive(Clone, Copy, Debug)]
pub struct Spectrum {
    /// The value, or the factor of the image.
    pub value: Spectral,
    /// Index of the image.
    pub texture: Option<u32>,
}

impl Spectrum {
    /// The same everywhere.
    #[must_use]
    pub fn uniform(value: Spectral) -> Self {
        Self { value, texture: None }
    }

    /// Its value at texture coordinates.
    #[inline]
    #[must_use]
    pub fn at(&self, textures: &Textures, uv: [f32; 2]) -> Spectral {
        match self.texture {
            Some(t) => self.value * textures.eval(t, uv),
            None => self.value,
        }
    }
}

/// One number, times the first channel of an image where there is one.
#[derive(Clone, Copy, Debug)]
pub struct Scalar {
    /// The value, or the factor of the image.
    pub value: f32,
    /// Index of the image.
    pub texture: Option<u32>,
}

impl Scalar {
    /// The same everywhere.
    #[must_use]
    pub fn uniform(value: f32) -> Self {
        Self { value, texture: None }
    }

    /// Its value at texture coordinates.
    #[inline]
    #[must_use]
    pub fn at(&self, textures: &Textures, uv: [f32; 2]) -> f32 {
        match self.texture {
            Some(t) => self.value * textures.eval(t, uv).to_array()[0],
            None => self.value,
        }
    }
}
