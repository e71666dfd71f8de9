//! Finds the apparent positions of devices, as seen through interfaces from inside a medium.
//!
//! Rays of a device are traced until a medium scatters them. If all earlier interactions are specular, the
//! last segment is a line from the apparent device. The apparent position is the point nearest to the lines
//! of all rays. Through a flat pane, this point is the virtual image, which is slightly blurred because the
//! image depends on the angle of incidence.

use super::{Emission, End, Ends, First, Guide, Limits, Site, Splitting, Walk};
use crate::render::bidirectional::most;
use crate::render::state::From;
use crate::scene::Scene;
use glam::{DMat3, DVec2, DVec3, Vec3A};
use optics::sampling::stream::Stream;
use std::f32::consts::PI;

/// Minimum forward peak of a phase function, relative to isotropic scattering, for which large deflections
/// are rare.
const LEAST_PEAK: f32 = 3.0;

/// Number of rays along each side of a device's image that are traced into media.
const GRID: u32 = 48;

/// Minimum fraction of rays that must enter a medium without diffuse scattering for the device to be a target
/// in the medium.
const LEAST_SEEN: f64 = 0.01;

/// Maximum number of interfaces on a ray.
const MOST_INTERFACES: u32 = 12;

/// Key of the random streams of the traced rays.
const SEED: u64 = 0x1bd1_1bda_a9fc_1a22;

/// Sums over lines, from which the point nearest to all lines is computed by the method of least squares.
#[derive(Clone, Copy)]
struct Lines {
    count: u32,
    /// Sum Σ (1 - d dᵀ) over lines through p along d. `vector` is the sum Σ (1 - d dᵀ) p.
    matrix: DMat3,
    vector: DVec3,
}

impl Lines {
    const NONE: Self = Self { count: 0, matrix: DMat3::ZERO, vector: DVec3::ZERO };

    fn add(&mut self, p: Vec3A, dir: Vec3A) {
        let (p, d) = (p.as_dvec3(), dir.as_dvec3());
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        self.count += 1;
        self.matrix += across;
        self.vector += across * p;
    }

    /// Returns the point nearest to all lines, or `None` if there are too few lines or if the lines are
    /// nearly parallel.
    fn nearest(&self) -> Option<Vec3A> {
        if f64::from(self.count) < LEAST_SEEN * f64::from(GRID * GRID) {
            return None;
        }
        let scale = 1.0 / f64::from(self.count);
        let matrix = self.matrix * scale;
        (matrix.determinant() > 1e-6).then(|| (matrix.inverse() * (self.vector * scale)).as_vec3a())
    }
}

/// Returns the lines along which rays enter media without diffuse scattering, by device and medium. `start`
/// returns a ray through a point of a device's image (in [0, 1]²) and the index of the device.
fn seen(
    scene: &Scene,
    from: From,
    devices: usize,
    start: impl Fn([f32; 2], &mut Stream) -> Option<(End, usize)>,
) -> Vec<Vec<Lines>> {
    let mut lines = vec![vec![Lines::NONE; scene.media.list.len()]; devices];
    let (unguided, mut walk) = (Guide::default(), Walk::default());
    let limits = Limits {
        interactions: most(scene).min(MOST_INTERFACES),
        point: usize::MAX,
        escapes: false,
        labelled: false,
        first: First::Anything,
        splitting: Splitting::Never,
    };
    for k in 0..GRID * GRID {
        let mut stream = Stream::new(SEED, k, from as u32);
        let at = [k % GRID, k / GRID].map(|i| (i as f32 + 0.5) / GRID as f32);
        let Some((end, device)) = start(at, &mut stream) else {
            continue;
        };
        walk.run(scene, &unguided, from, &end, &mut stream, limits);
        let first = walk.points.iter().skip(1).find(|p| !p.delta);
        if let Some(point) = first
            && let Site::Volume(id) = point.site
        {
            lines[device][id as usize].add(point.surface.p, point.back);
        }
    }
    lines
}

/// Finds targets in all forward-scattering media of a scene.
pub(crate) fn find(scene: &Scene, emission: &Emission) -> Guide {
    let mut guide = Guide::none(&scene.media);
    let dir = Vec3A::Z;
    let peak = |id: u32| 4.0 * PI * scene.media.pdf(id, scene.lanes(), dir, -dir);
    let peaked: Vec<u32> = (0..scene.media.list.len() as u32).filter(|id| peak(*id) >= LEAST_PEAK).collect();
    if !scene.filled || peaked.is_empty() {
        return guide;
    }
    let ends = Ends::new(scene);
    let [w, h] = scene.camera.resolution.map(f64::from);
    let of_camera = seen(scene, From::Camera, 1, |at, _| {
        let [x, y] = at.map(f64::from);
        let mut ends = ends;
        let dir = ends.look(DVec2::new(w * x, h * y));
        Some((emission.camera_end(scene, &ends.camera, dir), 0))
    });
    let of_light = seen(scene, From::Light, emission.count(), |at, stream| {
        let begun = emission.start(scene, &ends, at, stream)?;
        Some((begun.end, begun.sender.source))
    });
    for (walks, devices) in [(From::Light, of_camera), (From::Camera, of_light)] {
        for lines in devices {
            for id in &peaked {
                if let Some(place) = lines[*id as usize].nearest() {
                    guide.add(*id, walks, place);
                }
            }
        }
    }
    guide
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns lines from a device 0.4 m in front of water. The lines are refracted according to Snell's law,
    /// for angles of up to `most` in air.
    fn through_water(index: f32, most: f32) -> Lines {
        let mut lines = Lines::NONE;
        for k in 0..GRID * GRID {
            let [x, y] = [k % GRID, k / GRID].map(|i| most * (2.0 * (i as f32 + 0.5) / GRID as f32 - 1.0));
            let dir = Vec3A::new(x.tan(), y.tan(), -1.0).normalize();
            let at = dir * (0.4 / -dir.z) + Vec3A::new(0.0, 0.0, 0.4);
            let across = Vec3A::new(dir.x, dir.y, 0.0) / index;
            let bent = across - Vec3A::Z * (1.0 - across.length_squared()).sqrt();
            lines.add(at + bent * 0.1 * (1.0 + x), bent);
        }
        lines
    }

    /// Verifies that rays near the axis appear to come from n times the distance of the device, as in
    /// Gaussian optics.
    #[test]
    fn devices_appear_at_their_images() {
        for index in [1.0, 1.333] {
            let place = through_water(index, 0.02).nearest().expect("the lines have a nearest point");
            assert!((place - Vec3A::new(0.0, 0.0, 0.4 * index)).length() < 1e-3, "{index}: {place}");
        }
        // Steeper rays appear to come from a larger distance.
        let far = through_water(1.333, 0.4).nearest().expect("a place").z;
        assert!(far > 0.4 * 1.333 * 1.01, "{far}");
    }

    /// Verifies that `nearest` returns `None` for too few lines and for parallel lines.
    #[test]
    fn parallel_lines_have_no_nearest_point() {
        let mut lines = Lines::NONE;
        for k in 0..GRID * GRID {
            lines.add(Vec3A::new(k as f32 * 0.01, 0.0, 0.0), Vec3A::Z);
        }
        assert!(lines.nearest().is_none());
        let mut few = Lines::NONE;
        few.add(Vec3A::ZERO, Vec3A::X);
        few.add(Vec3A::ZERO, Vec3A::Y);
        assert!(few.nearest().is_none());
    }
}
