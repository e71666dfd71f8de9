//! Next-event estimation: connections from a surface point to the projector and to the point emitters.

use super::Views;
use super::sheets::{self, Connection};
use crate::accumulate::{Contributions, NO_PIXEL};
use crate::device::emitter::PointEmitter;
use crate::device::pinhole::OUTSIDE;
use crate::device::projector::{Arrivals, Projector};
use crate::geometry::many;
use crate::geometry::many::Many;
use crate::geometry::ray::{Hit, Ray, Surface};
use crate::geometry::rounding::END_GAP;
use crate::geometry::view::View;
use crate::light::filter::Polarized;
use crate::light::{self, Drawn};
use crate::material::{Filling, NO_CRYSTAL};
use crate::render::state::State;
use crate::scene::Scene;
use base::units::picoseconds;
use glam::Vec3A;
use optics::polarization::extent::Extent;
use optics::polarization::frame::{perpendicular, turn};
use optics::polarization::scatter::Scatter;
use optics::spectrum::Spectral;

/// A surface point on the path.
pub(super) struct ShadingPoint<'a> {
    pub scene: &'a Scene,
    /// State of the path on the ray that hit the surface.
    pub state: &'a State,
    pub hit: Hit,
    pub surface: &'a Surface,
    /// Unit direction in which light leaves the surface toward the camera.
    pub wo: Vec3A,
    /// Number of surface interactions, including the interaction at this point.
    pub bounces: u32,
}

/// Unoccluded light of the projector at several points, and the points' cells in the projector's view.
pub(super) struct Illumination<const N: usize> {
    at: Arrivals<N>,
    /// Indices of the cells of the projector's view that contain the points.
    cells: [u32; N],
}

impl<const N: usize> Illumination<N> {
    /// Computes the light of the projector at the points `p`. The first `used` points are valid. `seen_in` is
    /// the camera pixel that sees all points, if the camera shares the projector's pinhole.
    #[inline(always)]
    pub fn new(
        projector: &Projector,
        view: Option<&View>,
        p: &Many<N>,
        used: usize,
        seen_in: Option<u32>,
    ) -> Self {
        let mut at = projector.arrivals(p);
        if let Some(pixel) = seen_in {
            at.pixel = [pixel; N];
        }
        let cells = match view {
            Some(view) => {
                let cells = view.cells(&at.local);
                for cell in &cells[..used.min(N)] {
                    view.expect(*cell);
                }
                cells
            }
            None => [OUTSIDE; N],
        };
        Self { at, cells }
    }
}

/// The light of the projector at one of several points, selected by index.
#[derive(Clone, Copy)]
pub(super) struct IlluminationAt<'a, const N: usize> {
    pub lit: &'a Illumination<N>,
    pub place: usize,
}

impl<const N: usize> IlluminationAt<'_, N> {
    /// Returns the unit direction to the projector and the distance (metres).
    #[inline]
    pub fn toward(&self) -> (Vec3A, f32) {
        let at = &self.lit.at;
        (many::get(&at.wi, self.place), at.distance[self.place])
    }
}

/// Connects a surface point to the projector and to all point emitters. `lit` is the light of the projector
/// at the point. Returns the number of traced rays.
#[inline(always)]
pub(super) fn connect_all<const N: usize>(
    views: &Views,
    at: &ShadingPoint,
    lit: Option<IlluminationAt<N>>,
    out: &mut Contributions,
) -> u32 {
    let (scene, mut rays) = (at.scene, 0);
    if let (Some(projector), Some(IlluminationAt { lit, place })) = (&scene.projector, lit)
        && lit.at.pixel[place] != OUTSIDE
    {
        let a = &lit.at;
        let connection = Connection {
            wi: many::get(&a.wi, place),
            position: projector.pinhole.origin,
            distance: a.distance[place],
            irradiance: projector.irradiance * Spectral::splat(a.factor[place]),
            polarized: Polarized { axis: projector.pinhole.axes.x_axis, filter: None },
            pixel: a.pixel[place],
            start_m: 0.0,
        };
        let seen = match &views.projector {
            Some(view) => view.sees(lit.cells[place], a.local[2][place], &at.hit, at.surface),
            None => None,
        };
        rays += connect(at, &connection, seen, out);
    }
    if !scene.points.is_empty() && scene.point_tree.is_none() {
        rays += connect_points(at, out);
    }
    rays
}

