//! Coins of four metals in front of a mirror (Fig. 13). Section 6.4 of the paper states that "specular
//! interreflection often flips the circular polarization".
//!
//! The paper's captions name no elements for coins. This application uses the elements that the captions name
//! for the corresponding light of the disco ball. Each reflection by metal reverses the handedness of
//! circular polarization. The sign of (3,3) therefore separates odd from even numbers of reflections. Light
//! is epipolar if camera and projector view the scene directly. Light is also epipolar if the two devices
//! view the scene via the mirror. Light is not epipolar if one device views the scene directly and one device
//! views the scene via the mirror.

use super::methods::{application, methods};
use crate::application::{Application, Truth};
use crate::isolation::element::{Element, Space};
use crate::isolation::seen::{self, Sight};
use crate::isolation::{self, Task, task};
use crate::paths::Path;

/// Returns whether a path consists of exactly `bounces` reflections by metal.
fn metal(p: Path, bounces: u32) -> bool {
    p.all_specular() && p.bounces == bounces
}

const TASKS: [Task; 5] = [
    task!("one reflection by metal", |p| metal(p, 1), 0.2)
        .named(Element::of(Space::Epipolar, [3, 3]).negative()),
    task!("two reflections by metal", |p| metal(p, 2), 0.5).named(Element::of(Space::NonEpipolar, [3, 3])),
    task!("three reflections by metal", |p| metal(p, 3), 0.2)
        .named(Element::of(Space::Epipolar, [3, 3]).negative()),
    // The element is -(1,0), as for the floor under the disco ball.
    task!("mirror to table", Path::one_mirror_one_diffuse, 0.2)
        .within(|o| seen::within(o, "table", |share| share[0] >= 0.5))
        .named(Element::of(Space::NonEpipolar, [1, 0]).negative()),
    // The element is (2,1), which "removes the specular reflection".
    task!("table alone", Path::single_diffuse, 0.5).named(Element::of(Space::Epipolar, [2, 1])),
];

pub(crate) fn coins() -> Application {
    let shows = "which Mueller element isolates which light between coins and a mirror (Fig. 13)";
    let table = Truth::Material { name: "table", of: &["table"] };
    application(
        ["multibounce-coins", shows, "coins_mirror/variants.toml"],
        &[table],
        &TASKS,
        |train, test| isolation::run(&TASKS, &methods(), Sight::Space, train, test),
    )
}
