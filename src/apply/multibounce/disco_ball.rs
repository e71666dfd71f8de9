//! A disco ball among painted walls (Fig. 13 a to j).

use super::{FULL, METHODS, PREVIEW, TRUTH_SAMPLES};
use crate::application::{Application, Method, Metric, Outcome, Plan, Truth};
use crate::error::ApplyError;
use crate::isolation::element::{Element, Space};
use crate::isolation::{self, Task, metrics, metrics_of, seen};
use crate::observation::Observation;
use crate::paths::Path;
use tensor::label::{DIFFUSE, SPECULAR};

/// The application.
#[derive(Clone, Copy, Debug)]
pub struct DiscoBall;

/// From a facet to a wall and from there to the camera, or the other way round; by the wall's gloss too.
fn patch(p: Path) -> bool {
    p.label & SPECULAR != 0 && p.label != SPECULAR && p.bounces == 2
}

/// What the captions of Fig. 13 say.
pub(super) const TASKS: [Task; 6] = [
    // c: "isolates the remaining specular reflection on the diffuse planes".
    Task {
        name: "gloss of walls",
        metrics: metrics!("gloss of walls"),
        light: Path::single_specular,
        region: None,
        share: 0.1,
        named: Some(Element::of(Space::Epipolar, [0, 1])),
    },
    // d: "removes the specular reflection".
    Task {
        name: "walls without gloss",
        metrics: metrics!("walls without gloss"),
        light: |p| p.label == DIFFUSE,
        region: None,
        share: 0.9,
        named: Some(Element::of(Space::Epipolar, [2, 1])),
    },
    // e: "captures the diffuse direct interreflections between the red and blue planes".
    Task {
        name: "interreflection of walls",
        metrics: metrics!("interreflection of walls"),
        light: Path::diffuse_interreflection,
        region: None,
        share: 0.2,
        named: Some(Element::of(Space::Epipolar, [3, 3]).negative()),
    },
    // h: "the reflection from the planes and the disco ball only to the floor".
    Task {
        name: "walls and ball to floor",
        metrics: metrics!("walls and ball to floor"),
        light: |p| p.bounces > 1,
        region: Some("floor"),
        share: 0.2,
        named: Some(Element::of(Space::NonEpipolar, [1, 0]).negative()),
    },
    // i, j: "the reflections with different directions from the disco ball to the planes".
    Task {
        name: "ball to left wall",
        metrics: metrics!("ball to left wall"),
        light: patch,
        region: Some("left wall"),
        share: 0.1,
        named: Some(Element::of(Space::NonEpipolar, [0, 2])),
    },
    Task {
        name: "ball to right wall",
        metrics: metrics!("ball to right wall"),
        light: patch,
        region: Some("right wall"),
        share: 0.1,
        named: Some(Element::of(Space::NonEpipolar, [0, 2]).negative()),
    },
];

impl Application for DiscoBall {
    fn name(&self) -> &'static str {
        "multibounce"
    }

    fn shows(&self) -> &'static str {
        "which element isolates which light between a disco ball and painted walls (Fig. 13)"
    }

    fn plan(&self) -> Plan {
        Plan {
            scene: "disco_ball/variants.toml",
            train: (0..3).collect(),
            test: (3..10).collect(),
            slices: vec![seen::POLARIMETRIC, seen::EPIPOLAR, seen::TRANSIENT],
            truth: vec![
                Truth::Slice {
                    name: seen::PATHS,
                    slice: seen::PATHS,
                    samples: TRUTH_SAMPLES,
                },
                Truth::Material {
                    name: "floor",
                    of: &["floor"],
                },
                Truth::Material {
                    name: "left wall",
                    of: &["red"],
                },
                Truth::Material {
                    name: "right wall",
                    of: &["blue"],
                },
            ],
            preview: PREVIEW,
            full: FULL,
        }
    }

    fn methods(&self) -> Vec<Method> {
        METHODS.iter().map(|m| m.method).collect()
    }

    fn metrics(&self) -> Vec<Metric> {
        metrics_of(&TASKS)
    }

    fn run(&self, train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError> {
        isolation::run(&TASKS, &METHODS, false, train, test)
    }
}
