//! Which triangle of its mesh a hit is on: asked of meshes that emit light alone.

/// Numbers of triangles in their meshes.
#[derive(Clone, Debug, Default)]
pub(super) struct Facets {
    /// Places among all triangles, rising.
    places: Vec<u32>,
    /// Number in the mesh, with [`WHOLE`] where it and the next one make a parallelogram.
    numbers: Vec<u32>,
    /// Materials of the meshes.
    pub(super) materials: Vec<u32>,
}

/// Set in the number of a parallelogram's first triangle.
const WHOLE: u32 = 1 << 31;

impl Facets {
    /// Appends the triangle at a place after all others.
    pub(super) fn add(&mut self, place: u32, number: u32, whole: bool) {
        self.places.push(place);
        self.numbers.push(number | if whole { WHOLE } else { 0 });
    }

    /// Number of the triangle at a place; `far`: the hit is on a parallelogram's second half.
    pub(super) fn find(&self, place: u32, far: bool) -> Option<u32> {
        let at = self.places.binary_search(&place).ok()?;
        let number = self.numbers[at];
        Some((number & !WHOLE) + u32::from(far && number & WHOLE != 0))
    }

    /// Memory that they take.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.places[..]) + size_of_val(&self.numbers[..]) + size_of_val(&self.materials[..])
    }
}
