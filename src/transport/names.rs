//! Names of a scene's objects and materials.

/// Names of objects and materials by number.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Names {
    /// Object names by the number that [`Geometry::object`](crate::geometry::bvh::Geometry::object) returns.
    /// An object without a name is called `objects[3]` (counted from 0, as in the file). Names of objects in
    /// a group begin with the group's name: `tree/leaf`.
    pub objects: Vec<String>,
    pub materials: Vec<String>,
    /// Index into `materials` for each material number. Filled and emitting objects have separate material
    /// numbers.
    pub material_of: Vec<u32>,
}

impl Names {
    /// Returns the index into `materials` for a material number; `None` if the material has no name.
    pub fn material(&self, number: u32) -> Option<u32> {
        self.material_of.get(number as usize).copied()
    }
}