/// Connects a surface point to an emitter along a line that is known to be unoccluded.
#[inline(never)]
pub(super) fn connect_known(at: &ShadingPoint, to: &Connection, out: &mut Contributions) {
    connect(at, to, Some(true), out);
}

/// Connects a surface point to all point emitters. Returns the number of traced rays.
#[inline(never)]
fn connect_points(at: &ShadingPoint, out: &mut Contributions) -> u32 {
    let mut rays = 0;
    for point in &at.scene.points {
        rays += connect_point(at, (point, 1.0), out);
    }
    rays
}

/// Connects a surface point to point emitter `number`, which was chosen with probability `chance`. Returns
/// the number of traced rays.
#[inline(never)]
pub(super) fn connect_drawn_point(
    at: &ShadingPoint,
    (number, chance): (u32, f32),
    out: &mut Contributions,
) -> u32 {
    connect_point(at, (&at.scene.points[number as usize], chance), out)
}

/// Connects a surface point to a point emitter chosen with probability `chance`. Returns the number of rays.
#[inline(always)]
fn connect_point(at: &ShadingPoint, (point, chance): (&PointEmitter, f32), out: &mut Contributions) -> u32 {
    let to = point.position - at.surface.p;
    let distance = to.length();
    if distance <= 0.0 {
        return 0;
    }
    let wi = to * distance.recip();
    let share = point.profile.value(-wi) / (distance * distance) / chance;
    if share == 0.0 {
        return 0;
    }
    let connection = Connection {
        wi,
        position: point.position,
        distance,
        irradiance: point.share(&at.scene.materials.textures, -wi, share),
        polarized: Polarized { axis: point.axis, filter: None },
        pixel: NO_PIXEL,
        start_m: 0.0,
    };
    connect(at, &connection, None, out)
}

/// Connects a surface point to all directional lights and to a sampled light. Returns the number of rays.
#[inline(never)]
pub(super) fn connect_lights(at: &ShadingPoint, drawn: Option<Drawn>, out: &mut Contributions) -> u32 {
    let &ShadingPoint { scene, surface, .. } = at;
    let lights = &scene.lights;
    let mut rays = 0;
    let distant = lights.distant.iter().filter_map(|d| d.toward(surface.p, scene.far));
    for drawn in distant.chain(drawn) {
        let share = if drawn.density > 0.0 {
            let chance = scene.materials.pdf(surface.material, surface, at.wo, drawn.wi);
            light::share(drawn.density, chance)
        } else {
            1.0
        };
        let connection = Connection {
            wi: drawn.wi,
            position: drawn.position,
            distance: drawn.distance,
            irradiance: drawn.irradiance * Spectral::splat(share),
            polarized: drawn.polarized,
            pixel: NO_PIXEL,
            start_m: drawn.start_m,
        };
        rays += connect(at, &connection, None, out);
    }
    rays
}

/// Makes one connection. The function tests the known visibility first and then evaluates the BRDF. A ray is
/// traced only if the visibility and the BRDF allow a contribution. Returns the number of traced rays.
#[inline(always)]
fn connect(at: &ShadingPoint, to: &Connection, known: Option<bool>, out: &mut Contributions) -> u32 {
    if known == Some(false) {
        return 0;
    }
    if out.labelled {
        return connect_by_kind(at, to, known, out);
    }
    let &ShadingPoint { scene, state, surface, wo, .. } = at;
    // `scatter` is used by reference, because the matrix is large.
    let scatter = scene.materials.eval_inline(surface.material, surface, wo, to.wi);
    let Some(scatter) = &scatter else {
        return 0;
    };
    match visibility(scene, surface, to, known) {
        (rays, Visibility::Hidden) => rays,
        (rays, Visibility::Visible) => rays + append(at, to, (scatter, state.label, None), out),
        (rays, Visibility::Blocked(ray)) => rays + append(at, to, (scatter, state.label, Some(ray)), out),
    }
}

