//! Converts images of materials to Mitsuba bitmaps.

use super::export_output::{Output, bitmap, png};
use super::xml::Element;
use crate::build::context::Context;
use base::locate::InputError;
use image::{DynamicImage, ImageBuffer, Luma, Rgb};
use std::ops::Range;
use transport::material::texture::Textures;

/// Writes the images of one material.
pub(super) struct Images<'a> {
    pub ctx: &'a Context,
    pub textures: &'a Textures,
    pub out: &'a mut Output,
    /// Location of the material in the scene file.
    pub span: Range<usize>,
    /// Prefix of the file names.
    pub stem: String,
}

impl Images<'_> {
    /// Writes a grayscale bitmap with the result of `value` for every texel. If `raw` is false, Mitsuba
    /// decodes the bitmap's values from sRGB.
    pub fn grey(
        self,
        name: &str,
        texture: u32,
        raw: bool,
        value: impl Fn(&[f32; 4]) -> f32,
    ) -> Result<Element, InputError> {
        let (size, texels) = texels(self.textures, texture);
        let pixels = texels.iter().map(|t| sixteen_bits(value(t))).collect();
        let image: Option<ImageBuffer<Luma<u16>, Vec<u16>>> = ImageBuffer::from_raw(size.0, size.1, pixels);
        let image = DynamicImage::ImageLuma16(image.unwrap_or_default());
        self.write(name, name, texture, raw, &image)
    }

    /// Writes the bitmap of a bump map.
    ///
    /// # Errors
    /// Returns [`InputError`] if the heights of the bump map are outside the range of a PNG file.
    pub fn heights(self, texture: u32) -> Result<Element, InputError> {
        let fits = |t: &[f32; 4]| (0.0..=1.0).contains(&t[0]);
        if !texels(self.textures, texture).1.iter().all(fits) {
            return Err(self.ctx.error(
                self.span.clone(),
                "an image of heights with values outside 0..1 cannot be exported",
                "divide the values by their maximum, and multiply `height` by the same maximum",
            ));
        }
        self.grey("heights", texture, true, |t| t[0])
    }

    pub fn normals(self, texture: u32) -> Result<Element, InputError> {
        let ((w, h), texels) = texels(self.textures, texture);
        let pixels = texels.iter().flat_map(|t| [t[0], t[1], t[2]].map(sixteen_bits)).collect();
        let image: Option<ImageBuffer<Rgb<u16>, Vec<u16>>> = ImageBuffer::from_raw(w, h, pixels);
        let image = DynamicImage::ImageRgb16(image.unwrap_or_default());
        self.write("normals", "normalmap", texture, true, &image)
    }

    fn write(
        self,
        ending: &str,
        name: &str,
        texture: u32,
        raw: bool,
        image: &DynamicImage,
    ) -> Result<Element, InputError> {
        let contents = png(self.ctx, self.span.clone(), image)?;
        let file = self.out.file(&format!("{}_{ending}.png", self.stem), contents);
        Ok(bitmap(name, &file, raw, &self.textures.images[texture as usize]))
    }
}

pub(super) fn texels(textures: &Textures, texture: u32) -> ((u32, u32), &[[f32; 4]]) {
    let image = &textures.images[texture as usize];
    let (first, count) = (image.first as usize, (image.width * image.height) as usize);
    ((image.width, image.height), &textures.texels[first..first + count])
}

/// Encodes a linear value in sRGB.
pub(super) fn encode(c: f32) -> f32 {
    if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

fn sixteen_bits(v: f32) -> u16 {
    (v * 65535.0).round() as u16
}
