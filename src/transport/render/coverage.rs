//! What light of a scene its integrator cannot find.
//!
//! Projector and camera are points, so light that leaves one of them by a single direction (over a mirror, through smooth
//! glass) reaches a given point of a surface by chance never. Paths from the camera miss what the projector sends that
//! way; paths from both ends miss what is bent on both sides of a single rough surface, but for what manifold connections
//! find through interfaces and over mirrors.

use crate::device::pinhole::Pinhole;
use crate::geometry::ray::Ray;
use crate::scene::{Integrator, Scene};
use glam::DVec2;

/// Rays along each side of a device's image that are asked what they meet.
const GRID: u32 = 48;

/// Shares of a device's image whose rays meet a surface that sends light in single directions: a mirror, an interface that
/// manifold connections can follow, and a crystal whose rays part ways.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Meets {
    mirror: f64,
    interface: f64,
    split: f64,
}

impl Meets {
    fn any(&self) -> bool {
        self.mirror + self.interface + self.split > 0.0
    }
}

fn meets(scene: &Scene, device: &Pinhole) -> Meets {
    let mut meets = Meets::default();
    let [w, h] = device.resolution.map(f64::from);
    let one = 1.0 / f64::from(GRID * GRID);
    for k in 0..GRID * GRID {
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
        let pixel = DVec2::new(w * at(k % GRID), h * at(k / GRID));
        let mut ray = Ray {
            origin: device.origin,
            dir: device.direction(pixel),
        };
        // Sheets and null boundaries do not bend light.
        for _ in 0..64 {
            let Some(hit) = scene.geometry.intersect(&ray, f32::INFINITY) else {
                break;
            };
            let surface = scene.geometry.surface(&ray, &hit);
            let id = surface.material;
            if scene.materials.is_null(id) || scene.materials.straight(id, &surface, -ray.dir).is_some() {
                ray.origin = scene.geometry.leave(&surface, ray.dir);
                continue;
            }
            if scene.materials.is_interface(id) {
                meets.interface += one;
            } else if scene.materials.is_crystal(id) {
                meets.split += one;
            } else if !scene.materials.has_extended_lobe(id) {
                meets.mirror += one;
            }
            break;
        }
    }
    meets
}

/// What the scene's integrator cannot find of its light, a sentence each; none if nothing is known to be missing.
#[must_use]
pub fn missing(scene: &Scene) -> Vec<String> {
    let mut out = vec![];
    if !scene.lights.distant.is_empty() && scene.materials.any_redirecting() {
        out.push(
            "beams and directional light shine straight on surfaces alone: where mirrors, smooth glass or crystals send that \
             light is not found; use a spot or a shining surface"
                .to_owned(),
        );
    }
    let Some(projector) = &scene.projector else {
        return out;
    };
    let lit = meets(scene, &projector.pinhole);
    let percent = |share: f64| format!("{:.0} %", (100.0 * share).max(1.0));
    let both = scene.settings.integrator == Integrator::Bidirectional;
    if !both && lit.mirror + lit.split > 0.0 {
        out.push(format!(
            "{} of the projector's pixels shine on mirrors or crystals, and integrator = \"path\" does not find where that \
             light goes; set integrator = \"bidirectional\"",
            percent(lit.mirror + lit.split)
        ));
    }
    if !both && lit.interface > 0.0 {
        out.push(if scene.settings.manifold {
            format!(
                "{} of the projector's pixels shine on smooth interfaces; of that light, what is reflected there is not \
                 found; integrator = \"bidirectional\" finds it",
                percent(lit.interface)
            )
        } else {
            format!(
                "{} of the projector's pixels shine on smooth interfaces, and integrator = \"path\" does not find where that \
                 light goes; set integrator = \"bidirectional\", or manifold = true for what passes straight through",
                percent(lit.interface)
            )
        });
    }
    if both && lit.any() {
        let seen = meets(scene, &scene.camera);
        if !scene.settings.manifold && seen.any() {
            out.push(
                "surfaces that are lit and seen over mirrors or through smooth interfaces, without a second rough surface or a \
                 medium in between, stay dark; set manifold = true"
                    .to_owned(),
            );
        } else if lit.split > 0.0 && seen.split + seen.mirror > 0.0 {
            out.push(
                "surfaces that are lit through crystals with split = true and seen through such crystals or in mirrors, without \
                 a second rough surface or a medium in between, stay dark: no connection leads through both"
                    .to_owned(),
            );
        }
    }
    out
}
