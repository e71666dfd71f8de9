//! Checks objects filled with a medium. The surfaces of filled objects must be closed and must not intersect
//! other objects of the same priority. Normals of filled objects that point inward are reversed.

use super::context::Context;
use super::shapes::Solid;
use base::locate::{InputError, Located};
use glam::DVec3;
use import::closed;
use syntax::shape::ObjectFile;
use transport::geometry::mesh::Mesh;
use transport::geometry::quadric::{Quadric, QuadricKind};
use transport::medium::nesting::Boundary;

/// An object filled with a medium, for the checks of this module.
pub(crate) struct Volume<'a> {
    object: &'a Located<ObjectFile>,
    filling: Boundary,
    inside: Inside,
    low: DVec3,
    high: DVec3,
    points: Vec<DVec3>,
}

enum Inside {
    /// A sphere, or a cylinder with caps.
    Quadric(Box<Quadric>),
    Mesh(closed::Inside),
}

/// Number of surface points per object that are tested against other objects.
const POINTS: usize = 96;

impl<'a> Volume<'a> {
    /// Creates the volume of an object after checking that the object's surface is closed. If the normals of
    /// a mesh point inward, reverses the mesh and adds a note.
    ///
    /// # Errors
    /// Returns [`InputError`] at the object if the object's surface is open. For a mesh, the message contains
    /// the position of an open edge.
    pub fn new(
        ctx: &mut Context,
        object: &'a Located<ObjectFile>,
        filling: Boundary,
        solids: &mut [Solid],
    ) -> Result<Self, InputError> {
        let open = |ctx: &Context, what: String| {
            let name = object.interior.as_ref().map_or(0..0, Located::span);
            Err(ctx.error(
                name,
                format!("this object has an interior, but {what}"),
                "close the surface (weld vertices, fill holes, set caps = true for a cylinder), or remove `interior`",
            ))
        };
        if let [Solid::Quadric(q), rest @ ..] = &*solids {
            let caps = rest.iter().filter(|s| matches!(s, Solid::Quadric(q) if q.kind == QuadricKind::Disk));
            let closed = match q.kind {
                QuadricKind::Sphere => rest.is_empty(),
                QuadricKind::Cylinder => caps.count() == 2 && rest.len() == 2,
                QuadricKind::Disk => false,
            };
            if !closed {
                return open(ctx, "the surface is open".into());
            }
            let (low, high) = q.bounds();
            let at = |k: usize| (k as f32 + 0.5) / POINTS as f32;
            // Points on a spiral cover the surface evenly.
            let point = |k: usize| q.point([(at(k) * 38.2).fract(), at(k)]).0.as_dvec3();
            return Ok(Self {
                object,
                filling,
                inside: Inside::Quadric(Box::new(*q)),
                low: low.as_dvec3(),
                high: high.as_dvec3(),
                points: (0..POINTS).map(point).collect(),
            });
        }
        let mut meshes: Vec<&mut Mesh> = solids
            .iter_mut()
            .filter_map(|s| match s {
                Solid::Mesh(mesh) => Some(mesh),
                Solid::Quadric(_) => None,
            })
            .collect();
        if let Some(what) = closed::fault(&meshes) {
            return open(ctx, what);
        }
        if closed::turn_outward(&mut meshes) {
            let line = ctx.line(object.shape.span());
            ctx.notes.push(format!(
                "the filled mesh{line} has normals that point inward, so the orientation of the mesh is reversed"
            ));
        }
        let inside = closed::Inside::new(&meshes);
        let (low, high) = inside.bounds();
        Ok(Self { object, filling, low, high, points: inside.points(POINTS), inside: Inside::Mesh(inside) })
    }

    /// Returns whether a point is inside the object, or `None` if the point is too close to the surface to
    /// decide.
    fn holds(&self, p: DVec3) -> Option<bool> {
        match &self.inside {
            Inside::Quadric(q) => {
                let [a, b] = [1.0 - 1e-3, 1.0 + 1e-3].map(|grown| q.holds(p.as_vec3a(), grown));
                (a == b).then_some(a)
            }
            Inside::Mesh(mesh) => mesh.holds(p),
        }
    }

    /// Returns whether the surface of the volume is partly inside and partly outside another volume.
    fn cuts(&self, other: &Self) -> bool {
        let found: Vec<bool> = self.points.iter().filter_map(|p| other.holds(*p)).collect();
        found.contains(&true) && found.contains(&false)
    }
}

/// Checks that filled objects of equal priority with different media do not intersect.
///
/// # Errors
/// Returns [`InputError`], located at the second volume, if two volumes intersect.
pub(crate) fn overlaps(ctx: &Context, volumes: &[Volume]) -> Result<(), InputError> {
    for (i, b) in volumes.iter().enumerate() {
        for a in &volumes[..i] {
            let apart = a.low.cmpgt(b.high).any() || b.low.cmpgt(a.high).any();
            let message = a.filling.priority != b.filling.priority || a.filling.medium == b.filling.medium;
            if apart || message || !(a.cuts(b) || b.cuts(a)) {
                continue;
            }
            let other = match &a.object.name {
                Some(name) => format!(" (`{name}`)"),
                None => ctx.line(a.object.shape.span()),
            };
            return Err(ctx.error(
                b.object.interior.as_ref().map_or(0..0, Located::span),
                format!(
                    "this object and another object{other} intersect with equal priorities ({}), so the medium of the \
                     intersection is ambiguous",
                    b.filling.priority
                ),
                "give the objects different priorities; the object of higher priority fills the intersection",
            ));
        }
    }
    Ok(())
}
