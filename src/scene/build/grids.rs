//! Converts volume grids of a file to grids of media.

use super::context::Context;
use super::shapes::{is_solid, transform};
use base::locate::{InputError, Located};
use glam::{Affine3A, DAffine3, DVec3};
use import::picture;
use import::vol::parse_vol;
use syntax::medium::{GridFile, GridFilter};
use transport::medium::grid::Grid;

/// Reads a grid and checks that its values do not exceed `most`.
pub(super) fn grid(ctx: &mut Context, file: &Located<GridFile>, most: f64) -> Result<Grid, InputError> {
    let at = file.file.span();
    let path = ctx.path(&file.file).display().to_string();
    let bytes = ctx.read(&file.file, at.clone())?;
    let fault =
        |ctx: &Context, what: String, fix: &str| Err(ctx.error(at.clone(), format!("{path}: {what}"), fix));
    let vol = match parse_vol(&bytes) {
        Ok(vol) => vol,
        Err(e) => {
            return fault(ctx, e.problem.to_string(), "give a grid in the format of Mitsuba's VolumeGrid");
        }
    };
    if ![1, 3].contains(&vol.channels) {
        let what = format!("the grid has {} values per point, but 1 or 3 values are expected", vol.channels);
        return fault(ctx, what, "give a grid with 1 or 3 values per point");
    }
    let most = (most as f32).min(1e30);
    if let Some(wrong) = vol.values.iter().find(|v| !(0.0..=most).contains(*v)) {
        return fault(
            ctx,
            format!("the value {wrong} in the grid is outside the supported range"),
            &format!("give values from 0 to {most}"),
        );
    }
    let corners = file.corners.unwrap_or(vol.bbox.map(|p| p.map(f64::from)));
    let [low, high] = corners.map(DVec3::from_array);
    let place = transform(ctx, file.transform.as_ref())?;
    let unit = DAffine3::from_translation(low) * DAffine3::from_scale(high - low);
    let to_world = place * unit;
    let is_nearest = file.filter == GridFilter::Nearest;
    let texel = |v: &[f32]| picture::texel(&ctx.wavelengths, [v[0], v[v.len() / 2], v[v.len() - 1]]);
    let values = vol.values.chunks_exact(vol.channels).map(texel).collect();
    let map = Affine3A::from_mat3_translation(to_world.matrix3.as_mat3(), to_world.translation.as_vec3());
    let grid = if low.cmplt(high).all() && is_solid(&to_world) {
        Grid::new(vol.size, values, map, is_nearest)
    } else {
        None
    };
    match grid {
        Some(grid) => Ok(grid),
        None if low.cmplt(high).all() => Err(ctx.error(
            file.span(),
            "the grid or its transform has zero extent along a direction",
            "give an extent above 0 along every direction",
        )),
        None => Err(ctx.error(
            file.span(),
            format!("the box of the grid is {corners:?}, which has no volume"),
            "give box = [[x, y, z], [x, y, z]] with the minimum corner first",
        )),
    }
}
