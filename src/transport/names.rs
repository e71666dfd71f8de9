//! Names of a scene's objects and materials.

/// Names of objects and materials by index.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Names {
    /// Object names by the index that [`Geometry::object`](crate::geometry::bvh::Geometry::object) returns.
    /// An object without a name is called `objects[3]` (counted from 0, as in the file). Names of objects in
    /// a group begin with the name of the group, for example `tree/leaf`.
    pub objects: Vec<String>,
    pub materials: Vec<String>,
    /// Index into `materials` for each material index of the scene. Each object that is filled or emits light
    /// has a separate material index.
    pub material_of: Vec<u32>,
}

impl Names {
    /// Returns the index into `materials` for a material index of the scene, or `None` if there is no name.
    pub fn material(&self, number: u32) -> Option<u32> {
        self.material_of.get(number as usize).copied()
    }
}
