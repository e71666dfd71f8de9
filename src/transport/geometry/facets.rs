//! Maps a hit to the index of the triangle in its mesh, for emissive meshes only.

/// Triangles of emissive meshes, with the indices of the triangles in the meshes.
#[derive(Clone, Debug, Default)]
pub(super) struct Facets {
    /// Indices of the emissive triangles among all triangles, ascending.
    places: Vec<u32>,
    /// Index, in its mesh, of each emissive triangle, with [`WHOLE`] set if this triangle and the next form a
    /// parallelogram.
    numbers: Vec<u32>,
    /// Material indices of the emissive meshes.
    pub(super) materials: Vec<u32>,
}

/// Flag in the index of a parallelogram's first triangle.
const WHOLE: u32 = 1 << 31;

impl Facets {
    /// Appends a triangle. `place` must exceed all earlier places.
    pub(super) fn add(&mut self, place: u32, number: u32, whole: bool) {
        self.places.push(place);
        self.numbers.push(number | if whole { WHOLE } else { 0 });
    }

    /// Returns the index, in its mesh, of the triangle at `place`. If `far` is true and the triangle begins a
    /// parallelogram, returns the index of the parallelogram's second triangle.
    pub(super) fn find(&self, place: u32, far: bool) -> Option<u32> {
        let at = self.places.binary_search(&place).ok()?;
        let number = self.numbers[at];
        Some((number & !WHOLE) + u32::from(far && number & WHOLE != 0))
    }

    /// Returns the memory used by the tables, bytes.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.places[..]) + size_of_val(&self.numbers[..]) + size_of_val(&self.materials[..])
    }
}
