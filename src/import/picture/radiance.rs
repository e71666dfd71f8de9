//! Decodes Radiance HDR files (Ward, "Real Pixels", Graphics Gems II, 1991; Radiance's `color.c` and
//! `resolu.c`).
//!
//! The crate `image` is not used because its reader accepts only the signature `#?RADIANCE` and the
//! orientation `-Y +X`, and ignores the exposure.

use super::pixels::{PictureError, Pixels, pixel_count};
use super::primaries::{self, NoGamut};

struct Header {
    /// Factors from stored values to radiance, per channel.
    correction: [f64; 3],
    is_xyz: bool,
    primaries: Option<primaries::Primaries>,
    notes: Vec<String>,
}

pub(super) fn decode(bytes: &[u8]) -> Result<Pixels, PictureError> {
    let mut rest = bytes;
    let mut header = header(&mut rest)?;
    let resolution = line(&mut rest).ok_or_else(|| damaged("the resolution is missing"))?;
    let layout = Layout::parse(&resolution).ok_or_else(|| {
        damaged(format!("expected a resolution such as `-Y 512 +X 1024`, got `{resolution}`"))
    })?;
    let (width, height) = (layout.width, layout.height);
    let count = pixel_count("Radiance", width, height)?;
    let (length, lines) = if layout.by_columns { (height, width) } else { (width, height) };
    let mut values = vec![[0.0; 3]; count];
    let mut scan = vec![[0; 4]; length];
    for k in 0..lines {
        scanline(&mut rest, &mut scan)
            .ok_or_else(|| damaged(format!("cannot decode scan line {} of {lines}", k + 1)))?;
        for (i, rgbe) in scan.iter().enumerate() {
            let (x, y) = if layout.by_columns { (k, i) } else { (i, k) };
            let x = if layout.from_right { width - 1 - x } else { x };
            let y = if layout.from_below { height - 1 - y } else { y };
            values[y * width + x] = colour(*rgbe, header.correction);
        }
    }
    let to_rgb = primaries::conversion(header.is_xyz, header.primaries)
        .map_err(|NoGamut| damaged("the primary colours in PRIMARIES are degenerate"))?;
    if header.correction != [1.0; 3] {
        let [r, g, b] = header.correction.map(|c| 1.0 / c);
        header.notes.push(format!(
            "EXPOSURE and COLORCORR are undone: values are divided by {r} {g} {b} (Mitsuba ignores these keys)"
        ));
    }
    Ok(Pixels { width, height, values, encoded: false, to_rgb, notes: header.notes })
}

fn damaged(what: impl std::fmt::Display) -> PictureError {
    PictureError::damaged("Radiance", what)
}

/// Returns the next line without its line ending.
fn line(rest: &mut &[u8]) -> Option<String> {
    let end = rest.iter().position(|b| *b == b'\n')?;
    let text = String::from_utf8_lossy(&rest[..end]).trim_end_matches('\r').to_owned();
    *rest = &rest[end + 1..];
    Some(text)
}

/// Parses the header up to the empty line.
fn header(rest: &mut &[u8]) -> Result<Header, PictureError> {
    let mut header = Header { correction: [1.0; 3], is_xyz: false, primaries: None, notes: vec![] };
    loop {
        let text = line(rest).ok_or_else(|| damaged("the header is truncated"))?;
        if text.is_empty() {
            return Ok(header);
        }
        let Some((key, value)) = text.split_once('=') else {
            continue;
        };
        let numbers: Option<Vec<f64>> = value.split_whitespace().map(|n| n.parse().ok()).collect();
        let positive = |n: &f64| n.is_finite() && *n > 0.0;
        match (key.trim(), numbers.as_deref()) {
            ("FORMAT", _) => match value.trim() {
                "32-bit_rle_rgbe" => header.is_xyz = false,
                "32-bit_rle_xyze" => header.is_xyz = true,
                other => {
                    return Err(PictureError::new(
                        format!("unsupported FORMAT={other} in the Radiance file"),
                        "convert the file to 32-bit_rle_rgbe",
                    ));
                }
            },
            ("EXPOSURE", Some(&[e])) if positive(&e) => {
                header.correction = header.correction.map(|c| c / e);
            }
            ("COLORCORR", Some(c @ [_, _, _])) if c.iter().all(positive) => {
                for (all, c) in header.correction.iter_mut().zip(c) {
                    *all /= c;
                }
            }
            ("EXPOSURE" | "COLORCORR", _) => return Err(damaged(format!("invalid header line `{text}`"))),
            ("PRIMARIES", Some(&[rx, ry, gx, gy, bx, by, wx, wy])) => {
                header.primaries = Some([[rx, ry], [gx, gy], [bx, by], [wx, wy]]);
            }
            ("PRIMARIES", _) => return Err(damaged(format!("invalid header line `{text}`"))),
            ("GAMMA", Some(&[g])) if (g - 1.0).abs() > 1e-3 => {
                header.notes.push(format!("GAMMA={g} is ignored: values are read as linear"));
            }
            _ => {}
        }
    }
}

