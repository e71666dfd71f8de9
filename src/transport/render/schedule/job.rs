//! Describes a render to its sink: the layouts of slices and the provenance.

use crate::accumulate::SlicePlan;
use crate::device::distortion::Distortion;
use crate::device::distortion::opencv::Opencv;
use crate::device::pinhole::Pinhole;
use crate::render::strategies::strategies;
use crate::scene::Scene;
use serde_json::{Map, Value, json};
use tensor::sink::{Job, JobSlice};
use tensor::slice::Slice;

/// Returns the job of rendering all slices of a scene. `plans` must be the result of [`plans`] for the scene.
pub(super) fn job(scene: &Scene, plans: &[SlicePlan]) -> Job {
    let slices = scene.slices.iter().zip(plans).map(|(slice, plan)| JobSlice {
        layout: plan.layout.clone(),
        attributes: slice_attributes(scene, slice, plan),
    });
    Job {
        slices: slices.collect(),
        attributes: provenance(scene),
        camera: scene.camera.resolution,
        tile: scene.settings.tile,
    }
}

/// Returns the plan of each slice, which maps contributions to elements of the slice.
pub(super) fn plans(scene: &Scene) -> Vec<SlicePlan> {
    let extents = scene.extents();
    scene.slices.iter().map(|s| SlicePlan::new(s, &extents)).collect()
}

/// Returns the attributes that describe the render and are known before the render starts.
fn provenance(scene: &Scene) -> Map<String, Value> {
    let pose = |p: &Pinhole| {
        let per = if p.parallel { "pixels_per_m" } else { "focal_px" };
        json!({
            "resolution": p.resolution,
            per: [p.focal.x, p.focal.y],
            "principal_px": [p.principal.x, p.principal.y],
            "distortion": lens(&p.distortion),
            "origin_m": p.origin.to_array(),
            "right": p.axes.x_axis.to_array(), "down": p.axes.y_axis.to_array(), "forward": p.axes.z_axis.to_array(),
        })
    };
    let mut map = Map::new();
    let mut put = |k: &str, v: Value| map.insert(k.into(), v);
    put("title", json!(scene.name));
    put(
        "conventions",
        json!(
            "Stokes, Mueller and frames as in CONVENTIONS.md (Mitsuba 3's); Mueller matrices map projector-frame Stokes to camera-frame Stokes"
        ),
    );
    put("scene_sha256", json!(scene.sha256));
    put("scene", json!(scene.text));
    if let Some(variant) = &scene.variant {
        put("variant", json!(variant));
    }
    put("seeds", json!([scene.settings.seed]));
    put("samples_per_pixel", json!(scene.settings.spp));
    put("replicates_per_pixel", json!(scene.settings.spp / scene.settings.group().size()));
    put("max_depth", json!(scene.settings.max_depth));
    put("integrator", json!(scene.settings.integrator.name()));
    if let Some(why) = scene.why_integrator() {
        put("integrator_because", json!(why));
    }
    put("strategies", json!(strategies(scene).names()));
    put("tile", json!(scene.settings.tile));
    put("wavelengths_nm", json!(scene.wavelengths.nm()));
    put("camera", pose(&scene.camera));
    if let Some(p) = &scene.projector {
        let mut v = pose(&p.pinhole);
        v["irradiance"] = json!(p.irradiance.to_array()[..scene.wavelengths.count()]);
        v["coaxial"] = json!(p.coaxial);
        put("projector", v);
    }
    map
}

/// Returns lens coefficients by name. The result contains the five coefficients of the Brown–Conrady model,
/// and all other coefficients that are non-zero.
fn lens(distortion: &Distortion) -> Value {
    let lens = match distortion {
        Distortion::None => Opencv::default(),
        Distortion::Opencv(lens) => *lens,
        Distortion::Fisheye(lens) => return json!({ "fisheye": lens.k }),
    };
    let Opencv { k1, k2, k3, p1, p2, .. } = lens;
    let mut out = json!({"k1": k1, "k2": k2, "k3": k3, "p1": p1, "p2": p2});
    let more = [
        ("k4", lens.k4),
        ("k5", lens.k5),
        ("k6", lens.k6),
        ("s1", lens.s1),
        ("s2", lens.s2),
        ("s3", lens.s3),
        ("s4", lens.s4),
        ("tau_x", lens.tilt.tau[0]),
        ("tau_y", lens.tilt.tau[1]),
    ];
    for (name, value) in more.into_iter().filter(|(_, v)| *v != 0.0) {
        out[name] = json!(value);
    }
    out
}

fn slice_attributes(scene: &Scene, slice: &Slice, plan: &SlicePlan) -> Map<String, Value> {
    use tensor::slice::ProjectorSelect as P;
    let mut map = Map::new();
    // Users need the following values to place a drive pattern on the projector axes of the slice.
    if let Some(p) = &scene.projector {
        let bin = match slice.projector {
            P::Binned { nx, ny } => [nx, ny],
            _ => [1, 1],
        };
        map.insert("projector_size".into(), json!(p.pinhole.resolution));
        map.insert("projector_bin".into(), json!(bin));
    }
    map.insert("pixels_per_element".into(), json!(plan.pixels_per_element()));
    let projector = match &slice.projector {
        P::Sum => "sum".into(),
        P::All => "all".into(),
        P::Rows(_) => "rows".into(),
        P::Columns(_) => "columns".into(),
        P::Block(_) => "block".into(),
        P::Binned { nx, ny } => format!("binned {nx} x {ny}"),
        P::Mask { name, .. } => format!("mask {name}"),
        P::Epipolar { half_width_px } => format!("epipolar, half width {half_width_px} px"),
        P::EpipolarAlong { half_width_px, along } => {
            let along = along.kind().name();
            format!("epipolar, half width {half_width_px} px, along {along}")
        }
        P::NonEpipolar { half_width_px } => format!("nonepipolar, half width {half_width_px} px"),
        P::Coaxial => "coaxial".into(),
        P::Ambient => "ambient".into(),
    };
    map.insert("projector_selection".into(), json!(projector));
    map
}
