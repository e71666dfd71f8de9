//! Encodes a chunk's numbers as a Zstandard frame and its CRC-32C, in a file or in a shard.

use super::shard::CODEC;
use super::sparse_frame::{self, Content};
use serde_json::{Value, json};
use std::cell::RefCell;
use std::io;

/// Zstandard compression level. Compared with this level, level 1 reduces the size of noisy floating-point
/// data by a further 8 %. Levels above 1 are slower and do not reduce the size further.
const LEVEL: i32 = -2;
/// Size of a CRC-32C checksum in bytes.
pub(super) const SEAL: usize = 4;
/// Name of the attribute of a sharded array that contains the shape of an unsharded chunk. An unsharded chunk
/// consists of several chunks of a shard. Reads of whole arrays use blocks of the shape of an unsharded
/// chunk.
pub(super) const CHUNK: &str = "unsharded_chunk";

thread_local! {
    /// Compression context of the thread. The context is reused, because creating it takes longer than
    /// compressing a small chunk.
    static COMPRESSOR: RefCell<Option<zstd::bulk::Compressor<'static>>> = const { RefCell::new(None) };
    static DECOMPRESSOR: RefCell<Option<zstd::bulk::Decompressor<'static>>> = const { RefCell::new(None) };
}

/// The encoding of a chunk file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Coding {
    pub(super) frame: Frame,
    /// Whether the byte order of the file differs from the byte order of this machine.
    pub(super) swapped: bool,
}

/// The format of a chunk's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Frame {
    /// Plain bytes, not compressed.
    Plain,
    Zstd,
    /// A Zstandard frame followed by its CRC-32C.
    Sealed,
}

/// Compresses bytes to one Zstandard frame that declares its content size.
fn compress(bytes: &[u8]) -> io::Result<Vec<u8>> {
    COMPRESSOR.with_borrow_mut(|slot| {
        let compressor = match slot {
            Some(c) => c,
            None => slot.insert(zstd::bulk::Compressor::new(LEVEL)?),
        };
        compressor.compress(bytes)
    })
}

/// Encodes a chunk. `bytes` are the chunk's numbers in the byte order of the file, and `content` is the
/// result of [`sparse_frame::encode`] for these bytes.
pub(super) fn encode(bytes: &[u8], content: Content, frame: Frame) -> io::Result<Vec<u8>> {
    let mut out = match (frame, content) {
        (Frame::Plain, _) => return Ok(bytes.to_vec()),
        (_, Content::Sparse(frame)) => frame,
        _ => compress(bytes)?,
    };
    if frame == Frame::Sealed {
        out.extend(crc32c::crc32c(&out).to_le_bytes());
    }
    Ok(out)
}

/// Decodes a chunk file into `out`, in the byte order of the file. Returns the fault if the decoded size
/// differs from the size of `out`.
pub(super) fn decode(bytes: &[u8], frame: Frame, out: &mut [u8]) -> Result<(), String> {
    let (content, seal) = match frame {
        Frame::Sealed => bytes.split_at(bytes.len().saturating_sub(SEAL)),
        _ => (bytes, &[][..]),
    };
    let declared = match frame {
        Frame::Plain => Some(content.len() as u64),
        _ => sparse_frame::content_size(content),
    };
    if declared != Some(out.len() as u64) {
        let found = declared.map_or("no complete Zstandard frame".into(), |n| format!("{n} bytes"));
        return Err(format!("the chunk has {found}, expected {} bytes", out.len()));
    }
    if frame == Frame::Plain {
        out.copy_from_slice(content);
        return Ok(());
    }
    if frame == Frame::Sealed && seal != crc32c::crc32c(content).to_le_bytes() {
        return Err("checksum mismatch".into());
    }
    let length = DECOMPRESSOR.with_borrow_mut(|slot| {
        let decompressor = match slot {
            Some(d) => d,
            None => slot.insert(zstd::bulk::Decompressor::new()?),
        };
        decompressor.decompress_to_buffer(content, out)
    });
    match length {
        Ok(n) if n == out.len() => Ok(()),
        Ok(n) => Err(format!("the decoded chunk has {n} bytes, expected {} bytes", out.len())),
        Err(e) => Err(format!("the Zstandard frame is damaged ({e})")),
    }
}

/// Returns the codecs of a new array: frames with a checksum, or shards whose chunks have the shape `inner`.
pub(super) fn describe(inner: Option<&[u64]>) -> Value {
    let numbers = json!({"name": "bytes", "configuration": {"endian": "little"}});
    let zstd = json!({"name": "zstd", "configuration": {"level": LEVEL, "checksum": false}});
    let seal = json!({"name": "crc32c"});
    match inner {
        None => json!([numbers, zstd, seal]),
        Some(chunk) => json!([{"name": CODEC, "configuration": {
            "chunk_shape": chunk,
            "codecs": [&numbers, zstd, &seal],
            "index_codecs": [&numbers, &seal],
            "index_location": "end",
        }}]),
    }
}

/// Returns the name of an extension, such as a codec. A plain string is valid for an extension without a
/// configuration.
pub(super) fn name(json: &Value) -> Option<&str> {
    json["name"].as_str().or(json.as_str())
}

fn names(codecs: &Value) -> Vec<&str> {
    codecs.as_array().into_iter().flatten().filter_map(name).collect()
}

/// Returns whether the first codec, `bytes`, specifies a byte order other than the byte order of this
/// machine.
fn is_swapped(codecs: &Value) -> Result<bool, String> {
    let ours = if cfg!(target_endian = "big") { "big" } else { "little" };
    let endian = &codecs[0]["configuration"]["endian"];
    match endian.as_str() {
        Some(endian @ ("little" | "big")) => Ok(endian != ours),
        _ => Err(format!("`endian` of the codec `bytes` is {endian}, expected \"little\" or \"big\"")),
    }
}

/// Parses the codecs in an array's metadata. Returns the encoding and, for a sharded array, the shape of a
/// chunk in a shard.
pub(super) fn of(codecs: &Value) -> Result<(Coding, Option<Vec<u64>>), String> {
    let found = names(codecs);
    let frame = match found[..] {
        ["bytes", "zstd", "crc32c"] => Frame::Sealed,
        ["bytes", "zstd"] => Frame::Zstd,
        ["bytes"] => Frame::Plain,
        [CODEC] => {
            let how = &codecs[0]["configuration"];
            let chunk = how["chunk_shape"].as_array();
            let chunk: Option<Vec<u64>> = chunk.and_then(|list| list.iter().map(Value::as_u64).collect());
            let ours = names(&how["codecs"]) == ["bytes", "zstd", "crc32c"]
                && names(&how["index_codecs"]) == ["bytes", "crc32c"]
                && how.get("index_location").is_none_or(|at| at == "end")
                && how["index_codecs"][0]["configuration"]["endian"] != "big";
            let chunk = chunk.filter(|_| ours).ok_or(
                "the configuration of the shards is not supported: expected `codecs` [bytes, zstd, crc32c], `index_codecs` [bytes \
                 (little-endian), crc32c] and `index_location` \"end\"",
            )?;
            let swapped = is_swapped(&how["codecs"])?;
            return Ok((Coding { frame: Frame::Sealed, swapped }, Some(chunk)));
        }
        _ => {
            return Err(format!(
                "the list of codecs is {found:?}, expected [\"bytes\", \"zstd\", \"crc32c\"]"
            ));
        }
    };
    let swapped = is_swapped(codecs)?;
    Ok((Coding { frame, swapped }, None))
}
