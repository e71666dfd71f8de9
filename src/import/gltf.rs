//! glTF 2.0, as JSON or GLB (Khronos, "glTF 2.0 specification", 2021), with `EXT_mesh_gpu_instancing` and
//! `KHR_mesh_quantization`.
//!
//! The node tree is walked in double precision and every mesh is baked to world space once per node that uses it.
//! glTF is right-handed with +y up and in metres, as Sunstone is.

use std::borrow::Cow;
use std::path::Path;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec2, Vec3};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::scene::Node;
use gltf::json::validation::Checked;
use gltf::json::{Index, Root, Value};

use super::accessor::{Data, broken, percent_decoded};
use super::error::{ImportError, ImportProblem};
use super::part::{MeshPart, finish};
use transport::geometry::mesh::Mesh;

/// The most triangles that instancing may blow one file up to (about 2 GB of tables).
const MAX_TRIANGLES: usize = 1 << 26;

pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// Extensions that change nothing here, or are read.
const KNOWN: [&str; 4] = [
    INSTANCING,
    "KHR_mesh_quantization",
    "KHR_lights_punctual",
    "KHR_texture_transform",
];

/// Reads a glTF document or GLB container. Takes the default scene, else all scenes, else all nodes, else all meshes;
/// each primitive of each node that has a mesh becomes a part named after the node, baked to world space. `base_dir`
/// is where external buffers are looked up; without it they are an error. Materials without a name are called
/// `material_` and their number. Vertex attributes other than positions, normals and the first uv set are ignored.
///
/// # Errors
/// [`ImportError`] if the file is broken, its nodes are not a tree, it needs an extension that is not read (Draco and
/// meshopt compression among them), uses points or lines, skins or morph weights, or no triangles are left.
pub fn parse_gltf(bytes: &[u8], base_dir: Option<&Path>) -> Result<Vec<MeshPart>, ImportError> {
    let (json, blob) = container(bytes)?;
    // Not `deserialize::from_slice`, which would be compiled for `Root` here, optimized, once more.
    let root = Root::from_slice(&json).map_err(|e| broken(format!("the glTF JSON cannot be read ({e})")))?;
    if !root.asset.version.starts_with("2.") {
        let what = format!("the glTF version is {}", root.asset.version);
        return Err(ImportError::unsupported(what, "export as glTF 2.0"));
    }
    let unknown = |e: &&String| !KNOWN.contains(&e.as_str()) && !e.starts_with("KHR_materials_");
    if let Some(extension) = root.extensions_required.iter().find(unknown) {
        let what = format!("the file requires the extension {extension}");
        return Err(ImportError::unsupported(
            what,
            "export again without it (for compression: switch it off)",
        ));
    }
    let data = Data::new(&root, blob.as_deref(), base_dir)?;
    let mut importer = Importer {
        data,
        primitives: vec![None; root.meshes.len()],
        parts: Vec::new(),
        triangles: 0,
    };
    importer.walk()?;
    if importer.parts.is_empty() {
        return Err(broken("no node of the scene has a mesh"));
    }
    Ok(importer.parts)
}

/// Names of the files beside a document that hold its buffers, as far as it can be read.
#[must_use]
pub fn gltf_buffers(bytes: &[u8]) -> Vec<String> {
    let root = container(bytes)
        .ok()
        .and_then(|(json, _)| Root::from_slice(&json).ok());
    let buffers = root.map(|root| root.buffers).unwrap_or_default();
    let uris = buffers.iter().filter_map(|buffer| buffer.uri.as_deref());
    uris.filter(|uri| !uri.contains(':'))
        .filter_map(percent_decoded)
        .collect()
}

/// Bytes of a file, or unpacked from it.
type Bytes<'a> = Cow<'a, [u8]>;

/// A file's JSON, and the chunk of bytes behind it in a GLB.
pub(super) fn container(bytes: &[u8]) -> Result<(Bytes<'_>, Option<Bytes<'_>>), ImportError> {
    if bytes.is_empty() {
        return Err(ImportProblem::EmptyFile.into());
    }
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.into(), None));
    }
    // The crate subtracts the header's size from its length field unchecked.
    let length = bytes
        .get(8..12)
        .and_then(|b| b.try_into().ok())
        .map_or(0, u32::from_le_bytes);
    if length < 12 {
        return Err(broken(
            "the GLB header is cut off or gives a length of less than 12",
        ));
    }
    let glb =
        gltf::Glb::from_slice(bytes).map_err(|e| broken(format!("the GLB container is broken ({e})")))?;
    Ok((glb.json, glb.bin))
}

struct Importer<'a> {
    data: Data<'a>,
    /// The primitives of each mesh in its own space, once read.
    primitives: Vec<Option<Vec<MeshPart>>>,
    parts: Vec<MeshPart>,
    triangles: usize,
}

