//! Decodes buffer views compressed with `EXT_meshopt_compression` and `KHR_meshopt_compression` (Khronos glTF
//! extensions, appendix A: bitstreams; appendix B: filters). Versions 0 and 1 of the attribute stream are
//! supported.

/// Encoding of the elements in a compressed buffer view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    Attributes,
    Triangles,
    Indices,
}

/// Unread bytes of a buffer view.
struct Stream<'a> {
    bytes: &'a [u8],
}

impl<'a> Stream<'a> {
    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.bytes.split_at_checked(n)?;
        self.bytes = rest;
        Some(head)
    }

    fn byte(&mut self) -> Option<u8> {
        self.take(1).map(|b| b[0])
    }

    /// Reads an integer that is stored as seven bits per byte, lowest bits first.
    fn number(&mut self) -> Option<u32> {
        let mut value = 0_u32;
        for shift in (0..35).step_by(7) {
            let byte = self.byte()?;
            value |= u32::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }
}

/// Decodes a signed number that stores its sign in the lowest bit (zigzag encoding).
fn unfolded(v: u32) -> u32 {
    (v >> 1) ^ (v & 1).wrapping_neg()
}

/// Decodes `count` elements of `stride` bytes. Returns `None` if the stream is invalid.
pub(super) fn decode(bytes: &[u8], mode: Mode, count: usize, stride: usize) -> Option<Vec<u8>> {
    let numbers = match mode {
        Mode::Attributes => return attributes(bytes, count, stride),
        Mode::Triangles => triangles(bytes, count)?,
        Mode::Indices => sequence(bytes, count)?,
    };
    match stride {
        2 => Some(numbers.iter().flat_map(|i| (*i as u16).to_le_bytes()).collect()),
        4 => Some(numbers.iter().flat_map(|i| i.to_le_bytes()).collect()),
        _ => None,
    }
}

fn attributes(bytes: &[u8], count: usize, stride: usize) -> Option<Vec<u8>> {
    let version = bytes.first()?.checked_sub(0xa0).filter(|v| *v < 2)?;
    if stride == 0 || !stride.is_multiple_of(4) || stride > 256 {
        return None;
    }
    let channels = if version == 1 { stride / 4 } else { 0 };
    let tail = bytes.len().checked_sub(stride + channels)?;
    let (mut last, channels) = (bytes[tail..tail + stride].to_vec(), &bytes[tail + stride..]);
    let mut stream = Stream { bytes: bytes.get(1..tail)? };
    let most = ((8192 / stride) & !15).min(256);
    let mut out: Vec<u8> = vec![];
    for done in (0..count).step_by(most) {
        let elements = most.min(count - done);
        // Each block consumes bytes, so the file's length bounds the allocation.
        out.resize(out.len() + elements * stride, 0);
        let block = &mut out[done * stride..];
        let controls = match version {
            1 => stream.take(stride / 4)?,
            _ => &[],
        };
        for k in (0..stride).step_by(4) {
            let mut planes = [const { Vec::new() }; 4];
            for (j, plane) in planes.iter_mut().enumerate() {
                *plane = match controls.get(k / 4).map(|c| c >> (2 * j) & 3) {
                    None => groups(&mut stream, elements, [0, 2, 4, 8])?,
                    Some(0) => groups(&mut stream, elements, [0, 1, 2, 4])?,
                    Some(1) => groups(&mut stream, elements, [1, 2, 4, 8])?,
                    Some(2) => vec![0; elements],
                    Some(_) => stream.take(elements)?.to_vec(),
                };
            }
            let channel = channels.get(k / 4).copied().unwrap_or(0);
            let before = &mut last[k..k + 4];
            for i in 0..elements {
                let delta = [0, 1, 2, 3].map(|j| planes[j][i]);
                let add16 = |a: usize| {
                    let d = unfolded(u16::from_le_bytes([delta[a], delta[a + 1]]).into()) as u16;
                    u16::from_le_bytes([before[a], before[a + 1]]).wrapping_add(d).to_le_bytes()
                };
                let new = match channel & 3 {
                    0 => [0, 1, 2, 3].map(|j| before[j].wrapping_add(unfolded(delta[j].into()) as u8)),
                    1 => {
                        let [[a, b], [c, d]] = [add16(0), add16(2)];
                        [a, b, c, d]
                    }
                    2 => {
                        let turned = u32::from_le_bytes(delta).rotate_right(u32::from(channel >> 4));
                        let before = u32::from_le_bytes([before[0], before[1], before[2], before[3]]);
                        (turned ^ before).to_le_bytes()
                    }
                    _ => return None,
                };
                before.copy_from_slice(&new);
                block[i * stride + k..i * stride + k + 4].copy_from_slice(&new);
            }
        }
    }
    Some(out)
}

