//! Reads and writes shards. A shard is a file that contains many chunks, in the format of Zarr's codec
//! `sharding_indexed` with the index at the end.
//!
//! The file contains sealed frames, a table of the frames' checksums, and the index. A sealed frame is a
//! Zstandard frame and its CRC-32C. The index contains two 64-bit numbers per frame, offset and size, and the
//! CRC-32C of all offsets and sizes. For a missing frame, all bits of offset and size are ones. The table is
//! an addition of Sunstone, which is valid because the codec allows any bytes between frames and index. The
//! manifest contains the checksum of table and index. The tail of a shard consists of table and index, and is
//! sufficient to detect that a frame was replaced by another valid frame. The index alone is not sufficient,
//! because incompressible frames give equal indices in all shards.

use serde_json::Value;
use std::collections::HashMap;
use std::ops::Range;
use std::path::Path;

/// Size of a CRC-32C checksum in bytes.
const SEAL: usize = 4;
/// Size of a frame's entry in the index, in bytes.
const PLACE: usize = 16;
/// Value of offset and size of a missing frame in the index.
const NOWHERE: u64 = u64::MAX;
/// Maximum number of frames of a shard. Metadata with a larger number is refused before an allocation.
pub(super) const MAX_FRAMES: usize = 1 << 16;

/// Position of a frame in its shard, with its checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Piece {
    pub(super) offset: u64,
    pub(super) size: u64,
    pub(super) seal: u32,
}

impl Piece {
    pub(super) fn range(self) -> Range<u64> {
        self.offset..self.offset + self.size
    }

    /// Returns the fault in the frame's bytes, if any.
    pub(super) fn fault(self, bytes: &[u8]) -> Option<&'static str> {
        match bytes.split_last_chunk::<SEAL>() {
            Some((frame, seal)) if u32::from_le_bytes(*seal) == self.seal => {
                (crc32c::crc32c(frame) != self.seal).then_some("checksum mismatch")
            }
            _ => Some("the chunk differs from the one written to the shard"),
        }
    }
}

/// Returns the size, in bytes, of the tail (checksums and index) of a shard with `frames` frames.
pub(super) fn tail_len(frames: usize) -> u64 {
    (frames * (SEAL + PLACE) + SEAL) as u64
}

/// Returns the checksum of a shard for the manifest. The checksum covers the tail of the shard except the
/// checksum of the index. If a CRC covers both the index and the index's own CRC, the result does not depend
/// on the index.
pub(super) fn checksum(tail: &[u8]) -> u32 {
    crc32c::crc32c(&tail[..tail.len().saturating_sub(SEAL)])
}

/// Assembles the bytes of a shard.
pub(super) struct Builder {
    bytes: Vec<u8>,
    pieces: Vec<Option<Piece>>,
}

impl Builder {
    pub(super) fn new(frames: usize) -> Self {
        Self { bytes: vec![], pieces: vec![None; frames] }
    }

    pub(super) fn push(&mut self, number: usize, frame: &[u8]) {
        let seal = frame.last_chunk().map_or(0, |seal| u32::from_le_bytes(*seal));
        self.pieces[number] = Some(Piece { offset: self.bytes.len() as u64, size: frame.len() as u64, seal });
        self.bytes.extend_from_slice(frame);
    }

    /// Returns the bytes of the shard and the checksum for the manifest, or `None` if there are no frames.
    pub(super) fn finish(self) -> Option<(Vec<u8>, u32)> {
        let Self { mut bytes, pieces } = self;
        if pieces.iter().all(Option::is_none) {
            return None;
        }
        let tail = bytes.len();
        for piece in &pieces {
            bytes.extend(piece.map_or(0, |p| p.seal).to_le_bytes());
        }
        let index = bytes.len();
        for piece in &pieces {
            let place = piece.map_or([NOWHERE; 2], |p| [p.offset, p.size]);
            bytes.extend(place.into_iter().flat_map(u64::to_le_bytes));
        }
        let seal = crc32c::crc32c(&bytes[index..]);
        bytes.extend(seal.to_le_bytes());
        let checksum = checksum(&bytes[tail..]);
        Some((bytes, checksum))
    }
}

