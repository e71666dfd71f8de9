//! Checked access to glTF 2.0 buffers and accessors (specification, sections 3.6 and 5.1).
//!
//! The crate `gltf` decodes the container and the JSON. The accessor readers and the validation of the crate
//! are not used, because they panic on invalid files. Examples are a `POSITION` index out of range, an empty
//! accessor, an unsuitable component type, and a percent-encoded URI that is not UTF-8. This module checks
//! every index, offset and count against the available bytes.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::buffer::View;
use gltf::json::validation::Checked;
use gltf::json::{Root, Value};

use super::draco::{self, Elements};
use super::error::{ImportError, ImportProblem, broken};
use super::gltf_notes::MESHOPT;
use super::meshopt::{self, Mode};
use super::notes::Notes;

/// A document's JSON and the bytes of its buffers.
pub(super) struct Data<'a> {
    pub root: &'a Root,
    buffers: Vec<Cow<'a, [u8]>>,
    /// Decompressed buffer views.
    views: BTreeMap<usize, Vec<u8>>,
    /// Values of accessors of compressed primitives.
    elements: BTreeMap<usize, Elements>,
}

type Decode<T> = fn(ComponentType, bool, &[u8]) -> T;

impl<'a> Data<'a> {
    /// Loads all buffers: the GLB's binary chunk, data URIs and, if `base` is given, files below the folder
    /// `base`. A buffer that is too short causes only a note, because accessors are checked separately.
    pub fn new(
        root: &'a Root,
        blob: Option<&'a [u8]>,
        base: Option<&Path>,
        notes: &mut Notes,
    ) -> Result<Self, ImportError> {
        let mut buffers = Vec::with_capacity(root.buffers.len());
        for (i, buffer) in root.buffers.iter().enumerate() {
            // Fallback buffers of compressed views are not needed and can be empty.
            let extensions = buffer.extensions.as_ref().map(|e| &e.others);
            let is_fallback =
                |name: &&str| extensions.and_then(|e| e.get(*name)).is_some_and(|v| v["fallback"] == true);
            let is_absent = || {
                let mut views = root.buffer_views.iter().filter(|v| v.buffer.value() == i);
                let has_bytes = buffer.uri.is_some() || i == 0 && blob.is_some();
                !has_bytes && views.any(|v| compression(v).is_some())
            };
            if MESHOPT.iter().any(is_fallback) || is_absent() {
                buffers.push(Cow::Borrowed(&[][..]));
                continue;
            }
            let length = usize::try_from(buffer.byte_length.0).unwrap_or(usize::MAX);
            let mut bytes = match (&buffer.uri, blob) {
                (Some(uri), _) if uri.starts_with("data:") => {
                    let source = gltf::buffer::Source::Uri(uri);
                    let data = gltf::buffer::Data::from_source(source, None)
                        .map_err(|e| broken(format!("cannot decode the data URI of buffer {i} ({e})")))?;
                    Cow::Owned(data.0)
                }
                (Some(uri), _) => Cow::Owned(external(uri, length, base)?),
                (None, Some(blob)) if i == 0 => Cow::Borrowed(blob),
                (None, _) => {
                    return Err(broken(format!(
                        "buffer {i} has neither a `uri` nor data in the GLB container"
                    )));
                }
            };
            if bytes.len() < length {
                let found = bytes.len();
                notes.add(format!(
                    "buffer {i}: expected {length} bytes, got {found} bytes; the missing bytes are ignored"
                ));
            }
            let length = length.min(bytes.len());
            match &mut bytes {
                Cow::Borrowed(b) => *b = &b[..length],
                Cow::Owned(b) => b.truncate(length),
            }
            buffers.push(bytes);
        }
        let mut views = BTreeMap::new();
        for (i, view) in root.buffer_views.iter().enumerate() {
            if let Some((name, extension)) = compression(view) {
                let bytes = decompressed(extension, &buffers);
                let bytes =
                    bytes.ok_or_else(|| broken(format!("cannot decode {name} of buffer view {i}")))?;
                views.insert(i, bytes);
            }
        }
        let mut data = Self { root, buffers, views, elements: BTreeMap::new() };
        data.elements = draco::decode(root, |view| data.view(view))?;
        Ok(data)
    }