/// Implements [`connect`] with a separate contribution for each kind of lobe.
#[inline(never)]
fn connect_by_kind(at: &ShadingPoint, to: &Connection, known: Option<bool>, out: &mut Contributions) -> u32 {
    let &ShadingPoint { scene, state, surface, .. } = at;
    let lobes = scene.materials.lobes(surface.material, surface, at.wo, to.wi);
    if lobes.is_empty() {
        return 0;
    }
    let (mut rays, blocked) = match visibility(scene, surface, to, known) {
        (rays, Visibility::Hidden) => return rays,
        (rays, Visibility::Visible) => (rays, None),
        (rays, Visibility::Blocked(ray)) => (rays, Some(ray)),
    };
    for (kind, scatter) in &lobes {
        rays += append(at, to, (scatter, state.label | kind, blocked), out);
    }
    rays
}

/// Visibility between a surface and an emitter.
enum Visibility {
    Visible,
    /// The ray hit a surface. The surface blocks the ray or is a sheet that transmits light.
    Blocked(Ray),
    Hidden,
}

/// Returns the number of traced rays and the visibility of an emitter. If `known` is true, the emitter is
/// visible, and no ray is traced. `known` must not be false.
#[inline(always)]
fn visibility(scene: &Scene, surface: &Surface, to: &Connection, known: Option<bool>) -> (u32, Visibility) {
    if known.is_some() {
        return (0, Visibility::Visible);
    }
    let origin = scene.geometry.leave(surface, to.wi);
    let v = to.position - origin;
    let length = v.length();
    let ray = Ray { origin, dir: v * length.recip() };
    if !scene.geometry.occluded(&ray, length * (1.0 - END_GAP)) {
        return (1, Visibility::Visible);
    }
    (1, if scene.sheets { Visibility::Blocked(ray) } else { Visibility::Hidden })
}

/// Appends the light of an emitter after scattering. The arguments include the path label and the blocked
/// ray. Returns the number of traced rays.
#[inline(always)]
fn append(
    at: &ShadingPoint,
    to: &Connection,
    (scatter, label, blocked): (&Scatter, u8, Option<Ray>),
    out: &mut Contributions,
) -> u32 {
    let &ShadingPoint { scene, state, surface, wo, .. } = at;
    let id = surface.material;
    let through = surface.ng.dot(wo) * surface.ng.dot(to.wi) < 0.0;
    let beyond = through.then(|| scene.materials.beyond(id, surface, wo, state.lanes));
    let filling = beyond.flatten().unwrap_or(state.filling);
    if let Some(shadow) = blocked {
        let ray = (shadow, filling);
        return sheets::connect(at, to, ray, (scatter, label), out);
    }
    let extent = if to.polarized.filter.is_some() {
        through_filter(at, scatter, filling, to, out)
    } else if let Scatter::Depolarize(f) = scatter {
        state.chain.finish_depolarized(*f * to.irradiance, out.elements)
    } else if filling.crystal != NO_CRYSTAL {
        through_filter(at, scatter, filling, to, out)
    } else {
        let frame_in = scatter.frame_in();
        let (c2, s2) = turn(-to.wi, to.polarized.frame(-to.wi), frame_in);
        state.chain.finish_scattered(scatter, wo, state.frame, to.irradiance, (c2, s2), out.elements)
    };
    let length = state.from.distance(to.position.as_dvec3());
    let time_ps = picoseconds(state.optical_m + f64::from(filling.index) * length + to.start_m);
    out.push(extent, time_ps, to.pixel, at.bounces, label);
    0
}

/// Finishes a path whose last segment crosses a crystal, or whose light is filtered at the emitter.
#[cold]
fn through_filter(
    at: &ShadingPoint,
    scatter: &Scatter,
    filling: Filling,
    to: &Connection,
    out: &mut Contributions,
) -> Extent {
    let mut chain = at.state.chain;
    let frame = chain.push(scatter, at.wo, at.state.frame);
    chain.scale(to.irradiance);
    // After depolarizing scattering, any frame is valid.
    let mut frame = frame.unwrap_or_else(|| perpendicular(to.wi));
    if let Some(way) = at.scene.materials.propagate(filling, to.wi, f64::from(to.distance)) {
        frame = chain.push(&way, -to.wi, frame).unwrap_or(frame);
    }
    to.polarized.end(&mut chain, -to.wi, frame);
    chain.finish(out.elements)
}