/// Decodes one byte per element, in groups of 16. The header of each group selects the number of bits per
/// element from `bits`.
fn groups(stream: &mut Stream, elements: usize, bits: [u32; 4]) -> Option<Vec<u8>> {
    let count = elements.div_ceil(16);
    let headers = stream.take(count.div_ceil(4))?;
    let mut out = Vec::with_capacity(count * 16);
    for group in 0..count {
        let bits = bits[usize::from(headers[group / 4] >> (group % 4 * 2) & 3)];
        match bits {
            0 => out.extend([0; 16]),
            8 => out.extend(stream.take(16)?),
            _ => {
                let packed = stream.take(2 * bits as usize)?;
                let most = (1_u8 << bits) - 1;
                for i in 0..16 {
                    let at = i * bits as usize;
                    // The first value of a byte is in the highest bits. Values of one bit start at the
                    // lowest bit.
                    let shift = if bits == 1 { i % 8 } else { 8 - bits as usize - at % 8 };
                    let value = packed[at / 8] >> shift & most;
                    out.push(if value == most { stream.byte()? } else { value });
                }
            }
        }
    }
    out.truncate(elements);
    Some(out)
}

fn sequence(bytes: &[u8], count: usize) -> Option<Vec<u32>> {
    let end = bytes.len().checked_sub(4).filter(|end| count < *end)?;
    if bytes[0] & 0xf0 != 0xd0 || bytes[0] & 0xf > 1 {
        return None;
    }
    let mut stream = Stream { bytes: &bytes[1..end] };
    let mut last = [0_u32; 2];
    (0..count)
        .map(|_| {
            let v = stream.number()?;
            let last = &mut last[(v & 1) as usize];
            *last = last.wrapping_add(unfolded(v >> 1));
            Some(*last)
        })
        .collect()
}

/// Ring buffer of the last 16 entries.
struct Recent<T> {
    entries: [T; 16],
    next: usize,
}

impl<T: Copy + Default> Recent<T> {
    fn new() -> Self {
        Self { entries: [T::default(); 16], next: 0 }
    }

    fn push(&mut self, entry: T) {
        self.entries[self.next % 16] = entry;
        self.next = (self.next + 1) % 16;
    }

    /// Returns the entry that was pushed `back` pushes ago. `back` is at least 1.
    fn get(&self, back: usize) -> T {
        self.entries[(self.next + 32 - back) % 16]
    }
}

fn triangles(bytes: &[u8], count: usize) -> Option<Vec<u32>> {
    let version = bytes.first()?.checked_sub(0xe0).filter(|v| *v < 2)?;
    if !count.is_multiple_of(3) {
        return None;
    }
    let (body, table) = bytes.split_at_checked(bytes.len().checked_sub(16)?)?;
    let codes = body.get(1..1 + count / 3)?;
    let mut stream = Stream { bytes: &body[1 + count / 3..] };
    let (mut edges, mut vertices) = (Recent::<[u32; 2]>::new(), Recent::<u32>::new());
    let (mut next, mut last) = (0_u32, 0_u32);
    let far = if version == 1 { 13 } else { 15 };
    let mut out = Vec::with_capacity(count);
    let fresh = |next: &mut u32| {
        let new = *next;
        *next = next.wrapping_add(1);
        new
    };
    for &code in codes {
        let low = usize::from(code & 15);
        if code < 0xf0 {
            let [a, b] = edges.get(1 + usize::from(code >> 4));
            let c = if low < far && low != 0 {
                vertices.get(1 + low)
            } else {
                let c = match low {
                    0 => fresh(&mut next),
                    13 if version == 1 => last.wrapping_sub(1),
                    14 if version == 1 => last.wrapping_add(1),
                    _ => last.wrapping_add(unfolded(stream.number()?)),
                };
                if low != 0 {
                    last = c;
                }
                vertices.push(c);
                c
            };
            edges.push([c, b]);
            edges.push([a, c]);
            out.extend([a, b, c]);
            continue;
        }
        let (pair, first) = match code {
            0xfe | 0xff => (stream.byte()?, if code == 0xfe { 0 } else { 15 }),
            _ => (table[low], 0),
        };
        let explicit = code >= 0xfe;
        if explicit && pair == 0 {
            next = 0;
        }
        let choices = [first, usize::from(pair >> 4), usize::from(pair & 15)];
        // Assign numbers to new vertices before reading explicit indices.
        let mut corners = [0; 3];
        for (corner, choice) in corners.iter_mut().zip(choices) {
            *corner = match choice {
                0 => fresh(&mut next),
                15 if explicit => 0,
                back => vertices.get(back),
            };
        }
        for (corner, choice) in corners.iter_mut().zip(choices) {
            if choice == 15 && explicit {
                last = last.wrapping_add(unfolded(stream.number()?));
                *corner = last;
            }
        }
        for (corner, choice) in corners.iter().zip(choices) {
            if choice == 0 || choice == 15 && explicit {
                vertices.push(*corner);
            }
        }
        let [a, b, c] = corners;
        edges.push([b, a]);
        edges.push([c, b]);
        edges.push([a, c]);
        out.extend(corners);
    }
    Some(out)
}

