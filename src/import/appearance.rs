//! The materials of mesh files: glTF's metallic-roughness model, and MTL libraries of OBJ files.

use syntax::texture::UvRows;
use transport::material::texture::{Filter, Wrap};

/// A material of a mesh file, with linear colours.
#[derive(Clone, Debug, PartialEq)]
pub struct Appearance {
    pub name: String,
    pub model: Model,
    /// Albedo of the base, or reflectance of a metal at normal incidence: red, green, blue.
    pub base: [f64; 3],
    pub image: Option<Picture>,
    pub coat: Option<Coat>,
    /// Share of metal, 0..1.
    pub metallic: f64,
    /// GGX roughness α of coat, metal and glass. The roughness α is the square of glTF's roughness.
    pub alpha: f64,
    /// An image. The green channel multiplies the roughness (the square root of α), and the blue channel
    /// multiplies the share of metal.
    pub metallic_roughness: Option<Picture>,
    /// Reflectance of a mirror blended with the base: red, green, blue.
    pub mirror: [f64; 3],
    pub ior: f64,
    /// Share of light that is transmitted instead of reaching the base, 0..1.
    pub transmission: f64,
    /// Whether transmitted light is refracted, as at the surface of a solid.
    pub refracts: bool,
    /// Share of the surface that is present, 0..1. The remaining share transmits light unchanged.
    pub opacity: f64,
    /// An image that multiplies `opacity`.
    pub opacity_image: Option<(Picture, Opacity)>,
    pub normals: Option<(Picture, f64)>,
    /// Names of the keys that are not used, as spelled in the file.
    pub unused: Vec<String>,
    /// Notes for the user about keys that are interpreted differently from the format's definition.
    pub notes: Vec<String>,
}

/// Model that defines the parameters of an [`Appearance`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// glTF 2.0, appendix B: the coat's reflection attenuates the diffuse part.
    Gltf,
    /// MTL: the colour describes the whole surface, including the coat.
    Mtl,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    pub ior: f64,
    /// Linear red, green and blue factors of the light that the coat reflects.
    pub colour: [f64; 3],
}

/// Image channel from which the opacity is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Opacity {
    First,
    Alpha,
    /// Opacity is 1 where the alpha channel times the factor is at least this value, and 0 elsewhere.
    Cut(f64),
}

#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub source: Source,
    /// Map from Sunstone's texture coordinates to image coordinates.
    pub uv: Option<UvRows>,
    pub wrap: Wrap,
    pub filter: Filter,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Path of an image file, relative to the mesh file.
    File(String),
    /// An image embedded in the mesh file: the index of the image, and the bytes of a PNG or JPEG file.
    Embedded(usize, Vec<u8>),
}

impl Appearance {
    /// Returns whether the file contains only a name: glTF's default material, or a grey MTL material.
    pub fn is_plain(&self) -> bool {
        let plain = Self {
            alpha: self.alpha,
            metallic: self.metallic,
            base: self.base,
            unused: self.unused.clone(),
            ..Self::new(self.name.clone(), self.model)
        };
        let values = match self.model {
            Model::Gltf => self.base == [1.0; 3] && self.metallic == 1.0 && self.alpha == 1.0,
            Model::Mtl => {
                self.base[0] == self.base[1] && self.base[1] == self.base[2] && self.metallic == 0.0
            }
        };
        plain == *self && values && self.unused.iter().all(|u| u == "Ka")
    }

    pub fn pictures(&mut self) -> impl Iterator<Item = &mut Picture> {
        [
            self.image.as_mut(),
            self.metallic_roughness.as_mut(),
            self.opacity_image.as_mut().map(|(p, _)| p),
            self.normals.as_mut().map(|(p, _)| p),
        ]
        .into_iter()
        .flatten()
    }

    /// Creates the default appearance for a material name.
    pub(super) fn new(name: String, model: Model) -> Self {
        Self {
            name,
            model,
            base: [1.0; 3],
            image: None,
            coat: (model == Model::Gltf).then_some(Coat { ior: 1.5, colour: [1.0; 3] }),
            metallic: 0.0,
            alpha: 1.0,
            metallic_roughness: None,
            mirror: [0.0; 3],
            ior: 1.5,
            transmission: 0.0,
            refracts: false,
            opacity: 1.0,
            opacity_image: None,
            normals: None,
            unused: vec![],
            notes: vec![],
        }
    }
}
