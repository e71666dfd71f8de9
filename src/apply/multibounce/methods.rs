//! The methods and the plan for the two scenes with a camera and a projector.

use crate::application::{Application, Plan, Run, Size, Truth, itself};
use crate::isolation::{COAXIAL, Dimensions, Family, IN_SPACE, Isolation, Task, metrics_of, seen};

pub(super) const fn any(space: bool, time: bool, polarization: bool) -> Family {
    Family::Any(Dimensions { space, time, polarization })
}

/// The methods of single elements. The first method is the paper's method.
const ELEMENTS: [Isolation; 8] = [
    Isolation::new("the named element", "Baek & Heide 2021", Family::Named),
    Isolation::new("the named element, either sign", "its sign learnt", Family::NamedEitherSign),
    Isolation::new(
        "the named element, any azimuth",
        "its magnitude: rows and columns 1 and 2 together",
        Family::NamedAnyAzimuth,
    ),
    Isolation::new(
        "any element of space and polarization",
        "learnt: the bound of single elements",
        any(true, false, true),
    ),
    Isolation::new("polarization only", "learnt element of all light", any(false, false, true)),
    Isolation::new(
        "space only",
        "learnt: (0,0) of epipolar or other light (O'Toole et al. 2012)",
        any(true, false, false),
    ),
    Isolation::new("time only", "learnt: (0,0) of early or late light", any(false, true, false)),
    Isolation::new("intensity only", "a photograph", any(false, false, false)),
];

/// Returns all methods.
pub(super) fn methods() -> Vec<Isolation> {
    [&ELEMENTS[..], &COAXIAL, &IN_SPACE].concat()
}

/// Returns the application of a scene. `maps` are the truth maps that define the regions of tasks. `run`
/// isolates the light of each task with [`methods`].
pub(super) fn application(
    [name, shows, scene]: [&'static str; 3],
    maps: &[Truth],
    tasks: &[Task],
    run: Run,
) -> Application {
    let paths = Truth::Slice { name: seen::PATHS, slice: seen::PATHS, of: itself, samples: 16 };
    Application {
        name,
        shows,
        plan: Plan {
            scene,
            train: (0..3).collect(),
            // Variants 3 to 9 were used to define the tasks and metrics.
            test: (10..17).collect(),
            slices: vec![seen::POLARIMETRIC, seen::EPIPOLAR, seen::TRANSIENT],
            truth: [&[paths], maps].concat(),
            preview: Size { pixels: 64, spp: 32 },
            full: Size { pixels: 128, spp: 128 },
        },
        methods: methods().iter().map(|m| m.method).collect(),
        drawn: vec![],
        metrics: metrics_of(tasks),
        run,
        task: None,
    }
}