/// Reverses a filter on elements of `stride` bytes. Returns `None` if the filter does not exist for elements
/// of the given size.
pub(super) fn unfilter(bytes: &mut [u8], filter: &str, stride: usize) -> Option<()> {
    let int16 = |b: &[u8], i: usize| f32::from(i16::from_le_bytes([b[2 * i], b[2 * i + 1]]));
    match (filter, stride) {
        ("NONE", _) => {}
        ("OCTAHEDRAL", 4) => {
            for e in bytes.chunks_exact_mut(4) {
                let v = octahedral([0, 1, 2].map(|i| f32::from(e[i] as i8)), 127.0);
                (0..3).for_each(|i| e[i] = v[i] as i8 as u8);
            }
        }
        ("OCTAHEDRAL", 8) => {
            for e in bytes.chunks_exact_mut(8) {
                let v = octahedral([0, 1, 2].map(|i| int16(e, i)), 32767.0);
                (0..3).for_each(|i| e[2 * i..2 * i + 2].copy_from_slice(&(v[i] as i16).to_le_bytes()));
            }
        }
        ("QUATERNION", 8) => {
            for e in bytes.chunks_exact_mut(8) {
                let code = i16::from_le_bytes([e[6], e[7]]);
                let scale = std::f32::consts::FRAC_1_SQRT_2 / f32::from(code | 3);
                let [x, y, z] = [0, 1, 2].map(|i| int16(e, i) * scale);
                let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
                for (i, v) in [(1, x), (2, y), (3, z), (0, w)] {
                    let at = 2 * ((code as usize + i) & 3);
                    e[at..at + 2].copy_from_slice(&((v * 32767.0).round() as i16).to_le_bytes());
                }
            }
        }
        ("EXPONENTIAL", _) if stride.is_multiple_of(4) => {
            for e in bytes.chunks_exact_mut(4) {
                let v = i32::from_le_bytes([e[0], e[1], e[2], e[3]]);
                let value = f64::from(v << 8 >> 8) * f64::from(v >> 24).exp2();
                e.copy_from_slice(&(value as f32).to_le_bytes());
            }
        }
        _ => return None,
    }
    Some(())
}