impl Importer<'_> {
    fn walk(&mut self) -> Result<(), ImportError> {
        let root = self.data.root;
        if root.nodes.is_empty() {
            for mesh in 0..root.meshes.len() {
                self.place(mesh, None, &[DAffine3::IDENTITY])?;
            }
            return Ok(());
        }
        let mut stack: Vec<_> = roots(root)?
            .into_iter()
            .map(|n| (n, DAffine3::IDENTITY))
            .collect();
        stack.reverse();
        let mut visited = vec![false; root.nodes.len()];
        while let Some((index, parent)) = stack.pop() {
            let node = root
                .nodes
                .get(index)
                .ok_or_else(|| broken(format!("node {index} does not exist")))?;
            if std::mem::replace(&mut visited[index], true) {
                return Err(broken(format!(
                    "node {index} is reached twice (a cycle, or a child of two parents)"
                )));
            }
            let world = parent * local(node, index)?;
            if let Some(mesh) = node.mesh {
                if node.skin.is_some() || node.weights.iter().flatten().any(|&w| w != 0.0) {
                    let what = format!("node {index} is deformed by a skin or morph weights");
                    return Err(ImportError::unsupported(
                        what,
                        "apply the deformation before exporting",
                    ));
                }
                let instances: Vec<_> = self.instances(node)?.iter().map(|i| world * *i).collect();
                self.place(mesh.value(), node.name.as_deref(), &instances)?;
            }
            for child in node.children.iter().flatten().rev() {
                stack.push((child.value(), world));
            }
        }
        Ok(())
    }

    /// The maps of `EXT_mesh_gpu_instancing`, or the identity alone.
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
                None => Err(broken(format!("{INSTANCING}: {name} is not an accessor"))),
            }
        };
        let moves = accessor("TRANSLATION")?
            .map(|i| self.data.floats::<3>(i))
            .transpose()?;
        let turns = accessor("ROTATION")?
            .map(|i| self.data.floats::<4>(i))
            .transpose()?;
        let scales = accessor("SCALE")?.map(|i| self.data.floats::<3>(i)).transpose()?;
        let counts = [
            moves.as_ref().map(Vec::len),
            turns.as_ref().map(Vec::len),
            scales.as_ref().map(Vec::len),
        ];
        let count = counts.iter().flatten().copied().next().unwrap_or(0);
        if counts.iter().flatten().any(|&c| c != count) || count == 0 {
            return Err(broken(format!(
                "{INSTANCING}: the attributes differ in count or have none"
            )));
        }
        (0..count)
            .map(|i| {
                trs(
                    moves.as_ref().map_or([0.0; 3], |m| m[i]),
                    turns.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |r| r[i]),
                    scales.as_ref().map_or([1.0; 3], |s| s[i]),
                )
                .ok_or_else(|| broken(format!("{INSTANCING}: instance {i} has no valid rotation")))
            })
            .collect()
    }

    /// Adds a mesh's primitives to the parts, once for each map to world space.
    fn place(&mut self, mesh: usize, node: Option<&str>, maps: &[DAffine3]) -> Result<(), ImportError> {
        if self.primitives.get(mesh).is_some_and(Option::is_none) {
            self.primitives[mesh] = Some(read_mesh(&self.data, mesh)?);
        }
        let Some(Some(primitives)) = self.primitives.get(mesh) else {
            return Err(broken(format!("mesh {mesh} does not exist")));
        };
        for (i, map) in maps.iter().enumerate() {
            for (k, local) in primitives.iter().enumerate() {
                self.triangles += local.mesh.indices.len();
                if self.triangles > MAX_TRIANGLES {
                    return Err(ImportError::unsupported(
                        format!("its instances have more than {MAX_TRIANGLES} triangles together"),
                        "use fewer instances or a simpler mesh",
                    ));
                }
                let mut name = node.unwrap_or(&local.name).to_owned();
                if maps.len() > 1 {
                    name += &format!("#{i}");
                }
                if primitives.len() > 1 {
                    name += &format!(".{k}");
                }
                let mut baked = local.mesh.clone();
                baked.transform(&map.as_affine3a());
                self.parts.push(finish(name, local.material.clone(), baked)?);
            }
        }
        Ok(())
    }
}

/// The nodes to start from.
fn roots(root: &Root) -> Result<Vec<usize>, ImportError> {
    let mut roots: Vec<usize> = match root.scene {
        Some(scene) => match root.scenes.get(scene.value()) {
            Some(scene) => scene.nodes.iter().map(Index::value).collect(),
            None => return Err(broken("the default scene does not exist")),
        },
        None if root.scenes.is_empty() => {
            let children = root.nodes.iter().flat_map(|n| n.children.iter().flatten());
            let mut is_child = vec![false; root.nodes.len()];
            for child in children {
                if let Some(flag) = is_child.get_mut(child.value()) {
                    *flag = true;
                }
            }
            (0..root.nodes.len()).filter(|&n| !is_child[n]).collect()
        }
        None => root
            .scenes
            .iter()
            .flat_map(|s| &s.nodes)
            .map(Index::value)
            .collect(),
    };
    // Several scenes may share their root nodes.
    let mut seen = std::collections::HashSet::new();
    roots.retain(|&n| seen.insert(n));
    Ok(roots)
}

