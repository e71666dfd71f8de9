//! Converts colours with other primaries to linear red, green and blue of ITU-R BT.709 (sRGB).
//!
//! The conversion uses CIE XYZ without chromatic adaptation, as in the OpenEXR library and in Mitsuba.

use glam::{DMat3, DVec3};

/// Chromaticities (x, y) of red, green, blue and white.
pub(super) type Primaries = [[f64; 2]; 4];

pub(super) const BT709: Primaries = [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3127, 0.329]];

/// Returns the matrix from red, green and blue to CIE XYZ, such that white has Y = 1. Returns
/// `None` if the primaries span no gamut.
fn to_xyz(primaries: &Primaries) -> Option<DMat3> {
    let xyz = |[x, y]: [f64; 2]| DVec3::new(x, y, 1.0 - x - y);
    let [r, g, b, w] = primaries.map(xyz);
    let columns = DMat3::from_cols(r, g, b);
    if !columns.is_finite() || columns.determinant().abs() < 1e-6 || w.y.abs() < 1e-6 {
        return None;
    }
    let scale = columns.inverse() * (w / w.y);
    Some(columns * DMat3::from_diagonal(scale))
}

/// Returns the rows of the matrix from a file's colours to BT.709. The colours are CIE XYZ or have
/// the given primaries. Returns `None` for BT.709 and for files without primaries.
///
/// # Errors
/// Returns [`NoGamut`] if the primaries span no gamut.
pub(super) fn conversion(is_xyz: bool, given: Option<Primaries>) -> Result<Option<[[f32; 3]; 3]>, NoGamut> {
    match given.filter(|p| !is_bt709(p)) {
        _ if is_xyz => Ok(Some(rows(xyz_to_bt709()))),
        None => Ok(None),
        Some(given) => match to_xyz(&given) {
            Some(xyz) => Ok(Some(rows(xyz_to_bt709() * xyz))),
            None => Err(NoGamut),
        },
    }
}

/// Error: the primaries are collinear.
pub(super) struct NoGamut;

fn is_bt709(primaries: &Primaries) -> bool {
    let pairs = primaries.iter().flatten().zip(BT709.iter().flatten());
    pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>() < 1e-6
}

fn xyz_to_bt709() -> DMat3 {
    match to_xyz(&BT709) {
        Some(m) => m.inverse(),
        None => unreachable!("BT.709 spans a gamut"),
    }
}

fn rows(m: DMat3) -> [[f32; 3]; 3] {
    let rows = m.transpose();
    [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.as_vec3().to_array())
}

/// Multiplies a matrix, given as rows, by a colour.
pub(super) fn times(m: &[[f32; 3]; 3], c: [f32; 3]) -> [f32; 3] {
    m.map(|row| row[0] * c[0] + row[1] * c[1] + row[2] * c[2])
}
