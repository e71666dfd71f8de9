//! Visibility from the pinholes of camera and projector, precomputed once per render.

use crate::device::pinhole::Pinhole;
use crate::geometry::view::View;
use crate::scene::Scene;

/// Views from the devices. A view is `None` if the device does not exist or has no usable view.
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
            // A scene with sheets has no view, because a view would treat sheets as opaque.
            projector: scene.projector.as_ref().filter(|_| !scene.sheets).and_then(|p| view(&p.pinhole)),
        }
    }
}
