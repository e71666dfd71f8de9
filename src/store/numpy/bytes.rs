//! Provides the bytes of an array's elements, either from the file or from memory.

use base::positioned;
use std::fs::File;
use std::io;

#[derive(Debug)]
pub(super) enum Bytes {
    File(File),
    /// Elements in memory, for an array in column-major order. The elements have been reordered to row-major
    /// order.
    Memory(Vec<u8>),
}

impl Bytes {
    /// Fills `out` with the bytes from offset `at`.
    pub(super) fn read_at(&self, at: u64, out: &mut [u8]) -> io::Result<()> {
        match self {
            Self::File(file) => positioned::read_exact_at(file, out, at),
            Self::Memory(bytes) => {
                let part = usize::try_from(at).ok().and_then(|at| bytes.get(at..)?.get(..out.len()));
                out.copy_from_slice(part.ok_or(io::ErrorKind::UnexpectedEof)?);
                Ok(())
            }
        }
    }
}

/// Returns elements of `size` bytes, reordered from column-major to row-major order, or `None` if memory is
/// insufficient.
pub(super) fn row_major(bytes: &[u8], shape: &[usize], size: usize) -> Option<Vec<u8>> {
    let mut out = vec![];
    out.try_reserve_exact(bytes.len()).ok()?;
    let mut index = vec![0; shape.len()];
    let mut steps = vec![size; shape.len()];
    for k in 1..shape.len() {
        steps[k] = steps[k - 1] * shape[k - 1];
    }
    let mut at = 0;
    while out.len() < bytes.len() {
        out.extend_from_slice(&bytes[at..at + size]);
        for k in (0..shape.len()).rev() {
            index[k] += 1;
            at += steps[k];
            if index[k] < shape[k] {
                break;
            }
            at -= steps[k] * shape[k];
            index[k] = 0;
        }
    }
    Some(out)
}
