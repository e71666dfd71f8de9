//! What people call the objects and the materials of a scene.

/// Names by number.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Names {
    /// Of objects, by the number that [`Geometry::object`](crate::geometry::bvh::Geometry::object) gives: the object's own name, or
    /// `objects[3]` where it has none (from 0, as in the file); those of groups begin with the group's name: `tree/leaf`.
    pub objects: Vec<String>,
    /// Of materials.
    pub materials: Vec<String>,
    /// The place in `materials` of each material by its number: filled and shining objects have numbers of their own for one material.
    pub material_of: Vec<u32>,
}

impl Names {
    /// The place in `materials` of the material with a number; `None` of one without a name.
    #[must_use]
    pub fn material(&self, number: u32) -> Option<u32> {
        self.material_of.get(number as usize).copied()
    }
}
