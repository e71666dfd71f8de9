//! Starts the paths of a camera pixel.

use super::{BATCH, Batch, Path, Paths};
use crate::geometry::many;
use crate::geometry::ray::Ray;
use crate::material::Filling;
use crate::render::emitter_hits::DirectionSampling;
use arrayvec::ArrayVec;
use optics::polarization::chain::Chain;
use optics::sampling::stream::Stream;

impl Paths {
    /// Starts a path for each sample. Returns, for each path, the index of the cell of the camera's view that
    /// contains the path's ray.
    #[inline(always)]
    pub(super) fn start(&mut self, batch: &Batch) -> [u32; BATCH] {
        let &Batch { scene, views, pixel: [x, y], group, .. } = batch;
        let (camera, pixel) = (&scene.camera, y * scene.camera.resolution[0] + x);
        let mut at = [[f64::from(x); BATCH], [f64::from(y); BATCH]];
        let mut streams: ArrayVec<Stream, BATCH> = ArrayVec::new();
        for (n, sample) in batch.samples.clone().take(BATCH).enumerate() {
            let mut stream = Stream::stratified(scene.settings.seed, pixel, sample, group);
            let [jx, jy] = stream.uniform2();
            at[0][n] += f64::from(jx);
            at[1][n] += f64::from(jy);
            streams.push(stream);
        }
        let dirs = camera.directions(&at);
        let (ones, lanes) = (scene.wavelengths.ones(), scene.lanes());
        // Paths are modified in place because they are large.
        self.paths.resize_with(BATCH, Path::default);
        for (n, (path, stream)) in self.paths.iter_mut().zip(streams).enumerate() {
            let (state, dir) = (&mut path.state, many::get(&dirs, n));
            state.ray = Ray { origin: camera.origin, dir };
            state.from = camera.origin.as_dvec3();
            state.chain = Chain::start(ones);
            state.frame = camera.frame(dir);
            state.optical_m = 0.0;
            state.filling = Filling::VACUUM;
            state.lanes = lanes;
            state.label = 0;
            path.stream = stream;
            path.chosen = DirectionSampling::alone(camera.origin);
            path.density = 0.0;
        }
        match &views.camera {
            Some(view) => view.cells_toward(&dirs),
            None => [0; BATCH],
        }
    }
}
