//! Stores the splats of all light subpaths in a file, for renders that exceed the available memory.
//!
//! The image is rendered in parts, and only the splats of the current part are in memory. All subpaths are
//! traced once, in batches. The splats of each batch are sorted by part and appended to an unnamed temporary
//! file. Each part reads its splats from this file. The cost per sample is therefore independent of the
//! number of parts. Each part receives the same splats in the same order as if the subpaths were traced only
//! for this part.

use super::splats::{Counts, Splat, Splats, WalkNumber, chunk};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::fs::File;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::ops::Range;

/// Number of subpaths that are traced before their splats are written to the file.
const BATCH: u64 = 1 << 20;
/// Part number of pixels that no part renders.
pub(crate) const NO_PART: u32 = u32::MAX;

/// Splats in a file on disk, sorted by part.
pub(crate) struct SplatFile {
    file: File,
    extents: Extents,
    pixels: u32,
}

/// Number of bytes of a pixel index. A pixel index precedes each splat in the file.
const PIXEL: usize = size_of::<u32>();
/// Number of bytes of a splat with a straight connection. The direction of a straight connection is not
/// stored.
const STRAIGHT: usize = std::mem::offset_of!(Splat, dir);

fn append(out: &mut Vec<u8>, pixel: u32, s: &Splat) {
    let bytes = bytemuck::bytes_of(s);
    out.extend_from_slice(bytemuck::bytes_of(&pixel));
    out.extend_from_slice(if s.interfaces > 0 { bytes } else { &bytes[..STRAIGHT] });
}

/// Parses the splats in a section of the file.
fn parse(mut bytes: &[u8], found: &mut Vec<(u32, Splat)>) -> io::Result<()> {
    while let Some((head, mut rest)) = bytes.split_at_checked(PIXEL + STRAIGHT) {
        let (pixel, head) = head.split_at(PIXEL);
        let mut splat = Splat::zeroed();
        let (straight, dir) = bytemuck::bytes_of_mut(&mut splat).split_at_mut(STRAIGHT);
        straight.copy_from_slice(head);
        if straight[std::mem::offset_of!(Splat, interfaces)] > 0 {
            let (read, after) = rest.split_at_checked(dir.len()).ok_or(ErrorKind::UnexpectedEof)?;
            dir.copy_from_slice(read);
            rest = after;
        }
        bytes = rest;
        found.push((bytemuck::pod_read_unaligned(pixel), splat));
    }
    if bytes.is_empty() { Ok(()) } else { Err(ErrorKind::UnexpectedEof.into()) }
}

/// The section of a file that contains the splats of one batch for one part.
#[derive(Clone, Copy, Debug, Pod, PartialEq, Zeroable)]
#[repr(C)]
pub(super) struct Extent {
    pub begin: u64,
    pub length: u64,
    /// Checksum of the bytes in the section (CRC-32C).
    pub check: u64,
}

/// Sections of each part, in the order of batches.
pub(super) type Extents = Vec<Vec<Extent>>;

pub(crate) struct Parts<F> {
    pub count: usize,
    /// Function that returns the part to which a pixel belongs, or [`NO_PART`].
    pub of: F,
}

/// Traces subpaths as [`Splats::new`] does, and writes the splats of all parts to the file. Returns `None` if
/// `stop` returns true.
pub(super) fn write<T: Send>(
    file: &mut impl Write,
    (counts, walks): (Counts, Range<u64>),
    parts: &Parts<impl Fn(u32) -> u32 + Sync>,
    stop: impl Fn() -> bool,
    make: impl Fn() -> T + Sync,
    trace: impl Fn(&mut T, WalkNumber, &mut dyn FnMut(u32, Splat)) + Sync,
) -> io::Result<Option<Extents>> {
    let mut extents = vec![vec![]; parts.count];
    let mut at = 0;
    for (n, first) in walks.clone().step_by(BATCH as usize).enumerate() {
        if stop() {
            return Ok(None);
        }
        if n > 0 && n % 16 == 0 {
            tracing::info!("traced {first} of {} light paths, {} MB of vertices", walks.end, at / 1_000_000);
        }
        let end = (first + BATCH).min(walks.end);
        // Collect the bytes for each part in an order that is independent of the number of threads.
        let found: Vec<Vec<(u32, Vec<u8>)>> = chunk::of(first..end)
            .map_init(&make, |state, walks| {
                let mut points: Vec<(u32, u32, Splat)> = vec![];
                for i in walks {
                    trace(state, counts.number(i), &mut |pixel, splat| {
                        let part = (parts.of)(pixel);
                        if part != NO_PART {
                            points.push((part, pixel, splat));
                        }
                    });
                }
                points.sort_by_key(|p| p.0);
                let pieces = points.chunk_by(|a, b| a.0 == b.0);
                let piece = |points: &[(u32, u32, Splat)]| {
                    let mut bytes = vec![];
                    points.iter().for_each(|(_, pixel, s)| append(&mut bytes, *pixel, s));
                    (points[0].0, bytes)
                };
                pieces.map(piece).collect()
            })
            .collect();
        let mut next = vec![0; found.len()];
        for (part, extents) in extents.iter_mut().enumerate() {
            let (begin, mut check) = (at, 0);
            for (pieces, next) in found.iter().zip(&mut next) {
                if let Some((_, bytes)) = pieces.get(*next).filter(|p| p.0 as usize == part) {
                    file.write_all(bytes)?;
                    check = crc32c::crc32c_append(check, bytes);
                    at += bytes.len() as u64;
                    *next += 1;
                }
            }
            if at > begin {
                extents.push(Extent { begin, length: at - begin, check: check.into() });
            }
        }
    }
    Ok(Some(extents))
}