/// Decodes a unit vector in octahedral encoding, in which the value `one` represents 1, and multiplies the
/// vector by `full`.
fn octahedral([x, y, one]: [f32; 3], full: f32) -> [f32; 3] {
    let z = one - x.abs() - y.abs();
    let fold = z.min(0.0);
    let [x, y] = [x, y].map(|v| if v >= 0.0 { v + fold } else { v - fold });
    let scale = full / (x * x + y * y + z * z).sqrt();
    [x, y, z].map(|v| (v * scale).round())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draco_tests::stream as bytes;

    // Output of the encoder of npm's meshoptimizer 1.3.0 for the numbers given in the tests.
    const WORDS: [&str; 2] = [
        "a01f0002060a0e12161a1e22262a2e32363a3e42464a4e52565a5e62666a6e72767affff0000dc82868a8e92969a1480\
        020080c0820000052a066666666666666666666666666666666666666600000000002a0ddddddddddddddddddddddddd\
        dddddddddddddd000000001000100000000000000000000000000000000000000000000000000000000000000000ffff\
        0000",
        "a193a90002060a0e12161a1e22262a2e32363a3e42464a4e52565a5e62666a6e72767a2382868a8e92969a100100072a\
        0666666666666666666666666666666666666666000000002a0ddddddddddddddddddddddddddddddddddddddd000000\
        00000000000000000000000000000000000000ffff00000101",
    ];
    const FLOATS: [&str; 2] = [
        "a000002f0000ff8080404040402020202020202020101010101010101010101010101010f88888880000000010053080\
        00007c8000000000000000000000000000000000000000000000000000000000000000000000000000c0bf",
        "a168aa0502000f01001f1a0ffff8f8f4c4f4c48020107018381cf262e262f262e262fc1edddd00003e03070300000000\
        00000000000000000000000000000000c0bf6200",
    ];
    const TRIANGLES: &str = "e1f010fe23fffffe10f61201ff01004200007687566778a9866589689801690000";
    const SEQUENCE: &str = "d10004cd010407981fb701a0ec1000000000";

    #[test]
    fn attributes_of_both_versions_are_decoded() {
        let words: Vec<u8> = (0..40_u16)
            .flat_map(|i| [i * i % 977, 3 * i, 65535 - 7 * i, 0])
            .flat_map(u16::to_le_bytes)
            .collect();
        let floats: Vec<u8> =
            (0..40_u16).flat_map(|i| [f32::from(i) / 8.0, -1.5]).flat_map(f32::to_le_bytes).collect();
        for version in [0, 1] {
            let decoded = |text: [&str; 2]| decode(&bytes(text[version]), Mode::Attributes, 40, 8).unwrap();
            assert_eq!(decoded(WORDS), words, "version {version}");
            assert_eq!(decoded(FLOATS), floats, "version {version}");
        }
    }

    #[test]
    fn indices_are_decoded() {
        let expected = [0, 1, 2, 2, 1, 3, 4, 3, 5, 2, 3, 4, 9, 8, 0, 7, 7, 40, 0, 1, 2];
        let found = triangles(&bytes(TRIANGLES), 21).unwrap();
        // The encoder can rotate the corners of a triangle.
        let turned = |t: &[u32]| {
            let first = (0..3).min_by_key(|i| (t[*i], t[(i + 1) % 3])).unwrap();
            [0, 1, 2].map(|i| t[(first + i) % 3])
        };
        for (a, b) in found.chunks(3).zip(expected.chunks(3)) {
            assert_eq!(turned(a), turned(b), "{found:?}");
        }
        let found = sequence(&bytes(SEQUENCE), 8).unwrap();
        assert_eq!(found, [0, 1, 51, 2, 49, 1000, 3, 70000]);
    }

    #[test]
    fn filters_are_decoded() {
        let undone = |hex: &str, filter: &str, stride: usize| {
            let mut all = bytes(hex);
            unfilter(&mut all, filter, stride).unwrap();
            all
        };
        let normals = [
            [0.0, 0.0, 1.0],
            [1.0, 0.0, 0.0],
            [0.0, -0.6, -0.8],
            [-0.577_350_3, 0.577_350_3, -0.577_350_3_f32],
        ];
        let small = undone("00007f007f007f0049817f00ab557f00", "OCTAHEDRAL", 4);
        let large =
            undone("00000000ff7f0000ff7f0000ff7f000024490180ff7f0000abaa5555ff7f0000", "OCTAHEDRAL", 8);
        for (i, normal) in normals.iter().enumerate() {
            for (k, v) in normal.iter().enumerate() {
                let byte = f32::from(small[4 * i + k] as i8) / 127.0;
                let at = 8 * i + 2 * k;
                let word = f32::from(i16::from_le_bytes([large[at], large[at + 1]])) / 32767.0;
                assert!((byte - v).abs() < 0.012 && (word - v).abs() < 1e-4, "{byte} {word} {v}");
            }
        }
        let turns = [[0.0, 0.0, 0.0, 1.0], [0.5, 0.5, -0.5, 0.5], [0.8, 0.0, 0.6, 0.0_f32]];
        let found = undone("000000000000ff7f825a7ea5825afc7f00009c6c0000fc7f", "QUATERNION", 8);
        for (q, b) in turns.iter().zip(found.chunks(8)) {
            let dot: f32 = (0..4)
                .map(|i| q[i] * f32::from(i16::from_le_bytes([b[2 * i], b[2 * i + 1]])) / 32767.0)
                .sum();
            assert!((dot.abs() - 1.0).abs() < 1e-3, "{dot}");
        }
        let found = undone("000020eb0000b0eb000000f300087df3", "EXPONENTIAL", 8);
        let floats: Vec<f32> = found.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        assert_eq!(floats, [1.0, -2.5, 0.0, 1000.25]);
        assert!(unfilter(&mut [0; 4], "WHITENING", 4).is_none());
    }

    #[test]
    fn broken_streams_are_refused() {
        for text in [WORDS[0], WORDS[1], FLOATS[1]] {
            let all = bytes(text);
            for n in 0..all.len() {
                let _ = decode(&all[..n], Mode::Attributes, 40, 8);
            }
            assert!(decode(&all, Mode::Attributes, usize::MAX, 8).is_none());
            assert!(decode(&all[..40], Mode::Attributes, 40, 8).is_none());
        }
        for (text, mode) in [(TRIANGLES, Mode::Triangles), (SEQUENCE, Mode::Indices)] {
            let all = bytes(text);
            (0..all.len()).for_each(|n| drop(decode(&all[..n], mode, 21, 4)));
            assert!(decode(&all, mode, usize::MAX / 3 * 3, 4).is_none());
            assert!(decode(&all, mode, 3, 8).is_none());
        }
    }
}
