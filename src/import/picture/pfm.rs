//! Decodes portable float maps, `PF` (three channels) or `Pf` (one channel). The bottom row is first. The
//! sign of the scale gives the byte order.

use super::pixels::{PictureError, Pixels, pixel_count};

pub(super) fn decode(bytes: &[u8]) -> Result<Pixels, PictureError> {
    let damaged = |what: &str| PictureError::damaged("PFM", what);
    // Read the three tokens after the signature. One white-space character terminates each token.
    let mut at = 2;
    let mut token = || {
        let start = at + bytes[at..].iter().position(|b| !b.is_ascii_whitespace())?;
        let end = start + bytes[start..].iter().position(u8::is_ascii_whitespace)?;
        at = end;
        std::str::from_utf8(&bytes[start..end]).ok()
    };
    let header = (token(), token(), token());
    let (Some(width), Some(height), Some(scale)) = header else {
        return Err(damaged("the header is not `PF width height scale`"));
    };
    let (Ok(width), Ok(height), Ok(scale)) = (width.parse(), height.parse(), scale.parse::<f32>()) else {
        return Err(damaged("the header is not `PF width height scale`"));
    };
    let count = pixel_count("PFM", width, height)?;
    let colours = if bytes[1] == b'F' { 3 } else { 1 };
    let data = &bytes[at + 1..];
    if data.len() < 4 * colours * count {
        return Err(damaged("the file is truncated"));
    }
    let factor = if scale == 0.0 { 1.0 } else { scale.abs() };
    let value = |b: &[u8]| {
        let b = [b[0], b[1], b[2], b[3]];
        let v = if scale <= 0.0 { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) };
        v * factor
    };
    let pixel = |p: &[u8]| {
        let at = |c: usize| value(&p[4 * (c % colours)..]);
        [at(0), at(1), at(2)]
    };
    let rows = data[..4 * colours * count].chunks_exact(4 * colours * width).rev();
    Ok(Pixels {
        width,
        height,
        values: rows.flat_map(|row| row.chunks_exact(4 * colours).map(pixel)).collect(),
        encoded: false,
        to_rgb: None,
        notes: vec![],
    })
}
