//! Tracks the medium of a path through nested or overlapping filled objects.
//!
//! Each filled object has a priority. Where several objects overlap, the object with the highest priority
//! fills the space. Within this space, light ignores the boundaries of the other objects (Schmidt & Budge
//! 2002, "Simple nested dielectrics in ray traced images"). If priorities are equal, the object that was
//! entered last fills the space. Nested objects therefore need no priorities.

/// Maximum number of filled objects that may contain the same point. Further objects are ignored.
pub const DEPTH: usize = 8;

/// A boundary of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Boundary {
    /// Index of the medium inside.
    pub medium: u32,
    /// Priority of the object. Among overlapping objects, the object with the highest priority fills the
    /// space.
    pub priority: i32,
    /// Index of the first boundary of the same object. The surfaces of an object may have different
    /// materials, so light may enter through one boundary and leave through another.
    pub object: u32,
}

impl Boundary {
    /// The boundary of an unfilled object.
    pub const NONE: Self = Self { medium: u32::MAX, priority: 0, object: u32::MAX };
}

/// The filled objects that contain a point, in order of entry, as indices of their first boundaries.
#[derive(Clone, Copy, Debug, Default)]
pub struct Nest {
    entered: [u32; DEPTH],
    count: u8,
}

impl Nest {
    #[inline]
    fn list(&self) -> &[u32] {
        &self.entered[..usize::from(self.count)]
    }

    /// Returns the index of the medium at the point, or `None` outside all filled objects.
    #[inline]
    pub fn medium(&self, boundaries: &[Boundary]) -> Option<u32> {
        let filled = self.list().iter().map(|id| boundaries[*id as usize]);
        // `max_by_key` returns the last of several equal elements.
        filled.max_by_key(|b| b.priority).map(|b| b.medium)
    }

    /// Returns true if boundary `id` is inside an object of higher priority and therefore has no effect on
    /// light.
    #[inline]
    pub fn hides(&self, boundaries: &[Boundary], id: u32) -> bool {
        let own = boundaries[id as usize];
        own != Boundary::NONE
            && self.list().iter().any(|other| boundaries[*other as usize].priority > own.priority)
    }

    /// Crosses boundary `id` to the inside if `enters` is true, otherwise to the outside.
    #[inline]
    pub fn cross(&mut self, boundaries: &[Boundary], id: u32, enters: bool) {
        let own = boundaries[id as usize];
        if own == Boundary::NONE {
            return;
        }
        let count = usize::from(self.count);
        if enters {
            if count < DEPTH {
                self.entered[count] = own.object;
                self.count += 1;
            }
        } else if let Some(at) = self.list().iter().rposition(|other| *other == own.object) {
            self.entered.copy_within(at + 1..count, at);
            self.count -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boundaries() -> [Boundary; 5] {
        let of = |medium, priority, object| Boundary { medium, priority, object };
        [of(10, 0, 0), of(11, 0, 1), of(12, 5, 2), Boundary::NONE, of(10, 0, 0)]
    }

    /// Verifies that boundaries 0 and 4, which belong to the same object, count as one object.
    #[test]
    fn parts_of_an_object_count_as_one() {
        let (b, mut nest) = (boundaries(), Nest::default());
        nest.cross(&b, 4, true);
        assert_eq!(nest.medium(&b), Some(10));
        nest.cross(&b, 0, false);
        assert_eq!(nest.medium(&b), None);
    }

    #[test]
    fn the_innermost_object_of_equal_priority_fills() {
        let (b, mut nest) = (boundaries(), Nest::default());
        assert_eq!(nest.medium(&b), None);
        nest.cross(&b, 0, true);
        nest.cross(&b, 1, true);
        assert_eq!(nest.medium(&b), Some(11));
        assert!(!nest.hides(&b, 0));
        nest.cross(&b, 1, false);
        assert_eq!(nest.medium(&b), Some(10));
        nest.cross(&b, 3, true);
        assert_eq!(nest.medium(&b), Some(10), "an empty object changes nothing");
        nest.cross(&b, 0, false);
        nest.cross(&b, 0, false);
        assert_eq!(nest.medium(&b), None);
    }

    /// Verifies the medium inside two overlapping objects whose boundaries are crossed in any order.
    #[test]
    fn the_highest_priority_fills_and_hides() {
        let (b, mut nest) = (boundaries(), Nest::default());
        nest.cross(&b, 2, true);
        assert!(nest.hides(&b, 0) && !nest.hides(&b, 2) && !nest.hides(&b, 3));
        nest.cross(&b, 0, true);
        assert_eq!(nest.medium(&b), Some(12));
        nest.cross(&b, 2, false);
        assert_eq!(nest.medium(&b), Some(10));
    }

    /// Verifies that more than [`DEPTH`] nested objects do not cause a failure.
    #[test]
    fn nesting_deeper_than_the_limit_does_not_fail() {
        let (b, mut nest) = (boundaries(), Nest::default());
        for _ in 0..2 * DEPTH {
            nest.cross(&b, 0, true);
        }
        assert_eq!(nest.medium(&b), Some(10));
        for _ in 0..2 * DEPTH {
            nest.cross(&b, 0, false);
        }
        assert_eq!(nest.medium(&b), None);
    }
}
