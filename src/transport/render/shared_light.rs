//! Walks from the light, made once for all parts of a render on many machines, by files in a folder that these share.
//!
//! Tiles are shared out, but light falls where it will: the points that any part sees are of all walks. So each part makes its
//! share of the *walks*, sorts the points by the part that sees them, and reads its own from everybody's files. What nobody has
//! made yet, or began and did not finish, any part makes: a file is a pure function of scene, seed and share, and appears whole
//! or not at all, so who dies, comes late or makes a share twice changes nothing. There is nothing to schedule and nobody waits
//! for one that is no more. What all parts work out beforehand from the scene alone is kept there in the same way.

use super::spill::{self, Extent, Parts};
use super::splats::{Counts, Splat, Splats, WalkNumber};
use super::tiles;
use crate::scene::Scene;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How long a share that another part has begun is waited for, in times of the longest that was made here.
const PATIENCE: u32 = 2;
/// How often it is looked for.
const LOOK: Duration = Duration::from_millis(20);

/// The folder, and which part this is.
#[derive(Clone, Debug)]
pub struct SharedLight {
    folder: PathBuf,
    /// Begins the names of files: what all that is in them depends on.
    key: String,
    /// From 0.
    part: u32,
    of: u32,
}

impl SharedLight {
    /// For part `number` of `of`, counted from 1, of the render that `key` names.
    #[must_use]
    pub fn new(folder: &Path, key: String, number: u32, of: u32) -> Self {
        Self {
            folder: folder.to_owned(),
            key,
            part: number.saturating_sub(1),
            of: of.max(1),
        }
    }

    fn file(&self, share: u32) -> PathBuf {
        self.folder
            .join(format!("{}-{}of{}.light", self.key, share + 1, self.of))
    }

    pub(super) fn warn(&self, what: &str, e: &io::Error) {
        tracing::warn!(
            "the points of walks from the light cannot be {what} {}: {e}; all walks are made here",
            self.folder.display()
        );
    }

    /// A number that follows from scene and seed: as another part has made it, or made here and kept for others.
    pub(super) fn number(&self, name: &str, make: impl FnOnce() -> f32) -> f32 {
        let path = self.folder.join(format!("{}.{name}", self.key));
        let kept = fs::read(&path).ok().and_then(|bytes| {
            let (value, check) = bytes.split_first_chunk()?;
            (crc32c::crc32c(value).to_le_bytes() == check).then(|| f32::from_le_bytes(*value))
        });
        kept.unwrap_or_else(|| {
            let made = make();
            // Where it cannot be kept, others make it too.
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

    /// Sees to it that all shares are there, beginning with this part's own. `None` once `stop` says so.
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
            let parts = Parts {
                count: self.of as usize,
                of: |pixel| tiles::of(scene, pixel) % self.of,
            };
            let walks = counts.share(share, self.of);
            let made = self.write(share, |file| {
                spill::write(file, (counts, walks), &parts, stop, &make, &trace)
            });
            longest = longest.max(begun.elapsed());
            made.map(|made| made.map(|()| longest))
        };
        let shares = || (0..self.of).map(|n| (self.part + n) % self.of);
        let mut patience = Duration::ZERO;
        // First what nobody has begun.
        for share in shares().filter(|share| !self.file(*share).is_file()) {
            let claim = self.file(share).with_extension("begun");
            if OpenOptions::new()
                .write(true)
                .create_new(true)
                .open(claim)
                .is_ok()
            {
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
                // Who began it is slow, or dead.
                match write(share)? {
                    Some(longest) => patience = longest * PATIENCE,
                    None => return Ok(None),
                }
            }
        }
        Ok(Some(()))
    }

    /// Writes the file of a share: points, then extents of each part, then where these begin.
    fn write(
        &self,
        share: u32,
        points: impl FnOnce(&mut BufWriter<File>) -> io::Result<Option<spill::Extents>>,
    ) -> io::Result<Option<()>> {
        // A name that no other machine gives.
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

    /// The points that this part's pixels see, of those that are `wanted`.
    pub(super) fn splats(&self, pixels: u32, wanted: impl Fn(u32) -> bool) -> io::Result<Splats> {
        let mut found = vec![];
        for share in 0..self.of {
            let mut file = File::open(self.file(share))?;
            let extents = extents(&mut file, self.part)?;
            let mut points = vec![];
            spill::read(&mut file, &extents, &mut points)?;
            points.retain(|(pixel, _)| *pixel < pixels && wanted(*pixel));
            found.push(points);
        }
        Ok(Splats::by_pixel(pixels, &found))
    }
}

/// Where in the file of a share the points of a part are.
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
        let (own, after) = after
            .split_at_checked(size.ok_or_else(wrong)?)
            .ok_or_else(wrong)?;
        if n == part {
            return Ok(own
                .chunks_exact(size_of::<Extent>())
                .map(bytemuck::pod_read_unaligned)
                .collect());
        }
        rest = after;
    }
    Err(wrong())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_made_once_and_again_where_they_are_spoilt() {
        let folder = tempfile::tempdir().expect("a folder");
        let of = |part| SharedLight::new(&folder.path().join("light"), "key".into(), part, 2);
        assert_eq!(of(1).number("threshold", || 0.25).to_bits(), 0.25_f32.to_bits());
        let kept = of(2).number("threshold", || panic!("it is there"));
        assert_eq!(kept.to_bits(), 0.25_f32.to_bits());
        let file = folder.path().join("light/key.threshold");
        for spoilt in [&b""[..], b"\0\0\0\0\0\0\0\x01", b"long enough to be more"] {
            fs::write(&file, spoilt).expect("writes");
            assert_eq!(of(2).number("threshold", || 0.5).to_bits(), 0.5_f32.to_bits());
        }
        // Another render's are not taken.
        let other = SharedLight::new(&folder.path().join("light"), "other".into(), 1, 2);
        assert_eq!(other.number("threshold", || 1.0).to_bits(), 1.0_f32.to_bits());
    }
}