/// A node's map to its parent.
fn local(node: &Node, index: usize) -> Result<DAffine3, ImportError> {
    let Some(m) = node.matrix else {
        return trs(
            node.translation.unwrap_or([0.0; 3]),
            node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |q| q.0),
            node.scale.unwrap_or([1.0; 3]),
        )
        .ok_or_else(|| {
            broken(format!(
                "the rotation of node {index} is not a quaternion of length 1"
            ))
        });
    };
    let column = |i: usize| DVec3::new(m[i].into(), m[i + 1].into(), m[i + 2].into());
    if [m[3], m[7], m[11], m[15] - 1.0].iter().any(|x| x.abs() > 1e-5) {
        let what = format!("the matrix of node {index} is not affine (its bottom row is not 0 0 0 1)");
        return Err(broken(what));
    }
    let linear = DMat3::from_cols(column(0), column(4), column(8));
    Ok(DAffine3::from_mat3_translation(linear, column(12)))
}

/// Translation · rotation · scale; the quaternion (x, y, z, w) is normalized, `None` if that is impossible.
fn trs(t: [f32; 3], r: [f32; 4], s: [f32; 3]) -> Option<DAffine3> {
    let q = DQuat::from_array(r.map(f64::from));
    let length = q.length();
    if !(0.5..2.0).contains(&length) {
        return None;
    }
    let [t, s] = [t, s].map(|v| DVec3::from_array(v.map(f64::from)));
    Some(DAffine3::from_scale_rotation_translation(s, q / length, t))
}

fn read_mesh(data: &Data, index: usize) -> Result<Vec<MeshPart>, ImportError> {
    let json = data
        .root
        .meshes
        .get(index)
        .ok_or_else(|| broken(format!("mesh {index} does not exist")))?;
    let name = json.name.clone().unwrap_or_else(|| format!("mesh_{index}"));
    if json.weights.iter().flatten().any(|&w| w != 0.0) {
        let what = format!("mesh {name:?} has morph weights");
        return Err(ImportError::unsupported(what, "apply them before exporting"));
    }
    if json.primitives.is_empty() {
        return Err(broken(format!("mesh {name:?} has no primitives")));
    }
    json.primitives
        .iter()
        .map(|p| {
            let mesh = read_primitive(data, p, &name)?;
            finish(name.clone(), material(data.root, p)?, mesh)
        })
        .collect()
}

fn material(root: &Root, p: &Primitive) -> Result<Option<String>, ImportError> {
    let Some(index) = p.material.map(|m| m.value()) else {
        return Ok(None);
    };
    match root.materials.get(index) {
        Some(m) => Ok(Some(
            m.name.clone().unwrap_or_else(|| format!("material_{index}")),
        )),
        None => Err(broken(format!("material {index} does not exist"))),
    }
}

fn read_primitive(data: &Data, p: &Primitive, name: &str) -> Result<Mesh, ImportError> {
    let Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) = p.mode else {
        let what = format!("mesh {name:?} is made of points or lines");
        return Err(ImportError::unsupported(
            what,
            "export triangles, or leave it out",
        ));
    };
    let attribute = |s| p.attributes.get(&Checked::Valid(s)).map(Index::value);
    let positions = attribute(Semantic::Positions)
        .ok_or_else(|| broken(format!("mesh {name:?} has no POSITION attribute")))?;
    let vec3 = |index| -> Result<Vec<Vec3>, ImportError> {
        Ok(data.floats(index)?.into_iter().map(Vec3::from_array).collect())
    };
    let positions = vec3(positions)?;
    let normals = attribute(Semantic::Normals)
        .map(vec3)
        .transpose()?
        .unwrap_or_default();
    let uvs = match attribute(Semantic::TexCoords(0)) {
        // Theirs count from the image's upper left corner, ours from its lower left.
        Some(index) => data
            .floats(index)?
            .into_iter()
            .map(|[u, v]| Vec2::new(u, 1.0 - v))
            .collect(),
        None => Vec::new(),
    };
    let order = match p.indices {
        Some(accessor) => data.indices(accessor.value())?,
        None => (0..u32::try_from(positions.len()).unwrap_or(u32::MAX)).collect(),
    };
    let indices = triangles(mode, &order)
        .ok_or_else(|| broken(format!("mesh {name:?} has {} indices in triangles", order.len())))?;
    Ok(Mesh {
        positions,
        normals,
        uvs,
        indices,
    })
}

/// Cuts an index list into triangles (specification, section 3.7.2.1); `None` if a list does not come out even.
fn triangles(mode: Mode, order: &[u32]) -> Option<Vec<[u32; 3]>> {
    match mode {
        Mode::TriangleStrip => Some(
            order
                .windows(3)
                .enumerate()
                .map(|(i, w)| {
                    if i % 2 == 0 {
                        [w[0], w[1], w[2]]
                    } else {
                        [w[0], w[2], w[1]]
                    }
                })
                .collect(),
        ),
        Mode::TriangleFan => {
            let (&first, rest) = order.split_first()?;
            Some(rest.windows(2).map(|w| [w[0], w[1], first]).collect())
        }
        _ => {
            let (whole, left) = order.as_chunks();
            left.is_empty().then(|| whole.to_vec())
        }
    }
}
