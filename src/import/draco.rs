//! Decodes primitives compressed with Draco (glTF extension `KHR_draco_mesh_compression`) to accessor values.
//! The crate `draco-core` decodes the bitstream.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use draco_core::{DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute, PointIndex};
use gltf::json::accessor::ComponentType;
use gltf::json::mesh::{Mode, Primitive};
use gltf::json::validation::Checked;
use gltf::json::{Root, Value};

use super::error::{ImportError, broken};
use super::gltf_notes::DRACO;

/// Elements of an accessor, tightly packed and little-endian.
pub(super) struct Elements {
    pub component: ComponentType,
    pub count: usize,
    pub bytes: Vec<u8>,
}

/// Maximum number of triangles or points per stream. A stream of less than a kilobyte can describe millions
/// of triangles, so the stream's length does not bound their number.
const MOST: u64 = 1 << 26;

/// Returns the values of the accessors of all compressed primitives. If a file also contains the uncompressed
/// values of a primitive, the uncompressed values are used because they are exact. `view` returns the bytes
/// of a buffer view.
pub(super) fn decode<'a>(
    root: &Root,
    view: impl Fn(usize) -> Option<&'a [u8]>,
) -> Result<BTreeMap<usize, Elements>, ImportError> {
    let mut out = BTreeMap::new();
    let mut streams = BTreeMap::new();
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            let Some(extension) = extension(primitive).filter(|_| lacks_values(root, primitive)) else {
                continue;
            };
            let wrong = |what: &str| broken(format!("{DRACO} of primitive {i} of mesh {m} {what}"));
            // The decoded indices are indices of separate triangles, not of a strip.
            if primitive.mode != Checked::Valid(Mode::Triangles) {
                return Err(wrong("does not have the mode TRIANGLES"));
            }
            let index = number(&extension["bufferView"]).ok_or_else(|| wrong("has no buffer view"))?;
            // Primitives of different materials can share a stream.
            let stream = match streams.entry(index) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(vacant) => {
                    let bytes = view(index).ok_or_else(|| wrong("extends beyond its buffer"))?;
                    let limits = DecodeLimits::default().with_max_points(MOST).with_max_faces(MOST);
                    let mut stream = Mesh::new();
                    MeshDecoder::new()
                        .decode(&mut DecoderBuffer::new(bytes).with_limits(limits), &mut stream)
                        .map_err(|e| wrong(&format!("cannot be decoded ({e})")))?;
                    vacant.insert(stream)
                }
            };
            if let Some(accessor) = primitive.indices {
                let faces = stream.faces().as_flattened();
                let bytes = faces.iter().flat_map(|point| point.0.to_le_bytes()).collect();
                let indices = Elements { component: ComponentType::U32, count: faces.len(), bytes };
                out.insert(accessor.value(), indices);
            }
            for (semantic, accessor) in &primitive.attributes {
                let Checked::Valid(semantic) = semantic else {
                    continue;
                };
                let Some(id) = extension["attributes"].get(semantic.to_string()) else {
                    continue;
                };
                let attribute = number(id).and_then(|id| u32::try_from(id).ok());
                let elements = attribute
                    .and_then(|id| stream.attribute_by_unique_id(id))
                    .and_then(|a| elements(a, stream.num_points()))
                    .ok_or_else(|| {
                        wrong(&format!("does not contain the attribute {}", semantic.to_string()))
                    })?;
                out.insert(accessor.value(), elements);
            }
        }
    }
    Ok(out)
}

fn extension(primitive: &Primitive) -> Option<&Value> {
    primitive.extensions.as_ref()?.others.get(DRACO)
}

/// Returns whether an accessor of a primitive has no bytes in a buffer.
fn lacks_values(root: &Root, primitive: &Primitive) -> bool {
    let accessors = primitive.attributes.values().chain(&primitive.indices);
    accessors
        .filter_map(|a| root.accessors.get(a.value()))
        .any(|a| a.buffer_view.is_none() && a.sparse.is_none())
}

fn number(value: &Value) -> Option<usize> {
    usize::try_from(value.as_u64()?).ok()
}

/// Returns the values of an attribute, one per point, or `None` if the attribute is invalid.
fn elements(attribute: &PointAttribute, points: usize) -> Option<Elements> {
    let component = match attribute.data_type() {
        DataType::Int8 => ComponentType::I8,
        DataType::Uint8 | DataType::Bool => ComponentType::U8,
        DataType::Int16 => ComponentType::I16,
        DataType::Uint16 => ComponentType::U16,
        DataType::Uint32 => ComponentType::U32,
        DataType::Float32 => ComponentType::F32,
        _ => return None,
    };
    let size = component.size() * usize::from(attribute.num_components());
    let stride = usize::try_from(attribute.byte_stride()).ok()?;
    let values = attribute.buffer().data();
    let mut bytes = Vec::with_capacity(points * size);
    for point in 0..u32::try_from(points).ok()? {
        let start = attribute.mapped_index(PointIndex(point)).0 as usize * stride;
        bytes.extend_from_slice(values.get(start..start + size)?);
    }
    Some(Elements { component, count: points, bytes })
}