    /// Reads an accessor of `N` floating-point (or normalized or plain integer) components.
    pub fn floats<const N: usize>(&self, accessor: usize) -> Result<Vec<[f32; N]>, ImportError> {
        self.gather(accessor, decode_float)
    }

    /// Reads a scalar accessor of unsigned integers.
    pub fn indices(&self, accessor: usize) -> Result<Vec<u32>, ImportError> {
        let json = self.accessor(accessor)?;
        match component(json) {
            Some(ComponentType::U8 | ComponentType::U16 | ComponentType::U32) => {}
            _ => {
                return Err(broken(format!(
                    "accessor {accessor} does not contain unsigned integers, which indices require"
                )));
            }
        }
        let values = self.gather::<u32, 1>(accessor, |t, _, b| decode_unsigned(t, b))?;
        Ok(values.into_iter().map(|[i]| i).collect())
    }

    /// Reads an accessor of four unsigned integers per element.
    pub fn joints(&self, accessor: usize) -> Result<Vec<[u32; 4]>, ImportError> {
        self.gather(accessor, |t, _, b| decode_unsigned(t, b))
    }

    /// Reads an accessor of 4 × 4 float matrices, column by column.
    pub fn matrices(&self, accessor: usize) -> Result<Vec<[f32; 16]>, ImportError> {
        self.gather(accessor, decode_float)
    }

