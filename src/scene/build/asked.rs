//! Mesh attributes and images that materials use: state while a scene is built.

use base::locate::Located;
use std::collections::BTreeMap;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Asked {
    pub name: Located<String>,
    /// Whether the attribute must be one number, not a colour.
    pub number: bool,
    /// Largest factor of the attribute as an albedo.
    pub albedo: f64,
}

/// What a material looks up by texture coordinates.
#[derive(Clone, Debug, Default)]
pub(crate) struct Uses {
    pub asked: Option<Asked>,
    pub images: bool,
    pub heights: bool,
}

/// Uses recorded so far.
#[derive(Default)]
pub(crate) struct Attributes {
    /// Uses of the material being built.
    pub open: Uses,
    /// Uses of each finished material.
    pub of_material: BTreeMap<u32, Uses>,
}

impl Attributes {
    pub fn of(&self, material: u32) -> Option<&Asked> {
        self.of_material.get(&material)?.asked.as_ref()
    }

    pub fn has_image(&mut self) {
        self.open.images = true;
    }

    pub fn has_heights(&mut self) {
        self.open.heights = true;
    }

    pub fn heights(&self, material: u32) -> bool {
        self.of_material.get(&material).is_some_and(|uses| uses.heights)
    }

    /// Returns the attribute of any material that uses one.
    pub fn first(&self) -> Option<&Asked> {
        self.of_material.values().find_map(|uses| uses.asked.as_ref())
    }
}
