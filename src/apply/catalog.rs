//! The list of all applications.

use crate::application::Application;
use crate::{analysis, crystals, ellipsometry, metamerism, multibounce, scattering, shape, transient};

/// Returns all applications, in the paper's order.
pub fn all() -> Vec<Application> {
    vec![
        analysis::application(),
        crystals::application(),
        crystals::faces::application(),
        transient::application(),
        ellipsometry::application(),
        shape::application::application(),
        scattering::application(),
        multibounce::disco_ball(),
        multibounce::coins(),
        multibounce::statue(),
        metamerism::application(),
    ]
}

pub fn find(name: &str) -> Option<Application> {
    all().into_iter().find(|a| a.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn applications_have_unique_names_and_disjoint_variants() {
        let mut names = BTreeSet::new();
        for a in all() {
            assert!(names.insert(a.name), "{} twice", a.name);
            let plan = &a.plan;
            assert!(plan.test.iter().all(|t| !plan.train.contains(t)), "{}", a.name);
            assert!(plan.test.len() >= 5 && !plan.train.is_empty(), "{}", a.name);
            let unlike = |all: Vec<&str>| all.iter().collect::<BTreeSet<_>>().len() == all.len();
            assert!(unlike(a.methods.iter().map(|m| m.name).collect()), "{}", a.name);
            assert!(unlike(a.metrics.iter().map(|m| m.name).collect()), "{}", a.name);
            assert!(!a.methods.is_empty() && !a.metrics.is_empty());
        }
    }
}