/// Parses the tail of a shard of `size` bytes, and returns the position of each frame, in order.
pub(super) fn parse(tail: &[u8], size: u64, frames: usize) -> Result<Vec<Option<Piece>>, &'static str> {
    let Some(data) = size.checked_sub(tail_len(frames)).filter(|_| tail.len() as u64 == tail_len(frames))
    else {
        return Err("the shard is shorter than the index of its chunks");
    };
    let (seals, index) = tail.split_at(frames * SEAL);
    let (index, seal) = index.split_at(frames * PLACE);
    if seal != crc32c::crc32c(index).to_le_bytes() {
        return Err("the checksum of the index is wrong");
    }
    let number = |bytes: &[u8]| bytes.try_into().map_or(NOWHERE, u64::from_le_bytes);
    let piece = |(seal, place): (&[u8], &[u8])| {
        let (offset, size) = place.split_at(PLACE / 2);
        let (offset, size) = (number(offset), number(size));
        if [offset, size] == [NOWHERE; 2] {
            return Ok(None);
        }
        match offset.checked_add(size) {
            Some(end) if end <= data && size > SEAL as u64 => {
                Ok(Some(Piece { offset, size, seal: seal.try_into().map_or(0, u32::from_le_bytes) }))
            }
            _ => Err("the index refers to bytes outside the file"),
        }
    };
    seals.chunks_exact(SEAL).zip(index.chunks_exact(PLACE)).map(piece).collect()
}

/// Checks every byte of a complete shard. Returns the fault, if any.
pub(super) fn fault(bytes: &[u8], frames: usize) -> Option<String> {
    let size = bytes.len() as u64;
    let Some(data) = size.checked_sub(tail_len(frames)) else {
        return Some("the shard is shorter than the index of its chunks".into());
    };
    let pieces = match parse(&bytes[data as usize..], size, frames) {
        Ok(pieces) => pieces,
        Err(reason) => return Some(reason.into()),
    };
    let mut there: Vec<(usize, Piece)> =
        pieces.into_iter().enumerate().filter_map(|(n, p)| Some((n, p?))).collect();
    there.sort_unstable_by_key(|(_, piece)| piece.offset);
    let mut end = 0;
    for (number, piece) in there {
        if piece.offset != end {
            return Some(format!("chunk {number} begins at byte {}, expected byte {end}", piece.offset));
        }
        end = piece.range().end;
        if let Some(reason) = piece.fault(&bytes[piece.offset as usize..end as usize]) {
            return Some(format!("chunk {number}: {reason}"));
        }
    }
    (end != data).then(|| format!("the chunks end at byte {end}, expected byte {data}"))
}

/// The number of frames per shard of each sharded array of a store, by the array's folder. The metadata of
/// the arrays contains these numbers.
#[derive(Clone, Debug, Default)]
pub(super) struct Shards(HashMap<String, usize>);

impl Shards {
    /// Finds the sharded arrays in metadata. `descriptions` contains the path and the content of each
    /// metadata file.
    pub(super) fn of<'a>(descriptions: impl IntoIterator<Item = (&'a str, Value)>) -> Self {
        let found = descriptions.into_iter().filter_map(|(path, json)| {
            let folder = path.strip_suffix("/zarr.json")?;
            let lengths =
                |value: &Value| -> Option<Vec<u64>> { value.as_array()?.iter().map(Value::as_u64).collect() };
            let codec = json["codecs"].get(0)?;
            let shard = lengths(&json["chunk_grid"]["configuration"]["chunk_shape"])?;
            let chunk = lengths(&codec["configuration"]["chunk_shape"])?;
            if codec["name"] != CODEC || shard.len() != chunk.len() {
                return None;
            }
            Some((folder.to_owned(), frames(&shard, &chunk)?))
        });
        Self(found.collect())
    }

    /// Finds the sharded arrays in the metadata of a folder. `files` contains the paths of all files in the
    /// folder.
    pub(super) fn in_folder<'a>(root: &Path, files: impl IntoIterator<Item = &'a String>) -> Self {
        let descriptions = files.into_iter().filter_map(|path| {
            let bytes = path.ends_with("/zarr.json").then(|| base::input::read(&root.join(path)));
            Some((path.as_str(), serde_json::from_slice(&bytes?.ok()?).ok()?))
        });
        Self::of(descriptions)
    }

    /// Returns the number of frames of a file, or `None` if the file is not a shard.
    pub(super) fn frames(&self, path: &str) -> Option<usize> {
        let (folder, name) = path.rsplit_once('/')?;
        self.0.get(folder).filter(|_| name.starts_with("c.")).copied()
    }
}

