//! Visibility from the camera's and the projector's pinholes, precomputed once per render.

use crate::device::pinhole::Pinhole;
use crate::geometry::view::View;
use crate::scene::Scene;

/// Views of the devices; `None` if there is no device or no view can be built.
#[derive(Default)]
pub struct Views {
    pub camera: Option<View>,
    pub projector: Option<View>,
}

impl Views {
    pub fn new(scene: &Scene) -> Self {
        let view = |device: &Pinhole| {
            let field = device.field().map(glam::DVec2::as_vec2);
            View::new(&scene.geometry, device.origin, device.axes, field, device.resolution)
        };
        Self {
            camera: view(&scene.camera),
            // Light passes sheets, which a view treats as opaque.
            projector: scene.projector.as_ref().filter(|_| !scene.sheets).and_then(|p| view(&p.pinhole)),
        }
    }
}
