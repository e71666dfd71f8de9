//! Reads glTF 2.0, as JSON or GLB (Khronos, "glTF 2.0 specification", 2021), with the following extensions:
//! - `EXT_mesh_gpu_instancing`
//! - `KHR_mesh_quantization`
//! - `KHR_node_visibility`
//! - `KHR_draco_mesh_compression`
//! - `EXT_meshopt_compression` and `KHR_meshopt_compression`
//!
//! Transforms of the node tree are multiplied in double precision. Every mesh is transformed to world space
//! once per node that uses the mesh. Meshes are in the rest pose: morph targets have their default weights,
//! and skins follow the transforms of their joints. As in Sunstone, axes are right-handed with +y up. Units
//! are metres.

use std::borrow::Cow;
use std::path::Path;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec2, Vec3};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::scene::Node;
use gltf::json::validation::Checked;
use gltf::json::{Index, Root, Value};

use super::accessor::{Data, percent_decoded};
use super::error::{ImportError, ImportProblem, broken};
use super::gltf_deform::{self, Pose};
use super::gltf_notes::{self, INSTANCING, VISIBILITY};
use super::part::{self, Model, Parts};
use transport::geometry::mesh::Mesh;

/// Maximum number of triangles after instancing of one file (about 2 GB of tables).
const MAX_TRIANGLES: usize = 1 << 26;

/// Parses a glTF document or GLB container. Uses the default scene if there is one. Otherwise, uses the first
/// of these that exists: the first scene, all nodes, or all meshes. Each primitive of each node with a mesh
/// becomes a part in world space, named after the node.
///
/// `base_dir` is the folder of external buffers. Without `base_dir`, external buffers are an error. Materials
/// without a name are named `material_` and their index. Notes list points, lines and all other contents that
/// are not used.
///
/// # Errors
/// Returns [`ImportError`] if the file is invalid, requires an unsupported geometry extension or has no
/// triangles, or if its nodes are not a tree.
pub fn parse_gltf(bytes: &[u8], base_dir: Option<&Path>) -> Result<Model, ImportError> {
    let (json, blob) = container(bytes)?;
    let cannot = |e: gltf::json::Error| broken(format!("cannot parse the glTF JSON ({e})"));
    // The generic `deserialize::from_slice` would compile the code for `Root` again in this optimized crate.
    let mut document: Value = gltf::json::deserialize::from_slice(&json).map_err(cannot)?;
    let version = document["asset"]["version"].as_str().unwrap_or("1.0");
    if !version.starts_with("2.") {
        let what = format!("expected glTF 2.x, got version {version}");
        return Err(ImportError::new(what, "export the file as glTF 2.0"));
    }
    let mut parts = Parts::default();
    gltf_notes::read(&document, &mut parts.notes)?;
    let materials = material_names(&document);
    // Remove the parts that are not read, so that they cannot cause an error.
    if let Some(top) = document.as_object_mut() {
        for key in ["animations", "cameras", "materials", "textures", "images", "samplers", "extensions"] {
            top.remove(key);
        }
    }
    // A scene without nodes is empty (section 3.5.1).
    for scene in document.get_mut("scenes").and_then(Value::as_array_mut).into_iter().flatten() {
        if let Some(scene) = scene.as_object_mut() {
            scene.entry("nodes").or_insert_with(|| Value::Array(vec![]));
        }
    }
    let json = gltf::json::serialize::to_vec(&document).map_err(cannot)?;
    let root = Root::from_slice(&json).map_err(cannot)?;
    let data = Data::new(&root, blob.as_deref(), base_dir, &mut parts.notes)?;
    let mut importer = Importer {
        worlds: worlds(&root)?,
        data,
        materials,
        primitives: vec![None; root.meshes.len()],
        parts,
        triangles: 0,
    };
    importer.walk()?;
    importer.parts.end("export a scene whose nodes have triangle meshes")
}

/// Returns the file names of a document's external buffers. Unreadable parts of the document are skipped.
pub fn gltf_buffers(bytes: &[u8]) -> Vec<String> {
    let root = container(bytes).ok().and_then(|(json, _)| Root::from_slice(&json).ok());
    let buffers = root.map(|root| root.buffers).unwrap_or_default();
    let uris = buffers.iter().filter_map(|buffer| buffer.uri.as_deref());
    uris.filter(|uri| !uri.contains(':')).filter_map(percent_decoded).collect()
}

