//! Reports light in a scene that the scene's integrator cannot find.
//!
//! The projector and the camera have no spatial extent. Paths from the camera therefore miss light of the
//! projector that a mirror or smooth glass has redirected. Paths from both ends miss light that is redirected
//! both before and after the only rough surface on the path. Manifold connections find a part of the missing
//! light: specular paths through interfaces and crystals, and paths that mirrors reflect.

use crate::integrator_choice::meets;
use crate::scene::Scene;

/// Returns one sentence for each kind of light that the integrator is known to miss.
pub fn missing(scene: &Scene) -> Vec<String> {
    let mut out = vec![];
    if !scene.lights.distant.is_empty() && scene.materials.any_redirecting() {
        out.push(
            "light of beam and directional emitters is found only on directly illuminated surfaces; after reflection or refraction \
             by mirrors, smooth glass or crystals, this light is missing; to include the light, use a spot or an area light"
                .to_owned(),
        );
    }
    let Some(projector) = &scene.projector else {
        return out;
    };
    let lit = meets(scene, &projector.pinhole);
    let percent = |share: f64| format!("{:.0} %", (100.0 * share).max(1.0));
    let both = scene.settings.integrator.walks_from_light();
    if !both && lit.mirror + lit.split > 0.0 {
        out.push(format!(
            "{} of the projector's pixels illuminate mirrors or crystals, and integrator = \"path\" does not find the light \
             redirected there; remove `integrator`, or set `integrator = \"caustics\"`",
            percent(lit.mirror + lit.split)
        ));
    }
    if !both && lit.interface > 0.0 {
        out.push(if scene.settings.manifold {
            format!(
                "{} of the projector's pixels illuminate smooth interfaces; the light reflected there is missing; remove \
                 `integrator`",
                percent(lit.interface)
            )
        } else {
            format!(
                "{} of the projector's pixels illuminate smooth interfaces, and integrator = \"path\" does not find the light \
                 redirected there; remove `integrator`, or set manifold = true to find the transmitted light",
                percent(lit.interface)
            )
        });
    }
    if both && lit.any() && !scene.settings.manifold && meets(scene, &scene.camera).any() {
        out.push(
            "light that is redirected by mirrors or smooth interfaces both before and after a single rough surface is not \
             found; set manifold = true"
                .to_owned(),
        );
    }
    out
}
