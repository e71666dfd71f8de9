//! Selects the strategies that render a scene.

use super::manifold::reflectance;
use crate::material::Materials;
use crate::scene::{Integrator, Scene};
use crate::strategy::{Strategies, Strategy};

/// Returns the strategies of the scene's integrator that can find light in the scene.
pub fn strategies(scene: &Scene) -> Strategies {
    let (settings, materials) = (&scene.settings, &scene.materials);
    let both = settings.integrator.walks_from_light();
    // A single strategy from the settings excludes all other strategies.
    let alone = settings.strategy.is_some();
    let bent = settings.manifold && !alone;
    let mirrors = (0..materials.list.len() as u32).any(|id| reflectance(materials, id) > 0.0);
    let over = both && bent && mirrors;
    let inside = settings.integrator == Integrator::Path && scene.filled && !alone;
    Strategies::NONE
        .with(Strategy::NextEvent, true)
        .with(Strategy::RoughInterface, inside && materials.any(Materials::is_rough_interface))
        .with(Strategy::SmoothInterfaces, bent && materials.any(Materials::is_interface))
        .with(Strategy::FlatMirrors, over)
        .with(Strategy::CurvedMirrors, over)
        .with(Strategy::LightTracing, both)
        .with(Strategy::VertexConnection, both)
        .both(settings.strategies)
}
