//! Converts emitters and emissive objects to Mitsuba's emitters.
//!
//! Mitsuba's emitters are unpolarized, and their only intensity profile is a cone. Images of emitters are
//! exported for one wavelength, as numbers, because Mitsuba's spectral variants would convert image colours
//! to spectra.

use super::export_output::{Output, bitmap, device, spectrum};
use super::files::Contents;
use super::xml::{Element, single};
use crate::build::context::Context;
use crate::build::lights::Emitters;
use base::locate::InputError;
use glam::{DAffine3, DMat3, Vec3A};
use image::{DynamicImage, ImageBuffer, Rgb};
use import::picture;
use std::f64::consts::PI;
use std::ops::Range;
use syntax::device::EmitterFile;
use syntax::scene::SceneFile;
use transport::device::emitter::{PointEmitter, Slide};
use transport::light::area::AreaLight;
use transport::light::distant::{Across, Distant};
use transport::light::filter::Polarized;
use transport::light::profile::Profile;
use transport::light::sky::{Rows, Sky};
use transport::material::texture::{Image, Textures};

pub(super) struct EmitterWriter<'a> {
    pub ctx: &'a Context,
    pub out: &'a mut Output,
}

impl EmitterWriter<'_> {
    /// Converts all emitters of the scene file's `[[emitters]]`.
    pub fn all(
        &mut self,
        file: &SceneFile,
        all: &Emitters,
        textures: &Textures,
    ) -> Result<Vec<Element>, InputError> {
        let mut done = vec![];
        let places = |is: fn(&EmitterFile) -> bool| {
            let these = file.emitters.iter().filter(move |e| is(e));
            these.map(base::locate::Located::span)
        };
        let is_point =
            |e: &EmitterFile| matches!(e, EmitterFile::Point(_) | EmitterFile::Spot(_) | EmitterFile::Ies(_));
        let slides = places(|e| matches!(e, EmitterFile::Slide(_)));
        for (point, at) in all.points.iter().zip(places(is_point).chain(slides)) {
            done.push(self.point(point, textures, at)?);
        }
        let is_distant = |e: &EmitterFile| matches!(e, EmitterFile::Directional(_) | EmitterFile::Beam(_));
        for (distant, at) in all.lights.distant.iter().zip(places(is_distant)) {
            done.push(self.distant(distant, at)?);
        }
        if let Some(environment) = &all.environment {
            let radiance = spectrum(&self.ctx.wavelengths, "radiance", environment.radiance);
            done.push(Element::plugin("emitter", "constant").child(radiance));
        }
        if let Some(sky) = &all.lights.sky {
            let at = places(|e| matches!(e, EmitterFile::Environment(_))).next();
            done.push(self.sky(sky, at.unwrap_or_default())?);
        }
        Ok(done)
    }

    fn cannot<T>(&self, at: Range<usize>, what: &str, fix: &str) -> Result<T, InputError> {
        Err(self.ctx.error(at, format!("Mitsuba cannot express {what}"), fix))
    }

    fn unpolarized(&self, light: &Polarized, at: Range<usize>) -> Result<(), InputError> {
        if light.filter.is_some() {
            return self.cannot(at, "a polarized emitter", "remove stokes and polarizer_deg");
        }
        Ok(())
    }

    fn point(
        &mut self,
        point: &PointEmitter,
        textures: &Textures,
        at: Range<usize>,
    ) -> Result<Element, InputError> {
        let intensity = spectrum(&self.ctx.wavelengths, "intensity", point.intensity);
        Ok(match &point.profile {
            Profile::Even => Element::plugin("emitter", "point")
                .child(vector("point", "position", point.position))
                .child(intensity),
            Profile::Spot { axis, beam, cutoff } => {
                let frame = match &point.slide {
                    None => optics::polarization::frame::basis(*axis),
                    Some(slide) => slide.frustum.to_local.transpose(),
                };
                let columns = [frame.x_axis, frame.y_axis, frame.z_axis].map(glam::Vec3A::as_dvec3);
                let place = DAffine3::from_mat3_translation(
                    DMat3::from_cols(columns[0], columns[1], columns[2]),
                    point.position.as_dvec3(),
                );
                let spot = Element::plugin("emitter", "spot")
                    .float("cutoff_angle", f64::from(cutoff.to_degrees()))
                    .float("beam_width", f64::from(beam.to_degrees()))
                    .transform("to_world", &place)
                    .child(intensity);
                match &point.slide {
                    Some(slide) => spot.child(self.slide("texture", slide, textures, at)?),
                    None => spot,
                }
            }
            Profile::Frustum(frustum) => {
                let Some(slide) = &point.slide else {
                    unreachable!("a frustum belongs to a slide, and each slide has an image")
                };
                Element::plugin("emitter", "projector")
                    .float("fov", 2.0 * f64::from(frustum.half.x).atan().to_degrees())
                    .string("fov_axis", "x")
                    .float("scale", f64::from(point.intensity.to_array()[0]) / PI)
                    .transform("to_world", &device(point.position, frustum.to_local.transpose()))
                    .child(self.slide("irradiance", slide, textures, at)?)
            }
            Profile::Table(_) => {
                return self.cannot(at, "an IES profile", "use a point or a spot");
            }
        })
    }

    fn distant(&mut self, distant: &Distant, at: Range<usize>) -> Result<Element, InputError> {
        self.unpolarized(&distant.polarized, at.clone())?;
        let Across::Even(irradiance) = distant.across else {
            return self.cannot(at, "a beam", "use a directional emitter, or a spot");
        };
        if distant.origin.is_some() {
            self.out.note("Mitsuba's directional emitter is infinitely distant; the origin is not exported");
        }
        Ok(Element::plugin("emitter", "directional")
            .child(vector("vector", "direction", distant.dir))
            .child(spectrum(&self.ctx.wavelengths, "irradiance", irradiance)))
    }

    fn sky(&mut self, sky: &Sky, at: Range<usize>) -> Result<Element, InputError> {
        self.unpolarized(&sky.polarized, at.clone())?;
        self.at_one_wavelength(at.clone(), "an environment image")?;
        let [w, h] = sky.size();
        let at_row = |k: usize, i: usize| sky.texels[k.min(h - 1) * w + i][0];
        // Mitsuba's rows span from pole to pole. The h rows at cell centres become the odd rows of 2h + 1
        // rows. Each even row is the mean of its neighbours.
        let value = |k: usize, i: usize| match (sky.rows(), k % 2) {
            (Rows::Poles, _) => at_row(k, i),
            (Rows::Centres, 1) => at_row(k / 2, i),
            (Rows::Centres, _) => 0.5 * (at_row((k / 2).saturating_sub(1), i) + at_row(k / 2, i)),
        };
        let rows = match sky.rows() {
            Rows::Poles => h,
            Rows::Centres => 2 * h + 1,
        };
        let values = (0..rows * w).map(|n| value(n / w, n % w));
        let file = self.exr("sky.exr", [w as u32, rows as u32], values, at)?;
        let columns = [sky.to_world().x_axis, sky.to_world().y_axis, sky.to_world().z_axis];
        let columns = columns.map(glam::Vec3A::as_dvec3);
        let place = DAffine3::from_mat3(DMat3::from_cols(columns[0], columns[1], columns[2]));
        Ok(Element::plugin("emitter", "envmap").string("filename", &file).transform("to_world", &place))
    }

    pub fn area(
        &mut self,
        light: &AreaLight,
        textures: &Textures,
        at: Range<usize>,
    ) -> Result<Element, InputError> {
        self.unpolarized(&light.polarized, at.clone())?;
        if light.two_sided {
            return self.cannot(
                at,
                "a two-sided emitting surface",
                "remove two_sided, or use two surfaces back to back",
            );
        }
        let open = Element::plugin("emitter", "area");
        let Some(texture) = light.radiance.texture else {
            return Ok(open.child(spectrum(&self.ctx.wavelengths, "radiance", light.radiance.value)));
        };
        let image = textures.images[texture as usize];
        let scale = light.radiance.value.to_array()[0];
        Ok(open.child(self.image("radiance", textures, image, scale, at)?))
    }

    /// Converts the image that a point emitter projects. In Mitsuba, the v axis of a projected image points
    /// down.
    fn slide(
        &mut self,
        name: &str,
        slide: &Slide,
        textures: &Textures,
        at: Range<usize>,
    ) -> Result<Element, InputError> {
        let image = textures.images[slide.texture as usize];
        let uv = image.uv.map(|[a, b, c]| [a, -b, b + c]);
        self.image(name, textures, Image { uv, ..image }, 1.0, at)
    }

    /// Writes an emitter's image as a texture, with texels multiplied by `scale`.
    fn image(
        &mut self,
        name: &str,
        textures: &Textures,
        image: Image,
        scale: f32,
        at: Range<usize>,
    ) -> Result<Element, InputError> {
        self.at_one_wavelength(at.clone(), "an image of the emission")?;
        let (first, count) = (image.first as usize, (image.width * image.height) as usize);
        let values = textures.texels[first..first + count].iter().map(|t| t[0] * scale);
        let file = self.exr("light.exr", [image.width, image.height], values, at)?;
        Ok(bitmap(name, &file, true, &Image { first: 0, ..image }))
    }

    fn at_one_wavelength(&self, at: Range<usize>, what: &str) -> Result<(), InputError> {
        if self.ctx.wavelengths.count() == 1 {
            return Ok(());
        }
        self.cannot(at, &format!("{what} at several wavelengths"), "export one wavelength (--wavelength)")
    }

    fn exr(
        &mut self,
        name: &str,
        [w, h]: [u32; 2],
        values: impl Iterator<Item = f32>,
        at: Range<usize>,
    ) -> Result<String, InputError> {
        let pixels = values.flat_map(|v| [v; 3]).collect();
        let image: Option<ImageBuffer<Rgb<f32>, Vec<f32>>> = ImageBuffer::from_raw(w, h, pixels);
        let image = DynamicImage::ImageRgb32F(image.unwrap_or_default());
        let bytes = picture::encoded(&image, image::ImageFormat::OpenExr)
            .map_err(|e| self.ctx.error(at, format!("cannot encode an image: {e}"), "use a smaller image"))?;
        Ok(self.out.file(name, Contents::Bytes(bytes)))
    }
}

fn vector(tag: &'static str, name: &str, v: Vec3A) -> Element {
    let [x, y, z] = v.to_array().map(single);
    Element::new(tag).with("name", name).with("x", x).with("y", y).with("z", z)
}