    fn accessor(&self, index: usize) -> Result<&'a Accessor, ImportError> {
        let missing = || broken(format!("accessor {index} does not exist"));
        self.root.accessors.get(index).ok_or_else(missing)
    }

    fn gather<T: Copy + Default, const N: usize>(
        &self,
        index: usize,
        decode: Decode<T>,
    ) -> Result<Vec<[T; N]>, ImportError> {
        let json = self.accessor(index)?;
        let wrong = |what: &str| broken(format!("accessor {index} {what}"));
        let decoded = self.elements.get(&index);
        let component = decoded.map(|d| d.component).or(component(json));
        let component = component.ok_or_else(|| wrong("has an unknown component type"))?;
        let dimensions = match json.type_ {
            Checked::Valid(Type::Scalar) => 1,
            Checked::Valid(Type::Vec2) => 2,
            Checked::Valid(Type::Vec3) => 3,
            Checked::Valid(Type::Vec4) => 4,
            Checked::Valid(Type::Mat4) => 16,
            _ => 0,
        };
        if dimensions != N {
            return Err(wrong(&format!("does not have {N} components per element")));
        }
        let count = usize::try_from(json.count.0).unwrap_or(usize::MAX);
        let size = component.size();
        let element = |bytes: &[u8]| {
            let mut out = [T::default(); N];
            for (o, b) in out.iter_mut().zip(bytes.chunks_exact(size)) {
                *o = decode(component, json.normalized, b);
            }
            out
        };
        let length = count.saturating_mul(size * N);
        if let Some(d) = decoded.filter(|d| (d.count, d.bytes.len()) != (count, length)) {
            return Err(wrong(&format!(
                "does not match the compressed data: expected {count} elements ({length} bytes), got {} elements ({} bytes)",
                d.count,
                d.bytes.len()
            )));
        }
        let mut values: Vec<[T; N]> = match (decoded, json.buffer_view) {
            (Some(decoded), _) => decoded.bytes.chunks_exact(size * N).map(element).collect(),
            (None, Some(view)) => self
                .elements(view.value(), json.byte_offset.map_or(0, |o| o.0), count, size * N)
                .ok_or_else(|| wrong("extends beyond its buffer"))?
                .map(element)
                .collect(),
            (None, None) if count > self.buffers.iter().map(|b| b.len()).sum() => {
                return Err(wrong(
                    "has no data, and its number of elements exceeds the number of bytes of the file",
                ));
            }
            (None, None) => vec![[T::default(); N]; count],
        };
        if let Some(sparse) = &json.sparse {
            let outside = || wrong("has sparse data beyond the end of its buffer");
            let changes = usize::try_from(sparse.count.0).unwrap_or(usize::MAX);
            let Checked::Valid(target_type) = sparse.indices.component_type else {
                return Err(wrong("has sparse indices of an unknown type"));
            };
            let (at, data) = (&sparse.indices, &sparse.values);
            let targets = self
                .elements(at.buffer_view.value(), at.byte_offset.0, changes, target_type.0.size())
                .ok_or_else(outside)?;
            let changed = self
                .elements(data.buffer_view.value(), data.byte_offset.0, changes, size * N)
                .ok_or_else(outside)?;
            for (target, bytes) in targets.zip(changed) {
                let target = decode_unsigned(target_type.0, target) as usize;
                *values.get_mut(target).ok_or_else(outside)? = element(bytes);
            }
        }
        Ok(values)
    }

    /// Returns the bytes of a buffer view, or `None` if the buffer is too short.
    fn view(&self, index: usize) -> Option<&[u8]> {
        let view = self.root.buffer_views.get(index)?;
        if let Some(decoded) = self.views.get(&index) {
            return Some(decoded);
        }
        let start = usize::try_from(view.byte_offset.map_or(0, |o| o.0)).ok()?;
        let end = start.checked_add(usize::try_from(view.byte_length.0).ok()?)?;
        self.buffers.get(view.buffer.value())?.get(start..end)
    }

    /// Returns `count` elements of `size` bytes each, or `None` if the view or its buffer is too short.
    fn elements(
        &self,
        view: usize,
        offset: u64,
        count: usize,
        size: usize,
    ) -> Option<impl Iterator<Item = &[u8]>> {
        let bytes = self.view(view)?.get(usize::try_from(offset).ok()?..)?;
        let stride = self.root.buffer_views.get(view)?.byte_stride.map_or(0, |s| s.0);
        let stride = if stride == 0 { size } else { stride };
        if count > 0 {
            let last = stride.checked_mul(count - 1)?.checked_add(size)?;
            bytes.get(..last)?;
        }
        Some((0..count).map(move |i| &bytes[i * stride..i * stride + size]))
    }
}

fn compression(view: &View) -> Option<(&'static str, &Value)> {
    let extensions = &view.extensions.as_ref()?.others;
    MESHOPT.into_iter().find_map(|name| Some((name, extensions.get(name)?)))
}

/// Decompresses a buffer view. Returns `None` on invalid data. Colour filters are not reversed because
/// colours are not used.
fn decompressed(extension: &Value, buffers: &[Cow<[u8]>]) -> Option<Vec<u8>> {
    let number = |key: &str| usize::try_from(extension[key].as_u64()?).ok();
    let start = extension.get("byteOffset").map_or(Some(0), |_| number("byteOffset"))?;
    let end = start.checked_add(number("byteLength")?)?;
    let bytes = buffers.get(number("buffer")?)?.get(start..end)?;
    let mode = match extension["mode"].as_str()? {
        "ATTRIBUTES" => Mode::Attributes,
        "TRIANGLES" => Mode::Triangles,
        "INDICES" => Mode::Indices,
        _ => return None,
    };
    let stride = number("byteStride")?;
    let mut out = meshopt::decode(bytes, mode, number("count")?, stride)?;
    match extension.get("filter").map(|filter| filter.as_str()) {
        None | Some(Some("COLOR")) => {}
        Some(filter) => meshopt::unfilter(&mut out, filter?, stride)?,
    }
    Some(out)
}

fn component(json: &Accessor) -> Option<ComponentType> {
    match json.component_type {
        Checked::Valid(t) => Some(t.0),
        Checked::Invalid => None,
    }
}

