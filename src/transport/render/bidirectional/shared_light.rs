//! Shares light subpaths through files in a common folder, between the parts of a render on many machines.
//!
//! Each part renders a subset of the tiles, but the vertices that the pixels of a part see may be on any
//! light subpath. Each part therefore traces a share of the *subpaths* and sorts the visible vertices by the
//! part whose pixels see the vertices. Each part then reads the vertices that its pixels see from the files
//! of all parts. In addition, a part may trace shares that another part has not started or not finished.
//!
//! A file depends only on scene, seed and share, and is written atomically. The result is therefore the same
//! if a part stops, starts late or computes a share twice. No scheduler is needed, and no part waits
//! indefinitely for a stopped part. In addition, parts share values that depend only on the scene and the
//! seed.

use super::splat_file::{self, Extent, Parts};
use super::{Counts, Splat, Splats, WalkNumber};
use crate::render::schedule::tiles;
use crate::scene::Scene;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Maximum time to wait for a share that another part has started, in units of the longest time that this
/// part has needed to compute a share.
const PATIENCE: u32 = 2;
/// Interval at which a part checks for the file of a share.
const LOOK: Duration = Duration::from_millis(20);

/// The common folder, and the number of this part of the render.
#[derive(Clone, Debug)]
pub struct SharedLight {
    folder: PathBuf,
    /// Prefix of the file names. The prefix is a key that depends on all inputs that determine the contents
    /// of the files.
    key: String,
    /// Number of this part of the render, counted from 0.
    part: u32,
    of: u32,
}

impl SharedLight {
    /// Creates the exchange for part `number` (counted from 1) of `of` parts of the render with key `key`.
    pub fn new(folder: &Path, key: String, number: u32, of: u32) -> Self {
        Self { folder: folder.to_owned(), key, part: number.saturating_sub(1), of: of.max(1) }
    }

    fn file(&self, share: u32) -> PathBuf {
        self.folder.join(format!("{}-{}of{}.light", self.key, share + 1, self.of))
    }

    pub(super) fn warn(&self, what: &str, e: &io::Error) {
        tracing::warn!(
            "the vertices of light paths cannot be {what} {}: {e}; this part traces all light paths again",
            self.folder.display()
        );
    }

    /// Returns the number called `name`, which must depend only on scene and seed. Reads the number from the
    /// folder, or computes and stores the number.
    pub(super) fn number(&self, name: &str, make: impl FnOnce() -> f32) -> f32 {
        let path = self.folder.join(format!("{}.{name}", self.key));
        let kept = fs::read(&path).ok().and_then(|bytes| {
            let (value, check) = bytes.split_first_chunk()?;
            (crc32c::crc32c(value).to_le_bytes() == check).then(|| f32::from_le_bytes(*value))
        });
        kept.unwrap_or_else(|| {
            let made = make();
            // If storing fails, the other parts compute the number again.
            let _ = self.keep(&path, made.to_le_bytes());
            made
        })
    }

