//! Helpers shared by the parts of an export: spectra, images, ids, and files next to the XML.

use super::files::Contents;
use super::names::{free, plain};
use super::xml::{Element, number, single};
use crate::build::context::Context;
use base::locate::InputError;
use glam::{DAffine3, DMat3, Mat3A, Vec3A};
use import::picture;
use optics::spectrum::{Spectral, Wavelengths};
use std::collections::BTreeMap;
use std::ops::Range;
use transport::material::texture::{Filter, Image, SAME, Wrap};

/// Files to write next to the XML, and notes for the user.
#[derive(Default)]
pub(super) struct Output {
    pub files: Vec<(String, Contents)>,
    pub notes: Vec<String>,
}

impl Output {
    pub fn note(&mut self, text: impl Into<String>) {
        let text = text.into();
        if !self.notes.contains(&text) {
            self.notes.push(text);
        }
    }

    /// Adds a file and returns its name: `name`, or a similar name if `name` is taken.
    pub fn file(&mut self, name: &str, contents: Contents) -> String {
        let (stem, ending) = name.rsplit_once('.').unwrap_or((name, ""));
        let file = |stem: &str| format!("{stem}.{ending}");
        let name = file(&free(stem, |stem| self.files.iter().any(|(taken, _)| *taken == file(stem))));
        self.files.push((name.clone(), contents));
        name
    }
}

/// Ends of Mitsuba's wavelength range in nanometres. The export extends all wavelength:value pairs to both
/// ends. Beyond the last pair, Mitsuba's spectra are zero and Sunstone's are constant. A refractive index of
/// zero would make the reflectance of a metal undefined.
const RANGE_NM: [f64; 2] = [360.0, 830.0];

/// Returns the XML element of a spectrum. A single value is written as a plain number, which Mitsuba's mono
/// variants use unchanged.
pub(super) fn spectrum(wavelengths: &Wavelengths, name: &str, value: Spectral) -> Element {
    let nm = wavelengths.nm();
    let lanes = &value.to_array()[..nm.len()];
    let out = Element::new("spectrum").with("name", name);
    if lanes.iter().all(|v| *v == lanes[0]) {
        return out.with("value", single(lanes[0]));
    }
    let mut pairs: Vec<(f64, f32)> = nm.iter().copied().zip(lanes.iter().copied()).collect();
    if RANGE_NM[0] < nm[0] {
        pairs.insert(0, (RANGE_NM[0], lanes[0]));
    }
    let last = nm.len() - 1;
    if RANGE_NM[1] > nm[last] {
        pairs.push((RANGE_NM[1], lanes[last]));
    }
    let pairs: Vec<String> = pairs.iter().map(|(nm, v)| format!("{}:{}", number(*nm), single(*v))).collect();
    out.with("value", pairs.join(", "))
}

/// Returns whether a value is the same at all wavelengths.
pub(super) fn is_even(wavelengths: &Wavelengths, value: Spectral) -> bool {
    !transport::material::varies(value, wavelengths.count())
}

/// Returns the device-to-world transform (metres) with Mitsuba's device axes: left, up, forward.
pub(super) fn device(origin: Vec3A, axes: Mat3A) -> DAffine3 {
    let [right, down, forward] = [axes.x_axis, axes.y_axis, axes.z_axis].map(glam::Vec3A::as_dvec3);
    DAffine3::from_mat3_translation(DMat3::from_cols(-right, -down, forward), origin.as_dvec3())
}

/// Returns the XML element of an image as a texture. In Mitsuba, the texture coordinate v starts at the top
/// of the image.
pub(super) fn bitmap(name: &str, file: &str, raw: bool, image: &Image) -> Element {
    let upward = Element::new("transform").with("name", "to_uv").child(if image.uv == SAME {
        Element::new("scale").with("x", "1").with("y", "-1")
    } else {
        let [[a, b, c], [d, e, f]] = image.uv.map(|row| row.map(f64::from));
        let rows = [[a, b, 0.0, c], [-d, -e, 0.0, 1.0 - f], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let value = rows.map(|row| row.map(number).join(" ")).join(" ");
        Element::new("matrix").with("value", value)
    });
    let mut out = Element::plugin("texture", "bitmap")
        .with("name", name)
        .string("filename", file)
        .boolean("raw", raw)
        // Store texels in the floating-point precision of Mitsuba's variant instead of half precision.
        .string("format", "variant");
    if image.filter == Filter::Nearest {
        out = out.string("filter_type", "nearest");
    }
    match image.wrap {
        Wrap::Repeat => {}
        Wrap::Mirror => out = out.string("wrap_mode", "mirror"),
        Wrap::Clamp => out = out.string("wrap_mode", "clamp"),
    }
    out.child(upward)
}

pub(super) fn png(
    ctx: &Context,
    span: Range<usize>,
    image: &image::DynamicImage,
) -> Result<Contents, InputError> {
    let bytes = picture::encoded(image, image::ImageFormat::Png)
        .map_err(|e| ctx.error(span, format!("cannot encode an image: {e}"), "use a smaller image"))?;
    Ok(Contents::Bytes(bytes))
}

/// Properties that a material requires of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Needs {
    pub uv: bool,
    /// Whether the material needs the tangent directions of the texture coordinates.
    pub tangent: bool,
}

/// Returns a unique id for a name. The id contains only characters that XML and Mitsuba's parameter syntax
/// accept.
pub(super) fn plain_id(name: &str, taken: &BTreeMap<u32, String>) -> String {
    free(&plain(name), |id| taken.values().any(|t| t == id))
}
