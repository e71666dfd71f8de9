//! What a mesh file says its materials look like: glTF's metallic-roughness model, and MTL libraries of OBJ files.

use syntax::texture::UvRows;
use transport::material::texture::{Filter, Wrap};

/// A material of a mesh file, linear colours.
#[derive(Clone, Debug, PartialEq)]
pub struct Appearance {
    /// As parts name it.
    pub name: String,
    /// Albedo of the base, or the reflectance of a metal at normal incidence: red, green, blue.
    pub base: [f64; 3],
    /// An image in its place.
    pub image: Option<Picture>,
    /// Share that is metal, 0..1.
    pub metallic: f64,
    /// Facets' α (the square of glTF's roughness); `None` of a base without a coat.
    pub alpha: Option<f64>,
    /// Refractive index of coat or glass.
    pub ior: f64,
    /// Share of light that is let through instead of reaching the base, 0..1.
    pub transmission: f64,
    /// A map of normals, and its strength.
    pub normals: Option<(Picture, f64)>,
    /// What is not read, by the names of the file's format.
    pub unused: Vec<String>,
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
    /// True if the file gives no more than a name.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        let Self {
            alpha,
            metallic,
            base,
            ..
        } = self;
        let plain = Self {
            alpha: *alpha,
            metallic: *metallic,
            base: *base,
            ..Self::new(self.name.clone())
        };
        // The defaults of glTF, and of an MTL library.
        let gltf = *base == [1.0; 3] && *metallic == 1.0 && *alpha == Some(1.0);
        let mtl = base[0] == base[1] && base[1] == base[2] && alpha.is_none();
        plain == *self && (gltf || mtl)
    }

    /// A grey diffuse material.
    pub(super) fn new(name: String) -> Self {
        Self {
            name,
            base: [1.0; 3],
            image: None,
            metallic: 0.0,
            alpha: None,
            ior: 1.5,
            transmission: 0.0,
            normals: None,
            unused: vec![],
        }
    }
}