pub(super) const CODEC: &str = "sharding_indexed";

/// Returns the number of chunks of a shard, or `None` if the shape of a chunk does not divide the shape of
/// the shard.
pub(super) fn frames(shard: &[u64], chunk: &[u64]) -> Option<usize> {
    let along = |(s, c): (&u64, &u64)| (*c > 0 && *s > 0 && s % c == 0).then(|| s / c);
    let counts: Vec<u64> = shard.iter().zip(chunk).map(along).collect::<Option<_>>()?;
    tensor::region::volume(&counts).filter(|n| (1..=MAX_FRAMES).contains(n))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sealed(bytes: &[u8]) -> Vec<u8> {
        [bytes, &crc32c::crc32c(bytes).to_le_bytes()].concat()
    }

    fn example() -> (Vec<u8>, u32, [Vec<u8>; 2]) {
        let frames = [sealed(b"first frame"), sealed(b"second")];
        let mut builder = Builder::new(4);
        builder.push(2, &frames[0]);
        builder.push(1, &frames[1]);
        let (bytes, checksum) = builder.finish().unwrap();
        (bytes, checksum, frames)
    }

    #[test]
    fn frames_are_found_by_number() {
        let (bytes, sum, frames) = example();
        let tail = &bytes[bytes.len() - tail_len(4) as usize..];
        assert_eq!(checksum(tail), sum);
        let pieces = parse(tail, bytes.len() as u64, 4).unwrap();
        assert_eq!((pieces[0], pieces[3]), (None, None));
        for (number, frame) in [(2, &frames[0]), (1, &frames[1])] {
            let piece = pieces[number].unwrap();
            let range = piece.range().start as usize..piece.range().end as usize;
            assert_eq!(&bytes[range], &frame[..]);
            assert_eq!(piece.fault(frame), None);
        }
        // Two different valid frames have different checksums.
        assert!(pieces[2].unwrap().fault(&frames[1]).is_some());
        assert_eq!(fault(&bytes, 4), None);
        assert!(Builder::new(3).finish().is_none());
    }

    /// Verifies that two shards whose frames have equal sizes have the same index, but different checksums.
    #[test]
    fn checksums_distinguish_frames() {
        let shard = |content: &[u8]| {
            let mut builder = Builder::new(1);
            builder.push(0, &sealed(content));
            builder.finish().unwrap()
        };
        let ((a, of_a), (b, of_b)) = (shard(b"abc"), shard(b"abd"));
        assert_eq!(a[a.len() - 20..], b[b.len() - 20..]);
        assert_ne!(of_a, of_b);
    }

    proptest! {
        /// Verifies that any changed or lost byte is detected.
        #[test]
        fn damage_is_detected(at in any::<prop::sample::Index>(), byte in any::<u8>(), cut in any::<bool>()) {
            let (sound, sum, _) = example();
            let mut bytes = sound.clone();
            let at = at.index(bytes.len());
            if cut {
                bytes.remove(at);
            } else {
                bytes[at] = byte;
            }
            let tail = &bytes[bytes.len() - tail_len(4) as usize..];
            let noticed = fault(&bytes, 4).is_some() || checksum(tail) != sum;
            prop_assert!(bytes == sound || noticed);
        }

        #[test]
        fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), frames in 1_usize..6) {
            prop_assert!(fault(&bytes, frames).is_some() || bytes.is_empty());
        }
    }
}
