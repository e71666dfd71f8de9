//! Applies the morph targets and skins of glTF meshes in the rest pose (specification, sections 3.7.2.2 and
//! 3.7.3).

use glam::{DAffine3, DMat3, DVec3, Vec3};
use gltf::json::Index;
use gltf::json::mesh::{Primitive, Semantic};
use gltf::json::validation::Checked;

use super::accessor::Data;
use super::error::{ImportError, broken};
use transport::geometry::mesh::Mesh;

/// Deformation of a node's mesh.
#[derive(Default)]
pub(super) struct Pose<'a> {
    /// Weights of the morph targets, or `None` for the weights of the mesh.
    pub weights: Option<&'a [f32]>,
    /// Mesh-to-world transforms of the skin's joints, or `None` without a skin.
    pub joints: Option<Vec<DAffine3>>,
}

/// Returns the mesh-to-world transforms of a skin's joints. `worlds` are the node-to-world transforms.
pub(super) fn joints(
    data: &Data,
    skin: usize,
    worlds: &[Option<DAffine3>],
) -> Result<Vec<DAffine3>, ImportError> {
    let missing = || broken(format!("skin {skin} does not exist"));
    let json = data.root.skins.get(skin).ok_or_else(missing)?;
    let inverses = match json.inverse_bind_matrices {
        Some(accessor) => data.matrices(accessor.value())?,
        None => vec![],
    };
    if json.inverse_bind_matrices.is_some() && inverses.len() < json.joints.len() {
        let what = format!(
            "skin {skin} has {} inverse bind matrices, but {} joints",
            inverses.len(),
            json.joints.len()
        );
        return Err(broken(what));
    }
    let joint = |(i, node): (usize, &Index<_>)| {
        let world = worlds.get(node.value()).copied().flatten();
        let world =
            world.ok_or_else(|| broken(format!("joint {i} of skin {skin} is not part of a node tree")))?;
        Ok(inverses.get(i).map_or(world, |m| world * affine(m)))
    };
    json.joints.iter().enumerate().map(joint).collect()
}

fn affine(m: &[f32; 16]) -> DAffine3 {
    let column = |i: usize| DVec3::new(m[i].into(), m[i + 1].into(), m[i + 2].into());
    DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(4), column(8)), column(12))
}

pub(super) fn morph(data: &Data, p: &Primitive, weights: &[f32], mesh: &mut Mesh) -> Result<(), ImportError> {
    for (target, &weight) in p.targets.iter().flatten().zip(weights) {
        if weight == 0.0 {
            continue;
        }
        let add = |accessor: Option<Index<_>>, to: &mut [Vec3]| -> Result<(), ImportError> {
            let Some(accessor) = accessor else {
                return Ok(());
            };
            let moves = data.floats::<3>(accessor.value())?;
            if !to.is_empty() && moves.len() != to.len() {
                let what = format!(
                    "a morph target has displacements for {} vertices, but the mesh has {} vertices",
                    moves.len(),
                    to.len()
                );
                return Err(broken(what));
            }
            for (v, by) in to.iter_mut().zip(moves) {
                *v += weight * Vec3::from_array(by);
            }
            Ok(())
        };
        add(target.positions, &mut mesh.positions)?;
        add(target.normals, &mut mesh.normals)?;
    }
    Ok(())
}

/// Transforms vertices to world space with the weighted transforms of their joints.
pub(super) fn skin(
    data: &Data,
    p: &Primitive,
    joints: &[DAffine3],
    mesh: &mut Mesh,
) -> Result<(), ImportError> {
    let attribute = |s| p.attributes.get(&Checked::Valid(s)).map(Index::value);
    let mut sets = vec![];
    for set in 0.. {
        let (Some(of), Some(weights)) = (attribute(Semantic::Joints(set)), attribute(Semantic::Weights(set)))
        else {
            break;
        };
        let (of, weights) = (data.joints(of)?, data.floats::<4>(weights)?);
        if [of.len(), weights.len()] != [mesh.positions.len(); 2] {
            return Err(broken(format!(
                "in a primitive with a skin, the numbers of joints ({}), weights ({}) and positions ({}) differ",
                of.len(),
                weights.len(),
                mesh.positions.len()
            )));
        }
        sets.push((of, weights));
    }
    if sets.is_empty() {
        return Err(broken(
            "a node has a skin, but a primitive of its mesh has no attributes JOINTS_0 and WEIGHTS_0, which assign joints and weights \
             to vertices",
        ));
    }
    let mut mirrored = 0;
    for vertex in 0..mesh.positions.len() {
        let (mut sum, mut linear, mut offset) = (0.0, DMat3::ZERO, DVec3::ZERO);
        for (of, weights) in &sets {
            for (&joint, &weight) in of[vertex].iter().zip(&weights[vertex]) {
                if weight == 0.0 {
                    continue;
                }
                let missing = || {
                    broken(format!(
                        "vertex {vertex} refers to joint {joint}, but the skin has no joint with this index"
                    ))
                };
                let map = joints.get(joint as usize).ok_or_else(missing)?;
                let weight = f64::from(weight);
                sum += weight;
                linear += map.matrix3 * weight;
                offset += map.translation * weight;
            }
        }
        if sum == 0.0 {
            return Err(broken(format!(
                "in a primitive with a skin, the weights of vertex {vertex} are all 0"
            )));
        }
        // Divide by the sum of the weights, which is 1 only up to rounding.
        let (linear, offset) = (linear * sum.recip(), offset / sum);
        let position = &mut mesh.positions[vertex];
        *position = (linear * position.as_dvec3() + offset).as_vec3();
        let mirrors = linear.determinant() < 0.0;
        mirrored += usize::from(mirrors);
        if let Some(normal) = mesh.normals.get_mut(vertex) {
            let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
            let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
            let turned = cofactors * normal.as_dvec3() * if mirrors { -1.0 } else { 1.0 };
            *normal = turned.normalize_or_zero().as_vec3();
        }
    }
    if 2 * mirrored > mesh.positions.len() {
        mesh.indices.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Ok(())
}
