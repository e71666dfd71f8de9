//! Divides the camera image into square tiles, which are the units of rendering.

use crate::scene::Scene;
use std::ops::Range;

/// Ranges of columns and rows of camera pixels.
pub(super) struct TilePixels {
    pub x: Range<u32>,
    pub y: Range<u32>,
}

/// Returns the number of tiles in the image.
pub(super) fn count(scene: &Scene) -> u32 {
    let ([w, h], n) = (scene.camera.resolution, scene.settings.tile);
    w.div_ceil(n) * h.div_ceil(n)
}

/// Returns the ranges of camera pixels in tile number `tile`.
pub(super) fn pixels(scene: &Scene, tile: u32) -> TilePixels {
    let ([w, h], n) = (scene.camera.resolution, scene.settings.tile);
    let across = w.div_ceil(n);
    let (x, y) = (tile % across * n, tile / across * n);
    TilePixels { x: x..(x + n).min(w), y: y..(y + n).min(h) }
}

/// Returns the number of the tile that contains the camera pixel with row-major index `pixel`.
pub(crate) fn of(scene: &Scene, pixel: u32) -> u32 {
    let ([w, _], n) = (scene.camera.resolution, scene.settings.tile);
    let (x, y) = (pixel % w, pixel / w);
    y / n * w.div_ceil(n) + x / n
}