    fn keep(&self, path: &Path, value: [u8; 4]) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        let mut temporary = tempfile::NamedTempFile::new_in(&self.folder)?;
        temporary.write_all(&value)?;
        temporary.write_all(&crc32c::crc32c(&value).to_le_bytes())?;
        temporary.persist(path).map_err(|e| e.error)?;
        Ok(())
    }

    /// Ensures that the files of all shares exist. Returns `None` if `stop` returns true.
    pub(super) fn make<T: Send>(
        &self,
        scene: &Scene,
        counts: Counts,
        stop: &(impl Fn() -> bool + Sync),
        make: impl Fn() -> T + Sync,
        trace: impl Fn(&mut T, WalkNumber, &mut dyn FnMut(u32, Splat)) + Sync,
    ) -> io::Result<Option<()>> {
        fs::create_dir_all(&self.folder)?;
        let mut longest = Duration::ZERO;
        let mut write = |share: u32| {
            let begun = Instant::now();
            let parts = Parts { count: self.of as usize, of: |pixel| tiles::of(scene, pixel) % self.of };
            let walks = counts.share(share, self.of);
            let made = self
                .write(share, |file| splat_file::write(file, (counts, walks), &parts, stop, &make, &trace));
            longest = longest.max(begun.elapsed());
            made.map(|made| made.map(|()| longest))
        };
        let shares = || (0..self.of).map(|n| (self.part + n) % self.of);
        let mut patience = Duration::ZERO;
        // Start with the shares that no part has started.
        for share in shares().filter(|share| !self.file(*share).is_file()) {
            let claim = self.file(share).with_extension("begun");
            if OpenOptions::new().write(true).create_new(true).open(claim).is_ok() {
                match write(share)? {
                    Some(longest) => patience = longest * PATIENCE,
                    None => return Ok(None),
                }
            }
        }
        for share in shares() {
            let begun = Instant::now();
            while !self.file(share).is_file() {
                if stop() {
                    return Ok(None);
                }
                if begun.elapsed() < patience {
                    std::thread::sleep(LOOK);
                    continue;
                }
                // The part that started this share is slow or has stopped.
                match write(share)? {
                    Some(longest) => patience = longest * PATIENCE,
                    None => return Ok(None),
                }
            }
        }
        Ok(Some(()))
    }

    /// Writes the file of a share. The file contains the vertices, the sections ([`Extent`]) of each part,
    /// and the position of the list of sections.
    fn write(
        &self,
        share: u32,
        points: impl FnOnce(&mut BufWriter<File>) -> io::Result<Option<splat_file::Extents>>,
    ) -> io::Result<Option<()>> {
        // The name of the temporary file must be unique across all machines.
        let temporary = tempfile::NamedTempFile::new_in(&self.folder)?;
        let mut file = BufWriter::new(temporary.reopen()?);
        let Some(extents) = points(&mut file)? else {
            return Ok(None);
        };
        let at = file.stream_position()?;
        let mut tail = vec![];
        for extents in &extents {
            tail.extend_from_slice(&(extents.len() as u64).to_le_bytes());
            tail.extend_from_slice(bytemuck::cast_slice(extents));
        }
        tail.extend_from_slice(&at.to_le_bytes());
        let check = crc32c::crc32c(&tail);
        file.write_all(&tail)?;
        file.write_all(&check.to_le_bytes())?;
        file.flush()?;
        temporary.persist(self.file(share)).map_err(|e| e.error)?;
        Ok(Some(()))
    }

    /// Reads the vertices that the pixels of this part see, restricted to `wanted` pixels.
    pub(super) fn splats(&self, pixels: u32, wanted: impl Fn(u32) -> bool) -> io::Result<Splats> {
        let mut found = vec![];
        for share in 0..self.of {
            let mut file = File::open(self.file(share))?;
            let extents = extents(&mut file, self.part)?;
            let mut points = vec![];
            splat_file::read(&mut file, &extents, &mut points)?;
            points.retain(|(pixel, _)| *pixel < pixels && wanted(*pixel));
            found.push(points);
        }
        Ok(Splats::by_pixel(pixels, &found))
    }
}

/// Reads the list of sections in which the file of a share stores the vertices of a part.
fn extents(file: &mut File, part: u32) -> io::Result<Vec<Extent>> {
    const END: u64 = 12;
    let wrong = || io::Error::from(ErrorKind::InvalidData);
    let length = file.seek(SeekFrom::End(0))?;
    let mut end = [0; END as usize];
    file.seek(SeekFrom::Start(length.checked_sub(END).ok_or_else(wrong)?))?;
    file.read_exact(&mut end)?;
    let (at, check) = end.split_at(8);
    let at = u64::from_le_bytes(at.try_into().map_err(|_| wrong())?);
    let tail = (length - 4).checked_sub(at).ok_or_else(wrong)?;
    file.seek(SeekFrom::Start(at))?;
    let mut bytes = vec![0; tail as usize];
    file.read_exact(&mut bytes)?;
    if crc32c::crc32c(&bytes).to_le_bytes() != check {
        return Err(wrong());
    }
    let mut rest = &bytes[..];
    for n in 0..=part {
        let (count, after) = rest.split_first_chunk().ok_or_else(wrong)?;
        let size = (u64::from_le_bytes(*count) as usize).checked_mul(size_of::<Extent>());
        let (own, after) = after.split_at_checked(size.ok_or_else(wrong)?).ok_or_else(wrong)?;
        if n == part {
            return Ok(own.chunks_exact(size_of::<Extent>()).map(bytemuck::pod_read_unaligned).collect());
        }
        rest = after;
    }
    Err(wrong())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_computed_once_and_again_if_damaged() {
        let folder = tempfile::tempdir().expect("a folder");
        let of = |part| SharedLight::new(&folder.path().join("light"), "key".into(), part, 2);
        assert_eq!(of(1).number("threshold", || 0.25).to_bits(), 0.25_f32.to_bits());
        let kept = of(2).number("threshold", || panic!("the number is in the folder"));
        assert_eq!(kept.to_bits(), 0.25_f32.to_bits());
        let file = folder.path().join("light/key.threshold");
        for damaged in [&b""[..], b"\0\0\0\0\0\0\0\x01", b"long enough to be more"] {
            fs::write(&file, damaged).expect("writes");
            assert_eq!(of(2).number("threshold", || 0.5).to_bits(), 0.5_f32.to_bits());
        }
        // A part must not use the values of another render.
        let other = SharedLight::new(&folder.path().join("light"), "other".into(), 1, 2);
        assert_eq!(other.number("threshold", || 1.0).to_bits(), 1.0_f32.to_bits());
    }
}
