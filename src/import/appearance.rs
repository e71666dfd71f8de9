//! What a mesh file says its materials look like: glTF's metallic-roughness model, and MTL libraries of OBJ files.

use syntax::texture::UvRows;
use transport::material::texture::{Filter, Wrap};

/// A material of a mesh file, linear colours.
#[derive(Clone, Debug, PartialEq)]
pub struct Appearance {
    /// As parts name it.
    pub name: String,
    /// Whose model the numbers belong to.
    pub model: Model,
    /// Albedo of the base, or the reflectance of a metal at normal incidence: red, green, blue.
    pub base: [f64; 3],
    /// An image that multiplies it.
    pub image: Option<Picture>,
    /// A dielectric coat over the base.
    pub coat: Option<Coat>,
    /// Share that is metal, 0..1.
    pub metallic: f64,
    /// Facets' α (the square of glTF's roughness) of coat, metal and glass.
    pub alpha: f64,
    /// An image of which green multiplies roughness (the root of α) and blue the share of metal.
    pub metallic_roughness: Option<Picture>,
    /// Reflectance of a mirror beside the base: red, green, blue.
    pub mirror: [f64; 3],
    /// Refractive index of glass.
    pub ior: f64,
    /// Share of light that is let through instead of reaching the base, 0..1.
    pub transmission: f64,
    /// Light that is let through is refracted, as by the surface of something solid.
    pub refracts: bool,
    /// Share of the surface that is there, 0..1: the rest lets light pass straight on.
    pub opacity: f64,
    /// An image that multiplies it.
    pub opacity_image: Option<(Picture, Opacity)>,
    /// A map of normals, and its strength.
    pub normals: Option<(Picture, f64)>,
    /// What is not used, by the names of the file's format.
    pub unused: Vec<String>,
    /// What is used otherwise than the format says, a sentence each.
    pub notes: Vec<String>,
}

/// Whose model the numbers of an [`Appearance`] belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// glTF 2.0, appendix B: the diffuse part is weakened by what the coat reflects on the way.
    Gltf,
    /// MTL: the colour is that of the whole surface, coat included.
    Mtl,
}

/// A dielectric coat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    /// Refractive index.
    pub ior: f64,
    /// Factor of what it reflects: red, green, blue.
    pub colour: [f64; 3],
}

/// What of an image is opacity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Opacity {
    /// Its first channel.
    First,
    /// Its alpha channel.
    Alpha,
    /// 1 where its alpha channel (times the factor) is at least this, else 0.
    Cut(f64),
}

/// An image of a mesh file.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Where it is.
    pub source: Source,
    /// Where it lies on our texture coordinates.
    pub uv: Option<UvRows>,
    /// Beyond its edges.
    pub wrap: Wrap,
    /// Between its texels.
    pub filter: Filter,
}

/// Where an image is.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// A file, relative to the mesh file.
    File(String),
    /// In the file itself: a number, and the bytes of a PNG or JPEG.
    Embedded(usize, Vec<u8>),
}

impl Appearance {
    /// True if the file gives no more than a name: the default material of glTF, or a grey of an MTL library.
    #[must_use]
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

    /// All images of the material.
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

    /// What a name alone stands for.
    pub(super) fn new(name: String, model: Model) -> Self {
        Self {
            name,
            model,
            base: [1.0; 3],
            image: None,
            coat: (model == Model::Gltf).then_some(Coat {
                ior: 1.5,
                colour: [1.0; 3],
            }),
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
