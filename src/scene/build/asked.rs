//! What materials read of the meshes that they cover: state that is kept while a scene is built.

use base::locate::Located;
use std::collections::BTreeMap;

/// What a material asks of the meshes that it covers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Asked {
    /// Name of the attribute.
    pub name: Located<String>,
    /// It must be one number, not a colour.
    pub number: bool,
    /// Greatest factor of the albedos that it is.
    pub albedo: f64,
}

/// What a material reads by texture coordinates.
#[derive(Clone, Debug, Default)]
pub(crate) struct Uses {
    pub asked: Option<Asked>,
    /// Images or checkerboards.
    pub images: bool,
    /// A bump map among them.
    pub heights: bool,
}

/// What is asked for, and what was found so far.
#[derive(Default)]
pub(crate) struct Attributes {
    /// By the material that is being built.
    pub open: Uses,
    /// By each material.
    pub of_material: BTreeMap<u32, Uses>,
    /// Values at the corners of all triangles that have them.
    pub corners: Vec<[[f32; 4]; 3]>,
}

impl Attributes {
    /// What a material asks for.
    pub fn of(&self, material: u32) -> Option<&Asked> {
        self.of_material.get(&material)?.asked.as_ref()
    }

    /// The material that is being built has an image or a checkerboard.
    pub fn has_image(&mut self) {
        self.open.images = true;
    }

    /// The material that is being built has a bump map.
    pub fn has_heights(&mut self) {
        self.open.heights = true;
    }

    /// True if a material has a bump map.
    pub fn heights(&self, material: u32) -> bool {
        self.of_material.get(&material).is_some_and(|uses| uses.heights)
    }

    /// A place of a material that asks; of none, nothing.
    pub fn first(&self) -> Option<&Asked> {
        self.of_material.values().find_map(|uses| uses.asked.as_ref())
    }
}
