//! Analyses the dimensions of the transport tensor for a room with a mirror (Baek & Heide 2021, section 3.2,
//! Fig. 2 and 3).
//!
//! Each method isolates five light components, and uses one element of the tensor, or a linear combination of
//! several elements, for each component. A method may slice one or more of these dimensions:
//! - space: epipolar or non-epipolar light,
//! - time: early or late light of a pixel,
//! - polarization: the 16 elements.
//!
//! A method learns the slice and the sign of the element from the training variants. One baseline uses only
//! the intensity of all light. Two more baselines slice only space or only time. The linear methods
//! (`isolation::IN_SPACE`) have the same baselines.

mod scanlines;

use crate::application::{Application, Outcome, Plan, Size, Truth, itself};
use crate::error::ApplyError;
use crate::isolation::seen::Sight;
use crate::isolation::{
    self, COAXIAL, Dimensions, Family, IN_SPACE, Isolation, Task, metrics_of, seen, task,
};
use crate::observation::Observation;
use crate::paths::Path;

const fn slicing(name: &'static str, source: &'static str, dimensions: [bool; 3]) -> Isolation {
    let [space, time, polarization] = dimensions;
    Isolation::new(name, source, Family::Any(Dimensions { space, time, polarization }))
}

/// The methods of single elements.
const ELEMENTS: [Isolation; 7] = [
    slicing("space, time, polarization", "Baek & Heide 2021", [true, true, true]),
    slicing("space, polarization", "Baek & Heide 2021", [true, false, true]),
    slicing("time, polarization", "Baek & Heide 2021", [false, true, true]),
    slicing("polarization only", "an element of all light", [false, false, true]),
    slicing("space only", "epipolar or other light (O'Toole et al. 2012)", [true, false, false]),
    slicing("time only", "early or late light", [false, true, false]),
    slicing("intensity only", "a photograph", [false, false, false]),
];

/// Returns all methods. The first method is the paper's method.
fn methods() -> Vec<Isolation> {
    [&ELEMENTS[..], &COAXIAL, &IN_SPACE].concat()
}

const TASKS: [Task; 5] = [
    task!("one matt", Path::single_diffuse, 0.5),
    task!("several matt", Path::diffuse_interreflection, 0.2),
    task!("mirror and matt", Path::mirror_and_diffuse, 0.5),
    task!("one specular", Path::single_specular, 0.5),
    task!("several specular", Path::multi_specular, 0.2),
];

pub(crate) fn application() -> Application {
    Application {
        name: "analysis",
        shows: "what space, time and polarization reveal about matt, mirrored, single and multiple reflections (Fig. 2, 3)",
        plan: Plan {
            scene: "mirror_room/variants.toml",
            train: (0..3).collect(),
            // Variants 3 to 9 were used to define the tasks and metrics.
            test: (10..17).collect(),
            slices: vec![seen::POLARIMETRIC, seen::EPIPOLAR, seen::TRANSIENT, seen::GATED, scanlines::SPACE],
            truth: vec![Truth::Slice { name: seen::PATHS, slice: seen::PATHS, of: itself, samples: 16 }],
            preview: Size { pixels: 64, spp: 32 },
            full: Size { pixels: 128, spp: 128 },
        },
        methods: methods().iter().map(|m| m.method).collect(),
        drawn: scanlines::elements().collect(),
        metrics: metrics_of(&TASKS),
        run,
        task: None,
    }
}

fn run(train: &[Observation], test: &[Observation]) -> Result<Outcome, ApplyError> {
    let mut outcome = isolation::run(&TASKS, &methods(), Sight::SpaceAndTime, train, test)?;
    if let Some(shown) = test.first() {
        outcome.pictures.extend(scanlines::pictures(shown)?);
    }
    Ok(outcome)
}

#[cfg(test)]
mod tests;