/// Bytes that are part of a file, or that were decoded from the file.
type Bytes<'a> = Cow<'a, [u8]>;

/// Returns a file's JSON and the binary chunk of a GLB.
pub(super) fn container(bytes: &[u8]) -> Result<(Bytes<'_>, Option<Bytes<'_>>), ImportError> {
    if bytes.is_empty() {
        return Err(ImportProblem::EmptyFile.into());
    }
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).into(), None));
    }
    let word = |at: usize| {
        let word = bytes.get(at..at + 4)?.try_into().ok()?;
        Some(u32::from_le_bytes(word) as usize)
    };
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(broken("the GLB header is truncated"));
    };
    if version != 2 {
        let what = format!("expected a GLB container of version 2, got {version}");
        return Err(ImportError::new(what, "export the file as glTF 2.0"));
    }
    let (mut json, mut bin, mut at) = (None, None, 12);
    // A chunk may be longer than the rest of a truncated file. Buffers and accessors are checked separately.
    while let (Some(size), Some(kind)) = (word(at), bytes.get(at + 4..at + 8)) {
        if at >= length {
            break;
        }
        let rest = &bytes[at + 8..];
        let chunk = &rest[..size.min(rest.len())];
        match kind {
            b"JSON" => json = json.or(Some(chunk)),
            b"BIN\0" => bin = bin.or(Some(chunk)),
            // The specification (section 4.4.1) requires unknown chunks to be ignored.
            _ => {}
        }
        at += 8 + chunk.len();
        // Chunks begin at multiples of 4. Some exporters give the length without the padding, and others omit
        // the padding.
        if bytes.get(at + 4..at + 8) != Some(b"BIN\0") {
            at = at.next_multiple_of(4);
        }
    }
    let json = json.ok_or_else(|| broken("the GLB container has no `JSON` chunk"))?;
    Ok((json.into(), bin.map(Cow::Borrowed)))
}

struct Importer<'a> {
    data: Data<'a>,
    materials: Vec<String>,
    /// Node-to-world transforms, or `None` for nodes that do not belong to a tree.
    worlds: Vec<Option<DAffine3>>,
    /// Primitives of each mesh in the mesh's own space with default weights, or `None` before the mesh is
    /// read.
    primitives: Vec<Option<Vec<Local>>>,
    parts: Parts,
    triangles: usize,
}

/// A primitive in the space of its mesh.
#[derive(Clone)]
struct Local {
    material: Option<String>,
    mesh: Mesh,
}