struct Layout {
    width: usize,
    height: usize,
    by_columns: bool,
    from_right: bool,
    from_below: bool,
}

impl Layout {
    fn parse(text: &str) -> Option<Self> {
        let mut words = text.split_whitespace();
        let mut axis = || Some((words.next()?, words.next()?.parse::<usize>().ok()?));
        let (first, second) = (axis()?, axis()?);
        let by_columns = first.0.ends_with('X');
        let (y, x) = if by_columns { (second, first) } else { (first, second) };
        let one = |name: &str, minus: &str, plus: &str| match name {
            n if n == minus => Some(true),
            n if n == plus => Some(false),
            _ => None,
        };
        Some(Self {
            width: x.1,
            height: y.1,
            by_columns,
            from_right: one(x.0, "-X", "+X")?,
            from_below: !one(y.0, "-Y", "+Y")?,
        })
    }
}

/// Converts three mantissas with a common exponent to floats, times `correction`.
fn colour([r, g, b, e]: [u8; 4], correction: [f64; 3]) -> [f32; 3] {
    if e == 0 {
        return [0.0; 3];
    }
    let unit = (f64::from(e) - 136.0).exp2();
    let [r, g, b] = [r, g, b].map(|m| f64::from(m) * unit);
    [r * correction[0], g * correction[1], b * correction[2]].map(|v| v as f32)
}

/// Reads one scan line in any of the three encodings. Returns `None` if the line is truncated or longer than
/// `out`.
fn scanline(rest: &mut &[u8], out: &mut [[u8; 4]]) -> Option<()> {
    let take = |rest: &mut &[u8]| {
        let (first, after) = rest.split_first()?;
        *rest = after;
        Some(*first)
    };
    let &[a, b, high, low, ..] = *rest else {
        return None;
    };
    let length = usize::from(high) << 8 | usize::from(low);
    if !(8..0x8000).contains(&out.len()) || a != 2 || b != 2 || high >= 128 {
        return old_scanline(rest, out);
    }
    if length != out.len() {
        return None;
    }
    *rest = &rest[4..];
    for channel in 0..4 {
        let mut i = 0;
        while i < out.len() {
            let code = usize::from(take(rest)?);
            let (count, run) = if code > 128 { (code - 128, Some(take(rest)?)) } else { (code, None) };
            if count == 0 || count > out.len() - i {
                return None;
            }
            for pixel in &mut out[i..i + count] {
                pixel[channel] = match run {
                    Some(value) => value,
                    None => take(rest)?,
                };
            }
            i += count;
        }
    }
    Some(())
}

/// Reads pixels in the old encoding. The code (1, 1, 1, n) repeats the previous pixel n times. The count of
/// each directly following code is multiplied by another factor of 256.
fn old_scanline(rest: &mut &[u8], out: &mut [[u8; 4]]) -> Option<()> {
    let (mut i, mut shift) = (0, 0);
    while i < out.len() {
        let (pixel, after) = rest.split_first_chunk::<4>()?;
        *rest = after;
        if pixel[..3] == [1, 1, 1] && i > 0 {
            let count = usize::from(pixel[3]).checked_shl(shift)?;
            if count > out.len() - i {
                return None;
            }
            let before = out[i - 1];
            out[i..i + count].fill(before);
            i += count;
            shift += 8;
        } else {
            out[i] = *pixel;
            i += 1;
            shift = 0;
        }
    }
    Some(())
}
