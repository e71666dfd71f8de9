//! A disco ball between painted walls (Fig. 13 a to j).

use super::methods::{application, methods};
use crate::application::{Application, Truth};
use crate::error::ApplyError;
use crate::isolation::element::{Element, Space};
use crate::isolation::seen::{self, Sight};
use crate::isolation::{self, Task, task};
use crate::observation::Observation;
use crate::paths::Path;
use tensor::label::{DIFFUSE, SPECULAR};

/// Returns whether a path leads from a facet via a wall to the camera, or in the reverse order. Paths with
/// specular reflection by the wall are included.
fn patch(p: Path) -> bool {
    p.label & SPECULAR != 0 && p.label != SPECULAR && p.bounces == 2
}

/// Returns the pixels of the walls on one diagonal through the ball's centre. With `side` = 1, the pixels are
/// to the upper right or lower left. With `side` = -1, the pixels are on the other diagonal.
pub(super) fn diagonal(o: &Observation, side: f64) -> Result<Vec<bool>, ApplyError> {
    let value = |name: &str| o.values.get(name).copied().unwrap_or(f64::NAN);
    let [x, y] = [value("ball_x"), value("ball_y")];
    let on_it = seen::within(o, "position", |p| p.len() == 3 && side * (p[0] - x) * (p[1] - y) > 0.0)?;
    let walls = seen::within(o, "walls", |share| share[0] >= 0.5)?;
    Ok(on_it.iter().zip(&walls).map(|(a, b)| *a && *b).collect())
}

/// The tasks from the captions of Fig. 13.
const TASKS: [Task; 6] = [
    // Fig. 13 c "isolates the remaining specular reflection on the diffuse planes".
    task!("gloss of walls", Path::single_specular, 0.05).named(Element::of(Space::Epipolar, [0, 1])),
    // Fig. 13 d "removes the specular reflection".
    task!("walls without gloss", |p| p.label == DIFFUSE, 0.8).named(Element::of(Space::Epipolar, [2, 1])),
    // Fig. 13 e "captures the diffuse direct interreflections between the red and blue planes".
    task!("interreflection of walls", Path::diffuse_interreflection, 0.2)
        .named(Element::of(Space::Epipolar, [3, 3]).negative()),
    // Fig. 13 h shows "the reflection from the planes and the disco ball only to the floor".
    task!("walls and ball to floor", |p| p.bounces > 1, 0.2)
        .within(|o| seen::within(o, "floor", |share| share[0] >= 0.5))
        .named(Element::of(Space::NonEpipolar, [1, 0]).negative()),
    // Fig. 13 i and j show "the reflections with different directions from the disco ball to the planes". For
    // light that a facet reflects to the upper right or lower left, the plane of incidence at the facet is at
    // +45°. For light along the other diagonal, the plane of incidence is at -45°. The sign of (0,2)
    // distinguishes these two directions best.
    task!("ball along one diagonal", patch, 0.2)
        .within(|o| diagonal(o, 1.0))
        .named(Element::of(Space::NonEpipolar, [0, 2])),
    task!("ball along the other", patch, 0.2)
        .within(|o| diagonal(o, -1.0))
        .named(Element::of(Space::NonEpipolar, [0, 2]).negative()),
];

pub(crate) fn disco_ball() -> Application {
    let shows = "which Mueller element isolates which light between a disco ball and painted walls (Fig. 13)";
    let maps = [
        Truth::Material { name: "floor", of: &["floor"] },
        Truth::Material { name: "walls", of: &["floor", "white", "red", "blue"] },
        Truth::Layer { name: "position", layer: "position", through: false },
    ];
    application(["multibounce", shows, "disco_ball/variants.toml"], &maps, &TASKS, |train, test| {
        isolation::run(&TASKS, &methods(), Sight::Space, train, test)
    })
}
