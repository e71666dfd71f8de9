//! Table of the materials that an import creates, under unique names.

use super::names::{free, plain};
use super::tree::Node;
use base::locate::Located;
use std::collections::{BTreeMap, BTreeSet};
use syntax::material::{MaterialFile, NullFile, TwoSidedFile};

#[derive(Default)]
pub(super) struct Table {
    pub materials: BTreeMap<String, Located<MaterialFile>>,
    taken: BTreeSet<String>,
}

impl Table {
    /// Reserves an unused name similar to `wanted` and returns that name.
    fn free(&mut self, wanted: &str) -> String {
        let name = free(&plain(wanted), |name| self.taken.contains(name));
        self.taken.insert(name.clone());
        name
    }

    /// Adds the material of a plugin under a name similar to `wanted` and returns that name.
    pub fn add(&mut self, node: &Node, wanted: &str, material: MaterialFile) -> Located<String> {
        let name = self.free(wanted);
        let at = |material| node.at(material);
        self.materials.insert(name.clone(), at(material));
        node.at(name)
    }

    /// Adds a material as [`Self::add`] does, and makes it black from behind.
    pub fn add_front(&mut self, node: &Node, wanted: &str, material: MaterialFile) -> Located<String> {
        let name = self.free(wanted);
        let front = self.add(node, &format!("{name}_front"), material);
        let two_sided = MaterialFile::TwoSided(TwoSidedFile { front, back: None });
        self.materials.insert(name.clone(), node.at(two_sided));
        node.at(name)
    }

    /// Returns the name of the material for the invisible boundary of a medium.
    pub fn unseen(&mut self) -> String {
        let name = "mitsuba_unseen".to_owned();
        if self.taken.insert(name.clone()) {
            self.materials.insert(name.clone(), MaterialFile::Null(NullFile {}).into());
        }
        name
    }

    /// Returns the name of the material for emissive shapes without a BSDF, which reflect no light in
    /// Mitsuba.
    pub fn of_bare_lights(&mut self) -> String {
        let name = "mitsuba_light".to_owned();
        if self.taken.insert(name.clone()) {
            self.materials.insert(name.clone(), MaterialFile::diffuse(0.0).into());
        }
        name
    }

    /// Returns the name of Mitsuba's default material, for shapes that have no BSDF and emit no light.
    pub fn of_bare_shapes(&mut self) -> String {
        let name = "mitsuba_default".to_owned();
        if self.taken.insert(name.clone()) {
            let inner = self.free("mitsuba_default_front");
            let two_sided = MaterialFile::two_sided(inner.clone(), None);
            self.materials.insert(inner, MaterialFile::diffuse(0.5).into());
            self.materials.insert(name.clone(), two_sided.into());
        }
        name
    }
}
