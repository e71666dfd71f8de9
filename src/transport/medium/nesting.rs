//! Which medium a path is in, where filled objects stand in or overlap one another.
//!
//! Every filled object has a priority. Where several overlap, the one of highest priority fills the space, and light does
//! not notice the boundaries of lower ones there (Schmidt & Budge 2002, "Simple nested dielectrics in ray traced
//! images"); among equals the one entered last counts, so plain nesting needs no numbers.

/// How many filled objects a path can be in at once; deeper ones are not noticed.
pub const DEPTH: usize = 8;

/// What the surfaces of one object bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Boundary {
    /// Number of the medium inside.
    pub medium: u32,
    /// The highest of those that overlap fills the space.
    pub priority: i32,
    /// Number of the first boundary of the same object: its parts may have materials of their own, so that light enters it by
    /// one boundary and leaves it by another.
    pub object: u32,
}

impl Boundary {
    /// Of an object that nothing fills.
    pub const NONE: Self = Self {
        medium: u32::MAX,
        priority: 0,
        object: u32::MAX,
    };
}

/// The filled objects that a point is in, in the order in which a path entered them, by the numbers of their first
/// boundaries.
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

    /// Number of the medium that fills the point; `None` outside of all filled objects.
    #[inline]
    #[must_use]
    pub fn medium(&self, boundaries: &[Boundary]) -> Option<u32> {
        let filled = self.list().iter().map(|id| boundaries[*id as usize]);
        // The last of equals.
        filled.max_by_key(|b| b.priority).map(|b| b.medium)
    }

    /// True if boundary `id` lies in an object of higher priority, so that light does not notice it.
    #[inline]
    #[must_use]
    pub fn hides(&self, boundaries: &[Boundary], id: u32) -> bool {
        let own = boundaries[id as usize];
        own != Boundary::NONE
            && self
                .list()
                .iter()
                .any(|other| boundaries[*other as usize].priority > own.priority)
    }

    /// Passes boundary `id`, to its inside if `enters`.
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
        let of = |medium, priority, object| Boundary {
            medium,
            priority,
            object,
        };
        [
            of(10, 0, 0),
            of(11, 0, 1),
            of(12, 5, 2),
            Boundary::NONE,
            of(10, 0, 0),
        ]
    }

    /// Boundaries 0 and 4 are of one object.
    #[test]
    fn parts_of_an_object_are_one() {
        let (b, mut nest) = (boundaries(), Nest::default());
        nest.cross(&b, 4, true);
        assert_eq!(nest.medium(&b), Some(10));
        nest.cross(&b, 0, false);
        assert_eq!(nest.medium(&b), None);
    }

    #[test]
    fn the_innermost_of_equals_fills() {
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

    /// Two overlapping objects, crossed in whatever order.
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

    /// Deeper than there is room for: nothing breaks.
    #[test]
    fn too_deep_is_not_noticed() {
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
