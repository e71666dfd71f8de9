//! A statue next to a mirror in front of a coaxial rig (Fig. 13, "temporal-polarimetric imaging"). The paper
//! shows "the diffuse transient reflections as T(s,s,3,3,t1)" and "specular transient reflections from
//! metallic surfaces as T(s,s,3,3,t2)".
//!
//! The paper shows two times, but does not state how these times were chosen. This application learns the bin
//! of travel time of each task from the training variants, like all free parameters. Every reflection by
//! metal reverses the handedness of circular polarization. Light from the statue's gold leaf therefore has a
//! negative (3,3), whether the light is seen directly or via the mirror (three reflections). The caption's
//! positive (3,3) cannot isolate this light.

use super::methods::any;
use crate::application::{Application, Plan, Size, Truth, itself};
use crate::isolation::element::{Element, Space};
use crate::isolation::seen::Sight;
use crate::isolation::{self, COAXIAL, Family, Isolation, Task, metrics_of, seen, task};
use crate::paths::Path;
use tensor::label::SPECULAR;

/// Returns whether a path leads via the mirror to the statue and via the mirror back.
fn in_the_mirror(p: Path) -> bool {
    p.bounces == 3 && p.label & SPECULAR != 0
}

const CIRCULAR: Element = Element::of(Space::All, [3, 3]);

const TASKS: [Task; 4] = [
    task!("direct light", |p| p.bounces == 1, 0.5).named(CIRCULAR),
    task!("light by way of the mirror", in_the_mirror, 0.5).named(CIRCULAR),
    task!("metal, direct", Path::single_specular, 0.5).named(CIRCULAR),
    task!("metal in the mirror", |p| in_the_mirror(p) && p.all_specular(), 0.5).named(CIRCULAR),
];

/// The methods of single elements.
const ELEMENTS: [Isolation; 7] = [
    Isolation::new("(3,3) at a time", "Baek & Heide 2021", Family::NamedAtATime { either: false }),
    Isolation::new("(3,3) at a time, either sign", "its sign learnt", Family::NamedAtATime { either: true }),
    Isolation::new("any element at a time", "learnt: the bound of single elements", any(false, true, true)),
    Isolation::new("(3,3) without time, either sign", "its sign learnt", Family::NamedEitherSign),
    Isolation::new("polarization only", "learnt element of all light", any(false, false, true)),
    Isolation::new("time only", "learnt: (0,0) of a bin (Velten et al. 2013)", any(false, true, false)),
    Isolation::new("intensity only", "a photograph", any(false, false, false)),
];

fn methods() -> Vec<Isolation> {
    [&ELEMENTS[..], &COAXIAL].concat()
}

pub(crate) fn statue() -> Application {
    Application {
        name: "multibounce-statue",
        shows: "which Mueller element at which time isolates which light of a statue and a mirror in front of a coaxial rig (Fig. 13)",
        plan: Plan {
            scene: "statue_mirror/variants.toml",
            train: (0..6).collect(),
            test: (6..14).collect(),
            slices: vec![seen::TRANSIENT],
            truth: vec![Truth::Slice { name: seen::PATHS, slice: seen::PATHS, of: itself, samples: 4 }],
            preview: Size { pixels: 40, spp: 32 },
            full: Size { pixels: 96, spp: 128 },
        },
        methods: methods().iter().map(|m| m.method).collect(),
        drawn: vec![],
        metrics: metrics_of(&TASKS),
        run: |train, test| isolation::run(&TASKS, &methods(), Sight::Coaxial, train, test),
        task: None,
    }
}