impl Importer<'_> {
    fn walk(&mut self) -> Result<(), ImportError> {
        let root = self.data.root;
        if root.nodes.is_empty() {
            for mesh in 0..root.meshes.len() {
                let local = self.read(mesh, &Pose::default())?;
                self.place(mesh, None, &local, &[DAffine3::IDENTITY])?;
            }
            return Ok(());
        }
        let mut stack = roots(root, &mut self.parts)?;
        stack.reverse();
        let mut visited = vec![false; root.nodes.len()];
        while let Some(index) = stack.pop() {
            let node = root.nodes.get(index).ok_or_else(|| broken(format!("node {index} does not exist")))?;
            if std::mem::replace(&mut visited[index], true) {
                return Err(broken(format!(
                    "node {index} occurs more than once in the hierarchy (a cycle, or a node that is listed as a child twice)"
                )));
            }
            let extension = |name| node.extensions.as_ref().and_then(|e| e.others.get(name));
            if extension(VISIBILITY).is_some_and(|v| v["visible"] == false) {
                let name = node.name.clone().unwrap_or_else(|| format!("node {index}"));
                self.parts
                    .notes
                    .add(format!("{name:?} is invisible, so this node and its children are skipped"));
                continue;
            }
            if let Some(mesh) = node.mesh {
                self.node(node, index, mesh.value())?;
            }
            stack.extend(node.children.iter().flatten().rev().map(Index::value));
        }
        let left = root.nodes.iter().zip(visited).filter(|(n, seen)| n.mesh.is_some() && !seen);
        let note = "a node with a mesh is skipped because the node is not part of the scene";
        self.parts.notes.add_times(note, left.count());
        Ok(())
    }

    /// Adds the primitives of a node's mesh to the parts.
    fn node(&mut self, node: &Node, index: usize, mesh: usize) -> Result<(), ImportError> {
        let name = node.name.as_deref();
        let pose = Pose {
            weights: node.weights.as_deref(),
            joints: match node.skin {
                Some(skin) => Some(gltf_deform::joints(&self.data, skin.value(), &self.worlds)?),
                None => None,
            },
        };
        // A skin's joints map to world space, independent of the node's own transform (section 3.7.3.1).
        if pose.joints.is_some() {
            let local = self.read(mesh, &pose)?;
            return self.place(mesh, name, &local, &[DAffine3::IDENTITY]);
        }
        let world = self.worlds[index]
            .ok_or_else(|| broken(format!("node {index} is part of a cycle of child nodes")))?;
        let maps: Vec<_> = self.instances(node)?.iter().map(|i| world * *i).collect();
        let local = self.read(mesh, &pose)?;
        self.place(mesh, name, &local, &maps)
    }

    fn read(&mut self, mesh: usize, pose: &Pose) -> Result<Vec<Local>, ImportError> {
        let is_default = pose.weights.is_none() && pose.joints.is_none();
        if let Some(Some(known)) = self.primitives.get(mesh).filter(|_| is_default) {
            return Ok(known.clone());
        }
        let read = read_mesh(&self.data, &self.materials, mesh, pose, &mut self.parts)?;
        if is_default {
            self.primitives[mesh] = Some(read.clone());
        }
        Ok(read)
    }

    /// Returns a node's instance transforms (`EXT_mesh_gpu_instancing`), or the identity if the node has
    /// none.
    fn instances(&self, node: &Node) -> Result<Vec<DAffine3>, ImportError> {
        let extension = node.extensions.as_ref().and_then(|e| e.others.get(INSTANCING));
        let Some(attributes) = extension.map(|e| e.get("attributes")) else {
            return Ok(vec![DAffine3::IDENTITY]);
        };
        let accessor = |name: &str| -> Result<Option<usize>, ImportError> {
            let Some(value) = attributes.and_then(|a| a.get(name)) else {
                return Ok(None);
            };
            match Value::as_u64(value).and_then(|i| usize::try_from(i).ok()) {
                Some(i) => Ok(Some(i)),
                None => Err(broken(format!("{INSTANCING}: {name} is not the index of an accessor"))),
            }
        };
        let moves = accessor("TRANSLATION")?.map(|i| self.data.floats::<3>(i)).transpose()?;
        let turns = accessor("ROTATION")?.map(|i| self.data.floats::<4>(i)).transpose()?;
        let scales = accessor("SCALE")?.map(|i| self.data.floats::<3>(i)).transpose()?;
        let counts =
            [moves.as_ref().map(Vec::len), turns.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)];
        let count = counts.iter().flatten().copied().next().unwrap_or(0);
        if counts.iter().flatten().any(|&c| c != count) {
            let found: Vec<_> = counts.iter().flatten().collect();
            return Err(broken(format!(
                "{INSTANCING}: the attributes have different numbers of elements: {found:?}"
            )));
        }
        if count == 0 {
            return Err(broken(format!("{INSTANCING}: the attributes have no elements")));
        }
        (0..count)
            .map(|i| {
                trs(
                    moves.as_ref().map_or([0.0; 3], |m| m[i]),
                    turns.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |r| r[i]),
                    scales.as_ref().map_or([1.0; 3], |s| s[i]),
                )
                .ok_or_else(|| {
                    broken(format!("{INSTANCING}: the rotation of instance {i} is not a unit quaternion"))
                })
            })
            .collect()
    }

    /// Adds the primitives of a mesh to the parts, once for each mesh-to-world transform.
    fn place(
        &mut self,
        mesh: usize,
        node: Option<&str>,
        primitives: &[Local],
        maps: &[DAffine3],
    ) -> Result<(), ImportError> {
        let mesh = mesh_name(self.data.root, mesh);
        for (i, map) in maps.iter().enumerate() {
            for (k, local) in primitives.iter().enumerate() {
                self.triangles += local.mesh.indices.len();
                if self.triangles > MAX_TRIANGLES {
                    return Err(ImportError::new(
                        format!("the instances have more than {MAX_TRIANGLES} triangles in total"),
                        "use fewer instances or a simpler mesh",
                    ));
                }
                let mut name = node.unwrap_or(&mesh).to_owned();
                if maps.len() > 1 {
                    name += &format!("#{i}");
                }
                if primitives.len() > 1 {
                    name += &format!(".{k}");
                }
                let mut baked = local.mesh.clone();
                baked.transform(&map.as_affine3a());
                self.parts.add(name, local.material.clone(), baked)?;
            }
        }
        Ok(())
    }
}

