//! Finds mistakes that give a valid render without the light that the user expects: a black image, and time
//! bins in which no light arrives.

use base::units::METRES_PER_PS;
use glam::DVec2;
use store::doubt;
use store::zarr::{AccessError, OpenError, StoredSlice, TensorStore};
use tensor::field::Field;
use tensor::slice::TimeSelect;
use transport::render::layers::visible_surface::{Viewer, VisibleSurface};
use transport::scene::Scene;

/// Number of camera rays along each side of the image.
const RAYS: u32 = 24;

/// Returns the first surfaces on a grid of camera rays, and the number of rays.
fn looked(scene: &Scene) -> (Vec<VisibleSurface>, u32) {
    let viewer = Viewer::new(scene);
    let [w, h] = scene.camera.resolution.map(f64::from);
    let at = |i: u32, size: f64| (f64::from(i) + 0.5) / f64::from(RAYS) * size;
    let rays = (0..RAYS * RAYS).map(|i| DVec2::new(at(i % RAYS, w), at(i / RAYS, h)));
    (rays.filter_map(|at| viewer.look(at, true)).collect(), RAYS * RAYS)
}

/// Returns one sentence for each slice whose time bins contain none of the light that the projector sends
/// directly to the visible surfaces. Scenes with other emitters are not checked.
pub fn outside_bins(scene: &Scene) -> Vec<String> {
    let Some(projector) = &scene.projector else {
        return vec![];
    };
    let others = !scene.points.is_empty()
        || scene.environment.is_some()
        || !scene.lights.areas.is_empty()
        || !scene.lights.distant.is_empty()
        || scene.lights.sky.is_some();
    let timed = |slice: &&tensor::slice::Slice| matches!(slice.time, TimeSelect::Bins { .. });
    if others || !scene.slices.iter().any(|s| timed(&s)) {
        return vec![];
    }
    let from = projector.pinhole.origin.as_dvec3();
    let lit = |s: &&VisibleSurface| projector.pinhole.project(s.at.as_vec3().into()).is_some();
    let time = |s: &VisibleSurface| (s.optical + s.at.distance(from)) / METRES_PER_PS;
    let (seen, _) = looked(scene);
    let times = seen.iter().filter(lit).map(time);
    let [first, last] = times.fold([f64::INFINITY, 0.0_f64], |[a, b], t| [a.min(t), b.max(t)]);
    let outside = |slice: &tensor::slice::Slice| {
        let TimeSelect::Bins { start_ps, bin_ps, bins } = slice.time else {
            return None;
        };
        let end_ps = start_ps + bin_ps * f64::from(bins);
        (first < f64::INFINITY && (last < start_ps || first >= end_ps)).then(|| {
            format!(
                "slice `{}` has time bins from {start_ps:.0} to {end_ps:.0} ps, but direct light arrives from {first:.0} to {last:.0} \
                 ps; change start_ps, bin_ps or bins, unless you expect only indirect light",
                slice.name
            )
        })
    };
    scene.slices.iter().filter_map(outside).collect()
}

/// Returns a sentence about the probable reason why a render of a scene is black.
pub fn black(scene: &Scene) -> String {
    let (seen, all) = looked(scene);
    let mut why = match seen.first() {
        None => "no camera ray hits an object; check pose and field of view of the camera".to_owned(),
        Some(first) => {
            let name = &scene.names.objects[first.object as usize];
            let behind = |s: &VisibleSurface| s.surface.ng.dot(s.wo) < 0.0;
            let enclosed =
                seen.len() as u32 == all && seen.iter().all(|s| s.object == first.object && behind(s));
            let farthest = seen.iter().map(|s| s.length).fold(0.0, f64::max);
            if enclosed {
                format!("the camera is inside the object `{name}`; move the camera or the object")
            } else if seen.len() as u32 == all && seen.iter().all(|s| s.object == first.object) {
                format!("the camera sees only the object `{name}`, at distances of up to {farthest:.3} m")
            } else {
                format!(
                    "{:.0} % of the camera rays hit an object",
                    100.0 * seen.len() as f64 / f64::from(all)
                )
            }
        }
    };
    if let (Some(projector), false) = (&scene.projector, seen.is_empty()) {
        let lit = |s: &&VisibleSurface| projector.pinhole.project(s.at.as_vec3().into()).is_some();
        let share = seen.iter().filter(lit).count() as f64 / seen.len() as f64;
        why += &format!(
            "; {:.0} % of the visible points are in the field of view of the projector",
            100.0 * share
        );
    }
    format!("the image is black: {why}")
}

/// Returns [`black`] if all slices of a store have no light.
///
/// # Errors
/// Returns an error if the store cannot be read.
pub fn black_store(scene: &Scene, store: &TensorStore) -> Result<Option<String>, ReadError> {
    for name in store.slice_names() {
        if has_light(&store.slice(name)?)? {
            return Ok(None);
        }
    }
    Ok(Some(black(scene)))
}

/// The store cannot be opened or read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error(transparent)]
    Access(#[from] AccessError),
}

/// Returns whether a slice contains light, in its time bins or outside. Most slices are decided by the errors
/// of totals, which are small.
fn has_light(slice: &StoredSlice) -> Result<bool, AccessError> {
    if doubt::of(slice)?.is_some_and(|doubt| doubt.lit > 0) {
        return Ok(true);
    }
    for field in [Field::Overflow, Field::Mean].into_iter().filter(|f| slice.has(*f)) {
        for (start, shape) in slice.chunks(field)? {
            if slice.read(field, &start, &shape)?.iter().any(|v| *v != 0.0) {
                return Ok(true);
            }
        }
    }
    Ok(false)
}