/// Decodes little-endian bytes of a component type to a float. Normalized integers map to 0..1, or to -1..1
/// if signed.
fn decode_float(t: ComponentType, normalized: bool, b: &[u8]) -> f32 {
    let scaled = |x: f32, full: f32| if normalized { (x / full).max(-1.0) } else { x };
    match (t, b) {
        (ComponentType::I8, &[a]) => scaled(f32::from(a as i8), 127.0),
        (ComponentType::U8, &[a]) => scaled(f32::from(a), 255.0),
        (ComponentType::I16, &[a, b]) => scaled(f32::from(i16::from_le_bytes([a, b])), 32767.0),
        (ComponentType::U16, &[a, b]) => scaled(f32::from(u16::from_le_bytes([a, b])), 65535.0),
        (ComponentType::U32, &[a, b, c, d]) => u32::from_le_bytes([a, b, c, d]) as f32,
        (ComponentType::F32, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]),
        _ => f32::NAN,
    }
}

fn decode_unsigned(t: ComponentType, b: &[u8]) -> u32 {
    match (t, b) {
        (ComponentType::U8, &[a]) => a.into(),
        (ComponentType::U16, &[a, b]) => u16::from_le_bytes([a, b]).into(),
        (ComponentType::U32, &[a, b, c, d]) => u32::from_le_bytes([a, b, c, d]),
        _ => u32::MAX,
    }
}

/// Reads the first `length` bytes of a buffer file next to the document.
fn external(uri: &str, length: usize, base: Option<&Path>) -> Result<Vec<u8>, ImportError> {
    let Some(base) = base else {
        let what = format!("buffer {uri:?} is in an external file");
        return Err(ImportError::new(what, "load the document from disk, or embed its buffers"));
    };
    let name = percent_decoded(uri)
        .ok_or_else(|| broken(format!("the buffer URI {uri:?} is not a valid file name")))?;
    if uri.contains(':') || Path::new(&name).is_absolute() {
        let what = format!("the buffer URI {uri:?} is not a relative path");
        return Err(ImportError::new(what, "put the buffer next to the document and use a relative URI"));
    }
    let path = base.join(name);
    let read = || {
        let file = base::input::open(&path)?;
        let mut bytes = Vec::new();
        file.take(length as u64).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    read().map_err(|cause| {
        let what = format!("buffer {}", path.display());
        ImportProblem::Read { what, cause }.into()
    })
}

/// Decodes percent-encoding (RFC 3986). Returns `None` if the result is not UTF-8.
pub(super) fn percent_decoded(uri: &str) -> Option<String> {
    let mut out = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&b, tail)) = rest.split_first() {
        rest = tail;
        let hex = tail.first_chunk::<2>().filter(|_| b == b'%');
        let digits = hex.and_then(|h| std::str::from_utf8(h).ok());
        match digits.and_then(|d| u8::from_str_radix(d, 16).ok()) {
            Some(decoded) => {
                out.push(decoded);
                rest = &tail[2..];
            }
            None => out.push(b),
        }
    }
    String::from_utf8(out).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_are_decoded() {
        assert_eq!(percent_decoded("a%20b%2Fc.bin").as_deref(), Some("a b/c.bin"));
        assert_eq!(percent_decoded("100%").as_deref(), Some("100%"));
        assert_eq!(percent_decoded("%zz").as_deref(), Some("%zz"));
        assert_eq!(percent_decoded("%ff"), None);
    }

    #[test]
    fn integers_are_normalized_as_specified() {
        assert_eq!(decode_float(ComponentType::I8, true, &[0x80]), -1.0);
        assert_eq!(decode_float(ComponentType::U8, true, &[255]), 1.0);
        assert_eq!(decode_float(ComponentType::I16, false, &[0xfe, 0xff]), -2.0);
        assert_eq!(decode_float(ComponentType::U16, true, &[0xff, 0xff]), 1.0);
    }
}
