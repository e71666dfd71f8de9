//! How the numbers of a chunk become bytes: a Zstandard frame and its CRC-32C, a file of its own or one of a shard.

use super::shard::CODEC;
use super::sparse_frame::Content;
use serde_json::Value;
use std::cell::RefCell;
use std::io;
use std::num::NonZeroU64;
use std::sync::Arc;
use zarrs::array::codec::array_to_bytes::sharding::ShardingIndexLocation;
use zarrs::array::codec::{BytesCodec, Crc32cCodec, ShardingCodec, ZstdCodec};
use zarrs::array::{ArrayToBytesCodecTraits, BytesToBytesCodecTraits, CodecChain};

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
}

/// How the numbers of a chunk become the bytes of its file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coding {
    /// As they are.
    Plain,
    /// A Zstandard frame.
    Frame,
    /// A Zstandard frame and its CRC-32C.
    SealedFrame,
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

/// The frame of bytes whose content is this. (What zarrs' codecs would make, without a copy of the values and a new context for
/// every chunk.)
pub(super) fn encode(bytes: &[u8], content: Content) -> io::Result<Vec<u8>> {
    match content {
        Content::Sparse(frame) => Ok(frame),
        _ => compress(bytes),
    }
}

/// Adds its checksum to a frame.
pub(super) fn seal(frame: &mut Vec<u8>) {
    frame.extend(crc32c::crc32c(frame).to_le_bytes());
}

/// The codec of numbers.
pub(super) fn numbers() -> Arc<dyn ArrayToBytesCodecTraits> {
    Arc::new(BytesCodec::little())
}

/// The codecs of a sealed frame.
pub(super) fn frame() -> Vec<Arc<dyn BytesToBytesCodecTraits>> {
    vec![
        Arc::new(ZstdCodec::new(LEVEL, false)),
        Arc::new(Crc32cCodec::new()),
    ]
}

/// All codecs of a chunk.
pub(super) fn chain() -> CodecChain {
    CodecChain::new(vec![], numbers(), frame())
}

/// The codec of shards whose chunks have these lengths.
pub(super) fn shard(chunk: &[u64]) -> Arc<dyn ArrayToBytesCodecTraits> {
    let lengths = chunk
        .iter()
        .map(|n| NonZeroU64::new(*n).unwrap_or(NonZeroU64::MIN));
    let index = CodecChain::new(vec![], numbers(), vec![Arc::new(Crc32cCodec::new())]);
    Arc::new(ShardingCodec::new(
        lengths.collect(),
        Arc::new(chain()),
        Arc::new(index),
        ShardingIndexLocation::End,
    ))
}

/// What takes no options may be named by its name alone.
fn names(codecs: &Value) -> Vec<&str> {
    let list = codecs.as_array().into_iter().flatten();
    list.filter_map(|c| c["name"].as_str().or(c.as_str())).collect()
}

/// The coding that an array's description says, and, of an array in shards, the lengths of a chunk in them.
pub(super) fn of(codecs: &Value) -> Result<(Coding, Option<Vec<u64>>), String> {
    let found = names(codecs);
    match found[..] {
        ["bytes", "zstd", "crc32c"] => Ok((Coding::SealedFrame, None)),
        ["bytes", "zstd"] => Ok((Coding::Frame, None)),
        ["bytes"] => Ok((Coding::Plain, None)),
        [CODEC] => {
            let how = &codecs[0]["configuration"];
            let chunk = how["chunk_shape"].as_array();
            let chunk: Option<Vec<u64>> = chunk.and_then(|list| list.iter().map(Value::as_u64).collect());
            let ours = names(&how["codecs"]) == ["bytes", "zstd", "crc32c"]
                && names(&how["index_codecs"]) == ["bytes", "crc32c"]
                && how.get("index_location").is_none_or(|at| at == "end")
                && how["index_codecs"][0]["configuration"]["endian"] != "big";
            match chunk.filter(|_| ours) {
                Some(chunk) => Ok((Coding::SealedFrame, Some(chunk))),
                None => Err("its shards are not of `bytes`, `zstd` and `crc32c` with an index of `bytes` and `crc32c` at the end".into()),
            }
        }
        _ => Err(format!(
            "its codecs {found:?} are not `bytes`, `zstd` and `crc32c`"
        )),
    }
}
