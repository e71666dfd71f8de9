//! What a Zstandard frame says of itself (RFC 8878, section 3.1.1), read before anything is decoded.

/// The content size that one Zstandard frame declares, if the bytes are exactly one complete frame that declares it.
pub(super) fn frame_content(bytes: &[u8]) -> Option<u64> {
    let descriptor = *bytes.strip_prefix(&[0x28, 0xB5, 0x2F, 0xFD])?.first()?;
    let single_segment = descriptor & 0x20 != 0;
    let checksum = if descriptor & 4 != 0 { 4 } else { 0 };
    let mut at = 5 + usize::from(!single_segment) + [0, 1, 2, 4][usize::from(descriptor & 3)];
    let size_bytes = match descriptor >> 6 {
        0 => usize::from(single_segment),
        flag => 1 << flag,
    };
    let field = bytes.get(at..at + size_bytes).filter(|f| !f.is_empty())?;
    let little = field.iter().rev().fold(0_u64, |n, &b| (n << 8) | u64::from(b));
    let content = if size_bytes == 2 { little + 256 } else { little };
    at += size_bytes;
    loop {
        let header = bytes.get(at..at + 3)?;
        let header = u32::from(header[0]) | u32::from(header[1]) << 8 | u32::from(header[2]) << 16;
        at += 3 + match (header >> 1) & 3 {
            1 => 1,
            3 => return None,
            _ => (header >> 3) as usize,
        };
        if header & 1 != 0 {
            return (at + checksum == bytes.len()).then_some(content);
        }
    }
}