/// Returns the node-to-world transforms of all nodes, or `None` for nodes in a cycle.
fn worlds(root: &Root) -> Result<Vec<Option<DAffine3>>, ImportError> {
    let mut out = vec![None; root.nodes.len()];
    let mut stack: Vec<_> = tops(root).into_iter().map(|n| (n, DAffine3::IDENTITY)).collect();
    while let Some((index, parent)) = stack.pop() {
        let Some(node) = root.nodes.get(index) else {
            // The missing node is reported if the scene refers to the node.
            continue;
        };
        if out[index].is_some() {
            return Err(broken(format!("node {index} is listed as a child more than once")));
        }
        let world = parent * local(node, index)?;
        out[index] = Some(world);
        stack.extend(node.children.iter().flatten().map(|child| (child.value(), world)));
    }
    Ok(out)
}

/// Returns the indices of the nodes without a parent.
fn tops(root: &Root) -> Vec<usize> {
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|n| n.children.iter().flatten()) {
        if let Some(flag) = is_child.get_mut(child.value()) {
            *flag = true;
        }
    }
    (0..root.nodes.len()).filter(|&n| !is_child[n]).collect()
}

/// Returns the indices of the root nodes to import.
fn roots(root: &Root, parts: &mut Parts) -> Result<Vec<usize>, ImportError> {
    if root.scenes.is_empty() {
        return Ok(tops(root));
    }
    let scene = root.scene.map_or(0, |scene| scene.value());
    let missing = || {
        let count = root.scenes.len();
        broken(format!(
            "the default scene {scene} (counted from 0) does not exist: the file has {count} scenes"
        ))
    };
    let nodes = &root.scenes.get(scene).ok_or_else(missing)?.nodes;
    let others = root.scenes.len() - 1;
    if others > 0 {
        parts.notes.add(format!("scene {scene} (counted from 0) is used; {others} other scenes are ignored"));
    }
    Ok(nodes.iter().map(Index::value).collect())
}

/// Returns the transform from a node to its parent.
fn local(node: &Node, index: usize) -> Result<DAffine3, ImportError> {
    let Some(m) = node.matrix else {
        return trs(
            node.translation.unwrap_or([0.0; 3]),
            node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |q| q.0),
            node.scale.unwrap_or([1.0; 3]),
        )
        .ok_or_else(|| broken(format!("the rotation of node {index} is not a unit quaternion")));
    };
    let column = |i: usize| DVec3::new(m[i].into(), m[i + 1].into(), m[i + 2].into());
    if [m[3], m[7], m[11], m[15] - 1.0].iter().any(|x| x.abs() > 1e-5) {
        let what = format!(
            "the matrix of node {index} is not affine (the bottom row is {} {} {} {}, not 0 0 0 1)",
            m[3], m[7], m[11], m[15]
        );
        return Err(broken(what));
    }
    let linear = DMat3::from_cols(column(0), column(4), column(8));
    Ok(DAffine3::from_mat3_translation(linear, column(12)))
}

/// Returns translation · rotation · scale, or `None` if the quaternion (x, y, z, w) cannot be normalized.
fn trs(t: [f32; 3], r: [f32; 4], s: [f32; 3]) -> Option<DAffine3> {
    let q = DQuat::from_array(r.map(f64::from));
    let length = q.length();
    if !(0.5..2.0).contains(&length) {
        return None;
    }
    let [t, s] = [t, s].map(|v| DVec3::from_array(v.map(f64::from)));
    Some(DAffine3::from_scale_rotation_translation(s, q / length, t))
}

fn mesh_name(root: &Root, index: usize) -> String {
    let name = root.meshes.get(index).and_then(|m| m.name.clone());
    name.unwrap_or_else(|| format!("mesh_{index}"))
}

