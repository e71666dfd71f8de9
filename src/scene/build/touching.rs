//! Separates or overlaps objects that touch within rounding errors. The surface of one object is moved by
//! the smallest distance that single precision resolves.
//!
//! Glass on an opaque object is extended into the object, as in other renderers. Light in the extended glass
//! reaches the object without an air gap. A sheet, which does not refract, is moved away from the object.

use super::context::Context;
use super::pose::matrix;
use super::shapes::{self, Solid};
use base::locate::{InputError, Located};
use glam::{DAffine3, DMat3, DVec3};
use std::collections::BTreeMap;
use syntax::scene::SceneFile;
use syntax::shape::ObjectFile;
use transport::render::gaps::{Contact, Gap};

/// Width of a gap that is accepted as sufficient, divided by the minimum width.
const ENOUGH: f64 = 2.0;

/// Ratio of an object's thickness to its displacement below which the whole object is translated. The
/// opposite side of a thicker object stays fixed.
const FLAT: f64 = 8.0;

/// Largest relative change of an object's thickness.
const MOST_CHANGE: f64 = 0.01;

/// Moves the surface of one of the two objects at a gap and returns a note for the user. Returns `None` if
/// neither object can be moved.
pub(crate) fn separate(ctx: &mut Context, file: &mut SceneFile, gap: &Gap) -> Option<String> {
    let (width, enough) = (f64::from(gap.width), ENOUGH * f64::from(gap.least));
    // The object to move, and its displacement in metres away from the other object.
    let (side, off) = match gap.contact {
        Contact::Air(side) => (side, enough - width),
        Contact::Touch => (0, -enough - width),
        Contact::Glass => return None,
    };
    let numbers = [gap.objects[0]? as usize, gap.objects[1]? as usize];
    if numbers[0] == numbers[1] {
        return None;
    }
    let [object, other] = [numbers[side], numbers[1 - side]].map(|i| (i, file.objects.get(i)));
    let (object, other) = ((object.0, object.1?), (other.0, other.1?));
    let away = gap.across.as_dvec3() * if side == 0 { -1.0 } else { 1.0 };
    let (low, high) = extent(ctx, file, object.1, away).ok()?;
    let map = if high - low < FLAT * off.abs() {
        DAffine3::from_translation(away * off)
    } else {
        // Relative change of the object's thickness if the opposite side stays fixed.
        let share = off / (high - gap.at.as_dvec3().dot(away));
        if share.is_nan() || share.abs() >= MOST_CHANGE {
            return None;
        }
        let outer = DMat3::from_cols(away * away.x, away * away.y, away * away.z);
        DAffine3::from_mat3_translation(DMat3::IDENTITY - outer * share, away * (high * share))
    };
    let named = |(i, o): (usize, &Located<ObjectFile>)| {
        let name = o.name.clone().unwrap_or_else(|| format!("objects[{i}]"));
        format!("`{name}`{}", ctx.line(o.span()))
    };
    let [x, y, z] = gap.at.to_array();
    let way = if off < 0.0 {
        "into the other object, to remove the air gap between the objects"
    } else {
        "away from the other object"
    };
    let note = format!(
        "{} touches {} at ({x:.4}, {y:.4}, {z:.4}), so the surface of the first object is moved by {:.1e} m {way}",
        named(object),
        named(other),
        off.abs()
    );
    let place = shapes::transform(ctx, object.1.transform.as_ref()).ok()?;
    let (number, span) = (object.0, object.1.span());
    let mut moved = (**object.1).clone();
    let at = moved.transform.as_ref().map_or_else(|| span.clone(), Located::span);
    moved.transform = Some(Located::at(at, matrix(&(map * place))));
    file.objects[number] = Located::at(span, moved);
    Some(note)
}

/// Returns the smallest and largest coordinate of an object along the direction `along`, in metres.
fn extent(
    ctx: &mut Context,
    file: &SceneFile,
    object: &Located<ObjectFile>,
    along: DVec3,
) -> Result<(f64, f64), InputError> {
    let names: BTreeMap<&str, u32> = file.materials.keys().map(String::as_str).zip(0..).collect();
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut add = |p: DVec3| {
        low = low.min(p.dot(along));
        high = high.max(p.dot(along));
    };
    for placed in shapes::place(ctx, object, &names)? {
        match placed.solid(ctx, object)? {
            Solid::Mesh(mesh) => mesh.positions.iter().for_each(|p| add(p.as_dvec3())),
            Solid::Quadric(quadric) => {
                let (a, b) = quadric.bounds();
                let corners = [a, b].map(glam::Vec3A::as_dvec3);
                for k in 0..8 {
                    add(DVec3::from_array([0, 1, 2].map(|i| corners[k >> i & 1][i])));
                }
            }
        }
    }
    Ok((low, high))
}