pub(super) fn read(
    file: &mut (impl Read + Seek),
    extents: &[Extent],
    found: &mut Vec<(u32, Splat)>,
) -> io::Result<()> {
    let mut bytes = vec![];
    for extent in extents {
        bytes.resize(extent.length as usize, 0);
        file.seek(SeekFrom::Start(extent.begin))?;
        file.read_exact(&mut bytes)?;
        if u64::from(crc32c::crc32c(&bytes)) != extent.check {
            return Err(ErrorKind::InvalidData.into());
        }
        parse(&bytes, found)?;
    }
    Ok(())
}

impl SplatFile {
    /// Traces all subpaths of all samples as [`Splats::new`] does, and stores the splats in a file. `part_of`
    /// returns the part of a pixel (less than `parts`), or [`NO_PART`] to omit its splats. Returns `None` if
    /// `stop` returns true.
    ///
    /// # Errors
    /// Returns an error if the temporary file cannot be created or written.
    pub fn new<T: Send>(
        counts: Counts,
        parts: usize,
        part_of: impl Fn(u32) -> u32 + Sync,
        stop: impl Fn() -> bool,
        make: impl Fn() -> T + Sync,
        trace: impl Fn(&mut T, WalkNumber, &mut dyn FnMut(u32, Splat)) + Sync,
    ) -> io::Result<Option<Self>> {
        let mut file = tempfile::tempfile()?;
        let parts = Parts { count: parts, of: part_of };
        let extents = write(&mut file, (counts, 0..counts.all()), &parts, stop, make, trace)?;
        Ok(extents.map(|extents| Self { file, extents, pixels: counts.pixels }))
    }

    /// Reads the splats of a part.
    ///
    /// # Errors
    /// Returns an error if the splats cannot be read or are damaged.
    pub fn part(&mut self, part: usize) -> io::Result<Splats> {
        let mut found = vec![];
        if let Some(extents) = self.extents.get(part) {
            read(&mut self.file, extents, &mut found)?;
        }
        Ok(Splats::by_pixel(self.pixels, &[found]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies that the splats read from the file for a part equal the splats traced only for this part. The
    /// test includes refracted connections.
    #[test]
    fn parts_are_read_back() {
        let counts = Counts { samples: 3, walks: 500_000, pixels: 60 };
        let trace = |(): &mut (), n: WalkNumber, found: &mut dyn FnMut(u32, Splat)| {
            for point in 0..n.walk % 3 {
                let bent = (n.walk + point).is_multiple_of(4);
                let splat = Splat {
                    walk: n,
                    seen: n.walk as f32,
                    factor: 1.0 + point as f32,
                    dir: if bent { [0.0, n.sample as f32, 1.0] } else { [0.0; 3] },
                    point: point as u16 + 1,
                    lineage: point as u8,
                    interfaces: u8::from(bent),
                    lanes: 7,
                    ..Splat::zeroed()
                };
                found((n.walk * 7 + n.sample + point) % 60, splat);
            }
        };
        // Part 2 includes pixels that no part renders.
        let part_of = |pixel: u32| if pixel >= 55 { NO_PART } else { pixel / 20 };
        let splat_file = SplatFile::new(counts, 3, part_of, || false, || (), trace);
        let mut splat_file = splat_file.expect("a file").expect("all walks");
        for part in 0..3 {
            let want = Splats::new(counts, |pixel| part_of(pixel) == part, || (), trace);
            let got = splat_file.part(part as usize).expect("reads");
            for (pixel, sample) in (0..60).flat_map(|p| (0..3).map(move |s| (p, s))) {
                assert_eq!(got.of(pixel, sample), want.of(pixel, sample), "{part} {pixel} {sample}");
            }
        }
        assert!(SplatFile::new(counts, 3, part_of, || true, || (), trace).expect("a file").is_none());
    }
}
