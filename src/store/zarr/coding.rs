//! How the numbers of a chunk become bytes: a Zstandard frame and its CRC-32C, a file of its own or one of a shard.

use super::shard::CODEC;
use super::sparse_frame::{self, Content};
use serde_json::{Value, json};
use std::cell::RefCell;
use std::io;

/// Zstandard level: noise of floating point numbers gets 8 % smaller at 1 and not at all at higher ones, only slower.
const LEVEL: i32 = -2;
/// Bytes of a CRC-32C.
pub(super) const SEAL: usize = 4;
/// Attribute of an array in shards: lengths of a chunk of it that was a file, several of which a shard has, and each of which several
/// of the shard's chunks make. What is read whole is read by these.
pub(super) const CHUNK: &str = "unsharded_chunk";

thread_local! {
    /// A compression context takes longer to make than to use on a small chunk.
    static COMPRESSOR: RefCell<Option<zstd::bulk::Compressor<'static>>> = const { RefCell::new(None) };
    static DECOMPRESSOR: RefCell<Option<zstd::bulk::Decompressor<'static>>> = const { RefCell::new(None) };
}

/// How the numbers of a chunk become the bytes of its file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Coding {
    pub(super) frame: Frame,
    /// Whether numbers have their bytes in another order than in memory here.
    pub(super) swapped: bool,
}

/// What is around the bytes of a chunk's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Frame {
    /// Nothing.
    Plain,
    /// A Zstandard frame.
    Zstd,
    /// A Zstandard frame and its CRC-32C.
    Sealed,
}

/// One Zstandard frame with its size.
fn compress(bytes: &[u8]) -> io::Result<Vec<u8>> {
    COMPRESSOR.with_borrow_mut(|slot| {
        let compressor = match slot {
            Some(c) => c,
            None => slot.insert(zstd::bulk::Compressor::new(LEVEL)?),
        };
        compressor.compress(bytes)
    })
}

/// The bytes of a chunk's file, `bytes` being its numbers in the order of the file and `content` what is known of them.
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

/// Fills `out` with the numbers' bytes, in the order of the file, of all of a chunk's file; says what is wrong if it is not of so many.
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
        return Err(format!("found {found}, expected {} bytes", out.len()));
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
        Ok(n) => Err(format!("found {n} bytes, expected {}", out.len())),
        Err(e) => Err(format!("its Zstandard frame is damaged ({e})")),
    }
}

/// The codecs of a new array in sealed frames, or of one in shards whose chunks have these lengths.
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

/// The name of an extension point, which may stand by itself where there is no configuration.
pub(super) fn name(json: &Value) -> Option<&str> {
    json["name"].as_str().or(json.as_str())
}

fn names(codecs: &Value) -> Vec<&str> {
    codecs.as_array().into_iter().flatten().filter_map(name).collect()
}

/// Whether the first of these codecs, `bytes`, writes numbers in another order than that of memory here.
fn is_swapped(codecs: &Value) -> Result<bool, String> {
    let ours = if cfg!(target_endian = "big") {
        "big"
    } else {
        "little"
    };
    match codecs[0]["configuration"]["endian"].as_str() {
        Some(endian @ ("little" | "big")) => Ok(endian != ours),
        _ => Err("its codec `bytes` needs `endian`, \"little\" or \"big\"".into()),
    }
}

/// The coding that an array's description says, and, of an array in shards, the lengths of a chunk in them.
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
                "its shards must use the codecs `bytes`, `zstd` and `crc32c`, with an index of \
                `bytes` and `crc32c` at the end",
            )?;
            let swapped = is_swapped(&how["codecs"])?;
            return Ok((
                Coding {
                    frame: Frame::Sealed,
                    swapped,
                },
                Some(chunk),
            ));
        }
        _ => {
            return Err(format!(
                "its codecs are {found:?}, expected `bytes`, `zstd` and `crc32c`"
            ));
        }
    };
    let swapped = is_swapped(codecs)?;
    Ok((Coding { frame, swapped }, None))
}
