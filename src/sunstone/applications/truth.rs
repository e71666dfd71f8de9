//! Computes ground-truth maps from the geometry of a scene. The maps show the first surface that
//! camera rays hit behind smooth glass and water ([`Viewer`]).

use apply::map::Map;
use apply::pinhole::{Pinhole, Rig};
use glam::DVec2;
use tensor::layers::{LayerSet, LayerValues};
use transport::device::pinhole::Pinhole as Device;
use transport::render::layers::visible_surface::{Viewer, VisibleSurface};
use transport::scene::Scene;

/// Number of rays along each side of a pixel, to compute the share of the pixel that a material covers.
const GRID: u32 = 3;

/// Fills a map from the hit of the ray through each pixel's centre.
fn centres(scene: &Scene, channels: usize, mut fill: impl FnMut(VisibleSurface, &mut [f64])) -> Map {
    let viewer = Viewer::new(scene);
    let [w, h] = scene.camera.resolution.map(|n| n as usize);
    Map::from_fn(w, h, channels, |x, y, out| {
        out.fill(f64::NAN);
        if let Some(surface) = viewer.look(DVec2::new(x as f64 + 0.5, y as f64 + 0.5), true) {
            fill(surface, out);
        }
    })
}

/// Returns the share of each pixel that the given materials cover, from 0 to 1.
pub fn material(scene: &Scene, of: &[&str]) -> Map {
    let (viewer, names) = (Viewer::new(scene), &scene.names);
    let [w, h] = scene.camera.resolution.map(|n| n as usize);
    let is_one = |at| {
        let name = names.material(viewer.look(at, true)?.material)?;
        of.contains(&names.materials.get(name as usize)?.as_str()).then_some(())
    };
    Map::from_fn(w, h, 1, |x, y, out| {
        let within = |n: u32| (f64::from(n) + 0.5) / f64::from(GRID);
        let at = |i: u32| DVec2::new(x as f64 + within(i % GRID), y as f64 + within(i / GRID));
        let met = (0..GRID * GRID).filter(|i| is_one(at(*i)).is_some()).count();
        out[0] = met as f64 / f64::from(GRID * GRID);
    })
}

/// Returns the object number ([`transport::names::Names::objects`]) at each pixel's centre, or NaN if no
/// object is there.
pub fn object(scene: &Scene) -> Map {
    centres(scene, 1, |surface, out| out[0] = f64::from(surface.object))
}

/// Returns the texture coordinates at each pixel's centre, or NaN if no object is there. The scene must keep
/// texture coordinates ([`Scene::keep_texture_coordinates`]).
pub fn texture(scene: &Scene) -> Map {
    centres(scene, 2, |surface, out| {
        out.iter_mut().zip(surface.surface.uv).for_each(|(o, uv)| *o = f64::from(uv));
    })
}

/// Returns the layer called `name` as a map, or `None` if no layer has this name.
pub fn layer(layers: &LayerSet, name: &str) -> Option<Map> {
    let layer = layers.get(name)?;
    let [width, height] = layers.size.map(|n| n as usize);
    Some(Map {
        width,
        height,
        channels: layers.channels(layer),
        data: match &layer.values {
            LayerValues::Real(all) => all.iter().map(|v| f64::from(*v)).collect(),
            LayerValues::Number(all) => all.iter().map(|v| f64::from(*v)).collect(),
        },
    })
}

/// Returns the camera and the projector of a scene as a rig without calibration error, or `None` if the scene
/// has no projector.
pub fn rig(scene: &Scene) -> Option<Rig> {
    Some(Rig { camera: pinhole(&scene.camera), projector: pinhole(&scene.projector.as_ref()?.pinhole) })
}

fn pinhole(device: &Device) -> Pinhole {
    let axes = [device.axes.x_axis, device.axes.y_axis, device.axes.z_axis];
    Pinhole::new(
        device.resolution.map(|n| n as usize),
        device.focal.to_array(),
        device.principal.to_array(),
        device.origin.as_dvec3().to_array(),
        axes.map(|a| a.as_dvec3().to_array()),
    )
}
