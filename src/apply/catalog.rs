//! The list of all applications.

use crate::analysis::Analysis;
use crate::application::Application;
use crate::crystals::Crystals;
use crate::crystals::faces::CrystalFaces;
use crate::ellipsometry::Ellipsometry;
use crate::metamerism::Metamerism;
use crate::multibounce::{COINS, DISCO_BALL, Statue};
use crate::scattering::Scattering;
use crate::shape::application::ShapeScan;
use crate::transient::Transient;

/// Returns all applications, in the paper's order.
#[must_use]
pub fn all() -> Vec<Box<dyn Application>> {
    vec![
        Box::new(Analysis),
        Box::new(Crystals),
        Box::new(CrystalFaces),
        Box::new(Transient),
        Box::new(Ellipsometry),
        Box::new(ShapeScan),
        Box::new(Scattering),
        Box::new(DISCO_BALL),
        Box::new(COINS),
        Box::new(Statue),
        Box::new(Metamerism),
    ]
}

/// Returns the application of this name.
#[must_use]
pub fn find(name: &str) -> Option<Box<dyn Application>> {
    all().into_iter().find(|a| a.name() == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn applications_keep_to_what_they_promise() {
        let mut names = BTreeSet::new();
        for a in all() {
            assert!(names.insert(a.name()), "{} twice", a.name());
            let plan = a.plan();
            assert!(plan.test.iter().all(|t| !plan.train.contains(t)), "{}", a.name());
            assert!(plan.test.len() >= 5 && !plan.train.is_empty(), "{}", a.name());
            let unlike = |all: Vec<&str>| all.iter().collect::<BTreeSet<_>>().len() == all.len();
            assert!(unlike(a.methods().iter().map(|m| m.name).collect()), "{}", a.name());
            assert!(unlike(a.metrics().iter().map(|m| m.name).collect()), "{}", a.name());
            assert!(!a.methods().is_empty() && !a.metrics().is_empty());
        }
    }
}