fn read_mesh(
    data: &Data,
    materials: &[String],
    index: usize,
    pose: &Pose,
    parts: &mut Parts,
) -> Result<Vec<Local>, ImportError> {
    let json = data.root.meshes.get(index).ok_or_else(|| broken(format!("mesh {index} does not exist")))?;
    let name = mesh_name(data.root, index);
    let weights = pose.weights.or(json.weights.as_deref()).unwrap_or_default();
    let mut out = vec![];
    for p in &json.primitives {
        if let Some(mut mesh) = read_primitive(data, p, &name, parts)? {
            gltf_deform::morph(data, p, weights, &mut mesh)?;
            if let Some(joints) = &pose.joints {
                gltf_deform::skin(data, p, joints, &mut mesh)?;
            }
            // Repair the normals before the transform, because all nodes transform the same normals.
            part::repair_normals(&mut mesh, &name, &mut parts.notes);
            let material = match p.material.map(|m| m.value()) {
                Some(i) => {
                    let missing = || broken(format!("material {i} does not exist"));
                    Some(materials.get(i).ok_or_else(missing)?.clone())
                }
                None => None,
            };
            out.push(Local { material, mesh });
        }
    }
    Ok(out)
}

fn material_names(document: &Value) -> Vec<String> {
    let list = document["materials"].as_array().map_or(&[][..], Vec::as_slice);
    let name =
        |(i, m): (usize, &Value)| m["name"].as_str().map_or_else(|| format!("material_{i}"), str::to_owned);
    list.iter().enumerate().map(name).collect()
}

/// Reads a primitive. Returns `None` and adds a note if the primitive has no triangles.
fn read_primitive(
    data: &Data,
    p: &Primitive,
    name: &str,
    parts: &mut Parts,
) -> Result<Option<Mesh>, ImportError> {
    let mode = match p.mode {
        Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => mode,
        Checked::Valid(_) => {
            parts.notes.add(format!("points or lines of mesh {name:?} are skipped"));
            return Ok(None);
        }
        Checked::Invalid => {
            return Err(broken(format!("mesh {name:?} has a primitive whose `mode` is unknown")));
        }
    };
    let attribute = |s| p.attributes.get(&Checked::Valid(s)).map(Index::value);
    let Some(positions) = attribute(Semantic::Positions) else {
        parts.notes.add(format!("a primitive of mesh {name:?} has no attribute POSITION and is skipped"));
        return Ok(None);
    };
    let vec3 = |index| -> Result<Vec<Vec3>, ImportError> {
        Ok(data.floats(index)?.into_iter().map(Vec3::from_array).collect())
    };
    let positions = vec3(positions)?;
    let normals = attribute(Semantic::Normals).map(vec3).transpose()?.unwrap_or_default();
    let uvs = match attribute(Semantic::TexCoords(0)) {
        // glTF's v starts at the image's upper left corner, and Sunstone's v starts at the lower left corner.
        Some(index) => data.floats(index)?.into_iter().map(|[u, v]| Vec2::new(u, 1.0 - v)).collect(),
        None => Vec::new(),
    };
    let order = match p.indices {
        Some(accessor) => data.indices(accessor.value())?,
        None => (0..u32::try_from(positions.len()).unwrap_or(u32::MAX)).collect(),
    };
    if mode == Mode::Triangles {
        let note = format!(
            "a surplus index of mesh {name:?} is skipped: the number of indices is not a multiple of three"
        );
        parts.notes.add_times(note, order.len() % 3);
    }
    Ok(Some(Mesh { positions, normals, uvs, indices: triangles(mode, &order) }))
}

/// Splits an index list into triangles (specification, section 3.7.2.1).
fn triangles(mode: Mode, order: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => {
            let turned = |(i, w): (usize, &[u32])| match i % 2 {
                0 => [w[0], w[1], w[2]],
                _ => [w[0], w[2], w[1]],
            };
            order.windows(3).enumerate().map(turned).collect()
        }
        Mode::TriangleFan => match order.split_first() {
            Some((&first, rest)) => rest.windows(2).map(|w| [w[0], w[1], first]).collect(),
            None => vec![],
        },
        _ => order.as_chunks().0.to_vec(),
    }
}
