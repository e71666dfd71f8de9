//! Reads the transforms of many copies from a text file or a NumPy `.npy` file.

use super::context::Context;
use base::locate::{InputError, Located};
use glam::DAffine3;
use import::places;

pub(super) fn read(ctx: &mut Context, file: &Located<String>) -> Result<Vec<DAffine3>, InputError> {
    let bytes = ctx.read(file, file.span())?;
    let places = places::parse(&bytes).map_err(|message| {
        ctx.error(
            file.span(),
            format!("{}{message}", **file),
            if places::is_array(&bytes) {
                "give an array of n × 3 × 4 or n × 4 × 4 floating-point numbers"
            } else {
                "give one copy per line: the 12 numbers of a 3×4 matrix in row-major order, or the 16 of a 4×4 matrix"
            },
        )
    })?;
    if places.is_empty() {
        return Err(ctx.error(
            file.span(),
            format!("the file {} contains no transforms", **file),
            "give the matrix of at least one copy, or remove the instance",
        ));
    }
    Ok(places)
}
